"""Starting values out of nothing: cameras and points from numbered targets alone.

For each of several focal lengths two images are oriented to each other (five points; for a plane also its homography),
all other images are resected, all points met anew. What images best is adjusted with focal length and first radial term
free, and the best of these is the start. No approximate value of anything is needed; a focal length helps.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Camera
from testfield.calibrate.loose_network import loose_network
from testfield.calibrate.ties import LEAST_COMMON, Ties
from testfield.camera.interior import Interior
from testfield.camera.lens import lens_model
from testfield.camera.pose import Poses
from testfield.camera.project import plane_of, project_camera
from testfield.camera.rays import meet_all
from testfield.errors import TestfieldError

FOCAL_OVER_WIDTH = np.geomspace(0.45, 5, 9)
PAIRS, PAIRS_TRIED = 3, 60
BASE = 1000.0
"""Length of the first base: the scale is not known yet."""
CAP = 0.01
"""A residual beyond this part of the image's width is as bad as any other, or as no ray at all."""
ADJUSTED = 5
"""Trials that are adjusted."""
PASSES = 5
SQUARE = 1e-4
"""Standard deviation of fy / fx where pixels are taken to be square. A stiffer tie would hold the focal length, too,
while steps are damped."""


@dataclass(frozen=True)
class Start:
    """A camera, poses (I) of images and points (n, 3) in a scale of their own; which of them are known at all."""

    interior: Interior
    poses: Poses
    reached: np.ndarray
    point_mm: np.ndarray
    known: np.ndarray


@dataclass(frozen=True)
class _Views:
    """Sights as tables: `there` (I, n), `xy_px` (I, n, 2)."""

    there: np.ndarray
    xy_px: np.ndarray

    @staticmethod
    def of(ties: Ties) -> "_Views":
        there = ties.seen()
        xy = np.zeros((*there.shape, 2))
        xy[ties.image, ties.point] = ties.xy_px
        return _Views(there, xy)


def start_from_nothing(ties: Ties, width_px: int, height_px: int, lens: str, focal_px: float | None) -> Start:
    """Starting values of images that belong together (`ties.largest_group`).

    Raises `TestfieldError` where no two images can be oriented to each other.
    """
    views = _Views.of(ties)
    middle = [(width_px - 1) / 2, (height_px - 1) / 2]
    focals = [focal_px] if focal_px else list(FOCAL_OVER_WIDTH * width_px)
    pinhole = lens_model(lens).pinhole
    shapes = [np.zeros(len(pinhole)), *([pinhole] if pinhole.any() else [])]
    cameras = [
        Interior(width_px, height_px, np.array([f, f, *middle, *shape]), lens) for shape in shapes for f in focals
    ]
    pairs = _best_pairs(cameras[len(focals) // 2], views)
    if not pairs:
        raise TestfieldError(
            f"no two images have {LEAST_COMMON} coded targets in common",
            "observations",
            "take more images of the same targets",
        )
    trials = []
    for interior in cameras:
        for first, second in pairs:
            for pose in _orientations(interior, views, first, second):
                trial = _grown(interior, views, first, second, pose)
                if trial is not None:
                    trials.append((_misfit(trial, views), trial))
    if not trials:
        raise TestfieldError(
            "no two images can be oriented to each other by their common targets",
            "observations",
            "take images from clearly different places",
        )
    trials.sort(key=lambda item: item[0])
    best: tuple[float, Start] | None = None
    for misfit, trial in trials[:ADJUSTED]:
        if misfit > 3 * trials[0][0] + 1e-3:
            break
        found = _adjusted(trial, ties)
        if found is not None:
            # The better lens reaches images and points that the first one could not.
            found = _extended(found, views)
            score = _misfit(found, views)
            if best is not None and abs(score - best[0]) < 0.01 * best[0]:
                break  # two starts that end in the same place
            if best is None or score < best[0]:
                best = (score, found)
    return best[1] if best else trials[0][1]


def _directions(interior: Interior, views: _Views) -> np.ndarray:
    """(I, n, 2) places on the plane before the lens, NaN where the lens does not reach."""
    return plane_of(interior, views.xy_px)


def _best_pairs(interior: Interior, views: _Views) -> list[tuple[int, int]]:
    """Pairs of images with many common targets under large angles."""
    plane = _directions(interior, views)
    common = views.there.astype(int) @ views.there.T.astype(int)
    first, second = np.nonzero(np.triu(common >= LEAST_COMMON, 1))
    order = np.argsort(-common[first, second], kind="stable")[:PAIRS_TRIED]
    scored = []
    for i, j in zip(first[order], second[order], strict=True):
        both = views.there[i] & views.there[j]
        angle = 0.0
        for R, t in _orientations(interior, views, int(i), int(j)):
            a, b = (np.column_stack([plane[k][both], np.ones(both.sum())]) for k in (i, j))
            x = _two_rays(a[:, :2], b[:, :2], R, t)
            b_in_a = -R.T @ t
            u, v = x / np.linalg.norm(x, axis=1, keepdims=True), (x - b_in_a)
            v /= np.linalg.norm(v, axis=1, keepdims=True)
            angle = max(angle, float(np.median(np.arccos(np.clip((u * v).sum(axis=1), -1, 1)))))
        scored.append((np.sqrt(both.sum()) * np.sin(min(angle, np.radians(50))), int(i), int(j)))
    scored.sort(key=lambda item: -item[0])
    return [(i, j) for _, i, j in scored[:PAIRS]]


def _orientations(interior: Interior, views: _Views, first: int, second: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses second-from-first with a base of one that see most points in front of both cameras."""
    both = views.there[first] & views.there[second]
    plane = _directions(interior, _Views(views.there[[first, second]], views.xy_px[[first, second]]))[:, both]
    good = np.isfinite(plane).all(axis=(0, 2))
    a, b = plane[0][good], plane[1][good]
    if len(a) < LEAST_COMMON:
        return []
    tolerance = 0.5 * CAP * interior.width_px / interior.fx
    answers = []
    try:
        E, inside = cv2.findEssentialMat(a, b, np.eye(3), cv2.RANSAC, 0.999, tolerance)
    except cv2.error:
        E, inside = None, None
    if E is not None and inside is not None and E.shape[0] >= 3:
        for part in E.reshape(-1, 3, 3)[:4]:
            _, R, t, _ = cv2.recoverPose(part, a, b, np.eye(3), mask=inside.copy())
            answers.append((R, t[:, 0]))
    H, flat = cv2.findHomography(a, b, cv2.RANSAC, 2 * tolerance, maxIters=60)
    if H is not None and flat.mean() > 0.7:
        _, turns, shifts, _ = cv2.decomposeHomographyMat(H, np.eye(3))
        for R, t in zip(turns, shifts, strict=True):
            length = np.linalg.norm(t)
            if length > 1e-3:
                answers.append((R, t[:, 0] / length))
    kept = []
    for R, t in answers:
        x = _two_rays(a, b, R, t)
        front = (x[:, 2] > 0) & ((x @ R.T + t)[:, 2] > 0)
        if front.mean() > 0.8:
            kept.append((R, t))
    return kept


def _two_rays(a: np.ndarray, b: np.ndarray, R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Points (n, 3) in the first camera's frame."""
    left = np.hstack([np.eye(3), np.zeros((3, 1))])
    x = cv2.triangulatePoints(left, np.column_stack([R, t]), a.T.copy(), b.T.copy())
    with np.errstate(all="ignore"):
        return np.nan_to_num((x[:3] / x[3]).T, posinf=1e6, neginf=-1e6)


def _grown(
    interior: Interior, views: _Views, first: int, second: int, pose: tuple[np.ndarray, np.ndarray]
) -> Start | None:
    n = len(views.there)
    poses, reached = Poses.identity(n), np.zeros(n, bool)
    poses.R[second], poses.t_mm[second] = pose[0], BASE * pose[1]
    reached[[first, second]] = True
    start = Start(interior, poses, reached, np.zeros((views.there.shape[1], 3)), np.zeros(views.there.shape[1], bool))
    start = _extended(start, views)
    return start if start.known.sum() >= LEAST_COMMON else None


def _extended(start: Start, views: _Views) -> Start:
    """Points met by the images that are reached, images resected by those points, in turn."""
    poses, reached = Poses(start.poses.R.copy(), start.poses.t_mm.copy()), start.reached.copy()
    plane = _directions(start.interior, views)
    points, known = start.point_mm, start.known
    for step in range(PASSES):
        points, known = _met(start.interior, views, poses, reached)
        before = reached.copy()
        for i in range(len(reached)):
            common = views.there[i] & known & np.isfinite(plane[i]).all(axis=1)
            found = _resected(plane[i][common], points[common], CAP * start.interior.width_px / start.interior.fx)
            if found is not None:
                poses.R[i], poses.t_mm[i], reached[i] = *found, True
        if step >= 1 and (reached == before).all():
            break
    points, known = _met(start.interior, views, poses, reached)
    return replace(start, poses=poses, reached=reached, point_mm=points, known=known)


def _met(interior: Interior, views: _Views, poses: Poses, reached: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) and which of them two reached images or more see in front of them."""
    there = (views.there & reached[:, None]).T
    known = there.sum(axis=1) >= 2
    points = np.zeros((len(known), 3))
    k, stations = int(known.sum()), np.arange(len(reached))
    if k == 0:
        return points, known
    try:
        station = np.tile(stations, (k, 1))
        points[known] = meet_all(
            [interior], np.zeros_like(station), poses, station, there[known], np.swapaxes(views.xy_px, 0, 1)[known]
        )
    except np.linalg.LinAlgError:  # rays that are parallel, or a pixel that the lens does not reach
        return points, np.zeros_like(known)
    depth = np.einsum("ij,nj->ni", poses.R[:, 2], points) + poses.t_mm[:, 2]
    known &= (depth > 0).all(axis=1, where=there) & np.isfinite(points).all(axis=1)
    return points, known


def _resected(plane: np.ndarray, points: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Camera-from-datum rotation and translation that see points (n, 3) at `plane` (n, 2), misread ones left out."""
    if len(points) < LEAST_COMMON:
        return None
    try:
        good, _, _, inside = cv2.solvePnPRansac(
            points, plane, np.eye(3), None, flags=cv2.SOLVEPNP_AP3P, reprojectionError=2 * tolerance, iterationsCount=80
        )
        if not good or inside is None or len(inside) < LEAST_COMMON:
            return None
        x, at = points[inside[:, 0]], plane[inside[:, 0]]
        good, turn, shift = cv2.solvePnP(x, at, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        if not good:
            return None
        turn, shift = cv2.solvePnPRefineLM(x, at, np.eye(3), None, turn, shift)
    except cv2.error:
        return None
    R = cv2.Rodrigues(turn)[0]
    return (R, shift[:, 0]) if np.isfinite(R).all() and np.isfinite(shift).all() else None


def _misfit(start: Start, views: _Views) -> float:
    """Mean size of the residuals in px, none of them counted as more than the cap; what has no ray counts as that."""
    cap = CAP * start.interior.width_px
    i, p = np.nonzero(views.there & start.reached[:, None] & start.known)
    with np.errstate(all="ignore"):
        at = project_camera(start.interior, start.poses[i].apply(start.point_mm[p]))
    size = np.nan_to_num(np.linalg.norm(at - views.xy_px[i, p], axis=1), nan=cap)
    counted = (views.there & (views.there.sum(axis=0) >= 2)).sum()
    return float((np.minimum(size, cap).sum() + cap * (counted - len(size))) / max(counted, 1))


def _adjusted(start: Start, ties: Ties) -> Start | None:
    """After a first adjustment: square pixels, one radial term, weights that forgive."""
    use = start.reached[ties.image] & start.known[ties.point]
    some = ties.take(use)
    some = replace(some, cov_px2=np.broadcast_to(np.eye(2), some.cov_px2.shape).copy())
    stations = np.flatnonzero(start.reached)
    number = np.full(len(start.reached), -1)
    number[stations] = np.arange(len(stations))
    # Priors so wide that they tell nothing, but keep what is not determined where it is.
    interior = start.interior
    u = np.zeros(len(interior.parameters))
    u[:2], u[4] = interior.fx, 0.5
    camera = Camera(interior, u, interior.parameters, u_aspect=SQUARE)
    network = loose_network(
        replace(some, image=number[some.image]),
        (camera,),
        np.zeros(len(stations), int),
        start.poses[stations],
        start.point_mm,
    )
    try:
        found: Adjustment = adjust(network, network.labels(tuple(map(str, stations))), robust=True)
    except (TestfieldError, np.linalg.LinAlgError):
        return None
    focal = found.network.interior.fx
    if not (found.converged and 0.1 < focal / interior.width_px < 50):
        return None
    poses = Poses(start.poses.R.copy(), start.poses.t_mm.copy())
    poses.R[stations], poses.t_mm[stations] = found.network.stations.R, found.network.stations.t_mm
    return replace(start, interior=found.network.interior, poses=poses, point_mm=found.network.point_mm)
