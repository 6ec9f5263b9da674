"""Twins of boards of squares: light and blur from their corners, boards where the calibration has them."""

import json
import shutil
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from testfield.author.twin_boards import pattern_boards
from testfield.calibrate.calibration import Calibration
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.cli.main import main
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.job_file import job_of, load_job, save_job
from testfield.measure.patterns import patterns_of
from testfield.measure.seen_corners import crossings
from testfield.scene.build import build_world
from testfield.scene.schema import SceneFile
from testfield.targets.field_file import field_of_target
from testfield.uncertainty.halves import NO_HALVES

BLACK, WHITE, BLUR_PX, FINE = 40.0, 190.0, 0.9, 8


def test_corners_of_squares_show_black_white_and_blur() -> None:
    side, turn = 22.0, np.radians(11)
    grid = np.stack(np.meshgrid(np.arange(200 * FINE), np.arange(160 * FINE)), axis=-1) / FINE
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    on = ((grid - [100, 80]) @ R / side + 100).astype(int).sum(axis=-1) % 2
    fine = cv2.GaussianBlur(BLACK + (WHITE - BLACK) * on, (0, 0), BLUR_PX * FINE)
    pixels = fine.reshape(160, FINE, 200, FINE).mean(axis=(1, 3))
    k = np.stack(np.meshgrid(np.arange(-2, 3), np.arange(-2, 3)), axis=-1).reshape(-1, 2)
    xy = k * side @ R.T + [100, 80] - 0.5 + 0.5 / FINE
    found = np.median(list(crossings(pixels, xy, 30)), axis=0)
    assert found[:2] == pytest.approx([BLACK, WHITE], abs=1)
    assert found[2] == pytest.approx(np.hypot(BLUR_PX, np.sqrt(1 / 12)), rel=0.03)


@pytest.mark.parametrize(
    "kind",
    ["checkerboard:9x6:25", "charuco:7x5:DICT_4X4_50:30:22", "acircles:4x11:20:12", "hexcircles:6x7:26:15"],
)
def test_boards_of_the_scene_are_where_the_calibration_has_them(kind: str) -> None:
    field = field_of_target(kind)
    patterns = patterns_of(field, "here")
    pose = Poses(Rotation.from_rotvec([[0.2, -0.9, 2.1]]).as_matrix(), np.array([[10.0, 20, 30]]))
    inner = Interior(640, 480, np.array([600.0, 600, 320, 240, 0, 0, 0, 0, 0]))
    none = _nothing()
    calibration = Calibration(
        "x", inner, ("a",), Poses.identity(1), (patterns[0].name,), pose, 1.0, np.zeros((0, 0)), (), 1.0, 1, 0.1, 1
    )
    _, parts, (normal, offset, _) = pattern_boards(calibration, none, patterns, [], ())
    scene = SceneFile.model_validate(
        {
            "name": "t",
            "u_print_scale_ppm": 0,
            "volume": {"size_mm": [300, 300, 300]},
            "room": {"ambient_w_m2_sr": 1},
            "stations": [{"generator": "single", "position_mm": [0, 0, 900], "look_at_mm": [0, 0, 0]}],
            **{
                "boards": [
                    part | ({} if "square_mm" in part["pattern"] else {"print_sigma_mm": 0}) for part in parts["boards"]
                ]
            },
        }
    )
    world = build_world(scene)
    sheet = world.field.boards[0].marks.xy_mm
    flat = np.column_stack([sheet, np.zeros(len(sheet))])
    assert world.mark_world_mm == pytest.approx(flat @ pose.R[0].T + pose.t_mm[0], abs=1e-9)
    assert offset == pytest.approx(float(normal @ pose.t_mm[0]))


def test_boards_that_have_no_twin_are_refused_by_name() -> None:
    patterns = patterns_of(field_of_target("aprilgrid:6x6:88:26.4"), "here")
    with pytest.raises(TestfieldError, match="aprilgrid"):
        pattern_boards(None, None, patterns, [], ())  # type: ignore[arg-type]


def test_a_job_of_several_cameras_is_asked_again_as_it_was(tmp_path: Path) -> None:
    folders = [tmp_path / "left", tmp_path / "right"]
    save_job(job_of({"images": folders, "rig": True, "target": "checkerboard:9x6:25"}), tmp_path)
    job = load_job(tmp_path / "job.json")
    assert job.cameras
    assert {"--rig", "--target", "checkerboard:9x6:25"} == set(job.options)


SCENE = """name = "board"
seed = 4
u_print_scale_ppm = 0
[volume]
size_mm = [400, 300, 200]
[kinds.body]
width_px = 640
height_px = 480
pixel_pitch_um = 5.0
f_number = 8
psf_sigma_px = 0.6
{cameras}
[exposure]
time_ms = 9
[room]
ambient_w_m2_sr = 1.6
[[boards]]
name = "A"
size_mm = [310, 220]
position_mm = [0, 0, 300]
pattern = {{ {pattern} }}
[[stations]]
generator = "arc"
{held}
count = {count}
radius_mm = 420
height_mm = 450
azimuth_deg = [-35, 35]
look_at_mm = [0, 0, 300]
roll_deg = [0, 90, 180, -90]
[[stations]]
generator = "arc"
{held}
count = {count}
radius_mm = 400
height_mm = 150
azimuth_deg = [-30, 30]
look_at_mm = [0, 0, 300]
roll_deg = [90, 0, -90, 180]
"""
ONE = """[camera]
kind = "body"
focal_length_mm = 4.0
k1 = -0.08
"""
TWO = """[[cameras]]
name = "left"
kind = "body"
focal_length_mm = 4.0
k1 = -0.08
[[cameras]]
name = "right"
kind = "body"
focal_length_mm = 4.1
k1 = -0.09
[[rigs]]
name = "bar"
[[rigs.cameras]]
camera = "left"
position_mm = [-60, 0, 0]
[[rigs.cameras]]
camera = "right"
position_mm = [60, 0, 0]
rotation_deg = [0, -3, 0]
"""


@pytest.mark.slow
@pytest.mark.parametrize("several", [False, True], ids=["charuco", "two-cameras"])
def test_the_twin_of_a_board_scatters_as_its_photographs(
    several: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    room = import_module("testfield.measure.photographs")
    monkeypatch.setattr(room, "compare_halves", lambda *_: NO_HALVES)
    pattern = "columns = 10, rows = 7, square_mm = 28"
    pattern = f'kind = "checkerboard", {pattern}' if several else f'kind = "charuco", {pattern}, marker_mm = 21'
    cameras, held = (TWO, 'rig = "bar"') if several else (ONE, "")
    scene = tmp_path / "board.toml"
    scene.write_text(SCENE.format(cameras=cameras, pattern=pattern, held=held, count=3 if several else 4))
    assert main(["run", str(scene), "--out", str(tmp_path / "run"), "--jobs", "1"]) == 0
    frames, target = tmp_path / "run" / "frames", "charuco:10x7:DICT_4X4_50:28:21"
    taken = [str(frames)]
    if several:
        target, taken = "checkerboard:9x6:28", [str(tmp_path / "left"), str(tmp_path / "right"), "--rig"]
        for frame in frames.glob("*.png"):
            place, camera = frame.stem.rsplit("-", 1)
            (tmp_path / camera).mkdir(exist_ok=True)
            shutil.copy(frame, tmp_path / camera / f"{place}.png")
    out = str(tmp_path / "measured")
    assert main(["measure", *taken, "--target", target, "--hold", "k3", "--jobs", "1", "--out", out]) == 0
    capsys.readouterr()
    assert main(["twin", out, "--measure", "--json", "--jobs", "1"]) == 0
    rows = {row["title"]: row for row in json.loads(capsys.readouterr().out)["rows"]}
    assert 1 / 1.5 < rows["residual of a coordinate, rms"]["ratio"] < 1.5
    errors = [row for title, row in rows.items() if title.endswith("actual error of the focal length")]
    assert len(errors) == (2 if several else 1)


def _nothing() -> Observations:
    return Observations(
        stations=("a",),
        station=np.zeros(0, int),
        xy_px=np.zeros((0, 2)),
        cov_px2=np.zeros((0, 2, 2)),
        moments_px2=np.zeros((0, 2, 2)),
        code=np.zeros(0, int),
        board=np.zeros(0, int),
        point=np.zeros(0, int),
        chi2=np.zeros(0),
        status=np.zeros(0, object),
        centre_of_disc=False,
    )
