"""`testfield sweep SCENE`: a scene with varied fields, each case rendered, measured and scored, and plots of them."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from testfield.cli.clusters import add_cluster, cluster_of
from testfield.cli.show import add_load


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "sweep", help="vary fields of a scene, and plot what becomes of the figures", description=__doc__
    )
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene with [vary], or a file with `scene` and [vary]")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="where cases are kept (default: renders/<name>-sweep)")
    p.add_argument("--cases", action="store_true", help="say which cases there are, and do none")
    p.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: one a core)")
    p.add_argument("--json", action="store_true", help="print all rows as one JSON object")
    add_cluster(p)
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Do what is missing of all cases; write the page and its table. Exit status 1 where cases failed."""
    import json

    from testfield.cli.show import jobs_of
    from testfield.evaluate.execute import execute
    from testfield.evaluate.failures import FAILURE
    from testfield.evaluate.sweep import Sweep
    from testfield.evaluate.sweep_page import figures_of, write_sweep
    from testfield.score.scorecard import plain
    from testfield.store.lock import only_writer

    sweep = Sweep.load(args.scene)
    count, how = sweep.size
    print(f"sweep: {count:,} cases: {how}", file=sys.stderr)
    cases = sweep.cases()
    if args.cases:
        labels = [case.labels for case in cases]
        print(json.dumps(labels) if args.json else "\n".join(_line(one) for one in labels))
        return 0
    out = args.out or Path("renders") / f"{sweep.name}-sweep"
    with only_writer(out):
        with cluster_of(args, out) as pool:
            rows = execute(cases, out, jobs_of(args.jobs), "sweep", pool=pool)
        page = write_sweep(sweep, rows, out)
    failed = rows[rows[FAILURE].notna()] if FAILURE in rows else rows.iloc[:0]
    if args.json:
        print(json.dumps(plain({"cases": count, "rows": rows.to_dict("records")})))
    else:
        for row in rows.drop(index=failed.index).to_dict("records"):
            figures = ", ".join(f"{key} {row[key]:.4g}" for _, key in figures_of(rows)[-4:])
            print(f"{_line({k: v for k, v in row.items() if k in cases[0].labels})}: {figures}")
        print(page)
    for row in failed.to_dict("records"):
        print(f"case {row['case']} failed: {row[FAILURE]}", file=sys.stderr)
    return 1 if len(failed) else 0


def _line(labels: dict[str, Any]) -> str:
    return " ".join(f"{name}={value}" for name, value in labels.items() if name != "scene")
