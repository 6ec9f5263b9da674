"""What a plan predicts is what the measurement then states, and what the network's equations say."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testfield.adjust.bundle import adjust
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.chain.recipe import recipe_of
from testfield.errors import TestfieldError
from testfield.measure.pipeline import measure
from testfield.plan.card import card_of
from testfield.plan.datum import rms_in_board
from testfield.plan.job import Job
from testfield.plan.network import planned
from testfield.plan.points import by_all, by_pixels, rays_of
from testfield.plan.predict import Prediction, predict_scene
from testfield.scene.exposure import sensor_of
from testfield.scene.frames import camera_looking
from testfield.scene.load import load_scene, parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.truth import see
from testfield.score.align import aligned_covariance, rigid_basis
from testfield.seeds import normals
from testfield.simulate.expected import _of_discs, _of_moved_discs

SCENES = Path(__file__).parents[1] / "scenes"


@pytest.fixture(scope="module")
def scene() -> SceneFile:
    return load_scene(SCENES / "quick.toml")


@pytest.fixture(scope="module")
def job(scene: SceneFile) -> Job:
    return Job.of(scene, "quick.toml")


@pytest.fixture(scope="module")
def found(job: Job) -> Prediction:
    return predict_scene(job)


def test_predicted_uncertainties_are_those_that_the_measurement_states(
    scene: SceneFile, job: Job, found: Prediction
) -> None:
    exact = job.observations
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(exact.cov_px2), normals(3, "plan", len(exact), 2))
    measured = measure(replace(exact, xy_px=exact.xy_px + noise), job.told, recipe_of(scene))
    rows = np.array([found.rows((int(code),)) for code in measured.points.code]).ravel()
    stated = np.sqrt(np.diag(measured.points.cov_xyz_mm2)).reshape(-1, 3)
    assert len(rows) == 12
    assert found.u_mm[rows] / stated == pytest.approx(np.ones((len(rows), 3)), abs=0.01)
    names = [label for label in measured.calibration.labels if not label.startswith("point:")]
    ours = np.sqrt(np.diag(found.shared)[found.index(names)])
    theirs = np.sqrt(np.diag(measured.calibration.covariance)[measured.calibration.index(names)])
    assert ours / theirs == pytest.approx(np.ones(len(names)), abs=0.01)


@pytest.mark.parametrize("name", ["quick", "on_a_hull", "charuco"])
def test_what_is_expected_to_be_seen_is_what_is_truly_seen(name: str) -> None:
    job = Job.of(load_scene(SCENES / f"{name}.toml"), name)
    views = see(job.world)
    clear = (views.visible == 1) & (views.obliquity_deg < 75)
    clear &= views.diameter_px >= job.scene.measure.smallest_diameter_px
    expected = np.zeros_like(clear)
    expected[job.expected.station, job.expected.mark] = True
    assert (expected != clear).sum() <= 0.002 * clear.sum()
    here = job.expected.station, job.expected.mark
    assert np.abs(job.expected.xy_px - views.centre_px[here]).max() < 1e-9
    assert job.expected.diameter_px / views.diameter_px[here] == pytest.approx(np.ones(len(job.expected)), abs=0.01)


def test_points_and_cameras_of_one_bundle_are_known_as_its_equations_say(scene: SceneFile) -> None:
    bundled = scene.model_copy(update={"measure": scene.measure.model_copy(update={"reconstructor": "bundle"})})
    job = Job.of(bundled.in_folder(SCENES), "quick.toml")
    found, plan = predict_scene(job), planned(job)
    whole = adjust(plan.network, plan.labels(plan.network), most_steps=0)
    points = plan.points_of(found.code)
    assert found.blocks == pytest.approx(whole.cov.point_blocks()[points], rel=1e-6, abs=1e-12)
    assert found.points.joint(np.arange(4)) == pytest.approx(whole.cov.points(points[:4]), rel=1e-5, abs=1e-11)


def test_another_board_as_datum_gives_what_its_frame_was_predicted_to_give(scene: SceneFile, found: Prediction) -> None:
    a, b, c = scene.boards
    turned = scene.model_copy(update={"boards": (c, a, b)}).in_folder(SCENES)
    other = predict_scene(Job.of(turned, "quick.toml"))
    check = np.flatnonzero(found.is_check)
    by_c = float(np.sqrt((other.u_mm[other.is_check] ** 2).mean()))
    assert rms_in_board(found, check, 2) == pytest.approx(by_c, rel=2e-3)


def test_the_fit_and_lengths_follow_from_the_joint_covariance(found: Prediction) -> None:
    joint, n = found.points.joint(np.arange(len(found.code))), len(found.code)
    after = aligned_covariance(joint, found.xyz_mm)
    assert found.points.rms_after(rigid_basis(found.xyz_mm)) == pytest.approx(np.sqrt(np.trace(after) / (3 * n)))
    d = found.xyz_mm[0] - found.xyz_mm[1]
    along = np.concatenate([d, -d]) / np.linalg.norm(d)
    u = np.sqrt(along @ joint[:6, :6] @ along)
    assert found.points.u_lengths_mm(np.array([[0, 1]]), found.xyz_mm) == pytest.approx([u])


def test_redundancy_numbers_and_what_is_known_before_sum_to_the_freedom(found: Prediction) -> None:
    network = found.adjustment.network
    images = np.einsum("mii->", found.adjustment.redundancy)
    assert (
        images < found.adjustment.freedom < images + network.information.astype(bool).sum() + len(network.distances) + 1
    )


def test_boards_that_no_image_joins_are_named_with_their_stations(job: Job) -> None:
    board = job.world.marks.board[job.expected.mark]
    apart = np.where(job.expected.station < 4, board != 2, board == 2)
    with pytest.raises(TestfieldError) as refused:
        planned(replace(job, expected=job.expected.take(apart)))
    assert all(word in str(refused.value) for word in ("datum", "'C'", "'station05'", "stations"))


def test_a_scene_without_any_board_in_view_is_refused_with_the_field(job: Job) -> None:
    with pytest.raises(TestfieldError, match="stations"):
        planned(replace(job, expected=job.expected.take(np.zeros(len(job.expected), bool))))


def test_a_narrow_view_a_lonely_target_and_an_uncontrolled_scale_are_warned_of(job: Job, scene: SceneFile) -> None:
    board, code = (values[job.expected.mark] for values in (job.world.marks.board, job.world.marks.code))
    first = job.expected.station == job.expected.station[0]
    keep = ((board != 2) | (job.expected.station < 1)) & ((code != 201) | first) & ~np.isin(code, (111, 112))
    warned = " ".join(card_of(predict_scene(replace(job, expected=job.expected.take(keep))))["warnings"])
    assert all(word in warned for word in ("'C'", "201", "check bar"))


def test_the_light_of_a_mark_is_what_a_lamp_and_an_open_sky_throw_on_it() -> None:
    """A card on the floor of an empty world under a small lamp, by hand: E = L A cos cos / d^2, and pi L of the sky."""
    text = """
name = "card"
u_print_scale_ppm = 0
[room]
ambient_w_m2_sr = 0.5
[[room.lights]]
size_mm = [20, 20]
position_mm = [0, 0, 2000]
normal = [0, 0, -1]
radiance_w_m2_sr = 900.0
[[boards]]
name = "A"
position_mm = [0, 0, 0]
normal = [0, 0, 1]
kind = "plate"
[kinds.plate]
extension_zone = { columns = 3, rows = 3, pitch_mm = 75, centre_mm = [145, 0] }
recognition_zone = { columns = 2, rows = 6, pitch_mm = 125, centre_mm = [-435, 0], first_code = 1 }
[[stations]]
position_mm = [0, -300, 3000]
look_at_mm = [0, 0, 0]
"""
    expecting = Job.of(parse_scene(text, "card.toml"), "card.toml").expecting[0]
    world, sensor = expecting.world, sensor_of(parse_scene(text, "card.toml"))
    place = world.mark_world_mm
    d2 = (place**2).sum(axis=1) - 2 * 2000 * place[:, 2] + 2000**2
    light = 900.0 * 400 * 2000**2 / d2**2 + np.pi * 0.5
    albedo = world.panels.ink_albedo[0] - world.panels.ground_albedo[0]
    contrast = albedo * light / np.pi * sensor.electrons_per_radiance / sensor.gain_e_per_dn
    assert expecting.contrast_dn / contrast == pytest.approx(np.ones(len(place)), abs=0.01)


def test_stations_all_around_know_a_point_as_the_formula_of_fraser_says() -> None:
    """Mean precision q S s with q = sqrt(3 / (2 n)), cameras known (METHODS section 5.5)."""
    n, distance_mm, focal_px, sigma_px = 60, 2000.0, 4000.0, 0.04
    k = np.arange(n) + 0.5
    z, turn = 1 - 2 * k / n, np.pi * (1 + np.sqrt(5)) * k
    eyes = distance_mm * np.column_stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z])
    looking = [camera_looking(eye, np.zeros(3), 0.3) for eye in eyes]
    interior = Interior(4000, 4000, np.array([focal_px, focal_px, 2000, 2000, 0, 0, 0, 0, 0.0]))
    rays = rays_of(
        xyz_mm=np.zeros((1, 3)),
        point=np.zeros(n, int),
        image=np.arange(n),
        cov_px2=np.tile(sigma_px**2 * np.eye(2), (n, 1, 1)),
        poses=Poses(np.array([R for R, _ in looking]), np.array([t for _, t in looking])),
        camera=np.zeros(n, int),
        interiors=(interior,),
        interior_at=[(np.zeros(0, int), np.zeros(0, int))],
        image_at=6 * np.arange(n),
    )
    known = np.zeros((6 * n, 6 * n))
    predicted = np.sqrt(3 / (2 * n)) * distance_mm / focal_px * sigma_px
    for kind in (by_pixels, by_all):
        assert np.sqrt(np.diag(kind(rays, known).blocks()[0])) == pytest.approx([predicted] * 3, rel=0.02)


def test_a_dot_that_moves_is_known_worse_along_its_way_and_one_at_rest_as_before() -> None:
    spread, snr, edge = np.tile(6.0 * np.eye(2), (2, 1, 1)), np.full(2, 50.0), np.full(2, 0.7)
    still = _of_discs(spread, snr, edge)
    moved = _of_moved_discs(spread, snr, edge, np.array([[0.0, 0.0], [3.0, 0.0]]))
    assert moved[0] == pytest.approx(still[0], rel=1e-9)
    assert moved[1, 0, 0] > 1.1 * moved[1, 1, 1]
    assert moved[1, 1, 1] > still[1, 1, 1]
