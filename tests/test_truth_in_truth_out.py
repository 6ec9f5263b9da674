"""Feed the truth in and demand perfection: this is where a convention error anywhere would show."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.stitched import stitched
from testfield.camera.circle import disc_image
from testfield.detect.observations import MEASURED, Observations
from testfield.reconstruct.gls import gls
from testfield.reconstruct.midpoint import midpoint
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.truth import Views, see
from testfield.scene.world import World
from testfield.score.camera import interior_difference, score_boards
from testfield.score.detection import score_detection
from testfield.score.points import score_lengths, score_points

SCENE = Path(__file__).parents[1] / "scenes/stitched_wall.toml"


@pytest.fixture(scope="module")
def perfect() -> tuple[World, Views]:
    """The stitched wall made without any error of manufacture: what the sheets say is true."""
    scene = load_scene(SCENE)
    exact = scene.model_copy(
        update={
            "u_print_scale_ppm": 0.0,
            "boards": tuple(b.model_copy(update={"print_sigma_mm": 0.0}) for b in scene.boards),
            "scale_bars": tuple(b.model_copy(update={"u_length_mm": 0.0}) for b in scene.scale_bars),
        }
    )
    world = build_world(exact)
    return world, see(world)


def observe(world: World, views: Views, discs: bool, shift_px: float = 0.0) -> Observations:
    """Noise-free observations of all visible marks: true projected centres, or true centres of the discs' images."""
    station, mark = np.nonzero((views.visible == 1) & (views.obliquity_deg < 75))
    px = (views.disc_px if discs else views.centre_px)[station, mark] + shift_px
    n = len(px)
    image = disc_image(
        world.interior,
        world.camera_from_world[station],
        world.mark_world_mm[mark],
        world.mark_normal[mark],
        world.marks.diameter_mm[mark] / 2,
    )
    return Observations(
        stations=world.station_name,
        station=station,
        xy_px=px,
        cov_px2=np.tile(1e-4 * np.eye(2), (n, 1, 1)),
        moments_px2=image.moments_px2,
        code=world.marks.code[mark],
        board=world.marks.board[mark],
        point=world.marks.point[mark],
        chi2=np.ones(n),
        status=np.full(n, MEASURED, object),
        centre_of_disc=discs,
    )


def largest_errors(world: World, calibration: Calibration, observations: Observations) -> tuple[float, float, float]:
    """Camera in px over the image, check points in mm, board poses in mm."""
    points = score_points(world, calibration, gls(observations, calibration, world.field))
    grid = np.stack(np.meshgrid(np.linspace(0, 2447, 20), np.linspace(0, 2047, 20)), -1).reshape(-1, 2)
    camera = np.abs(interior_difference(world.interior, calibration.interior, grid)).max()
    assert len(points.code) == points.expected
    return float(camera), float(np.abs(points.error_mm).max()), score_boards(world, calibration)["pose_rms_mm"]


def test_true_projected_centres_give_the_true_camera_and_points(perfect: tuple[World, Views]) -> None:
    world, views = perfect
    observations = observe(world, views, discs=False)
    calibration = stitched(observations, world.field, 2448, 2048)
    camera_px, points_mm, boards_mm = largest_errors(world, calibration, observations)
    assert camera_px < 1e-6
    assert points_mm < 1e-6
    assert boards_mm < 1e-6
    assert np.abs(calibration.interior.parameters[:4] - world.interior.parameters[:4]).max() < 1e-6
    bars = score_lengths(world, calibration, gls(observations, calibration, world.field))["bars"]
    assert max(abs(bar["error_mm"]) for bar in bars) < 1e-6


def test_true_disc_images_give_the_same_because_the_circle_itself_is_modelled(perfect: tuple[World, Views]) -> None:
    world, views = perfect
    observations = observe(world, views, discs=True)
    calibration = stitched(observations, world.field, 2448, 2048)
    camera_px, points_mm, boards_mm = largest_errors(world, calibration, observations)
    assert camera_px < 1e-6
    assert boards_mm < 1e-6
    # A loose target's normal comes from its images' shapes to first order; that costs some nanometres.
    assert points_mm < 2e-5


def test_half_a_pixel_turns_this_red(perfect: tuple[World, Views]) -> None:
    world, views = perfect
    shifted = observe(world, views, discs=False, shift_px=0.5)
    calibration = stitched(shifted, world.field, 2448, 2048)
    error = np.abs(calibration.interior.parameters[2:4] - world.interior.parameters[2:4])
    assert error.min() > 0.4  # a shift of all pixels is a shift of the principal point, and must show as one


def test_taking_the_disc_for_its_centre_turns_this_red(perfect: tuple[World, Views]) -> None:
    world, views = perfect
    mistaken = replace(observe(world, views, discs=True), centre_of_disc=False)
    calibration = stitched(mistaken, world.field, 2448, 2048)
    camera_px, points_mm, _ = largest_errors(world, calibration, mistaken)
    assert camera_px > 1e-4
    assert points_mm > 1e-4


def test_the_true_observations_score_perfectly(perfect: tuple[World, Views]) -> None:
    world, views = perfect
    observed = observe(world, views, discs=False)
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = world.interior.parameters
    K, lens = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array([k1, k2, p1, p2, k3])
    _, mark = np.nonzero((views.visible == 1) & (views.obliquity_deg < 75))
    by_opencv = np.empty_like(observed.xy_px)
    for s in range(len(world.station_name)):
        here = observed.station == s
        pose = cv2.Rodrigues(world.camera_from_world.R[s])[0], world.camera_from_world.t_mm[s]
        by_opencv[here] = cv2.projectPoints(world.mark_world_mm[mark[here]], *pose, K, lens)[0][:, 0]
    card = score_detection(world, views, replace(observed, xy_px=by_opencv)).card()
    assert card["centre_worst_px"] < 1e-6
    assert card["measured"] == len(observed)
    assert card["false"] == card["wrong_code"] == card["wrong_dot"] == 0
    off = score_detection(world, views, replace(observed, xy_px=by_opencv + [0.003, -0.004])).card()
    assert off["centre_bias_px"] == pytest.approx(0.005, abs=1e-6)


def test_methods_agree_on_perfect_observations(perfect: tuple[World, Views]) -> None:
    world, views = perfect
    observations = observe(world, views, discs=False)
    calibration = stitched(observations, world.field, 2448, 2048)
    a, b = gls(observations, calibration, world.field), midpoint(observations, calibration, world.field)
    assert np.abs(a.xyz_mm - b.xyz_mm).max() < 1e-6
