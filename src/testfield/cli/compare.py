"""`testfield compare SCENE... --recipes A B`: which way of measuring is better, by how much, and is it sure."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "compare", help="compare recipes or centroid estimators on the same rendered frames", description=__doc__
    )
    p.add_argument(
        "scenes", type=Path, nargs="+", metavar="SCENE", help="scene files, or names of those that come along"
    )
    p.add_argument(
        "--recipes",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="recipe files; others are held against the first",
    )
    p.add_argument("--centroids", default="", metavar="A,B", help="centroid estimators in else equal recipes")
    p.add_argument("--draws", type=int, default=5, metavar="N", help="draws of noise of every scene (default: 5)")
    p.add_argument("--effect-px", type=float, default=0.001, metavar="PX", help="what matters in pixels (0.001)")
    p.add_argument("--effect-um", type=float, default=1.0, metavar="UM", help="what matters in micrometres (1)")
    p.add_argument(
        "--out", type=Path, default=Path("renders/compare"), metavar="FOLDER", help="default: renders/compare"
    )
    p.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: one a core)")
    p.add_argument("--json", action="store_true", help="print differences and summary as one JSON object")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Do what is missing of all cases; write the page and its tables. Exit status 1 where the ruler is not sane."""
    import json
    import platform
    import shlex

    from testfield.cli.show import jobs_of
    from testfield.errors import TestfieldError
    from testfield.evaluate.compare import MATTERS, cases_of, conclude
    from testfield.evaluate.compare_page import differences_table, write_comparison
    from testfield.evaluate.execute import execute
    from testfield.measure.recipe import Algorithm, Recipe
    from testfield.scene.shipped import find_scene
    from testfield.score.floor import floor_of
    from testfield.score.scorecard import plain
    from testfield.store.lock import only_writer
    from testfield.version import __version__

    for name, value in (("--effect-px", args.effect_px), ("--effect-um", args.effect_um)):
        if not 0 < value < 1e6:
            raise TestfieldError(f"value {value:g} is no difference that can matter", name, "give one above 0")
    recipes = [Recipe.load(path) for path in args.recipes]
    words = [word.strip() for word in args.centroids.split(",") if word.strip()]
    recipes += [Recipe(name=word, centroid=Algorithm(word)) for word in words]
    for recipe in recipes:
        recipe.check(f"recipe '{recipe.name}'")
    scenes = [find_scene(scene) for scene in args.scenes]
    cases = cases_of(scenes, recipes, args.draws)
    names = [recipe.name for recipe in recipes]
    matters = MATTERS | {"px": args.effect_px, "um": args.effect_um}
    with only_writer(args.out):
        rows = execute(cases, args.out, jobs_of(args.jobs), "compare")
        compared = conclude(rows, names, matters)
        about = {
            "first": names[0],
            "recipes": names,
            "scenes": [str(scene) for scene in scenes],
            "draws": args.draws,
            "floor": _floor(floor_of(args.out)),
            "provenance": {
                "command": shlex.join(["testfield", *sys.argv[1:]]),
                "program": f"testfield {__version__}",
                "processor": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
                "scenes": ", ".join(str(scene) for scene in args.scenes),
            },
        }
        place = write_comparison(compared, about, args.out)
    table = differences_table(compared)
    if args.json:
        found = {"sane": compared.sane, "differences": table.to_dict("records")}
        print(json.dumps(plain(found | {"summary": compared.summary.to_dict("records")})))
    else:
        for row in table.itertuples():
            ends = f"{row.low:+.3g} to {row.high:+.3g}"
            print(f"{row.verdict:<11} {row.recipe:<18} {row.figure:<44} {row.difference:+.3g} {row.unit:<3} ({ends})")
        if not compared.sane:
            print(
                "the two rows whose outcome is known came out otherwise: nothing here can be believed", file=sys.stderr
            )
        print(place)
    return 0 if compared.sane else 1


def _floor(certificate: dict[str, Any] | None) -> str:
    """What the images themselves may err, in a sentence."""
    if certificate is None:
        return "No certificate lies beside this comparison's folder; testfield certify says what the images may err."
    limit = certificate["centre_floor_px"]
    of = "" if certificate["valid"] else ", made with another version of the renderer"
    return f"Centres in these images are true to {limit:.5f} px rms by the certificate beside this folder{of}."
