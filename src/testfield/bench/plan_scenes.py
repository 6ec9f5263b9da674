"""Fields on which planning is put to the test: large ones for its time, and three for where to put stations."""

import numpy as np

from testfield.scene.load import parse_scene
from testfield.scene.schema import SceneFile

COLUMNS = 50


def large_field(targets: int, stations: int) -> SceneFile:
    """A wall of 8 x 4 m full of targets, half of which stand out of it, behind four boards and a bar, seen from arcs of
    stations."""
    rows = -(-targets // COLUMNS)
    heights = np.linspace(700, 3300, 4)
    arcs = np.array_split(np.arange(stations), 4)
    boards = "\n".join(
        f"""
[[boards]]
name = "{name}"
position_mm = [{x}, -600, {z}]
normal = [{-0.1 * np.sign(x):g}, -1, {0.1 * np.sign(2000 - z):g}]
kind = "wall"
recognition_zone = {{ first_code = {1 + 20 * k} }}
"""
        for k, (name, x, z) in enumerate((("A", -2000, 1200), ("B", 2000, 1200), ("C", -2000, 2900), ("D", 2000, 2900)))
    )
    views = "\n".join(
        f"""
[[stations]]
generator = "arc"
count = {len(arc)}
radius_mm = {radius}
height_mm = {height}
azimuth_deg = [-50, 50]
look_at_mm = [0, 0, 2000]
roll_deg = [0, 90, 180, 270]
"""
        for arc, height, radius in zip(arcs, heights, (8500, 9000, 9500, 10000), strict=True)
        if len(arc)
    )
    text = f"""
name = "large"
seed = 5
code_bits = 20
[volume]
size_mm = [8000, 4000, 1000]
[camera]
width_px = 6000
height_px = 4000
pixel_pitch_um = 3.9
focal_length_mm = 20
k1 = -0.1
k2 = 0.08
[exposure]
time_ms = 20
[room]
ambient_w_m2_sr = 4.0
[kinds.wall]
extension_zone = {{ columns = 11, rows = 10, pitch_mm = 75, centre_mm = [145, 0] }}
recognition_zone = {{ columns = 2, rows = 6, pitch_mm = 125, centre_mm = [-435, 0] }}
{boards}
[[scale_bars]]
name = "control bar"
role = "control"
length_mm = 2100
u_length_mm = 0.008
codes = [301, 302]
position_mm = [0, -600, 3700]
direction = [1, 0, 0]
normal = [0, -1, 0]
[[check_targets]]
generator = "grid"
first_code = 1001
counts = [{COLUMNS}, 2, {-(-rows // 2)}]
low_mm = [-3900, -450, 300]
high_mm = [3900, -100, 3600]
normal = [0, -1, 0]
diameter_mm = 16
{views}
"""
    return parse_scene(text, "large field")
