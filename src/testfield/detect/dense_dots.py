"""Dots so near to each other that nothing around one of them is empty: all are fitted together, then each is looked at
alone.

Every dot is fitted by the forward model in the image less the light of all others, again and again until nothing moves.
Then the dots are shared out among a few images, in each of which those of the others are taken away, so that whatever
asks what a dot looks like and what surrounds it needs to know nothing of neighbours.
"""

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.images import SensorSheet
from testfield.detect.centre_forward import dot_outline, refine, start
from testfield.detect.disc import disc_in_pixels
from testfield.detect.find import Blobs
from testfield.detect.forward_windows import BLUR, CONTRAST, Batch, reach, window_batches
from testfield.detect.joined import put_beside, take
from testfield.detect.observations import MEASURED, diameters
from testfield.detect.targets import Targets

NEAR, ALIKE = 1.6, 1.4
"""Blobs crowd each other where their distance is less than the first times the mean of their diameters, and these
differ by less than the second."""
LEAST_NEIGHBOURS, FEWEST = 2, 9
"""A blob belongs to a crowd that has so many beside it; so many make a crowd."""
LOST = 0.05
"""Part of a crowd that must be without a measurement for all of it to be measured together."""
ROUNDS, STILL_PX = 12, 0.003
APART = 3.3
"""Distance, in the larger one's radii, from which on two dots leave each other enough empty ground."""
SAME = 0.35


def measure_dense(
    image_dn: np.ndarray,
    sheet: SensorSheet,
    targets: Targets,
    again: Callable[[np.ndarray, tuple[np.ndarray, np.ndarray]], Targets],
) -> Targets:
    """The `targets` of an image (h, w) of bright marks, those in crowds measured together.

    `again(image, (xy, moments))` measures dots at rough places (n, 2) of rough moments (n, 2, 2) in an image in which
    they stand alone.
    """
    blobs = targets.blobs
    if blobs is None or len(blobs) < FEWEST:
        return targets
    crowd = crowded(blobs)
    good = targets.status == MEASURED
    if len(crowd) < FEWEST or _lost(blobs, crowd, targets.xy_px[good]) < LOST * len(crowd):
        return targets
    theta, fitted = fit_together(image_dn, sheet, blobs.xy_px[crowd], blobs.moments_px2[crowd])
    theta = theta[fitted]
    if not len(theta):
        return targets
    colour = colours(theta)
    whole = light_of(theta, image_dn.shape)
    parts = []
    for c in range(int(colour.max()) + 1):
        mine = theta[colour == c]
        alone = (image_dn - whole + light_of(mine, image_dn.shape)).astype(np.float32)
        found = again(alone, (mine[:, :2], moments_of(mine)))
        parts.append(take(found, found.status == MEASURED))
    for part in parts:
        targets = put_beside(targets, part, SAME)
    return targets


def crowded(blobs: Blobs) -> np.ndarray:
    """Rows of the blobs that have others like them close by."""
    size = diameters(blobs.moments_px2)
    pairs = cKDTree(blobs.xy_px).query_pairs(NEAR * float(size.max(initial=0)), output_type="ndarray")
    if not len(pairs):
        return np.zeros(0, int)
    a, b = pairs.T
    distance = np.linalg.norm(blobs.xy_px[a] - blobs.xy_px[b], axis=1)
    near = distance < NEAR * (size[a] + size[b]) / 2
    near &= np.maximum(size[a], size[b]) < ALIKE * np.minimum(size[a], size[b])
    beside = np.bincount(np.concatenate([a[near], b[near]]), minlength=len(size))
    return np.flatnonzero((beside >= LEAST_NEIGHBOURS) & ~blobs.cut)


def fit_together(
    image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Parameters (n, 12) of dots at rough places, each fitted in the image less the light of all others, and which of
    them were (n,); centres in px."""
    theta = start(xy_px, moments_px2)
    theta[:, CONTRAST] = _first_contrast(image_dn, xy_px, moments_px2)
    fitted = theta[:, CONTRAST] > 0
    for _ in range(ROUNDS):
        rest = image_dn - light_of(theta[fitted], image_dn.shape)
        before, rows = theta[:, :2].copy(), np.flatnonzero(fitted)
        for batch in window_batches(rest, theta[rows]):
            values = batch.values + _light(batch.theta, batch.half) * batch.inside
            one = Batch(batch.rows, batch.corner, values, batch.inside, batch.theta)
            fit = refine(one, sheet, None, None)
            mine = rows[batch.rows]
            fitted[mine] = fit.converged
            theta[mine] = one.theta
            theta[mine, :2] += one.middle
        if not fitted.any() or np.abs(theta[fitted, :2] - before[fitted]).max() < STILL_PX:
            break
    return theta, fitted


def colours(theta: np.ndarray) -> np.ndarray:
    """(n,) numbers such that dots of the same number stand apart."""
    radius = reach(theta)[0]
    number = np.full(len(theta), -1)
    near = cKDTree(theta[:, :2]).query_ball_point(theta[:, :2], APART * radius)
    beside: list[set[int]] = [set() for _ in range(len(theta))]
    for k, others in enumerate(near):
        for other in others:
            if other != k:
                beside[k].add(other)
                beside[other].add(k)
    for k in range(len(theta)):
        taken = {int(number[other]) for other in beside[k]}
        number[k] = next(c for c in range(len(theta)) if c not in taken)
    return number


def light_of(theta: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """(h, w) what dots add to their ground."""
    light = np.zeros(shape)
    for batch in window_batches(light, theta) if len(theta) else ():
        for corner, part in zip(batch.corner, _light(batch.theta, batch.half), strict=True):
            left, top = np.maximum(corner, 0)
            right, bottom = np.minimum(corner + part.shape[0], shape[::-1])
            if right > left and bottom > top:
                light[top:bottom, left:right] += part[
                    top - corner[1] : bottom - corner[1], left - corner[0] : right - corner[0]
                ]
    return light


def _light(theta: np.ndarray, half: int) -> np.ndarray:
    """(n, m, m) the same in windows, to whose middles the centres are relative."""
    outline, tangent, by_shape = dot_outline(theta)
    grid = np.broadcast_to(np.arange(-half, half + 1.0), (len(theta), 2 * half + 1))
    disc = disc_in_pixels(outline, tangent, by_shape[:, :0], theta[:, BLUR], grid, grid)
    return np.asarray(theta[:, CONTRAST, None, None] * disc.value)


def moments_of(theta: np.ndarray) -> np.ndarray:
    """(n, 2, 2) second moments of the outlines."""
    axes = theta[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    return np.asarray(axes @ axes / 4)


def _first_contrast(image: np.ndarray, xy: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """(n,) the level in the middle less the least one around."""
    sides = np.maximum(np.ceil(0.8 * diameters(moments)), 2).astype(int)
    middle = np.rint(xy).astype(int)
    found = np.zeros(len(xy))
    for k, ((x, y), r) in enumerate(zip(middle, sides, strict=True)):
        window = image[max(y - r, 0) : y + r + 1, max(x - r, 0) : x + r + 1]
        found[k] = np.median(image[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]) - window.min()
    return found


def _lost(blobs: Blobs, crowd: np.ndarray, measured_px: np.ndarray) -> int:
    """How many of a crowd have no measurement."""
    if not len(measured_px):
        return len(crowd)
    gap = cKDTree(measured_px).query(blobs.xy_px[crowd])[0]
    return int((gap > SAME * diameters(blobs.moments_px2[crowd])).sum())
