"""Is a blob's edge an ellipse? Asked of the edge alone, so a shadow that falls across a dot does no harm."""

from functools import partial

import cv2
import numpy as np

from testfield.detect.by_place import by_place
from testfield.detect.sampling import WINDOW_PX, median_of, sampled
from testfield.detect.screen import half_axes_of
from testfield.store.compiled import compiled

RMS_PART, WORST_PX, WORST_PART, NOISE_PX = 0.045, 0.03, 0.1, 0.5
"""An edge may lie off its ellipse by such parts of the dot's radius, and so many pixels for a noise as large as the
contrast. Blur makes a square of a few pixels so round that its edge is off by little more."""
ROUGHLY = 2.5
"""Before the fit the ellipse is a rough one, and all four may be so many times larger."""
CAUGHT = 0.85
"""Part of a dot's contrast by which its image must fall along the rays: of a wider edge the ends are cut off, what is
left is noise more than fall, and where it lies is the middle of the ray whatever the dot's shape."""
FOOTS = 1.15, 1.3, 1.5
"""Where the ground is looked for, in dot radii: nearest to the dot where another one is beside it."""
RAYS, STEPS = 36, 33
BEGIN, END = 0.5, 1.5
"""Where a ray looks for the edge, in dot radii."""


def is_elliptic(
    image_dn: np.ndarray, xy_px: np.ndarray, moments_px2: np.ndarray, relative_noise: np.ndarray, slack: float = 1.0
) -> np.ndarray:
    """(n,) whether the edges of bright blobs in an image (h, w) lie on the ellipses of their moments, within what noise
    and real paint need: `relative_noise` (n,) of a pixel over the contrast; `slack` widens the limits. Rows that are
    not finite are no ellipses."""
    good = np.isfinite(xy_px).all(axis=1) & np.isfinite(moments_px2).all(axis=(1, 2))
    if not good.any():
        return good
    rms, worst = edge_deviation(image_dn, xy_px[good], moments_px2[good])
    radius = 2 * np.maximum(np.linalg.det(moments_px2[good]), 0) ** 0.25
    with np.errstate(invalid="ignore"):
        chance = NOISE_PX * np.nan_to_num(relative_noise[good], nan=0.0)
        good[good] = (rms < slack * (RMS_PART * radius + chance)) & (
            worst < slack * (WORST_PX + WORST_PART * radius + 3 * chance)
        )
    return good


def has_contour(
    image_dn: np.ndarray, xy_px: np.ndarray, moments_px2: np.ndarray, contrast_dn: np.ndarray
) -> np.ndarray:
    """(n,) whether the edges of dots of these contrasts (n,) are narrow enough for `is_elliptic` to tell their shape;
    rows that are not finite have none."""
    good = np.isfinite(xy_px).all(axis=1) & np.isfinite(moments_px2).all(axis=(1, 2)) & (contrast_dn > 0)
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    ends = np.array([BEGIN, *FOOTS])[:, None, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    image, rows = np.ascontiguousarray(image_dn, np.float32), np.flatnonzero(good)
    for some in np.array_split(rows, len(rows) // 30_000 + 1):  # OpenCV counts rows in 16 bits
        if not len(some):
            continue
        around = ends.reshape(-1, 2) @ np.swapaxes(half_axes_of(moments_px2[some]), 1, 2)
        at = (xy_px[some, None] + around).astype(np.float32)
        value = cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        level = value.reshape(len(some), -1, RAYS)
        fall = (level[:, 0] - level[:, 1:].min(axis=1)).mean(axis=1)
        good[some] = fall > CAUGHT * contrast_dn[some]
    return good


def edge_deviation(image_dn: np.ndarray, xy_px: np.ndarray, moments_px2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Root mean square and largest distance (n,) in px of the edges of n bright dots from their ellipses.

    Along each of `RAYS` rays the edge lies at the centroid of the squared fall of the image (h, w); rays that leave
    the image are left out. The ellipses' mean error in size does not count.
    """
    angle, radius = 2 * np.pi * np.arange(RAYS) / RAYS, np.linspace(BEGIN, END, STEPS)
    towards = np.column_stack([np.cos(angle), np.sin(angle)])
    image = np.ascontiguousarray(image_dn, np.float32)
    places, middles = (towards[:, None] * radius[:, None]).reshape(-1, 2), (radius[:-1] + radius[1:]) / 2
    rms, worst = by_place(partial(_deviations, image, towards, places, middles), xy_px, half_axes_of(moments_px2)).T
    return rms, worst


@compiled
def _deviations(
    image: np.ndarray, towards: np.ndarray, places: np.ndarray, middles: np.ndarray, xy: np.ndarray, axes: np.ndarray
) -> np.ndarray:
    """(n, 2) root mean square and largest; `places` are those along the rays, one ray behind the other."""
    n, rays, steps = len(xy), len(towards), len(middles)
    both, edge, sorting = np.empty((n, 2)), np.empty(rays), np.empty(rays)
    values, window = np.empty(len(places), np.float32), np.empty((WINDOW_PX, WINDOW_PX), np.float32)
    for i in range(n):
        sampled(image, xy[i], axes[i], places, window, values)
        for k in range(rays):
            total, moment, first = 0.0, 0.0, k * (steps + 1)
            for j in range(steps):
                fall = values[first + j] - values[first + j + 1]
                # Beyond the image values are NaN, and so is the edge.
                square = 0.0 if fall <= 0 else float(fall * fall)
                total += square
                moment += square * middles[j]
            edge[k] = moment / total
            sorting[k] = edge[k]
        middle = median_of(sorting)
        count, squares, worst = 0, 0.0, 0.0
        for k in range(rays):
            if not np.isnan(edge[k]):
                dx = axes[i, 0, 0] * towards[k, 0] + axes[i, 0, 1] * towards[k, 1]
                dy = axes[i, 1, 0] * towards[k, 0] + axes[i, 1, 1] * towards[k, 1]
                off = abs(edge[k] - middle) * np.sqrt(dx * dx + dy * dy)
                squares += off * off
                worst = max(worst, off)
                count += 1
        both[i, 0] = np.sqrt(squares / count) if count else np.inf
        both[i, 1] = worst if count else np.inf
    return both
