"""Calibration by name: the truth from exact observations, true claims from noisy ones, and what bad input gets."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.views import Uncertain
from testfield.camera.circle import disc_image
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation, rotation_vector
from testfield.camera.project import project
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.registry import find, names
from testfield.scene.build import build_world
from testfield.scene.frames import camera_looking
from testfield.scene.load import load_scene
from testfield.scene.schema import CertifiedPosesPart
from testfield.targets.field import CertifiedPose, Field, NominalBoard, ScaleBar
from testfield.targets.marks import Marks

WIDTH, HEIGHT = 2448, 2048
MIDDLE = ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
SIGMA_PX = 0.03
BROWN = Interior(WIDTH, HEIGHT, np.array([2600, 2604, 1236, 1015, -0.1, 0.08, 0.0, 3e-4, -2e-4]))
PINHOLE = Interior(WIDTH, HEIGHT, np.array([2600, 2604, 1236, 1015, 0, 0, 0, 0, 0.0]))
TSAI = Interior(WIDTH, HEIGHT, np.array([2600, 2604, *MIDDLE, -0.1, 0, 0, 0, 0.0]))
FISHEYE = Interior(WIDTH, HEIGHT, np.array([2200, 2203, 1236, 1015, 0.02, -0.006, 2e-3, -4e-4]), "fisheye")
RATIONAL = Interior(
    WIDTH, HEIGHT, np.array([2600, 2604, 1236, 1015, -0.1, 0.08, 3e-4, -2e-4, 0, 0, 0, 0, 0, 0, 0, 0.0]), "rational"
)
SHEAR = Interior(WIDTH, HEIGHT, np.array([2600, 2604, 1236, 1015, -0.1, 0.08, 0.0, 3e-4, -2e-4, 2e-3]), "brown_shear")
BOARDS = Poses(
    rotation(np.array([[0, 0, 0], [0.35, 0.45, 0.2], [-0.4, 0.3, -0.3]])),
    np.array([[0, 0, 0], [620.0, 40, 120], [-80, 560, 150]]),
)
GRID = np.stack(np.meshgrid(np.linspace(-240, 240, 6), np.linspace(-190, 190, 5)), -1).reshape(-1, 2)
BAR_MM = np.array([[-300.0, -330, 60], [560, -340, 30]])


def sheet(u_xy_mm: float = 0.0, u_scale: float = 0.0, bar: bool = True) -> Field:
    """Three boards of 6 x 5 coded marks and a control bar."""
    boards = tuple(
        NominalBoard(name, Marks(GRID, np.full(30, 12.0), 1 + 30 * b + np.arange(30)), u_xy_mm, 0.0)
        for b, name in enumerate("ABC")
    )
    length = float(np.linalg.norm(BAR_MM[0] - BAR_MM[1]))
    bars = (ScaleBar("bar", "control", (101, 102), length, 0.01),) if bar else ()
    return Field(14, boards, bars, {101: 12.0, 102: 12.0}, u_scale=u_scale)


@cache
def around(count: int = 9, face_on: bool = False) -> Poses:
    """Stations around the boards, each quarter turn once, or side by side and face on."""
    poses = []
    for k in range(count):
        angle = 2 * np.pi * k / count
        place = np.array([200 + 900 * np.cos(angle), 150 + 900 * np.sin(angle), 1700.0 + 100 * (k % 3)])
        aim = np.array([220.0, 150, 60])
        if face_on:
            place, aim = np.array([200.0 + 10 * k, 150, 2000]), np.array([200.0 + 10 * k, 150, 0])
        poses.append(camera_looking(place, aim, np.pi / 2 * (k % 4)))
    return Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))


def seen(
    camera: Interior = BROWN,
    stations: Poses | None = None,
    boards: Poses = BOARDS,
    noise: np.random.Generator | None = None,
    discs: bool = False,
) -> Observations:
    """What all stations see of all marks, in the frame of board A."""
    stations = around() if stations is None else stations
    b, count = len(boards), len(stations)
    local = np.column_stack([GRID, np.zeros(30)])
    xyz = np.vstack([*(local @ boards.R[k].T + boards.t_mm[k] for k in range(b)), BAR_MM])
    normal = np.vstack([np.repeat(boards.R[:, :, 2], 30, axis=0), [[0, 0, 1.0]] * 2])
    board, point = np.append(np.repeat(np.arange(b), 30), [-1, -1]), np.append(np.tile(np.arange(30), b), [-1, -1])
    code = np.append(1 + np.arange(30 * b), [101, 102])
    s, k = (v.ravel() for v in np.meshgrid(np.arange(count), np.arange(len(xyz)), indexing="ij"))
    image = disc_image(camera, stations[s], xyz[k], normal[k], np.full(len(k), 6.0))
    xy = image.centroid_px if discs else project(camera, stations[s], xyz[k])
    n = len(s)
    xy = xy + (SIGMA_PX * noise.standard_normal(xy.shape) if noise else 0)
    inside = np.isfinite(xy).all(axis=1) & (np.abs(xy - MIDDLE) < np.add(MIDDLE, 0.5)).all(axis=1)
    rows = Observations(
        stations=tuple(f"s{i}" for i in range(count)),
        station=s,
        xy_px=xy,
        cov_px2=np.tile(SIGMA_PX**2 * np.eye(2), (n, 1, 1)),
        moments_px2=image.moments_px2,
        code=code[k],
        board=board[k],
        point=point[k],
        chi2=np.ones(n),
        status=np.full(n, MEASURED, object),
        centre_of_disc=discs,
    )
    return rows.take(inside)


def certified(field: Field, u_turn_rad: float = 0.0, u_mm: float = 0.0, off: np.ndarray | None = None) -> Field:
    """The sheet with the boards' poses, which are off by (2, 6) small turns and shifts."""
    off = np.zeros((2, 6)) if off is None else off
    boards = [field.boards[0]]
    for b, sheet_ in enumerate(field.boards[1:], 1):
        R = rotation(off[b - 1, :3]) @ BOARDS.R[b]
        pose = CertifiedPose(
            tuple(rotation_vector(R[None])[0]), tuple(BOARDS.t_mm[b] + off[b - 1, 3:]), u_turn_rad, u_mm
        )
        boards.append(replace(sheet_, pose=pose))
    return replace(field, boards=tuple(boards))


def calibrated(method: str, rows: Observations, field: Field, lens: str = "brown", **more: object) -> Calibration:
    return find("calibrators", method)(rows, field, WIDTH, HEIGHT, lens, **more)


def errors(found: Calibration, camera: Interior, first: int = 0) -> np.ndarray:
    """Found minus true of everything with a label, in the frame of board `first`."""
    datum = BOARDS[np.full(len(around()), first)]
    stations, boards = around().after(datum), BOARDS[np.full(3, first)].inverse().after(BOARDS)
    true = {name: value for name, value in zip(camera.names, camera.parameters, strict=True)}
    got = {name: value for name, value in zip(found.interior.names, found.interior.parameters, strict=True)}
    answer = [got[name] - true[name] for name in found.labels if name in true]
    for k, name in enumerate(found.station_names):
        answer += _off(found.stations, k, stations, int(name[1:]))
    for k, name in enumerate(found.board_names):
        if f"board:{name}.rx" in found.labels:
            answer += _off(found.boards, k, boards, "ABC".index(name))
    return np.array(answer + [found.scale - 1] * ("scale" in found.labels))


def _off(found: Poses, k: int, true: Poses, j: int) -> list[float]:
    return [*rotation_vector((found.R[k] @ true.R[j].T)[None])[0], *(found.t_mm[k] - true.t_mm[j])]


def nees(found: Calibration, camera: Interior, first: int = 0) -> float:
    error = errors(found, camera, first)
    own = found.index([label for label in found.labels if not label.startswith("point:")])
    return float(error @ np.linalg.solve(found.covariance[np.ix_(own, own)], error) / len(error))


def test_every_method_is_announced() -> None:
    assert {"stitched", "stitched_given", "zhang", "tsai", "dlt", "opencv", "opencv_ro", "colmap"} <= set(
        names("calibrators")
    )


EXACT = {
    "stitched": (BROWN, "brown", (), 1e-7),
    "stitched, sheared": (SHEAR, "brown_shear", (), 1e-7),
    "stitched_given": (BROWN, "brown", (), 1e-7),
    "zhang": (BROWN, "brown", (), 1e-7),
    "tsai": (TSAI, "brown", (), 1e-7),
    "dlt": (PINHOLE, "brown", (), 1e-6),
    # OpenCV takes pixels in single precision: 6e-5 px near 1000.
    "opencv": (BROWN, "brown", (), 0.05),
    "opencv, fisheye": (FISHEYE, "fisheye", (), 0.05),
    "opencv_ro": (BROWN, "brown", (), 0.05),
    "colmap": (BROWN, "brown", ("k3",), 1e-4),
    "colmap, fisheye": (FISHEYE, "fisheye", (), 1e-3),
}


@pytest.mark.parametrize("case", EXACT)
def test_exact_observations_give_the_truth(case: str) -> None:
    camera, lens, hold, limit = EXACT[case]
    method = case.split(",")[0]
    if method == "colmap":
        pytest.importorskip("pycolmap")
    field = certified(sheet()) if method in ("stitched_given", "dlt") else sheet()
    found = calibrated(method, seen(camera), field, lens, hold=hold)
    assert found.method == method
    assert np.abs(errors(found, camera)).max() < limit, found.notes
    assert found.reprojection_rms_px < 1e-4
    assert len(found.labels) == len(found.covariance)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()


NOISY = {
    "stitched": (BROWN, ("k3",), 0.3),
    "zhang": (BROWN, ("k3",), 0.3),
    "tsai": (TSAI, (), 0.3),
    "stitched_given": (BROWN, ("k3",), 0.3),
    "dlt": (PINHOLE, (), 0.5),
}


@pytest.mark.parametrize("method", NOISY)
def test_claims_of_our_own_methods_are_the_scatter_of_their_errors(method: str) -> None:
    camera, hold, limit = NOISY[method]
    rng, values = np.random.default_rng(4), []
    for _ in range(6):
        field, u_turn, u_mm = sheet(), 2e-5, 0.02
        if method == "stitched_given":
            off = rng.standard_normal((2, 6)) * ([u_turn] * 3 + [u_mm] * 3)
            field = certified(field, u_turn, u_mm, off)
        elif method == "dlt":
            field = certified(field)
        rows = seen(camera, noise=rng)
        if method == "dlt":  # boards are exact here, and no error of theirs to be judged
            found = calibrated(method, rows, field)
            count = 4 + 6 * len(found.station_names)
            error = errors(found, camera)[:count]
            values.append(error @ np.linalg.solve(found.covariance[:count, :count], error) / count)
        else:
            found = calibrated(method, rows, field, hold=hold)
            values.append(nees(found, camera))
    # 6 x 60 or more degrees of freedom: the mean scatters by 0.07
    assert np.mean(values) == pytest.approx(1, abs=limit), values


def test_opencv_on_the_same_observations_finds_the_same_minimum_and_the_same_standard_deviations() -> None:
    import cv2

    from testfield.calibrate.opencv import CRITERIA

    rows = seen(noise=np.random.default_rng(3))
    rows = replace(rows, xy_px=rows.xy_px.astype(np.float32).astype(float))
    field = sheet(bar=False)
    theirs, ours = calibrated("opencv", rows, field, board="A"), calibrated("zhang", rows, field, board="A")
    assert theirs.used == ours.used
    assert abs(theirs.reprojection_rms_px - ours.reprojection_rms_px) < 1e-6
    # Their own claim, which the normal equations at their solution must repeat.
    here = [np.flatnonzero((rows.station == s) & (rows.board == 0)) for s in range(9)]
    xyz = np.column_stack([GRID, np.zeros(30)]).astype(np.float32)
    _, _, _, _, _, sigma, _, _ = cv2.calibrateCameraExtended(
        [xyz[rows.point[v]] for v in here],
        [rows.xy_px[v].astype(np.float32) for v in here],
        (WIDTH, HEIGHT),
        theirs.interior.matrix,
        np.zeros(5),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS,
        criteria=CRITERIA,
    )
    at = theirs.index(["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"])
    claimed = np.sqrt(theirs.covariance[at, at])
    ratio = claimed / sigma.ravel()[:9]
    assert np.allclose(ratio, ratio[0], rtol=1e-3)
    assert ratio[0] == pytest.approx(1, abs=0.02)


def test_chained_opencv_poses_claim_their_scatter() -> None:
    rng = np.random.default_rng(9)
    values = [nees(calibrated("opencv", seen(noise=rng), sheet(), hold=("k3",)), BROWN) for _ in range(6)]
    assert np.mean(values) == pytest.approx(1, abs=0.3), values


def test_given_poses_are_worth_what_their_uncertainty_says() -> None:
    rows = seen(noise=np.random.default_rng(1))
    u = []
    for method, field in (
        ("stitched_given", certified(sheet())),
        ("stitched_given", certified(sheet(), 1.0, 1e5)),
        ("stitched", sheet()),
    ):
        found = calibrated(method, rows, field, hold=("k3",))
        u.append(np.sqrt(found.covariance[found.index(["fx", "board:B.tz"]), found.index(["fx", "board:B.tz"])]))
    assert (u[0] < 0.95 * u[2]).all()  # exact poses help
    assert np.allclose(u[1], u[2], rtol=1e-3)  # a vague certificate says nothing


def test_given_poses_join_boards_that_share_no_image_and_need_no_first_board() -> None:
    rows = seen()
    apart = rows.take(((rows.station < 5) & (rows.board == 1)) | ((rows.station >= 5) & (rows.board == 2)))
    found = calibrated("stitched_given", apart, certified(sheet(bar=False)))
    assert found.board_names == ("A", "B", "C")
    assert np.abs(errors(found, BROWN)).max() < 1e-4
    with pytest.raises(TestfieldError, match="certifies the pose of no board"):
        calibrated("stitched_given", rows, sheet())


def test_a_sheet_with_poses_is_read_as_it_was_written(tmp_path) -> None:  # type: ignore[no-untyped-def]
    field = certified(sheet(), 1e-5, 0.02)
    field.save(tmp_path / "field.json")
    again = Field.load(tmp_path / "field.json")
    assert [b.pose for b in again.boards] == [b.pose for b in field.boards]


def test_the_graph_says_how_good_each_joint_is_and_how_far_each_board(tmp_path) -> None:  # type: ignore[no-untyped-def]
    rows = seen(noise=np.random.default_rng(2))
    # C is seen only where B is, and A never with it: a chain A - B - C.
    rows = rows.take(~((rows.board == 2) & (rows.station < 6)) & ~((rows.board == 0) & (rows.station >= 6)))
    found = calibrated("stitched", rows, sheet(), hold=("k3",))
    assert {(j["station"], j["board"]) for j in found.joints} == {(s, b) for s, b, _ in found.graph}
    assert all(0 < j["redundancy"] < 1 and 0.01 < j["rms_px"] < 0.08 for j in found.joints)
    assert [q["links"] for q in found.board_quality] == [0, 1, 2]
    u = [q["u_position_mm"] for q in found.board_quality]
    assert u[0] is None and 0 < u[1] < u[2]
    assert found.test["passed"] and found.test["least_redundancy"] > 0.1
    found.save(tmp_path / "c.json")
    again = Calibration.load(tmp_path / "c.json")
    assert again.joints == found.joints and again.test == found.test


def said(found: Calibration, *parts: str) -> bool:
    return any(all(part in note for part in parts) for note in found.notes)


def test_good_observations_raise_no_doubt() -> None:
    assert not calibrated("stitched", seen(noise=np.random.default_rng(2)), sheet(), hold=("k3",)).notes


def test_views_without_roll_name_what_leans_on_tilts() -> None:
    aim, places = np.array([220.0, 150, 60]), [np.array([x, -1300.0, 1300]) for x in range(0, 500, 60)]
    poses = [camera_looking(place, aim, 0.0) for place in places]
    level = seen(stations=Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses])))
    assert said(calibrated("stitched", level, sheet()), "never turned about its axis", "cx, cy, p1, p2")


def test_views_face_on_name_the_focal_length() -> None:
    flat = Poses(np.tile(np.eye(3), (3, 1, 1)), np.array([[0, 0, 0], [520.0, 0, 0], [0, 420, 0]]))
    rows = seen(PINHOLE, around(face_on=True), flat, noise=np.random.default_rng(5))
    try:
        found = calibrated("stitched", rows, sheet(bar=False))
    except TestfieldError as error:
        assert "face on" in str(error)
    else:
        assert said(found, "face on", "fx, fy", "tz")
        assert said(found, "hardly determined together", "fx")


def test_a_small_part_of_the_image_is_named() -> None:
    rows = seen()
    small = rows.take((np.abs(rows.xy_px - MIDDLE) < [700, 600]).all(axis=1))
    assert said(calibrated("stitched", small, sheet()), "cover", "% of the image", "k1")


def test_groups_that_share_no_image_are_named_and_the_larger_is_solved() -> None:
    rows = seen()
    apart = rows.take(((rows.station < 6) & (rows.board != 2)) | ((rows.station >= 6) & (rows.board == 2)))
    found = calibrated("stitched", apart, sheet(bar=False))
    assert said(found, "board 'C', seen by 's6', 's7', 's8'", "shares no image", "left out")
    assert found.board_names == ("A", "B") and np.abs(errors(found, BROWN)).max() < 1e-4


def test_a_bar_seen_once_is_named_and_left_out() -> None:
    rows = seen()
    once = rows.take((rows.code != 102) | (rows.station == 3))
    found = calibrated("stitched", once, sheet())
    assert said(found, "control bar 'bar'", "code 101 in 9 images", "code 102 in 1 image)", "left out")
    assert np.abs(errors(found, BROWN)).max() < 1e-4


def test_a_code_seen_twice_in_an_image_is_rejected_twice() -> None:
    rows = seen()
    k = int(np.flatnonzero((rows.station == 2) & (rows.code == 40))[0])
    ghost = rows.take(np.array([k]))
    rows = Observations.beside([rows, replace(ghost, xy_px=ghost.xy_px + 300)])
    found = calibrated("stitched", rows, sheet())
    assert said(found, "code 40 of board 'B'", "more than once in image 's2'", "rejected")
    assert [r["why"] for r in found.rejected] == ["ambiguous"] * 2
    assert np.abs(errors(found, BROWN)).max() < 1e-4


def test_a_code_on_two_sheets_is_rejected() -> None:
    field = sheet()
    b = field.boards[1]
    twice = replace(b, marks=replace(b.marks, code=np.where(b.marks.code == 40, 5, b.marks.code)))
    rows = seen()
    rows = replace(rows, code=np.where(rows.code == 40, 5, rows.code))
    found = calibrated("stitched", rows, replace(field, boards=(field.boards[0], twice, field.boards[2])))
    assert said(found, "lists code 5 on board 'A' and board 'B'")
    assert np.abs(errors(found, BROWN)).max() < 1e-4


def test_a_bar_in_metres_is_named_and_left_out() -> None:
    field = sheet()
    bar = field.scale_bars[0]
    found = calibrated("stitched", seen(), replace(field, scale_bars=(replace(bar, length_mm=bar.length_mm / 1000),)))
    assert said(found, "control bar 'bar'", "is the sheet in metres instead of millimetres?", "left out")
    assert np.abs(errors(found, BROWN)).max() < 1e-4


def test_a_board_in_metres_is_named_and_left_out() -> None:
    field = sheet()
    b = field.boards[1]
    metres = replace(b, marks=replace(b.marks, xy_mm=b.marks.xy_mm / 1000, diameter_mm=b.marks.diameter_mm / 1000))
    found = calibrated("stitched", seen(), replace(field, boards=(field.boards[0], metres, field.boards[2])))
    assert said(found, "board 'B' is about 10", "times as small", "metres instead of millimetres", "left out")
    assert found.board_names == ("A", "C") and np.abs(errors(found, BROWN)).max() < 1e-4


def test_dots_in_metres_are_named_and_their_size_is_taken_from_the_images() -> None:
    field = sheet()
    boards = tuple(replace(b, marks=replace(b.marks, diameter_mm=b.marks.diameter_mm / 1000)) for b in field.boards)
    rows = seen(discs=True)
    found = calibrated("stitched", rows, replace(field, boards=boards))
    assert said(found, "dots of board 'A'", "metres instead of millimetres")
    assert np.abs(errors(found, BROWN)).max() < 0.02
    assert not said(calibrated("stitched", rows, field), "dots of board")


def test_observations_that_are_no_numbers_are_an_error_that_names_the_row() -> None:
    rows = seen()
    xy = rows.xy_px.copy()
    xy[17] = np.nan
    with pytest.raises(TestfieldError, match=r"observation 17 .*'s0'.*is not finite"):
        calibrated("zhang", replace(rows, xy_px=xy), sheet())


def test_one_station_is_enough_for_tsai_alone() -> None:
    rows = seen(TSAI)
    one = rows.take(rows.station == 1)
    found = calibrated("tsai", one, sheet(bar=False))
    assert np.abs(found.interior.parameters - TSAI.parameters).max() < 1e-5
    with pytest.raises(TestfieldError, match="fewer than two stations"):
        calibrated("stitched", one, sheet(bar=False))


def test_residuals_larger_than_claimed_are_said_to_be() -> None:
    rows = seen(noise=np.random.default_rng(2))
    found = calibrated("stitched", replace(rows, cov_px2=rows.cov_px2 / 4), sheet())
    assert said(found, "larger than claimed")
    assert found.test["variance"] == pytest.approx(4, rel=0.15)
    assert not found.test["passed"]


def test_dlt_without_given_poses_or_depth_says_so() -> None:
    with pytest.raises(TestfieldError, match="'dlt' needs points that are known in space"):
        calibrated("dlt", seen(PINHOLE), sheet())
    rows = seen(PINHOLE)
    with pytest.raises(TestfieldError, match="different planes"):
        calibrated("dlt", rows.take(rows.board == 0), certified(sheet()))


def test_a_wrong_certified_pose_of_a_board_is_named_and_not_used() -> None:
    rows = seen(noise=np.random.default_rng(1))
    off = np.zeros((2, 6))
    off[0, 3:] = 1.0  # a millimetre, where 0.02 is claimed
    wrong = calibrated("stitched_given", rows, certified(sheet(), 2e-5, 0.02, off), hold=("k3",))
    assert said(wrong, "certified pose of board 'B'", "not used") and not wrong.rejected
    assert nees(wrong, BROWN) < 1.5
    right = calibrated("stitched_given", rows, certified(sheet(), 2e-5, 0.02), hold=("k3",))
    assert right.test["passed"] and not right.notes


def test_chained_poses_follow_their_parts_as_differences_say() -> None:
    rng = np.random.default_rng(0)
    R, t = rotation(rng.normal(0, 1, (2, 3))), rng.normal(0, 300, (2, 3))
    unit = np.eye(12)

    def chained(step: np.ndarray) -> Uncertain:
        moved = rotation(step.reshape(2, 6)[:, :3]) @ R
        a, b = (Uncertain(moved[k], t[k] + step.reshape(2, 6)[k, 3:], unit[6 * k : 6 * k + 6]) for k in (0, 1))
        return a.inverse().after(b)

    here = chained(np.zeros(12))
    for k in range(12):
        up, down = chained(1e-5 * unit[k]), chained(-1e-5 * unit[k])
        turn = rotation_vector((up.R @ down.R.T)[None])[0] / 2e-5
        assert np.allclose(turn, here.by[:3, k], atol=1e-7)
        assert np.allclose((up.t_mm - down.t_mm) / 2e-5, here.by[3:, k], atol=1e-4)


def test_a_scene_certifies_poses_as_well_as_it_says_and_changes_nothing_else() -> None:
    scene = load_scene(Path(__file__).parents[1] / "scenes/quick.toml")
    plain = build_world(scene)
    true = plain.world_from_board[np.zeros(3, int)].inverse().after(plain.world_from_board)
    for u_mm, u_deg in ((0.0, 0.0), (0.5, 0.02)):
        part = CertifiedPosesPart(u_position_mm=u_mm, u_rotation_deg=u_deg)
        world = build_world(scene.model_copy(update={"certified_poses": part}))
        assert np.array_equal(world.marks.xy_mm, plain.marks.xy_mm)
        assert world.field.boards[0].pose is None
        shifts, turns = [], []
        for k in (1, 2):
            pose = world.field.boards[k].pose
            assert pose is not None and pose.u_mm == u_mm
            shifts.append(np.array(pose.t_mm) - true.t_mm[k])
            turns.append(rotation_vector((rotation(np.array(pose.turn_rad)) @ true.R[k].T)[None])[0])
        rms_mm, rms_deg = np.sqrt(np.mean(np.square(shifts))), np.degrees(np.sqrt(np.mean(np.square(turns))))
        assert (rms_mm < 1e-9 and rms_deg < 1e-9) if u_mm == 0 else (0.2 < rms_mm < 1 and 0.008 < rms_deg < 0.04)
    assert all(board.pose is None for board in plain.field.boards)


@pytest.mark.parametrize("method", ["gls", "midpoint", "ml", "bundle", "parametric_wls", "dlt"])
def test_a_field_without_loose_targets_gives_no_points_and_no_error(method: str) -> None:
    field = replace(sheet(bar=False), loose={})
    rows = seen().take(seen().board >= 0)
    found = find("reconstructors", method)(rows, calibrated("stitched", rows, field), field)
    assert len(found.code) == 0
