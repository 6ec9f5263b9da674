"""Growth along chains, the mother board's figures and the statement of thousands of trials, against arithmetic by
hand."""

from dataclasses import replace

import numpy as np
import pytest
from hand_made import HandMade
from scipy.stats import binom

from testfield.calibrate.calibration import Calibration
from testfield.camera.pose import Poses, rotation
from testfield.scene.world import World
from testfield.score.camera import true_in_datum
from testfield.score.chain_growth import chain_errors, grown, link_of_marks
from testfield.score.mother_board import coplanarity, fitted_rms_mm, mother_marks, mother_scores
from testfield.statistics.consistency import hit_band
from testfield.uncertainty.statement import of_blocks, quantities

UM = 1e-3
AXES = ("rx", "ry", "rz", "tx", "ty", "tz")


def test_growth_by_hand() -> None:
    """s = 2, turn 0.1, pitch 10, shared 0.3: k s^2 + (pitch turn)^2 (0, 1, 1 + 4) + pitch shared k (k - 1)."""
    assert grown(np.array([1, 2, 3]), 2.0, 0.1, 10.0, 0.3) == pytest.approx([4.0, 8 + 1 + 6, 12 + 5 + 18])
    assert grown(np.array([4]), 0.0, 0.1, 10.0) == pytest.approx([14.0])
    # Of four marks at the corners of a square of 6 mm, all 18^0.5 mm from the middle.
    shift, turn = link_of_marks(np.array([[1.0, 1], [7, 1], [7, 7], [1, 7]]), 0.1)
    assert (shift, turn) == pytest.approx((0.05, 0.1 / 72**0.5))


@pytest.fixture
def chain(by_hand: HandMade) -> tuple[World, Calibration]:
    """The hand-made world, and a calibration that has all its boards where they are."""
    names = tuple(sheet.name for sheet in by_hand.world.field.boards)
    _, boards = true_in_datum(by_hand.world, names)
    labels = tuple(f"board:{name}.{axis}" for name in names[1:] for axis in AXES)
    u = np.tile([1e-5, 2e-5, 4e-5, 10 * UM, 20 * UM, 40 * UM], len(names) - 1)
    known = replace(
        by_hand.calibration, board_names=names, boards=boards, labels=labels, covariance=np.diag(u**2), scale=1.0
    )
    return by_hand.world, known


def test_errors_of_boards_and_links_by_hand(chain: tuple[World, Calibration]) -> None:
    world, calibration = chain
    datum, true = true_in_datum(world, calibration.board_names)
    moved, turned = np.array([10, -40, 20]) * UM, np.array([1e-5, -2e-5, 8e-5])
    R, t = true.R.copy(), true.t_mm.copy()
    R[1], t[1] = rotation(turned[None])[0] @ R[1], t[1] + moved
    found = chain_errors(world, replace(calibration, boards=Poses(R, t)))
    # In units of their standard deviations: turns 1, 1, 2 and shifts 1, 2, 1/2.
    assert found.nees[0] == pytest.approx((1 + 1 + 4 + 1 + 4 + 0.25) / 6, rel=1e-6)
    to_world = datum.R[0]
    assert found.place_mm[0] == pytest.approx(to_world @ moved * [1, -1, 1], abs=1e-9)
    assert found.u_place_mm[0] ** 2 == pytest.approx(to_world**2 @ np.square([10 * UM, 20 * UM, 40 * UM]))
    along = to_world @ moved
    assert found.shift_mm[0] == pytest.approx([-along[1], along[2]], abs=1e-9)
    spin = to_world @ turned
    assert found.turn_rad[0] == pytest.approx([-spin[2], -spin[1]], abs=1e-11)


def test_a_board_that_is_off_makes_both_its_links_wrong_and_no_other_board(chain: tuple[World, Calibration]) -> None:
    """Moved, then turned where it is: the next board is seen off by as much the other way."""
    world, calibration = chain
    _, true = true_in_datum(world, calibration.board_names)
    R, t = true.R.copy(), true.t_mm.copy()
    R[1], t[1] = rotation(np.array([[1e-5, -2e-5, 8e-5]]))[0] @ R[1], t[1] + np.array([10, -40, 20]) * UM
    shifted = chain_errors(world, replace(calibration, boards=Poses(true.R, t)))
    turned = chain_errors(world, replace(calibration, boards=Poses(R, true.t_mm)))
    for found in (shifted, turned):
        assert found.nees.shape == (2,) and found.place_mm.shape == found.u_place_mm.shape == (2, 3)
        assert found.nees[1] == pytest.approx(0, abs=1e-9) and found.place_mm[1] == pytest.approx([0] * 3, abs=1e-9)
        assert found.shift_mm.shape == found.turn_rad.shape == (2, 2)
    assert shifted.shift_mm[1] == pytest.approx(-shifted.shift_mm[0], abs=1e-9) and shifted.shift_mm[0].all()
    assert shifted.turn_rad == pytest.approx(np.zeros((2, 2)), abs=1e-12)
    assert turned.turn_rad[1] == pytest.approx(-turned.turn_rad[0], abs=1e-9) and turned.turn_rad[0].all()


def test_the_mother_board_by_hand(chain: tuple[World, Calibration]) -> None:
    world, calibration = chain
    card = mother_scores(world, calibration)
    # The true marks lie 1 um beside the sheets' places, out of the boards' planes or in them.
    found, true = mother_marks(world, calibration)
    assert np.linalg.norm(found - true, axis=1) == pytest.approx(np.full(len(found), UM), rel=1e-6)
    assert card["mother_rms_mm"] <= UM / 3**0.5 * (1 + 1e-9)
    # Between boards 80 mm apart in height; the true ones are 20 ppm larger than their sheets.
    assert (card["mother_flatness_mm"], card["true_flatness_mm"]) == pytest.approx((80.0, 80.0016))
    statistic, freedom = coplanarity(calibration)
    assert freedom == 3 * (len(calibration.board_names) - 1)
    normal, height = calibration.boards.R[1:, :, 2], calibration.boards.t_mm[1:, 2]
    by_hand = (normal[:, 1] / 1e-5) ** 2 + (normal[:, 0] / 2e-5) ** 2 + (height / (40 * UM)) ** 2
    assert statistic == pytest.approx(by_hand.sum(), rel=1e-9)
    assert card["coplanarity"] == pytest.approx(statistic / freedom)
    assert card["flat_passed"] == float(statistic <= {3: 7.814728, 6: 12.591587}[freedom])


def test_a_motion_of_all_marks_is_no_error_of_the_mother_board() -> None:
    true = np.random.default_rng(3).uniform(-500, 500, (9, 3))
    R = rotation(np.array([[0.1, -0.2, 0.3]]))[0]
    found = (true - [40.0, -7, 11]) @ R
    assert fitted_rms_mm(found, true) == pytest.approx(0, abs=1e-9)
    # Stretched by 1 in 1000 about the middle: what is left is that part of the marks' own spread.
    stretched = fitted_rms_mm(found * 1.001, true)
    assert stretched == pytest.approx(0.001 * np.sqrt(((true - true.mean(axis=0)) ** 2).mean()), rel=1e-6)


def test_bands_of_hits_cut_off_as_much_below_as_above() -> None:
    assert hit_band(1000, 0.95) == (931, 967)
    low, high = hit_band(40, 0.5, central=0.5)
    assert (low, high) == (18, 22)
    assert binom.cdf(low - 1, 40, 0.5) < 0.25 <= binom.cdf(low, 40, 0.5)


def test_the_statement_of_thousands_of_trials_has_regions_beside_its_quantities(by_hand: HandMade) -> None:
    points = by_hand.points
    linear = quantities(points, by_hand.world.field, [])
    factor = np.linalg.cholesky(points.cov_xyz_mm2 + 1e-18 * np.eye(3 * len(points)))

    def block(k: int) -> np.ndarray:
        draws = np.random.default_rng(k).standard_normal((2000, 3 * len(points)))
        return points.xyz_mm + (draws @ factor.T).reshape(2000, -1, 3)

    answer = of_blocks(points, linear, by_hand.world.field, block, 20000, 1, False)
    assert len(answer["quantities"]) == len(linear.names) and answer["probability"] == 0.95
    regions = answer["regions"]
    assert regions["k_gaussian"] == pytest.approx(2.795483, abs=1e-6)  # the root of 7.814728
    assert [row["code"] for row in regions["points"]] == points.code.tolist()
    assert regions["points"][0]["k"] == pytest.approx(2.795, abs=0.1)
    row = int(points.rows([21])[0])
    u = np.sqrt(np.diag(points.cov_xyz_mm2)[3 * row : 3 * row + 3])
    assert sorted(regions["points"][row]["half_axes_mm"]) == pytest.approx(sorted(2.795 * u), rel=0.1)
