"""The pixel equations of blobs whose outline is asked after: gathered at once into normal equations."""

import numpy as np

from testfield.detect.disc import integrate
from testfield.detect.normal_equations import CHUNK, add_products
from testfield.store.compiled import compiled

ELLIPSE = 12
"""Parameters of a blurred and unevenly lit ellipse: centre, three of its half-axes' matrix, blur, contrast, background,
and the gradients of the last two."""
NO_HOLE = np.empty((0, 0, 2))


def outline_equations(
    values: np.ndarray,
    use: np.ndarray,
    theta: np.ndarray,
    outline: tuple[np.ndarray, np.ndarray, np.ndarray],
    hole: tuple[np.ndarray, np.ndarray] | None,
    noise: tuple[float, float, float],
) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrices (n, p, p) and right sides (n, p) of blobs in windows (n, m, m) of pixel `values`, of which those
    of `use` count, weighted by the line of a pixel's variance (`SensorSheet.noise_line`) at the model's own value.

    `theta` (n, 12) relative to the windows' middles; `outline` points (n, k, 2) at equal steps of an angle, their
    derivatives by it, and those (n, 5 + s, k, 2) by centre, half-axes and s more parameters of the shape; `hole` points
    and derivatives of a second outline within, whose level is one parameter more. The parameters are the ellipse's, the
    s, and the hole's: p of them.
    """
    at, tangent, by_shape = outline
    inner, inner_tangent = (NO_HOLE, NO_HOLE) if hole is None else hole
    step = 2 * np.pi / at.shape[1]
    return _equations(
        np.ascontiguousarray(values, float),
        np.ascontiguousarray(use),
        theta,
        np.ascontiguousarray(at),
        tangent * step,
        np.ascontiguousarray(by_shape),
        np.ascontiguousarray(inner),
        inner_tangent * step,
        np.array(noise, float),
    )


@compiled
def _equations(
    values: np.ndarray,
    use: np.ndarray,
    theta: np.ndarray,
    outline: np.ndarray,
    tangent: np.ndarray,
    by_shape: np.ndarray,
    hole: np.ndarray,
    hole_tangent: np.ndarray,
    noise: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    n, side, shapes, holes = values.shape[0], values.shape[1], by_shape.shape[1], min(len(hole), 1)
    p, half = ELLIPSE + shapes - 5 + holes, side // 2
    normal, right = np.zeros((n, p, p)), np.zeros((n, p))
    seen, first = np.empty((side, side, 2 + shapes)), np.array([-float(half), -float(half)])
    within = np.zeros((side, side, 2))
    jacobian, weight, residual = np.zeros((p, CHUNK)), np.zeros(CHUNK), np.zeros(CHUNK)
    for i in range(n):
        t, k = theta[i], 0
        integrate(outline[i], tangent[i], by_shape[i], t[5], first, seen)
        if holes:
            integrate(hole[i], hole_tangent[i], by_shape[i, :0], t[5], first, within)
        for r in range(side):
            for c in range(side):
                if not use[i, r, c]:
                    continue
                dx, dy, disc = c - half - t[0], r - half - t[1], seen[r, c, 0]
                lit = t[6] + t[8] * dx + t[9] * dy
                jacobian[0, k] = lit * seen[r, c, 2] - t[8] * disc - t[10]
                jacobian[1, k] = lit * seen[r, c, 3] - t[9] * disc - t[11]
                for j in range(2, 5):
                    jacobian[j, k] = lit * seen[r, c, 2 + j]
                jacobian[5, k] = lit * seen[r, c, 1]
                jacobian[6, k], jacobian[7, k] = disc, 1.0
                jacobian[8, k], jacobian[9, k] = disc * dx, disc * dy
                jacobian[10, k], jacobian[11, k] = dx, dy
                for j in range(5, shapes):
                    jacobian[ELLIPSE - 5 + j, k] = lit * seen[r, c, 2 + j]
                if holes:
                    jacobian[p - 1, k] = within[r, c, 0]
                value = t[7] + t[10] * dx + t[11] * dy + lit * disc
                residual[k] = values[i, r, c] - value
                weight[k] = 1 / (noise[0] + max(noise[1] * (value - noise[2]), 0.0))
                k += 1
                if k == CHUNK:
                    add_products(jacobian, weight, residual, normal[i], right[i])
                    k = 0
        add_products(jacobian, weight, residual, normal[i], right[i])
    return normal, right
