"""The study `wls`: its work on drawn observations, its findings on made-up tables, and rays that are not rejected."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import tomli_w

from testfield.bench.drawn import draw_observations
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.estimate import Method, settle
from testfield.reconstruct.midpoint import unweighted
from testfield.reconstruct.opponents import _opencv, by_opponent
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import sights_of
from testfield.report.study import drawn
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.study.wls import (
    EXPOSURES,
    KEPT_ERRORS,
    METHODS,
    camera_sets,
    cases,
    compared,
    exact_calibration,
    law,
    observations_of,
    scored,
)
from testfield.study.wls_cells import cells
from testfield.study.wls_field import FAR_MM, NEAR_MM, field_scene
from testfield.study.wls_page import read

NAMES = ["midpoint", "dlt", "dlt_p34", "parametric_wls", "gls", "ml", "bundle", "opencv"]


@pytest.fixture(scope="module")
def spread() -> tuple[SceneFile, World, Observations]:
    """The spread scene with six stations, its pixels drawn at the physical bound."""
    text = tomli_w.dumps(field_scene(True, 6))
    scene = parse_scene(text, "spread", Path())
    world = build_world(scene)
    return scene, world, draw_observations(scene, world, see(world), np.random.default_rng(1))


def test_ranges_are_equal_or_spread_five_times_and_all_stations_see_nearly_all() -> None:
    for wide in (False, True):
        world = build_world(parse_scene(tomli_w.dumps(field_scene(wide)), "field", Path()))
        ranges = np.linalg.norm(world.camera_from_world.origin_mm - [0, 0, 1500], axis=1)
        assert ranges.max() / ranges.min() == pytest.approx(FAR_MM / NEAR_MM if wide else 1)
        seen = see(world).visible[:, world.marks.board < 0] == 1
        assert seen.mean() > 0.98


def test_plan_has_a_thousand_points_in_every_cell() -> None:
    plan = cases(False)
    exposures = {case.labels["exposure"] for case in plan}
    assert len(exposures) == EXPOSURES and plan[0].options["numbers"] == [2, 3, 4, 6, 8, 12, 16]
    # Of the largest number of cameras there is one set only, and a few targets of an exposure may be lost.
    assert {len(case.scene["check_targets"]) for case in plan if case.scene} == {42}
    assert (42 - 3) * EXPOSURES >= 1000
    sets = camera_sets(16, [2, 12, 16])
    assert [(n, which) for n, which, _ in sets] == [(2, 0), (2, 1), (12, 0), (12, 1), (16, 0)]
    assert all(part.stop - part.start == n and part.stop <= 16 for n, _, part in sets)
    assert set(NAMES) <= set(METHODS)


def test_truth_in_truth_out_for_every_method(spread: tuple[SceneFile, World, Observations]) -> None:
    _, world, drawn_rows = spread
    exact = replace(drawn_rows, xy_px=_true_pixels(world, drawn_rows))
    rows = compared(exact, exact_calibration(world), world.field, world, 6, NAMES)
    assert [row["method"] for row in rows] == NAMES
    assert all(row["points"] > 35 for row in rows)
    # What is left is the discs' normals, which are measured from the moments.
    assert max(np.sqrt(row["square_mm2"] / row["points"]) for row in rows) < 2e-3


def test_noise_gives_what_the_covariances_claim(spread: tuple[SceneFile, World, Observations]) -> None:
    _, world, observations = spread
    seen = observations_of(observations, world.station_name[:4])
    assert seen.stations == world.station_name[:4] and seen.station.max() == 3
    rows = compared(seen, exact_calibration(world), world.field, world, 4, NAMES)
    for row in rows:
        assert row["nees"] == pytest.approx(1, abs=0.45), row
    by = {row["method"]: row for row in rows}
    assert by["parametric_wls"]["claimed_mm2"] < 0.6 * by["midpoint"]["claimed_mm2"]
    # Under an exact calibration all claims are the same claim.
    for name in ("ml", "parametric_wls"):
        assert by[name]["nees_narrow"] == pytest.approx(by[name]["nees_points"], rel=1e-6)
        assert by[name]["nees_narrow"] == pytest.approx(by[name]["nees_points_frame"], rel=1e-6)
        assert by[name]["narrow_mm2"] == pytest.approx(by[name]["claimed_frame_mm2"], rel=1e-6)
    assert 1 < by["gls"]["law_ranges"] < by["gls"]["law_noise"]
    assert 1 < by["gls"]["law_cameras"] < 4
    for name, row in by.items():
        assert ("error_mm" in row) == (name in KEPT_ERRORS)
    assert float((by["gls"]["error_mm"].astype(float) ** 2).sum()) == pytest.approx(by["gls"]["square_mm2"], rel=1e-5)
    assert len(by["gls"]["codes"]) == by["gls"]["points"] == len(by["gls"]["error_mm"]) / 3


def test_narrower_claims_are_compared_with_the_sandwich_in_the_same_frame(
    spread: tuple[SceneFile, World, Observations],
) -> None:
    """With all cameras in one error together (a shift of the datum), what single rays claim of it is too little, and
    nothing of it is left after a fit: only in the frame are claims and errors alike."""
    _, world, observations = spread
    calibration = exact_calibration(world)
    shift = np.array([0.3, -0.2, 0.1])
    R = calibration.stations.R
    turns = np.zeros((len(calibration.labels), 3))  # by a shift of the world all stations' t move by R
    rows = calibration.station_unknowns
    for k in range(len(R)):
        turns[calibration.index(rows(k))[3:]] = R[k]
    wrong = replace(
        calibration, method="shifted", covariance=0.09 * turns @ turns.T,
        stations=replace(calibration.stations, t_mm=calibration.stations.t_mm + R @ shift),
    )  # fmt: skip
    by = {row["method"]: row for row in compared(observations, wrong, world.field, world, 6, ["parametric_wls", "ml"])}
    for row in by.values():
        assert row["frame_mm2"] == pytest.approx(row["points"] * shift @ shift, rel=0.02)
        assert row["narrow_mm2"] < row["claimed_frame_mm2"]
        assert row["nees_narrow"] > row["nees_points_frame"]
        assert row["nees_points_frame"] == pytest.approx(shift @ shift / 0.27, rel=0.05)
        assert row["claimed_mm2"] < 1e-2 * row["claimed_frame_mm2"]
        assert row["nees_points"] == pytest.approx(1, abs=0.45)


def test_points_that_are_not_finite_are_not_measured_and_a_method_that_fails_fails_alone(
    spread: tuple[SceneFile, World, Observations], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, world, observations = spread
    calibration = exact_calibration(world)
    points = METHODS["midpoint"](observations, calibration, world.field)
    lost = points.xyz_mm[points.rows([70])[0]]

    def but_for_one(plane: np.ndarray, cameras: np.ndarray) -> np.ndarray:
        place = _opencv(plane, cameras)
        return np.full(3, np.nan) if np.linalg.norm(place - lost) < 10 else place

    def never(plane: np.ndarray, cameras: np.ndarray) -> np.ndarray:
        return np.full(3, np.nan)

    def fails(*_: Any) -> Points:
        raise TestfieldError("no points", "here", "look")

    monkeypatch.setitem(METHODS, "colmap", lambda o, c, f: by_opponent(o, c, f, "colmap", but_for_one))
    monkeypatch.setitem(METHODS, "opencv", fails)
    names = ["midpoint", "colmap", "opencv", "gls", "parametric_wls"]
    rows = compared(observations, calibration, world.field, world, 6, names)
    assert [row["method"] for row in rows] == names
    failed = rows.pop(2)
    assert failed["points"] == 0 and "no points" in failed["why"]
    assert {row["points"] for row in rows} == {41}
    assert 70 not in rows[-1]["codes"]
    assert all(np.isfinite(row["nees"]) and row["nees"] < 3 for row in rows)
    monkeypatch.setitem(METHODS, "colmap", lambda o, c, f: by_opponent(o, c, f, "colmap", never))
    rows = compared(observations, calibration, world.field, world, 6, names)
    assert [row["points"] > 0 for row in rows] == [True, False, False, True, True]


def test_the_law_counts_the_cameras_that_its_weights_make() -> None:
    there = np.ones((2, 4), bool)
    assert law(np.full((2, 4), 3.0), there) == pytest.approx((1, 4))
    gain, cameras = law(np.array([[1.0, 1e3, 1e3, 1e3]]), there[:1])
    assert cameras == pytest.approx(1, abs=1e-4) and gain > 100
    assert law(np.array([[2.0, 2.0, 99.0, 99.0]]), np.array([[True, True, False, False]])) == pytest.approx((1, 2))


def test_a_wrong_truth_turns_it_red(spread: tuple[SceneFile, World, Observations]) -> None:
    _, world, observations = spread
    calibration = exact_calibration(world)
    points = METHODS["gls"](observations, calibration, world.field)
    rows = points.rows([int(code) for code in points.code[points.rays == 6]])
    codes, true = [int(code) for code in points.code[rows]], points.xyz_mm[rows]
    assert scored(points, codes, true, False, None)["nees"] < 1e-12
    assert scored(points, codes, true + [0.1, 0, 0], False, None)["nees"] > 5
    assert scored(points, codes, true + [0.1, 0, 0], True, None)["nees"] < 1e-6  # a shift is fitted


def test_the_midpoint_keeps_good_rays_however_the_ranges_differ(
    spread: tuple[SceneFile, World, Observations],
) -> None:
    _, world, observations = spread
    calibration = exact_calibration(world)
    sights = sights_of(observations_of(observations, world.station_name[:2]), calibration, world.field)
    kept = settle(sights, calibration, Method("midpoint", unweighted))
    assert len(kept.sights) == len(sights) and kept.rejected.sum() == 0
    size = np.linalg.norm(kept.rays.residual_px, axis=-1) / np.sqrt(np.trace(sights.cov_px2, axis1=-2, axis2=-1) / 2)
    assert size.max() > 6  # the near rays miss by far more than their own noise: the far ones drag the point
    wrong = sights.xy_px.copy()
    wrong[0, 0, 1] += 2.0
    broken = settle(replace(sights, xy_px=wrong), calibration, Method("midpoint", unweighted))
    assert len(broken.sights) == len(sights) - 1  # of two rays that disagree neither is believed


def _true_pixels(world: World, rows: Observations) -> np.ndarray:
    marks = {
        (int(b), int(c), int(p)): k
        for k, (b, c, p) in enumerate(zip(world.marks.board, world.marks.code, world.marks.point, strict=True))
    }
    mark = [marks[int(b), int(c), int(p)] for b, c, p in zip(rows.board, rows.code, rows.point, strict=True)]
    return see(world).disc_px[rows.station, mark]


def _table(gain: dict[tuple[str, str], float], narrow: float = 3.0, exposures: int = 12) -> pd.DataFrame:
    """Rows in which parametric_wls gains what is asked for, by (calibration, few or many cameras), at spread ranges."""
    rng = np.random.default_rng(0)
    rows: list[dict[str, Any]] = []
    for ranges in ("equal", "spread"):
        for exposure in range(exposures):
            for n in (2, 16):
                for kind in ("exact", "estimated"):
                    noise = rng.chisquare(120) / 120
                    for method in NAMES:
                        factor = gain[kind, "few" if n == 2 else "many"] if ranges == "spread" else 1.0
                        factor = factor if method == "parametric_wls" else 1.0
                        square = noise * 40 * 3e-4 / factor**2 * (1 + 0.01 * rng.standard_normal())
                        rows.append({
                            "ranges": ranges, "noise": "low", "exposure": exposure, "cameras": n, "set": 0,
                            "calibration": kind, "method": method, "points": 40, "square_mm2": square,
                            "claimed_mm2": 40 * 3e-4 / factor**2, "frame_mm2": 2 * square, "nees": noise,
                            "nees_points": noise, "hits": 38, "rejected": 0, "law_ranges": 1.4, "law_noise": 1.8,
                            "nees_narrow": narrow if method in ("ml", "parametric_wls") else np.nan,
                            "square_normal_mm2": square / 3, "claimed_normal_mm2": 40e-4 / factor**2,
                        })  # fmt: skip
    return pd.DataFrame(rows)


GOOD = {("exact", "few"): 1.3, ("exact", "many"): 1.5, ("estimated", "few"): 1.2, ("estimated", "many"): 1.2}


def test_cells_carry_the_gain_and_an_interval_that_holds_it() -> None:
    found = cells(_table(GOOD))
    row = found[(found["method"] == "parametric_wls") & (found["ranges"] == "spread") & (found["cameras"] == 16)]
    exact = row[row["calibration"] == "exact"].iloc[0]
    assert exact["gain"] == pytest.approx(1.5, rel=0.01) and exact["gain_low"] < exact["gain"] < exact["gain_high"]
    assert exact["gain_predicted"] == pytest.approx(1.5) and exact["points"] == 480
    assert exact["rmse_mm"] == pytest.approx(0.01 / 1.5, rel=0.1)
    assert exact["rmse_mm_low"] < exact["rmse_mm"] < exact["rmse_mm_high"]


def test_findings_say_that_the_claim_holds_and_draw_every_plot() -> None:
    findings = read(_table(GOOD))
    assert findings.figures["verdict"] == "holds" and findings.verdict.startswith("The claim holds:")
    assert findings.figures["nees_claiming_blocks"] == [3.0, 3.0]
    assert all(drawn(plot).startswith(b"<?xml") for plot in findings.plots)
    assert any("With two cameras" in sentence for sentence in findings.sentences)


def test_findings_turn_red_where_the_table_says_otherwise() -> None:
    partly = read(_table(GOOD | {("estimated", "few"): 0.8, ("estimated", "many"): 1.0}))
    assert partly.figures["verdict"] == "holds in part"
    assert "it is worse with few cameras and no different with many" in partly.verdict
    assert read(_table(dict.fromkeys(GOOD, 0.7))).figures["verdict"] == "fails"
    assert read(_table(GOOD | {("exact", "many"): 0.8})).figures["verdict"] == "holds in part"
