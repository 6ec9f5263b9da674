"""Give every dot its name: the coded targets of a board say where its plain dots must be."""

import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.plane_image import NEIGHBOURS, PlaneImage, View, carried, fit_plane, fitted_to, rough_lens
from testfield.camera.rough_lens import RoughLens
from testfield.targets.field import Field

LEAST_CODES = 2
ARM = 3.0
"""Length of the arms by which a code's own map counts, in radii of its dot: the edge of its ring."""
TURN_TOLERANCE = 0.35
"""By how much of itself a code's own map to px may differ from its board's."""
WELL_KNOWN = 12
"""From this many marks on, their centres alone make the homography."""
FAR_PX = 1e9
DOT_TOLERANCE = 0.3
"""Fraction of the local spacing of dots by which a dot may miss its predicted place."""


def identify(
    xy_px: np.ndarray, code: np.ndarray, affine: np.ndarray, field: Field, middle_px: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Board (n,) and point (n,) index of each detection of one image, -1 for none, and the reason (n,) where refused.

    `affine` (n, 2, 2) is each code's own map from its plane, in dot radii, to px: it lets two codes stand for a board
    of which little is seen. `middle_px` (2,) is the image's middle, about which a lens distorts; without it that of
    what was detected.

    A code that contradicts its board's layout, or that is read twice, is refused. From the board's codes its image
    (`camera/plane_image.py`) predicts the dots; it is extended outwards from what is already identified, so what the
    lens does beyond a few radial terms is followed and never extrapolated.
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

    seen: list[tuple[int, np.ndarray, np.ndarray, np.ndarray]] = []
    for b, sheet in enumerate(field.boards):
        place = {int(c): k for k, c in enumerate(sheet.marks.code) if c > 0}
        mine = np.flatnonzero(np.isin(code, list(place)) & (reason == ""))
        if len(mine) < LEAST_CODES:
            continue
        index = np.array([place[int(c)] for c in code[mine]])
        spread = affine[mine] * (2 / sheet.marks.diameter_mm[index])[:, None, None]
        seen.append((b, mine, index, spread))
    arms = [ARM / 2 * field.boards[b].marks.diameter_mm[index] for b, _, index, _ in seen]
    views = [
        _with_arms(field.boards[b].marks.xy_mm[index], xy_px[mine], spread, arm)
        for (b, mine, index, spread), arm in zip(seen, arms, strict=True)
    ]
    for (b, mine, index, spread), view, lens in zip(seen, views, _lenses(views, xy_px, middle_px), strict=True):
        sheet = field.boards[b]
        consistent, image = _carry(sheet.marks.xy_mm[index], spread, view, lens)
        reason[mine[~consistent]] = "code contradicts its board's layout"
        if image is None:
            continue
        board[mine[consistent]], point[mine[consistent]] = b, index[consistent]
        free = np.flatnonzero((code == 0) & (board == -1))
        dots = np.flatnonzero(sheet.marks.code == 0)
        for detection, dot in _grow(
            sheet.marks.xy_mm, image, index[consistent], xy_px[mine[consistent]], dots, xy_px, free
        ):
            board[detection], point[detection] = b, dot
    return board, point, reason


def _with_arms(layout: np.ndarray, image: np.ndarray, spread: np.ndarray, arm_mm: np.ndarray) -> View:
    """Codes' centres, then two points beside each, where its own affine map (n, 2, 2) in px/mm puts them: that steadies
    the few codes of a board that is mostly out of sight, and shows a false turn."""
    turned = np.isfinite(spread).all(axis=(1, 2))
    arm = arm_mm[turned, None, None] * np.eye(2)
    beside = image[turned][:, None] + np.einsum("nij,nkj->nki", spread[turned], arm)
    return (
        np.concatenate([layout, (layout[turned][:, None] + arm).reshape(-1, 2)]),
        np.concatenate([image, beside.reshape(-1, 2)]),
    )


def _lenses(views: list[View], xy_px: np.ndarray, middle_px: np.ndarray | None) -> list[RoughLens]:
    """For each board the lens to see it with: a pinhole where that explains all of its codes, else the image's own."""
    if not views:
        return []
    if middle_px is None:
        middle_px = (np.nanmin(xy_px, axis=0) + np.nanmax(xy_px, axis=0)) / 2
    pinhole = RoughLens.pinhole(middle_px, float(np.nanmax(np.linalg.norm(xy_px - middle_px, axis=1))))
    straight = [bool(len(view[0]) < 4 or fit_plane(view, pinhole)[1].all()) for view in views]
    lens = pinhole if all(straight) else rough_lens([view for view in views if len(view[0]) >= 4], middle_px)
    return [pinhole if alone else lens for alone in straight]


def _carry(layout: np.ndarray, spread: np.ndarray, view: View, lens: RoughLens) -> tuple[np.ndarray, PlaneImage | None]:
    """(n,) which codes one image of their board carries, and that image (None where there are too few of them)."""
    turned = np.isfinite(spread).all(axis=(1, 2))
    nothing = np.zeros(len(layout), bool)
    model, good = fit_plane(view, lens)
    if model is None:
        return nothing, None
    keep = good[: len(layout)].copy()
    keep &= ~turned | _turn_agrees(model, layout, spread)
    # A model that lost what it rests on says nothing of the others.
    return (keep, model) if keep.sum() >= max(LEAST_CODES, len(layout) / 2) else (nothing, None)


def _turn_agrees(image: PlaneImage, layout: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """(n,) whether the image of a board turns and stretches each code as it was seen turned and stretched: `spread`
    (n, 2, 2) px/mm. A wrong number has a turn of its own, wherever its centre happens to lie."""
    predicted = image.maps(layout)
    with np.errstate(invalid="ignore"):
        size = np.linalg.norm(predicted, axis=(1, 2))
        return np.asarray(np.linalg.norm(predicted - spread, axis=(1, 2)) < TURN_TOLERANCE * size)


def _grow(
    layout: np.ndarray,
    image: PlaneImage,
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
            fitted = fitted_to((layout[known], known_px), image.lens)
            if fitted is None:
                break
            image = fitted
        residual = known_px - image.at(layout[known])
        near, neighbours = cKDTree(layout[known]).query(layout[left], k=min(NEIGHBOURS, len(known)))
        # Across an empty strip of the board the nearest dots are the next step, however far they are.
        edge = near[:, 0] <= max(reach, 1.2 * near[:, 0].min())
        at = layout[left[edge]]
        around = zip(at, neighbours[edge], strict=True)
        predicted = image.at(at) + [carried(layout[known[k]] - place, residual[k]) for place, k in around]
        # The local spacing in px: what one spacing on the board becomes here, in its shorter direction.
        steps = [np.linalg.norm(image.at(at + s) - image.at(at), axis=1) for s in ([spacing, 0], [0, spacing])]
        tolerance = DOT_TOLERANCE * np.minimum(*steps)
        # What no pixel shows is far from everything.
        distance, hit = found.query(np.nan_to_num(predicted, nan=FAR_PX))
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
