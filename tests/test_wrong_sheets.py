"""Wrong sheets of boards, wrong bars among boards, and images that are not what they are taken for: each is named, and
costs no observation of anything else."""

from dataclasses import replace

import numpy as np
import pytest
from test_calibrators import BROWN, WIDTH, Interior, calibrated, errors, said, seen, sheet

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.targets.field import Field

NAMES = "ABC"


def rows(seed: int = 2) -> Observations:
    return seen(noise=np.random.default_rng(seed))


def with_marks(field: Field, board: int, xy_mm: np.ndarray) -> Field:
    boards = list(field.boards)
    boards[board] = replace(boards[board], marks=replace(boards[board].marks, xy_mm=xy_mm))
    return replace(field, boards=tuple(boards))


def certain() -> Field:
    """The sheet as well as it is certified: its marks off by as much as it says."""
    field, rng = sheet(u_xy_mm=0.02, u_scale=3e-5), np.random.default_rng(5)
    for b in range(3):
        field = with_marks(field, b, field.boards[b].marks.xy_mm + 0.02 * rng.standard_normal((30, 2)))
    return field


def stitched(observations: Observations, field: Field) -> Calibration:
    return calibrated("stitched", observations, field, hold=("k3",))


@pytest.mark.parametrize("board", [0, 1])
@pytest.mark.parametrize("factor", [(1.03, 1.0), (1.03, 1.03), (0.995, 1.0)])
def test_a_board_whose_sheet_is_stretched_is_named_and_left_out(board: int, factor: tuple[float, float]) -> None:
    field = certain()
    found = stitched(rows(), with_marks(field, board, field.boards[board].marks.xy_mm * factor))
    assert said(found, f"board '{NAMES[board]}'", f"in x {100 * (factor[0] - 1):+.0g}"[:8], "left out")
    assert NAMES[board] not in found.board_names and len(found.board_names) == 2
    assert not found.rejected and not found.test["passed"] and found.failures
    true = next(k for k in range(3) if NAMES[k] == found.board_names[0])
    assert np.abs(errors(found, BROWN, true)).max() < 2


def test_single_marks_misplaced_on_a_sheet_are_named_and_their_pixels_stay() -> None:
    field = certain()
    xy = field.boards[1].marks.xy_mm.copy()
    xy[7] += [0.5, 0]
    found = stitched(rows(), with_marks(field, 1, xy))
    assert said(found, "code 38", "board 'B'", "off its sheet")
    assert not found.rejected and found.board_names == ("A", "B", "C")
    xy = field.boards[1].marks.xy_mm.copy()
    xy[[3, 4]] = xy[[4, 3]]
    found = stitched(rows(), with_marks(field, 1, xy))
    assert said(found, "code 34") and said(found, "code 35")
    assert {r["code"] for r in found.rejected} <= {34, 35}


@pytest.mark.parametrize("u_scale", [3e-5, 0.0])
@pytest.mark.parametrize("factor", [1.005, 0.001, 1 / 25.4])
def test_a_bar_alone_that_contradicts_the_boards_is_named_with_them(u_scale: float, factor: float) -> None:
    field = sheet(u_xy_mm=0.02, u_scale=u_scale)
    bar = field.scale_bars[0]
    found = stitched(rows(), replace(field, scale_bars=(replace(bar, length_mm=factor * bar.length_mm),)))
    assert said(found, "'bar'", "the boards' sheets", "left out")
    assert found.failures and not found.test["passed"] and not found.rejected
    u = float(np.sqrt(found.covariance[found.index(["scale"]), found.index(["scale"])][0])) if factor > 0.5 else 0.003
    assert 0.002 < u < 0.006  # what is stated covers the other
    assert abs(found.scale - 1) < 2e-4


def test_a_good_bar_changes_nothing_and_is_not_named() -> None:
    found = stitched(rows(), certain())
    assert not found.notes and found.test["passed"]
    assert [c["used"] for c in found.certificates] == [True]


def test_an_image_whose_marks_are_misnumbered_is_named() -> None:
    observations = rows()
    here = (observations.station == 4) & (observations.board >= 0)
    point = np.where(here, (observations.point + 1) % 30, observations.point)
    code = np.where(here, 1 + 30 * observations.board + point, observations.code)
    found = stitched(replace(observations, point=point, code=code), certain())
    assert said(found, "'s4'")
    assert not found.test["passed"] and set(found.board_names) == set(NAMES)
    assert {r["station"] for r in found.rejected} <= {"s4"}


@pytest.mark.slow  # nothing fits anything, which takes its time; `test_certificates` asks the same without boards
def test_photographs_by_a_second_camera_are_named() -> None:
    other = Interior(WIDTH, BROWN.height_px, BROWN.parameters * [1.3, 1.3, 1, 1, -1, 1, 1, 1, 1])
    first, second = rows(), seen(other, noise=np.random.default_rng(3))
    both = Observations.beside([first.take(first.station < 6), second.take(second.station >= 6)])
    found = stitched(both, certain())
    assert found.failures and not found.test["passed"]


def test_rejections_are_counted_by_group_and_kept() -> None:
    observations = rows()
    xy = observations.xy_px.copy()
    xy[[10, 200]] += 3.0
    found = stitched(replace(observations, xy_px=xy), certain())
    assert sum(r["rejected"] for r in found.rejections if r["kind"] == "station") == 2
    assert not any(r["too_many"] for r in found.rejections) and found.test["passed"]
    assert {r["kind"] for r in found.rejections} >= {"station", "board"}
