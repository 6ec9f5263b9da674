"""Dots without a code, named by their rays: which dot of one image is which of another.

Two dots near each other's epipolar lines give a place; where that place falls on a dot in further images, all of them
are one. Places that most images support come first, and no dot is given away twice. Two rays alone are believed only
where neither dot has another candidate and both show a disc of the usual size.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, cross_matrix
from testfield.camera.project import directions, project_camera
from testfield.camera.rays import meet_all

PARTNERS = 6
"""Other images with which each image's dots are paired."""
BEST_ANGLE = np.radians(30)
BEYOND = 0.6
"""By how much of its extent the space in which dots are looked for is larger than that of the coded points."""
LIKE = 0.06
"""Part by which the sizes of one disc in two images may differ."""
USUAL = 0.15
"""Part by which a disc of two rays may differ from the usual size."""


@dataclass(frozen=True)
class Dots:
    """Matched dots: `point_mm` (n, 3); `sight` (m,) rows of what was given, and the dot (m,) each is."""

    point_mm: np.ndarray
    sight: np.ndarray
    dot: np.ndarray


def match_dots(
    interiors: Sequence[Interior],
    poses: Poses,
    image: np.ndarray,
    xy_px: np.ndarray,
    size_px: np.ndarray,
    around_mm: np.ndarray,
    tolerance_px: float,
) -> Dots:
    """Match dots between images, by the cameras `interiors` of each of them from `poses`: `image` (m,) places among the
    `poses`, `xy_px` (m, 2), `size_px` (m,) longer half-axes of their images; they are looked for around the points
    (k, 3) that are known."""
    rows = [np.flatnonzero(image == i) for i in range(len(poses))]
    low, high = around_mm.min(axis=0), around_mm.max(axis=0)
    margin = BEYOND * (high - low).max()
    space = (low - margin, high + margin)
    places, support = [], []
    for i, j in _pairs(poses, around_mm.mean(axis=0)):
        a, b, xyz = _candidates(interiors, poses, i, j, xy_px[rows[i]], xy_px[rows[j]], tolerance_px, space)
        if not len(a):
            continue
        hit = np.full((len(a), len(poses)), -1)
        hit[:, i], hit[:, j] = rows[i][a], rows[j][b]
        places.append(xyz)
        support.append(hit)
    if not places:
        return Dots(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int))
    xyz, hit = np.concatenate(places), np.concatenate(support)
    two = hit.copy()
    for k in range(len(poses)):
        missing = hit[:, k] < 0
        if len(rows[k]) and missing.any():
            at = project_camera(interiors[k], poses[np.full(int(missing.sum()), k)].apply(xyz[missing]))
            distance, nearest = cKDTree(xy_px[rows[k]]).query(np.nan_to_num(at, nan=-1e9))
            hit[missing, k] = np.where(distance < 2 * tolerance_px, rows[k][np.minimum(nearest, len(rows[k]) - 1)], -1)
    taken = np.zeros(len(image), bool)
    chosen_xyz, chosen = _assigned(interiors, poses, hit[(hit >= 0).sum(axis=1) >= 3], xy_px, tolerance_px, taken)
    radius = _radius(interiors, poses, chosen_xyz, chosen, size_px)
    usual = float(np.median(radius)) if len(radius) else None
    pairs_xyz, pairs = _unambiguous(interiors, poses, xyz, two, size_px, taken, usual)
    point, table = np.concatenate([chosen_xyz, pairs_xyz]), np.concatenate([chosen, pairs])
    order = np.lexsort((point[:, 0].round(6), -point[:, 1].round(6)))
    point, table = point[order], table[order]
    dot, column = np.nonzero(table >= 0)
    return Dots(point, table[dot, column], dot)


def _pairs(poses: Poses, middle: np.ndarray) -> list[tuple[int, int]]:
    """Each image with those that see the field under the most useful angles."""
    toward = poses.origin_mm - middle
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    angle = np.arccos(np.clip(toward @ toward.T, -1, 1))
    worth = np.abs(np.log(np.maximum(angle, 1e-3) / BEST_ANGLE))
    np.fill_diagonal(worth, np.inf)
    pairs = set()
    for i in range(len(poses)):
        for j in np.argsort(worth[i], kind="stable")[: min(PARTNERS, len(poses) - 1)]:
            pairs.add((min(i, int(j)), max(i, int(j))))
    return sorted(pairs)


def _candidates(
    interiors: Sequence[Interior],
    poses: Poses,
    i: int,
    j: int,
    a_px: np.ndarray,
    b_px: np.ndarray,
    tolerance_px: float,
    space: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dots of two images near each other's epipolar lines and the places (c, 3) where their rays meet."""
    nothing = np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3))
    if not (len(a_px) and len(b_px)):
        return nothing
    a, b = (np.nan_to_num(directions(interiors[k], px), nan=1e6) for k, px in ((i, a_px), (j, b_px)))
    R = poses.R[j] @ poses.R[i].T
    t = poses.t_mm[j] - R @ poses.t_mm[i]
    line = a @ (cross_matrix(t) @ R).T
    distance = np.abs(line @ b.T) / np.linalg.norm(line[:, :2], axis=1)[:, None] * interiors[j].fx
    first, second = np.nonzero(distance < 2 * tolerance_px)
    if not len(first):
        return nothing
    xy = np.stack([a_px[first], b_px[second]], axis=1)
    station = np.tile([i, j], (len(first), 1))
    try:
        xyz = meet_all(interiors, station, poses, station, np.ones(station.shape, bool), xy)
    except np.linalg.LinAlgError:
        return nothing
    depth = np.stack([poses.R[k, 2] @ xyz.T + poses.t_mm[k, 2] for k in (i, j)])
    good = (depth > 0).all(axis=0) & ((xyz > space[0]) & (xyz < space[1])).all(axis=1)
    return first[good], second[good], xyz[good]


def _assigned(
    interiors: Sequence[Interior],
    poses: Poses,
    hit: np.ndarray,
    xy_px: np.ndarray,
    tolerance_px: float,
    taken: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Places with their dots (n, I), best supported first, every dot once; marks the dots as taken."""
    hit = np.unique(hit, axis=0)
    if not len(hit):
        return np.zeros((0, 3)), hit
    xyz, worst, rms = _met(interiors, poses, hit, xy_px)
    fine = np.flatnonzero(worst < tolerance_px)
    keep_xyz, keep = [], []
    for k in fine[np.lexsort((rms[fine], -(hit[fine] >= 0).sum(axis=1)))]:
        dots = hit[k][hit[k] >= 0]
        if not taken[dots].any():
            taken[dots] = True
            keep_xyz.append(xyz[k])
            keep.append(hit[k])
    return np.array(keep_xyz).reshape(-1, 3), np.array(keep, int).reshape(-1, hit.shape[1])


def _met(
    interiors: Sequence[Interior], poses: Poses, hit: np.ndarray, xy_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the rays of each row of dots meet, and the largest and mean residual in px."""
    there = hit >= 0
    station = np.tile(np.arange(hit.shape[1]), (len(hit), 1))
    xy = xy_px[np.maximum(hit, 0)]
    xyz = meet_all(interiors, station, poses, station, there, xy)
    size = np.zeros(hit.shape)
    for k in range(hit.shape[1]):
        at = project_camera(interiors[k], poses[np.full(len(xyz), k)].apply(xyz))
        size[:, k] = np.nan_to_num(np.linalg.norm(at - xy[:, k], axis=1), nan=1e9)
    size = np.where(there, size, 0)
    return xyz, size.max(axis=1), np.sqrt((size**2).sum(axis=1) / there.sum(axis=1))


def _radius(
    interiors: Sequence[Interior], poses: Poses, xyz: np.ndarray, hit: np.ndarray, size_px: np.ndarray
) -> np.ndarray:
    """(n,) median radius of the discs."""
    if not len(xyz):
        return np.zeros(0)
    return np.nanmedian(_radii(interiors, poses, xyz, hit, size_px), axis=1)


def _radii(
    interiors: Sequence[Interior], poses: Poses, xyz: np.ndarray, hit: np.ndarray, size_px: np.ndarray
) -> np.ndarray:
    """(n, I) radius of each disc as each image shows it, NaN where it does not."""
    depth = np.stack([xyz @ poses.R[k, 2] + poses.t_mm[k, 2] for k in range(len(poses))], axis=1)
    return np.where(hit >= 0, size_px[np.maximum(hit, 0)] * depth / np.array([one.fx for one in interiors]), np.nan)


def _unambiguous(
    interiors: Sequence[Interior],
    poses: Poses,
    xyz: np.ndarray,
    two: np.ndarray,
    size_px: np.ndarray,
    taken: np.ndarray,
    usual: float | None,
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of dots left over that have no other candidate at all."""
    free = ~np.where(two >= 0, taken[np.maximum(two, 0)], False).any(axis=1)
    xyz, two = xyz[free], two[free]
    times = np.bincount(two[two >= 0], minlength=len(taken))
    alone = (np.where(two >= 0, times[np.maximum(two, 0)], 1) == 1).all(axis=1)
    xyz, two = xyz[alone], two[alone]
    if not len(xyz):
        return xyz.reshape(-1, 3), two
    radii = _radii(interiors, poses, xyz, two, size_px)
    middle = np.nanmedian(radii, axis=1)
    like = np.nanmax(np.abs(radii / middle[:, None] - 1), axis=1) < LIKE
    if usual is not None:
        like &= np.abs(middle / usual - 1) < USUAL
    return xyz[like], two[like]
