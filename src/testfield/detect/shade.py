"""Dots half in the shade: the light's step across them is measured and taken out, then they are looked at once more.

Ink and ground meet the same light, so where a shadow's edge crosses a dot the whole picture around it is the lit one
times a step. The step's place, direction, width and depth follow from the bright side of the dot's outline alone: from
a white dot itself, from the paper around a dark one.
"""

from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.special import ndtr

from testfield.camera.images import InvertedSheet, SensorSheet
from testfield.detect.joined import put_beside, take
from testfield.detect.observations import MEASURED, diameters
from testfield.detect.polar import values_at
from testfield.detect.screen import circles, half_axes_of
from testfield.detect.targets import Targets

WHITE, PAPER = (0.15, 0.35, 0.55, 0.75), (1.3, 1.45, 1.6)
"""Radii, in dot radii, at which the light is seen on a white dot, and on the paper around a dark one."""
RAYS = 24
ANGLES, PLACES, WIDTHS = 24, np.linspace(-0.75, 0.75, 11), (0.08, 0.2, 0.4)
"""Directions, places and widths of edges that are tried, the latter in dot radii."""
EXPLAINED, DEEPEST, SHALLOWEST = 0.8, 0.12, 0.88
"""A step explains this part of what the light varies; the shade's level over the lit one lies between the others."""
SIGMAS = 6.0
NARROW = 0.3
"""Dots that were measured are looked at again where the step is narrower than this part of their radius."""
SMALLEST_PX, MOST = 7.0, 400
SAME = 0.35


def measure_shaded(
    image_dn: np.ndarray,
    sheet: SensorSheet,
    targets: Targets,
    reach: float,
    again: Callable[[np.ndarray, tuple[np.ndarray, np.ndarray]], Targets],
) -> Targets:
    """The `targets` of an image (h, w) of bright marks, those that a shadow's edge crosses measured in even light.

    Light is made even up to `reach` dot radii around each. `again(image, (xy, moments))` measures dots at rough places
    (n, 2) of rough moments (n, 2, 2).
    """
    blobs = targets.blobs
    if blobs is None or not len(blobs):
        return targets
    size = diameters(blobs.moments_px2)
    good = targets.status == MEASURED
    done = np.zeros(len(size), bool)
    if good.any():
        done = cKDTree(targets.xy_px[good]).query(blobs.xy_px)[0] < SAME * size
    left = ~blobs.cut & (size >= SMALLEST_PX)
    rows = np.flatnonzero(left)
    white = not isinstance(sheet, InvertedSheet)
    light_dn = image_dn if white else sheet.largest_dn - image_dn
    places = circles(WHITE if white else PAPER, RAYS)
    axes = half_axes_of(blobs.moments_px2[rows])
    values = values_at(light_dn, blobs.xy_px[rows], axes, places).astype(float)
    noise = np.sqrt(sheet.variance_dn2(np.nan_to_num(values if white else sheet.largest_dn - values)).mean(axis=1))
    begun = _steps(places, values, noise)
    rows, axes, values, steps = (part[begun[1]][:MOST] for part in (rows, axes, values, begun[0]))
    steps = np.array([_refined(places, *one) for one in zip(values, steps, strict=True)]).reshape(-1, 5)
    # Light that slopes is part of every dot's model; a step is not, and draws its centre to the lit side.
    asked = ~done[rows] | (steps[:, 4] < NARROW)
    rows, axes, steps = rows[asked], axes[asked], steps[asked]
    if not len(rows):
        return targets
    even, nearest = light_dn.astype(np.float32).copy(), np.full(image_dn.shape, np.inf, np.float32)
    for xy, axis, step in zip(blobs.xy_px[rows], axes, steps, strict=True):
        _make_even(light_dn, even, nearest, xy, axis, step, reach)
    flat = even if white else sheet.largest_dn - even
    found = again(flat.astype(np.float32), (blobs.xy_px[rows], blobs.moments_px2[rows]))
    return put_beside(targets, take(found, found.status == MEASURED), SAME)


def _steps(places: np.ndarray, values: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Steps (n, 5) that explain values (n, k) at places (k, 2) best: level, its change, direction, place, width; and
    which of them are a shadow's edge (n,)."""
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    tried = np.stack(np.meshgrid(angle, PLACES, WIDTHS, indexing="ij"), -1).reshape(-1, 3)
    edges = np.array([_edge(places, *one) for one in tried])
    shapes = edges - edges.mean(axis=1, keepdims=True)
    length = np.maximum(np.linalg.norm(shapes, axis=1), 1e-9)
    whole = np.isfinite(values).all(axis=1)
    seen = np.nan_to_num(values)
    rest = seen - seen.mean(axis=1, keepdims=True)
    # Of the two directions of an edge the one in which it gets darker.
    along = rest @ (shapes / length[:, None]).T
    best = along.argmin(axis=1)
    n = np.arange(len(values))
    part = along[n, best] ** 2 / np.maximum((rest**2).sum(axis=1), 1e-9)
    change = along[n, best] / length[best]
    level = seen.mean(axis=1) - change * edges.mean(axis=1)[best]
    ratio = (level + change) / np.maximum(level, 1e-9)
    shadow = whole & (part > EXPLAINED) & (ratio > DEEPEST) & (ratio < SHALLOWEST) & (-change > SIGMAS * noise)
    return np.column_stack([level, change, tried[best]]), shadow


def _edge(places: np.ndarray, angle: float, at: float, width: float) -> np.ndarray:
    """(k,) from 0 to 1 across a straight edge, at places in dot radii."""
    return np.asarray(ndtr((places @ [np.cos(angle), np.sin(angle)] - at) / width))


def _refined(places: np.ndarray, values: np.ndarray, first: np.ndarray) -> np.ndarray:
    """The step (5,) of least squares."""
    scale = np.array([first[0], first[0], 1, 1, 1])

    def misfit(p: np.ndarray) -> np.ndarray:
        q = p * scale
        return np.asarray((q[0] + q[1] * _edge(places, q[2], q[3], max(q[4], 0.02)) - values) / first[0])

    found = least_squares(misfit, first / scale, loss="soft_l1", f_scale=0.05, max_nfev=40).x * scale
    return found if np.isfinite(found).all() and 0 < found[0] + found[1] < found[0] else first


def _make_even(
    light_dn: np.ndarray,
    even: np.ndarray,
    nearest: np.ndarray,
    xy: np.ndarray,
    axes: np.ndarray,
    step: np.ndarray,
    reach: float,
) -> None:
    """Divide what lies within `reach` dot radii by the step, in `even`; where two dots reach, the nearer one counts."""
    height, width = light_dn.shape
    far = reach * np.linalg.norm(axes, 2) + 1
    left, top = np.maximum(np.floor(xy - far), 0).astype(int)
    right, bottom = np.minimum(np.ceil(xy + far) + 1, [width, height]).astype(int)
    x, y = np.meshgrid(np.arange(left, right) - xy[0], np.arange(top, bottom) - xy[1])
    places = np.stack([x, y], axis=-1) @ np.linalg.inv(axes).T
    q = np.linalg.norm(places, axis=-1)
    window = slice(top, bottom), slice(left, right)
    mine = (q < reach) & (q < nearest[window])
    level, change, angle, at, edge_width = step
    part = 1 + change / level * _edge(places.reshape(-1, 2), angle, at, max(edge_width, 0.02)).reshape(q.shape)
    even[window][mine] = (light_dn[window] / part)[mine]
    nearest[window][mine] = q[mine]
