"""A smooth field of displacements over the image: Chebyshev products, evaluated with slopes.

Coefficients (..., 2, d, d): displacement in x and in y, row index for y, over the image mapped to -1 ... 1.
"""

import numpy as np

OUTSIDE = 1.05
"""A polynomial means nothing far outside the image: beyond this it keeps its last value."""


def displacement(field_px: np.ndarray, uv_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(..., 2) px that a field (2, d, d) adds at pixels (..., 2) of an image of `size_px` (width, height)."""
    inside = np.clip(_mapped(uv_px, size_px), -OUTSIDE, OUTSIDE)
    parts = [np.polynomial.chebyshev.chebval2d(inside[..., 1], inside[..., 0], c) for c in field_px]
    return np.stack(parts, axis=-1)


def slope(field_px: np.ndarray, uv_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(..., 2, 2) derivatives of `displacement` by the pixel: by x in the first column."""
    by_x = np.polynomial.chebyshev.chebder(field_px, axis=2) * (2 / size_px[0])
    by_y = np.polynomial.chebyshev.chebder(field_px, axis=1) * (2 / size_px[1])
    return np.stack([displacement(by_x, uv_px, size_px), displacement(by_y, uv_px, size_px)], axis=-1)


def values_of(modes_px: np.ndarray, uv_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(n, 2, q) displacements at pixels (n, 2) by each of q fields (q, 2, d, d)."""
    q, _, d, _ = modes_px.shape
    inside = np.clip(_mapped(uv_px, size_px), -OUTSIDE, OUTSIDE)
    x, y = (np.polynomial.chebyshev.chebvander(inside[:, axis], d - 1) for axis in (0, 1))
    products = (y[:, :, None] * x[:, None, :]).reshape(len(uv_px), d * d)
    return (products @ modes_px.reshape(2 * q, d * d).T).reshape(-1, q, 2).swapaxes(1, 2)


def mean_squares(modes_px: np.ndarray) -> np.ndarray:
    """(q,) mean square displacement in px^2 over the image by each of q fields (q, 2, d, d)."""
    at = np.linspace(-1, 1, 4 * modes_px.shape[-1] + 1)
    basis = np.polynomial.chebyshev.chebvander(at, modes_px.shape[-1] - 1)
    everywhere = np.einsum("ai,qkij,bj->qkab", basis, modes_px, basis, optimize=True)
    return np.square(everywhere).sum(axis=1).mean(axis=(1, 2))


def _mapped(uv_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    return 2 * (uv_px + 0.5) / np.asarray(size_px) - 1
