"""Give every dot its name: the coded targets of a board say where its plain dots must be."""

import cv2
import numpy as np
from scipy.spatial import cKDTree

from testfield.targets.field import Field

LEAST_CODES = 2
CODE_TOLERANCE_PX = 6.0
ARM_MM = 20.0
TURN_TOLERANCE = 0.35
"""By how much of itself a code's own map to px may differ from its board's."""
WELL_KNOWN = 12
"""From this many marks on, their centres alone make the homography."""
DOT_TOLERANCE = 0.3
"""Fraction of the local spacing of dots by which a dot may miss its predicted place."""


def identify(
    xy_px: np.ndarray, code: np.ndarray, affine: np.ndarray, field: Field
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Board (n,) and point (n,) index of each detection of one image, -1 for none, and the reason (n,) where refused.

    `affine` (n, 2, 2) is each code's own map from its plane, in dot radii, to px: it lets two codes stand for a board
    of which little is seen.

    A code that contradicts its board's layout, or that is read twice, is refused. From the board's codes a homography
    predicts the dots; it is extended outwards from what is already identified, so the lens' distortion, unknown here,
    is followed and never extrapolated.
    """
    n = len(xy_px)
    board, point, reason = np.full(n, -1), np.full(n, -1), np.full(n, "", dtype=object)
    for number in np.unique(code[code > 0]):
        same = np.flatnonzero(code == number)
        if len(same) > 1:
            reason[same] = "code read twice in one image"
    listed = {int(c) for b in field.boards for c in b.marks.code[b.marks.code > 0]} | set(field.loose)
    unknown = (code > 0) & ~np.isin(code, list(listed))
    reason[unknown] = "code not in the field"

    for b, sheet in enumerate(field.boards):
        place = {int(c): k for k, c in enumerate(sheet.marks.code) if c > 0}
        mine = np.flatnonzero(np.isin(code, list(place)) & (reason == ""))
        if len(mine) < LEAST_CODES:
            continue
        index = np.array([place[int(c)] for c in code[mine]])
        spread = affine[mine] * (2 / sheet.marks.diameter_mm[index])[:, None, None]
        consistent, homography = _carry(sheet.marks.xy_mm[index], xy_px[mine], spread)
        reason[mine[~consistent]] = "code contradicts its board's layout"
        if homography is None:
            continue
        board[mine[consistent]], point[mine[consistent]] = b, index[consistent]
        free = np.flatnonzero((code == 0) & (board == -1))
        dots = np.flatnonzero(sheet.marks.code == 0)
        for detection, dot in _grow(
            sheet.marks.xy_mm, homography, index[consistent], xy_px[mine[consistent]], dots, xy_px, free
        ):
            board[detection], point[detection] = b, dot
    return board, point, reason


def _carry(layout: np.ndarray, image: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """(n,) which codes one homography carries, and that homography (None where there are too few of them).

    Each code counts with its centre and with two points beside it, where its own affine map (n, 2, 2) in px/mm puts
    them: that steadies the few codes of a board that is mostly out of sight, and shows a false turn.
    """
    arm = np.array([[0, 0], [ARM_MM, 0], [0, ARM_MM]])
    turned = np.isfinite(spread).all(axis=(1, 2))
    nothing = np.zeros(len(layout), bool)
    if len(layout) + 2 * turned.sum() < 4:
        return nothing, None
    source = np.concatenate([layout, (layout[turned][:, None] + arm[1:]).reshape(-1, 2)])
    target = np.concatenate(
        [image, (image[turned][:, None] + np.einsum("nij,kj->nki", spread[turned], arm[1:])).reshape(-1, 2)]
    )
    model, mask = cv2.findHomography(source, target, cv2.RANSAC, CODE_TOLERANCE_PX)
    keep = nothing if mask is None else mask.ravel()[: len(layout)].astype(bool)
    if keep.any():
        keep &= ~turned | _turn_agrees(model, layout, spread)
    # A homography that lost what it rests on says nothing of the others.
    return (keep, model) if keep.sum() >= max(LEAST_CODES, len(layout) / 2) else (nothing, None)


def _turn_agrees(homography: np.ndarray, layout: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(n,) whether a homography turns and stretches each code as it was seen turned and stretched: `spread` (n, 2, 2)
    px/mm. A wrong number has a turn of its own, wherever its centre happens to lie."""
    predicted = local_maps(homography, layout)
    with np.errstate(invalid="ignore"):
        size = np.linalg.norm(predicted, axis=(1, 2))
        return np.linalg.norm(predicted - spread, axis=(1, 2)) < TURN_TOLERANCE * size


def local_maps(homography: np.ndarray, layout: np.ndarray) -> np.ndarray:
    """(n, 2, 2) px/mm: the linear maps that are a homography's around places (n, 2)."""
    step = 0.5
    at = _apply(homography, layout)
    return np.stack([(_apply(homography, layout + step * e) - at) / step for e in np.eye(2)], axis=-1)


def _grow(
    layout: np.ndarray,
    homography: np.ndarray,
    known: np.ndarray,
    known_px: np.ndarray,
    dots: np.ndarray,
    xy_px: np.ndarray,
    free: np.ndarray,
) -> list[tuple[int, int]]:
    """Pairs (detection, dot): ring by ring outwards from the marks that are known."""
    pairs: list[tuple[int, int]] = []
    if len(free) == 0 or len(dots) == 0:
        return pairs
    found = cKDTree(xy_px[free])
    spacing = (
        np.median(cKDTree(layout[dots]).query(layout[dots], k=min(2, len(dots)))[0][:, -1]) if len(dots) > 1 else 1.0
    )
    left, taken = dots.copy(), np.zeros(len(free), bool)
    reach = 2.5 * spacing
    while len(left):
        if len(known) >= WELL_KNOWN:
            homography, _ = cv2.findHomography(layout[known], known_px)
            if homography is None:
                break
        residual = known_px - _apply(homography, layout[known])
        near, neighbours = cKDTree(layout[known]).query(layout[left], k=min(4, len(known)))
        # Across an empty strip of the board the nearest dots are the next step, however far they are.
        edge = near[:, 0] <= max(reach, 1.2 * near[:, 0].min())
        at = layout[left[edge]]
        predicted = _apply(homography, at) + residual[neighbours[edge]].mean(axis=1)
        # The local spacing in px: what one spacing on the board becomes here, in its shorter direction.
        steps = [
            np.linalg.norm(_apply(homography, at + s) - _apply(homography, at), axis=1)
            for s in ([spacing, 0], [0, spacing])
        ]
        tolerance = DOT_TOLERANCE * np.minimum(*steps)
        distance, hit = found.query(predicted)
        good = (distance < tolerance) & ~taken[hit]
        # Two dots never share a detection.
        order = np.argsort(distance)
        first = np.zeros(len(hit), bool)
        first[order[np.unique(hit[order], return_index=True)[1]]] = True
        good &= first
        new = left[edge][good]
        pairs += list(zip(free[hit[good]].tolist(), new.tolist(), strict=True))
        taken[hit[good]] = True
        known = np.concatenate([known, new])
        known_px = np.vstack([known_px, xy_px[free[hit[good]]]])
        # Dots on the edge that found nothing are absent here; growth goes on around them.
        left = left[~edge] if good.any() else left[:0]
    return pairs


def _apply(homography: np.ndarray, xy: np.ndarray) -> np.ndarray:
    mapped = np.column_stack([xy, np.ones(len(xy))]) @ homography.T
    return mapped[:, :2] / mapped[:, 2:]
