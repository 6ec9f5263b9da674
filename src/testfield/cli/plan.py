"""`testfield plan SCENE`: what a scene will measure, predicted before any image, and where more stations gain most."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testfield.cli.show import add_load

if TYPE_CHECKING:
    from testfield.plan.job import Job
    from testfield.plan.predict import Prediction


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("plan", help="predict what a scene will measure, and propose stations", description=__doc__)
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML), or the name of one that comes along")
    p.add_argument("--json", action="store_true", help="print one JSON object: every point, length and parameter")
    p.add_argument("--page", type=Path, metavar="PAGE.html", help="write a page of its own with maps of the volume")
    p.add_argument("--next", type=int, metavar="N", help="propose N stations more, where they gain most")
    p.add_argument(
        "--goal",
        metavar="NAME=VALUE",
        help="propose as many stations as it takes: u_length_mm=0.02 (check bars and lines, else distances of check "
        "targets), u_rms_mm, u_worst_mm (check targets), u_corner_px (interior orientation)",
    )
    p.add_argument("--replace", action="store_true", help="propose all stations anew, whatever the scene has")
    p.add_argument("--candidates", default="sphere", help="where stations may be: sphere (default), grid or mesh")
    p.add_argument("--mesh", metavar="NAME", help="the mesh that candidates stand around; the first, if not given")
    p.add_argument("--range-mm", type=float, metavar="R", help="how far they stand; absent, as the scene's own")
    p.add_argument("--clearance-mm", type=float, default=300.0, metavar="C", help="from every surface (300)")
    p.add_argument("--most", type=int, default=60, metavar="N", help="the most stations that a goal may take (60)")
    p.add_argument("--exposures", action="store_true", help="say what more exposures gain, of all and of each station")
    p.add_argument("--out", type=Path, metavar="NEW.toml", help="write the scene with the proposed stations")
    p.add_argument("--force", action="store_true", help="overwrite NEW.toml and PAGE.html")
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Predict, propose, and show it."""
    import json

    from testfield.chain.run import check_algorithms
    from testfield.cli.show import show_warnings
    from testfield.plan.card import card_of
    from testfield.plan.job import Job
    from testfield.plan.network import planned
    from testfield.plan.predict import predict
    from testfield.scene.document import load_document
    from testfield.scene.load import numbered, scene_from
    from testfield.scene.shipped import find_scene
    from testfield.score.scorecard import plain
    from testfield.store.sheets import FORMAT
    from testfield.store.threads import one_blas_thread

    _check(args)
    path = find_scene(args.scene)
    document = load_document(path)
    scene = scene_from(document)
    with one_blas_thread(), numbered(document):
        check_algorithms(scene, str(path))
        job = Job.of(scene, str(path))
        found = None if args.replace else predict(planned(job))
        proposal: dict[str, Any] = {}
        if args.next or args.goal:
            found, proposal = _propose(args, job, path)
        assert found is not None
        card = card_of(found) | ({"proposal": proposal} if proposal else {})
        if args.exposures:
            card["exposures"] = _exposures(found, args)
    show_warnings(card["warnings"])
    if args.page:
        from testfield.report.plan_page import plan_page
        from testfield.store.atomic import whole
        from testfield.store.text import write_text

        text = plan_page(found, card)
        with whole(args.page) as part:
            write_text(part, text)
    if args.json:
        print(json.dumps({"format": FORMAT, "file": str(path)} | plain(card), indent=1, allow_nan=False))
    else:
        show(card)
        if args.page:
            print(f"\n  page   {args.page}")
        if args.out:
            print(f"\n  scene  {args.out}")
    return 0


def _check(args: argparse.Namespace) -> None:
    """Raise `TestfieldError` for options that do not fit together, before anything long starts."""
    from testfield.errors import TestfieldError
    from testfield.plan.goals import Goal

    if args.goal:
        Goal.parse(args.goal)
    for name in ("next", "most"):
        value = getattr(args, name)
        if value is not None and not 1 <= value <= 1000:
            raise TestfieldError(f"value {value} is not from 1 to 1000", f"--{name}", "give how many stations")
    for name in ("range_mm", "clearance_mm"):
        value = getattr(args, name)
        if value is not None and not 0 < value < 1e7:
            raise TestfieldError(f"value {value} is no distance", f"--{name.replace('_', '-')}", "give millimetres")
    proposes = args.next or args.goal
    for name in ("out", "replace", "mesh", "range_mm"):
        if getattr(args, name) and not proposes:
            option = f"--{name.replace('_', '-')}"
            raise TestfieldError("nothing is proposed without --next or --goal", option, "add one of them")
    if args.force and args.out is None and args.page is None:
        raise TestfieldError(
            "nothing is written that could be there", "--force", "add --out or --page, or leave it out"
        )
    if args.mesh and args.candidates != "mesh":
        raise TestfieldError(f"{args.candidates} candidates stand around no mesh", "--mesh", "add --candidates mesh")
    for name in ("out", "page"):
        path = getattr(args, name)
        if path is not None and path.exists() and not args.force:
            raise TestfieldError("this file exists", str(path), "give another name, or --force")
        if path is not None and not path.parent.is_dir():
            raise TestfieldError("no such folder", str(path.parent), "make it first")


def _propose(args: argparse.Namespace, job: "Job", path: Path) -> tuple["Prediction", dict[str, Any]]:
    """The prediction with the proposed stations, and what was proposed; `--out` is written."""
    import sys

    import numpy as np

    from testfield.plan.candidates import candidates_of
    from testfield.plan.design import propose
    from testfield.plan.goals import Goal
    from testfield.plan.propose import write_proposal
    from testfield.plan.subsets import Choice

    goal = Goal.parse(args.goal) if args.goal else Goal("u_rms_mm")
    candidates = candidates_of(job, args.candidates, args.range_mm, args.clearance_mm, args.mesh)

    def tell(said: str) -> None:
        if sys.stderr.isatty():
            print(said, file=sys.stderr)

    design = propose(
        Choice(job, candidates),
        goal,
        most=args.next if args.next and not args.goal else args.most,
        least=args.next or 0,
        keep=() if args.replace else None,
        tell=tell,
    )
    if args.out:
        write_proposal(path, args.out, candidates, design.chosen, args.force, args.replace)
    stations = [
        {
            "position_mm": np.round(candidates.poses[k : k + 1].origin_mm[0], 1).tolist(),
            "look_at_mm": np.round(candidates.look_at_mm[k], 1).tolist(),
            "roll_deg": float(candidates.roll_deg[k]),
        }
        for k in design.chosen
    ]
    return design.found, {
        "goal": goal.name,
        "most": goal.most,
        "candidates": len(candidates),
        "steps": list(design.steps),
        "value": design.value,
        "stations": stations,
    }


def _exposures(found: "Prediction", args: argparse.Namespace) -> dict[str, Any]:
    from testfield.plan.exposures import by_exposures, worth_of_stations
    from testfield.plan.goals import Goal

    goal = Goal.parse(args.goal) if args.goal else Goal("u_rms_mm")
    return by_exposures(found.planned, goal) | {"stations": worth_of_stations(found.planned, goal)}


def show(card: dict[str, Any]) -> None:
    """The prediction as tables."""
    from testfield.cli.plan_tables import tables

    print(f"{card['scene']}: predicted, standard uncertainties (k = 1)")
    for lines in tables(card):
        print()
        for line in lines:
            print(f"  {line}")
