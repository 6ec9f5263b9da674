"""`testfield export SCENE`: frames, field sheet, observations and truth as files that any program reads."""

import argparse
import os
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "export",
        help="frames, field sheet and truth as PNG, JSON and CSV, for programs of others",
        description="The scene is rendered where that has not been done. Results that a program makes of the images, "
        "put beside export.json, are measured and compared by recipes with `folder` (OWN_ALGORITHMS.md).",
    )
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML), or the name of one that comes along")
    p.add_argument(
        "--out", type=Path, metavar="FOLDER", help="where the files go (default: renders/<the run's name>-export)"
    )
    p.add_argument(
        "--draws",
        type=int,
        metavar="N",
        help="N draws of noise, each in a folder of its own: those that `testfield compare` measures by default",
    )
    p.add_argument("--seed", type=int, metavar="N", help="another world")
    p.add_argument("--noise-seed", type=int, metavar="N", help="other noise in the same world")
    p.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes at once (default: one a core)"
    )
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Render what is missing, and write the files."""
    from testfield.chain.complete import complete
    from testfield.chain.export import STAGES, export_run
    from testfield.cli.show import jobs_of, seed_of_option, show_warnings
    from testfield.errors import TestfieldError
    from testfield.evaluate.comparison_cases import noise_of
    from testfield.scene.load import load_scene
    from testfield.scene.shipped import find_scene

    if args.draws is not None and args.noise_seed is not None:
        raise TestfieldError("draws have noise seeds of their own", "--noise-seed", "leave it or --draws out")
    if args.draws is not None and args.draws < 1:
        raise TestfieldError(f"value {args.draws}", "--draws", "give 1 or more")
    seed, noise_seed = seed_of_option("--seed", args.seed), seed_of_option("--noise-seed", args.noise_seed)
    draws = {0: noise_seed}
    if args.draws is not None:
        name = load_scene(find_scene(args.scene)).name
        draws = {draw: noise_of(name, draw) for draw in range(1, args.draws + 1)}
    for draw, noise in draws.items():
        warn = show_warnings if draw < 2 else lambda _: None
        run, _ = complete(args.scene, None, seed, noise, jobs_of(args.jobs), False, warn, STAGES)
        out = args.out or run.folder.parent / f"{run.scene.name}-export"
        folder = out if args.draws is None else out / f"noise{draw}"
        export_run(run, folder)
        print(folder)
    return 0
