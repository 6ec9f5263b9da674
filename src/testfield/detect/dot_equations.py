"""The pixel equations of dots: a model's values and derivatives, gathered at once into normal equations."""

from dataclasses import dataclass

import numpy as np

from testfield.detect.disc import integrate
from testfield.detect.normal_equations import CHUNK, add_products
from testfield.store.compiled import compiled

DOT = 12
"""Parameters of a dot, in the order of `forward_windows`."""


@dataclass(frozen=True)
class Equations:
    """Of n fits of p parameters: the model's values (n, m, m) where pixels are used, normal matrices (n, p, p), and
    their right sides (n, p)."""

    model: np.ndarray
    normal: np.ndarray
    right: np.ndarray

    def renew(self, which: np.ndarray, now: "Equations") -> None:
        """Take what is new of the fits `which` (k,); the others stay."""
        for old, new in ((self.model, now.model), (self.normal, now.normal), (self.right, now.right)):
            old[which] = new


def dot_equations(
    values: np.ndarray,
    use: np.ndarray,
    theta: np.ndarray,
    outline: tuple[np.ndarray, np.ndarray, np.ndarray],
    noise: tuple[float, float, float],
) -> Equations:
    """The equations of dots in windows (n, m, m) of pixel `values`, of which those of `use` count.

    `theta` (n, 12) are the parameters, relative to the window's middle; `outline` the points (n, k, 2) at equal steps
    of an angle, their derivatives by it, and those (n, 5, k, 2) by the first five parameters. Weights are those of
    `noise`, the line of a pixel's variance (`SensorSheet.noise_line`), at the model's own value: a better guess of a
    pixel's mean than the noisy pixel.
    """
    at, tangent, by_shape = outline
    model, normal, right = _dots(
        values,
        use,
        theta,
        np.ascontiguousarray(at),
        tangent * (2 * np.pi / at.shape[1]),
        np.ascontiguousarray(by_shape),
        np.array(noise),
    )
    return Equations(model, normal, right)


@compiled
def _dots(
    values: np.ndarray,
    use: np.ndarray,
    theta: np.ndarray,
    outline: np.ndarray,
    tangent: np.ndarray,
    by_shape: np.ndarray,
    noise: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n, side = values.shape[0], values.shape[1]
    half = side // 2
    model, normal, right = np.zeros((n, side, side)), np.zeros((n, DOT, DOT)), np.zeros((n, DOT))
    seen, first = np.empty((side, side, 7)), np.array([-float(half), -float(half)])
    jacobian, weight, residual = np.zeros((DOT, CHUNK)), np.zeros(CHUNK), np.zeros(CHUNK)
    for i in range(n):
        t, k = theta[i], 0
        integrate(outline[i], tangent[i], by_shape[i], t[5], first, seen)
        for r in range(side):
            for c in range(side):
                if use[i, r, c]:
                    value = dot_pixel(t, c - half - t[0], r - half - t[1], seen, r, c, jacobian, k)
                    model[i, r, c], residual[k] = value, values[i, r, c] - value
                    weight[k] = 1 / (noise[0] + max(noise[1] * (value - noise[2]), 0.0))
                    k += 1
                    if k == CHUNK:
                        add_products(jacobian, weight, residual, normal[i], right[i])
                        k = 0
        add_products(jacobian, weight, residual, normal[i], right[i])
    return model, normal, right


@compiled
def dot_pixel(
    t: np.ndarray, dx: float, dy: float, seen: np.ndarray, r: int, c: int, jacobian: np.ndarray, k: int
) -> float:
    """The value of a pixel in row r and column c, (dx, dy) from the centre of a dot of parameters t (12,), from what is
    `seen` (h, w, 7) of the disc; its derivatives go to place k of the `jacobian` (12, m)."""
    disc, by_x, by_y, spread = seen[r, c, 0], seen[r, c, 2], seen[r, c, 3], t[5] * t[5] + 1 / 12
    # Blurred, x times the disc becomes x times the disc's image plus the blur's variance times its slope.
    lit_x, lit_y = dx * disc - spread * by_x, dy * disc - spread * by_y
    lit = t[6] + t[8] * dx + t[9] * dy
    jacobian[0, k] = lit * by_x - t[8] * disc - t[10]
    jacobian[1, k] = lit * by_y - t[9] * disc - t[11]
    for j in range(2, 5):
        jacobian[j, k] = lit * seen[r, c, 2 + j]
    jacobian[5, k] = lit * seen[r, c, 1]
    jacobian[6, k], jacobian[7, k], jacobian[8, k], jacobian[9, k] = disc, 1.0, lit_x, lit_y
    jacobian[10, k], jacobian[11, k] = dx, dy
    return t[7] + t[10] * dx + t[11] * dy + t[6] * disc + t[8] * lit_x + t[9] * lit_y
