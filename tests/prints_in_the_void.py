"""Renders every kind of print before nothing at all: run as `prints_in_the_void.py OUT.npz [kinds ...]`.

Rays beside a board meet no wall and no sky. The environment names the LLVM target; `CHECK_BOUNDS` in it makes Dr.Jit
check every look-up. Run in a process of its own, because a look-up far outside its table ends the process.
"""

import os
import sys
from pathlib import Path

import numpy as np

from testfield.render.irradiance import Irradiance, compute_irradiance
from testfield.render.jit_core import llvm_target
from testfield.render.path import render_path
from testfield.render.stage import build_stage
from testfield.render.variant import mitsuba
from testfield.render.view import render_view
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene

SCENES = Path(__file__).parents[1] / "scenes"
DOTS = "extension_zone = { columns = 4, rows = 4, pitch_mm = 40, diameter_mm = 14, centre_mm = [-60, 0] }"
CODES = (
    "recognition_zone = "
    "{ columns = 1, rows = 2, pitch_mm = 90, diameter_mm = 14, centre_mm = [90, 0], first_code = %d }"
)
BOARDS = {
    "dots": f"{DOTS}\n{CODES % 1}",
    "bent": f"bow_mm = 12\nbow_axis_deg = 70\n{DOTS}\n{CODES % 3}",
    "dirt": f"dirt = {{ count = 12, diameter_mm = 9 }}\n{DOTS}\n{CODES % 5}",
    "charuco": 'pattern = { kind = "charuco", columns = 7, rows = 5, square_mm = 40, marker_mm = 30 }',
    "checkerboard": 'pattern = { kind = "checkerboard", columns = 6, rows = 5, square_mm = 40 }',
    "aruco": 'pattern = { kind = "aruco", columns = 4, rows = 3, marker_mm = 54, gap_mm = 18, first_tag = 20 }',
    "apriltag": 'pattern = { kind = "apriltag", columns = 4, rows = 3, marker_mm = 54, gap_mm = 18 }',
    "circles": 'pattern = { kind = "circles", columns = 7, rows = 6, pitch_mm = 36, diameter_mm = 18 }',
    "acircles": 'pattern = { kind = "acircles", columns = 4, rows = 9, pitch_mm = 24, diameter_mm = 18 }',
}
HULL = """
[[meshes]]
name = "hull"
file = "meshes/hull.stl"
unit = "mm"
position_mm = [0, -300, 720]
[[check_targets]]
generator = "on_mesh"
mesh = "hull"
first_code = 201
points_mm = [[-300, -480, 650], [0, -480, 600]]
diameter_mm = 14
"""
HEAD = """
name = "void"
seed = 3
[camera]
width_px = 200
height_px = 160
pixel_pitch_um = 5
focal_length_mm = 1.2
psf_sigma_px = 0.6
%s
[paint]
ink = "%s"
[room]
ambient_w_m2_sr = 0
[[room.lights]]
size_mm = [300, 200]
position_mm = [300, -1500, 1500]
normal = [-0.1, 1, -0.6]
radiance_w_m2_sr = 40
%s
[[stations]]
position_mm = [100, -1700, 500]
look_at_mm = [60, 0, 300]
roll_deg = [8]
"""
FLASH = "flash = { radius_mm = 35, radiant_intensity_w_sr = 1.0, falloff_exponent = 2 }"
POINT = '[[room.lights]]\nkind = "point"\nposition_mm = [500, -900, 900]\nintensity_w_sr = 1'


def scene_text(kind: str) -> str:
    """A scene of one board of a kind, or of all of them (`all`), or of all in an ink, or with a mesh (`stickers`)."""
    ink = kind if kind in ("gloss", "retro", "luminous") else "matt"
    text = HEAD % (FLASH if ink == "retro" else "", ink, POINT if ink != "matt" else "")
    names = [kind] if kind in BOARDS else ["dots"] if kind == "stickers" else list(BOARDS)
    if ink in ("gloss", "luminous"):
        names.remove("bent")  # is refused
    for k, name in enumerate(names):
        x, z = (0, 300) if len(names) == 1 else (350 * (k % 3) - 350, 300 * (k // 3))
        text += f'[[boards]]\nname = "{name}"\nsize_mm = [300, 240]\nposition_mm = [{x}, {20 * k}, {z}]\n'
        text += f"normal = [0.2, -1, 0.1]\nspin_deg = {3 * k}\n{BOARDS[name]}\n"
    return text + HULL * (kind == "stickers")


def render(kind: str) -> dict[str, np.ndarray]:
    """Radiances of the kind in even light; if its name ends in `!`, also in computed light and path traced."""
    whole, kind = kind.endswith("!"), kind.rstrip("!")
    world = build_world(parse_scene(scene_text(kind), kind, SCENES))
    stage = build_stage(world)
    lights = {"even": Irradiance.even(len(world.panels), 3.0, world.meshes)}
    if whole:
        lights["computed"] = compute_irradiance(stage, 100.0, 64, 1, lambda _: None)
    made = {f"{kind} {name}": render_view(stage, light, 0, 3, 0.1, 64, 1)[0].values for name, light in lights.items()}
    if whole:
        made[f"{kind} path"] = render_path(stage, 0, 16, 1).values
    return made


def main(out: str, *kinds: str) -> None:
    """Render kinds into a file, with the vector width that was in use."""
    mitsuba()
    import drjit as dr

    dr.set_flag(dr.JitFlag.Debug, "CHECK_BOUNDS" in os.environ)
    images = {name: image for kind in kinds for name, image in render(kind).items()}
    np.savez(out, width=llvm_target()[1], **images)


if __name__ == "__main__":
    main(*sys.argv[1:])
