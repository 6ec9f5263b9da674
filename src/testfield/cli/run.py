"""`testfield run SCENE`: the whole chain."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testfield.cli.show import add_strict

if TYPE_CHECKING:
    from testfield.chain.run import Run


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("run", help="render, measure and score a scene: the whole chain", description=__doc__)
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML), or the name of one that comes along")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="the run's folder (default: renders/<scene's name>)")
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
    add_strict(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Run the chain; stages whose inputs have not changed are not repeated."""
    from testfield.chain.run import checked, share_radiance
    from testfield.cli.show import failures_in, jobs_of, seed_of_option, show_result, show_warnings, status_of
    from testfield.store.lock import only_writer

    seed, noise_seed = seed_of_option("--seed", args.seed), seed_of_option("--noise-seed", args.noise_seed)
    jobs = jobs_of(args.jobs)
    world = checked(args.scene, args.out, seed, jobs)
    run, content, warnings = world if noise_seed is None else checked(args.scene, args.out, seed, jobs, noise_seed)
    made = False
    if run.folder != world[0].folder:
        base = world[0]
        with only_writer(base.folder):
            made = _chain(base, world[1], warnings, args.force, ("render",))
            with only_writer(run.folder):
                _lay_out(run, content, warnings, args.force)
                share_radiance(base, run)
    with only_writer(run.folder):
        show_warnings(warnings)
        made |= _chain(run, content, warnings, args.force and run is world[0], None)
    if not made:
        print(f"run: nothing to do, all is up to date ({run.folder})", file=sys.stderr)
    show_warnings(run.measuring_notes())
    show_result(run.folder, args.json)
    return status_of(failures_in(run.folder / "scorecard.json"), args.strict)


def _chain(run: "Run", content: bytes, warnings: list[str], force: bool, stages: tuple[str, ...] | None) -> bool:
    """Lay out a run and do some stages, or all; whether anything was made."""
    from testfield.chain.stages import STAGES, run_stage
    from testfield.cli.show import watched

    _lay_out(run, content, warnings, force)
    made = False
    for name in stages or tuple(STAGES):
        with watched(name):
            made |= run_stage(run, name)
    return made


def _lay_out(run: "Run", content: bytes, warnings: list[str], force: bool) -> None:
    """Lay out a run's folder, emptied first where that is asked for.

    Frames of somebody's own are refused before anything is removed, or rendered in vain.
    """
    from testfield.chain.run import clear, lay_out
    from testfield.chain.stages import refuse_frames_of_others

    refuse_frames_of_others(run)
    if force:
        clear(run)
    lay_out(run, content, warnings)
