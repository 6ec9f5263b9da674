"""`testfield validate SCENE`: check a scene file without rendering."""

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
        "validate", help="check a scene file and say what it holds, without rendering", description=__doc__
    )
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML), or the name of one that comes along")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Say what is wrong, or what the scene holds."""
    import json

    from testfield.chain.run import Run, examined
    from testfield.cli.show import show_warnings
    from testfield.scene.load import load_scene
    from testfield.scene.shipped import find_scene
    from testfield.store.ledger import Ledger

    path = find_scene(args.scene)
    run = Run(Path(), load_scene(path), str(path), Ledger(Path("/nonexistent")))
    warnings = examined(run, path.read_bytes())
    show_warnings(warnings)
    held = _held(run)
    if args.json:
        print(json.dumps({"scene": str(path), "valid": True, "warnings": warnings} | held))
    else:
        _show(path, held)
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
