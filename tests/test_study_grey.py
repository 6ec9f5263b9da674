"""The study of grey methods: its design, its rankings and what it says of them."""

import json
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import f as f_law
from scipy.stats import kendalltau

from testfield.camera.project import project
from testfield.errors import TestfieldError
from testfield.evaluate.case import changed
from testfield.evaluate.execute import do_case
from testfield.scene.check import check_scene
from testfield.scene.load import parse_scene
from testfield.scene.truth import see
from testfield.score.scorecard import plain
from testfield.seeds import generator
from testfield.study.finding import Outcome
from testfield.study.page import write_page
from testfield.study.study import Extent, Results, run_study
from testfield_studies.grey import design as grey_design
from testfield_studies.grey import page as grey_page
from testfield_studies.grey import plan as grey
from testfield_studies.grey import rankings as grey_rankings
from testfield_studies.grey import runs as grey_runs
from testfield_studies.grey import samples as grey_samples
from testfield_studies.grey import small_samples as grey_small_samples
from testfield_studies.grey.factors import DUMMY, FACTORS, NAMES, WORKSHOP, levels_of, scene_of
from testfield_studies.grey.sweeps import sweep_table
from testfield_studies.truth import exact_calibration

HOLDS, FAILS, OPEN = Outcome.HOLDS, Outcome.FAILS, Outcome.OPEN
EFFECT = np.array([0.2, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.8, 0.4, 0.0, 1.2, 0.0])


def _rows(base_rows: int, noise: float, levels: int = 3, repeats: int = 2) -> pd.DataFrame:
    """Runs whose ln RMSE is `EFFECT` times the places in the unit cube, and noise."""
    rng = generator(1, "grey rows")
    rows = []
    for entry in grey.design(base_rows) + grey.sweep(levels, repeats):
        unit = np.array(entry["unit"])
        row = {key: value for key, value in entry.items() if key != "unit"}
        row |= {f"unit {k}": value for k, value in enumerate(unit)}
        rows.append(row | {"part": "runs", "lost": "", "rmse_mm": float(np.exp(unit @ EFFECT + noise * rng.normal()))})
    return pd.DataFrame(rows)


@cache
def _samples() -> pd.DataFrame:
    rng = generator(2, "grey rows")
    rows = [
        {
            "part": "exposures",
            "centroid": centroid,
            "exposure": e,
            "station": 0,
            "mark": m,
            "error_x_px": 0.01 * rng.normal() + 0.003 * (m % 3),
            "error_y_px": 0.01 * rng.normal(),
        }
        for centroid in grey.CENTROIDS
        for e in range(6)
        for m in range(12)
    ]
    for case in grey.laws(2000):
        rows += [case.labels | row for row in grey_samples.sample_law(case, None)]
    return pd.DataFrame(rows)


def _runs(base_rows: int, noise: float) -> grey_rankings.Runs:
    rows = _rows(base_rows, noise)
    return grey_rankings.Runs.of(rows[rows["set"] == "design"]).whole()


def test_every_run_of_the_plan_is_made_once_and_shares_its_picture_with_all_that_look_alike():
    for quick, pictures, runs in ((True, 3 * 12, 3 * 14), (False, 16 * 12 + 41, 16 * 14 + 180)):
        cases = [case for case in grey.cases(quick) if case.labels["part"] == "runs"]
        entries = [entry for case in cases for entry in case.options["runs"]]
        assert len({entry["run"] for entry in entries}) == len(entries) == runs
        assert pictures - 12 <= len(cases) <= pictures  # numbers of stations may be the same
        for case in cases:
            for entry in case.options["runs"]:
                levels = levels_of(np.array(entry["unit"]))
                assert scene_of(levels) == case.scene and entry["read_noise_e"] == levels["image noise, e"]


def test_the_dummy_changes_nothing_and_every_other_factor_something():
    middle = np.full(len(FACTORS), 0.5)
    before = levels_of(middle)
    for k, factor in enumerate(FACTORS):
        unit = middle.copy()
        unit[k] = 0.9
        after = levels_of(unit)
        assert (scene_of(after) != scene_of(before)) == factor.pictures, factor.name
        assert after[factor.name] != before[factor.name]
    assert [f.name for f in FACTORS if not f.pictures] == ["image noise, e", DUMMY]


@pytest.mark.parametrize("place", [0.0, 1.0])
def test_the_scene_is_in_order_at_the_ends_of_all_factors(place):
    import tomli_w

    scene = parse_scene(tomli_w.dumps(scene_of(levels_of(np.full(len(FACTORS), place)))), "grey")
    from testfield.scene.build import build_world

    world = build_world(scene)
    check_scene(scene, world, see(world), "grey")
    assert len(world.station_name) == (4 if place == 0 else 8)


def test_the_workshop_of_a_run_is_drawn_around_the_truth():
    import tomli_w

    from testfield.scene.build import build_world

    unit = np.full(len(FACTORS), 0.5)
    unit[NAMES.index("bow of the board, um")] = 0  # the sheet knows nothing of it
    world = build_world(parse_scene(tomli_w.dumps(scene_of(levels_of(unit))), "grey"))
    true, views = exact_calibration(world), see(world)
    marks, sheet = world.marks, grey_runs.sheet_of(world.field, WORKSHOP)
    local = np.column_stack([sheet.boards[0].marks.xy_mm, np.zeros(len(sheet.boards[0].marks))])
    on_board = np.flatnonzero(marks.board == 0)
    here = true.boards[np.zeros(len(on_board), int)].apply(local[marks.point[on_board]])
    for station in range(len(true.station_names)):
        place = project(true.interior, true.stations[np.full(len(on_board), station)], here)
        assert np.allclose(place, views.centre_px[station, on_board], atol=1e-6)
    (bar,) = sheet.scale_bars
    ends = world.mark_world_mm[np.isin(marks.code, bar.codes)]
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(bar.length_mm, abs=1e-9)
    assert (bar.u_length_mm, sheet.boards[0].u_xy_mm) == (WORKSHOP["bar_mm"], WORKSHOP["print_mm"])
    assert sheet.u_scale == pytest.approx(1e-6 * WORKSHOP["scale_ppm"], rel=1e-12)


def test_sobol_indices_are_salibs():
    from SALib.analyze.sobol import analyze

    runs = _runs(32, 0.1)
    first, total = grey_rankings.sobol(runs)
    theirs = analyze(grey.problem(), runs.log, calc_second_order=False, num_resamples=2, seed=1)
    assert np.allclose(first, theirs["S1"], atol=1e-12) and np.allclose(total, theirs["ST"], atol=1e-12)


def test_analysis_of_variance_finds_the_shares_that_were_put_in():
    runs = _runs(64, 0.05)
    shares = EFFECT**2 / 12 / ((EFFECT**2).sum() / 12 + 0.05**2)
    assert np.allclose(grey_rankings.anova_shares(runs), shares, atol=0.08)
    tested = grey_rankings.anova_table(runs, 1500)
    assert set(tested["factor"][tested["p"] < 0.001]) == {name for name, e in zip(NAMES, EFFECT, strict=True) if e}
    assert grey_rankings.explained(runs) > 0.97
    # Without any effect, nothing acts.
    noise = replace(runs, rmse_mm=np.exp(generator(3, "noise").normal(size=len(runs.rmse_mm))))
    assert (grey_rankings.anova_table(noise, 1500)["p"] > 0.001).all()


def _acting_together(rng: np.random.Generator, rows: int = 16) -> grey_rankings.Runs:
    """A Saltelli design of which four factors act, in pairs and through nothing but their products."""
    ends = rng.uniform(size=(rows, 2, len(NAMES)))
    blocks = ["A", *NAMES, "B"]
    unit = np.repeat(ends[:, :1], len(blocks), axis=1)
    unit[:, -1] = ends[:, 1]
    for k in range(len(NAMES)):
        unit[:, 1 + k, k] = ends[:, 1, k]
    u = 2 * unit.reshape(-1, len(NAMES)) - 1
    log = 4 * u[:, 7] * u[:, 10] + 4 * u[:, 0] * u[:, 4] + 0.1 * rng.normal(size=len(u))
    return grey_rankings.Runs(
        unit.reshape(-1, len(NAMES)), np.exp(log), np.repeat(np.arange(rows), len(blocks)), np.tile(blocks, rows)
    )


def _f_test(runs: grey_rankings.Runs) -> np.ndarray:
    terms, _, residual = grey_rankings._regression(runs)
    free, p = len(terms) - terms.shape[1], []
    for k in range(len(NAMES)):
        without = np.delete(terms, [1 + 2 * k, 2 + 2 * k], axis=1)
        rest = runs.log - without @ np.linalg.lstsq(without, runs.log, rcond=None)[0]
        p.append(f_law.sf(((rest**2).sum() - residual) / 2 / (residual / free), 2, free))
    return np.array(p)


def test_where_factors_act_together_those_that_do_nothing_are_found_as_often_as_chance_finds_them():
    designs = [_acting_together(generator(k, "grey together")) for k in range(30)]
    none = [1, 2, 3, 5, 6, 8, 9, 11]
    p = np.array([grey_rankings.anova_table(runs, 99)["p"].to_numpy()[none] for runs in designs])
    for level in (0.05, 0.2, 0.5):
        assert abs((p <= level).mean() - level) < 4 * np.sqrt(level * (1 - level) / p.size)
    independent = np.array([_f_test(runs)[none] for runs in designs])
    assert (independent <= 0.05).mean() > 0.2  # what the runs of a base row share makes an F test find nothing's effect


def test_a_shuffle_explains_as_much_as_a_regression_on_it_does():
    runs = _runs(8, 0.3)
    terms, _, residual = grey_rankings._regression(runs)
    without = np.delete(terms, 3, axis=1)
    basis = grey_rankings._basis(without)
    rest = runs.log - without @ np.linalg.lstsq(without, runs.log, rcond=None)[0]
    gain = grey_rankings._gains(basis, rest, terms[None][:, :, [3]])
    assert gain == pytest.approx((rest**2).sum() - residual, rel=1e-9)


def test_kendalls_tau_is_that_of_scipy_with_and_without_ties():
    rng = generator(4, "tau")
    a, b = rng.integers(0, 6, (20, 12)), rng.normal(size=(20, 12))
    expected = [kendalltau(x, y).statistic for x, y in zip(a, b, strict=True)]
    assert np.allclose(grey_rankings.agreement(a, b), expected, atol=1e-12)
    assert grey_rankings.agreement(b, b[0])[0] == pytest.approx(1)


def test_a_dummy_above_acting_factors_is_counted():
    scores = np.arange(12.0)[None]
    acting = np.zeros(12, bool)
    acting[[3, 7]] = True
    assert grey_rankings.dummy_above(scores, acting).tolist() == [2]
    scores[0, NAMES.index(DUMMY)] = 5
    assert grey_rankings.dummy_above(scores, acting).tolist() == [1]
    scores[0, NAMES.index(DUMMY)] = -1
    assert grey_rankings.dummy_above(scores, acting).tolist() == [0]


def test_a_sweeps_slope_is_what_was_put_in_within_its_uncertainty():
    rows = _rows(1, 0.2, 5, 4)
    table = sweep_table(rows[rows["set"] == "sweep"]).set_index("factor")
    assert np.allclose(table["u"], 0.2 / np.sqrt(4 * 0.625), rtol=0.6)
    assert (np.abs(table["change of ln RMSE"] - EFFECT) < 4 * table["u"]).all()
    assert ((table["change of ln RMSE"] - EFFECT) ** 2 / table["u"] ** 2).mean() < 2.5
    exact = _rows(1, 0.0, 5, 4)
    exact = sweep_table(exact[exact["set"] == "sweep"])
    assert np.allclose(exact["change of ln RMSE"], EFFECT, atol=1e-12) and np.allclose(exact["u"], 0, atol=1e-12)


def test_laws_come_first_so_that_a_study_that_is_not_finished_has_them():
    for quick in (True, False):
        parts = [case.labels["part"] for case in grey.cases(quick)]
        assert parts == sorted(parts, key=["law", "exposures", "runs"].index)


def test_dengs_rank_of_the_dummy_is_made_by_the_zero_of_its_levels():
    runs = _runs(16, 0.1)
    acting = EFFECT > 0.5
    table = grey_rankings.dummy_with_offset(runs, acting, (0.0, 10.0), 20)
    assert table["degree"].iloc[1] > table["degree"].iloc[0] + 0.02
    assert table["rank"].iloc[1] < table["rank"].iloc[0]
    assert grey_rankings.dummy_with_offset(runs, ~acting, (10.0,), 20)["above an acting factor"].iloc[0] == 1.0


def test_samples_from_a_population_have_its_law_and_are_judged_by_its_sigma():
    rng = generator(5, "population")
    populations = [100 + 3 * rng.normal(size=4000), -7 + 0.1 * rng.normal(size=4000)]
    rows = pd.DataFrame(grey_samples.judge("p", grey_samples.population_draw(populations), 5, 20_000))
    rows = rows.set_index("estimator")
    assert rows.loc["Bessel", "mean_ratio"] == pytest.approx(0.940, abs=0.01)
    assert rows.loc["grey, largest gap", "mean_ratio"] == pytest.approx(0.8912, abs=0.01)
    assert rows.loc["grey, largest gap", "sigma_covered"] == pytest.approx(0.95, abs=0.01)
    assert rows.loc["Bessel", "mean_covered_t"] == pytest.approx(0.95, abs=0.01)
    assert rows.loc["grey, largest gap", "mean_covered_2"] < 0.9


def test_normal_errors_are_described_as_normal_whatever_their_number():
    rng = generator(6, "population")
    for m in (5, 60):
        errors = 0.02 * rng.normal(size=(m, 400)) + 0.01 * rng.normal(size=400)
        skewness, excess, _ = grey_small_samples.shape(grey_small_samples.populations(errors)[grey_small_samples.DOT])
        assert abs(skewness) < 0.15 and abs(excess) < 0.4
        assert grey_small_samples._scatter_and_bias(errors) == pytest.approx((0.02, 0.01), rel=0.15)
        assert grey_small_samples._scatter_and_bias(errors - errors.mean(axis=0))[1] == 0


def test_errors_are_called_unlike_normal_ones_only_where_they_are(short):
    rng = generator(7, "population")
    tails, bias = "tails_dot_forward_model", "bias_forward_model"
    for errors, outcomes in (
        (0.02 * rng.normal(size=(12, 60)), (HOLDS, OPEN)),
        (0.02 * rng.laplace(size=(12, 60)), (FAILS, OPEN)),
        (0.02 * rng.uniform(-1, 1, size=(12, 60)), (FAILS, OPEN)),
        (0.02 * rng.normal(size=(12, 60)) + 0.03 * (-1.0) ** np.arange(60), (HOLDS, HOLDS)),
    ):
        found = _read_exposures(errors)
        assert (found[tails].outcome, found[bias].outcome) == outcomes
    assert found[bias].quantities["bias_over_scatter"].value == pytest.approx(1.5, abs=0.2)


def _read_exposures(errors: np.ndarray) -> Results:
    half = errors.shape[1] // 2
    rows = [
        {
            "part": "exposures",
            "centroid": "forward_model",
            "exposure": e,
            "station": 0,
            "mark": m,
            "error_x_px": errors[e, m],
            "error_y_px": errors[e, half + m],
        }
        for e in range(len(errors))
        for m in range(half)
    ]
    return grey_page.read(pd.DataFrame(rows))


def _read(rows: pd.DataFrame) -> Results:
    return grey_page.read(pd.concat([_samples(), rows], ignore_index=True))


def _sound(results: Results) -> None:
    """Words without holes, and figures that JSON knows."""
    assert "nan" not in " ".join(grey_page.STUDY.concluded(results))
    json.dumps(plain([finding.row() for finding in results.findings]), allow_nan=False)


def _write(results: Results, folder: Path) -> None:
    write_page(grey_page.STUDY, results, Extent(cases=9, done=1, failures=[], quick=True), folder)


@pytest.fixture()
def short(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(grey_design, "BOOTSTRAPS", 20)
    monkeypatch.setattr(grey_design, "ORDERS", 5)
    monkeypatch.setattr(grey_small_samples, "ALIKE", 40)
    monkeypatch.setattr(grey_samples, "PIVOTS", 2000)
    grey_samples.pivots.cache_clear()
    yield
    grey_samples.pivots.cache_clear()


def test_the_page_says_what_the_runs_say_and_counts_what_is_lost(short, tmp_path: Path):
    rows = _rows(16, 0.05)
    hit = rows.index[rows["run"] == "design 20"]
    rows.loc[hit, "rmse_mm"], rows.loc[hit, "lost"] = np.nan, "no image shows the board"
    found = _read(rows)
    _sound(found)
    runs = {name: quantity.value for name, quantity in found["acting"].quantities.items()}
    assert (runs["runs"], runs["lost"], runs["left_out"]) == (16 * 14, 1, 14)
    assert found["acting"].outcome == HOLDS and runs["acting"] >= 3
    assert found["floor"].quantities["least"].value > 1 / 3
    assert grey_page.STUDY.verdict(found) == FAILS
    _write(found, tmp_path)
    for name in ("bias", "scatter", "shares", "ranks", "agreement", "sweeps"):
        assert (tmp_path / f"{name}.svg").stat().st_size > 5000 and (tmp_path / f"{name}.csv").is_file()


def test_normal_samples_and_laws_give_the_outcomes_that_theory_has(short):
    found = _read(_rows(1, 0.05))
    outcomes = {name: found[name].outcome for name in ("scatter", "interval", "optimism", "unbiased", "laws")}
    assert outcomes == {"scatter": OPEN, "interval": FAILS, "optimism": HOLDS, "unbiased": HOLDS, "laws": FAILS}
    samples = _samples()
    turned = samples.replace({"estimator": {"Bessel": "grey, largest gap", "grey, largest gap": "Bessel"}})
    turned = grey_page.read(turned[turned["part"] == "law"])
    assert (turned["optimism"].outcome, turned["laws"].outcome) == (FAILS, HOLDS)
    covered = samples.assign(mean_covered_2=0.95, u_mean_covered_2=0.001)
    assert grey_page.read(covered[covered["part"] == "law"])["interval"].outcome == HOLDS


def test_a_degree_that_keeps_nothing_below_what_acts_is_not_called_misleading(short, monkeypatch: pytest.MonkeyPatch):
    usual = _read(_rows(16, 0.05))
    assert usual["nothing_above"].outcome == FAILS and usual["orders"].outcome == FAILS
    monkeypatch.setattr(
        grey_design,
        "bootstrap",
        lambda runs, count: dict.fromkeys(grey_rankings.METHODS, np.tile(EFFECT - 1e-9 * np.arange(12), (count, 1))),
    )
    assert _read(_rows(16, 0.05))["nothing_above"].outcome == HOLDS


def test_a_design_of_few_base_rows_judges_nothing(short, tmp_path: Path):
    found = _read(_rows(4, 0.05))
    _sound(found)
    assert found["nothing_above"].outcome == found["ranking"].outcome == found["acting"].outcome == OPEN
    assert "4 base rows, which of so few is no 95 % interval" in " ".join(t.note for t in found.tables)
    assert found["acting"].quantities["acting"].value == 0
    _write(found, tmp_path)


def test_a_design_of_which_nothing_was_measured_is_open(short):
    rows = _rows(4, 0.05)
    rows["rmse_mm"], rows["lost"] = np.nan, "no image shows the board"
    found = _read(rows)
    _sound(found)
    assert not found["acting"].measured and not found["slopes"].measured


SWEEP_WITH_A_HOLE = "all but one run of a sweep"
SO_FAR = {
    "none": lambda rows: rows["part"] == "",
    "one law, not the normal one": lambda rows: rows["law"] == "Laplace",
    "the normal law": lambda rows: rows["law"] == "normal",
    "all laws but one": lambda rows: (rows["part"] == "law") & (rows["law"] != "uniform"),
    "laws": lambda rows: rows["part"] == "law",
    "laws and two exposures": lambda rows: (rows["part"] == "law") | (rows["exposure"] < 2),
    "laws and exposures": lambda rows: rows["part"] != "runs",
    "one estimator's exposures": lambda rows: rows["centroid"] == "forward_model",
    "no laws": lambda rows: rows["part"] != "law",
    "runs": lambda rows: rows["part"] == "runs",
    "one run": lambda rows: rows["run"] == "design 0",
    "two base rows": lambda rows: (rows["set"] == "design") & (rows["base"] < 2),
    "the design and half a sweep": lambda rows: (rows["set"] == "design") | (rows["block"] == NAMES[0]),
    "the sweeps": lambda rows: rows["set"] == "sweep",
    SWEEP_WITH_A_HOLE: lambda rows: rows["run"] != f"sweep {DUMMY} 1 0",
}


@pytest.mark.parametrize("name", SO_FAR)
def test_a_study_that_is_not_finished_says_what_there_is_and_no_more(name, short, tmp_path: Path):
    rows = pd.concat([_samples(), _rows(4, 0.05)], ignore_index=True)
    rows = rows[SO_FAR[name](rows)].dropna(axis=1, how="all").reset_index(drop=True)
    if name == "none":
        rows = pd.DataFrame(columns=["part", "law", "centroid", "first exposure", "picture"])  # all cases failed
    found = grey_page.read(rows)
    _sound(found)
    _write(found, tmp_path)
    assert found["interval"].measured == ("normal" in set(rows.get("law", ())))
    assert found["laws"].measured == (len(set(rows.get("law", ())) & set(grey_samples.LAWS)) > 1)
    assert found["acting"].measured == (name in ("no laws", "runs", "the design and half a sweep", SWEEP_WITH_A_HOLE))
    assert found["slopes"].measured == (name in ("no laws", "runs", "the sweeps"))


@pytest.mark.slow
def test_the_quick_study_runs_from_end_to_end(tmp_path: Path):
    findings = run_study(grey_page.STUDY, tmp_path, True, 2)
    _sound(findings)
    table = pd.read_parquet(tmp_path / "results.parquet")
    assert set(table["part"]) == {"law", "exposures", "runs"} and "failure" not in table
    assert (table.loc[table["part"] == "runs", "lost"] == "").all()
    assert findings["nothing_above"].outcome == OPEN
    assert (tmp_path / "report.html").stat().st_size > 100_000
    assert json.loads((tmp_path / "findings.json").read_text())["failed"] == 0


@pytest.mark.slow
def test_a_rendered_run_gives_its_error_and_a_hopeless_one_its_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    unit = np.full(len(FACTORS), 0.5)
    unit[NAMES.index("stations")] = 0.0
    entry = {"run": "a", "repeat": 0, "set": "design", "base": 0, "block": "A", "unit": unit.tolist()}
    (case,) = grey.runs([entry, entry | {"run": "b"}])
    case = replace(case, scene=changed(case.scene or {}, {"render.cells": 1}))
    good, again = do_case(case, tmp_path)
    assert (good["run"], again["run"]) == ("a", "b")
    assert 0 < good["rmse_mm"] < 0.2 and good["measured"] == 10 and good["lost"] == ""
    assert good["rmse_mm"] != again["rmse_mm"]  # its own noise, on the same picture
    assert 0 < abs(good["bar_off_mm"]) < 0.05 and good["bar_off_mm"] != again["bar_off_mm"]  # and its own workshop
    assert not list(tmp_path.glob("runs/*/radiance/*.exr"))

    def blind(*_: object) -> None:
        raise TestfieldError("no image shows the board", "observations.parquet")

    monkeypatch.setattr("testfield_studies.grey.runs.reexposed", blind)
    bad = do_case(replace(case, options=case.options | {"runs": case.options["runs"][:1]}), tmp_path)[0]
    assert np.isnan(bad["rmse_mm"]) and "no image shows the board" in bad["lost"]
