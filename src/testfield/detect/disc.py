"""What pixels see of a disc: its outline blurred by the optics and by the pixels' own area, to the last digit.

A pixel's value is the integral over the disc of a weight, the pixel's square convolved with the optics' Gaussian. By
Green's theorem it is an integral along the outline, whose integrand is a function of x times a function of y, and which
only pixels near the outline feel. It holds for any smooth closed outline, however small and however flat, and so for a
circle seen through a whole lens. When the outline moves, the value changes by the weight on the outline times the
outline's speed across itself (Reynolds' transport theorem): one more such integral a parameter.
"""

from dataclasses import dataclass

import numpy as np

from testfield.detect.normal_table import normal
from testfield.store.compiled import compiled

SPACING = 1.3
"""Distance of the outline's points in units of the blur. The rule is exact but for exp(-2 pi^2 / SPACING^2)."""
LEAST_BLUR_PX, MOST_BLUR_PX = 0.2, 8.0
FELT = 5.0
"""Blurs beyond which an outline point is not felt: what is left there is less than a millionth."""


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
    n, p = by_shape.shape[0], by_shape.shape[1]
    value, bent = np.empty((n, height, width)), np.empty((n, height, width))
    moved, seen = np.empty((n, p, height, width)), np.empty((height, width, p + 2))
    for i in range(n):
        integrate(outline[i], tangent[i], by_shape[i], blur[i], first[i], seen)
        for row in range(height):
            for column in range(width):
                value[i, row, column], bent[i, row, column] = seen[row, column, 0], seen[row, column, 1]
                for j in range(p):
                    moved[i, j, row, column] = seen[row, column, 2 + j]
    return value, bent, moved


@compiled
def integrate(
    outline: np.ndarray,
    tangent: np.ndarray,
    by_shape: np.ndarray,
    blur: float,
    first: np.ndarray,
    seen: np.ndarray,
    felt: float = FELT,
) -> None:
    """Into `seen` (h, w, p + 2) what the pixels see of one disc: its value, and the derivatives by the blur and by the
    shape. These are sums over outline points with their tangents times the step between them; `first` (2,) is the
    middle of the window's first pixel. A point is felt within `felt` blurs; left of that a pixel is filled whole."""
    height, width, kinds = seen.shape
    flat = seen.reshape(height * width * kinds)
    whole, none = np.zeros((height, width + 1)), np.empty(0)
    across, filled, slope = np.empty(width), np.empty(width), np.empty(width)
    down, turn = np.empty(height), np.empty(height)
    row_part, turned_part = np.empty(width * kinds), np.empty(width)
    for k in range(len(flat)):
        flat[k] = 0
    for k in range(len(outline)):
        x, y = outline[k, 0] - first[0] + 0.5, outline[k, 1] - first[1] + 0.5
        dx, dy = tangent[k, 0], tangent[k, 1]
        left, right = _weights(x, blur, width, felt, across, filled, slope)
        top, bottom = _weights(y, blur, height, felt, down, none, turn)
        # All that a point adds to a row is one list of numbers times its share of the row, but to the derivatives by
        # the blur, which take the share's slope too.
        for column in range(left, right):
            at = (column - left) * kinds
            row_part[at], row_part[at + 1] = dy * filled[column], 0.0
            slope[column], turned_part[column] = dy * slope[column], -dx * across[column]
            for j in range(kinds - 2):
                row_part[at + 2 + j] = (by_shape[j, k, 0] * dy - by_shape[j, k, 1] * dx) * across[column]
        count = (right - left) * kinds
        for row in range(top, bottom):
            whole[row, left] += down[row] * dy
            at = (row * width + left) * kinds
            _add(flat[at : at + count], row_part, down[row])
            for column in range(left, right):
                flat[at + 1] += down[row] * slope[column] + turn[row] * turned_part[column]
                at += kinds
    for row in range(height):
        total = 0.0
        for column in range(width - 1, -1, -1):
            total += whole[row, column + 1]
            seen[row, column, 0] += total
            # The blur obeys the heat equation: a change of its variance adds half the Laplacian.
            seen[row, column, 1] *= blur


@compiled
def _add(to: np.ndarray, part: np.ndarray, share: float) -> None:
    for k in range(len(to)):
        to[k] += share * part[k]


@compiled
def _weights(
    at: float, blur: float, count: int, felt: float, across: np.ndarray, filled: np.ndarray, slope: np.ndarray
) -> tuple[int, int]:
    """Of `count` pixels whose first begins at 0, those from the first to the second number feel an outline point: their
    weights in one coordinate, these weights' integrals from the left (where asked for), and their derivatives."""
    first = min(max(int(np.floor(at - felt * blur)), 0), count)
    last = max(min(int(np.ceil(at + felt * blur)), count), first)
    below = density = integral = 0.0
    for edge in range(first, last + 1):
        u = at - edge
        next_below, next_density = normal(u / blur)
        next_density /= blur
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
