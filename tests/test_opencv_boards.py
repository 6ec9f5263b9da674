"""Boards that people own: rendered exactly, read by OpenCV, measured as well as is claimed, and used by the chain."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.camera.images import Frame, Radiance
from testfield.camera.photograph import Photograph
from testfield.certify.geometry import STRIP_PX, judge_squares, render_squares, squared, strewn
from testfield.certify.reference import cells_in_pixels
from testfield.chain.run import Run, begin
from testfield.chain.stages import STAGES, run_stage
from testfield.detect.corner_model import fit_corners, offsets_px
from testfield.detect.detect import detect
from testfield.detect.eight_bits import eight_bits
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.opencv_boards import detect_board
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.errors import TestfieldError
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.path import render_path
from testfield.render.stage import build_stage
from testfield.scene.build import build_world
from testfield.scene.check import check_scene
from testfield.scene.load import parse_scene
from testfield.scene.truth import Views, see
from testfield.scene.world import World
from testfield.score.detection import DetectionScore, score_detection
from testfield.sensor.expose import Sensor, expose
from testfield.targets.board_pattern import BoardPattern, dictionary

HEAD = """
name = "own"
seed = 3
[camera]
width_px = 480
height_px = 400
pixel_pitch_um = 5.0
focal_length_mm = 3.4
k1 = -0.08
psf_sigma_px = 0.65
[paint]
white_on_black = false
[room]
ambient_w_m2_sr = 1.0
[exposure]
time_ms = 15
[measure]
hold = ["k2", "k3", "p1", "p2"]
[render]
light_spacing_mm = 150
light_paths = 16
"""
STATIONS = """
[[stations]]
generator = "grid"
counts = [2, 1, 2]
low_mm = [-210, -480, 360]
high_mm = [230, -480, 720]
look_at_mm = [0, 0, 500]
roll_deg = [-12, 9, 6, -8]
"""
CHARUCO = 'kind = "charuco", columns = 7, rows = 5, square_mm = 40, marker_mm = 30'
CHECKERBOARD = 'kind = "checkerboard", columns = 8, rows = 5, square_mm = 36'
ARUCO = 'kind = "aruco", columns = 4, rows = 3, marker_mm = 54, gap_mm = 18, first_tag = 10'
APRILTAG = 'kind = "apriltag", columns = 4, rows = 3, marker_mm = 58, gap_mm = 18'
APRILGRID = 'kind = "aprilgrid", columns = 4, rows = 3, marker_mm = 54, gap_mm = 16.2'
CCTAG = 'kind = "cctag", columns = 4, rows = 3, pitch_mm = 74, diameter_mm = 58, first_tag = 7'
RUNETAG = 'kind = "runetag", diameter_mm = 190, number = 4711'
CIRCLES = 'kind = "circles", columns = 9, rows = 6, pitch_mm = 32, diameter_mm = 16'
ASYMMETRIC = 'kind = "acircles", columns = 4, rows = 9, pitch_mm = 24, diameter_mm = 18'
HEXAGONAL = 'kind = "hexcircles", columns = 7, rows = 7, pitch_mm = 34, diameter_mm = 20'


def text(*patterns: str) -> str:
    boards = "".join(
        f'[[boards]]\nname = "B{k}"\nsize_mm = [320, 240]\nnormal = [0.1, -1, 0.15]\n'
        f"position_mm = [{400 * k}, 0, 500]\npattern = {{ {pattern} }}\n"
        for k, pattern in enumerate(patterns)
    )
    return HEAD + boards + STATIONS


@cache
def built(pattern: str) -> World:
    return build_world(parse_scene(text(pattern), "test", Path()))


def sensor_of() -> Sensor:
    scene = parse_scene(text(CHARUCO), "test", Path())
    return Sensor(
        pixel_pitch_um=scene.camera.pixel_pitch_um,
        f_number=scene.camera.f_number,
        time_ms=scene.exposure.time_ms,
        **scene.sensor.model_dump(),
    )


@cache
def rendered(pattern: str) -> list[Radiance]:
    """All stations of a board under light that is the same everywhere."""
    world = built(pattern)
    stage, light = build_stage(world), Irradiance.even(len(world.panels), 3.0)
    return [render_fast(stage, light, s, 3) for s in range(len(world.station_name))]


def shots(pattern: str, seed: int = 1) -> list[Frame]:
    """What a sensor makes of them."""
    return [expose(image, sensor_of(), seed) for image in rendered(pattern)]


def measured(world: World, frames: list[Frame]) -> tuple[Observations, Views, DetectionScore]:
    parts = [detect(frame, world.field, "forward_model", 5.0) for frame in frames]
    observations, views = Observations.join(parts, world.station_name), see(world)
    return observations, views, score_detection(world, views, observations)


@pytest.mark.parametrize("rows", [5, 6])
def test_a_charuco_board_is_printed_as_opencv_prints_it(rows: int) -> None:
    pattern = BoardPattern("charuco", 7, rows, 30.0, 22.0, "DICT_4X4_50")
    px_a_mm = 6
    board = cv2.aruco.CharucoBoard((7, rows), 30, 22, dictionary("DICT_4X4_50"))
    theirs = board.generateImage((210 * px_a_mm, 30 * rows * px_a_mm)) < 128
    x = (np.arange(theirs.shape[1]) + 0.5) / px_a_mm - 105
    y = 15 * rows - (np.arange(theirs.shape[0]) + 0.5) / px_a_mm
    assert np.array_equal(pattern.cells.at(np.stack(np.meshgrid(x, y), axis=-1)), theirs)
    corners = board.getChessboardCorners()[:, :2] - [105, 15 * rows]
    assert np.abs(corners * [1, -1] - pattern.points_mm).max() < 1e-4


def test_pixels_of_squares_are_exact() -> None:
    world = squared(strewn(3478.0, STRIP_PX))
    verdict = judge_squares(render_squares(world, 3))
    assert verdict.passed, verdict
    assert verdict.measured < 2e-4

    def shifted(world: World) -> World:  # by a hundredth of a millimetre, some hundredths of a pixel
        moved = [replace(p, cells=replace(p.cells, x_mm=p.cells.x_mm + 0.01)) for p in world.prints]
        return replace(world, prints=tuple(moved))

    assert not judge_squares(render_squares(world, 3, shifted)).passed


def test_the_reference_of_squares_agrees_with_areas() -> None:
    pinhole, facing = np.array([3000.0, 3000.0, 500.0, 400.0, 0, 0, 0, 0, 0]), np.diag([1.0, -1.0, -1.0])
    x, y = np.array([-4.0, -1.0, 5.0]), np.array([-3.0, 0.5, 2.0])
    black = np.array([[True, False], [True, True]])
    window = cells_in_pixels(pinhole, facing, np.array([3.3, 4.7, 3000.0]), x, y, black)
    assert window.values.sum() == pytest.approx(3 * 3.5 + 9 * 1.5, rel=1e-12)
    assert window.values.max() < 1 + 1e-12


def test_the_path_tracer_sees_the_same_board() -> None:
    world = built(CHARUCO)
    world = replace(world, ambient_radiance=1.0, lights=())
    fast = render_fast(build_stage(world), Irradiance.even(len(world.panels), np.pi), 0, 3).values
    path = render_path(build_stage(world), 0, 64, 1).values
    # Light between panels is missing in the one; what edges are where is the same.
    smooth = [cv2.GaussianBlur(v, (0, 0), 1.5) for v in (fast, path)]
    assert np.corrcoef(smooth[0].ravel(), smooth[1].ravel())[0, 1] > 0.998
    # By how far one is shifted against the other, in x and y: least squares on the picture's own gradient.
    gradient = np.stack([np.gradient(smooth[0], axis=axis)[8:-8, 8:-8].ravel() for axis in (1, 0)])
    columns = np.column_stack([*gradient, smooth[0][8:-8, 8:-8].ravel(), np.ones(gradient.shape[1])])
    shift = np.linalg.lstsq(columns, smooth[1][8:-8, 8:-8].ravel().astype(float))[0][:2]
    assert np.abs(shift).max() < 0.02


def test_a_rendered_charuco_board_is_read_by_opencv_with_all_its_corners() -> None:
    world = built(CHARUCO)
    views = see(world)
    for s, frame in enumerate(shots(CHARUCO)):
        found = detect_board(frame.pixels_dn.astype(np.float32), parse_target("charuco:7x5:DICT_4X4_50:40:30"))
        assert sorted(found.point) == list(range(24))
        assert np.abs(found.xy_px - views.centre_px[s, found.point]).max() < 0.35


def test_rendered_april_tags_are_read_by_the_library_that_invented_them() -> None:
    pytest.importorskip("pupil_apriltags")
    world = built(APRILTAG)
    views, frame = see(world), shots(APRILTAG)[0]
    found = detect_board(frame.pixels_dn.astype(np.float32), parse_target("apriltag:36h11"))
    assert "by pupil-apriltags" in found.notes
    assert sorted(set(found.code)) == list(range(12))
    for tag in range(12):
        middle = found.xy_px[found.code == tag].mean(axis=0)
        assert np.linalg.norm(middle - views.centre_px[0, 4 * tag : 4 * tag + 4].mean(axis=0)) < 0.5


def test_a_rendered_symmetric_grid_is_read_by_opencv() -> None:
    world = built(CIRCLES)
    frame, views = shots(CIRCLES)[0], see(world)
    found, centres = cv2.findCirclesGrid(eight_bits(frame.pixels_dn.astype(np.float32)), (9, 6))
    assert found
    gap = np.linalg.norm(centres.reshape(-1, 1, 2) - views.disc_px[0], axis=2)
    assert gap.min(axis=1).max() < 0.3
    assert sorted(gap.argmin(axis=1)) == list(range(54))


def test_a_rendered_asymmetric_grid_is_read_by_opencv_in_its_order() -> None:
    world = built(ASYMMETRIC)
    frame, views = shots(ASYMMETRIC)[0], see(world)
    found = detect_board(frame.pixels_dn.astype(np.float32), parse_target("acircles:4x9"))
    assert found.disc
    gap = np.linalg.norm(found.xy_px[:, None] - views.disc_px[0], axis=2)
    assert gap.min(axis=1).max() < 0.3
    assert gap.argmin(axis=1).tolist() in (list(range(36)), list(range(35, -1, -1)))


@pytest.mark.parametrize(
    "pattern",
    [CHARUCO, CHECKERBOARD, ARUCO, APRILTAG, APRILGRID, CIRCLES, ASYMMETRIC, HEXAGONAL]
    + [pytest.param(CCTAG, marks=pytest.mark.slow)],  # `test_cctags` measures drawn ones in a third of the time
)
def test_every_point_of_every_board_is_named_and_known_as_well_as_claimed(pattern: str) -> None:
    world = built(pattern)
    _, _, score = measured(world, shots(pattern))
    assert score.expected.sum() >= 3 * len(world.marks)
    assert (score.found == score.expected).all(), score.missed
    assert len(score.wrong_dot) == len(score.wrong_code) == len(score.false) == 0
    assert np.sqrt((score.error_px**2).mean()) < 0.02
    # Some hundred points of two coordinates: three standard deviations of the mean either way.
    freedom = 2 * len(score.nees)
    assert abs(score.nees.mean() / 2 - 1) < 3 * np.sqrt(2 / freedom)


def test_the_dots_of_a_rune_tag_are_named_and_known_as_well_as_claimed() -> None:
    """Dots of 7 to 14 px, a third of their diameter apart: some are not seen for their neighbours."""
    world = built(RUNETAG)
    _, _, score = measured(world, shots(RUNETAG))
    assert score.expected.sum() > 0.75 * score.expected.size
    assert score.found.sum() > 0.9 * score.expected.sum(), score.missed
    assert len(score.wrong_dot) == len(score.wrong_code) == len(score.false) == 0
    assert np.sqrt((score.error_px**2).mean()) < 0.02
    assert abs(score.nees.mean() / 2 - 1) < 3 * np.sqrt(1 / len(score.nees))


@pytest.mark.parametrize("seed", range(1, 13))
def test_a_checkerboard_seen_at_a_slant_is_read_by_sheet_and_without_whatever_the_noise(seed: int) -> None:
    """OpenCV's finder gives wrong points for a quarter of its seeds here: no one draw decides."""
    world, frame = built(CHECKERBOARD), shots(CHECKERBOARD, seed)[1]
    assert (detect(frame, world.field, "forward_model", 5.0).status == MEASURED).sum() == 28
    at = see(world).disc_px[1]
    seen = detect_board(np.asarray(frame.pixels_dn, np.float32), parse_target("checkerboard:7x4")).xy_px
    assert np.linalg.norm(seen[:, None] - at[None], axis=-1).min(axis=1).max() < 0.5


@pytest.mark.parametrize(("pattern", "seeds"), [(CHARUCO, 6), (APRILTAG, 3)])
def test_corners_are_better_than_cornersubpix_and_their_claims_are_true(pattern: str, seeds: int) -> None:
    world = built(pattern)
    errors, nees, theirs = [], [], []
    for seed in range(seeds):
        frames = shots(pattern, seed)
        _, views, score = measured(world, frames)
        errors.append(score.error_px)
        nees.append(score.nees)
        for s, frame in enumerate(frames):  # as it was measured, not rounded to bytes, and from a good start
            start = (views.centre_px[s] + [0.3, -0.3]).astype(np.float32)[:, None]
            stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-5)
            found = cv2.cornerSubPix(frame.pixels_dn.astype(np.float32), start.copy(), (4, 4), (-1, -1), stop)
            theirs.append(found[:, 0] - views.centre_px[s])
    ours_px, theirs_px = (float(np.sqrt(np.mean(np.concatenate(e) ** 2))) for e in (errors, theirs))
    mean = float(np.concatenate(nees).mean() / 2)
    print(f"corner rms {ours_px:.4f} px, cornerSubPix {theirs_px:.4f} px, NEES {mean:.3f}")
    assert 0.9 < mean < 1.1
    assert ours_px < 0.4 * theirs_px


def test_a_hidden_corner_is_turned_down_and_its_neighbours_are_not() -> None:
    world = built(CHARUCO)
    frame, views = shots(CHARUCO)[0], see(world)
    pixels = frame.pixels_dn.copy()
    x, y = np.rint(views.centre_px[0, 9]).astype(int)
    pixels[y + 1 : y + 7, x - 7 : x - 1] = pixels[y + 3, x + 5]
    found = detect(replace(frame, pixels_dn=pixels), world.field, "forward_model", 5.0)
    status = dict(zip(found.point.tolist(), found.status.tolist(), strict=True))
    assert status[9] != MEASURED
    assert sum(value == MEASURED for value in status.values()) == 23


@pytest.mark.parametrize(
    ("pattern", "target"),
    [
        (CHARUCO, "charuco:7x5:DICT_4X4_50:40:30"),
        (CHECKERBOARD, "checkerboard:7x4"),
        (ARUCO, "aruco:DICT_4X4_50"),
        (APRILTAG, "apriltag:36h11"),
        (APRILGRID, "aprilgrid:4x3:54:16.2"),
    ],
)
def test_corners_of_photographs_have_a_covariance_too(pattern: str, target: str) -> None:
    world, frame = built(pattern), shots(pattern)[0]
    photograph = Photograph("photo", frame.pixels_dn.astype(np.float32), 12, ())
    found = detect_in_photograph(photograph, parse_target(target)).observations
    true = see(world).centre_px[0]
    error = found.xy_px - true[np.linalg.norm(found.xy_px[:, None] - true, axis=2).argmin(axis=1)]
    assert np.isfinite(found.cov_px2).all()
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_px2), error)
    assert 0.5 < nees.mean() / 2 < 1.6  # few corners, and noise that is only estimated


def test_a_mosaic_sensor_measures_corners_too() -> None:
    world, sensor = built(CHARUCO), replace(sensor_of(), bayer="RGGB", bayer_response=(0.5, 1.0, 0.65))
    frame = expose(rendered(CHARUCO)[0], sensor, 1)
    found = detect(frame, world.field, "forward_model", 5.0).measured
    assert len(found) > 15
    assert np.median(found.chi2) < 1.5


def test_a_board_of_which_the_image_shows_no_whole_corner_ends_nothing() -> None:
    world, frame = built(CHARUCO), shots(CHARUCO)[0]
    full = detect(frame, world.field, "forward_model", 5.0).measured
    for height in range(40, int(full.xy_px[:, 1].max()), 40):
        part = Frame(frame.station, np.ascontiguousarray(frame.pixels_dn[:height]), frame.sheet)
        assert len(detect(part, world.field, "forward_model", 5.0).measured) <= len(full)


def test_squares_alone_in_view_of_a_field_that_has_dots_too() -> None:
    world, frame = built(CHARUCO), shots(CHARUCO)[0]
    mixed = replace(world.field, loose={5: 10.0})
    blank = Frame(frame.station, np.full_like(frame.pixels_dn, 800), frame.sheet)
    assert len(detect(frame, mixed, "forward_model", 5.0).measured) > 15
    assert len(detect(blank, mixed, "forward_model", 5.0).measured) == 0


def test_a_light_gradient_moves_no_corner() -> None:
    """A rendered corner, no noise, a small window: under a gradient of 1 % a pixel the fit hardly moves."""
    world = built(CHARUCO)
    image = rendered(CHARUCO)[0].values
    sheet, views = sensor_of().sheet, see(world)
    slope = 1 + 0.01 * (np.arange(image.shape[1]) - views.centre_px[0, 11, 0])
    axes = np.diff(views.centre_px[0][[11, 12, 11, 5]].reshape(2, 2, 2), axis=1)[:, 0].T  # to the right, and up
    use = np.hypot(*offsets_px().T)[None] < 4
    bright = 2000 * image / image.max()
    found = []
    for light in (np.ones_like(slope), slope):
        fit = fit_corners(
            sheet.black_level_dn + bright * light,
            sheet,
            views.centre_px[0, 11:12] + 0.4,
            axes[None],
            np.array([True]),
            use,
        )
        assert fit.ok[0]
        assert np.abs(fit.xy_px[0] - views.centre_px[0, 11]).max() < 2e-3
        found.append(fit.xy_px[0])
    assert np.abs(found[1] - found[0]).max() < 1e-3


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A finished run with a ChArUco board and a grid of AprilTags."""
    folder = tmp_path_factory.mktemp("boards")
    both = text(CHARUCO, APRILTAG).replace("width_px = 480", "width_px = 900").replace("-480", "-560")
    both = both.replace("[-210,", "[0,").replace("[230,", "[400,").replace("[0, 0, 500]\nroll", "[200, 0, 500]\nroll")
    (folder / "own.toml").write_text(both)
    run, _ = begin(folder / "own.toml", folder / "run", None, 1)
    for name in STAGES:
        run_stage(run, name)
    return run


def test_the_whole_chain_runs_on_boards_of_two_kinds(tiny: Run) -> None:
    card = json.loads((tiny.folder / "scorecard.json").read_text())
    assert card["detection"]["found_fraction"] > 0.99
    assert card["detection"]["wrong_dot"] == card["detection"]["false"] == 0
    assert card["boards"]["joined"] == 2
    assert 0.9 < card["calibration"]["sigma0"] < 1.1
    assert card["boards"]["pose_rms_mm"] < 0.2
    assert "report.html" in tiny.ledger.files


def test_corners_are_never_shifted_as_discs_are(tiny: Run) -> None:
    """The sheet calls them corners; if it called them discs, calibration would see it."""
    from testfield.calibrate.stitched import stitched
    from testfield.targets.field import Field

    observations = Observations.load(tiny.folder / "observations.parquet")
    field = Field.load(tiny.folder / "field.json")
    assert [board.pattern for board in field.boards] == [board.pattern for board in tiny.world.field.boards]
    right = stitched(observations, field, 900, 400, hold=("k2", "k3", "p1", "p2"))
    discs = [
        replace(b, pattern=None, marks=replace(b.marks, diameter_mm=3 * b.marks.diameter_mm)) for b in field.boards
    ]
    wrong = stitched(observations, replace(field, boards=tuple(discs)), 900, 400, hold=("k2", "k3", "p1", "p2"))
    assert right.sigma0 < 1.1 and not right.failures
    assert wrong.failures


@pytest.mark.parametrize(
    ("pattern", "word"),
    [
        (CHARUCO.replace("marker_mm = 30", "marker_mm = 41"), "not smaller"),
        (CHARUCO + ', first_tag = 40, dictionary = "DICT_4X4_50"', "ends at 49"),
        (CHARUCO + ', dictionary = "DICT_9X9"', "no dictionary"),
        ('kind = "checkerboard", columns = 8, rows = 6, square_mm = 20', "upside down"),
        ('kind = "circles", columns = 6, rows = 6, pitch_mm = 30, diameter_mm = 10', "must exceed rows"),
        ('kind = "acircles", columns = 4, rows = 8, pitch_mm = 20, diameter_mm = 10', "odd number"),
        (CHARUCO + " }\nbow_mm = 3\ndirt = { count = 1, diameter_mm = 2", "flat"),
        (CHARUCO + " }\nprint_sigma_mm = 0.1\ndirt = { count = 1, diameter_mm = 2", "one piece"),
        (CHARUCO + " }\nrecognition_zone = { first_code = 1", "no recognition_zone"),
    ],
)
def test_boards_that_cannot_be_are_refused_in_a_sentence(pattern: str, word: str) -> None:
    with pytest.raises(TestfieldError, match=word):
        parse_scene(text(pattern), "test", Path())


@pytest.mark.parametrize(
    ("patterns", "word"),
    [
        ((CHARUCO, CHARUCO), "tag 0 of DICT_4X4_50 is also on"),
        ((CHECKERBOARD, CHECKERBOARD), "checkerboard of the same size"),
        ((CHARUCO.replace("square_mm = 40", "square_mm = 60"),), "reaches over the edge"),
    ],
)
def test_boards_that_nobody_could_tell_apart_are_refused(patterns: tuple[str, ...], word: str) -> None:
    scene = parse_scene(text(*patterns), "test", Path())
    world = build_world(scene)
    with pytest.raises(TestfieldError, match=word):
        check_scene(scene, world, see(world), "test")
