"""`testfield preview SCENE`: plan and elevation of the field, and one quick view."""

import argparse
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "preview",
        help="plan, elevation and one quick view of a scene, as PNG, in seconds",
        description=__doc__,
    )
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML), or the name of one that comes along")
    p.add_argument("--station", metavar="NAME", help="whose view (default: the first)")
    p.add_argument("--out", type=Path, metavar="FILE", help="the picture (default: renders/<scene's name>-preview.png)")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Check the scene and draw it."""
    from testfield.chain.run import Run, examined
    from testfield.cli.show import show_warnings
    from testfield.errors import TestfieldError
    from testfield.render.quick import quick_view
    from testfield.report.preview import draw_preview
    from testfield.scene.document import load_document
    from testfield.scene.load import scene_from
    from testfield.scene.shipped import find_scene
    from testfield.store.atomic import whole
    from testfield.store.ledger import Ledger

    path = find_scene(args.scene)
    document = load_document(path)
    run = Run(Path(), scene_from(document), str(path), Ledger(Path("/nonexistent")))
    show_warnings(examined(run, document))
    name = args.station or run.stations[0]
    if name not in run.stations:
        raise TestfieldError(f"no station is called '{name}'", "--station", f"choose one of {', '.join(run.stations)}")
    out = args.out or Path("renders") / f"{run.scene.name}-preview.png"
    if out.suffix != ".png":
        raise TestfieldError(f"'{out}' does not end in .png", "--out", "the preview is a PNG")
    world, station = next((world, k) for _, world, k, image in run.truth.images() if image == name)
    view = quick_view(world, station)
    with whole(out) as part:
        draw_preview(run.world, view, name, part)
    print(out)
    return 0
