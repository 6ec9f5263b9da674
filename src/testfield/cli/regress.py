"""`testfield regress record|check|history|selftest`: has a change of the code made a figure worse, and is it sure."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from testfield.cli.clusters import add_cluster, cluster_of
from testfield.cli.show import add_load

OUT = Path("renders/regress")
HISTORY = "history.sqlite"


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "regress", help="hold a suite's figures against a recorded baseline, with certainty", description=__doc__
    )
    parts = p.add_subparsers(dest="part", metavar="record|check|history|selftest", required=True)
    for name, what in (
        ("record", "measure a suite and write its baseline beside it"),
        ("check", "measure a suite again and judge every figure against its baseline"),
    ):
        q = parts.add_parser(name, help=what, description=what)
        q.add_argument("suite", type=Path, metavar="SUITE.toml", help="a suite (FORMATS.md)")
        _common(q)
        q.add_argument("--budget", type=int, metavar="N", help="draws of noise at most, instead of the suite's")
        q.add_argument("--baseline", type=Path, metavar="FILE", help="default: SUITE.baseline.json beside the suite")
        add_load(q)
        if name == "check":
            q.add_argument("--junit", type=Path, metavar="FILE", help="default: junit.xml in the folder")
            _history(q)
            q.add_argument("--all", action="store_true", help="show figures that pass, too")
    q = parts.add_parser("selftest", help="plant defects: each must be found, and unchanged code raise no alarm")
    _common(q)
    q.add_argument(
        "--unchanged",
        type=int,
        default=20,
        metavar="N",
        help="checks of unchanged code under other noise (default: 20)",
    )
    q.add_argument("--only", default="", metavar="WORD", help="only defects whose title has this word")
    q.add_argument(
        "--simulate", type=int, default=2000, metavar="N", help="simulated checks of unchanged code (default: 2000)"
    )
    q = parts.add_parser("history", help="write a page of each figure over all checks, with its change points")
    q.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help=f"where history.sqlite lies, default: {OUT}")
    _history(q)
    q.add_argument("--page", type=Path, metavar="FILE.html", help="default: history.html beside the database")
    p.set_defaults(act=act)


def _history(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--history", type=Path, metavar="FILE", help="database, default: history.sqlite in the folder")


def _common(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=OUT, metavar="FOLDER", help=f"kept cases, default: {OUT}")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: one a core)"
    )
    add_cluster(parser)


def act(args: argparse.Namespace) -> int:
    """Do one of the parts. Exit status 0: all pass; 1: something is worse, missing or no number; 2: it could not run;
    3: something is unknown after the budget."""
    return {"record": _record, "check": _check, "history": _history_page, "selftest": _selftest}[args.part](args)


def _record(args: argparse.Namespace) -> int:
    from testfield.cli.show import jobs_of
    from testfield.evaluate.regress.check import recorded
    from testfield.evaluate.regress.suite import Suite, baseline_path
    from testfield.store.lock import only_writer

    suite = Suite.load(args.suite).within(args.budget)
    path = args.baseline or baseline_path(args.suite)
    with only_writer(args.out), cluster_of(args, args.out) as pool:
        baseline, said = recorded(suite, args.out, jobs_of(args.jobs), pool)
    baseline.save(path)
    for line in said:
        print(f"not a number: {line}", file=sys.stderr)
    print(f"{len(baseline.figures)} figures of {len(baseline.scenes)} scene(s), {baseline.draws} draws of noise")
    print(path)
    return 1 if said else 0


def _check(args: argparse.Namespace) -> int:
    from testfield.cli.show import jobs_of
    from testfield.evaluate.regress.baseline import Baseline, made_here
    from testfield.evaluate.regress.cases import setups_of
    from testfield.evaluate.regress.check import checked, recorded
    from testfield.evaluate.regress.history import append
    from testfield.evaluate.regress.notes import notes_of
    from testfield.evaluate.regress.suite import Suite, baseline_path, candidate_path
    from testfield.evaluate.regress.summary import counted, lines_of, write_junit, write_markdown
    from testfield.evaluate.regress.verdict import status_of
    from testfield.store.lock import only_writer

    junit, summary = args.junit or args.out / "junit.xml", args.out / "summary.md"
    for earlier in (junit, summary):
        earlier.unlink(missing_ok=True)  # whoever reads them must not take an earlier check for this one
    suite = Suite.load(args.suite).within(args.budget)
    path, jobs = args.baseline or baseline_path(args.suite), jobs_of(args.jobs)
    setups = setups_of(suite)
    if not path.exists():
        print(f"missing: {path}; a candidate for it is measured", file=sys.stderr)
        with only_writer(args.out), cluster_of(args, args.out) as pool:
            recorded(suite, args.out, jobs, pool)[0].save(candidate_path(args.suite))
        print(f"missing: {path}; {_candidate(args.suite, path)}")
        return 1
    baseline = Baseline.load(path)
    baseline.belongs_to(suite, setups, path)
    with only_writer(args.out), cluster_of(args, args.out) as pool:
        found = checked(suite, baseline, args.out, jobs, pool)
        if found.lacking:
            recorded(suite, args.out, jobs, pool)[0].save(candidate_path(args.suite))
        notes = notes_of(suite, baseline, found)
        write_junit(found.findings, suite.name, junit)
        write_markdown(found.findings, suite.name, notes, summary)
    for line in lines_of(found.findings, args.all):
        print(line)
    for note in notes:
        print(note, file=sys.stderr)
    if found.lacking:
        print(_candidate(args.suite, path), file=sys.stderr)
    print(f"{suite.name}: {counted(found.findings)}")
    print(summary)
    sys.stdout.flush()
    append(args.history or args.out / HISTORY, suite, found, made_here(suite))
    return status_of(found.findings)


def _candidate(suite: Path, baseline: Path) -> str:
    from testfield.evaluate.regress.suite import candidate_path

    return f"a candidate was stored in {candidate_path(suite)}: look at it, and rename it to {baseline}"


def _history_page(args: argparse.Namespace) -> int:
    from testfield.evaluate.regress.history_page import write_history

    database = args.history or args.out / HISTORY
    print(write_history(database, args.page or database.with_name("history.html")))
    return 0


def _selftest(args: argparse.Namespace) -> int:
    from testfield.cli.show import jobs_of
    from testfield.evaluate.regress.selftest import tried
    from testfield.evaluate.regress.selftest_table import alarms_line, header, row, write_table
    from testfield.evaluate.regress.simulation import SHAPES, simulated
    from testfield.store.lock import only_writer

    simulations = [simulated(shape, args.simulate) for shape in SHAPES] if args.simulate > 0 else []
    print(header(), flush=True)
    outcomes = []
    with only_writer(args.out), cluster_of(args, args.out) as pool:
        for one in tried(args.out, jobs_of(args.jobs), pool, args.unchanged, args.only):
            print(row(one), flush=True)
            outcomes.append(one)
        path = write_table(outcomes, simulations, args.out / "selftest.md")
    for alarms in simulations:
        print(alarms_line(alarms))
    print(path)
    good = all(one.as_it_should for one in outcomes) and all(one.kept for one in simulations)
    return 0 if good else 1
