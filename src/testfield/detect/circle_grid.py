"""Put dots in the order of a regular grid, whatever else the photograph shows."""

import numpy as np
from scipy.spatial import cKDTree

NEIGHBOURS = 12
MISS = 0.25
"""How far from its predicted place a dot may be, in steps of the grid."""
SIZES = 1.7
"""Neighbours differ in diameter by less than this ratio."""
UNPLACED = np.iinfo(int).min
"""Place of what a grid was not followed to: places from a seed are of either sign."""
LEAST_FILLED, LEAST_EDGE = 0.9, 0.5
"""Parts of a whole grid, and of each of its outer rows, that must be found where some dots are not."""


def order_grid(xy_px: np.ndarray, diameter_px: np.ndarray, columns: int = 0, rows: int = 0) -> np.ndarray:
    """Column and row (n, 2) of each dot in the image's largest regular grid, -1 for dots that are not in it.

    From a dot whose neighbours lie in pairs on opposite sides the grid is followed step by step, each place predicted
    from the places before it, so perspective, distortion and bent paper do no harm. Columns run along the side with
    more dots, rows to the right of it as seen in the image (y down), so that a grid seen from its front is never
    mirrored; of the two remaining turns the one whose first dot is nearest to the image's top left is taken. Where
    `columns` and `rows` are given, only a grid of that size counts, complete or with a few dots missing while all of
    its outer rows are there.
    """
    n = len(xy_px)
    nothing = np.full((n, 2), -1)
    if n < 4:
        return nothing
    tree = cKDTree(xy_px)
    best = nothing
    tried = np.zeros(n, bool)
    for seed in np.argsort(np.linalg.norm(xy_px - np.median(xy_px, axis=0), axis=1)):
        if tried[seed]:
            continue
        steps = _steps(seed, xy_px, diameter_px, tree)
        if steps is None:
            continue
        place = _follow(seed, steps, xy_px, diameter_px, tree)
        inside = place[:, 0] > UNPLACED
        tried |= inside
        found = counted(place, inside, xy_px, columns, rows)
        if (found[:, 0] >= 0).sum() > max((best[:, 0] >= 0).sum(), 3):
            best = found
    return best


def counted(place: np.ndarray, inside: np.ndarray, xy_px: np.ndarray, columns: int = 0, rows: int = 0) -> np.ndarray:
    """Column and row (n, 2) as `order_grid` counts them of dots at `xy_px` (n, 2) whose places (n, 2) from one of them
    were followed where `inside` (n,); -1 for the others, and for all where they do not have the size asked for."""
    if columns and rows:
        inside = _window(place, inside, {(columns, rows), (rows, columns)})
    return _upright(place, inside, xy_px) if inside.any() else np.full((len(place), 2), -1)


def _steps(seed: int, xy: np.ndarray, size: np.ndarray, tree: cKDTree) -> np.ndarray | None:
    """(2, 2) steps in px from a dot to its two nearest neighbours that have a counterpart on the other side."""
    near = tree.query(xy[seed], k=min(NEIGHBOURS + 1, len(xy)))[1][1:]
    ratio = size[near] / size[seed]
    near = near[(ratio < SIZES) & (ratio > 1 / SIZES)]
    found: list[np.ndarray] = []
    for k in near:
        step = xy[k] - xy[seed]
        length = np.linalg.norm(step)
        if length < 1.15 * max(size[seed], size[k]) / 2 * 2:
            continue
        back = np.linalg.norm(xy[near] - (xy[seed] - step), axis=1)
        if len(back) == 0 or back.min() > MISS * length:
            continue
        step = (xy[k] - xy[near[np.argmin(back)]]) / 2
        if found and abs(found[0][0] * step[1] - found[0][1] * step[0]) < 0.25 * np.linalg.norm(found[0]) * length:
            continue
        found.append(step)
        if len(found) == 2:
            return np.array(found)
    return None


def _follow(seed: int, steps: np.ndarray, xy: np.ndarray, size: np.ndarray, tree: cKDTree) -> np.ndarray:
    """(n, 2) places in steps from the seed, `UNPLACED` for dots that were not reached."""
    place = np.full((len(xy), 2), UNPLACED)
    at = {(0, 0): int(seed)}
    local = {(0, 0): steps}
    place[seed] = 0
    queue = [(0, 0)]
    moves = [(1, 0), (-1, 0), (0, 1), (0, -1)]
    while queue:
        here = queue.pop(0)
        k, own = at[here], local[here]
        for move in moves:
            there = (here[0] + move[0], here[1] + move[1])
            if there in at:
                continue
            step = np.array(move) @ own
            distance, hit = tree.query(xy[k] + step)
            if distance > MISS * np.linalg.norm(own, axis=1).min() or place[hit, 0] != UNPLACED:
                continue
            if not 1 / SIZES < size[hit] / size[k] < SIZES:
                continue
            at[there] = int(hit)
            place[hit] = there
            # The next step follows what was found, along this axis; across it, what is known so far.
            axis = 0 if move[0] else 1
            new = own.copy()
            new[axis] = (xy[hit] - xy[k]) * (move[axis])
            local[there] = new
            queue.append(there)
    return place


def _window(place: np.ndarray, inside: np.ndarray, wanted: set[tuple[int, int]]) -> np.ndarray:
    """Which of the dots make up a complete grid of a wanted size: the places may reach beyond it by strays."""
    at = place[inside]
    low, high = at.min(axis=0), at.max(axis=0)
    full = np.zeros(high - low + 1, int)
    full[tuple((at - low).T)] = 1
    for columns, rows in sorted(wanted):
        if full.shape[0] < columns or full.shape[1] < rows:
            continue
        whole = np.lib.stride_tricks.sliding_window_view(full, (columns, rows)).sum(axis=(2, 3)) == columns * rows
        if whole.sum() > 1:  # a part of a larger grid, and nobody could say which
            return np.zeros(len(place), bool)
        if whole.any():
            first = np.argwhere(whole)[0] + low
            keep = (place >= first).all(axis=1) & (place < first + [columns, rows]).all(axis=1)
            return inside & keep
    # A glint or a finger on one dot leaves no doubt of the others, as long as the grid ends where it should.
    edges = (full[0], full[-1], full[:, 0], full[:, -1])
    if full.shape in wanted and full.mean() >= LEAST_FILLED and min(edge.mean() for edge in edges) >= LEAST_EDGE:
        return inside
    return np.zeros(len(place), bool)


def _upright(place: np.ndarray, inside: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Columns along the longer side, not mirrored, beginning near the top left."""
    at = place[inside] - place[inside].min(axis=0)
    if np.ptp(at[:, 1]) > np.ptp(at[:, 0]):
        at = at[:, ::-1]
    design = np.column_stack([at, np.ones(len(at))]).astype(float)
    steps = np.linalg.lstsq(design, xy[inside], rcond=None)[0][:2]
    if steps[0, 0] * steps[1, 1] - steps[0, 1] * steps[1, 0] < 0:
        at = at * [1, -1]
        at = at - at.min(axis=0)
    turned = at.max(axis=0) - at
    corner, other = (xy[inside][np.argmin(v.sum(axis=1))] for v in (at, turned))
    out = np.full((len(xy), 2), -1)
    out[inside] = at if corner.sum() <= other.sum() else turned
    return out
