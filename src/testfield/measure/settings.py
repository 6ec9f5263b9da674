"""Whether boards were moved between photographs: which images show one arrangement, which codes move together.

Images of one arrangement agree pairwise with one epipolar geometry, which needs no camera. The largest such set is
calibrated by itself; every other image is then resected from its points again and again, each time from those that no
earlier resection explains, so that each set of points found is a rigid body.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.sparse.csgraph import connected_components

from testfield.calibrate.self_calibration import free_network
from testfield.calibrate.self_job import FreeNetwork
from testfield.calibrate.ties import Ties
from testfield.camera.project import directions
from testfield.errors import TestfieldError

LEAST_PAIR = 10
"""Common codes of two images from which it can be said whether something moved in between."""
EPIPOLAR_PART = 0.002
"""Distance from the epipolar line, in the image's width, that an unknown lens explains; but 2 px at least."""
LEAST_BODY = 5
"""Codes in an image that make a rigid body: four that agree with a resection by three, and one more."""
BODY_PX = 2.0
"""Distance in the image within which a code is where its body says."""
MORE = "take three or more of each arrangement before a board is moved"
MISREAD = 0.05
"""Part of what contradicts that misread numbers explain."""


@dataclass(frozen=True)
class Arranged:
    """`setting` (I,) of each image, 0 the one with the most sights, -1 where nothing tells; `body` of each code, 0 the
    one that stands still for all others; `guessed` codes that only one arrangement shows, whose body is that of their
    neighbours. All one where nothing was moved."""

    setting: np.ndarray
    body: dict[int, int]
    guessed: tuple[int, ...] = ()

    @property
    def moving(self) -> tuple[int, ...]:
        """Codes that lie elsewhere in another setting."""
        return tuple(code for code, body in self.body.items() if body > 0) if self.moved else ()

    @property
    def moved(self) -> bool:
        """Whether anything was."""
        return len(set(self.body.values())) > 1


def arranged(
    ties: Ties, size_px: tuple[int, int], lens: str, hold: tuple[str, ...] = (), focal_px: float | None = None
) -> Arranged:
    """Settings and bodies of the sights of codes by one camera.

    Raises `TestfieldError` where no two images show the same arrangement, or the largest set cannot be calibrated.
    """
    still = Arranged(np.zeros(len(ties.stations), int), dict.fromkeys(ties.code.tolist(), 0))
    setting = _settings(ties, max(2.0, EPIPOLAR_PART * size_px[0]))
    if setting.max(initial=0) == 0:
        return still
    images, sights = np.bincount(setting[setting >= 0]), np.bincount(setting[ties.image] + 1)[1:]
    order = np.lexsort((-sights, -images))
    setting = np.where(setting >= 0, np.argsort(order)[np.maximum(setting, 0)], -1)
    try:
        if images.max() < 2:
            raise TestfieldError("no two photographs show the boards in one arrangement", "photographs", MORE)
        network = free_network(_of_images(ties, setting == 0), *size_px, lens, hold, None, focal_px, True)
    except TestfieldError:
        # A lens that bends much may look like motion, and too few images are left.
        if _one_world(ties, size_px, lens, hold, focal_px):
            return still
        raise
    body, guessed = _bodies(ties, np.flatnonzero(setting != 0), network)
    return Arranged(setting, body, guessed)


def _one_world(ties: Ties, size_px: tuple[int, int], lens: str, hold: tuple[str, ...], focal_px: float | None) -> bool:
    """Whether all images agree with one rigid world, once a lens is fitted."""
    try:
        network = free_network(ties, *size_px, lens, hold, None, focal_px, True)
    except TestfieldError:
        return False
    used = network.calibration.used
    return len(network.calibration.station_names) == len(ties.stations) and used >= (1 - MISREAD) * len(ties)


def _of_images(ties: Ties, chosen: np.ndarray) -> Ties:
    """The sights in some images, of these images and of the points in them alone."""
    some = ties.take(chosen[ties.image])
    points, point = np.unique(some.point, return_inverse=True)
    stations = tuple(name for name, c in zip(ties.stations, chosen, strict=True) if c)
    number = np.cumsum(chosen) - 1
    return replace(some, stations=stations, code=ties.code[points], image=number[some.image], point=point)


def _settings(ties: Ties, tolerance_px: float) -> np.ndarray:
    """(I,) images by arrangement: each joins the one that most of its images agree with and none contradicts."""
    count = len(ties.stations)
    xy = np.full((count, len(ties.code), 2), np.nan)
    xy[ties.image, ties.point] = ties.xy_px
    agree = np.zeros((count, count), int)
    for i in range(count):
        for j in range(i):
            common = np.isfinite(xy[i, :, 0]) & np.isfinite(xy[j, :, 0])
            if common.sum() >= LEAST_PAIR:
                agree[i, j] = agree[j, i] = 1 if _rigid(xy[i, common], xy[j, common], tolerance_px) else -1
    setting = np.full(count, -1)
    for i in np.argsort(-(agree != 0).sum(axis=1), kind="stable"):
        votes = {s: agree[i, setting == s] for s in range(setting.max(initial=-1) + 1)}
        fit = {s: int(v.sum()) for s, v in votes.items() if (v > 0).any() and not (v < 0).any()}
        if fit:
            setting[i] = max(fit, key=lambda s: fit[s])
        elif (agree[i] != 0).any():
            setting[i] = setting.max(initial=-1) + 1
    return setting


def _rigid(a: np.ndarray, b: np.ndarray, tolerance_px: float) -> bool:
    """Whether two images (n, 2) of points may be of one rigid arrangement: all but misread ones lie on epipolar lines
    of one geometry, or are images of one plane."""
    allowed = max(1, int(MISREAD * len(a)))
    cv2.setRNGSeed(0)
    H, mask = cv2.findHomography(a, b, cv2.RANSAC, tolerance_px, maxIters=2000)
    if H is not None and (mask == 0).sum() <= allowed:
        return True
    cv2.setRNGSeed(0)
    F, mask = cv2.findFundamentalMat(a, b, cv2.FM_RANSAC, tolerance_px, 0.999, 5000)
    return F is not None and int((mask == 0).sum()) <= allowed


def _bodies(ties: Ties, images: np.ndarray, network: FreeNetwork) -> tuple[dict[int, int], tuple[int, ...]]:
    """The rigid body of each code, and the codes of which nothing tells it. Codes that images of other arrangements
    show together belong together, unless others show them apart; one that no such image shows stands with its nearest
    neighbour."""
    place = {int(code): k for k, code in enumerate(network.code)}
    n = len(network.code)
    same, other = np.zeros((n, n), int), np.zeros((n, n), int)
    interior = network.calibration.interior
    for i in images:
        rows = np.flatnonzero((ties.image == i) & np.isin(ties.code[ties.point], network.code))
        known = np.array([place[int(c)] for c in ties.code[ties.point[rows]]], int)
        body = _in_image(network.xyz_mm[known], directions(interior, ties.xy_px[rows]), interior.fx)
        for b in range(body.max(initial=-1) + 1):
            mine, others = known[body == b], known[(body >= 0) & (body != b)]
            same[np.ix_(mine, mine)] += 1
            other[np.ix_(mine, others)] += 1
    joined = (same > 0) & (other <= MISREAD * (same + other))
    _, group = connected_components(joined, directed=False)
    size = np.bincount(group)
    sure = size[group] >= LEAST_BODY
    if not sure.any():
        return dict.fromkeys(ties.code.tolist(), 0), ()
    away = np.linalg.norm(network.xyz_mm[:, None] - network.xyz_mm[None, sure], axis=2)
    group = group[sure][away.argmin(axis=1)]
    sights = np.bincount(group, weights=np.bincount(ties.point, minlength=len(ties.code))[_rows(ties, network.code)])
    rank = {int(g): k for k, g in enumerate(np.argsort(-sights)) if sights[g] > 0}
    of_code = {int(code): rank[int(g)] for code, g in zip(network.code, group, strict=True)}
    more = _near_in_images(ties, of_code)
    return of_code | more, (*network.code[~sure].tolist(), *more)


def _near_in_images(ties: Ties, body: dict[int, int]) -> dict[int, int]:
    """Bodies of codes that the first arrangement did not show: those of the codes nearest to them in the images."""
    answer = {}
    code = ties.code[ties.point]
    for new in (int(c) for c in ties.code if int(c) not in body):
        votes: list[int] = []
        for k in np.flatnonzero(code == new):
            there = np.flatnonzero((ties.image == ties.image[k]) & np.isin(code, list(body)))
            near = there[np.argsort(np.linalg.norm(ties.xy_px[there] - ties.xy_px[k], axis=1))[:3]]
            votes += [body[int(code[r])] for r in near]
        answer[new] = max(set(votes), key=votes.count) if votes else 0
    return answer


def _rows(ties: Ties, codes: np.ndarray) -> np.ndarray:
    place = {int(code): k for k, code in enumerate(ties.code)}
    return np.array([place[int(code)] for code in codes], int)


def _in_image(xyz: np.ndarray, rays: np.ndarray, focal_px: float) -> np.ndarray:
    """(n,) which rigid body of one image each known point belongs to, -1 for none."""
    body = np.full(len(xyz), -1)
    good = np.isfinite(rays).all(axis=1) & (rays[:, 2] > 0)
    flat = rays[:, :2] / np.where(good, rays[:, 2], 1)[:, None]
    left = np.flatnonzero(good)
    poses: list[tuple[np.ndarray, np.ndarray]] = []
    while len(left) >= LEAST_BODY:
        cv2.setRNGSeed(0)
        found, turn, t, inliers = cv2.solvePnPRansac(
            xyz[left],
            flat[left],
            np.eye(3),
            None,
            iterationsCount=1000,
            reprojectionError=BODY_PX / focal_px,
            confidence=0.9999,
            flags=cv2.SOLVEPNP_SQPNP,
        )
        if not found or inliers is None or len(inliers) < LEAST_BODY:
            break
        mine = left[inliers[:, 0]]
        turn, t = cv2.solvePnPRefineLM(xyz[mine], flat[mine], np.eye(3), None, turn, t)
        poses.append((turn, t))
        left = np.setdiff1d(left, mine)
    if not poses:
        return body
    off = np.stack([np.linalg.norm(_projected(xyz, *pose) - flat, axis=1) for pose in poses]) * focal_px
    near = off.argmin(axis=0)
    return np.where(good & (off.min(axis=0) < BODY_PX), near, -1)


def _projected(xyz: np.ndarray, turn: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.projectPoints(xyz, turn, t, np.eye(3), None)[0][:, 0])
