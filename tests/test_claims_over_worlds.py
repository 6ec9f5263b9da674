"""Claims over many worlds: true ones are believed, and a covariance 1.2 times wrong is seen, however alike the errors
of one world are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from testfield.bench.claim_figures import LEVEL, WRONG, Errors, Tally, claim_checks, enough_trials
from testfield.bench.claims import drawn_worlds, figures_of
from testfield.evaluate.check import Outcome
from testfield.statistics.consistency import hit_band

SCENES = Path(__file__).parents[1] / "scenes"
PARTS = {"camera": (1, 9), "boards": (2, 6), "check_points": (8, 3)}
"""Of the made-up worlds: parts of a group, and values of a part, as in scenes/quick.toml."""
ALIKE = 0.8
"""Correlation of two parts of one world."""
WORLDS = enough_trials(9, len(PARTS))


def tallies(rng: np.random.Generator, suites: int, factor: float) -> dict[str, list[Tally]]:
    """Figures of so many suites of made-up worlds, whose covariances are claimed `factor` times too large."""
    found = {}
    for group, (parts, size) in PARTS.items():
        between = ALIKE * np.ones((parts, parts)) + (1 - ALIKE) * np.eye(parts)
        z = rng.standard_normal((suites, WORLDS, parts, size))
        error = np.einsum("ab,swbk->swak", np.linalg.cholesky(between), z)
        nees = (z**2).mean(axis=(2, 3)) / factor
        hits = ((error**2).sum(axis=3) / factor <= chi2.ppf(0.95, size)).sum(axis=2)
        found[group] = [Tally(nees=nees[s], hits=hits[s], parts=np.full(WORLDS, parts)) for s in range(suites)]
    return found


def red(rng: np.random.Generator, suites: int, factor: float) -> float:
    """The share of suites in which a check fails."""
    failed, block = 0, 100
    for _ in range(suites // block):
        drawn = tallies(rng, block, factor)
        for s in range(block):
            checks = claim_checks({group: of[s] for group, of in drawn.items()})
            failed += any(check.outcome is Outcome.FAIL for check in checks)
    return failed / suites


def test_true_claims_of_alike_regions_are_called_false_in_one_suite_of_a_hundred() -> None:
    assert red(np.random.default_rng(1), 2000, 1.0) <= hit_band(2000, LEVEL, 0.999)[1] / 2000


@pytest.mark.parametrize("factor", [WRONG, 1 / WRONG])
def test_a_covariance_one_fifth_wrong_turns_a_suite_red(factor: float) -> None:
    assert red(np.random.default_rng(2), 500, factor) > 0.95


def test_pooled_regions_of_alike_worlds_would_cry_wolf() -> None:
    """What the spread between worlds is for: regions counted as if each were a world of its own."""
    drawn = tallies(np.random.default_rng(3), 300, 1.0)["check_points"]
    low, high = hit_band(8 * WORLDS, 0.95, 0.99)
    assert np.mean([not low <= of.hits.sum() <= high for of in drawn]) > 0.1


def test_too_few_worlds_leave_it_open_whether_a_covariance_is_right() -> None:
    rng = np.random.default_rng(4)
    few = Tally(nees=rng.chisquare(9, 12) / 9, hits=np.full(12, 1), parts=np.full(12, 1))
    by_name = {check.name: check.outcome for check in claim_checks({"camera": few})}
    assert by_name["camera: covariance less than 1.2 times wrong"] is Outcome.OPEN
    one = Tally(nees=np.ones(1), hits=np.ones(1, int), parts=np.ones(1, int))
    assert claim_checks({"camera": one}) == []


def test_a_group_without_anything_to_judge_has_no_checks() -> None:
    nothing, two = Errors(np.zeros(0), np.zeros((0, 0)), 1), Errors(np.ones(3), np.eye(3), 3)
    trial = {"camera": nothing, "boards": nothing, "check_points": two}
    figures = figures_of([trial, trial])
    assert {row["name"].split(":")[0] for row in figures["checks"]} == {"check_points"}
    assert figures["camera"]["coverage_interval_95"] is None


def test_a_rig_is_judged_with_both_its_cameras_together() -> None:
    path = SCENES / "stereo_rig.toml"
    text = path.read_text().replace('rig = "bar"\ncount = 10', 'rig = "bar"\ncount = 2')
    (trial,) = drawn_worlds(text, path, 1)
    sizes = {group: (len(of.error), of.size) for group, of in trial.errors.items()}
    assert sizes["camera"] == (18, 9) and sizes["relative_orientation"] == (6, 6)
    for of in trial.errors.values():
        assert 0.1 < of.nees < 4
    assert set(figures_of([trial.errors])) == {*trial.errors, "checks"}


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "worlds"), [("quick", WORLDS), ("stitched_wall", 50), ("stereo_rig", 50)])
def test_claims_hold_over_worlds_and_those_one_fifth_wrong_do_not(scene: str, worlds: int) -> None:
    path = SCENES / f"{scene}.toml"
    found = [trial.errors for trial in drawn_worlds(path.read_text(), path, worlds)]

    def outcomes(factor: float) -> dict[str, Outcome]:
        scaled = {g: [replace(e[g], cov=factor * e[g].cov) for e in found] for g in found[0]}
        checks = claim_checks({group: Tally.of(errors) for group, errors in scaled.items()})
        return {check.name: check.outcome for check in checks}

    assert Outcome.FAIL not in outcomes(1.0).values(), outcomes(1.0)
    enough = [g for g, of in found[0].items() if worlds >= enough_trials(len(of.error), len(found[0]))]
    assert "check_points" in enough
    for group in enough:
        assert outcomes(1.0)[f"{group}: covariance less than {WRONG:g} times wrong"] is Outcome.PASS
        for factor in (WRONG, 1 / WRONG):
            assert outcomes(factor)[f"{group}: NEES per degree of freedom"] is Outcome.FAIL, (group, factor)
