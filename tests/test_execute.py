"""The one function that does all cases, and the executor under it."""

import os
import signal
import subprocess
import sys
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
import pandas as pd
import pytest

from testfield.chain.run import Run
from testfield.chain.stages import run_stage
from testfield.errors import TestfieldError
from testfield.evaluate import keys
from testfield.evaluate.case import Case, case, changed, scene_table
from testfield.evaluate.execute import _phases, case_key, execute, run_name
from testfield.evaluate.kept_rows import KeptRows
from testfield.measure.recipe import Algorithm, Recipe
from testfield.store.code import sources
from testfield.store.objects import Objects
from testfield.store.work import each

DONE: list[Any] = []


def count(case: Case, run: Run | None) -> list[dict[str, Any]]:
    DONE.append(case.labels["n"])
    if case.labels["n"] in case.options.get("killed", ()):
        raise KeyboardInterrupt
    if case.labels["n"] in case.options.get("hopeless", ()):
        raise TestfieldError("nothing was seen", "here", "look")
    return [{"square": case.labels["n"] ** 2, "row": k} for k in range(2)]


def stations(case: Case, run: Run | None) -> list[dict[str, Any]]:
    assert run is not None
    return [
        {"stations": len(run.stations), "made": run_stage(run, "render"), "read_noise_e": run.scene.sensor.read_noise_e}
    ]


def _cases(numbers: range, **options: Any) -> list[Case]:
    return [Case({"n": n}, f"{__name__}:count", options=options) for n in numbers]


def test_rows_come_in_the_order_of_the_cases_with_their_labels(tmp_path: Path) -> None:
    table = execute(_cases(range(3)), tmp_path)
    assert table["n"].tolist() == [0, 0, 1, 1, 2, 2] and table["square"].tolist() == [0, 0, 1, 1, 4, 4]
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "results.parquet"), table)


def test_after_a_kill_only_what_is_missing_is_done(tmp_path: Path) -> None:
    whole = execute(_cases(range(4)), tmp_path / "whole")
    # What is told to the work is part of the case, so the kill comes from outside it.
    DONE.clear()
    cases = _cases(range(4))
    with pytest.raises(KeyboardInterrupt):
        execute([*cases[:2], *_cases(range(2, 3), killed=[2])], tmp_path / "killed")
    assert DONE == [0, 1, 2]
    DONE.clear()
    again = execute(cases, tmp_path / "killed")
    assert DONE == [2, 3]
    pd.testing.assert_frame_equal(again, whole)


def test_a_case_that_fails_says_why_and_is_tried_again(tmp_path: Path) -> None:
    cases = _cases(range(2), hopeless=[1])
    table = execute(cases, tmp_path)
    assert table["failure"].isna().sum() == 2 and "nothing was seen" in table["failure"].iloc[2]
    DONE.clear()
    execute(cases, tmp_path)
    assert DONE == [1]


def _counted(monkeypatch: pytest.MonkeyPatch, of: Case) -> set[str]:
    """The modules whose code a case's key counts, beside what they import."""
    asked: list[str] = []
    monkeypatch.setattr(keys, "code_digest", lambda *modules, **_: asked.extend(modules) or "other")
    case_key(of)
    return set(asked)


def test_a_key_counts_the_algorithms_that_the_case_names_and_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    own = "testfield.evaluate.measured:scorecard_row"
    plain, named = (_counted(monkeypatch, Case({}, own, options=o)) for o in ({}, {"methods": ["ml", "dlt_p34"]}))
    assert {"testfield.detect.centre_forward", "testfield.calibrate.stitched", "testfield.reconstruct.gls"} <= plain
    assert {"testfield.reconstruct.ml", "testfield.reconstruct.dlt"} <= named - plain
    assert not {"testfield.reconstruct.opponents", "testfield.calibrate.zhang", "testfield.detect.centre_star"} & named
    recipe = Recipe(calibrator=Algorithm("zhang"))
    assert _counted(monkeypatch, Case({}, own, recipe=recipe)) - plain == {"testfield.calibrate.zhang"}
    scene = {"measure": {"centroid": "star"}}
    assert _counted(monkeypatch, Case({}, own, scene=scene)) - plain == {"testfield.detect.centre_star"}


def test_an_algorithm_that_is_found_by_name_makes_a_key_change_with_its_code(monkeypatch: pytest.MonkeyPatch) -> None:
    case = Case({}, "testfield.evaluate.measured:scorecard_row")
    before = case_key(case)
    changed_digest = keys.code_digest

    def edited(*modules: str, **more: Any) -> str:
        return changed_digest(*modules, **more) + ("edited" if "testfield.reconstruct.gls" in modules else "")

    monkeypatch.setattr(keys, "code_digest", edited)
    assert case_key(case) != before


def test_noise_and_recipe_are_part_of_the_key() -> None:
    plain = Case({}, f"{__name__}:count")
    others = [replace(plain, noise_seed=1), replace(plain, noise_seed=2), replace(plain, recipe=Recipe())]
    assert len({case_key(one) for one in (plain, *others)}) == 4


def test_how_a_scene_is_measured_gives_it_no_folder_of_its_own() -> None:
    scene = {"name": "a", "seed": 1}
    plain = Case({}, scene=scene)
    measured = Case({}, scene=scene | {"measure": {"calibrator": "zhang"}})
    assert run_name(plain) == run_name(measured) != run_name(Case({}, scene=scene | {"seed": 2}))


def test_rewording_a_page_throws_no_case_away() -> None:
    used = sources(("testfield_studies.stitching.experiment",), ("testfield.report", "testfield.certify"))
    assert not {"report", "certify"} & {path.parent.name for path in used}
    assert {"render", "detect", "calibrate"} <= {path.parent.name for path in used}


def test_a_damaged_file_of_a_case_is_made_again(tmp_path: Path) -> None:
    cases = _cases(range(2))
    whole = execute(cases, tmp_path)
    damaged = tmp_path / KeptRows(Objects(str(tmp_path))).file(case_key(cases[1]))
    damaged.write_bytes(damaged.read_bytes()[:60])
    DONE.clear()
    pd.testing.assert_frame_equal(execute(cases, tmp_path), whole)
    assert DONE == [1]


def singular(case: Case, run: Run | None) -> list[dict[str, Any]]:
    return [{"inverse": float(np.linalg.inv(np.zeros((2, 2)))[0, 0])}]


def test_a_singular_matrix_is_one_cases_failure_and_not_the_studys_end(tmp_path: Path) -> None:
    table = execute([*_cases(range(1)), Case({"n": 9}, f"{__name__}:singular")], tmp_path)
    assert table["square"].iloc[0] == 0 and "Singular" in table["failure"].iloc[-1]


def one_second(case: Case, run: Run | None) -> list[dict[str, Any]]:
    sleep(1)
    return [{}]


def in_two_long_groups(folder: Path) -> None:
    """What the interrupted process does: two processes, 60 cases of a second each."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have its background jobs ignore it
    execute([Case({"n": n}, f"{__name__}:one_second") for n in range(60)], folder, 2)


def test_an_interrupt_ends_a_study_after_the_cases_at_hand(tmp_path: Path) -> None:
    command = f"from {__name__} import *; in_two_long_groups(Path({str(tmp_path)!r}))"
    path = os.pathsep.join([str(Path(__file__).parent), os.environ.get("PYTHONPATH", "")])
    there = os.environ | {"PYTHONPATH": path}
    study = subprocess.Popen([sys.executable, "-c", command], env=there, stderr=subprocess.DEVNULL)
    end = monotonic() + 60
    while not list(tmp_path.glob("cases/*.parquet")) and monotonic() < end:
        sleep(0.1)
    study.send_signal(signal.SIGINT)
    try:
        study.wait(timeout=30)
    finally:
        study.kill()
    kept = list(tmp_path.glob("cases/*.parquet"))
    assert study.returncode != 0 and 1 <= len(kept) <= 8
    assert all(pd.read_parquet(path) is not None for path in kept)


def test_two_processes_find_what_one_finds(tmp_path: Path) -> None:
    one, two = execute(_cases(range(4)), tmp_path / "one"), execute(_cases(range(4)), tmp_path / "two", jobs=2)
    pd.testing.assert_frame_equal(one, two)


# ------------------------------------------------------------------ the executor
def square(n: int) -> int:
    return n**2


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_items_however_they_are_grouped(jobs: int) -> None:
    told: list[int] = []
    assert list(each(square, range(5), jobs, groups=[[4, 0], [], [3], [1, 2]], moved=told.append)) == [0, 1, 4, 9, 16]
    assert sorted(told) == [0, 1, 2, 3, 4]
    assert list(each(square, [], jobs)) == []


def test_results_are_given_before_all_items_are_done() -> None:
    done: list[int] = []
    results = each(lambda n: done.append(n) or n, range(3))
    assert (next(results), done) == (0, [0])


class AtOnce:
    """A pool of somebody else's, like a client of Dask."""

    def __init__(self) -> None:
        self.given = 0

    def submit(self, function: Any, /, *arguments: Any) -> Future:
        self.given += 1
        future: Future = Future()
        future.set_result(function(*arguments))
        return future


def test_work_is_done_by_whatever_pool_is_given() -> None:
    pool = AtOnce()
    assert list(each(square, range(4), pool=pool, groups=[[0, 1], [2, 3]])) == [0, 1, 4, 9] and pool.given == 2


def dies(n: int) -> int:
    if n == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return n


def test_a_worker_that_is_killed_ends_the_work_in_a_sentence() -> None:
    with pytest.raises(TestfieldError, match="ended from outside"):
        list(each(dies, range(3), 2))


def kept_or_killed(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """Kills its process in the second case, but only the first time."""
    mark = Path(case.options["mark"])
    if case.labels["n"] == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return [{"square": case.labels["n"] ** 2}]


def test_after_a_worker_was_killed_the_next_call_does_what_is_missing(tmp_path: Path) -> None:
    options = {"mark": str(tmp_path / "mark")}
    cases = [Case({"n": n}, f"{__name__}:kept_or_killed", options=options) for n in range(3)]
    with pytest.raises(TestfieldError, match="what is finished is kept"):
        execute(cases, tmp_path / "cases", 2)
    before = set((tmp_path / "cases").rglob("*.parquet"))
    assert execute(cases, tmp_path / "cases", 2)["n"].tolist() == [0, 1, 2]
    assert before <= set((tmp_path / "cases").rglob("*.parquet"))


def wait_for_file(wanted: tuple[Path, Path | None]) -> bool:
    """Touch a file; then whether the file that is waited for was there within ten seconds."""
    own, awaited = wanted
    end = monotonic() + 10
    while awaited and not awaited.is_file() and monotonic() < end:
        sleep(0.05)
    own.touch()
    return awaited is None or awaited.is_file()


def test_progress_is_told_item_by_item_while_a_process_still_works_on_the_next(tmp_path: Path) -> None:
    own, sign = [tmp_path / f"own {n}" for n in range(3)], tmp_path / "the first was told"
    items = [(own[0], None), (own[1], sign), (own[2], None)]
    told: list[int] = []

    def moved(k: int) -> None:
        told.append(k)
        if k == 0:
            sign.touch()

    kept = [path.is_file for path in own]
    in_time = list(each(wait_for_file, items, 2, groups=[[0, 1], [2]], kept=lambda k: kept[k](), moved=moved))
    assert in_time == [True] * 3 and sorted(told) == [0, 1, 2]


# ------------------------------------------------------------------ cases of scenes
def test_a_case_is_a_scene_with_changes_noise_and_a_recipe() -> None:
    one = case(Path("scenes/quick.toml"), {"sensor.read_noise_e": 7.0}, noise_seed=3, recipe=Recipe(name="mine"))
    assert one.labels == {"scene": "quick", "sensor.read_noise_e": 7.0, "noise_seed": 3, "recipe": "mine"}
    assert one.scene is not None and one.scene["sensor"]["read_noise_e"] == 7


def test_cases_of_one_scene_share_its_renders(tmp_path: Path) -> None:
    scene = changed(scene_table(Path("scenes/quick.toml")), {"camera.width_px": 320, "camera.height_px": 240})
    scene["stations"] = scene["stations"][:1]
    scene = changed(scene, {"stations.0.count": 2, "sensor.read_noise_e": 7.0, "measure.smallest_diameter_px": 3})
    again = changed(scene, {"measure.calibrator": "zhang"})
    table = execute(
        [Case({"n": n}, f"{__name__}:stations", one) for n, one in enumerate((scene, scene, again))], tmp_path
    )
    assert table["made"].tolist() == [True, False, False] and set(table["read_noise_e"]) == {7.0}


@pytest.mark.slow
def test_other_noise_and_another_recipe_render_nothing_again(tmp_path: Path) -> None:
    scene = Path(__file__).parent / "torture/tiny.toml"
    cases = [
        case(scene),
        case(scene, noise_seed=5),
        case(scene, recipe=Recipe(name="zhang", calibrator=Algorithm("zhang"))),
    ]
    table = execute(cases, tmp_path)
    assert len(list(tmp_path.glob("runs/*/radiance/*.exr"))) == 4 and len(list(tmp_path.glob("runs/*"))) == 1
    assert table["calibration.method"].tolist() == ["stitched", "stitched", "zhang"]
    assert table["detection.centre_rms_px"].nunique() == 2  # noise is the same for both recipes


def test_a_change_that_names_no_place_is_refused() -> None:
    scene = {"boards": [{"name": "A"}], "seed": 3}
    assert changed(scene, {"boards.0.bend": 2, "sensor.gain": 1})["boards"][0] == {"name": "A", "bend": 2}
    assert scene == {"boards": [{"name": "A"}], "seed": 3}
    for path in ("boards.1.bend", "seed.x", "boards.first.bend"):
        with pytest.raises(TestfieldError, match="no such place"):
            changed(scene, {path: 1})


def test_draws_of_noise_are_given_to_processes_that_would_have_no_work() -> None:
    def made(name: str, seed: int | None, recipe: int) -> Case:
        return Case({"recipe": recipe}, scene={"name": name}, noise_seed=seed)

    cases = [made(name, seed, recipe) for name in "ab" for seed in (1, 2, 3) for recipe in (1, 2)]
    cases.append(made("b", None, 3))
    assert _phases(cases, 1) == _phases(cases, 2) == [[[0, 1, 2, 3, 4, 5], [6, 7, 8, 9, 10, 11, 12]]]
    # What all draws share is made before any two processes look at it.
    assert _phases(cases, 3) == [[[0, 1], [6, 7, 12]], [[2, 3], [4, 5], [8, 9], [10, 11]]]
    assert _phases(cases[:2], 3) == [[[0, 1]]]
