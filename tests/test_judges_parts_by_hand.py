"""Small parts of what scores and judges, each at its bounds and against arithmetic by hand."""

import dataclasses
import json
import pkgutil
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hand_made import HandMade

from testfield.chain.keys import expose_key
from testfield.errors import TestfieldError
from testfield.scene.load import load_scene
from testfield.score.acceptance import _nearest, acceptance, points_card
from testfield.score.align import aligned_covariance, rigid_basis, rigid_fit, row_of
from testfield.score.camera import _places
from testfield.score.length_test import Limit, MeasuredLengths, judge
from testfield.score.scorecard import load_scorecard, scorecard, write_scorecard
from testfield.seeds import normals, normals_of_marks
from testfield.statistics.consistency import MOST_TRIALS, trials_to_tell

UM = 1e-3


def test_whatever_the_scorer_hands_over_is_frozen() -> None:
    rooms = [
        f"testfield.score.{module.name}" for module in pkgutil.iter_modules(import_module("testfield.score").__path__)
    ]
    rooms += ["testfield.chain.keys", "testfield.uncertainty.statement", "testfield.report.measured"]
    classes = {
        value
        for room in rooms
        for value in vars(import_module(room)).values()
        if dataclasses.is_dataclass(value) and isinstance(value, type) and value.__module__ == room
    }
    assert len(classes) >= 6
    assert [value.__name__ for value in classes if not value.__dataclass_params__.frozen] == []  # type: ignore[attr-defined]


# ------------------------------------------------------------------ random numbers of marks
def test_the_numbers_of_a_mark_are_those_of_its_board_its_code_or_its_turn() -> None:
    """Six observations of two stations: two of a board, two by their codes, two plain dots."""
    station = np.array([1, 1, 0, 1, 1, 1, 0])
    board = np.array([0, 1, -1, -1, -1, -1, -1])
    point = np.array([3, 0, -1, -1, -1, -1, -1])
    code = np.array([0, 7, 5, 2, 0, 0, 0])
    drawn = normals_of_marks(9, ("left", "right"), ("A", "B"), station, board, point, code)
    expected = [
        normals(9, "pixels/right/board/A", 4, 2)[3],
        normals(9, "pixels/right/board/B", 1, 2)[0],
        normals(9, "pixels/left/loose", 6, 2)[5],
        normals(9, "pixels/right/loose", 3, 2)[2],
        *normals(9, "pixels/right/plain", 2, 2),
        *normals(9, "pixels/left/plain", 1, 2),
    ]
    assert drawn.tolist() == np.array(expected).tolist()


def test_a_frame_depends_on_the_noise_and_on_the_sensors_own_seed() -> None:
    """Where none is given the scene's seed stands for it."""
    scene = load_scene(Path(__file__).parents[1] / "scenes/quick.toml")
    other = scene.seed + 1
    key = expose_key(scene, "left", "light")
    assert expose_key(scene, "left", "light", scene.seed) == key
    assert expose_key(scene.model_copy(update={"noise_seed": scene.seed}), "left", "light") == key
    others = [
        expose_key(scene, "left", "light", other),
        expose_key(scene, "left", "light", 0),
        expose_key(scene.model_copy(update={"noise_seed": other}), "left", "light"),
        expose_key(scene.model_copy(update={"seed": other}), "left", "light"),
        expose_key(scene, "right", "light"),
        expose_key(scene, "left", "other light"),
    ]
    assert len({key, *others}) == 7


# ------------------------------------------------------------------ limits
@pytest.mark.parametrize(
    ("dl_mm", "u_mm", "within", "verdict", "shown"),
    [
        (0.25, 0.0, True, "passed", "shown"),
        (-0.25, 0.0, True, "passed", "shown"),
        (0.25 + 2**-20, 0.0, False, "failed", "refuted"),
        (0.25, 0.0625, True, "passed", "open"),
        (0.125, 0.0625, True, "passed", "shown"),  # 0.125 + 2 * 0.0625 is the limit
        (0.125 + 2**-20, 0.0625, True, "passed", "open"),
        (0.375, 0.0625, False, "failed", "open"),  # and 0.375 less that
        (0.375 + 2**-20, 0.0625, False, "failed", "refuted"),
    ],
)
def test_an_error_of_just_the_limit_is_within_it(
    dl_mm: float, u_mm: float, within: bool, verdict: str, shown: str
) -> None:
    """All numbers are exact in binary."""
    one = MeasuredLengths(
        ("x",), np.array([[1, 2]]), np.array([512.0]), np.array([u_mm]), np.array([512 + dl_mm]), np.eye(1)
    )
    limit = Limit(0.25)
    (row,) = one.rows(limit)
    found = judge(one, limit)
    assert (row["within"], found["verdict"], found["with_test_uncertainty"]) == (within, verdict, shown)
    assert (found["outside"], found["missing"], found["b_mm"], found["k_ppm"]) == (int(not within), 0, None, 0.0)


def test_neighbours_are_those_of_two_targets_or_more() -> None:
    a, b = np.array([0.0, 0, 0]), np.array([3.0, 4, 0])
    assert _nearest({}) == [] and _nearest({7: a}) == []
    assert _nearest({9: b, 7: a}) == [("7 to 9", 7, 9, 5.0, 0.0)]


def test_points_that_state_no_uncertainty_are_not_accepted(by_hand: HandMade) -> None:
    scene: Any = None  # nothing of it is asked before that
    silent = replace(by_hand.points, cov_xyz_mm2=np.full_like(by_hand.points.cov_xyz_mm2, np.nan))
    with pytest.raises(TestfieldError, match="no covariance of the points is stated"):
        acceptance(scene, by_hand.world, by_hand.calibration, silent)


@pytest.mark.parametrize(("dl_um", "within", "covered"), [(2.0, 1.0, 0.0), (1.9, 1.0, 1.0), (2.0 + 1e-9, 0.0, 0.0)])
def test_the_share_of_lengths_within_one_holds_one_itself(
    by_hand: HandMade, dl_um: float, within: float, covered: float
) -> None:
    """u = 1 um, so E_n is 1 at 2 um, and 95 % are covered up to 1.96 um."""
    off = np.array([dl_um * UM, 0.0])
    two = MeasuredLengths(("x",) * 2, np.ones((2, 2), int), np.zeros(2), np.zeros(2), off, UM**2 * np.eye(2))
    card = points_card(by_hand.world, by_hand.calibration, by_hand.points, two)
    assert card is not None
    share = card["of_lengths"]
    assert [share[key] for key in ("en_within_1", "zeta_within_2", "covered_95")] == pytest.approx(
        [(1 + within) / 2, (1 + within) / 2, (1 + covered) / 2]
    )


# ------------------------------------------------------------------ fits
def test_a_single_point_is_moved_and_not_turned() -> None:
    R, t = rigid_fit(np.array([[1.0, 2, 3]]), np.array([[4.0, 4, 4]]))
    assert R.tolist() == np.eye(3).tolist() and t.tolist() == [3, 2, 1]
    assert rigid_basis(np.array([[1.0, 2, 3]])).tolist() == np.eye(3).tolist()
    assert aligned_covariance(np.eye(3), np.array([[1.0, 2, 3]])) == pytest.approx(np.zeros((3, 3)), abs=1e-15)
    direction = row_of(np.array([[1.0, 2, 3]]))
    assert direction is not None and direction.tolist() == [0, 0, 0]


@pytest.mark.parametrize("angle", [0.0, 1e-3, 2.0, np.pi - 1e-3, np.pi])
def test_a_row_is_turned_the_short_way_whatever_its_turn(angle: float) -> None:
    """The row along x, measured turned about z by the angle and shifted, comes back, and z stays z."""
    true = np.outer([-1.0, 0, 2], [1.0, 0, 0])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    R, t = rigid_fit(true @ turn.T + [5, 6, 7], true)
    assert (true @ turn.T + [5, 6, 7]) @ R.T + t == pytest.approx(true, abs=1e-9)
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-12) and np.abs(R @ R.T - np.eye(3)).max() < 1e-12
    assert (np.trace(R) - 1) / 2 == pytest.approx(np.cos(angle), abs=1e-9)
    if angle < np.pi:
        assert R[2] == pytest.approx([0, 0, 1], abs=1e-9)
    assert rigid_basis(true).shape == (9, 5)


@pytest.mark.parametrize(("aside_mm", "straight"), [(0.9e-6, True), (1.1e-6, False)])
def test_a_row_is_straight_to_a_millionth(aside_mm: float, straight: bool) -> None:
    """Four points at the corners of 1 mm by that much: their spreads are as these sides."""
    points = np.array([[x, y, 0.0] for x in (-0.5, 0.5) for y in (-0.5 * aside_mm, 0.5 * aside_mm)])
    assert (row_of(points) is not None) == straight
    assert rigid_basis(points).shape == (12, 5 if straight else 6)


def test_a_pixel_on_the_images_last_edge_belongs_to_the_last_cells(by_hand: HandMade) -> None:
    """Of cells of 100 px, the last column and row: each time that which is nearer to the middle of its cell."""
    camera = replace(by_hand.world.interior, width_px=1300, height_px=1100)
    seen = np.array([[1300.0, 50], [1240, 40], [50, 1100], [40, 1060], [1300, 1100], [1255, 1045]])
    assert _places(camera, seen).tolist() == [[1240, 40], [40, 1060], [1255, 1045]]


def test_small_turns_are_about_the_middle_and_move_it_nowhere() -> None:
    points = np.array([[1.0, 2, 3], [5, 2, 3], [3, 8, 3], [3, 4, 11]])
    basis = rigid_basis(points).reshape(4, 3, 6)
    assert basis[:, :, 3:].mean(axis=0) == pytest.approx(np.zeros((3, 3)), abs=1e-12)
    first = basis[0, :, 3:].T  # of a point (-2, -2, -2) from the middle
    assert first == pytest.approx(np.cross(np.eye(3), [-2, -2, -2]))


# ------------------------------------------------------------------ trials
@pytest.mark.parametrize(("freedom", "factor"), [(1, 0.0), (1, -2.0), (1, 1.0), (0, 2.0), (-1, 2.0)])
def test_what_no_number_of_trials_tells_is_refused(freedom: int, factor: float) -> None:
    with pytest.raises(TestfieldError, match="cannot be told"):
        trials_to_tell(freedom, factor)


def test_a_factor_too_near_to_one_is_refused_and_the_least_number_of_trials_is_found() -> None:
    with pytest.raises(TestfieldError, match=f"{MOST_TRIALS} trials"):
        trials_to_tell(1, 1.0001)
    assert trials_to_tell(1, 1e6) == 1
    # In units of degrees of freedom: as many are needed however they are shared out.
    alone = trials_to_tell(1, 2.0)
    assert [trials_to_tell(n, 2.0) for n in (2, 7, alone - 1, alone, 10 * alone)] == [
        -(-alone // 2),
        -(-alone // 7),
        2,
        1,
        1,
    ]
    assert trials_to_tell(1, 0.5) == alone
    assert trials_to_tell(1, 2.0, level=0.05) < alone and trials_to_tell(1, 2.0, power=0.9) < alone
    assert trials_to_tell(1, 2.0, level=0.01, power=0.99) == alone


# ------------------------------------------------------------------ scorecards
@pytest.fixture
def card(by_hand: HandMade, tmp_path: Path) -> tuple[Path, dict[str, Any]]:
    """Where the hand-made run's scorecard is to be, and what stands in it."""
    names = [tmp_path / name for name in ("observations.parquet", "calibration.json", "points.parquet")]
    by_hand.observations.save(names[0])
    by_hand.calibration.save(names[1])
    by_hand.points.save(names[2])
    return tmp_path / "scorecard.json", scorecard(by_hand.world, by_hand.views, *names) | {"time_s": {}}


def test_a_scorecard_has_a_line_for_each_figure(card: tuple[Path, dict[str, Any]]) -> None:
    path, figures_of = card
    write_scorecard(figures_of, path)
    lines = path.read_text(encoding="utf-8").splitlines()
    assert ' "scene": "by hand",' in lines and '  "wrong_code": 3,' in lines
    kept = json.loads(path.read_text(encoding="utf-8"))
    assert load_scorecard(path) | {"format": 1} == kept


@pytest.mark.parametrize("name", ["mark_shift_rms_mm", "translation_error_mm", "rotation_error_mrad"])
@pytest.mark.parametrize("count", [1, 3])
def test_a_scorecard_has_as_many_figures_as_boards(card: tuple[Path, dict[str, Any]], name: str, count: int) -> None:
    path, figures_of = card
    figures_of["boards"][name] = [0.5] * count
    write_scorecard(figures_of, path)
    with pytest.raises(TestfieldError, match=f"{name} has not one figure a board"):
        load_scorecard(path)


def test_a_scorecard_of_measured_points_has_their_band(card: tuple[Path, dict[str, Any]]) -> None:
    path, figures_of = card
    figures_of["points"]["anees_band_95"] = None
    write_scorecard(figures_of, path)
    with pytest.raises(TestfieldError, match="anees_band_95 is missing"):
        load_scorecard(path)
    figures_of["points"]["measured"] = 0
    write_scorecard(figures_of, path)
    assert load_scorecard(path)["points"]["anees_band_95"] is None
