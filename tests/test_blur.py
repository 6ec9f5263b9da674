"""Blur of optics, defocus and motion: as physics says, alike in both renderers, and known to the truth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from testfield.camera.motion import Motion, Twist
from testfield.camera.optics import Optics, blur_circle_px, entrance_pupil_mm
from testfield.certify import focus
from testfield.certify.light import block_means, board_pixels
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance, compute_irradiance
from testfield.render.path import render_path
from testfield.render.psf import diffraction_mtf, point_spread
from testfield.render.shots import shots
from testfield.render.stage import build_stage
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.truth import see
from testfield.scene.world import World

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
SLIDE = Twist(velocity_mm_s=(90.0, 40.0, 0.0), angular_velocity_rad_s=(0.0, 0.0, 0.05))


@pytest.fixture(scope="module")
def world() -> World:
    return build_world(load_scene(QUICK))


def small(world: World) -> World:
    """A quarter of the size, and of the second station's image the columns with boards in them."""
    first, columns = 104, 120
    parameters = world.interior.parameters * ([0.25] * 4 + [1] * 5) - first * np.eye(9)[2]
    interior = replace(world.interior, width_px=columns, height_px=256, parameters=parameters)
    return replace(world, interior=interior, psf_sigma_px=0.0)


def test_a_thin_lens_focused_far_away_has_the_pupil_of_its_f_number() -> None:
    assert entrance_pupil_mm(50.0, 2.0, 1e9) == pytest.approx(25.0)
    # Gauss: 50 mm of principal distance at 1 m is a focal length of 47.6 mm.
    assert entrance_pupil_mm(50.0, 2.0, 1000.0) == pytest.approx(1 / (1 / 50 + 1 / 1000) / 2)
    # A textbook case: f = 50 mm, f/2, focused at 2 m, a point at 4 m: 0.3205 mm on the sensor.
    c = 1 / (1 / 50 - 1 / 2000)
    optics = Optics(entrance_pupil_mm(c, 2.0, 2000.0), 2000.0)
    assert blur_circle_px(optics, c / 0.005, np.array([4000.0]))[0] * 0.005 == pytest.approx(0.320513, abs=1e-6)


def test_the_edge_behind_a_diffracting_aperture_is_the_integral_of_its_mtf() -> None:
    airy = 1.1
    spread = point_spread(2, 0.3, airy)
    n, m = spread.cells, spread.margin
    columns = 61
    at = 30.2  # the edge, in px
    left = (np.arange((columns + 2 * m) * n) / n) - m - 0.5
    cells = np.clip((left + 1 / n - at) * n, 0, 1)
    rows = 3
    image = spread.weigh(np.tile(cells.astype(np.float32), ((rows + 2 * m) * n, 1)), rows, columns)[1]

    def passed(f: float) -> float:
        return float(diffraction_mtf(np.array(f), airy) * np.exp(-2 * np.pi**2 * 0.09 * f * f) * np.sinc(f))

    def level(x: float) -> float:
        return 0.5 + quad(lambda f: passed(f) * np.sin(2 * np.pi * f * x) / (np.pi * f), 1e-9, 1 / airy, limit=400)[0]

    expected = np.array([level(x - at) for x in range(columns)])
    # Light diffracted beyond 32 px is left out: 2 airy / (pi^2 32) of it; but for that, the profile is the same.
    kept = ((expected - 0.5) @ (image - 0.5)) / ((image - 0.5) @ (image - 0.5))
    assert 1 - kept < 2 * airy / (np.pi**2 * 32)
    near = np.abs(np.arange(columns) - at) < 4
    assert np.abs(kept * (image - 0.5) - (expected - 0.5))[near].max() < 2e-3
    # A lens of half the aperture is told apart.
    blunt = point_spread(2, 0.3, 2 * airy).weigh(np.tile(cells.astype(np.float32), ((1 + 2 * m) * n, 1)), 1, columns)[0]
    assert np.abs(blunt - expected)[near].max() > 0.05


def test_blur_moves_nothing_by_itself(world: World) -> None:
    blurred = replace(world, optics=Optics(5.0, 2000.0), motion=Motion(camera=SLIDE, exposure_s=0.01))
    found = shots(blurred, 0, 64)
    assert 8 < len(found) <= 64
    assert np.abs(found.mean(axis=0)).max() < 1e-15
    assert (found[:, :2] ** 2).mean(axis=0) == pytest.approx([2.5**2 / 4] * 2, rel=1e-12)
    assert (found[:, 2] ** 2).mean() == pytest.approx(0.01**2 / 12, rel=1 / len(found) ** 2)
    assert np.array_equal(shots(world, 0, 64), np.zeros((1, 3)))


@pytest.mark.parametrize(
    "motion",
    [
        Motion(camera=SLIDE, exposure_s=0.03),
        Motion(target=SLIDE, exposure_s=0.03),
        Motion(camera=SLIDE, exposure_s=0.01, row_s=3e-5),
    ],
    ids=["camera moves", "target moves", "rolling shutter"],
)
def test_the_truth_of_what_moves_is_where_its_image_is(motion: Motion) -> None:
    still = focus._dots(3, 0.5)
    moving = replace(still, motion=motion)
    light = Irradiance.even(len(still.panels), np.pi)
    found = focus._Moments(moving, light).first
    assert np.sqrt(np.mean((found - see(moving).disc_px[0]) ** 2)) < 0.002
    # That the world moves must show: the truth of the still world is not where the images are.
    if motion.row_s:
        assert np.sqrt(np.mean((found - see(still).disc_px[0]) ** 2)) > 0.2


@pytest.mark.slow  # the limits of focus and motion below need one renderer
def test_both_renderers_see_the_same_blurred_dimmed_picture(world: World) -> None:
    optics = Optics(25.0, 1500.0, 0.0, (-0.3, 0.05, 0.0), True)
    blurred = replace(
        small(world), psf_sigma_px=0.6, optics=optics, motion=Motion(camera=SLIDE, exposure_s=0.02, row_s=1e-5)
    )
    stage = build_stage(blurred)
    light = compute_irradiance(stage, 60.0, 2048, 5, lambda _: None)
    fast = render_fast(stage, light, 1, 3).values.astype(float)
    runs = np.stack([render_path(stage, 1, 48, 100 + k).values.astype(float) for k in range(8)])
    mean, u = runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    boards = board_pixels(blurred, 1)
    difference, noise = block_means(fast - mean, boards), block_means(u**2, boards)
    # Blur leaves neighbouring pixels' noise correlated, so blocks are less certain than pixels say.
    assert np.sqrt((difference**2 / (noise / 64)).mean()) < 2.5
    assert abs((fast - mean)[boards].mean()) < 3e-3 * mean[boards].mean()
    sharp = render_fast(build_stage(small(world)), light, 1, 3).values.astype(float)
    assert np.abs(block_means(sharp - mean, boards)).max() > 10 * np.sqrt(noise / 64).max()


def test_focus_and_motion_keep_their_limits() -> None:
    for verdict in focus.certify_focus(True):
        assert verdict.passed, verdict


def test_a_pupil_of_twice_the_width_would_be_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(focus, "Optics", lambda aperture_mm, focus_mm: Optics(2 * aperture_mm, focus_mm))
    world = focus._dots(0, 0.5)
    light = Irradiance.even(len(world.panels), np.pi)
    assert not focus._circle(world, light, focus._Moments(world, light))[0].passed
