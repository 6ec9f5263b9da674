"""Worst cases of a comparison are found, and cut out of the frames that the recipes met."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from testfield.chain.run import Run
from testfield.evaluate import worst
from testfield.evaluate.case import Case
from testfield.evaluate.compared import compared_row
from testfield.evaluate.worst import Crop, Worst, crops_of, cut, worst_of
from testfield.evaluate.worst_drawings import crop_drawings, enlargement
from testfield.measure.recipe import Algorithm, Recipe

NAMES = ["forward_model", "grey_centroid"]


def rows_of(errors: dict[str, list[float]], missed: dict[str, list[int]]) -> pd.DataFrame:
    """One scene, one draw a row of numbers: recipe "a" and "b" in turns, errors along x of marks 0, 1, ..."""
    rows = []
    for name, size in errors.items():
        labels = {"scene": "s", "factor": "", "level": -1, "draw": 1, "recipe": name}
        marks = {"station": [0] * len(size), "mark": list(range(len(size)))}
        lists = {"dx_px": size, "dy_px": [0.0] * len(size)}
        gone = {"missed_station": [0] * len(missed.get(name, [])), "missed_mark": missed.get(name, [])}
        rows.append(labels | marks | lists | gone)
    return pd.DataFrame(rows)


def test_the_largest_error_of_each_is_found_with_what_others_found_there() -> None:
    found = worst_of(rows_of({"a": [0.1, -0.5, 0.2], "b": [0.3, 0.1]}, {}), ["a", "b"])
    assert [(one.recipe, one.mark, one.error_px) for one in found] == [("a", 1, 0.5), ("b", 0, 0.3)]
    assert found[0].found["b"].tolist() == [0.1, 0.0] and found[1].found["a"].tolist() == [0.1, 0.0]


def test_a_missed_target_is_one_that_others_found_and_is_shown_once() -> None:
    rows = rows_of({"a": [0.1, 0.2, 0.3], "b": [0.1], "c": [0.1]}, {"b": [2], "c": [2]})
    found = [one for one in worst_of(rows, ["a", "b", "c"]) if np.isnan(one.error_px)]
    assert [(one.mark, list(one.found)) for one in found] == [(2, ["a"])]


def test_a_recipe_that_failed_has_no_worst_case() -> None:
    rows = pd.concat(
        [rows_of({"a": [0.1]}, {}), pd.DataFrame([{"scene": "s", "factor": "", "level": -1, "draw": 1, "recipe": "b"}])]
    )
    assert [one.recipe for one in worst_of(rows.reset_index(drop=True), ["a", "b"])] == ["a"]


def test_a_crop_ends_with_the_image() -> None:
    pixels = np.arange(20 * 30).reshape(20, 30)
    piece, corner = cut(pixels, np.array([2.0, 18.0]), 5.0)
    assert corner.tolist() == [0, 13] and piece.shape == (7, 8)
    assert piece[18 - 13, 2] == pixels[18, 2]


def test_crops_are_of_the_frames_that_the_recipes_met(
    tiny: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worst, "run_of", lambda case, folder: tiny)
    labels = {"scene": "tiny", "factor": "", "level": -1, "draw": 2}
    cases = [
        Case(labels | {"recipe": name}, options={"until": "detect"}, noise_seed=2, recipe=Recipe(name, Algorithm(name)))
        for name in NAMES
    ]
    rows = pd.DataFrame([case.labels | compared_row(case, tiny)[0] for case in cases])
    crops = crops_of(rows, NAMES, cases, tmp_path)
    assert [crop.worst.recipe for crop in crops] == NAMES
    for crop in crops:
        assert set(crop.worst.found) == set(NAMES) and "tiny, draw 2, station" in crop.where
        x, y = crop.xy_px.round().astype(int)
        assert crop.pixels_dn[y, x] > 5 * crop.pixels_dn.min()  # a white dot on black ground
        # Another draw of noise shows other pixels.
        other = worst.exposed(Case(labels, noise_seed=3), tiny, crop.worst.station)
        again = worst.exposed(cases[0], tiny, crop.worst.station)
        assert other is not None and again is not None and (other.pixels_dn != again.pixels_dn).mean() > 0.5
    drawn = crop_drawings(crops, {"forward_model": "#1f77b4", "grey_centroid": "#ff7f0e"})
    assert "grey_centroid" in drawn[1].title and "times enlarged" in drawn[1].title and b"#ff7f0e" in drawn[1].svg


def test_errors_are_drawn_as_long_as_can_be_seen_within_the_crop() -> None:
    for error in (0.003, 0.04, 0.9, 7.0):
        one = Worst("a", 0, 0, 0, error, {"a": np.array([error, 0.0])})
        drawn = error * enlargement(Crop(one, np.zeros((40, 40)), np.array([20.0, 20.0]), ""))
        assert 4 <= drawn <= 20
