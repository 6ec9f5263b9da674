"""A change of any value of a scene changes the keys of the stages that depend on it, and of no others.

Stages are named as they depend on the scene itself, other stages' files being what they are: what is rendered anew is
exposed anew because its bytes differ. `sheet` stands for the three that measure by the field sheet: detect, calibrate
and reconstruct. Score and report repeat the whole scene, so every change is one for them.

A leaf of the schema that no line of the table changes turns a test red: say there what depends on it.
"""

import shutil
import tomllib
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import BaseModel

from testfield.chain import keys
from testfield.chain.run import field_key as run_field_key
from testfield.chain.truth import Truth
from testfield.evaluate.case import changed
from testfield.registry import module_of, names
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.world import World
from testfield.store import code
from testfield.targets.ring_code import code_words

SCENES = Path(__file__).parents[1] / "scenes"
BASE = """
name = "all"
seed = 3
[volume]
size_mm = [4000, 3000, 2000]
[camera]
width_px = 1280
height_px = 1024
residual_field = { rms_px = 0.05, degree = 5, seed = 1 }
focus_mm = 3000
diffraction = true
motion = { velocity_mm_s = [1, 0, 0], angular_velocity_deg_s = [0, 1, 0] }
flash = { radius_mm = 40, points = 8, radiant_intensity_w_sr = 2 }
[sensor]
bayer = "RGGB"
[exposure]
shutter = "rolling"
row_time_us = 10
[paint]
ink = "retro"
[[room.surfaces]]
name = "wall"
size_mm = [9000, 6000]
position_mm = [0, 2500, 1500]
normal = [0, -1, 0]
[[room.lights]]
size_mm = [1400, 900]
position_mm = [300, -1300, 3600]
radiance_w_m2_sr = 10.0
[[room.lights]]
kind = "point"
position_mm = [0, -3000, 3000]
intensity_w_sr = 20
[room.environment]
kind = "gradient"
zenith_w_m2_sr = 0.5
horizon_w_m2_sr = 0.4
ground_w_m2_sr = 0.1
[[boards]]
name = "A"
size_mm = [500, 360]
position_mm = [0, 250, 560]
bow_mm = 1
bow_axis_deg = 80
dirt = { count = 3, diameter_mm = 5 }
extension_zone = { columns = 6, rows = 7, pitch_mm = 45, diameter_mm = 14, centre_mm = [105, 0] }
recognition_zone = { columns = 2, rows = 4, pitch_mm = 80, diameter_mm = 14, centre_mm = [-165, 0], first_code = 1 }
[[boards]]
name = "B"
size_mm = [500, 360]
position_mm = [700, 250, 560]
ink = "gloss"
extension_zone = { columns = 6, rows = 7, pitch_mm = 45, diameter_mm = 14, centre_mm = [105, 0] }
[boards.recognition_zone]
columns = 2
rows = 2
pitch_mm = 80
diameter_mm = 14
centre_mm = [-165, 0]
codes = [11, 12, 13, 14]
[[boards]]
name = "charuco"
position_mm = [-1300, 250, 560]
ink = "luminous"
pattern = { kind = "charuco", columns = 6, rows = 5, square_mm = 60, marker_mm = 40, first_tag = 2 }
[[boards]]
name = "checker"
position_mm = [1900, 250, 560]
pattern = { kind = "checkerboard", columns = 7, rows = 6, square_mm = 60 }
[[boards]]
name = "tags"
position_mm = [-1300, 250, 1560]
pattern = { kind = "aruco", columns = 4, rows = 3, marker_mm = 60, gap_mm = 30, first_tag = 5 }
[[boards]]
name = "circles"
position_mm = [0, 250, 1560]
pattern = { kind = "circles", columns = 7, rows = 5, pitch_mm = 80, diameter_mm = 30 }
[[boards]]
name = "acircles"
position_mm = [1300, 250, 1560]
pattern = { kind = "acircles", columns = 4, rows = 9, pitch_mm = 40, diameter_mm = 25 }
[[boards]]
name = "aprilgrid"
position_mm = [1900, 250, 1560]
pattern = { kind = "aprilgrid", columns = 4, rows = 3, marker_mm = 60, gap_mm = 20, first_tag = 5 }
[[boards]]
name = "cctag"
position_mm = [2900, 250, 1560]
pattern = { kind = "cctag", columns = 4, rows = 3, pitch_mm = 100, diameter_mm = 70, crowns = 4, first_tag = 5 }
[[boards]]
name = "runetag"
position_mm = [3900, 250, 1560]
pattern = { kind = "runetag", diameter_mm = 300, number = 8 }
[[boards]]
name = "squares"
position_mm = [4900, 250, 1560]
pattern = { kind = "squares", columns = 5, rows = 4, square_mm = 60, gap_mm = 40 }
[[boards]]
name = "hexcircles"
position_mm = [5900, 250, 1560]
pattern = { kind = "hexcircles", columns = 6, rows = 7, pitch_mm = 60, diameter_mm = 40 }
[certified_poses]
u_position_mm = 0.1
u_rotation_deg = 0.01
[[scale_bars]]
name = "control bar"
role = "control"
length_mm = 900.0
codes = [101, 102]
position_mm = [0, 0, 960]
[[scale_bars]]
name = "check bar"
role = "check"
length_mm = 800.0
codes = [103, 104]
position_mm = [0, 0, 1160]
[[meshes]]
name = "hull"
file = "meshes/hull.stl"
position_mm = [0, -220, 520]
[[check_targets]]
code = 201
position_mm = [820, 60, 900]
[[check_targets]]
generator = "on_board"
board = "A"
code = 202
xy_mm = [-76, 152]
diameter_mm = 14
[[check_targets]]
generator = "grid"
first_code = 210
counts = [2, 1, 2]
low_mm = [-330, -60, 330]
high_mm = [330, -50, 820]
[[check_targets]]
generator = "random"
first_code = 220
count = 2
low_mm = [-2000, -900, 330]
high_mm = [-500, -200, 900]
[[check_targets]]
generator = "on_mesh"
mesh = "hull"
first_code = 230
points_mm = [[0, -420, 400]]
[[measuring_lines]]
name = "line"
first_code = 240
start_mm = [-400, -100, 300]
direction = [1, 0, 0.5]
lengths_mm = [300, 600]
[acceptance]
a_mm = 0.1
k_ppm = 5
b_mm = 1.0
[target_motion]
velocity_mm_s = [0, 1, 0]
angular_velocity_deg_s = [0, 0, 1]
about_mm = [10, 0, 0]
[[stations]]
name = "one"
position_mm = [0, -3000, 1000]
[[stations]]
generator = "arc"
count = 2
radius_mm = 3000
height_mm = 1200
[[stations]]
generator = "ring"
count = 2
radius_mm = 500
centre_mm = [0, -3000, 1200]
[[stations]]
generator = "grid"
counts = [2, 1, 1]
low_mm = [-500, -3100, 900]
high_mm = [500, -3000, 1000]
[[stations]]
generator = "random"
count = 2
low_mm = [-500, -3100, 900]
high_mm = [500, -3000, 1400]
"""
SEVERAL: dict[str, Any] = {"width_px": 1280, "height_px": 1024, "focus_mm": 3000}
LOOKING = {"rotation_deg": [90, 0, 0]}
VARIANTS: dict[str, dict[str, Any]] = {
    "base": {},
    "sheared": {"camera.lens": "brown_shear"},
    "rational": {"camera.lens": "rational"},
    "fisheye": {"camera.lens": "fisheye"},
    "path": {"render.mode": "path"},
    "map": {"room.environment": {"kind": "map", "file": "light.png"}},
    "ambient": {"room.environment": None, "room.ambient_w_m2_sr": 0.5},
    "global": {"exposure.shutter": "global", "exposure.row_time_us": 0},
    "several": {
        "camera": None,
        "target_motion": None,
        "cameras": [
            SEVERAL | {"name": "left", "lens": "brown_shear"},
            SEVERAL | {"name": "right", "focal_length_mm": 13.0},
            SEVERAL | {"name": "alone", "lens": "rational"},
        ],
        "rigs": [
            {
                "name": "bar",
                "cameras": [
                    {"camera": "left", "position_mm": [-300, 0, 0]},
                    {"camera": "right", "position_mm": [300, 0, 0], "u_position_mm": 0.1, "u_rotation_deg": 0.01},
                ],
            },
        ],
        "scale_bars.0.moves": [{"position_mm": [0, 0, 1300]}],
        "stations": [
            {"name": "one", "rig": "bar", "position_mm": [0, -3000, 1000]},
            {"generator": "pose", "name": "two", "camera": "alone", "position_mm": [0, -3000, 1100], **LOOKING},
            {"generator": "arc", "rig": "bar", "count": 2, "radius_mm": 3000, "height_mm": 1200},
        ],
    },
    "plain sensor": {"sensor": {}},
    "stuck": {
        "check_targets": [
            {
                "generator": "on_mesh",
                "mesh": "hull",
                "first_code": 300,
                "count": 12,
                "facing": [0, -1, 0.2],
                "diameter_mm": 6,
            }
        ]
    },
}
"""The scene that a change starts from, as changes of `BASE`; None takes a table away."""

R, E, D, C, P = "render", "expose", "detect", "calibrate", "reconstruct"
SHEET = (D, C, P)
ALL = (R, *SHEET)
"""What is printed and told alike: marks, codes, boards' sizes."""

Change = tuple[str, Any, tuple[str, ...]]
TABLE: dict[str, list[Change]] = {
    "base": [
        ("name", "other", ()),
        ("description", "other", ()),
        # Random places and errors, and with them certified lengths; noise.
        ("seed", 4, (R, E, *SHEET)),
        ("noise_seed", 4, (E,)),
        ("code_bits", 16, ALL),
        ("code_radii", "1:2.5:4", ALL),
        ("code_table", "codes.toml", ALL),
        ("volume.size_mm", [4000, 3000, 2001], ()),
        ("camera.width_px", 1290, (R, C)),
        ("camera.height_px", 1030, (R, C)),
        ("camera.pixel_pitch_um", 3.5, (R, E)),
        ("camera.focal_length_mm", 12.5, (R,)),
        ("camera.aspect", 1.01, (R,)),
        ("camera.principal_point_offset_px", [1, 0], (R,)),
        ("camera.lens", "brown_shear", (R, C, P)),
        ("camera.k1", 0.01, (R,)),
        ("camera.k2", 0.01, (R,)),
        ("camera.k3", 0.01, (R,)),
        ("camera.p1", 0.001, (R,)),
        ("camera.p2", 0.001, (R,)),
        ("camera.residual_field.rms_px", 0.06, (R,)),
        ("camera.residual_field.degree", 6, (R,)),
        ("camera.residual_field.seed", 2, (R,)),
        ("camera.f_number", 5.6, (R, E)),  # defocus and diffraction; and light
        ("camera.psf_sigma_px", 0.7, (R,)),
        ("camera.diffraction", False, (R,)),
        ("camera.focus_mm", 3100, (R,)),
        ("camera.vignetting", [0.1, 0, 0], (R,)),
        ("camera.natural_vignetting", True, (R,)),
        ("camera.coefficients", {"k1": 0.02}, (R,)),
        ("camera.motion.velocity_mm_s", [2, 0, 0], (R,)),
        ("camera.motion.angular_velocity_deg_s", [0, 2, 0], (R,)),
        ("camera.flash.on", False, (R,)),
        ("camera.flash.radius_mm", 41, (R,)),
        ("camera.flash.points", 9, (R,)),
        ("camera.flash.radiant_intensity_w_sr", 3, (R,)),
        ("camera.flash.falloff_exponent", 2, (R,)),
        ("sensor.bits", 10, (E,)),
        ("sensor.quantum_efficiency", 0.5, (E,)),
        ("sensor.full_well_e", 9000, (E,)),
        ("sensor.read_noise_e", 3, (E,)),
        ("sensor.gain_e_per_dn", 3, (E,)),
        ("sensor.black_level_dn", 32, (E,)),
        ("sensor.wavelength_nm", 600, (R, E)),  # diffraction; and photons
        ("sensor.dark_current_e_per_s", 5, (E,)),
        ("sensor.prnu", 0.01, (E,)),
        ("sensor.dsnu_e", 1, (E,)),
        ("sensor.bayer", "BGGR", (E,)),
        ("sensor.bayer_response", [1, 0.9, 1], (E,)),
        ("exposure.time_ms", 10, (R, E)),  # motion; and light
        ("exposure.row_time_us", 20, (R,)),
        ("paint.white", 0.8, (R,)),
        ("paint.black", 0.05, (R,)),
        ("paint.back", 0.3, (R,)),
        ("paint.white_on_black", False, ALL),
        ("paint.ink", "luminous", (R,)),
        ("paint.retro.coefficient_cd_lx_m2", 200, (R,)),
        ("paint.retro.half_entrance_deg", 40, (R,)),
        ("paint.retro.half_observation_deg", 0.7, (R,)),
        ("paint.retro.matt", 0.3, (R,)),
        ("paint.retro.shift_um_at_40_deg", 10, (R,)),
        ("paint.gloss.roughness", 0.4, (R,)),
        ("paint.gloss.reflectance", 0.05, (R,)),
        ("paint.luminous.radiance_w_m2_sr", 2, (R,)),
        ("room.surfaces.0.name", "screen", (R,)),
        ("room.surfaces.0.size_mm", [9000, 6001], (R,)),
        ("room.surfaces.0.position_mm", [0, 2600, 1500], (R,)),
        ("room.surfaces.0.normal", [0.1, -1, 0], (R,)),
        ("room.surfaces.0.albedo", 0.4, (R,)),
        ("room.lights.0.size_mm", [1400, 901], (R,)),
        ("room.lights.0.position_mm", [301, -1300, 3600], (R,)),
        ("room.lights.0.normal", [0, 0.1, -1], (R,)),
        ("room.lights.0.radiance_w_m2_sr", 11, (R,)),
        ("room.lights.1.position_mm", [1, -3000, 3000], (R,)),
        ("room.lights.1.intensity_w_sr", 21, (R,)),
        ("room.environment.zenith_w_m2_sr", 0.6, (R,)),
        ("room.environment.horizon_w_m2_sr", 0.5, (R,)),
        ("room.environment.ground_w_m2_sr", 0.2, (R,)),
        ("boards.1.name", "B2", ALL),
        ("boards.0.size_mm", [510, 360], (R,)),  # the sheet lists marks, and of zones no outline
        ("boards.0.thickness_mm", 11, (R,)),
        ("boards.0.position_mm", [1, 250, 560], ALL),  # certified poses are the truth with an error
        ("boards.0.normal", [0.1, -1, 0], ALL),
        ("boards.0.spin_deg", 1, ALL),
        ("boards.0.extension_zone.columns", 5, ALL),
        ("boards.0.extension_zone.rows", 6, ALL),
        ("boards.0.extension_zone.pitch_mm", 44, ALL),
        ("boards.0.extension_zone.diameter_mm", 13, ALL),
        ("boards.0.extension_zone.centre_mm", [106, 0], ALL),
        ("boards.0.extension_zone.places_mm", [[0, 0], [40, 10], [-30, 60]], ALL),
        ("boards.0.recognition_zone.places_mm", [[0, 0], [0, 80], [0, -80]], ALL),
        ("boards.5.marks_off_mm", [[0.01, 0, 0]] * 35, (R,)),
        ("boards.0.recognition_zone.columns", 1, ALL),
        ("boards.0.recognition_zone.rows", 3, ALL),
        ("boards.0.recognition_zone.pitch_mm", 79, ALL),
        ("boards.0.recognition_zone.diameter_mm", 13, ALL),
        ("boards.0.recognition_zone.centre_mm", [-166, 0], ALL),
        ("boards.0.recognition_zone.first_code", 21, ALL),
        ("boards.1.recognition_zone.codes", [11, 12, 13, 15], ALL),
        ("boards.1.ink", "matt", (R,)),
        ("boards.0.print_sigma_mm", 0.02, ALL),
        ("boards.0.scale_error_ppm", 50, (R,)),
        ("boards.0.bow_mm", 2, (R,)),
        ("boards.0.bow_axis_deg", 70, (R,)),
        ("boards.0.dirt.count", 4, (R,)),
        ("boards.0.dirt.diameter_mm", 6, (R,)),
        ("boards.0.dirt.albedo", 0.2, (R,)),
        ("boards.0.dirt.seed", 1, (R,)),
        ("boards.2.pattern.columns", 5, ALL),
        ("boards.2.pattern.rows", 6, ALL),
        ("boards.2.pattern.square_mm", 61, ALL),
        ("boards.2.pattern.marker_mm", 41, ALL),
        ("boards.2.pattern.dictionary", "DICT_5X5_50", ALL),
        ("boards.2.pattern.first_tag", 3, ALL),
        ("boards.3.pattern.columns", 5, ALL),
        ("boards.3.pattern.rows", 8, ALL),
        ("boards.3.pattern.square_mm", 61, ALL),
        ("boards.4.pattern.columns", 5, ALL),
        ("boards.4.pattern.rows", 4, ALL),
        ("boards.4.pattern.marker_mm", 61, ALL),
        ("boards.4.pattern.gap_mm", 31, ALL),
        ("boards.4.pattern.dictionary", "DICT_5X5_50", ALL),
        ("boards.4.pattern.first_tag", 6, ALL),
        ("boards.5.pattern.columns", 8, ALL),
        ("boards.5.pattern.rows", 4, ALL),
        ("boards.5.pattern.pitch_mm", 81, ALL),
        ("boards.5.pattern.diameter_mm", 31, ALL),
        ("boards.6.pattern.columns", 5, ALL),
        ("boards.6.pattern.rows", 7, ALL),
        ("boards.6.pattern.pitch_mm", 41, ALL),
        ("boards.6.pattern.diameter_mm", 26, ALL),
        ("boards.7.pattern.columns", 5, ALL),
        ("boards.7.pattern.rows", 4, ALL),
        ("boards.7.pattern.marker_mm", 61, ALL),
        ("boards.7.pattern.gap_mm", 21, ALL),
        ("boards.7.pattern.border_cells", 1, ALL),
        ("boards.7.pattern.dictionary", "DICT_APRILTAG_25h9", ALL),
        ("boards.7.pattern.first_tag", 6, ALL),
        ("boards.8.pattern.columns", 5, ALL),
        ("boards.8.pattern.rows", 4, ALL),
        ("boards.8.pattern.pitch_mm", 101, ALL),
        ("boards.8.pattern.diameter_mm", 71, ALL),
        ("boards.8.pattern.crowns", 3, ALL),
        ("boards.8.pattern.first_tag", 6, ALL),
        ("boards.9.pattern.diameter_mm", 310, ALL),
        ("boards.9.pattern.number", 10, ALL),
        ("boards.10.pattern.columns", 6, ALL),
        ("boards.10.pattern.rows", 3, ALL),
        ("boards.10.pattern.square_mm", 61, ALL),
        ("boards.10.pattern.gap_mm", 41, ALL),
        ("boards.11.pattern.columns", 5, ALL),
        ("boards.11.pattern.rows", 6, ALL),
        ("boards.11.pattern.pitch_mm", 61, ALL),
        ("boards.11.pattern.diameter_mm", 41, ALL),
        ("u_print_scale_ppm", 30, ALL),
        ("certified_poses.u_position_mm", 0.2, SHEET),
        ("certified_poses.u_rotation_deg", 0.02, SHEET),
        ("scale_bars.0.name", "other bar", ALL),  # also the name of the random number of its length
        ("scale_bars.0.role", "check", SHEET),
        ("scale_bars.0.length_mm", 901, ALL),
        ("scale_bars.0.u_length_mm", 0.006, ALL),
        ("scale_bars.0.codes", [101, 105], ALL),
        ("scale_bars.0.diameter_mm", 21, ALL),
        ("scale_bars.0.position_mm", [1, 0, 960], (R,)),
        ("scale_bars.0.direction", [1, 0.1, 0], (R,)),
        ("scale_bars.0.normal", [0, -1, 0.1], (R,)),
        ("meshes.0.unit", "cm", (R,)),
        ("meshes.0.position_mm", [1, -220, 520], (R,)),
        ("meshes.0.rotation_deg", [1, 0, 0], (R,)),
        ("meshes.0.albedo", 0.4, (R,)),
        ("check_targets.0.code", 209, ALL),
        ("check_targets.0.position_mm", [821, 60, 900], (R,)),
        ("check_targets.0.normal", [0.1, -1, 0], (R,)),
        ("check_targets.0.diameter_mm", 21, ALL),
        ("check_targets.1.board", "B", (R,)),
        ("check_targets.1.code", 209, ALL),
        ("check_targets.1.xy_mm", [-77, 152], (R,)),
        ("check_targets.1.diameter_mm", 15, ALL),
        ("check_targets.2.low_mm", [-331, -60, 330], (R,)),
        ("check_targets.2.high_mm", [331, -50, 820], (R,)),
        ("check_targets.2.first_code", 211, ALL),
        ("check_targets.2.counts", [2, 1, 1], ALL),
        ("check_targets.2.normal", [0.1, -1, 0], (R,)),
        ("check_targets.2.diameter_mm", 21, ALL),
        ("check_targets.3.low_mm", [-2001, -900, 330], (R,)),
        ("check_targets.3.high_mm", [-501, -200, 900], (R,)),
        ("check_targets.3.first_code", 221, ALL),
        ("check_targets.3.count", 3, ALL),
        ("check_targets.3.normal", [0.1, -1, 0], (R,)),
        ("check_targets.3.spread_deg", 20, (R,)),
        ("check_targets.3.spacing_mm", 1200, (R,)),
        ("check_targets.3.diameter_mm", 21, ALL),
        ("check_targets.3.seed", 1, (R,)),
        ("check_targets.4.first_code", 231, ALL),
        ("check_targets.4.points_mm", [[1, -420, 400]], (R,)),
        ("check_targets.4.diameter_mm", 21, ALL),
        ("measuring_lines.0.name", "other", ALL),  # also the name of the random numbers of its lengths
        ("measuring_lines.0.first_code", 241, ALL),
        ("measuring_lines.0.start_mm", [-401, -100, 300], (R,)),
        ("measuring_lines.0.direction", [1, 0, 0.4], (R,)),
        ("measuring_lines.0.lengths_mm", [300, 601], ALL),
        ("measuring_lines.0.u_length_mm", 0.003, ALL),
        ("measuring_lines.0.normal", [0.1, -1, 0], (R,)),
        ("measuring_lines.0.diameter_mm", 21, ALL),
        ("acceptance.a_mm", 0.2, ()),
        ("acceptance.k_ppm", 6, ()),
        ("acceptance.b_mm", 2, ()),
        ("target_motion.velocity_mm_s", [0, 2, 0], (R,)),
        ("target_motion.angular_velocity_deg_s", [0, 0, 2], (R,)),
        ("target_motion.about_mm", [11, 0, 0], (R,)),
        ("stations.0.look_at_mm", [1, 0, 1500], (R,)),
        ("stations.0.roll_deg", [90], (R,)),
        ("stations.0.name", "uno", (R,)),
        ("stations.0.position_mm", [1, -3000, 1000], (R,)),
        ("stations.1.look_at_mm", [1, 0, 1500], (R,)),
        ("stations.1.roll_deg", [90], (R,)),
        ("stations.1.count", 3, (R,)),
        ("stations.1.radius_mm", 3001, (R,)),
        ("stations.1.height_mm", 1201, (R,)),
        ("stations.1.azimuth_deg", [-44, 45], (R,)),
        ("stations.2.look_at_mm", [1, 0, 1500], (R,)),
        ("stations.2.roll_deg", [90], (R,)),
        ("stations.2.count", 3, (R,)),
        ("stations.2.radius_mm", 501, (R,)),
        ("stations.2.centre_mm", [1, -3000, 1200], (R,)),
        ("stations.2.axis", [0.1, 1, 0], (R,)),
        ("stations.3.look_at_mm", [1, 0, 1500], (R,)),
        ("stations.3.roll_deg", [90], (R,)),
        ("stations.3.counts", [2, 1, 2], (R,)),
        ("stations.3.low_mm", [-501, -3100, 900], (R,)),
        ("stations.3.high_mm", [501, -3000, 1000], (R,)),
        ("stations.4.look_at_mm", [1, 0, 1500], (R,)),
        ("stations.4.roll_deg", [90], (R,)),
        ("stations.4.count", 3, (R,)),
        ("stations.4.low_mm", [-501, -3100, 900], (R,)),
        ("stations.4.high_mm", [501, -3000, 1400], (R,)),
        ("stations.4.seed", 1, (R,)),
        ("render.mode", "path", (R,)),
        ("render.cells", 4, (R,)),
        ("render.light_spacing_mm", 61, (R,)),
        ("render.light_paths", 4097, (R,)),
        ("render.blur_shots", 65, (R,)),
        ("render.samples", 65, ()),  # of the mode path alone
        ("render.noise_target", 0.006, (R,)),
        ("render.most_samples", 4097, (R,)),
        ("measure.centroid", "ellipse_model", (D,)),
        ("measure.calibrator", "zhang", (C,)),
        ("measure.lens", "rational", (C, P)),
        ("measure.hold", ["k3"], (C,)),
        ("measure.board", "A", (C,)),
        ("measure.reconstructor", "ml", (P,)),
        ("measure.smallest_diameter_px", 6, (D,)),
        ("measure.centroid_options", {"one": 1}, (D,)),
        ("measure.calibrator_options", {"hold": ["k2"]}, (C,)),
        ("measure.reconstructor_options", {"one": 1}, (P,)),
    ],
    "sheared": [("camera.shear", 0.001, (R,))],
    "rational": [(f"camera.{name}", 0.001, (R,)) for name in ("k4", "k5", "k6", "s1", "s2", "s3", "s4")],
    "fisheye": [("camera.k4", 0.001, (R,))],
    "path": [("render.samples", 65, (R,)), ("render.cells", 4, ()), ("render.light_paths", 4097, ())],
    "map": [
        ("room.environment.file", "other.png", (R,)),
        ("room.environment.scale_w_m2_sr", 2, (R,)),
        ("room.environment.azimuth_deg", 10, (R,)),
    ],
    "ambient": [("room.ambient_w_m2_sr", 0.6, (R,))],
    "stuck": [
        ("check_targets.0.count", 13, ALL),
        ("check_targets.0.spacing_mm", 100, (R,)),
        ("check_targets.0.facing", [0, 1, 0], (R,)),
        ("check_targets.0.within_deg", 180, (R,)),
        ("check_targets.0.seed", 1, (R,)),
    ],
    "several": [
        ("cameras.0.width_px", 1290, (R, C)),
        ("cameras.0.height_px", 1030, (R, C)),
        ("cameras.0.pixel_pitch_um", 3.5, (R, E)),
        ("cameras.0.f_number", 9, (R, E)),
        ("cameras.0.lens", "brown", (R, C, P)),
        ("cameras.0.focal_length_mm", 12.5, (R,)),
        ("cameras.0.aspect", 1.01, (R,)),
        ("cameras.0.principal_point_offset_px", [1, 0], (R,)),
        *((f"cameras.0.{name}", 0.001, (R,)) for name in ("k1", "k2", "k3", "p1", "p2", "shear")),
        *((f"cameras.2.{name}", 0.001, (R,)) for name in ("k4", "k5", "k6", "s1", "s2", "s3", "s4")),
        ("cameras.0.psf_sigma_px", 0.7, (R,)),
        ("cameras.0.diffraction", True, (R,)),
        ("cameras.0.focus_mm", 3100, (R,)),
        ("cameras.0.vignetting", [0.1, 0, 0], (R,)),
        ("cameras.0.natural_vignetting", True, (R,)),
        ("cameras.0.coefficients", {"k1": 0.02}, (R,)),
        # What a rig is designed as, the calibration is told.
        ("rigs.0.cameras.0.position_mm", [-310, 0, 0], (R, C)),
        ("rigs.0.cameras.0.rotation_deg", [0, 1, 0], (R, C)),
        ("rigs.0.cameras.1.u_position_mm", 0.2, (C,)),
        ("rigs.0.cameras.1.u_rotation_deg", 0.02, (C,)),
        ("scale_bars.0.moves.0.position_mm", [0, 0, 1320], (R,)),
        ("scale_bars.0.moves.0.direction", [1, 0, 0.1], (R,)),
        ("scale_bars.0.moves.0.normal", [0, -1, 0.1], (R,)),
        ("stations.1.name", "other", (R,)),
        ("stations.1.position_mm", [0, -3000, 1150], (R,)),
        ("stations.1.rotation_deg", [91, 0, 0], (R,)),
    ],
    "global": [("exposure.shutter", "rolling", ())],  # all rows still begin together
    "plain sensor": [("sensor.preset", "IMX900-LCG", (R, E))],  # the pixels' size besides
}
KINDS = {"kind", "generator"}
"""What says which model a table is: another value is another table."""
UNNAMED = {"MeshPart.name", "MeshPart.file", "CheckOnMesh.mesh", "NamedCameraPart.name", "RigPart.name"}
REFERENCES = {"camera", "rig"}
"""Leaves that are changed in tests of their own."""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the files that the scenes name."""
    import cv2

    folder = tmp_path_factory.mktemp("keys")
    shutil.copytree(SCENES / "meshes", folder / "meshes")
    words = code_words(14)[np.arange(500)[::-1]]
    codes = "".join(f"[[codes]]\nnumber = {k}\nword = {word}\n" for k, word in enumerate(words.tolist(), 1))
    (folder / "codes.toml").write_text("bits = 14\n" + codes)
    for name, value in (("light.png", 100), ("other.png", 150)):
        cv2.imwrite(str(folder / name), np.full((8, 16, 3), value, np.uint8))
    return folder


def parsed(table: dict[str, Any], folder: Path) -> SceneFile:
    import tomli_w

    kept = {k: v for k, v in table.items() if v is not None}
    kept["room"] = {k: v for k, v in kept["room"].items() if v is not None}
    return parse_scene(tomli_w.dumps(kept), "all.toml", folder)


def table_of(variant: str) -> dict[str, Any]:
    return changed(tomllib.loads(BASE), VARIANTS[variant])


def keys_of(scene: SceneFile, world: World | None = None) -> dict[str, Any]:
    """The keys of all stages, other stages' files being the same whatever the scene says."""
    if world is None:
        truth = Truth.of(scene, "all.toml")
        world, sheet = truth.world, truth.told
        parts = [(part.scene, own) for part, own in zip(truth.parts, truth.worlds, strict=True)]
    else:
        parts, sheet = [(scene, world)], world.field
    rendered = [keys.render_keys(*part) for part in parts]
    return {
        R: [one.images if scene.render.mode == "path" else (one.light, one.images) for one in rendered],
        E: [keys.expose_key(part, "one", "radiance") for part, _ in parts],
        D: keys.detect_key(scene, sheet, ["frame"]),
        C: keys.calibrate_key(scene, sheet, "observations"),
        P: keys.reconstruct_key(scene, sheet, "observations", "calibration"),
        "score": keys.score_key(scene, world, ["measured"], {}),
        "report": keys.report_key(scene, world, ["measured"], ""),
    }


@lru_cache
def before(variant: str, folder: Path) -> dict[str, Any]:
    return keys_of(parsed(table_of(variant), folder))


PARTS = sorted({(variant, path.split(".")[0]) for variant, lines in TABLE.items() for path, *_ in lines})


@pytest.mark.parametrize(("variant", "part"), PARTS)
def test_a_change_of_any_value_changes_the_keys_of_the_stages_that_depend_on_it(
    variant: str, part: str, place: Path
) -> None:
    old, wrong = before(variant, place), {}
    for path, value, expected in (line for line in TABLE[variant] if line[0].split(".")[0] == part):
        new = keys_of(parsed(changed(table_of(variant), {path: value}), place))
        found = {stage for stage in old if new[stage] != old[stage]}
        if found != {*expected, "score", "report"}:
            wrong[path] = (sorted(found), expected)
    assert not wrong


def leaves(model: type[BaseModel], seen: set[type]) -> set[str]:
    """All fields of a model and of those in it that hold no model themselves, as Model.field."""
    if model in seen:
        return set()
    seen.add(model)
    found: set[str] = set()
    for name, field in model.model_fields.items():
        inner = models(field.annotation)
        found |= set().union(*(leaves(part, seen) for part in inner)) if inner else {f"{model.__name__}.{name}"}
    return found


def models(annotation: Any) -> set[type[BaseModel]]:
    """The models in a type."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {annotation}
    return set().union(*(models(part) for part in get_args(annotation))) if get_args(annotation) else set()


def test_no_leaf_of_the_schema_is_left_out_of_the_table(place: Path) -> None:
    reached = set(UNNAMED)
    for variant, lines in TABLE.items():
        scene = parsed(table_of(variant), place)
        for path, *_ in lines:
            *way, last = path.split(".")
            part: Any = scene
            for step in way:
                part = part[int(step)] if step.isdigit() else getattr(part, step)
            reached.add(f"{type(part).__name__}.{last}")
    every = {leaf for leaf in leaves(SceneFile, set()) if leaf.split(".")[1] not in KINDS | REFERENCES}
    assert not every - reached
    assert not reached - every


def test_a_mesh_and_what_sticks_to_it_are_renamed_together(place: Path) -> None:
    renamed = changed(table_of("base"), {"meshes.0.name": "body", "check_targets.4.mesh": "body"})
    new, old = keys_of(parsed(renamed, place)), before("base", place)
    # The stickers' codes and sizes are told, not what they stick to; the mesh's name names a file of the run.
    assert {stage for stage in old if new[stage] != old[stage]} == {R, "score", "report"}


def test_a_camera_or_a_rig_is_renamed_with_what_refers_to_it(place: Path) -> None:
    old = before("several", place)
    for renamed, expected in (
        ({"cameras.2.name": "lonely", "stations.1.camera": "lonely"}, {C}),
        ({"rigs.0.name": "beam", "stations.0.rig": "beam", "stations.2.rig": "beam"}, {C}),
    ):
        new = keys_of(parsed(changed(table_of("several"), renamed), place))
        assert {stage for stage in old if new[stage] != old[stage]} == {*expected, "score", "report"}


def test_a_mesh_counts_by_what_is_in_its_file(place: Path) -> None:
    old = before("base", place)
    moved = (place / "meshes/hull.stl").read_bytes()
    (place / "meshes/same.stl").write_bytes(moved)
    same = keys_of(parsed(changed(table_of("base"), {"meshes.0.file": "meshes/same.stl"}), place))
    assert same[R] == old[R] and same["score"] != old["score"]
    import trimesh

    trimesh.creation.box((900.0, 200, 400)).export(place / "meshes/box.stl")
    box = keys_of(parsed(changed(table_of("base"), {"meshes.0.file": "meshes/box.stl"}), place))
    assert {stage for stage in old if box[stage] != old[stage]} == {R, "score", "report"}


def test_inputs_that_are_sound_but_different_change_every_key(place: Path) -> None:
    scene = parsed(table_of("base"), place)
    world = build_world(scene)
    sheet, other = world.field, replace(world.field, u_scale=world.field.u_scale + 1e-6)
    for make, inputs in (
        (lambda a: keys.expose_key(scene, "one", a), "ab"),
        (lambda a: keys.expose_key(scene, a, "radiance"), ("one", "two")),
        (lambda a: keys.detect_key(scene, sheet, a), (["a", "b"], ["b", "a"])),
        (lambda a: keys.detect_key(scene, a, ["a"]), (sheet, other)),
        (lambda a: keys.calibrate_key(scene, sheet, a), "ab"),
        (lambda a: keys.calibrate_key(scene, a, "a"), (sheet, other)),
        (lambda a: keys.reconstruct_key(scene, sheet, a, "c"), "ab"),
        (lambda a: keys.reconstruct_key(scene, sheet, "o", a), "ab"),
        (lambda a: keys.reconstruct_key(scene, a, "o", "c"), (sheet, other)),
        (lambda a: keys.score_key(scene, world, a, {}), (["a", "b"], ["a", "c"])),
        (lambda a: keys.score_key(scene, world, ["a"], a), ({"render": 1.0}, {"render": 2.0})),
        (lambda a: keys.report_key(scene, world, a, ""), (["a", "b"], ["a", "c"])),
        (lambda a: keys.report_key(scene, world, ["a"], a), ("", "certificate")),
        (run_field_key, (sheet, other)),
    ):
        a, b = inputs
        assert make(a) == make(a)
        assert make(a) != make(b)


EDITS = [
    (R, "render/pattern.py"),
    (R, "render/shade.py"),
    (R, "camera/lens.py"),
    (R, "seeds.py"),
    (R, "camera/lenses/brown.py"),
    (C, "camera/lenses/brown.py"),
    (P, "camera/lenses/brown.py"),
    (E, "sensor/patterns.py"),
    (E, "sensor/expose.py"),
    (E, "seeds.py"),
    (D, "detect/decode.py"),
    (D, "detect/identify.py"),
    (D, "detect/centre_forward.py"),
    (D, "targets/ring_code.py"),
    (C, "adjust/normal.py"),
    (C, "calibrate/settle.py"),
    (C, "camera/circle.py"),
    (P, "reconstruct/gls.py"),
    (P, "reconstruct/estimate.py"),
    (D, "measure/pipeline.py"),
    (C, "measure/pipeline.py"),
    (P, "measure/pipeline.py"),
    (D, "targets/kinds/charuco.py"),
    (C, "targets/kinds/charuco.py"),
    ("score", "score/detection.py"),
    ("score", "score/align.py"),
    ("score", "scene/truth.py"),
    ("report", "report/page.html"),
    ("report", "report/figures.py"),
    ("report", "score/points.py"),
]
"""Each stage, and files it computes with, some of them far down."""
BLIND = {
    R: ("detect/decode.py", "score/align.py", "camera/lenses/fisheye.py"),
    E: ("render/pattern.py", "camera/lenses/brown.py"),
    D: ("score/align.py", "scene/build.py"),
    C: ("detect/decode.py", "scene/build.py", "camera/lenses/fisheye.py"),
    P: ("score/align.py",),
    "score": ("report/page.html",),
}
"""Files that a stage does not compute with: editing them must not cost a render."""


def test_every_stage_reacts_to_its_own_code_and_to_no_other(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy = tmp_path / "testfield"
    shutil.copytree(code.ROOT, copy, ignore=shutil.ignore_patterns("__pycache__"))
    scene = parsed(table_of("ambient"), place)
    world = build_world(scene)

    def of_stages() -> dict[str, Any]:
        code.code_digest.cache_clear()
        return keys_of(scene, world)

    monkeypatch.setattr(code, "ROOT", copy)
    try:
        old = of_stages()
        edited_files = sorted({name for _, name in EDITS} | {name for files in BLIND.values() for name in files})
        for name in edited_files:
            path = copy / name
            text = path.read_bytes()
            path.write_bytes(text + (b"\nEDITED = 1\n" if path.suffix == ".py" else b"\n"))
            new = of_stages()
            path.write_bytes(text)
            moved = {stage for stage in old if new[stage] != old[stage]}
            assert {stage for stage, edited in EDITS if edited == name} <= moved, name
            assert not {stage for stage, files in BLIND.items() if name in files} & moved, name
        for path in (copy / name for name in edited_files if name.endswith(".py")):
            path.write_bytes(path.read_bytes() + b'\n# A comment.\n"""A docstring."""\n')
        assert of_stages() == old
    finally:
        monkeypatch.undo()
        code.code_digest.cache_clear()


@pytest.mark.parametrize(
    ("kind", "field", "stage"),
    [("centroids", "centroid", D), ("calibrators", "calibrator", C), ("reconstructors", "reconstructor", P)],
)
def test_every_algorithm_counts_with_its_own_file(
    kind: str, field: str, stage: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever is chosen by name, its module is among those that the stage's key is made of."""
    asked: list[tuple[str, ...]] = []

    def heard(*modules: str, without: tuple[str, ...] = ()) -> str:
        if not without:  # with it, it is the pipeline's own
            asked.append(modules)
        return "digest"

    monkeypatch.setattr(keys, "code_digest", heard)
    scene = parsed(table_of("ambient"), place)
    world = build_world(scene)
    for name in names(kind):
        asked.clear()
        keys_of(scene.model_copy(update={"measure": scene.measure.model_copy(update={field: name})}), world)
        by_stage = dict(zip((R, E, D, C, P, "score", "report"), asked, strict=True))
        assert module_of(kind, name) in by_stage[stage], name
