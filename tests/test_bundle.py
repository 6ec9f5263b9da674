"""The adjustment: does it find the minimum, is its covariance true, and does it say what it cannot know."""

from dataclasses import replace

import numpy as np
import pytest

from testfield.adjust.bundle import adjust, predict
from testfield.adjust.network import FREE, HELD, Camera, Distances, Images, Network, information_of
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation, rotation_vector
from testfield.errors import TestfieldError
from testfield.scene.frames import camera_looking

NAMES = tuple(f"s{k}" for k in range(8))
BOARDS = ("A", "B")
SIGMA_PX, U_PRINT_MM, U_BAR_MM = 0.02, 0.02, 0.01
U_BAR = np.array([U_BAR_MM])
U_PRINT = np.array([[U_PRINT_MM, U_PRINT_MM, 0]] * 60 + [[0, 0, 0]] * 2)


def true_network(flat: bool = False) -> Network:
    """Two boards and a bar seen by eight stations, everything at its true value, observations exact."""
    g = np.stack(np.meshgrid(np.linspace(-400, 400, 6), np.linspace(-300, 300, 5)), -1).reshape(-1, 2)
    board = np.column_stack([g, np.zeros(len(g))])
    local = np.vstack([board, board, [[-500.0, 420, 80], [480.0, 430, 60]]])
    owner = np.repeat([0, 1, -1], [30, 30, 2])
    u = np.tile([U_PRINT_MM, U_PRINT_MM, 0.0], (62, 1))
    u[60:] = np.inf
    boards = Poses(np.stack([np.eye(3), rotation(np.array([0.5, 0.4, 0.2]))]), np.array([[0, 0, 0], [900.0, 100, 300]]))
    poses = []
    for k in range(8):
        angle = 2 * np.pi * k / 8
        place = np.array([400 + 1500 * np.cos(angle), 1500 * np.sin(angle), 2600.0])
        place = np.array([400 + 30.0 * k, 0, 3000]) if flat else place
        poses.append(camera_looking(place, np.array([400 + 30.0 * k * flat, 0, 100]), 0 if flat else np.pi / 2 * k))
    stations = Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))
    camera = Interior(2448, 2048, np.array([2600, 2601, 1220, 1030, -0.1, 0.1, 0.01, 3e-4, -2e-4]))
    station, point = (v.ravel() for v in np.meshgrid(np.arange(8), np.arange(62), indexing="ij"))
    n = len(station)
    network = Network(
        cameras=(Camera.of(camera),),
        stations=stations,
        images=Images.one_camera(8),
        boards=boards,
        ways=(HELD, FREE),
        point_mm=local,
        point_board=owner,
        known_mm=local,
        information=information_of(u),
        image=station,
        point=point,
        xy_px=np.zeros((n, 2)),
        cov_px2=np.tile(SIGMA_PX**2 * np.eye(2), (n, 1, 1)),
        offset_px=np.zeros((n, 2)),
        distances=Distances(np.array([[60, 61]]), np.linalg.norm(local[60:61] - local[61:], axis=1), U_BAR),
        scale=1.0,
        u_scale=3e-5,
    )
    return replace(network, xy_px=predict(network))


def observed(truth: Network, rng: np.random.Generator) -> Network:
    """A measured network: the boards are made with errors, the bar certified with one, the pixels noisy."""
    made = truth.point_mm + U_PRINT * rng.standard_normal((62, 3))
    scale = 1 + truth.u_scale * rng.standard_normal()
    real = replace(truth, point_mm=made, scale=scale)
    xy = predict(real) + SIGMA_PX * rng.standard_normal(truth.xy_px.shape)
    length = truth.distances.length_mm + U_BAR_MM * rng.standard_normal(1)
    return replace(truth, xy_px=xy, distances=replace(truth.distances, length_mm=length)), scale  # type: ignore[return-value]


def test_exact_observations_are_a_fixed_point_from_a_rough_start() -> None:
    truth = true_network()
    rng = np.random.default_rng(2)
    off = [30, -20, 10, -15, 0.02, -0.02, 0, 0, 0]
    rough = replace(
        truth,
        cameras=(Camera.of(truth.interior.with_parameters(truth.interior.parameters + off)),),
        stations=Poses(
            rotation(rng.normal(0, 0.01, (8, 3))) @ truth.stations.R, truth.stations.t_mm + rng.normal(0, 20, (8, 3))
        ),
    )
    found = adjust(rough, truth.labels(NAMES, BOARDS))
    assert np.allclose(found.network.interior.parameters, truth.interior.parameters, rtol=1e-9, atol=1e-10)
    assert np.abs(found.residual_px).max() < 1e-8
    assert found.chi2 < 1e-8


def test_degrees_of_freedom_count_every_observation_and_unknown() -> None:
    truth = true_network()
    found = adjust(truth, truth.labels(NAMES, BOARDS))
    # 2 x 496 pixels, 1 length, 1 scale prior, 180 coordinates known a priori; 9 + 48 + 6 + 1 + 6 + 180 unknowns
    assert found.freedom == 992 + 1 + 1 + 180 - (9 + 48 + 6 + 1 + 6 + 180)


def test_the_claimed_covariance_is_the_observed_scatter() -> None:
    truth = true_network()
    labels = truth.labels(NAMES, BOARDS)
    rng = np.random.default_rng(8)
    squares, chi2 = [], []
    for _ in range(60):
        network, scale = observed(truth, rng)  # type: ignore[misc]
        found = adjust(network, labels)
        n = found.network
        error = np.concatenate(
            [
                n.interior.parameters - truth.interior.parameters,
                np.column_stack(
                    [
                        rotation_vector(n.stations.R @ np.swapaxes(truth.stations.R, 1, 2)),
                        n.stations.t_mm - truth.stations.t_mm,
                    ]
                ).ravel(),
                rotation_vector(n.boards.R[1:] @ np.swapaxes(truth.boards.R[1:], 1, 2))[0],
                n.boards.t_mm[1] - truth.boards.t_mm[1],
                [n.scale - scale],
                (n.point_mm[60:] - truth.point_mm[60:]).ravel(),
            ]
        )
        squares.append(error @ np.linalg.solve(found.covariance, error) / len(error))
        chi2.append(found.sigma0**2)
    # 60 x 70 degrees of freedom: the mean scatters by 0.022
    assert np.mean(squares) == pytest.approx(1, abs=0.09)
    assert np.mean(chi2) == pytest.approx(1, abs=0.03)


def test_a_view_straight_onto_a_plane_cannot_know_the_focal_length() -> None:
    flat = true_network(flat=True)
    one = replace(
        flat,
        boards=Poses(np.stack([np.eye(3), np.eye(3)]), np.array([[0, 0, 0], [900.0, 0, 0]])),
        distances=Distances(),
    ).take(flat.point < 60)
    one = replace(one, xy_px=predict(one))
    with pytest.raises(TestfieldError, match=r"do not determine fx, station:s\d\.tz"):
        adjust(one, one.labels(NAMES, BOARDS))


def test_what_is_not_determined_is_named() -> None:
    truth = true_network()
    alone = truth.take(truth.image != 3)
    with pytest.raises(TestfieldError, match=r"station:s3\.") as caught:
        adjust(alone, truth.labels(NAMES, BOARDS))
    assert "do not determine" in str(caught.value)


def test_a_weaker_scale_prior_leaves_the_scale_to_the_bar() -> None:
    truth = true_network()
    labels = truth.labels(NAMES, BOARDS)
    at = labels.index("scale")
    with_bar = adjust(truth, labels)
    bar_only = np.sqrt(with_bar.covariance[at, at])
    without = replace(truth, distances=Distances())
    free = adjust(without, without.labels(NAMES, BOARDS))
    assert np.sqrt(free.covariance[at, at]) == pytest.approx(truth.u_scale, rel=0.01)  # nothing else knows it
    assert bar_only < 0.7 * truth.u_scale
