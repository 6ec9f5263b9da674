"""What pixels see of a disc: its outline blurred by the optics and by the pixels' own area, to the last digit.

A pixel's value is the integral over the disc of a weight, the pixel's square convolved with the optics' Gaussian. By
Green's theorem it is an integral along the outline, whose integrand is a function of x times a function of y, and which
only pixels near the outline feel. It holds for any smooth closed outline, however small and however flat, and so for a
circle seen through a whole lens. When the outline moves, the value changes by the weight on the outline times the
outline's speed across itself (Reynolds' transport theorem): one more such integral a parameter.
"""

import math
from dataclasses import dataclass

import numpy as np

from testfield.store.compiled import compiled

SPACING = 1.3
"""Distance of the outline's points in units of the blur. The rule is exact but for exp(-2 pi^2 / SPACING^2)."""
LEAST_BLUR_PX, MOST_BLUR_PX = 0.2, 8.0
FELT = 5.0
"""Blurs beyond which an outline point is not felt: what is left there is less than a millionth."""
ROOT_HALF = math.sqrt(0.5)


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
    value, by_blur, by_shape = _integrals(
        np.ascontiguousarray(outline_px, float),
        np.ascontiguousarray(tangent_px, float) * (2 * np.pi / outline_px.shape[1]),
        np.ascontiguousarray(by_shape_px, float),
        np.ascontiguousarray(blur_px, float),
        np.column_stack([x_px[:, 0], y_px[:, 0]]).astype(float),
        y_px.shape[1],
        x_px.shape[1],
    )
    return DiscPixels(value, by_blur, by_shape)


@compiled
def _integrals(
    outline: np.ndarray,
    tangent: np.ndarray,
    by_shape: np.ndarray,
    blur: np.ndarray,
    first: np.ndarray,
    height: int,
    width: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sums over outline points with their tangents times the step between them; `first` (n, 2) are the middles of the
    windows' first pixels. A point is felt within `FELT` blurs; left of that a pixel is filled whole."""
    n, points = outline.shape[:2]
    p = by_shape.shape[1]
    value, bent = np.zeros((n, height, width)), np.zeros((n, height, width))
    moved = np.zeros((n, p, height, width))
    most = width if width > height else height
    across, filled, slope = np.empty((2, most)), np.empty(most), np.empty((2, most))
    speed = np.empty(p)
    for i in range(n):
        # What is filled whole is noted where it ends, and summed up afterwards.
        whole = np.zeros((height, width + 1))
        for k in range(points):
            x, y = outline[i, k, 0] - first[i, 0] + 0.5, outline[i, k, 1] - first[i, 1] + 0.5
            dx, dy = tangent[i, k, 0], tangent[i, k, 1]
            left, right = _weights(x, blur[i], width, across[0], filled, slope[0])
            top, bottom = _weights(y, blur[i], height, across[1], filled[:0], slope[1])
            for j in range(p):
                speed[j] = by_shape[i, j, k, 0] * dy - by_shape[i, j, k, 1] * dx
            for row in range(top, bottom):
                share, turn = across[1, row], slope[1, row] * dx
                whole[row, left] += share * dy
                for column in range(left, right):
                    value[i, row, column] += share * dy * filled[column]
                    bent[i, row, column] += share * dy * slope[0, column] - turn * across[0, column]
                for j in range(p):
                    weight = share * speed[j]
                    for column in range(left, right):
                        moved[i, j, row, column] += weight * across[0, column]
        for row in range(height):
            total = 0.0
            for column in range(width - 1, -1, -1):
                total += whole[row, column + 1]
                value[i, row, column] += total
                # The blur obeys the heat equation: a change of its variance adds half the Laplacian.
                bent[i, row, column] *= blur[i]
    return value, bent, moved


@compiled
def _weights(
    at: float, blur: float, count: int, across: np.ndarray, filled: np.ndarray, slope: np.ndarray
) -> tuple[int, int]:
    """Of `count` pixels whose first begins at 0, those from the first to the second number feel an outline point: their
    weights in one coordinate, these weights' integrals from the left (where asked for), and their derivatives."""
    first = min(max(int(np.floor(at - FELT * blur)), 0), count)
    last = max(min(int(np.ceil(at + FELT * blur)), count), first)
    below = density = integral = 0.0
    for edge in range(first, last + 1):
        u = at - edge
        z = u / blur
        next_below = 0.5 * math.erfc(-z * ROOT_HALF)
        next_density = math.exp(-0.5 * z * z) * ROOT_HALF / (math.sqrt(math.pi) * blur)
        next_integral = u * next_below + blur * blur * next_density
        if edge > first:
            across[edge - 1] = below - next_below
            slope[edge - 1] = density - next_density
            if filled.size:
                filled[edge - 1] = integral - next_integral
        below, density, integral = next_below, next_density, next_integral
    return first, last


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
