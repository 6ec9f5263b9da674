"""The field of the study `wls`: 42 check targets, three small boards and a bar, and 16 stations around them.

The two scenes differ by the stations' distances alone: all at 4.5 m, or from 2 to 10 m with every distance as likely
from every side. Boards are printed exactly and the bar is as long as its certificate says, because what the workshop
does is drawn anew in every exposure (`testfield_studies.wls.experiment`).
"""

from typing import Any

import numpy as np

MAP = (
    "xx......CCCC",
    "xxxx.xxxCCCC",
    "x.xxxx.xCCCC",
    "x.x.AAAA.x.x",
    "...xAAAAx..x",
    "xx.xAAAAx..x",
    "BBBB.xxxx.xx",
    "BBBBx..xxxx.",
    "BBBB..x..xxx",
)
"""The field from the front, a cell each: check targets (x), boards, and cells left empty so that all is seen by all."""
CELL_MM = 134.0
MIDDLE_MM = (0.0, 0.0, 1500.0)
DIAMETER_MM = 32.0
AMBIENT_W_M2_SR = 1.3
"""Light from all sides and no lamp: no shadow of a board falls on the targets beside it."""
NORMALS = {"A": [0.03, -1, 0.04], "B": [0.22, -1, 0.12], "C": [-0.22, -1, -0.12]}
SPINS_DEG = {"A": 1.0, "B": 0.0, "C": 180.0}

SIDES_DEG = (
    (-35, 2),
    (34, 6),
    (2, 30),
    (-3, -20),
    (-24, 22),
    (26, -14),
    (27, 24),
    (-27, -15),
    (36, -4),
    (-37, 9),
    (5, -24),
    (-8, 26),
    (24, 12),
    (-22, -10),
    (14, 20),
    (-15, -18),
)
"""Azimuth and elevation of each station as the field's middle sees it. The first few are as far apart as all are, and
so are those from the ninth on, so that small sets of cameras can be taken from the front and from the middle."""
STEPS = (0, 15, 5, 10, 3, 12, 8, 7, 1, 14, 4, 11, 6, 9, 2, 13)
"""Which of 16 even steps from the nearest to the farthest each station takes, in the same manner."""
EQUAL_MM, NEAR_MM, FAR_MM = 4500.0, 2000.0, 10000.0


def field_scene(spread: bool, stations: int = 16) -> dict[str, Any]:
    """The scene file as a plain table, with the first of the 16 `stations`; ranges equal, or `spread` five times."""
    ends = np.array([_place(-4.0, 5.0, -40.0), _place(4.0, 5.0, -40.0)])
    length = float(np.linalg.norm(ends[1] - ends[0]))
    return {
        "name": "wls_spread" if spread else "wls_equal",
        "seed": 41,
        "code_bits": 12,
        "u_print_scale_ppm": 0,
        "volume": {"size_mm": [1500, 1200, 200]},
        "camera": {
            "width_px": 2048,
            "height_px": 1792,
            "pixel_pitch_um": 4.5,
            "focal_length_mm": 9.0,
            "principal_point_offset_px": [4.2, -3.1],
            "k1": -0.09,
            "k2": 0.11,
            "p1": 0.0003,
            "p2": -0.0002,
            "f_number": 5.6,
            "psf_sigma_px": 0.6,
        },
        "exposure": {"time_ms": 8.0},
        "room": {"ambient_w_m2_sr": AMBIENT_W_M2_SR},
        "boards": [_board(name, number) for number, name in enumerate(NORMALS)],
        "scale_bars": [
            {
                "name": "control bar",
                "role": "control",
                "length_mm": length,
                "u_length_mm": 0.0,
                "codes": [51, 52],
                "diameter_mm": DIAMETER_MM,
                "position_mm": ends.mean(axis=0).tolist(),
                "direction": [1, 0, 0],
            }
        ],
        "check_targets": [
            {"code": 61 + k, "position_mm": _place(*cell).tolist(), "normal": [0, -1, 0.05], "diameter_mm": DIAMETER_MM}
            for k, cell in enumerate(_cells("x"))
        ],
        "stations": [_station(k, spread) for k in range(stations)],
        "render": {"light_paths": 16384, "light_spacing_mm": 100},
    }


def range_mm(station: int, spread: bool) -> float:
    """A station's distance from the middle of the field."""
    return NEAR_MM + (FAR_MM - NEAR_MM) * STEPS[station] / (len(STEPS) - 1) if spread else EQUAL_MM


def _station(k: int, spread: bool) -> dict[str, Any]:
    azimuth, elevation = np.radians(SIDES_DEG[k])
    toward = np.array([np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    return {
        "name": f"s{k + 1:02d}",
        "position_mm": (MIDDLE_MM + range_mm(k, spread) * toward).tolist(),
        "look_at_mm": list(MIDDLE_MM),
        "roll_deg": [90 * (k % 4)],
    }


def _board(name: str, number: int) -> dict[str, Any]:
    across, up = np.mean(_cells(name), axis=0)
    place = _place(across, up, 40.0)
    return {
        "name": name,
        "size_mm": [450, 360],
        "position_mm": place.tolist(),
        "normal": NORMALS[name],
        "spin_deg": SPINS_DEG[name],
        "print_sigma_mm": 0,
        "extension_zone": {
            "columns": 3,
            "rows": 3,
            "pitch_mm": 110,
            "diameter_mm": DIAMETER_MM,
            "centre_mm": [70, 0],
        },
        "recognition_zone": {
            "columns": 1,
            "rows": 3,
            "pitch_mm": 120,
            "diameter_mm": DIAMETER_MM,
            "centre_mm": [-155, 0],
            "first_code": 1 + 10 * number,
        },
    }


def _cells(letter: str) -> list[tuple[float, float]]:
    """Cells of the map with that letter, from the middle of the field."""
    rows, columns = len(MAP), len(MAP[0])
    return [
        (column - (columns - 1) / 2, (rows - 1) / 2 - row)
        for row in reversed(range(rows))
        for column in range(columns)
        if MAP[row][column] == letter
    ]


def _place(across: float, up: float, behind_mm: float = 0.0) -> np.ndarray:
    """Where a cell is in space: the field is a shallow dish."""
    x, z = across * CELL_MM, up * CELL_MM
    depth = -70 * np.cos(2 * np.pi * x / 1700) * np.cos(2 * np.pi * z / 1500)
    return np.array([x, depth + behind_mm, MIDDLE_MM[2] + z])
