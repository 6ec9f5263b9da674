"""The virtual mother board: how true it is to the marks, and whether it is flat (METHODS section 4.5)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

from testfield.calibrate.calibration import Calibration
from testfield.camera.pose import Poses, rotation
from testfield.evaluate.case import changed
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.world import World
from testfield.score.camera import true_in_datum
from testfield.score.flatness import flatness
from testfield.score.mother_board import coplanarity, fitted_rms_mm, mother_marks, mother_scores
from testfield_studies.stitching import scenes as stitching_scenes

U_TURN_RAD, U_MM = 1e-5, 1e-2


def _world(placement: str, count: int) -> World:
    """A field printed exactly and at its true scale."""
    table = changed(stitching_scenes.field(placement, count, 1), {"u_print_scale_ppm": 0.0})
    for board in table["boards"]:
        board["print_sigma_mm"] = 0.0
    return build_world(parse_scene(tomli_w.dumps(table), table["name"], Path()))


def _known(world: World) -> Calibration:
    """A calibration that knows the truth."""
    names = tuple(sheet.name for sheet in world.field.boards)
    _, boards = true_in_datum(world, names)
    labels = tuple(f"board:{n}.{axis}" for n in names[1:] for axis in ("rx", "ry", "rz", "tx", "ty", "tz"))
    covariance = np.diag(np.tile([U_TURN_RAD**2] * 3 + [U_MM**2] * 3, len(names) - 1))
    return Calibration(
        method="true",
        interior=world.interior,
        station_names=world.station_name,
        stations=world.camera_from_world,
        board_names=names,
        boards=boards,
        scale=1.0,
        covariance=covariance,
        labels=labels,
        sigma0=1.0,
        freedom=1,
        reprojection_rms_px=0.0,
        used=0,
    )


def _moved(calibration: Calibration, board: int, turn_rad: list[float], shift_mm: list[float]) -> Calibration:
    R, t = calibration.boards.R.copy(), calibration.boards.t_mm.copy()
    R[board], t[board] = rotation(np.array(turn_rad)) @ R[board], t[board] + shift_mm
    return replace(calibration, boards=Poses(R, t))


def test_the_mother_board_is_true_where_poses_and_scale_are() -> None:
    world = _world("planned", 3)
    true = _known(world)
    assert fitted_rms_mm(*mother_marks(world, true)) < 1e-9
    assert 0.005 < fitted_rms_mm(*mother_marks(world, _moved(true, 1, [0, 0, 0], [0.03, 0, 0]))) < 0.03
    # A fit of six parameters takes no scale away: a mark errs by 1e-4 of its distance from the middle.
    found, right = mother_marks(world, replace(true, scale=1.0001))
    own = right[:36] - right[:36].mean(axis=0)
    assert fitted_rms_mm(found[:36], right[:36]) == pytest.approx(1e-4 * np.sqrt((own**2).mean()), rel=1e-6)


def test_a_flat_mother_board_is_flat_and_a_leaning_board_makes_it_uneven() -> None:
    world = _world("flat", 3)
    true = _known(world)
    scores = mother_scores(world, true)
    assert max(scores["mother_flatness_mm"], scores["true_flatness_mm"]) < 1e-9
    assert scores["coplanarity"] < 1e-9 and scores["flat_passed"] == 1.0
    lifted = mother_scores(world, _moved(true, 2, [0, 0, 0], [0, 0, 0.3]))
    # Boards in a row at heights 0, 0 and 0.3 mm: a plane through them leaves about half of the step.
    assert 0.1 < lifted["mother_flatness_mm"] < 0.3 and lifted["true_flatness_mm"] < 1e-9
    assert lifted["flat_passed"] == 0.0
    found, _ = mother_marks(world, _moved(true, 2, [0, 0, 0], [0, 0, 0.3]))
    assert flatness(found) == lifted["mother_flatness_mm"]


def test_boards_that_lean_all_ways_are_not_taken_for_flat() -> None:
    world = _world("planned", 3)
    scores = mother_scores(world, _known(world))
    assert scores["flat_passed"] == 0.0 and scores["true_flatness_mm"] > 50


def test_the_test_of_flatness_has_the_chi_squared_of_height_and_two_leans() -> None:
    true = _known(_world("flat", 3))
    for turn, shift, expected in (
        ([3 * U_TURN_RAD, 0, 0], [0, 0, 0], 9),
        ([0, -2 * U_TURN_RAD, 0], [0, 0, 0], 4),
        ([0, 0, 0], [0, 0, 4 * U_MM], 16),
        ([0, 0, 0.1], [5, -7, 0], 0),
    ):
        statistic, freedom = coplanarity(_moved(true, 1, turn, shift))
        assert freedom == 6 and statistic == pytest.approx(expected, abs=1e-6)
    assert coplanarity(_known(_world("flat", 1))) == (0.0, 0)


def test_the_test_of_flatness_turns_down_one_flat_board_in_twenty() -> None:
    world = _world("flat", 3)
    true, rng = _known(world), np.random.default_rng(4)
    passed = []
    for _ in range(400):
        R, t = true.boards.R.copy(), true.boards.t_mm.copy()
        for b in (1, 2):
            R[b] = rotation(U_TURN_RAD * rng.standard_normal(3)) @ R[b]
            t[b] = t[b] + U_MM * rng.standard_normal(3)
        passed.append(mother_scores(world, replace(true, boards=Poses(R, t)))["flat_passed"])
    assert 0.92 < np.mean(passed) < 0.98
