"""`testfield validate SCENE`: check a scene file without rendering."""

import argparse
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "validate", help="check a scene file and say what it holds, without rendering", description=__doc__
    )
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML)")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Say what is wrong, or what the scene holds."""
    import numpy as np

    from testfield.chain.run import Run, check_algorithms
    from testfield.cli.show import show_warnings
    from testfield.scene.load import load_scene
    from testfield.scene.world import BAR, BOARD, CHECK
    from testfield.store.ledger import Ledger

    run = Run(Path(), load_scene(args.scene), str(args.scene), Ledger(Path("/nonexistent")))
    world = run.world
    check_algorithms(run.scene, str(args.scene))
    show_warnings(run.truth.check(str(args.scene)))
    marks, seen = world.marks, run.views.visible == 1
    print(f"{args.scene}: valid")
    count = {role: int((marks.role == role).sum()) for role in (BOARD, CHECK, BAR)}
    print(f"  {len(world.field.boards)} boards with {count[BOARD]} marks, {count[CHECK]} check targets, ", end="")
    print(f"{len(world.field.scale_bars)} scale bars ({count[BAR]} ends)")
    for mesh in world.meshes:
        size = " x ".join(f"{edge:.0f}" for edge in np.ptp(mesh.vertices_mm, axis=0))
        kind = "closed" if mesh.closed else "open, seen from both sides"
        print(f"  mesh '{mesh.name}': {len(mesh.faces)} faces, {size} mm, {kind}")
    sizes = run.views.diameter_px[seen]
    print(f"  {len(world.station_name)} stations; {seen.sum()} full views of marks, ", end="")
    print(f"{sizes.min():.1f} to {sizes.max():.1f} px wide")
    return 0
