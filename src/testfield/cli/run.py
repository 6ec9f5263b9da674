"""`testfield run SCENE`: the whole chain."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from testfield.cli.show import add_load, add_strict


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("run", help="render, measure and score a scene: the whole chain", description=__doc__)
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML), or the name of one that comes along")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="the run's folder (default: renders/<scene's name>)")
    p.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="FIELD=VALUE",
        help="set a field for this run, as camera.focal_length_mm=35 or boards.A.bow_mm=2; may be repeated; default "
        "folder renders/<name>-FIELD=VALUE",
    )
    p.add_argument("--seed", type=int, metavar="N", help="another world: default folder renders/<name>-seedN")
    p.add_argument(
        "--noise-seed",
        type=int,
        metavar="N",
        help="the same world with other noise, nothing rendered twice: folder <the world's folder>-noiseN",
    )
    p.add_argument(
        "--force", action="store_true", help="begin again whatever is there; frames of your own are never touched"
    )
    p.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes at once (default: one a core)",
    )
    p.add_argument("--json", action="store_true", help="print the scorecard as one JSON object")
    add_load(p)
    add_strict(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Run the chain; stages whose inputs have not changed are not repeated."""
    from functools import partial

    from testfield.chain.complete import complete
    from testfield.cli.show import failures_in, jobs_of, seed_of_option, show_result, show_warnings, status_of
    from testfield.errors import gather
    from testfield.scene.changes import Change

    seed, noise_seed = seed_of_option("--seed", args.seed), seed_of_option("--noise-seed", args.noise_seed)
    run, made = complete(
        args.scene,
        args.out,
        seed,
        noise_seed,
        jobs_of(args.jobs),
        args.force,
        show_warnings,
        changes=tuple(gather(*(partial(Change.parse, text) for text in args.set))),
    )
    if not made:
        print(f"run: nothing to do, all is up to date ({run.folder})", file=sys.stderr)
    show_warnings(run.measuring_notes())
    show_result(run.folder, args.json)
    return status_of(failures_in(run.folder / "scorecard.json"), args.strict)
