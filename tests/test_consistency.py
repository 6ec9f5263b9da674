"""What the GUM family and photogrammetry foretell, against the project's own functions (METHODS sections 3 and 5)."""

import numpy as np
import pytest
from test_reconstruction import PINHOLE, calibration_of, seen

from testfield.camera.pose import Poses
from testfield.reconstruct.points import Points
from testfield.registry import find
from testfield.scene.frames import camera_looking
from testfield.score.acceptance import measured
from testfield.statistics.consistency import decorrelated, pit_uniformity


# ------------------------------------------------------------------ 3.3
def test_a_length_between_uncertain_points_is_too_long_by_its_second_order() -> None:
    """E|V - Q| - L = s^2 / L: 1e-5 mm for s = 0.1 mm and L = 1 m, by Gauss and Hermite over the error's components."""
    L, s = 1000.0, 0.1
    node, weight = np.polynomial.hermite_e.hermegauss(7)
    grid = np.stack(np.meshgrid(node, node, node, indexing="ij"), -1).reshape(-1, 3)
    mass = np.einsum("i,j,k->ijk", *3 * [weight / weight.sum()]).ravel()
    ends = np.vstack([np.zeros(3), [L, 0, 0] + s * grid])
    n = len(ends)
    points = Points(
        method="drawn",
        code=np.arange(n),
        xyz_mm=ends,
        cov_xyz_mm2=np.eye(3 * n),
        rays=np.full(n, 4),
        residual_rms_px=np.zeros(n),
        rejected=np.zeros(n, int),
    )
    lengths = measured(points, [("", 0, k, L, 0.0) for k in range(1, n)])
    assert mass @ lengths.dl_mm == pytest.approx(s**2 / L, rel=1e-4)
    assert mass @ lengths.dl_mm == pytest.approx(1e-5, abs=1e-9)


# ------------------------------------------------------------------ 5.4
def test_the_law_of_true_claims_is_normal_and_that_of_halved_ones_is_not() -> None:
    rng = np.random.default_rng(2)
    A = rng.standard_normal((40, 40))
    cov = A @ A.T
    p = [pit_uniformity(decorrelated(A @ rng.standard_normal(40), cov))[1] for _ in range(400)]
    assert 0.02 < np.mean(np.array(p) < 0.05) < 0.085  # p is uniform, where claims are true
    z = decorrelated(A @ rng.standard_normal(40), cov)
    assert len(z) == 40
    bold = [pit_uniformity(2 * decorrelated(A @ rng.standard_normal(40), cov))[1] for _ in range(100)]
    timid = [pit_uniformity(0.5 * decorrelated(A @ rng.standard_normal(40), cov))[1] for _ in range(100)]
    assert np.mean(np.array(bold) < 0.05) > 0.6 and np.mean(np.array(timid) < 0.05) > 0.4
    assert pit_uniformity(np.zeros(9))[0] == pytest.approx(0.5)


def test_what_a_fit_took_away_is_not_decorrelated() -> None:
    S = np.eye(6) - np.ones((6, 6)) / 6
    z = decorrelated(S @ np.arange(6.0), S)
    assert len(z) == 5 and z @ z == pytest.approx(np.arange(6).var() * 6)


# ------------------------------------------------------------------ 5.5
TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
TRIAD = np.eye(3)


def turned(angle: float) -> np.ndarray:
    """The triad turned about the space diagonal."""
    c, s = np.cos(angle), np.sin(angle)
    K = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3)
    return TRIAD @ (np.eye(3) + s * K + (1 - c) * K @ K).T


@pytest.mark.parametrize(
    ("directions", "q"),
    [
        (np.array([[1, 0, 1], [-1, 0, 1]]) / np.sqrt(2), 0.913),  # 90 degrees: exactly sqrt(5/6), not sqrt(3/4)
        (TETRAHEDRON, 0.61),
        (np.vstack([TRIAD, turned(1.0)]), 0.50),
        (np.vstack([TRIAD, turned(0.7), turned(1.4)]), 0.41),
    ],
)
def test_frasers_factor_is_that_of_isotropic_directions(directions: np.ndarray, q: float) -> None:
    """sigma = q S s with q = sqrt(3 / (2 n)), for the claimed covariance of a point met by n rays."""
    distance, s_px, focal = 4000.0, 0.05, 3000.0
    poses = [camera_looking(distance * d, np.zeros(3), 0.3 * k) for k, d in enumerate(directions)]
    stations = Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), s_px)
    for method in ("gls", "ml", "bundle"):
        points = find("reconstructors", method)(rows, calibration_of(PINHOLE, stations), field)
        found = np.sqrt(np.trace(points.cov_xyz_mm2) / 3) / (distance / focal * s_px)
        n = len(directions)
        assert found == pytest.approx(np.sqrt(5 / 6) if n == 2 else np.sqrt(3 / (2 * n)), rel=1e-5)
        assert found == pytest.approx(q, abs=0.0055)
