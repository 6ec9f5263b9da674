"""The study of grey methods: its design, its rankings and what it says of them."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import kendalltau

from testfield.camera.project import project
from testfield.errors import TestfieldError
from testfield.report.study import write_page
from testfield.scene.check import check_scene
from testfield.scene.load import parse_scene
from testfield.scene.truth import see
from testfield.seeds import generator
from testfield.study import grey, grey_page, grey_rankings, grey_runs, grey_samples
from testfield.study.cases import changed
from testfield.study.grey_factors import DUMMY, FACTORS, NAMES, WORKSHOP, levels_of, scene_of
from testfield.study.run_cases import do_case
from testfield.study.study import Findings

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


def _samples() -> pd.DataFrame:
    rng = generator(2, "grey rows")
    rows = [
        {"part": "exposures", "centroid": centroid, "exposure": e, "station": 0, "mark": m,
         "error_x_px": 0.01 * rng.normal() + 0.003 * (m % 3), "error_y_px": 0.01 * rng.normal()}
        for centroid in grey.CENTROIDS for e in range(6) for m in range(12)
    ]  # fmt: skip
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
    true, views = grey_runs.true_calibration(world), see(world)
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
    tested = grey_rankings.anova_table(runs)
    assert set(tested["factor"][tested["p"] < 0.001]) == {name for name, e in zip(NAMES, EFFECT, strict=True) if e}
    assert grey_rankings.explained(runs) > 0.97
    # Without any effect, nothing acts.
    noise = replace(runs, rmse_mm=np.exp(generator(3, "noise").normal(size=len(runs.rmse_mm))))
    assert (grey_rankings.anova_table(noise)["p"] > 0.001).all()


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
    table = grey_rankings.sweep_table(rows[rows["set"] == "sweep"]).set_index("factor")
    assert np.allclose(table["u"], 0.2 / np.sqrt(4 * 0.625), rtol=0.6)
    assert (np.abs(table["change of ln RMSE"] - EFFECT) < 4 * table["u"]).all()
    assert ((table["change of ln RMSE"] - EFFECT) ** 2 / table["u"] ** 2).mean() < 2.5
    exact = _rows(1, 0.0, 5, 4)
    exact = grey_rankings.sweep_table(exact[exact["set"] == "sweep"])
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


def _read(rows: pd.DataFrame) -> Findings:
    return grey_page.read(pd.concat([_samples(), rows], ignore_index=True))


@pytest.fixture()
def short(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    from testfield.study import grey_page_relations

    monkeypatch.setattr(grey_page_relations, "BOOTSTRAPS", 20)
    monkeypatch.setattr(grey_page_relations, "ORDERS", 5)
    monkeypatch.setattr(grey_samples, "PIVOTS", 2000)
    grey_samples.pivots.cache_clear()
    yield
    grey_samples.pivots.cache_clear()


def test_the_page_says_what_the_runs_say_and_counts_what_is_lost(short, tmp_path: Path):
    rows = _rows(8, 0.05)
    hit = rows.index[rows["run"] == "design 20"]
    rows.loc[hit, "rmse_mm"], rows.loc[hit, "lost"] = np.nan, "no image shows the board"
    findings = _read(rows)
    relations = findings.figures["grey relational analysis"]
    assert relations["runs"] == 8 * 14 and relations["lost runs"] == 1
    assert "1 could not be measured, 14 were left out with their base rows" in " ".join(findings.sentences)
    assert "bow of the board, um" in relations["acting factors"] and DUMMY not in relations["acting factors"]
    assert relations["Deng's lowest degree"] > 1 / 3
    write_page(grey_page.STUDY, findings, [], tmp_path, True)
    for name in ("bias", "scatter", "shares", "ranks", "agreement", "sweeps"):
        assert (tmp_path / f"{name}.svg").stat().st_size > 5000 and (tmp_path / f"{name}.csv").is_file()


def test_a_design_of_which_nothing_was_measured_is_said_to_be_so(short):
    rows = _rows(4, 0.05)
    rows["rmse_mm"], rows["lost"] = np.nan, "no image shows the board"
    assert "No base row of the design is whole (no image shows the board)" in _read(rows).verdict


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

    monkeypatch.setattr("testfield.study.grey_runs.reexposed", blind)
    bad = do_case(replace(case, options={"runs": case.options["runs"][:1]}), tmp_path)[0]
    assert np.isnan(bad["rmse_mm"]) and "no image shows the board" in bad["lost"]
