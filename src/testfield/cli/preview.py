"""`testfield preview SCENE`: plan and elevation of the field, and one quick view."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from testfield.camera.images import Radiance
    from testfield.chain.run import Run


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
    from testfield.errors import TestfieldError
    from testfield.report.preview import draw_preview
    from testfield.scene.shipped import find_scene
    from testfield.store.atomic import whole

    if args.out is not None and args.out.suffix != ".png":
        raise TestfieldError(f"'{args.out}' does not end in .png", "--out", "the preview is a PNG")
    run, view, name = seen(find_scene(args.scene), args.station)
    out = args.out or Path("renders") / f"{run.scene.name}-preview.png"
    with whole(out) as part:
        draw_preview(run.world, view, name, part)
    print(out)
    return 0


def seen(path: Path, station: str | None = None) -> "tuple[Run, Radiance, str]":
    """A scene's run, without a folder; one quick view of it, and which station's that is: the first if none is named.

    Raises `TestfieldError` where the scene is not valid or has no such station."""
    from testfield.chain.run import Run, examined
    from testfield.cli.show import show_warnings
    from testfield.errors import TestfieldError
    from testfield.render.quick import quick_view
    from testfield.scene.document import load_document
    from testfield.scene.load import scene_from
    from testfield.store.ledger import Ledger

    document = load_document(path)
    run = Run(Path(), scene_from(document), str(path), Ledger(Path("/nonexistent")))
    show_warnings(examined(run, document))
    name = station or run.stations[0]
    if name not in run.stations:
        raise TestfieldError(f"no station is called '{name}'", "--station", f"choose one of {', '.join(run.stations)}")
    world, k = next((world, k) for _, world, k, image in run.truth.images() if image == name)
    return run, quick_view(world, k), name
