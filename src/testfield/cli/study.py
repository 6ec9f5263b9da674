"""`testfield study NAME`: one of the thesis' claims, put to the test on rendered experiments."""

import argparse
import os
from pathlib import Path
from typing import Any

from testfield.cli.clusters import add_cluster, cluster_of
from testfield.store.text import read_text


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "study", help="put one of the thesis' claims to the test on rendered experiments", description=__doc__
    )
    p.add_argument("name", metavar="NAME", help="wls, grey, fitting_point, stitching, or one of your own")
    p.add_argument("--quick", action="store_true", help="a small version of the experiment, for a first look")
    p.add_argument("--so-far", action="store_true", help="do nothing more: the page of what is finished")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="default: renders/study-NAME, with --quick -quick")
    p.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: one a core)")
    p.add_argument("--json", action="store_true", help="print the findings as one JSON object")
    add_cluster(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Do what is missing and print the verdict."""
    import textwrap

    from testfield.cli.show import jobs_of
    from testfield.store.lock import only_writer
    from testfield.study.studies import find_study
    from testfield.study.study import run_study

    study = find_study(args.name)
    folder = args.out or Path("renders") / f"study-{study.name}{'-quick' if args.quick else ''}"
    with only_writer(folder), cluster_of(args, folder) as pool:
        results = run_study(study, folder, args.quick, jobs_of(args.jobs), args.so_far, pool)
    if args.json:
        print(read_text(folder / "findings.json"))
        return 0
    print(f"{study.title}\n\nclaim    {textwrap.fill(study.claim, 100, subsequent_indent=9 * ' ')}")
    print(f"verdict  {study.verdict(results)}\n")
    for finding in results.findings:
        print(textwrap.fill(finding.question, 100, initial_indent=f"{finding.outcome:<9}", subsequent_indent=9 * " "))
    print()
    for paragraph in study.concluded(results):
        print(textwrap.fill(paragraph, 108) + "\n")
    print(folder / "report.html")
    return 0
