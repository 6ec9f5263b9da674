"""The scenes of the study on stitched boards, as plain tables: one camera, one room, and what is calibrated with.

A field is 2.0 x 1.3 m, seen from the front (-y) by ten convergent stations. A sub-board is 400 x 300 mm with 36 marks.
A chain is a row of sub-boards along x; every close view is aimed at two neighbours, and wide views see up to eight.
"""

from typing import Any

import numpy as np

from testfield.scene.bend import extent_mm
from testfield.seeds import generator

WIDTH_MM, HEIGHT_MM, MIDDLE_MM = 2000.0, 1300.0, (0.0, 150.0, 850.0)
"""Outline of a field, in x and z, and its middle."""
SIZE_MM, MARKS = (400.0, 300.0), 36
"""A sub-board's size and how many marks it carries."""
GRIDS = {1: (1, 1), 2: (2, 1), 3: (3, 1), 4: (2, 2), 6: (3, 2), 9: (3, 3), 12: (4, 3)}
"""Columns and rows of sub-boards."""
FULL = {1: ((2, 3), (5, 6)), 3: ((2, 6), (12, 8)), 6: ((3, 8), (16, 12)), 12: ((3, 8), (24, 17))}
"""Columns and rows of codes and of dots on a full-size board with as many marks as that many sub-boards."""
TILT_DEG, DEPTH_MM = 28.0, 120.0
PITCH_MM = 440.0
WINDOW = 8
"""Boards of a chain that a wide view sees."""
BOW_OVER_MM = 400.0
"""Length over which a bow is stated."""

Table = dict[str, Any]


def planned(count: int, seed: int = 0) -> list[Table]:
    """Sub-boards spread over the whole field, each tilted another way, spun by quarters, alternately near and far."""
    columns, rows = GRIDS[count]
    found = []
    for k in range(count):
        column, row = k % columns, k // columns
        angle = 2.4 * k + 0.6  # golden angle: neighbours lean apart
        lean = np.tan(np.radians(TILT_DEG if count > 1 else 5.0))
        normal = [lean * np.cos(angle), -1.0, lean * np.sin(angle)]
        depth = MIDDLE_MM[1] + (DEPTH_MM if (row + column) % 2 else -DEPTH_MM) * (count > 1)
        found.append(_board(k, [*_across(column, columns, row, rows, depth)], normal, 90.0 * (k % 4)))
    return found


def flat(count: int, seed: int = 0) -> list[Table]:
    """The same places, all sub-boards in one plane and upright."""
    columns, rows = GRIDS[count]
    places = [_across(k % columns, columns, k // columns, rows, MIDDLE_MM[1]) for k in range(count)]
    return [_board(k, [*place], [0.0, -1.0, 0.0], 0.0) for k, place in enumerate(places)]


def random(count: int, seed: int) -> list[Table]:
    """Sub-boards wherever they fall: places in the field's box, leaning within 45 degrees, any spin; none before
    another as seen from the front."""
    own = [generator(seed, f"stitching/random/{count}/{k}") for k in range(count)]
    half = np.array([WIDTH_MM - SIZE_MM[0], HEIGHT_MM - SIZE_MM[1]]) / 2
    apart = 520.0
    places: list[np.ndarray] = []
    while len(places) < count:
        place = own[len(places)].uniform(-half, half)
        if not places or np.linalg.norm(place - np.array(places), axis=1).min() > apart:
            places.append(place)
        else:
            apart *= 0.999  # a denser packing is asked for the longer none is found
    found = []
    for k, (x, z) in enumerate(places):
        rng = generator(seed, f"stitching/random/{count}/{k}/attitude")
        lean, turn = np.tan(np.radians(rng.uniform(0, 45))), rng.uniform(0, 2 * np.pi)
        y = MIDDLE_MM[1] + rng.uniform(-150, 150)
        normal = [float(lean * np.cos(turn)), -1.0, float(lean * np.sin(turn))]
        found.append(_board(k, [float(x), float(y), float(z + MIDDLE_MM[2])], normal, float(rng.uniform(0, 360))))
    return found


PLACEMENTS = {"planned": planned, "flat": flat, "random": random}


def field(placement: str, count: int, seed: int, bow_mm: float = 0.0, scale_ppm: float = 0.0) -> Table:
    """A field of sub-boards. `bow_mm` over 400 mm bends each, its sign and axis drawn; `scale_ppm` is the standard
    deviation of their own scale errors."""
    boards = PLACEMENTS[placement](count, seed)
    rng = generator(seed, f"stitching/manufacture/{count}")
    sign, axis, ppm = rng.choice([-1.0, 1.0], count), rng.uniform(0, 180, count), rng.standard_normal(count)
    for k, board in enumerate(boards):
        if bow_mm:
            board |= bent(SIZE_MM, float(sign[k] * bow_mm), float(axis[k]))
        if scale_ppm:
            board["scale_error_ppm"] = float(ppm[k] * scale_ppm)
    # Exact poses on the sheet, for the calibrator that is told them: what stitching costs is the difference to it.
    return _scene(f"stitching-{placement}-{count}", seed, boards) | {"certified_poses": {}}


def full(count: int, seed: int, bow_mm: float = 0.0) -> Table:
    """One board of the field's size with as many marks as `count` sub-boards, printed without error; `bow_mm` over
    400 mm bends it."""
    (columns, rows), (across, down) = FULL[count]
    pitch = min(1520 / (across - 1), 1160 / (down - 1))
    board = {
        "name": "full",
        "size_mm": [WIDTH_MM, HEIGHT_MM],
        "position_mm": [*MIDDLE_MM],
        "normal": [0.05, -1.0, 0.08],
        "print_sigma_mm": 0.0,
        "recognition_zone": {
            "columns": columns,
            "rows": rows,
            "pitch_mm": 1100 / (rows - 1) if rows > 3 else 250.0,
            "diameter_mm": 22,
            "centre_mm": [-800.0, 0.0],
            "first_code": 1,
        },
        "extension_zone": {
            "columns": across,
            "rows": down,
            "pitch_mm": pitch,
            "diameter_mm": 14,
            "centre_mm": [200.0, 0.0],
        },
    }
    if rows > 3:
        zone = board["recognition_zone"]
        zone["pitch_mm"] = min(zone["pitch_mm"], 150.0)  # type: ignore[index]
    if bow_mm:
        board |= bent((WIDTH_MM, HEIGHT_MM), bow_mm, 90.0)
    return _scene(f"stitching-full-{count}", seed, [board])


def bent(size_mm: tuple[float, float], bow_mm: float, axis_deg: float) -> Table:
    """A board's bow and its axis, where a strip of 400 mm would have `bow_mm`: of one curvature, the bow grows with the
    square of the length across the axis."""
    across = extent_mm(size_mm, np.radians(axis_deg))
    return {"bow_mm": bow_mm * (across / BOW_OVER_MM) ** 2, "bow_axis_deg": axis_deg}


def charuco(count: int, seed: int) -> Table:
    """One ChArUco board of the area of `count` sub-boards."""
    return _scene(f"stitching-charuco-{count}", seed, [_charuco(count)])


def close(board: str, seed: int) -> Table:
    """One sub-board or one ChArUco board of its size, ten close views that show it all over the image."""
    part = planned(1)[0] if board == "sub-board" else _charuco(1)
    scene = _scene(f"stitching-close-{board}", seed, [part])
    aims = [(-70, -45), (70, -45), (-70, 45), (70, 45), (0, 0), (-60, 0), (60, 0), (0, 45), (0, -45), (0, 0)]
    x0, y0, z0 = MIDDLE_MM
    stations = []
    for k, (x, z) in enumerate(aims):
        azimuth, rise = np.radians([(-34, 30, 20, -26, 0, 36, -38, 12, -8, 24)[k], (-24, -18, 26, 22, 30, 4)[k % 6]])
        away = 640 if k % 4 in (0, 2) else 760
        towards = np.array([np.sin(azimuth) * np.cos(rise), -np.cos(azimuth) * np.cos(rise), np.sin(rise)])
        at = np.array([x0 + x, y0, z0 + z])
        stations.append(
            {
                "position_mm": (at + away * towards).tolist(),
                "look_at_mm": at.tolist(),
                "roll_deg": [[0.0, 90.0, 180.0, 270.0][k % 4]],
            }
        )
    return scene | {"stations": stations, "check_targets": [], "scale_bars": []}


def chain(count: int, wide: int, seed: int, print_sigma_mm: float = 0.01) -> Table:
    """A row of sub-boards, two close views of every two neighbours (`link..`), and `wide` views (`wide..`) of every
    eight boards, half of them shared with the next eight."""
    boards = []
    for k in range(count):
        lean = 0.12 if k % 2 else -0.12
        board = _board(k, [PITCH_MM * k, 0.0, 1000.0], [lean, -1.0, 0.05 * (k % 3 - 1)], 0.0)
        boards.append(board | {"print_sigma_mm": print_sigma_mm})
    stations = []
    for k in range(count - 1):
        at = np.array([PITCH_MM * (k + 0.5), 0.0, 1000.0])
        sign = 1 if k % 2 else -1
        for letter, azimuth, rise, roll, away in (("a", 30, 18, 0, 1250), ("b", -30, -18, 90, 1680)):
            roll_deg = (roll + (180 if k % 4 > 1 else 0)) % 360
            stations.append(_view(f"link{k + 1:02d}{letter}", at, sign * azimuth, rise, away, roll_deg))
    for first in range(0, max(count - WINDOW, 0) + 1, WINDOW // 2):
        here = min(WINDOW, count)
        at = np.array([PITCH_MM * (first + (here - 1) / 2), 0.0, 1000.0])
        for v in range(wide):
            azimuth, rise, roll = ((-22, 14, 0), (22, -6, 180), (-8, -8, 0), (10, 18, 180))[v]
            stations.append(_view(f"wide{first + 1:02d}{'abcd'[v]}", at, azimuth, rise, 620 * here, roll))
    scene = _scene(f"stitching-chain-{count}", seed, boards)
    length = PITCH_MM * count
    return scene | {
        "stations": stations,
        "check_targets": [],
        "volume": {"size_mm": [length, 600, 600]},
        "scale_bars": [_bar([PITCH_MM / 2, 0.0, 1215.0], 700.0)],
        "room": _room(length + 6000.0, length / 2 - PITCH_MM / 2, length + 1000.0),
    }


def _board(k: int, position: list[float], normal: list[float], spin_deg: float) -> Table:
    return {
        "name": f"B{k + 1:02d}",
        "size_mm": [*SIZE_MM],
        "position_mm": [float(v) for v in position],
        "normal": [float(v) for v in normal],
        "spin_deg": spin_deg,
        "recognition_zone": {
            "columns": 2,
            "rows": 3,
            "pitch_mm": 90,
            "diameter_mm": 22,
            "centre_mm": [-115, 0],
            "first_code": 1 + 6 * k,
        },
        "extension_zone": {"columns": 5, "rows": 6, "pitch_mm": 44, "diameter_mm": 14, "centre_mm": [88, 0]},
    }


def sub_board_marks_mm() -> np.ndarray:
    """(36, 2) where the marks of a sub-board are."""
    board = _board(0, [0.0, 0.0, 0.0], [0.0, -1.0, 0.0], 0.0)
    grids = []
    for zone in (board["recognition_zone"], board["extension_zone"]):
        axes = [(np.arange(zone[k]) - (zone[k] - 1) / 2) * zone["pitch_mm"] for k in ("columns", "rows")]
        grids.append(np.stack(np.meshgrid(*axes), -1).reshape(-1, 2) + zone["centre_mm"])
    return np.vstack(grids)


def _charuco(count: int) -> Table:
    width = np.sqrt(count * SIZE_MM[0] * SIZE_MM[1] * 4 / 3)
    columns = {1: 8, 3: 13, 6: 18, 12: 26}[count]
    rows = round(columns * 0.75)
    square = float(width / columns)
    return {
        "name": "charuco",
        "size_mm": [columns * square + 20, rows * square + 20],
        "position_mm": [*MIDDLE_MM],
        "normal": [0.05, -1.0, 0.08],
        "pattern": {
            "kind": "charuco",
            "columns": columns,
            "rows": rows,
            "square_mm": square,
            "marker_mm": 0.76 * square,
            "dictionary": "DICT_4X4_250" if count < 12 else "DICT_4X4_1000",
        },
    }


def _across(column: int, columns: int, row: int, rows: int, depth: float) -> tuple[float, float, float]:
    x = ((column + 0.5) / columns - 0.5) * WIDTH_MM
    z = (0.5 - (row + 0.5) / rows) * HEIGHT_MM
    return x + MIDDLE_MM[0], depth, z + MIDDLE_MM[2]


def _view(name: str, at: np.ndarray, azimuth_deg: float, rise_deg: float, away_mm: float, roll_deg: float) -> Table:
    azimuth, rise = np.radians([azimuth_deg, rise_deg])
    towards = np.array([np.sin(azimuth) * np.cos(rise), -np.cos(azimuth) * np.cos(rise), np.sin(rise)])
    return {
        "name": name,
        "position_mm": (at + away_mm * towards).tolist(),
        "look_at_mm": at.tolist(),
        "roll_deg": [float(roll_deg)],
    }


def _bar(position: list[float], length: float) -> Table:
    return {
        "name": "control bar",
        "role": "control",
        "length_mm": length,
        "u_length_mm": 0.005,
        "codes": [301, 302],
        "position_mm": position,
        "direction": [1, -0.05, 0.02],
        "normal": [0, -1, -0.1],
    }


def _room(width: float, x: float, lamp: float) -> Table:
    return {
        "ambient_w_m2_sr": 0.6,
        "surfaces": [
            {
                "name": "floor",
                "size_mm": [width, 8000.0],
                "position_mm": [x, -2500.0, -400.0],
                "normal": [0, 0, 1],
                "albedo": 0.3,
            },
            {"name": "wall", "size_mm": [width, 4000.0], "position_mm": [x, 900.0, 1600.0], "normal": [0, -1, 0]},
        ],
        "lights": [
            {
                "size_mm": [lamp, 1200.0],
                "position_mm": [x + 300.0, -2200.0, 3600.0],
                "normal": [-0.1, 0.7, -1],
                "radiance_w_m2_sr": 12.0,
            }
        ],
    }


def _scene(name: str, seed: int, boards: list[Table]) -> Table:
    """A scene with the study's camera, light, ten stations, a control bar and twelve check targets."""
    look = {"look_at_mm": [*MIDDLE_MM], "generator": "arc", "count": 5, "radius_mm": 2350.0}
    return {
        "name": name,
        "seed": seed,
        "u_print_scale_ppm": 30.0,
        "volume": {"size_mm": [WIDTH_MM, 800.0, HEIGHT_MM]},
        "camera": {
            "width_px": 1600,
            "height_px": 1200,
            "pixel_pitch_um": 4.5,
            "focal_length_mm": 8.0,
            "principal_point_offset_px": [5.2, -4.1],
            "aspect": 1.0001,
            "k1": -0.09,
            "k2": 0.11,
            "k3": -0.015,
            "p1": 0.0003,
            "p2": -0.0002,
            "f_number": 5.6,
            "psf_sigma_px": 0.6,
        },
        "exposure": {"time_ms": 8.0},
        "room": _room(6000.0, 0.0, 1800.0),
        "boards": boards,
        "scale_bars": [_bar([0.0, 60.0, 1545.0], 1200.0)],
        "check_targets": [
            {
                "generator": "grid",
                "first_code": 401,
                "counts": [3, 2, 2],
                "low_mm": [-780.0, -520.0, 380.0],
                "high_mm": [780.0, -220.0, 1320.0],
                "normal": [0, -1, 0.1],
            },
        ],
        "stations": [
            look | {"height_mm": 450.0, "azimuth_deg": [-40, 38], "roll_deg": [0, 90, 180, 270]},
            look | {"height_mm": 1500.0, "azimuth_deg": [-36, 42], "roll_deg": [90, 0, 270, 180]},
        ],
        "render": {"light_paths": 512, "light_spacing_mm": 100.0},
    }
