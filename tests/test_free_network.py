"""The general bundle: free networks, rigs, several cameras, planes, known points, and what residuals can tell."""

from dataclasses import replace

import numpy as np
import pytest

from testfield.adjust.bundle import Adjustment, adjust, predict
from testfield.adjust.datum import open_motions
from testfield.adjust.network import Camera, Distances, Images, Network, information_of
from testfield.adjust.reliability import global_test, reliability
from testfield.bench.networks import SIGMA_PX, free_network, loose_points
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation
from testfield.errors import TestfieldError
from testfield.scene.frames import camera_looking

POINTS, STATIONS = 40, 12
TURN_AND_SHIFTS = np.eye(6)[:, 2:5]
"""A turn about z, and shifts along x and y: the ways of what stays on a plane with that normal."""
CAMERA = Interior(4096, 3000, np.array([4000.0, 4003, 2040, 1505, -0.1, 0.1, 0.01, 3e-4, -2e-4]))


def loose_network(bar: bool = True) -> Network:
    """Loose points around which twelve stations stand, with a scale bar; everything at its true value."""
    rng = np.random.default_rng(3)
    xyz = rng.uniform([-2000, -1500, -1000], [2000, 1500, 1000], (POINTS, 3))
    poses = []
    for k in range(STATIONS):
        angle = 2 * np.pi * k / STATIONS
        place = np.array([7000 * np.cos(angle), 7000 * np.sin(angle), 2500 * np.sin(3 * angle)])
        poses.append(camera_looking(place, rng.uniform(-200, 200, 3), np.pi / 2 * (k % 4)))
    stations = Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))
    image, point = (v.ravel() for v in np.meshgrid(np.arange(STATIONS), np.arange(POINTS), indexing="ij"))
    network = loose_points(Camera.of(CAMERA), stations, xyz, image, point)
    length = np.linalg.norm(xyz[0] - xyz[1])
    bars = Distances(np.array([[0, 1]]), np.array([length]), np.array([0.02])) if bar else Distances()
    return replace(network, distances=bars)


def labels_of(network: Network) -> list[str]:
    return network.labels(tuple(f"s{k}" for k in range(len(network.stations))), tuple("AB"[: len(network.boards)]))


def noisy(truth: Network, rng: np.random.Generator) -> Network:
    """New pixels and a newly certified bar."""
    xy = truth.xy_px + SIGMA_PX * rng.standard_normal(truth.xy_px.shape)
    bars = truth.distances
    length = bars.length_mm + bars.u_mm * rng.standard_normal(len(bars))
    return replace(truth, xy_px=xy, distances=replace(bars, length_mm=length))


def whole_nees(found: Adjustment, truth: Network, defect: int) -> float:
    """The points' errors over all of them, with their joint covariance, for each degree of freedom."""
    error = (found.network.point_mm - truth.point_mm).ravel()
    cov = found.cov.points(np.arange(len(truth.point_mm)))
    values, vectors = np.linalg.eigh(cov)
    along = vectors[:, defect:].T @ error
    return float((along**2 / values[defect:]).sum() / (len(error) - defect))


@pytest.mark.parametrize("bar, defect", [(True, 6), (False, 7)])
def test_a_free_network_claims_its_points_scatter_by_inner_constraints(bar: bool, defect: int) -> None:
    truth, rng = loose_network(bar), np.random.default_rng(5)
    values = []
    for _ in range(12):
        found = adjust(noisy(truth, rng), labels_of(truth))
        assert found.converged
        # The datum: the points stay on the whole where they started.
        off = found.network.point_mm - truth.point_mm
        assert np.abs(off.mean(axis=0)).max() < 1e-9
        assert np.abs(np.cross(truth.point_mm, off).mean(axis=0)).max() < 1e-5
        values.append(whole_nees(found, truth, defect))
    freedom = 12 * (3 * POINTS - defect)
    assert np.mean(values) == pytest.approx(1, abs=3.5 * np.sqrt(2 / freedom))


def test_open_motions_change_no_image() -> None:
    _, start = free_network(8, 30, seed=4)
    away = replace(start, point_mm=start.point_mm + [300.0, -200.0, 900.0])  # the turns are about the points' middle
    shift = np.einsum("nij,j->ni", away.stations.R, [300.0, -200.0, 900.0])
    away = replace(away, stations=Poses(away.stations.R, away.stations.t_mm - shift))
    by_reduced, by_point = open_motions(away)
    for k in range(by_reduced.shape[1]):
        step = 1e-3 / np.abs(by_point[:, :, k]).max()
        moved = away.moved(step * by_reduced[:, k], step * by_point[:, :, k])
        assert np.abs(predict(moved) - predict(away)).max() < 1e-8


def test_distances_do_not_depend_on_the_datum() -> None:
    truth = loose_network()
    network = noisy(truth, np.random.default_rng(1))
    free = adjust(network, labels_of(truth))
    corner = adjust(network, labels_of(truth), datum_points=np.array([3, 4, 5, 6]))
    a, b = 20, 30
    for pair in ((a, b), (3, 17)):
        u, length = [], []
        for found in (free, corner):
            d = found.network.point_mm[pair[0]] - found.network.point_mm[pair[1]]
            n = d / np.linalg.norm(d)
            gain = np.concatenate([n, -n])
            u.append(gain @ found.cov.points(np.array(pair)) @ gain)
            length.append(np.linalg.norm(d))
        assert length[0] == pytest.approx(length[1], rel=1e-10)
        assert u[0] == pytest.approx(u[1], rel=1e-6)
    # Inner constraints over all points are the datum of the least mean variance.
    assert np.trace(free.cov.points(np.arange(POINTS))) < np.trace(corner.cov.points(np.arange(POINTS)))


def test_covariances_agree_whichever_way_they_are_asked_for() -> None:
    found = adjust(noisy(loose_network(), np.random.default_rng(2)), labels_of(loose_network()))
    points = np.array([0, 1, 7, 30])  # the bar's ends are reduced unknowns, the others are not
    joint = found.cov.points(points)
    blocks = found.cov.point_blocks()
    for k, point in enumerate(points):
        assert np.allclose(joint[3 * k : 3 * k + 3, 3 * k : 3 * k + 3], blocks[point], rtol=1e-7, atol=1e-12)
    size = found.covariance.shape[0]
    everything = found.cov.joint(
        np.vstack([np.eye(size), np.zeros((12, size))]), points, np.vstack([np.zeros((size, 12)), np.eye(12)])
    )
    assert np.allclose(everything[:size, :size], found.covariance, rtol=1e-6, atol=1e-14)
    assert np.allclose(everything[size:, size:], joint, rtol=1e-6, atol=1e-12)
    assert np.allclose(everything[size:, :size], found.cov.across(points), rtol=1e-6, atol=1e-12)


def test_control_points_with_covariance_hold_the_datum() -> None:
    truth = loose_network(bar=False)
    u = np.full((POINTS, 3), np.inf)
    u[:4] = 0.05
    known = replace(truth, information=information_of(u))
    rng, values = np.random.default_rng(4), []
    for _ in range(12):
        off = np.where(np.isfinite(u), 0.05 * rng.standard_normal(u.shape), 0)
        found = adjust(replace(noisy(known, rng), known_mm=truth.point_mm + off), labels_of(known))
        values.append(whole_nees(found, truth, 0))
    assert np.mean(values) == pytest.approx(1, abs=3.5 * np.sqrt(2 / (12 * 3 * POINTS)))


def test_a_rig_of_two_cameras_is_found_with_its_scatter() -> None:
    one = loose_network()
    second = CAMERA.with_parameters(CAMERA.parameters + [30, 25, -12, 9, 0.02, 0, 0, 0, 0])
    image, point = (v.ravel() for v in np.meshgrid(np.arange(2 * STATIONS), np.arange(POINTS), indexing="ij"))
    half = np.arange(STATIONS)
    member = Poses(
        np.stack([np.eye(3), rotation(np.array([0.02, -0.3, 0.05]))]), np.array([[0.0, 0, 0], [800, 20, -30]])
    )
    m = len(image)
    truth = replace(
        one,
        cameras=(Camera.of(CAMERA), Camera.of(second)),
        members=member,
        images=Images(np.concatenate([half, half]), np.repeat([0, 1], STATIONS), np.repeat([0, 1], STATIONS)),
        image=image,
        point=point,
        cov_px2=np.tile(SIGMA_PX**2 * np.eye(2), (m, 1, 1)),
        offset_px=np.zeros((m, 2)),
        xy_px=np.zeros((m, 2)),
    )
    truth = replace(truth, xy_px=predict(truth))
    labels = labels_of(truth)
    rows = [labels.index(name) for name in labels if name.startswith("member:1.")]
    rng, values = np.random.default_rng(6), []
    for _ in range(20):
        rough = noisy(truth, rng)
        rough = replace(rough, members=Poses(member.R, member.t_mm + [[0, 0, 0], [5.0, -4, 3]]))
        found = adjust(rough, labels)
        got = found.network.members
        turn = got.R[1] @ member.R[1].T
        error = np.array([turn[2, 1], turn[0, 2], turn[1, 0], *(got.t_mm[1] - member.t_mm[1])])
        values.append(error @ np.linalg.solve(found.covariance[np.ix_(rows, rows)], error) / 6)
    assert np.mean(values) == pytest.approx(1, abs=3.5 * np.sqrt(2 / 120))


def test_a_board_on_a_plane_stays_on_it() -> None:
    truth = loose_network(bar=False)
    grid = np.stack(np.meshgrid(np.linspace(-500, 500, 5), np.linspace(-400, 400, 4)), -1).reshape(-1, 2)
    local = np.column_stack([grid, np.zeros(20)])
    owner = np.repeat([0, 1], 20)
    boards = Poses(np.stack([np.eye(3), rotation(np.array([0, 0, 0.4]))]), np.array([[-700.0, 0, 0], [700, 200, 0]]))
    truth = replace(
        truth,
        boards=boards,
        ways=(np.zeros((6, 0)), TURN_AND_SHIFTS),
        point_mm=np.vstack([local, local]),
        known_mm=np.vstack([local, local]),
        point_board=owner,
        information=information_of(np.zeros((40, 3))),
    )
    truth = replace(truth, xy_px=predict(truth))
    rough = replace(truth, boards=Poses(boards.R, boards.t_mm + [[0, 0, 0], [20, -10, 0]]))
    labels = labels_of(truth)
    assert sum(name.startswith("board:") for name in labels) == 3
    found = adjust(rough, labels)
    assert np.abs(found.network.boards.t_mm - boards.t_mm).max() < 1e-7
    assert found.network.boards.t_mm[1, 2] == 0
    assert np.abs(found.network.boards.R[1, 2] - [0, 0, 1]).max() < 1e-12


def test_redundancy_sums_to_the_freedom_and_finds_the_gross_error() -> None:
    truth = loose_network()
    network = noisy(truth, np.random.default_rng(8))
    clean = adjust(network, labels_of(truth))
    images = np.einsum("mii->", clean.redundancy)
    assert images == pytest.approx(clean.freedom, abs=1.001)  # the bar takes what is left
    assert global_test(clean).passed
    spoilt = network.xy_px.copy()
    spoilt[77] += [0.6, -0.4]
    found = adjust(replace(network, xy_px=spoilt), labels_of(truth))
    what = reliability(found)
    assert np.argmax(what.test) == 77
    assert what.gross_errors[77]
    assert not global_test(found).passed
    assert what.detectable_px.max() < 0.72  # so this one had to be found


def test_robust_estimation_resists_what_spoils_least_squares() -> None:
    truth = loose_network()
    network = noisy(truth, np.random.default_rng(9))
    spoilt = network.xy_px.copy()
    spoilt[::60] += [3.0, -2.0]
    network = replace(network, xy_px=spoilt)
    plain, robust = (adjust(network, labels_of(truth), robust=choice) for choice in (False, True))
    error = [np.sqrt(((a.network.point_mm - truth.point_mm) ** 2).mean()) for a in (plain, robust)]
    assert error[1] < 0.4 * error[0]
    assert robust.weight[::60].max() < 0.2


def test_a_wrong_datum_turns_this_red() -> None:
    """The S-transformation is not decoration: without it the claimed covariance is that of another frame."""
    truth = loose_network()
    found = adjust(noisy(truth, np.random.default_rng(11)), labels_of(truth))
    held = found.cov.points(np.arange(POINTS))
    found.cov._d, found.cov._shared = 0, found.cov._inverse
    assert np.trace(found.cov.points(np.arange(POINTS))) > 1.02 * np.trace(held)


def test_a_point_seen_once_is_an_error_that_says_so() -> None:
    truth = loose_network()
    lone = truth.take((truth.point != 9) | (truth.image == 0))
    with pytest.raises(TestfieldError, match="not determined"):
        adjust(lone, labels_of(truth))
