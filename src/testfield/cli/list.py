"""`testfield list [WHAT]`: what can be chosen by name: scenes, templates, algorithms, boards, cameras, sensors."""

import argparse
from pathlib import Path
from typing import Any

from testfield.cli.show import add_load

ALGORITHMS = ("detectors", "finders", "centroids", "decoders", "calibrators", "reconstructors")
KINDS = ("scenes", "templates", *ALGORITHMS, "lenses", "boards", "cameras", "lights", "sensors")
SOURCED = {
    "boards": "boards (kinds in field files, with what a scene's pattern.kind calls them; and kinds of the catalogue)",
    "cameras": "cameras (kind)",
    "lights": "lights (kind)",
}
NONE = "none; this project's own is no algorithm of a recipe"
"""What is said of a kind of which only somebody else's are chosen by name."""


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "list",
        help="scenes, templates, algorithms, boards, cameras, lights, sensors: what is chosen by name",
        description=__doc__,
    )
    p.add_argument("what", nargs="?", choices=KINDS, metavar="WHAT", help=f"one of {', '.join(KINDS)} (default: all)")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.add_argument(
        "--pictures", type=Path, metavar="FOLDER", help="templates: write a small picture of each, NAME.png, there"
    )
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Print name and first sentence of each; of a package that cannot be imported, why."""
    import json

    from testfield.cli.refuse import refuse

    if args.pictures is not None:
        refuse(args, "pictures", {"json": False})
        return _pictures(args)
    found = {kind: _rows(kind) for kind in ([args.what] if args.what else KINDS)}
    if args.json:
        print(json.dumps(found))
        return 0
    for kind, rows in found.items():
        print("sensors (sensor.preset)" if kind == "sensors" else SOURCED.get(kind, kind))
        if not rows:
            print(f"  {NONE}")
        width = max([16, *(len(name) for name in rows)])
        for name, row in rows.items():
            print(f"  {name:<{width}} {row['what']}")
            if "source" in row:
                print(f"  {'':<{width}} {row['source']}")
    return 0


def _pictures(args: argparse.Namespace) -> int:
    from tempfile import TemporaryDirectory

    from testfield.author.templates import templates, write_template
    from testfield.cli.preview import seen
    from testfield.errors import TestfieldError
    from testfield.report.preview import draw_small
    from testfield.store.atomic import whole

    if args.what != "templates":
        raise TestfieldError("templates alone have pictures", "--pictures", "say `testfield list templates --pictures`")
    args.pictures.mkdir(parents=True, exist_ok=True)
    for name in templates():
        with TemporaryDirectory(prefix="testfield-") as folder:
            scene, *_ = write_template(name, name, Path(folder))
            run, view, _ = seen(scene)
        out = args.pictures / f"{name}.png"
        with whole(out) as part:
            draw_small(run.world, view, part)
        print(out)
    return 0


def _rows(kind: str) -> dict[str, dict[str, str]]:
    if kind == "scenes":
        return _scenes()
    if kind == "templates":
        from testfield.author.templates import described, templates

        told = {name: described(path) for name, path in templates().items()}
        return {name: {"what": what, "source": f"expected: {expected}"} for name, (what, expected) in told.items()}
    if kind == "sensors":
        from testfield.sensor.presets import presets

        doubt = {True: "", False: " (not verified)"}
        return {
            name: {"what": one["description"] + doubt[one["verified"]], "source": one["source"]}
            for name, one in presets().items()
        }
    from testfield.registry import names
    from testfield.scene.catalogue import LISTS, catalogue

    found = {} if kind in ("cameras", "lights") else {name: _said(kind, name) for name in names(kind)}
    for name, row in found.items() if kind == "boards" else ():
        row["what"] += f" In a scene: {_in_scenes(name)}."
    for name, one in catalogue(kind).items() if kind in LISTS else ():
        found[name] = {"what": one["what"] + ("" if one["verified"] else " (not verified)"), "source": one["source"]}
    return found


def _in_scenes(board: str) -> str:
    """How a scene's `pattern.kind` calls a kind of board."""
    from typing import get_args

    from testfield.scene.pattern_parts import PatternPart, TagGridPart

    union, *_ = get_args(PatternPart)
    named = {kind for part in get_args(union) for kind in get_args(part.model_fields["kind"].annotation)}
    own = get_args(TagGridPart.model_fields["kind"].annotation) if board == "tags" else (board,)
    said = " or ".join(f'"{kind}"' for kind in own if kind in named)
    return said or "not to be had"


def _said(kind: str, name: str) -> dict[str, str]:
    from testfield.errors import TestfieldError
    from testfield.registry import find

    try:
        return {"what": (find(kind, name).__doc__ or "").strip().split("\n")[0]}
    except TestfieldError as error:
        return {"what": f"BROKEN: {error.sentence()}"}


def _scenes() -> dict[str, dict[str, str]]:
    import tomllib

    from testfield.scene.shipped import shipped_scenes
    from testfield.store.text import read_text

    said = {name: tomllib.loads(read_text(path)).get("description", "") for name, path in shipped_scenes().items()}
    return {name: {"what": text.partition("; ")[0]} for name, text in said.items()}
