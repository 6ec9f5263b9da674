"""The numbers that compiled fits stand on: the normal distribution, inverses, and derivatives."""

import numpy as np
import pytest
from scipy.special import ndtr

from testfield.detect import centre_ring
from testfield.detect.centre_forward import dot_outline
from testfield.detect.dot_equations import DOT, dot_equations
from testfield.detect.normal_equations import LEAST_PIVOT, by_cholesky, inverse
from testfield.detect.normal_table import normal
from testfield.detect.ring_equations import PARAMETERS, ring_equations
from testfield.detect.ring_pixels import bright_segments, ring_nodes, ring_outline
from testfield.targets.marks import RADII

EVEN = 1.0, 0.0, 0.0
THETA = np.array([0.3, -0.2, 5.0, 0.3, 4.2, 0.7, 900.0, 100.0, 2.0, -1.0, 0.3, 0.2])


def test_the_table_gives_the_normal_distribution_to_its_last_digits() -> None:
    z = np.concatenate([np.linspace(-9.5, 9.5, 4001), [-40, 40]])
    ours = np.array([normal(float(v)) for v in z])
    np.testing.assert_allclose(ours[:, 0], ndtr(z), rtol=0, atol=1e-15)
    np.testing.assert_allclose(ours[:, 1], np.exp(-z * z / 2) / np.sqrt(2 * np.pi), rtol=0, atol=2e-13)


def test_inverses_are_those_of_numpy_and_what_is_not_told_stays() -> None:
    random = np.random.default_rng(1)
    design = random.normal(size=(5, 40, 6)) * [1, 1e3, 1e-3, 1, 10, 1]
    matrices = np.swapaxes(design, 1, 2) @ design
    np.testing.assert_allclose(inverse(matrices) @ matrices, np.tile(np.eye(6), (5, 1, 1)), atol=1e-9)
    matrices[2, :, 3] = matrices[2, 3] = 0
    assert list(by_cholesky(matrices)[1]) == [True, True, False, True, True]
    found = inverse(matrices)
    np.testing.assert_allclose(found[2, 3], 0, atol=1e-12)
    rest = [0, 1, 2, 4, 5]
    np.testing.assert_allclose(found[2][np.ix_(rest, rest)] @ matrices[2][np.ix_(rest, rest)], np.eye(5), atol=1e-9)
    assert LEAST_PIVOT > 1e-9


def dots(theta: np.ndarray, values: np.ndarray, use: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    found = dot_equations(values, use, theta, dot_outline(theta), EVEN)
    return found.model[0], found.right[0]


def rings(theta: np.ndarray, values: np.ndarray, use: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    start, turn = np.eye(3)[None].copy(), np.eye(3)
    start[0, :2, :2], start[0, :2, 2] = np.array([[5.0, 0.3], [0.2, 4.3]]), [0.3, -0.2]
    for k, place in enumerate(centre_ring.TURNS):
        turn[place] += theta[0, DOT + 1 + k]
    homography, nodes = start @ turn, ring_nodes(14, RADII["1:2:3"], 5.2, 0.65)
    outline = ring_outline(nodes, bright_segments(np.array([0b00010110111011], np.uint32), 14), homography)
    dot = dot_outline(theta[:, :DOT])
    found = ring_equations(values, use, theta, dot, outline, start, homography, np.array([15.0]), 64.0, EVEN)
    return found.model[0], found.right[0]


@pytest.mark.parametrize("equations", [dots, rings])
def test_right_sides_are_what_the_model_s_differences_say(equations: object) -> None:
    assert callable(equations)
    more = np.zeros(PARAMETERS - DOT)
    more[0], more[1:9] = 0.95, 0.01 * np.arange(-4, 4)
    # The light is not bent: how its curvature moves with the centre is left out of the derivatives.
    theta = np.concatenate([THETA, more] if equations is rings else [THETA])[None]
    side = 51
    use = np.ones((1, side, side), bool)
    model, _ = equations(theta, np.zeros((1, side, side)), use)
    for k in range(theta.shape[1]):
        step = 1e-4 * max(abs(theta[0, k]), 0.1)
        ends = []
        for sign in (1, -1):
            moved = theta.copy()
            moved[0, k] += sign * step
            ends.append(equations(moved, np.zeros((1, side, side)), use)[0])
        by = (ends[0] - ends[1]) / (2 * step)
        right = equations(theta, (model + by)[None], use)[1]
        # A turn moves what lies within the breadth of the blur differently, which the derivatives leave out.
        near = 0.03 if DOT < k <= DOT + 8 else 1e-3
        assert right[k] == pytest.approx((by**2).sum(), rel=near), k
