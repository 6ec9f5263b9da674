"""A quick look at every blob: is it bright inside, and darker all around? What is not costs no fit."""

import cv2
import numpy as np

RAYS = 24
INSIDE, RIM = (0.4, 0.75), (1.35, 1.6)
"""Radii, in dot radii, at which the dot and the gap around it are sampled."""
DARKER = 0.5
"""What lies around must be darker than this part of the way from the surroundings to the dot, in every direction."""
LEAST_SIGMAS = 4.0


def may_be_dots(
    image_dn: np.ndarray, xy_px: np.ndarray, moments_px2: np.ndarray, contrast_dn: np.ndarray, noise_dn: np.ndarray
) -> np.ndarray:
    """(n,) whether blobs at `xy_px` (n, 2) of moments (n, 2, 2) are bright spots on darker ground in all directions.

    `image_dn` (h, w) float32 of bright marks; `contrast_dn` and `noise_dn` (n,). Directions that lead out of the
    image are not asked. Blobs without finite numbers are none.
    """
    n = len(xy_px)
    answer = np.zeros(n, bool)
    finite = np.flatnonzero(
        np.isfinite(xy_px).all(1) & np.isfinite(moments_px2).all((1, 2)) & (contrast_dn > LEAST_SIGMAS * noise_dn)
    )
    if len(finite) == 0:
        return answer
    xy, contrast, noise = xy_px[finite], contrast_dn[finite], noise_dn[finite]
    half_axes = half_axes_of(moments_px2[finite])
    rim = np.stack([polar(image_dn, xy, half_axes, radius, RAYS) for radius in RIM]).min(axis=0)
    inner, inside = (polar(image_dn, xy, half_axes, radius, RAYS) for radius in INSIDE)
    known = ~np.isnan(rim)
    rim[~known.any(axis=1)] = inner[np.isnan(inner).all(axis=1)] = 0  # out of the image altogether
    ground, middle = median_known(rim), median_known(inner)
    step = middle - ground
    doubt = 3 * noise[:, None]
    with np.errstate(invalid="ignore"):
        dark = ~known | (rim - ground < DARKER * step + doubt)
        even = np.isnan(inner) | (np.abs(inner - middle) < DARKER * step + doubt)
        even &= np.isnan(inside) | (inside > ground + DARKER * step - doubt)
        enough = known.mean(axis=1) > 0.5
        answer[finite] = dark.all(1) & even.all(1) & enough & (step[:, 0] > 0.3 * contrast)
    return answer


def half_axes_of(moments_px2: np.ndarray) -> np.ndarray:
    """Symmetric (n, 2, 2) that maps the unit circle onto the ellipse of the moments without turning it."""
    values, vectors = np.linalg.eigh(4 * moments_px2)
    return (vectors * np.sqrt(np.maximum(values, 0))[:, None, :]) @ np.swapaxes(vectors, 1, 2)


def polar(image: np.ndarray, xy_px: np.ndarray, half_axes: np.ndarray, radius: float, count: int) -> np.ndarray:
    """(n, count) bilinear values on the ellipses of relative `radius`, at equal angles clockwise in the image (the
    first half a step from +x); NaN outside the image."""
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    circle = (radius * np.stack([np.cos(angle), np.sin(angle)])).astype(np.float32)
    place, half_axes = xy_px.astype(np.float32), half_axes.astype(np.float32)
    return sample(image, place[:, :1] + half_axes[:, 0] @ circle, place[:, 1:] + half_axes[:, 1] @ circle)


def sample(image: np.ndarray, x_px: np.ndarray, y_px: np.ndarray) -> np.ndarray:
    """Bilinear values at (n, k) places, NaN outside the image; in blocks that OpenCV's size limit allows."""
    x, y = x_px.astype(np.float32, copy=False), y_px.astype(np.float32, copy=False)
    out = np.empty(x.shape, np.float32)
    for start in range(0, len(x), 8192):
        part = slice(start, start + 8192)
        out[part] = cv2.remap(image, x[part], y[part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    h, w = image.shape
    if not all(v.min(initial=0) >= -0.5 and v.max(initial=0) <= size - 0.5 for v, size in ((x, w), (y, h))):
        out[(x < -0.5) | (y < -0.5) | (x > w - 0.5) | (y > h - 0.5)] = np.nan
    return out


def median_known(values: np.ndarray) -> np.ndarray:
    """(n, 1) medians of the rows, of what is known in them: NaN stands for the rest, and is slow to leave out."""
    median = np.nanmedian if np.isnan(values).any() else np.median
    return median(values, axis=1, keepdims=True)
