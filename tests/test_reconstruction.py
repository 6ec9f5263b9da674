"""Reconstruction methods against closed forms, against each other, and their covariances against scatter."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from testfield.calibrate.calibration import Calibration
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation
from testfield.camera.project import project, project_with_jacobian
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.estimate import Method
from testfield.registry import find
from testfield.scene.frames import camera_looking
from testfield.seeds import generator
from testfield.targets.field import Field

HAS_COLMAP = importlib.util.find_spec("pycolmap") is not None
METHODS = (
    "midpoint",
    "dlt",
    "dlt_p34",
    "parametric_wls",
    "gls",
    "ml",
    "bundle",
    "opencv",
    *(["colmap"] if HAS_COLMAP else []),
)
PINHOLE = Interior(4000, 3000, np.array([3000.0, 3000, 1999.5, 1499.5, 0, 0, 0, 0, 0]))
BENT = PINHOLE.with_parameters(np.array([3000.0, 3010, 2010, 1490, -0.1, 0.05, 0.01, 3e-4, -2e-4]))


def calibration_of(interior: Interior, stations: Poses, covariance: np.ndarray | None = None) -> Calibration:
    """Cameras known with a covariance of interior (9) and stations (6 each), exactly if not given."""
    names = tuple(f"s{k}" for k in range(len(stations)))
    axes = ("rx", "ry", "rz", "tx", "ty", "tz")
    labels = (*interior.names, *(f"station:{s}.{axis}" for s in names for axis in axes))
    cov = np.zeros((len(labels), len(labels))) if covariance is None else covariance
    return Calibration("given", interior, names, stations, (), Poses.identity(0), 1.0, cov, labels, 1.0, 1, 0.0, 0)


def around(distances: np.ndarray, rng: np.random.Generator) -> Poses:
    """Cameras in random directions at given distances (n,), looking at the origin."""
    d = rng.standard_normal((len(distances), 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    poses = [camera_looking(p, np.zeros(3), rng.uniform(0, 6)) for p in d * distances[:, None]]
    return Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))


def seen(interior: Interior, stations: Poses, xyz: np.ndarray, sigma_px: float) -> tuple[Observations, Field]:
    """Exact sights of all points from all stations."""
    s, n = len(stations), len(xyz)
    station, point = np.repeat(np.arange(s), n), np.tile(np.arange(n), s)
    px = project(interior, stations[station], xyz[point])
    m = s * n
    rows = Observations(
        tuple(f"s{k}" for k in range(s)), station, px, np.tile(sigma_px**2 * np.eye(2), (m, 1, 1)),
        np.tile(np.eye(2), (m, 1, 1)), point + 1, np.full(m, -1), np.full(m, -1), np.ones(m),
        np.full(m, MEASURED, object), centre_of_disc=False,
    )  # fmt: skip
    return rows, Field(14, (), (), {k + 1: 10.0 for k in range(n)})


def noisy(rows: Observations, sigma_px: float, rng: np.random.Generator) -> Observations:
    return replace(rows, xy_px=rows.xy_px + sigma_px * rng.standard_normal(rows.xy_px.shape))


def test_two_cameras_have_the_precision_of_the_closed_form() -> None:
    half, L = np.radians(30), 4000.0
    poses = [camera_looking(L * np.array([s * np.sin(half), 0, -np.cos(half)]), np.zeros(3), 0.0) for s in (-1, 1)]
    stations = Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.1)
    for method in ("midpoint", "gls", "ml", "parametric_wls", "dlt"):
        points = find("reconstructors", method)(rows, calibration_of(PINHOLE, stations), field)
        u = np.sqrt(np.diag(points.cov_xyz_mm2))
        assert u == pytest.approx([0.1088662, 0.0942809, 0.1885618], abs=2e-7)  # METHODS section 1.7


@pytest.mark.parametrize("method", METHODS)
def test_exact_rays_meet_in_the_point(method: str) -> None:
    rng = np.random.default_rng(1)
    xyz = rng.uniform(-300, 300, (20, 3))
    stations = around(rng.uniform(2000, 9000, 6), rng)
    rows, field = seen(BENT, stations, xyz, 0.05)
    dropped = rows.take(~((rows.code == 4) & (rows.station > 1)))  # one point with two rays only
    points = find("reconstructors", method)(dropped, calibration_of(BENT, stations), field)
    assert np.abs(points.xyz_mm - xyz).max() < 1e-7
    assert points.rays[3] == 2
    assert points.rays[4] == 6


@pytest.mark.parametrize("method", METHODS)
def test_claimed_covariance_is_the_scatter_with_calibration_error_and_all(method: str) -> None:
    rng = np.random.default_rng(2)
    xyz = rng.uniform(-300, 300, (12, 3))
    stations = around(rng.uniform(2000, 7000, 5), rng)
    rows, field = seen(BENT, stations, xyz, 0.05)
    # The case of METHODS section 1.6: f, cx, cy shared and uncertain, poses to 0.1 mrad and 0.5 mm.
    sigma = np.concatenate([[3, 3, 2, 2, 0, 0, 0, 0, 0], np.tile([1e-4] * 3 + [0.5] * 3, 5)])
    # A gain found by moving rays is true to first order only, which is not enough where rays miss by 60 sigma.
    sigma = sigma * (0.1 if method in ("opencv", "colmap") else 1.0)
    covariance = np.diag(sigma**2)
    covariance[0, 1] = covariance[1, 0] = sigma[0] ** 2
    values = []
    values_, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values_, 0))
    for _ in range(60):
        off = root @ rng.standard_normal(len(sigma))
        six = off[9:].reshape(-1, 6)
        moved = Poses(rotation(six[:, :3]) @ stations.R, stations.t_mm + six[:, 3:])
        wrong = calibration_of(BENT.with_parameters(BENT.parameters + off[:9]), moved, covariance)
        points = find("reconstructors", method)(noisy(rows, 0.05, rng), wrong, field)
        error = (points.xyz_mm - xyz).ravel()
        values.append(error @ np.linalg.solve(points.cov_xyz_mm2, error) / 36)
    assert np.mean(values) == pytest.approx(1, abs=3.5 * np.sqrt(2 / (60 * 36)) + 0.02)


def test_ignoring_what_cameras_share_costs_what_the_methods_page_says() -> None:
    """Claimed by block-diagonal weights, N^-1, the chi-squared is wrong by two or more; GLS is right, and better."""
    rng = np.random.default_rng(3)
    stations = around(rng.uniform(3000, 5000, 5), rng)
    xyz = np.zeros((1, 3))
    rows, field = seen(PINHOLE, stations, xyz, 0.05)
    sigma = np.concatenate([[3, 3, 2, 2, 0, 0, 0, 0, 0], np.tile([1e-4] * 3 + [0.5] * 3, 5)])
    covariance = np.diag(sigma**2)
    covariance[0, 1] = covariance[1, 0] = 9.0
    calibration = calibration_of(PINHOLE, stations, covariance)
    u = {
        method: np.sqrt(np.trace(find("reconstructors", method)(rows, calibration, field).cov_xyz_mm2))
        for method in ("midpoint", "ml", "parametric_wls", "gls", "bundle")
    }
    pixel_only = np.sqrt(
        np.trace(find("reconstructors", "ml")(rows, calibration_of(PINHOLE, stations), field).cov_xyz_mm2)
    )
    assert u["gls"] == pytest.approx(u["bundle"], rel=1e-6)  # of one point there is nothing more to learn
    assert u["gls"] < 0.8 * u["parametric_wls"]
    assert u["parametric_wls"] <= 1.001 * u["midpoint"]
    assert pixel_only < 0.1 * u["ml"]  # a chi-squared of hundreds for who claims that


@pytest.mark.parametrize("cameras", [2, 4, 8, 16])
def test_weighting_gains_with_spread_ranges_what_the_law_predicts(cameras: int) -> None:
    rng = np.random.default_rng(cameras)
    claimed: dict[str, list[float]] = {"midpoint": [], "parametric_wls": []}
    observed: dict[str, list[float]] = {"midpoint": [], "parametric_wls": []}
    for _ in range(60):
        stations = around(rng.uniform(2000, 12000, cameras), rng)
        d = stations.origin_mm / np.linalg.norm(stations.origin_mm, axis=1, keepdims=True)
        if cameras == 2 and abs(d[0] @ d[1]) > 0.8:
            continue
        rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.3)
        shaken = noisy(rows, 0.3, rng)
        for method in claimed:
            points = find("reconstructors", method)(shaken, calibration_of(PINHOLE, stations), field)
            claimed[method].append(np.trace(points.cov_xyz_mm2))
            observed[method].append((points.xyz_mm**2).sum())
    gain = np.sqrt(np.sum(claimed["midpoint"]) / np.sum(claimed["parametric_wls"]))
    for method in claimed:
        # About 150 degrees of freedom each.
        assert np.sum(observed[method]) / np.sum(claimed[method]) == pytest.approx(1, abs=0.35)
    if cameras == 2:
        assert 1 <= gain < 1.2  # one redundant observation, square to the epipolar plane
    elif cameras == 16:
        assert 1.35 < gain < 1.75  # sqrt(<L^2> <1/L^2>) = 1.546
    assert gain >= 1


def test_equal_ranges_gain_nothing_however_many_cameras() -> None:
    rng = np.random.default_rng(5)
    stations = around(np.full(16, 5000.0), rng)
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.3)
    u = [
        np.trace(find("reconstructors", m)(rows, calibration_of(PINHOLE, stations), field).cov_xyz_mm2)
        for m in ("midpoint", "parametric_wls", "gls", "ml")
    ]
    assert np.allclose(u, u[0], rtol=1e-6)


def test_many_points_teach_the_bundle_of_the_cameras() -> None:
    rng = np.random.default_rng(6)
    xyz = rng.uniform(-800, 800, (60, 3))
    stations = around(rng.uniform(3000, 5000, 6), rng)
    rows, field = seen(PINHOLE, stations, xyz, 0.02)
    sigma = np.concatenate([[3, 3, 2, 2, 0, 0, 0, 0, 0], np.tile([1e-4] * 3 + [0.5] * 3, 6)])
    calibration = calibration_of(PINHOLE, stations, np.diag(sigma**2))
    a, b = (find("reconstructors", m)(rows, calibration, field) for m in ("gls", "bundle"))
    lengths = [p.distance(0, 1)[1] for p in (a, b)]
    assert lengths[1] < 0.6 * lengths[0]


def test_the_wrong_ray_is_rejected_whichever_it_is() -> None:
    rng = np.random.default_rng(7)
    xyz = rng.uniform(-300, 300, (10, 3))
    stations = around(rng.uniform(3000, 5000, 6), rng)
    rows, field = seen(BENT, stations, xyz, 0.05)
    rows = noisy(rows, 0.05, rng)
    rows.xy_px[np.flatnonzero(rows.code == 3)[4]] += [4.0, -3]
    for method in METHODS:
        points = find("reconstructors", method)(rows, calibration_of(BENT, stations), field)
        assert points.rejected[2] == 1
        assert points.rejected.sum() == 1
        assert np.abs(points.xyz_mm[2] - xyz[2]).max() < 1.0


def test_a_gain_without_depth_turns_this_red() -> None:
    """Unweighted lines on the plane before the lens forget that far cameras see worse: they are not the midpoint."""
    from testfield.reconstruct.estimate import settle
    from testfield.reconstruct.midpoint import unweighted
    from testfield.reconstruct.sights import sights_of

    rng = np.random.default_rng(8)
    stations = around(np.array([2000.0, 9000, 5000]), rng)
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.3)
    calibration = calibration_of(PINHOLE, stations)
    shaken = noisy(rows, 0.3, rng)
    right = settle(sights_of(shaken, calibration, field), calibration, Method("m", unweighted))
    wrong = settle(
        sights_of(shaken, calibration, field), calibration,
        Method("m", lambda s, r, c: unweighted(s, r, c) / r.depth_mm[..., None, None] ** 2),
    )  # fmt: skip
    assert np.abs(right.xyz_mm - wrong.xyz_mm).max() > 0.01


def test_derivatives_by_the_calibration_are_those_of_the_projection() -> None:
    from testfield.reconstruct.sights import rays_of, sights_of

    rng = np.random.default_rng(9)
    stations = around(rng.uniform(3000, 5000, 3), rng)
    xyz = rng.uniform(-300, 300, (4, 3))
    rows, field = seen(BENT, stations, xyz, 0.05)
    calibration = calibration_of(BENT, stations)
    rays = rays_of(sights_of(rows, calibration, field), calibration, xyz)
    for s in range(3):
        _, jacobian = project_with_jacobian(BENT, stations[np.full(4, s)], xyz)
        assert np.allclose(rays.by_calibration[:, s, :, :9], jacobian.interior)
        assert np.allclose(rays.by_calibration[:, s, :, 9 + 6 * s : 12 + 6 * s], jacobian.rotation)
        assert np.allclose(rays.by_calibration[:, s, :, 12 + 6 * s : 15 + 6 * s], jacobian.camera_point)


@pytest.mark.parametrize("method", ["gls", "parametric_wls", "bundle"])
def test_a_worthless_calibration_is_named_and_not_a_singular_matrix(method: str) -> None:
    stations = around(np.full(4, 3000.0), generator(5, "worthless"))
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.1)
    worthless = calibration_of(PINHOLE, stations, -1e6 * np.eye(33))  # lost to rounding
    with pytest.raises(TestfieldError, match=r"reconstructor (gls|parametric_wls)"):
        find("reconstructors", method)(rows, worthless, field)
