"""`testfield render|expose|calibrate|reconstruct|score|report RUN`: one stage on a run's folder."""

import argparse
import os
from pathlib import Path
from typing import Any

from testfield.cli.show import add_strict

STAGES = {
    "render": "radiance images of all stations (EXR)",
    "expose": "digital frames from the radiance (16-bit PNG)",
    "detect": "find, centre, decode and identify the targets in the frames",
    "calibrate": "camera, stations and boards from the observations",
    "reconstruct": "scale-bar ends and check targets from observations and calibration",
    "score": "everything measured against the truth",
    "report": "the HTML page",
}

JUDGED = {"calibrate": "calibration.json", "score": "scorecard.json", "report": "scorecard.json"}
"""Stages after which something can have failed, and the file that says so."""


def add(commands: Any) -> None:
    """Enter a command a stage; `detect` has more to it and its own file."""
    for name, what in STAGES.items():
        if name == "detect":
            continue
        p = commands.add_parser(
            name,
            help=what,
            description=f"One stage alone: {what}. Its inputs are taken from the folder as they are.",
        )
        p.add_argument("run", type=Path, metavar="RUN", help="a run's folder")
        p.add_argument(
            "--jobs",
            type=int,
            default=os.cpu_count() or 1,
            metavar="N",
            help="processes at once (default: one a core)",
        )
        p.add_argument("--json", action="store_true", help="print one JSON object")
        if name in JUDGED:
            add_strict(p)
        p.set_defaults(act=act, stage=name, strict=False)


def act(args: argparse.Namespace) -> int:
    """Run the stage, unless what it would make is there already."""
    from testfield.chain.complete import stage
    from testfield.chain.run import resume, scene_of
    from testfield.chain.stages import remarks
    from testfield.cli.show import failures_in, jobs_of, show_result, show_warnings, status_of
    from testfield.store.atomic import sweep
    from testfield.store.lock import only_writer

    scene_of(args.run)
    with only_writer(args.run):
        sweep(args.run)
        run = resume(args.run, jobs_of(args.jobs))
        made = stage(run, args.stage)
        warnings = remarks(run)
        show_warnings(warnings)
    if args.json:
        _print_json(args, made, warnings)
    else:
        print(f"{args.stage}: {'done' if made else 'nothing to do, all is up to date'} ({args.run})")
        if args.stage == "score":
            show_result(args.run, as_json=False)
    if args.stage in JUDGED:
        return status_of(failures_in(args.run / JUDGED[args.stage]), args.strict)
    return 0


def _print_json(args: argparse.Namespace, made: bool, warnings: list[str]) -> None:
    """The scorecard where that is what the stage makes; otherwise whether it made anything, and what failed."""
    import json

    from testfield.cli.show import failures_in, show_result

    if args.stage == "score":
        show_result(args.run, as_json=True)
        return
    failures = failures_in(args.run / JUDGED[args.stage]) if args.stage in JUDGED else []
    said = {"stage": args.stage, "run": str(args.run), "made": made, "warnings": warnings, "failures": failures}
    print(json.dumps(said))
