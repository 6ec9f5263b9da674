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
from testfield.reconstruct.estimate import Method, Solved, sandwich, solve
from testfield.reconstruct.gls import all_together
from testfield.reconstruct.midpoint import unweighted
from testfield.reconstruct.ml import REPROJECTION
from testfield.reconstruct.parametric_wls import by_ray
from testfield.reconstruct.sights import Sights, rays_of, sights_of
from testfield.registry import find
from testfield.scene.frames import camera_looking
from testfield.seeds import generator
from testfield.targets.field import Field
from testfield_studies.wls.claims import law, normal_claim

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
    return Calibration(
        method="given",
        interior=interior,
        station_names=names,
        stations=stations,
        board_names=(),
        boards=Poses.identity(0),
        scale=1.0,
        covariance=cov,
        labels=labels,
        sigma0=1.0,
        freedom=1,
        reprojection_rms_px=0.0,
        used=0,
    )


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
        stations=tuple(f"s{k}" for k in range(s)),
        station=station,
        xy_px=px,
        cov_px2=np.tile(sigma_px**2 * np.eye(2), (m, 1, 1)),
        moments_px2=np.tile(np.eye(2), (m, 1, 1)),
        code=point + 1,
        board=np.full(m, -1),
        point=np.full(m, -1),
        chi2=np.ones(m),
        status=np.full(m, MEASURED, object),
        centre_of_disc=False,
    )
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


def test_of_one_point_the_bundle_learns_no_more_than_gls() -> None:
    rng = np.random.default_rng(3)
    stations = around(rng.uniform(3000, 5000, 5), rng)
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.05)
    root = five_cameras_root()
    calibration = calibration_of(PINHOLE, stations, root @ root.T)
    u = {
        method: np.sqrt(np.trace(find("reconstructors", method)(rows, calibration, field).cov_xyz_mm2))
        for method in ("midpoint", "ml", "parametric_wls", "gls", "bundle")
    }
    pixel_only = np.sqrt(
        np.trace(find("reconstructors", "ml")(rows, calibration_of(PINHOLE, stations), field).cov_xyz_mm2)
    )
    assert u["gls"] == pytest.approx(u["bundle"], rel=1e-6)
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

    rng = np.random.default_rng(8)
    stations = around(np.array([2000.0, 9000, 5000]), rng)
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.3)
    calibration = calibration_of(PINHOLE, stations)
    shaken = noisy(rows, 0.3, rng)
    right = settle(sights_of(shaken, calibration, field), calibration, Method("m", unweighted))
    wrong = settle(
        sights_of(shaken, calibration, field),
        calibration,
        Method("m", lambda s, r, c: unweighted(s, r, c) / r.depth_mm[..., None, None] ** 2),
    )
    assert np.abs(right.xyz_mm - wrong.xyz_mm).max() > 0.01


def test_derivatives_by_the_calibration_are_those_of_the_projection() -> None:
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


def many_times(
    stations: Poses, sigma_px: float, trials: int, rng: np.random.Generator, root: np.ndarray | None = None
) -> Sights:
    """Sights of the origin, as often as there are `trials`, by cameras that are not quite what they are taken for:
    `root` (P, r) is one of the calibration's covariance. A trial is a point, so that one call does them all."""
    rows, field = seen(PINHOLE, stations, np.zeros((trials, 3)), sigma_px)
    s = len(stations)
    t, interior = stations.t_mm[:, None], np.zeros((1, trials, 9))
    if root is not None:
        off = rng.standard_normal((trials, root.shape[1])) @ root.T
        # The origin lies at t in the camera's frame, whichever way the camera is turned about it.
        t, interior = t + np.moveaxis(off[:, 9:].reshape(trials, s, 6)[..., 3:], 1, 0), interior + off[None, :, :9]
    at = np.broadcast_to(t, (s, trials, 3))
    xy = (PINHOLE.parameters[:2] + interior[..., :2]) * at[..., :2] / at[..., 2:]
    xy = xy + PINHOLE.parameters[2:4] + interior[..., 2:4]
    shaken = noisy(replace(rows, xy_px=xy.reshape(-1, 2)), sigma_px, rng)
    return sights_of(shaken, calibration_of(PINHOLE, stations), field)


RULES = {
    "midpoint": Method("midpoint", unweighted),
    "ml": REPROJECTION,
    "parametric_wls": Method("parametric_wls", by_ray),
    "gls": Method("gls", all_together),
}


def solved_with(name: str, sights: Sights, calibration: Calibration) -> tuple[Solved, np.ndarray]:
    """Points, with the sandwich covariance (n, 3, 3) of each."""
    found = solve(sights, calibration, RULES[name])
    own, by_calibration = sandwich(found)
    by_calibration = by_calibration.reshape(len(own), 3, -1)
    return found, own + by_calibration @ calibration.covariance @ by_calibration.swapaxes(1, 2)


def rmse(xyz_mm: np.ndarray) -> float:
    return float(np.sqrt((xyz_mm**2).sum(axis=1).mean()))


def predicted(covariance: np.ndarray) -> float:
    return float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean()))


def nees(xyz_mm: np.ndarray, covariance: np.ndarray) -> float:
    return float(np.einsum("ni,ni->", xyz_mm, np.linalg.solve(covariance, xyz_mm[..., None])[..., 0]) / xyz_mm.size)


def test_least_squares_over_points_and_depths_is_the_midpoint() -> None:
    """METHODS section 1.2: no less than the thesis' own problem, unknowns X and t_1 to t_n, solved as it stands."""
    rng = np.random.default_rng(20)
    stations = around(rng.uniform(2000, 12000, 6), rng)
    sights = many_times(stations, 0.3, 5, rng)
    found, _ = solved_with("midpoint", sights, calibration_of(PINHOLE, stations))
    plane = (sights.xy_px - PINHOLE.parameters[2:4]) / PINHOLE.parameters[:2]
    d = np.einsum("kji,nkj->nki", stations.R, np.concatenate([plane, np.ones((5, 6, 1))], axis=-1))
    scales = rng.uniform(0.3, 3, (5, 6, 1))  # of directions, which must not matter
    for point, scaled in enumerate(d * scales):
        equations = np.zeros((18, 9))
        for k in range(6):
            equations[3 * k : 3 * k + 3, :3] = np.eye(3)
            equations[3 * k : 3 * k + 3, 3 + k] = -scaled[k] * 1000
        x = np.linalg.lstsq(equations, stations.origin_mm.ravel())[0]
        assert np.abs(x[:3] - found.xyz_mm[point]).max() < 1e-9  # METHODS: 2e-11


def test_an_error_along_the_projection_matrix_itself_is_none() -> None:
    """METHODS section 1.3: a calibration's error moves a line by L dP X, and dP = alpha P by nothing, so that it does
    not matter how P is scaled."""
    rng = np.random.default_rng(21)
    stations = around(rng.uniform(2000, 9000, 4), rng)
    xyz = rng.uniform(-300, 300, (3, 3))
    rows, field = seen(PINHOLE, stations, xyz, 0.05)
    calibration = calibration_of(PINHOLE, stations)
    rays = rays_of(sights_of(rows, calibration, field), calibration, xyz)

    def matrices(theta: np.ndarray) -> np.ndarray:
        fx, fy, cx, cy = PINHOLE.parameters[:4] + theta[:4]
        six = theta[9:].reshape(-1, 6)
        t = stations.t_mm + six[:, 3:]
        R = rotation(six[:, :3]) @ stations.R
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]) @ np.concatenate([R, t[..., None]], axis=2)

    off = rng.standard_normal(len(calibration.labels)) * np.concatenate([np.ones(4), np.zeros(5), np.full(24, 1e-3)])
    step = 1e-4
    P, dP = matrices(0 * off), (matrices(step * off) - matrices(-step * off)) / (2 * step)
    X = np.concatenate([xyz, np.ones((3, 1))], axis=1)
    image = np.einsum("kij,nj->nki", P, X)
    L = np.zeros((3, 4, 2, 3))
    L[..., :2], L[..., 2] = np.eye(2), -image[..., :2] / image[..., 2:]
    by_lines = np.einsum("nkij,nkjp,p->nki", rays.to_line, rays.by_calibration, off) * PINHOLE.parameters[:2]
    for alpha in (0.0, 7.0, -1e-3):
        by_matrix = np.einsum("nkij,kjl,nl->nki", L, dP + alpha * P, X)
        assert np.allclose(by_matrix, by_lines, rtol=1e-6, atol=1e-5 * np.abs(by_lines).max())
    assert not np.allclose(np.einsum("nkij,kjl,nl->nki", L, dP + [0, 0, 0, 1e-3] * P, X), by_lines, rtol=1e-3)


def test_of_two_cameras_only_the_normal_of_the_epipolar_plane_gains() -> None:
    """METHODS section 1.7: by 4 s1^2 s2^2 / (s1^2 + s2^2)^2 in variance there, and by nothing elsewhere."""
    rng = np.random.default_rng(22)
    stations = looking(np.array([[1500.0, 0, -1500], [-6000, 900, -7000]]))
    calibration = calibration_of(PINHOLE, stations)
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.3)
    exact = sights_of(rows, calibration, field)
    wide, narrow = (solved_with(name, exact, calibration)[1][0] for name in ("midpoint", "parametric_wls"))
    a, b = stations.origin_mm
    normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
    plane = np.linalg.svd(normal[None])[2][1:]
    s1, s2 = (a @ a) ** 0.5, (b @ b) ** 0.5
    expected = 4 * s1**2 * s2**2 / (s1**2 + s2**2) ** 2
    assert expected < 0.2
    assert (normal @ narrow @ normal) / (normal @ wide @ normal) == pytest.approx(expected, rel=1e-6)
    assert np.allclose(plane @ wide @ plane.T, plane @ narrow @ plane.T, rtol=1e-6, atol=1e-9)
    sights = many_times(stations, 0.3, 400, rng)
    ols, wls = (solved_with(name, sights, calibration)[0].xyz_mm for name in ("midpoint", "parametric_wls"))
    along = np.sqrt((((wls - ols) @ normal) ** 2).sum() / ((wls - ols) ** 2).sum())
    assert along > 0.99999  # METHODS: 0.999997


MADE_KNOWN = {2: (1.454, 1.384), 4: (0.752, 0.687), 8: (0.495, 0.309), 16: (0.360, 0.250)}
"""By number of cameras at 2 to 12 m what OLS and WLS are to reach in mm (METHODS section 1.7, 0.3 px, f = 3000 px)."""


@pytest.mark.parametrize("cameras", MADE_KNOWN)
def test_errors_at_2_to_12_m_are_those_of_the_covariances_and_of_the_methods_page(cameras: int) -> None:
    """In which directions its cameras stood the page does not say, so its figures are looked for among placements:
    within a tenth of them both, and there errors are those of the covariances, NEES is one. ML in place of WLS moves
    the points by 3e-5 to 2e-4 mm, as section 1.5 has it (6e-5 to 2e-4 mm there)."""
    rng = np.random.default_rng(30 + cameras)
    nearest, off = None, np.inf
    for _ in range(150):
        stations = around(rng.uniform(2000, 12000, cameras), rng)
        calibration = calibration_of(PINHOLE, stations)
        rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.3)
        sights = sights_of(rows, calibration, field)
        reached = [predicted(solved_with(name, sights, calibration)[1]) for name in ("midpoint", "parametric_wls")]
        assert reached[1] <= reached[0] * (1 + 1e-9)  # Gauss and Markov
        apart = np.abs(np.log(np.divide(reached, MADE_KNOWN[cameras]))).max()
        nearest, off = (stations, apart) if apart < off else (nearest, off)
    assert nearest is not None and off < 0.1
    calibration = calibration_of(PINHOLE, nearest)
    sights = many_times(nearest, 0.3, 3000, rng)
    xyz = {}
    for name in ("midpoint", "parametric_wls", "ml"):
        found, covariance = solved_with(name, sights, calibration)
        xyz[name] = found.xyz_mm
        assert rmse(found.xyz_mm) == pytest.approx(predicted(covariance), rel=0.04)
        assert nees(found.xyz_mm, covariance) == pytest.approx(1, abs=0.05)
    assert 1e-5 < rmse(xyz["ml"] - xyz["parametric_wls"]) < 4e-4


def test_the_law_of_many_cameras() -> None:
    """METHODS section 1.7: sqrt(<L^2> <1/L^2>) is 1.546 for ranges even from 2 to 12 m, and 400 cameras reach it."""
    rng = np.random.default_rng(40)
    ranges = rng.permutation(np.linspace(2000, 12000, 401)[:-1] + 12.5)
    stations = around(ranges, rng)
    gain, cameras = law(ranges[None], np.ones((1, 400), bool))
    assert gain == pytest.approx(1.546, abs=1e-3) and cameras > 100
    calibration = calibration_of(PINHOLE, stations)
    rows, field = seen(PINHOLE, stations, np.zeros((1, 3)), 0.3)
    sights = sights_of(rows, calibration, field)
    ols, wls = (predicted(solved_with(name, sights, calibration)[1]) for name in ("midpoint", "parametric_wls"))
    assert ols / wls == pytest.approx(gain, rel=0.02)


def test_errors_of_uncertain_cameras_are_those_of_the_covariances() -> None:
    """The row of METHODS section 1.7 with a random 12x12 covariance of each matrix that makes 42 % of the variance:
    OLS 0.4405 of 0.4413 mm, WLS 0.4047 of 0.4074, NEES 0.994 and 0.985.

    Here a camera has no twelve numbers of its own: the interior is one for all. So the poses' six have a random 6x6
    covariance each, and the RMSE are others than there; that they are what the covariances say is the same.
    """
    rng = np.random.default_rng(41)
    stations = around(rng.uniform(2000, 12000, 8), rng)
    root = np.zeros((57, 48))
    for k in range(8):
        scale = np.array([1, 1, 1, 4000, 4000, 4000])[:, None]
        root[9 + 6 * k : 15 + 6 * k, 6 * k : 6 * k + 6] = 9.15e-5 * scale * rng.standard_normal((6, 6))
    calibration = calibration_of(PINHOLE, stations, root @ root.T)
    sights = many_times(stations, 0.3, 3000, rng, root)
    reached = []
    for name in ("midpoint", "parametric_wls"):
        found, covariance = solved_with(name, sights, calibration)
        reached.append(predicted(covariance))
        assert rmse(found.xyz_mm) == pytest.approx(reached[-1], rel=0.04)
        assert nees(found.xyz_mm, covariance) == pytest.approx(1, abs=0.05)
    own = predicted(sandwich(found)[0])
    assert 1 - (own / reached[1]) ** 2 == pytest.approx(0.42, abs=0.05)
    assert reached[1] < reached[0]
    # Rays are independent, so what the weights claim by themselves is true.
    assert predicted(normal_claim(found, calibration)) == pytest.approx(reached[1], rel=1e-9)


def test_ignoring_what_cameras_share_costs_what_the_methods_page_says() -> None:
    """The table of METHODS section 1.6: five cameras, f, cx, cy shared and uncertain, 3000 runs. Its page does not say
    where they stood; with these directions and ranges, looked for, every figure of it is reached within 2 %."""
    azimuth, elevation = np.radians([[-2.7, 26.1, -20.2, -14.7, -14.8], [34, 9.5, 33.8, 25.5, 8.3]])
    towards = [np.sin(azimuth) * np.cos(elevation), np.sin(elevation), -np.cos(azimuth) * np.cos(elevation)]
    stations = looking(np.array([2252.0, 2078, 2709, 3370, 4964])[:, None] * np.transpose(towards))
    root = five_cameras_root()
    calibration = calibration_of(PINHOLE, stations, root @ root.T)
    sights = many_times(stations, 0.05, 3000, np.random.default_rng(42), root)
    reached = {}
    for name, sandwich_mm in (("midpoint", 4.025), ("ml", 3.552), ("parametric_wls", 3.568), ("gls", 1.225)):
        found, covariance = reached[name] = solved_with(name, sights, calibration)
        assert predicted(covariance) == pytest.approx(sandwich_mm, rel=0.02)
        assert rmse(found.xyz_mm) == pytest.approx(sandwich_mm, rel=0.04)
        assert nees(found.xyz_mm, covariance) == pytest.approx(1, abs=0.06)
    (ml, _), (wls, _) = reached["ml"], reached["parametric_wls"]
    for found, claim, claimed_mm, wrong in (
        (ml, sandwich(ml)[0], 0.064, 3957),
        (wls, normal_claim(wls, calibration), 2.669, 2.29),
    ):
        assert predicted(claim) == pytest.approx(claimed_mm, rel=0.02)
        assert nees(found.xyz_mm, claim) == pytest.approx(wrong, rel=0.05)


def five_cameras_root() -> np.ndarray:
    """(39, 39), a root of the covariance of METHODS section 1.6: f, cx, cy of 3, 2, 2 px for all cameras, and poses of
    0.1 mrad, which leaves the origin where it is, and 0.5 mm."""
    root = np.diag(np.concatenate([[3, 0, 2, 2, 0, 0, 0, 0, 0], np.tile([1e-4] * 3 + [0.5] * 3, 5)]))
    root[1, 0] = 3
    return root


def looking(places_mm: np.ndarray) -> Poses:
    """Upright cameras at these places (n, 3), looking at the origin."""
    poses = [camera_looking(place, np.zeros(3), 0.0) for place in places_mm]
    return Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))
