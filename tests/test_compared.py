"""One case of a comparison: what is measured of a recipe, however far it comes."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from testfield import registry
from testfield.chain.run import Run, begin
from testfield.errors import TestfieldError
from testfield.evaluate import compared
from testfield.evaluate.case import Case
from testfield.evaluate.compared import compared_row
from testfield.evaluate.failures import FAILURE, KIND, STAGE
from testfield.evaluate.known_rows import BOARDS, BROKEN, KNOWN, SCALE, SHIFT_MM, TRUTH, as_known
from testfield.evaluate.metrics import CENTRE, CORNER, POINTS
from testfield.evaluate.rendered import Rendered
from testfield.measure.outside import Program
from testfield.measure.programs import run_program
from testfield.measure.recipe import Algorithm, Recipe
from testfield.store.memory import peak_memory

ROOT = Path(__file__).parents[1]
GREY = Recipe("grey", Algorithm("grey_centroid"))


@contextmanager
def registered(kind: str, name: str, function: Callable) -> Iterator[None]:
    """An algorithm that is there for a while."""
    registry.register(kind, name)(function)
    try:
        yield
    finally:
        del registry._registered[kind][name]


def row_of(run: Run, recipe: Recipe | None = GREY, **options: Any) -> dict[str, Any]:
    (row,) = compared_row(Case({}, options=options, noise_seed=3, recipe=recipe), run)
    return row


def test_a_row_holds_every_error_its_time_and_its_memory(tiny: Run) -> None:
    row = row_of(tiny)
    assert row[CENTRE.key] > 0 and row[CORNER.key] > 0 and row[POINTS.key] > 0 and FAILURE not in row
    error = np.column_stack([row["dx_px"], row["dy_px"]])
    assert np.sqrt((error**2).mean()) == pytest.approx(row[CENTRE.key])
    assert (
        len(row["mark"])
        == len(row["station"])
        == len(row["x_px"])
        == len(row["centre_nees"])
        == row["detection.measured"]
    )
    assert np.mean(row["centre_nees"]) / 2 == pytest.approx(row["detection.centre_anees"])
    assert len(row["missed_mark"]) == row["detection.missed"]
    corners = np.hypot(row["camera_dx_px"], row["camera_dy_px"])[:4]
    assert corners.max() == pytest.approx(row[CORNER.key])
    points = np.column_stack([row[f"point_{axis}_mm"] for axis in "xyz"])
    assert np.sqrt((points**2).mean()) == pytest.approx(row[POINTS.key])
    assert len(row["length_mm"]) == len(points) * (len(points) - 1) / 2
    assert all(row[f"time_{stage}_s"] > 0 for stage in ("detect", "calibrate", "reconstruct")) and row["memory_mb"] >= 0
    # 1200 mm away through 8 mm on pixels of 9.6 um
    assert row["ground_mm_per_px"] == pytest.approx(1.4, rel=0.15)


def as_they_must(run: Run) -> dict[str, float]:
    """Asserts that both known rows come out as they must; returns what the broken one had to score."""
    truth, broken = row_of(run, None, sanity=TRUTH), row_of(run, None, sanity=BROKEN)
    keys = [name.removeprefix(KNOWN) for name in truth if name.startswith(KNOWN)]
    assert CENTRE.key in keys and CORNER.key in keys
    for key in keys:
        assert truth[KNOWN + key] == 0 and as_known(key, truth[key], 0), (key, truth[key])
        assert as_known(key, broken[key], broken[KNOWN + key]), (key, broken[key], broken[KNOWN + key])
        assert not as_known(key, 0.0, broken[KNOWN + key]) or not broken[KNOWN + key]
    assert truth[CENTRE.key] == 0 and truth["detection.found_fraction"] == 1 and truth["detection.expected"] > 100
    assert truth["detection.wrong_code"] == truth["detection.false"] == truth["detection.missed"] == 0
    return {key: broken[KNOWN + key] for key in keys}


def test_the_truth_scores_zero_and_what_is_broken_what_it_was_broken_by(tiny: Run) -> None:
    planted = as_they_must(tiny)
    assert planted[CENTRE.key] == pytest.approx(0.5 / np.sqrt(2)) and planted[CORNER.key] > 0.3
    assert planted[SCALE] == pytest.approx(10_000, rel=1e-3)


def test_the_truth_scores_zero_in_a_world_of_several_boards_and_points(quick: Run) -> None:
    planted = as_they_must(quick)
    assert planted[BOARDS] == SHIFT_MM and planted[POINTS.key] > 0.1


def test_what_is_not_asked_for_is_not_done(tiny: Run) -> None:
    row = row_of(tiny, until="detect")
    assert CENTRE.key in row and "time_calibrate_s" not in row and FAILURE not in row
    row = row_of(tiny, until="calibrate")
    assert "camera_dx_px" in row and CORNER.key in row and "time_reconstruct_s" not in row


def test_other_recipes_meet_the_same_frames_and_another_draw_others(tiny: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    exposed = []
    frames_of = compared.frames_of
    monkeypatch.setattr(compared, "frames_of", lambda *both: exposed.append(both) or frames_of(*both))
    monkeypatch.setattr(compared, "_kept", None)
    first, again = row_of(tiny, until="detect"), row_of(tiny, until="detect")
    assert len(exposed) == 1 and first["dx_px"] == again["dx_px"]
    (other,) = compared_row(Case({}, options={"until": "detect"}, noise_seed=4, recipe=GREY), tiny)
    assert len(exposed) == 2 and other["dx_px"] != first["dx_px"]


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (TestfieldError("too few boards", "field.json", "add one"), "refused"),
        (ValueError("of the algorithm's own"), "crashed"),
        (np.linalg.LinAlgError("Singular matrix"), "crashed"),
        (TimeoutError("after 3 s"), "timed out"),
    ],
)
def test_failures_have_kinds_and_keep_what_was_found_before(tiny: Run, error: Exception, kind: str) -> None:
    def fail(observations: Any, field: Any, width_px: int, height_px: int, **options: Any) -> None:
        raise error

    with registered("calibrators", "failing", fail):
        row = row_of(tiny, replace(GREY, calibrator=Algorithm("failing")))
    assert (row[KIND], row[STAGE]) == (kind, "calibrate") and str(error).split(" (")[0] in row[FAILURE]
    assert row[CENTRE.key] > 0 and row["time_detect_s"] > 0 and POINTS.key not in row


def test_where_detection_fails_all_that_was_expected_is_missed(tiny: Run) -> None:
    def fail(*given: Any, **options: Any) -> None:
        raise KeyError("label")

    with registered("centroids", "failing", fail):
        row = row_of(tiny, Recipe("failing", Algorithm("failing")))
    assert (row[KIND], row[STAGE]) == ("crashed", "detect") and "KeyError: 'label'" in row[FAILURE]
    assert (
        row["detection.missed"] == row["detection.expected"] == row_of(tiny, None, sanity=TRUTH)["detection.expected"]
    )


def test_first_use_of_any_stage_is_nobody_s_time(tiny: Run) -> None:
    used = []

    def loaded(observations: Any, field: Any, width_px: int, height_px: int, **options: Any) -> Any:
        if not used:
            time.sleep(2)
        used.append(options)
        return registry.find("calibrators", "stitched")(observations, field, width_px, height_px, **options)

    row_of(tiny, until="detect")
    with registered("calibrators", "loaded", loaded):
        first = row_of(tiny, replace(GREY, calibrator=Algorithm("loaded")))
        assert len(used) == 2 and FAILURE not in first and first["time_calibrate_s"] < 1.9
        row_of(tiny, replace(GREY, calibrator=Algorithm("loaded")))
        assert len(used) == 3


def test_memory_is_what_was_taken_and_given_back_within() -> None:
    with peak_memory() as small:
        np.ones(1)
    with peak_memory() as large:
        np.ones(20_000_000).sum()
    assert 150 < large.mb < 220 and small.mb < 20


def test_memory_of_a_program_is_its_own_however_large_we_are_and_others_were(tmp_path: Path) -> None:
    held = np.ones(50_000_000)
    (tmp_path / "large.py").write_text("import time\nheld = b'1' * 200_000_000\ntime.sleep(1.5)\n")
    work = tmp_path / "work"
    work.mkdir()

    def mb_of(command: str) -> float:
        with peak_memory() as peak:
            run_program(Program(command, tmp_path), {}, work, "here")
        return peak.mb

    large = [mb_of(f"{sys.executable} large.py") for _ in range(2)]
    inside = mb_of(f"/bin/sh -c '{sys.executable} large.py; true'")
    small = mb_of("sleep 0.2")
    assert all(190 < mb < 260 for mb in (*large, inside)) and small < 20 and held.all()


@pytest.mark.parametrize("scene", ["charuco", "camera_cell", "on_a_hull"])
def test_the_truth_scores_zero_whatever_a_scene_has(scene: str, tmp_path: Path) -> None:
    run, _ = begin(ROOT / f"scenes/{scene}.toml", tmp_path, None, 1)
    as_they_must(run)


def test_results_of_other_images_are_a_failure_in_which_everything_was_missed(
    tiny: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of_others(recipe: Recipe, frames: object) -> Recipe:
        raise TestfieldError("these results are of other images", str(tmp_path), "export again")

    monkeypatch.setattr(compared, "recipe_at", of_others)
    row = row_of(tiny)
    assert "of other images" in row[FAILURE] and row[STAGE] == "detect"
    assert row["detection.missed"] == row["detection.expected"] > 0


def test_a_rendered_field_is_measured_by_a_recipe_s_file_too(tiny: Run, tmp_path: Path) -> None:
    file = tmp_path / "grey.toml"
    file.write_text('[centroid]\nname = "grey_centroid"\n')
    field = Rendered(Case({}, noise_seed=3), tiny)
    assert field.measured(file) == field.measured(str(file)) == field.measured(Recipe.load(file))
    assert field.measured(file) != field.measured()
