"""`testfield run SCENE`: the whole chain."""

import argparse
import os
from pathlib import Path
from typing import Any

from testfield.cli.show import add_strict


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("run", help="render, measure and score a scene: the whole chain", description=__doc__)
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML)")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="the run's folder (default: renders/<scene's name>)")
    p.add_argument("--seed", type=int, metavar="N", help="another seed than the scene file's")
    p.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes at once (default: one a core)",
    )
    p.add_argument("--json", action="store_true", help="print the scorecard as one JSON object")
    add_strict(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Run the chain; stages whose inputs have not changed are not repeated."""
    from testfield.chain.run import checked, lay_out
    from testfield.chain.stages import STAGES, refuse_frames_of_others, run_stage
    from testfield.cli.show import failures_in, jobs_of, show_result, show_warnings, status_of
    from testfield.errors import TestfieldError
    from testfield.store.lock import only_writer

    if args.seed is not None and args.seed < 0:
        raise TestfieldError(f"value {args.seed} is negative", "--seed", "give 0 or more")
    run, content, warnings = checked(args.scene, args.out, args.seed, jobs_of(args.jobs))
    with only_writer(run.folder):
        lay_out(run, content, warnings)
        show_warnings(warnings)
        refuse_frames_of_others(run)  # before anything is rendered in vain
        for name in STAGES:
            run_stage(run, name)
    show_warnings(run.measuring_notes())
    show_result(run.folder, args.json)
    return status_of(failures_in(run.folder / "scorecard.json"), args.strict)
