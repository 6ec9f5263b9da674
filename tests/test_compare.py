"""`testfield compare`: the same frames for every recipe, the two known rows as they must be, failures counted."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from testfield.evaluate.bias import bias_and_spread, centre_errors
from testfield.evaluate.compare import conclude, of_common
from testfield.evaluate.comparison import Comparison
from testfield.evaluate.comparison_cases import cases_of, noise_of
from testfield.evaluate.failures import FAILURE
from testfield.evaluate.known_rows import BROKEN, KNOWN, SHIFT_PX, TRUTH
from testfield.evaluate.metrics import CENTRE, COMMON, CORNER, POINTS
from testfield.measure.recipe import Algorithm, Recipe

TINY = Path(__file__).parent / "torture" / "tiny.toml"
MATTERS = {"px": 0.001, "um": 1.0, "": 0.5}


def recipes(*names: str) -> tuple[Recipe, ...]:
    return tuple(Recipe(name=name, centroid=Algorithm(name)) for name in names)


def run_compare(*words: object) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "testfield", "compare", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_every_recipe_meets_every_draw_of_every_scene_and_two_rows_are_known(tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(TINY.read_text().replace('name = "', 'name = "other_', 1))
    cases = cases_of(Comparison((TINY, other), recipes("forward_model", "grey_centroid"), 3))
    labels = pd.DataFrame([case.labels for case in cases])
    assert (labels.groupby(["scene", "recipe"]).size().unstack()[["forward_model", "grey_centroid"]] == 3).all().all()
    assert (labels.groupby(["scene", "recipe"]).size().unstack()[[TRUTH, BROKEN]] == 1).all().all()
    own = [case for case in cases if case.recipe is not None]
    for case in own:
        assert case.noise_seed == noise_of(case.labels["scene"], case.labels["draw"]) and case.scene is not None
    # What the machine does besides slows no recipe more than another: each draw begins with another one.
    assert [case.recipe.name for case in own[:4]] == [
        *("forward_model", "grey_centroid"),
        *("grey_centroid", "forward_model"),
    ]


def test_a_comparison_finds_the_better_centroid_and_keeps_what_it_did(tmp_path: Path) -> None:
    words = (TINY, "--centroids", "forward_model,grey_centroid", "--draws", 3, "--out", tmp_path, "--jobs", 2, "--json")
    said = run_compare(*words)
    assert said.returncode == 0, said.stderr
    found = json.loads(said.stdout)
    assert found["sane"]
    (centre,) = [row for row in found["differences"] if row["figure"] == CENTRE.title]
    assert centre["difference"] > 0.005 and centre["draws"] == 3
    rows = pd.read_parquet(tmp_path / "results.parquet").set_index("recipe")
    assert rows.loc[TRUTH, CENTRE.key] == pytest.approx(0, abs=1e-12)
    assert rows.loc[BROKEN, CENTRE.key] == pytest.approx(SHIFT_PX / np.sqrt(2), rel=1e-9)
    page = re.sub(r"<script.*?</script>", "", (tmp_path / "report.html").read_text(), flags=re.S)
    assert not re.search(r"""(src|href)=["'](?!#|data:)|url\(["']?http""", page)
    for name in ("difference_centre_error_rms", "accuracy_over_recall", "bias_centre_grey_centroid"):
        assert (tmp_path / f"figures/{name}.pdf").read_bytes().startswith(b"%PDF")
        assert re.search(r'width="(239|240|241)[\d.]*pt"', (tmp_path / f"figures/{name}.svg").read_text())  # 85 mm
    assert len(pd.read_parquet(tmp_path / "comparison.parquet")) == len(found["differences"])
    for name in ("comparison.csv", "comparison.md", "comparison.tex", "cases.csv"):
        assert "grey_centroid" in (tmp_path / name).read_text().replace("\\", "")
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "cases").iterdir()}
    again = run_compare(*words)
    assert json.loads(again.stdout) == found
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "cases").iterdir()} == kept


def rows_of(**columns: list) -> pd.DataFrame:
    n = len(next(iter(columns.values())))
    return pd.DataFrame({"scene": ["s"] * n, "draw": range(1, n + 1)} | columns)


def test_a_truth_that_errs_or_a_broken_one_that_wins_condemns_the_page() -> None:
    def known(truth: float, broken: float) -> bool:
        rows = rows_of(recipe=["a", "b", TRUTH, BROKEN], **{CENTRE.key: [0.01, 0.02, truth, broken]})
        return conclude(rows, ["a", "b"], MATTERS).sane

    assert known(0.0, SHIFT_PX / np.sqrt(2))
    assert not known(1e-6, SHIFT_PX / np.sqrt(2))
    assert not known(0.0, 0.35)
    assert not known(0.0, 0.015)
    rows = rows_of(recipe=["a", "b"], **{CENTRE.key: [0.01, 0.02]})
    assert not conclude(rows, ["a", "b"], MATTERS).sane


def test_any_known_figure_that_comes_out_otherwise_condemns_the_page() -> None:
    def known(camera: float, points: float, zero: float) -> list[str]:
        rows = rows_of(recipe=["a", "b", TRUTH, BROKEN], **{CENTRE.key: [0.01, 0.02, 0.0, SHIFT_PX / np.sqrt(2)]})
        for key, found, must in ((CORNER.key, camera, 0.5), (POINTS.key, points, 0.2)):
            rows[key] = [0.1, 0.1, zero, found]
            rows[KNOWN + key] = [np.nan, np.nan, 0.0, must]
        compared = conclude(rows, ["a", "b"], MATTERS)
        assert compared.sane == (not compared.otherwise)
        return [f"{row}, {key}" for _, row, key in compared.otherwise]

    assert known(0.45, 0.2, 0.0) == []
    assert known(0.1, 0.2, 0.0) == [f"{BROKEN}, {CORNER.key}"]
    assert known(0.45, 0.201, 0.0) == [f"{BROKEN}, {POINTS.key}"]
    assert len(known(0.45, np.nan, 0.0)) == 1  # no figure where there had to be one
    assert known(0.45, 0.2, 1e-6) == [f"{TRUTH}, {CORNER.key}", f"{TRUTH}, {POINTS.key}"]


def test_a_recipe_worse_than_what_is_broken_is_named_and_the_ruler_is_believed() -> None:
    rows = rows_of(recipe=["a", "b", TRUTH, BROKEN], **{CENTRE.key: [0.01, 0.6, 0.0, SHIFT_PX / np.sqrt(2)]})
    compared = conclude(rows, ["a", "b"], MATTERS)
    assert compared.sane and compared.lost_to_broken == {"b": [CENTRE.title]}


def test_what_is_broken_is_an_opponent_in_its_own_scene_alone() -> None:
    broken = SHIFT_PX / np.sqrt(2)
    own = {POINTS.key: [20.0, 2.0, 0.0, 50.0, 0.1, 0.9, 0.0, 1.0], CENTRE.key: [0.01, 0.01, 0.0, broken] * 2}
    rows = rows_of(recipe=["a", "b", TRUTH, BROKEN] * 2, scene=["large"] * 4 + ["small"] * 4, **own)
    assert conclude(rows, ["a", "b"], MATTERS).lost_to_broken == {}
    rows.loc[5, POINTS.key] = 1.1
    assert conclude(rows, ["a", "b"], MATTERS).lost_to_broken == {"b": [POINTS.title]}


def test_where_every_case_failed_the_tables_stand_and_nothing_is_believed() -> None:
    rows = rows_of(recipe=["a", "b", TRUTH, BROKEN], **{FAILURE: ["too few boards"] * 4})
    compared = conclude(rows, ["a", "b"], MATTERS)
    assert not compared.sane and compared.lost_to_broken == {} and compared.summary.failed.tolist() == [1, 1]


def test_a_comparison_without_any_figure_says_why_in_one_sentence(tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text(TINY.read_text() + '\n[measure]\ncentroid = "nonsense"\n')
    words = (scene, "--centroids", "forward_model,grey_centroid", "--draws", 1, "--out", tmp_path / "out", "--jobs", 1)
    said = run_compare(*words)
    assert said.returncode == 2 and "nonsense" in said.stderr and "Traceback" not in said.stderr
    assert not (tmp_path / "out/report.html").exists()


def test_means_of_recipes_are_over_what_all_of_them_gave() -> None:
    rows = rows_of(recipe=["a", "b", "a", "b"], **{CENTRE.key: [0.01, 0.009, np.nan, 0.5]})
    rows["draw"] = [1, 1, 2, 2]
    compared = conclude(rows, ["a", "b"], MATTERS)
    assert compared.summary[CENTRE.key].tolist() == pytest.approx([0.01, 0.009])
    ranks = compared.ranks[compared.ranks.figure == CENTRE.title]
    assert ranks["rank"].tolist() == [2, 1] and ranks.draws.tolist() == [1, 1] and ranks.of_draws.tolist() == [2, 2]


def test_failures_are_counted_and_not_dropped() -> None:
    rows = rows_of(recipe=["a", "b", "a", "b"], **{CENTRE.key: [0.01, np.nan, 0.01, 0.02]})
    rows["draw"] = [1, 1, 2, 2]
    rows[FAILURE] = [None, "too few boards", None, None]
    compared = conclude(rows, ["a", "b"], MATTERS)
    assert compared.summary.failed.tolist() == [0, 1]
    assert compared.differences["b", CENTRE.key].draws == 1


def test_who_leaves_out_what_is_hard_gains_nothing_where_all_count_the_same() -> None:
    all_found = {"station": [0, 0, 1], "mark": [3, 4, 3], "dx_px": [0.1, 0.9, 0.1], "dy_px": [0.1, 0.9, 0.1]}
    easy_ones = {"station": [1, 0], "mark": [3, 3], "dx_px": [0.2, 0.2], "dy_px": [0.2, 0.2]}
    rows = pd.DataFrame(
        [
            {"scene": "s", "draw": 1, "recipe": "a", CENTRE.key: 0.53} | all_found,
            {"scene": "s", "draw": 1, "recipe": "b", CENTRE.key: 0.2} | easy_ones,
            {"scene": "s", "draw": 1, "recipe": "c", FAILURE: "crashed"},
        ]
    )
    assert of_common(rows).tolist() == pytest.approx([0.1, 0.2, np.nan], nan_ok=True)
    compared = conclude(rows, ["a", "b", "c"], MATTERS)
    assert compared.differences["b", CENTRE.key].estimate.value < 0
    assert compared.differences["b", COMMON.key].estimate.value == pytest.approx(0.1)


def test_bias_and_spread_of_drawn_errors_come_back() -> None:
    rng, marks, draws = np.random.default_rng(1), 400, 12
    bias = rng.normal(0, 0.02, (marks, 2))
    rows = []
    for draw in range(draws):
        error = bias + rng.normal(0, 0.05, (marks, 2))
        order = rng.permutation(marks)[: marks - 3]  # some are missed, and rows have no order
        columns = {"dx_px": error[order, 0].tolist(), "dy_px": error[order, 1].tolist()}
        rows.append({"scene": "s", "draw": draw, "station": [0] * len(order), "mark": order.tolist()} | columns)
    *found, items = bias_and_spread(pd.DataFrame(rows), centre_errors)
    assert found == pytest.approx((0.02, 0.05), rel=0.06)
    assert items > 0.8 * marks
