"""What pixels see of a disc: its outline blurred by the optics and by the pixels' own area, to the last digit.

A pixel's value is the integral over the disc of a weight, the pixel's square convolved with the optics' Gaussian. By
Green's theorem it is an integral along the outline, whose integrand is a function of x times a function of y: the image
is one product of matrices. It holds for any smooth closed outline, however small and however flat, and so for a circle
seen through a whole lens. When the outline moves, the value changes by the weight on the outline times the outline's
speed across itself (Reynolds' transport theorem): one more such product a parameter.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

SPACING = 1.3
"""Distance of the outline's points in units of the blur. The rule is exact but for exp(-2 pi^2 / SPACING^2)."""
LEAST_BLUR_PX, MOST_BLUR_PX = 0.2, 8.0


@dataclass(frozen=True)
class DiscPixels:
    """Windows of m rows and w columns with n discs of value 1.

    `value` (n, m, w); `by_blur` (n, m, w) its derivative by the blur; `by_shape` (n, p, m, w) by the outline's
    parameters.
    """

    value: np.ndarray
    by_blur: np.ndarray
    by_shape: np.ndarray


def outline_points(largest_half_axis_px: float, blur_px: float) -> int:
    """How many points an outline needs, in steps that make few groups."""
    need = 2 * np.pi * largest_half_axis_px / (SPACING * blur_px)
    return int(8 * np.ceil(max(need, 16) / 8))


def disc_in_pixels(
    outline_px: np.ndarray,
    tangent_px: np.ndarray,
    by_shape_px: np.ndarray,
    blur_px: np.ndarray,
    x_px: np.ndarray,
    y_px: np.ndarray,
) -> DiscPixels:
    """Pixel values and derivatives of n discs.

    `outline_px` (n, k, 2) at equal steps of a parameter that runs once round from +x towards +y, `tangent_px`
    (n, k, 2) its derivative by that parameter (0 to 2 pi), `by_shape_px` (n, p, k, 2) by each of p parameters of the
    shape; `blur_px` (n,) the Gaussian's standard deviation; `x_px` (n, w), `y_px` (n, m) the pixels' middles.
    """
    n, points = outline_px.shape[:2]
    p, m, w = by_shape_px.shape[1], y_px.shape[1], x_px.shape[1]
    tangent = tangent_px * (2 * np.pi / points)
    across_x, filled_x, bent_x = _weights(outline_px[:, :, 0], x_px, blur_px, True)
    across_y, _, bent_y = _weights(outline_px[:, :, 1], y_px, blur_px, False)
    speed = by_shape_px[..., 0] * tangent[:, None, :, 1] - by_shape_px[..., 1] * tangent[:, None, :, 0]

    right = np.empty((n, points, p + 2, w), np.float32)
    tangent, speed = tangent.astype(np.float32), np.swapaxes(speed, 1, 2).astype(np.float32)
    np.multiply(filled_x, tangent[..., 1:], out=right[:, :, 0])
    np.multiply(bent_x, tangent[..., 1:], out=right[:, :, 1])
    np.multiply(across_x[:, :, None, :], speed[..., None], out=right[:, :, 2:])
    planes = (np.swapaxes(across_y, 1, 2) @ right.reshape(n, points, -1)).reshape(n, m, p + 2, w)
    # The blur obeys the heat equation: a change of its variance adds half the Laplacian.
    laplacian = planes[:, :, 1] - np.swapaxes(bent_y, 1, 2) @ (across_x * tangent[..., :1])
    return DiscPixels(planes[:, :, 0], blur_px[:, None, None] * laplacian, np.moveaxis(planes[:, :, 2:], 2, 1))


def _weights(
    at_px: np.ndarray, pixel_px: np.ndarray, blur_px: np.ndarray, filled: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For outline coordinates (n, k) and neighbouring pixels (n, w): the pixel's weight in one coordinate (n, k, w),
    its integral from the left (zero where not `filled`), and its derivative."""
    edges = np.concatenate([pixel_px - 0.5, pixel_px[:, -1:] + 0.5], axis=1)
    blur = blur_px[:, None, None].astype(np.float32)
    u = (at_px[:, :, None] - edges[:, None, :]).astype(np.float32)
    z = u / blur
    below = ndtr(z)
    density = np.exp(-0.5 * z * z) / (np.float32(np.sqrt(2 * np.pi)) * blur)
    integral = _drop(u * below + blur**2 * density) if filled else density
    return _drop(below), integral, _drop(density)


def _drop(values: np.ndarray) -> np.ndarray:
    """By how much values fall from one pixel's edge to the next."""
    return values[:, :, :-1] - values[:, :, 1:]


def ellipse_outline(half_axes_px: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Outlines (n, k, 2) about the origin of ellipses whose axes' matrices (n, 2, 2) map the unit circle onto them,
    their tangents, and their derivatives (5, k, 2) by centre x, centre y and the matrix' xx, xy, yy."""
    angle = 2 * np.pi * np.arange(points) / points
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros(points), np.ones(points)
    outline = np.einsum("nij,kj->nki", half_axes_px, np.column_stack([c, s]))
    tangent = np.einsum("nij,kj->nki", half_axes_px, np.column_stack([-s, c]))
    rows = [(one, zero), (zero, one), (c, zero), (s, c), (zero, s)]
    return outline, tangent, np.array([np.column_stack(row) for row in rows])
