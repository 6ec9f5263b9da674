"""Claimed uncertainty against actual, over many draws of noise on true views: no images, so that there can be many."""

from pathlib import Path

import numpy as np
import pytest
from test_truth_in_truth_out import observe

from testfield.calibrate.stitched import stitched
from testfield.detect.observations import Observations
from testfield.reconstruct.gls import gls
from testfield.reconstruct.midpoint import midpoint
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.score.camera import score_boards, score_camera
from testfield.score.points import score_lengths, score_points
from testfield.statistics.consistency import nees_band

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
SIGMA_PX = 0.01


def draw(seed: int) -> tuple[World, Observations]:
    """A world made anew (print errors, lengths, scale) and its observations with noise of known size."""
    from dataclasses import replace

    world = build_world(load_scene(QUICK).model_copy(update={"seed": seed}))
    exact = observe(world, see(world), discs=True)
    noise = SIGMA_PX * np.random.default_rng(seed).standard_normal(exact.xy_px.shape)
    covariance = np.tile(SIGMA_PX**2 * np.eye(2), (len(exact), 1, 1))
    return world, replace(exact, xy_px=exact.xy_px + noise, cov_px2=covariance)


@pytest.mark.parametrize("draws", [8, pytest.param(40, marks=pytest.mark.slow)])
def test_claims_are_true_over_many_draws(draws: int) -> None:
    figures: dict[str, list[float]] = {
        name: [] for name in ("camera", "boards", "gls", "fitted", "midpoint", "check", "control")
    }
    for seed in range(100, 100 + draws):
        world, observations = draw(seed)
        calibration = stitched(observations, world.field, 1280, 1024)
        points = gls(observations, calibration, world.field)
        score = score_points(world, calibration, points)
        figures["camera"].append(score_camera(world, calibration)["interior_anees"])
        figures["boards"].append(score_boards(world, calibration)["anees"])
        figures["gls"].append(score.anees)
        figures["fitted"].append(score.anees_fitted)
        figures["midpoint"].append(
            score_points(world, calibration, midpoint(observations, calibration, world.field)).anees
        )
        for bar in score_lengths(world, calibration, points)["bars"]:
            figures[bar["role"]].append((bar["error_mm"] / bar["u_measured_mm"]) ** 2)
    # Degrees of freedom of one draw; the band holds what is true as often as three standard deviations do.
    freedom = {"camera": 9, "boards": 12, "gls": 24, "fitted": 18, "midpoint": 24, "check": 1, "control": 1}
    for name, of_one in freedom.items():
        low, high = nees_band(draws * of_one, 0.9973)
        assert low < np.mean(figures[name]) < high, name
    # Few draws are enough to see covariances of half the size.
    assert 2 * np.mean(figures["gls"]) > nees_band(draws * freedom["gls"], 0.9973)[1]


def test_midpoint_is_the_point_nearest_to_all_rays() -> None:
    from dataclasses import replace

    from testfield.camera.rays import meet

    world, observations = draw(7)
    plain = replace(observations, centre_of_disc=False)
    calibration = stitched(observations, world.field, 1280, 1024)
    found = midpoint(plain, calibration, world.field)
    ends = [code for bar in world.field.scale_bars if bar.role == "control" for code in bar.codes]
    assert sorted(calibration.point_code) == ends  # these were adjusted with the cameras
    for code, xyz in zip(found.code, found.xyz_mm, strict=True):
        if code in ends:
            continue
        rows = plain.take((plain.code == code) & (plain.board < 0))
        assert np.allclose(xyz, meet(calibration.interior, calibration.stations[rows.station], rows.xy_px), atol=1e-6)


def test_gross_errors_are_rejected_and_leave_no_trace() -> None:
    world, observations = draw(3)
    clean = stitched(observations, world.field, 1280, 1024)
    spoilt = observations.xy_px.copy()
    rng = np.random.default_rng(0)
    rows = rng.choice(np.flatnonzero(observations.board >= 0), 12, replace=False)
    spoilt[rows] += np.array([600, 190, 90, 40, 20, 8, 4, 2, 1, 0.5, 0.2, 0.1])[:, None] * rng.choice([-1, 1], (12, 2))
    from dataclasses import replace

    found = stitched(replace(observations, xy_px=spoilt), world.field, 1280, 1024)
    assert len(found.rejected) >= 12
    assert len(found.residual_px) == len(found.residual_at_px) == found.used == clean.used - len(found.rejected)
    u = np.sqrt(np.diag(clean.covariance)[:9])
    assert np.abs((found.interior.parameters - clean.interior.parameters) / u).max() < 1.5


def test_a_station_may_be_called_like_a_board() -> None:
    from dataclasses import replace

    world, observations = draw(5)
    names = tuple("B" if k == 3 else name for k, name in enumerate(observations.stations))
    a = stitched(observations, world.field, 1280, 1024)
    b = stitched(replace(observations, stations=names), world.field, 1280, 1024)
    assert np.array_equal(
        gls(observations, a, world.field).cov_xyz_mm2,
        gls(replace(observations, stations=names), b, world.field).cov_xyz_mm2,
    )
