"""`testfield validate FILE`: check a scene, a sweep, a recipe, a comparison, a suite or a field without rendering."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testfield.cli.colour import good
from testfield.cli.show import add_load

if TYPE_CHECKING:
    from testfield.chain.run import Run


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "validate",
        help="check a scene, a recipe, a comparison, a suite or a field file and say what it holds, without rendering",
        description=__doc__,
    )
    p.add_argument(
        "scene",
        type=Path,
        metavar="FILE",
        help="a scene file (TOML), or the name of one that comes along; a file of a recipe, comparison, suite or field",
    )
    p.add_argument("--json", action="store_true", help="print one JSON object")
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Say what is wrong, or what the file holds."""
    from testfield.evaluate.comparison import is_comparison
    from testfield.evaluate.regress.suite import is_suite
    from testfield.measure.recipe_file import is_recipe
    from testfield.scene.document import VARY
    from testfield.scene.schema import SceneFile
    from testfield.store.toml import toml_or_nothing
    from testfield.targets.field_file import is_field_file

    if is_comparison(args.scene):
        return _comparison(args)
    data = toml_or_nothing(args.scene)
    if is_recipe(data, SceneFile.model_fields):
        return _recipe(args)
    if is_suite(data):
        return _suite(args)
    if is_field_file(data, SceneFile.model_fields):
        return _field(args)
    if VARY in data and "scene" in data:
        return _sweep(args)
    return _scene(args)


def _sweep(args: argparse.Namespace) -> int:
    """The size of a sweep, with its scene, fields and values checked."""
    import json

    from testfield.evaluate.sweep import Sweep

    count, how = Sweep.load(args.scene).size
    if args.json:
        print(json.dumps({"sweep": str(args.scene), "valid": True, "warnings": [], "cases": count}))
    else:
        print(f"{args.scene}: {good('valid')}\n  {count:,} cases: {how}")
    return 0


def _scene(args: argparse.Namespace) -> int:
    import json

    from testfield.chain.run import Run, examined
    from testfield.cli.show import show_warnings
    from testfield.evaluate.sweep import Sweep
    from testfield.scene.document import VARY, load_document
    from testfield.scene.load import scene_from
    from testfield.scene.shipped import find_scene
    from testfield.store.ledger import Ledger
    from testfield.store.toml import toml_or_nothing

    path = find_scene(args.scene)
    document = load_document(path)
    run = Run(Path(), scene_from(document), str(path), Ledger(Path("/nonexistent")))
    warnings = examined(run, document)
    show_warnings(warnings)
    if VARY in toml_or_nothing(path):
        Sweep.load(path)  # speaks where it is wrong
    held = _held(run)
    if args.json:
        print(json.dumps({"scene": str(path), "valid": True, "warnings": warnings} | held))
    else:
        _show(path, held)
    return 0


def _field(args: argparse.Namespace) -> int:
    """What a field file of `testfield measure` declares, with its tables of codes and kinds of boards checked."""
    import json

    from testfield.cli.measure import targets_of
    from testfield.targets.code_table import codes_for

    args.field = args.scene
    file, source, beside, target, _ = targets_of(args)
    codes_for(file.target.codes, target.bits, f"{source}, target.codes", beside)
    held = {
        "target": file.target.kind,
        "certified_codes": sum(len(board.points) for board in file.boards),
        "groups": len(file.groups),
        "distances": len(file.distances),
        "patterns": len(file.calibrating),
        "cameras": len(file.cameras),
        "rigs": len(file.rigs),
    }
    if args.json:
        print(json.dumps({"field": str(args.scene), "valid": True, "warnings": [], "name": file.name} | held))
        return 0
    print(f"{args.scene}: {good('valid')}, a field file of `testfield measure`")
    print("  " + ", ".join(f"{name}: {value}" for name, value in held.items()))
    return 0


def _recipe(args: argparse.Namespace) -> int:
    """The parts of a recipe, with signatures checked and programs found; an environment that it names is made."""
    import json

    from testfield.measure.recipe import Recipe

    recipe = Recipe.load(args.scene)
    parts = recipe.parts
    if args.json:
        print(json.dumps({"recipe": str(args.scene), "valid": True, "name": recipe.name, "parts": parts}))
        return 0
    print(f"{args.scene}: {good('valid')}")
    for stage, what in parts.items():
        print(f"  {stage:<13} {what}")
    return 0


def _comparison(args: argparse.Namespace) -> int:
    """The size of a comparison, with its scenes, factors and recipes checked."""
    import json

    from testfield.cli.show import show_warnings
    from testfield.evaluate.comparison import Comparison
    from testfield.evaluate.comparison_cases import cases_of, setups_of

    comparison = Comparison.load(args.scene)
    setups, few = setups_of(comparison), len(comparison.recipes) < 2
    warnings = ["a comparison takes two recipes: `testfield compare` needs --recipes beside this file"] if few else []
    cases = None if few else len(cases_of(comparison))
    names = [recipe.name for recipe in comparison.recipes]
    show_warnings(warnings)
    held = {"scenes": len(comparison.scenes), "setups": len(setups), "draws": comparison.draws, "cases": cases}
    if args.json:
        head = {"comparison": str(args.scene), "valid": True, "warnings": warnings}
        print(json.dumps(head | {"recipes": names} | held))
        return 0
    print(f"{args.scene}: {good('valid')}")
    print(f"  recipes: {', '.join(names)}")
    print("  " + ", ".join(f"{name}: {value}" for name, value in held.items() if value is not None))
    return 0


def _suite(args: argparse.Namespace) -> int:
    """The size of a suite of `testfield regress`, with its scenes, recipes and baseline checked."""
    import json

    from testfield.cli.show import show_warnings
    from testfield.evaluate.regress.baseline import Baseline
    from testfield.evaluate.regress.cases import setups_of
    from testfield.evaluate.regress.suite import Suite, baseline_path

    suite, baseline = Suite.load(args.scene), baseline_path(args.scene)
    setups = setups_of(suite)
    warnings = []
    if baseline.exists():
        Baseline.load(baseline).belongs_to(suite, setups, baseline)
    else:
        warnings = [f"no baseline {baseline}: `testfield regress record {args.scene}` makes one"]
    show_warnings(warnings)
    figures = sum(len(suite.figures_of(setup.title)) for setup in setups)
    held = {"scenes": len(suite.scenes), "recipes": len(suite.recipes) or 1, "figures": figures}
    held |= {"draws": suite.draws, "budget": suite.budget}
    if args.json:
        print(json.dumps({"suite": str(args.scene), "valid": True, "warnings": warnings} | held))
        return 0
    print(f"{args.scene}: {good('valid')}")
    print("  " + ", ".join(f"{name}: {value}" for name, value in held.items()))
    return 0


def _held(run: "Run") -> dict[str, Any]:
    """What a scene holds: counts, sizes in mm and px."""
    import numpy as np

    from testfield.scene.world import BAR, BOARD, CHECK

    world, seen = run.world, run.views.visible == 1
    sizes = run.views.diameter_px[seen]
    count = {role: int((world.marks.role == role).sum()) for role in (BOARD, CHECK, BAR)}
    meshes = [
        {
            "name": mesh.name,
            "faces": len(mesh.faces),
            "size_mm": np.ptp(mesh.vertices_mm, axis=0).tolist(),
            "closed": bool(mesh.closed),
        }
        for mesh in world.meshes
    ]
    return {
        "boards": len(world.field.boards),
        "marks_of_boards": count[BOARD],
        "check_targets": count[CHECK],
        "scale_bars": len(world.field.scale_bars),
        "ends_of_bars": count[BAR],
        "meshes": meshes,
        "stations": len(world.station_name),
        "full_views": int(seen.sum()),
        "diameter_px": [float(sizes.min()), float(sizes.max())],
    }


def _show(path: Path, held: dict[str, Any]) -> None:
    print(f"{path}: {good('valid')}")
    print(
        f"  {held['boards']} boards with {held['marks_of_boards']} marks, {held['check_targets']} check targets, ",
        end="",
    )
    print(f"{held['scale_bars']} scale bars ({held['ends_of_bars']} ends)")
    for mesh in held["meshes"]:
        size = " x ".join(f"{edge:.0f}" for edge in mesh["size_mm"])
        kind = "closed" if mesh["closed"] else "open, seen from both sides"
        print(f"  mesh '{mesh['name']}': {mesh['faces']} faces, {size} mm, {kind}")
    print(f"  {held['stations']} stations; {held['full_views']} full views of marks, ", end="")
    print("{:.1f} to {:.1f} px wide".format(*held["diameter_px"]))
