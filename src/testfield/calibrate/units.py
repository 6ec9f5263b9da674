"""Sheets in another unit than the rest: boards against each other, dots against their spacing."""

import numpy as np

from testfield.calibrate.edges import Edges
from testfield.camera.pose import Poses
from testfield.detect.observations import Observations
from testfield.targets.field import Field

TOO_FAR = 1.5
"""A ratio of lengths beyond which no lens and no rough pose explains it."""
DOTS_TOO_FAR = 5.0
"""The same of dots against their spacing: blur and paint change sizes, but no unit is nearer to another."""
LEAST_BASE = 0.05
"""A base between two stations, over their distances to the board, from which it says something of the scale."""
UNITS = ((1000.0, "metres"), (25.4, "inches"), (10.0, "centimetres"), (304.8, "feet"), (0.001, "micrometres"))


def unit_of(ratio: float, what: str = "sheet") -> str:
    """A question that names the unit in which a number would be, which is `ratio` times too small in millimetres."""
    for factor, name in UNITS:
        if abs(np.log(ratio / factor)) < 0.1:
            return f"is the {what} in {name} instead of millimetres?"
    return f"is the {what}'s unit millimetres?"


def boards_of_one_unit(edges: Edges, camera_from_board: Poses, field: Field, notes: list[str]) -> np.ndarray:
    """(E,) which edges belong to boards that agree on the distances between stations, those of others being noted."""
    keep = np.ones(len(edges), bool)
    while True:
        here = edges.take(keep)
        off = _relative_sizes(here, camera_from_board[keep])
        if not off or max(abs(np.log(v)) for v in off.values()) < np.log(TOO_FAR):
            return keep
        # Where two boards stand against each other, the one that comes first on the sheet is believed.
        worst = max(sorted(off, reverse=True), key=lambda b: round(abs(np.log(off[b])), 1))
        notes.append(
            f"board '{field.boards[worst].name}' is {_times(1 / off[worst])} on its sheet as the other boards show it: "
            f"{unit_of(1 / off[worst])} It is left out"
        )
        keep &= edges.board != worst


def dots_fit_their_spacing(edges: Edges, rows: Observations, field: Field, notes: list[str]) -> dict[int, float]:
    """By how much the dots of a board are larger in the images than its sheet says, where that is no small thing."""
    ratios: dict[int, list[float]] = {}
    if not rows.centre_of_disc:
        return {}
    for e in range(len(edges)):
        b = int(edges.board[e])
        sheet = field.boards[b]
        if sheet.has_corners:
            continue
        here = edges.rows[e]
        point = rows.point[here]
        expected = edges.image[e].enlarged(sheet.marks.xy_mm[point]) * sheet.marks.diameter_mm[point]
        sizes = (rows.diameter_px[here] / expected)[np.isfinite(rows.diameter_px[here])]
        if len(sizes):
            ratios.setdefault(b, []).append(float(np.nanmedian(sizes)))
    wrong = {b: float(np.median(r)) for b, r in ratios.items() if abs(np.log(np.median(r))) > np.log(DOTS_TOO_FAR)}
    for b, ratio in wrong.items():
        notes.append(
            f"the dots of board '{field.boards[b].name}' are {ratio:.3g} times as large against their spacing as its "
            f"sheet says: {unit_of(max(ratio, 1 / ratio))} Their size in the images is believed"
        )
    return wrong


def _relative_sizes(edges: Edges, camera_from_board: Poses) -> dict[int, float]:
    """For each board, how long it makes the distances between stations against what the others make of them."""
    eye = camera_from_board.origin_mm
    far = np.linalg.norm(eye, axis=1)
    boards = np.unique(edges.board)
    place = {b: {int(edges.station[e]): e for e in np.flatnonzero(edges.board == b)} for b in boards}
    found: dict[int, list[float]] = {int(b): [] for b in boards}
    for i, a in enumerate(boards):
        for b in boards[i + 1 :]:
            shared = sorted(set(place[a]) & set(place[b]))
            base = []
            for board in (a, b):
                e = np.array([place[board][s] for s in shared], int)
                gaps = np.linalg.norm(eye[e][:, None] - eye[e][None], axis=2)
                base.append((gaps.sum(), far[e].sum() * max(len(e) - 1, 1)))
            if any(length < LEAST_BASE * depth for length, depth in base) or len(shared) < 2:
                continue
            found[int(a)].append(base[0][0] / base[1][0])
            found[int(b)].append(base[1][0] / base[0][0])
    return {b: float(np.exp(np.median(np.log(ratios)))) for b, ratios in found.items() if ratios}


def _times(ratio: float) -> str:
    factor = max(ratio, 1 / ratio)
    said = f"{factor:.0f}" if factor > 10 else f"{factor:.1f}"
    return f"about {said} times as {'small' if ratio > 1 else 'large'}"
