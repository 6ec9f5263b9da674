"""The regression suite put to the test: wrapped algorithms spoil what they should and nothing else; the project's own
suites can be read, have baselines, and its quick part passes."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import SCENES

from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.detect.detect import detect
from testfield.detect.observations import Observations
from testfield.evaluate.case import Case
from testfield.evaluate.measured import frames_of
from testfield.evaluate.regress.baseline import Baseline
from testfield.evaluate.regress.cases import setups_of
from testfield.evaluate.regress.check import Checked
from testfield.evaluate.regress.selftest import (
    CODES,
    PLANTED,
    _loaded,
    defects,
    outcome,
    suite,
    under_other_noise,
    whole_chain,
)
from testfield.evaluate.regress.suite import Figure, Suite, baseline_path
from testfield.evaluate.regress.verdict import judged
from testfield.measure.pipeline import calibrate, reconstruct
from testfield.measure.recipe import SMALLEST_DIAMETER_PX, Recipe
from testfield.registry import _name_of, find, load_file

OWN = ("quick", "all")


@pytest.fixture(autouse=True)
def loaded_anew(forget_ones_own: None) -> None:
    """The planted algorithms are registered for each test, and forgotten after it."""
    sys.modules.pop(_name_of(PLANTED), None)
    _loaded.cache_clear()
    load_file(PLANTED)


@pytest.fixture
def seen(tiny: Run) -> Observations:
    return Observations.load(tiny.folder / "observations.parquet")


def planted(stage: str, name: str):  # type: ignore[no-untyped-def]
    return find(stage, f"planted_{name}")


def test_without_options_a_wrapped_detector_gives_what_the_true_one_gives(tiny: Run) -> None:
    frame = frames_of(Case({}, scene={}), tiny)[0]
    true = detect(frame, tiny.field, "forward_model", SMALLEST_DIAMETER_PX)
    wrapped = planted("detectors", "detector")
    assert np.array_equal(wrapped(frame, tiny.field).xy_px, true.xy_px, equal_nan=True)
    shifted = wrapped(frame, tiny.field, shift_px=0.5).xy_px - true.xy_px
    assert np.nanmax(np.abs(shifted - [0.5, 0])) < 1e-9
    noisy = wrapped(frame, tiny.field, noisier=0.2)
    rows = np.flatnonzero(true.status == "measured")
    scaled = (noisy.xy_px - true.xy_px)[rows] / np.sqrt(true.cov_px2[rows][:, [0, 1], [0, 1]])
    assert 0.5 < scaled.std() / np.sqrt(1.2**2 - 1) < 1.5
    misread = wrapped(frame, tiny.field, wrong_code_in=3)
    changed = misread.code != true.code
    assert (
        changed.any() and (true.code[changed] > 0).all() and np.array_equal(misread.xy_px, true.xy_px, equal_nan=True)
    )


def test_without_options_a_wrapped_calibrator_and_reconstructor_give_what_the_true_ones_give(
    tiny: Run, seen: Observations
) -> None:
    true = calibrate(seen, tiny.field, Recipe())
    wrapped = calibrate(seen, tiny.field, whole_chain())
    assert np.array_equal(wrapped.interior.parameters, true.interior.parameters)
    assert np.array_equal(wrapped.stations.t_mm, true.stations.t_mm)
    points, twice = (
        planted("reconstructors", "reconstructor")(seen, true, tiny.field, covariance=factor) for factor in (1.0, 2.0)
    )
    assert np.array_equal(points.xyz_mm, reconstruct(seen, true, tiny.field, Recipe()).xyz_mm)
    assert np.array_equal(twice.cov_xyz_mm2, 2 * points.cov_xyz_mm2)


def test_every_defect_is_a_recipe_that_is_accepted_and_differs_from_the_true_chain() -> None:
    true = whole_chain()
    assert len(defects()) == 12
    for defect in defects():
        defect.recipe.check(defect.title)
        assert defect.recipe != true and defect.recipe.name == true.name
        assert setups_of(suite(defect.suite, defect.recipe))
    assert CODES in {defect.suite for defect in defects()}


def test_a_row_of_the_table_says_what_was_found_first() -> None:
    base = np.linspace(1, 1.1, 8)

    def one(key: str, factor: float, n: int = 8):  # type: ignore[no-untyped-def]
        return judged("s", "r", Figure(key, 0.01), base[:n], factor * base[:n], 0.01)

    found = Checked([one("late", 9.0), one("calm", 1.0), one("early", 3.0, 6)], pd.DataFrame(), (6, 8))
    row = outcome("it", True, found)
    assert row.as_it_should and row.draws == 6 and [f.figure.key for f in row.by] == ["early", "late"]
    calm = Checked([one("calm", 1.0)], pd.DataFrame(), (6,))
    assert not outcome("it", True, calm).as_it_should
    assert outcome("it", False, calm).as_it_should
    better = Checked([one("less", 0.2)], pd.DataFrame(), (8,))
    assert not outcome("it", False, better).as_it_should


def test_blocks_of_recorded_draws_are_checks_of_unchanged_code_and_a_level_that_moved_is_seen_among_them() -> None:
    rng = np.random.default_rng(4)
    own = Suite("own", Path("own.toml"), (), (Figure("x", 0.5),), draws=8)
    calm = {("a", "r", "failed"): np.zeros(64), ("a", "r", "x"): rng.standard_normal(64)}
    outcomes = list(under_other_noise(own, Baseline("own", 64, {}, calm, {}), 20))
    assert len(outcomes) == 20 and all(one.as_it_should for one in outcomes)
    moved = {**calm, ("a", "r", "x"): calm["a", "r", "x"] + 20 * (np.arange(64) >= 56)}
    found = [one.found for one in under_other_noise(own, Baseline("own", 64, {}, moved, {}), 28)]
    assert sum(found) == 7


@pytest.mark.parametrize("name", OWN)
def test_the_projects_own_suites_have_baselines_of_their_scenes(name: str) -> None:
    path = SCENES / "regress" / f"{name}.toml"
    own = Suite.load(path)
    baseline = Baseline.load(baseline_path(path))
    setups = setups_of(own)
    baseline.belongs_to(own, setups, baseline_path(path))
    asked = {(*setup.name, figure.key) for setup in setups for figure in own.figures_of(setup.title)}
    assert set(baseline.figures) == asked
    assert all(np.isfinite(values).all() for values in baseline.figures.values())


def test_the_quick_part_of_the_projects_own_suite_passes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status = main(["regress", "check", str(SCENES / "regress/quick.toml"), "--out", str(tmp_path), "--jobs", "1"])
    assert status == 0, capsys.readouterr().out
