"""`testfield compare SCENE... --recipes A B`: which way of measuring is better, by how much, and is it sure."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from testfield.evaluate.compare import Compared
    from testfield.evaluate.comparison import Comparison

from testfield.cli.clusters import add_cluster, cluster_of
from testfield.cli.show import add_load


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "compare", help="compare recipes or single algorithms on the same rendered frames", description=__doc__
    )
    p.add_argument(
        "scenes",
        type=Path,
        nargs="+",
        metavar="SCENE",
        help="scene files, or names of those that come along; or one comparison file (FORMATS.md)",
    )
    p.add_argument(
        "--recipes",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="recipe files; others are held against the first",
    )
    for stage in ("centroids", "calibrators", "reconstructors"):
        p.add_argument(f"--{stage}", default="", metavar="A,B", help=f"{stage} in else equal recipes")
    p.add_argument(
        "--factor",
        action="append",
        default=[],
        metavar="FIELD=V,V",
        help="vary a field of the scenes, as camera.f_number=4,8; can be given again",
    )
    p.add_argument("--draws", type=int, metavar="N", help="draws of noise of every scene (default: 5)")
    p.add_argument("--effect-px", type=float, metavar="PX", help="what matters in pixels (default: 0.001)")
    p.add_argument("--effect-um", type=float, metavar="UM", help="what matters in micrometres (default: 1)")
    p.add_argument("--until", choices=("detect", "calibrate", "reconstruct"), help="last stage (default: reconstruct)")
    p.add_argument(
        "--out", type=Path, default=Path("renders/compare"), metavar="FOLDER", help="default: renders/compare"
    )
    p.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: one a core)")
    p.add_argument("--json", action="store_true", help="print differences and summary as one JSON object")
    add_cluster(p)
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Do what is missing of all cases; write the page and its tables. Exit status 1 where the ruler is not sane."""
    import json

    from testfield.cli.show import jobs_of
    from testfield.errors import TestfieldError
    from testfield.evaluate.compare import conclude, why_nothing
    from testfield.evaluate.compare_floor import Floor
    from testfield.evaluate.compare_page import write_comparison
    from testfield.evaluate.compare_tables import differences_table
    from testfield.evaluate.comparison_cases import cases_of
    from testfield.evaluate.execute import execute
    from testfield.evaluate.paired import Word
    from testfield.evaluate.provenance import provenance
    from testfield.evaluate.worst import crops_of
    from testfield.score.floor import floor_of
    from testfield.score.scorecard import plain
    from testfield.store.lock import only_writer

    comparison = asked_for(args)
    cases = cases_of(comparison)
    names = [recipe.name for recipe in comparison.recipes]
    with only_writer(args.out):
        with cluster_of(args, args.out) as pool:
            rows = execute(cases, args.out, jobs_of(args.jobs), "compare", pool=pool)
        if said := why_nothing(rows):
            raise TestfieldError(said)
        compared = conclude(rows, names, comparison.matters)
        floor = Floor.of(floor_of(args.out), compared.ground_um_per_px)
        made = provenance(comparison, cases, sys.argv[1:])
        crops = crops_of(compared.rows, names, cases, args.out)
        if args.store and not crops:
            print(
                "the images stayed with the workers: the page has no crops of worst cases; an --out that all machines "
                "see, without --store, brings them",
                file=sys.stderr,
            )
        place = write_comparison(compared, comparison, floor, made, args.out, crops)
    table = differences_table(compared, floor)
    if args.json:
        found = {"sane": compared.sane, "differences": table.to_dict("records")}
        print(json.dumps(plain(found | {"summary": compared.summary.to_dict("records")})))
    else:
        for row in compared.summary.itertuples():
            if row.failed:
                print(f"{row.recipe} failed in {row.failed} of {row.cases} cases: {_why(compared, row.recipe)}")
        print(f"differences from {names[0]}, with 95 % intervals:")
        for row in table.itertuples():
            if row.verdict == Word.NOTHING.value:
                print(f"{row.verdict:<11} {row.recipe:<18} {row.figure}")
                continue
            ends = f"{row.low:+.3g} to {row.high:+.3g}"
            print(f"{row.verdict:<11} {row.recipe:<18} {row.figure:<44} {row.difference:+.3g} {row.unit:<3} ({ends})")
        for name, figures in compared.lost_to_broken.items():
            print(f"'{name}' errs more than what is broken on purpose: {', '.join(figures)}", file=sys.stderr)
        if not compared.sane:
            print(
                "the two rows whose outcome is known came out otherwise: nothing here can be believed", file=sys.stderr
            )
            for scene, row, key in compared.otherwise:
                print(f"  scene '{scene}', {row}: {key}", file=sys.stderr)
        print(place)
    return 0 if compared.sane else 1


def _why(compared: "Compared", recipe: str) -> str:
    """What most of a recipe's failed cases said."""
    said = compared.failures[compared.failures.recipe == recipe]["failure"].dropna()
    return str(said.mode().iloc[0]) if len(said) else "for no stated reason"


def asked_for(args: argparse.Namespace) -> "Comparison":
    """The comparison that a command line asks for: what a file says, and what options say beyond it."""
    from dataclasses import replace

    from testfield.evaluate.comparison import DRAWS, Comparison, Until, factor_of, is_comparison, recipes_of
    from testfield.evaluate.metrics import MATTERS
    from testfield.measure.recipe import Recipe
    from testfield.scene.shipped import find_scene

    stages = {stage: _words(getattr(args, stage)) for stage in ("centroids", "calibrators", "reconstructors")}
    recipes = (*(Recipe.load(path) for path in args.recipes), *recipes_of(stages, "command line"))
    factors = tuple(factor_of(text) for text in args.factor)
    if len(args.scenes) == 1 and is_comparison(args.scenes[0]):
        asked = Comparison.load(args.scenes[0])
    else:
        asked = Comparison(tuple(find_scene(scene) for scene in args.scenes), (), DRAWS)
    effects = {"px": args.effect_px, "um": args.effect_um}
    return replace(
        asked,
        recipes=(*asked.recipes, *recipes),
        factors=(*asked.factors, *factors),
        draws=asked.draws if args.draws is None else args.draws,
        until=asked.until if args.until is None else Until(args.until),
        matters=MATTERS | dict(asked.matters) | {unit: v for unit, v in effects.items() if v is not None},
    ).check()


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]
