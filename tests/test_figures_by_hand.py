"""What `measure`, `uncertainty` and `bench` count and print, and the tables of studies, against arithmetic by hand."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from hand_made import HandMade, Page

from testfield.bench.claim_figures import Errors, summary
from testfield.bench.clutter import ClutteredView
from testfield.bench.recall import Recall, count
from testfield.bench.scatter import figures as scatter
from testfield.calibrate.certified import Certified
from testfield.cli.uncertainty import _show
from testfield.detect.centre import Centres
from testfield.detect.observations import MEASURED
from testfield.detect.targets import Targets
from testfield.measure.certified import lengths_of
from testfield.measure.photographs import Measurement
from testfield.report.measured import write_measurement
from testfield.score.align import aligned_covariance, rigid_basis
from testfield.study.page import as_html
from testfield.study.study import Table
from testfield.targets.field_file import FieldFile
from testfield.uncertainty.monte_carlo import MonteCarlo, adaptive, validate
from testfield.uncertainty.statement import of_trials, quantities

UM = 1e-3


# ------------------------------------------------------------------ measure
@pytest.fixture(scope="module")
def measured(by_hand: HandMade, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder of a measurement of the hand-made field, of which one point has no code, and its summary."""
    folder = tmp_path_factory.mktemp("measured")
    points = replace(by_hand.points, code=np.where(by_hand.points.code == 37, -1, by_hand.points.code))
    lengths, notes = lengths_of(Certified(by_hand.world.field.scale_bars, {}, {}), points, set(), "distances")
    assert len(notes) == 1 and "check three" in notes[0]
    o = by_hand.observations
    o = replace(o, point=np.where(o.status == MEASURED, 0, -1))
    result = Measurement(o, by_hand.calibration, points, lengths, "by hand")
    for name in o.stations:
        cv2.imwrite(str(folder / f"{name}.png"), np.full((800, 1000), 90, np.uint8))
    field = FieldFile.model_validate({"target": {"kind": "ring14"}})
    return folder, write_measurement(result, field, folder, ("left.jpg", "right.jpg"))


def test_a_measurement_compares_lengths_as_the_hand_does(measured: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = measured
    assert [row["name"] for row in summary["lengths"]] == ["control bar", "check one", "check two"]
    for row, en in zip(summary["lengths"], (None, 1.2, -1.5), strict=True):
        assert row["u_measured_mm"] == pytest.approx(0.004, abs=1e-9)
        assert row["en"] == (None if en is None else pytest.approx(en, abs=1e-6))
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    assert page.table("distance", "role") == [
        ["control bar", "control", "31 – 32", "900.0000", "0.0060", "900.0040", "0.0040", "+0.0040", "–"],
        ["check one", "check", "33 – 34", "700.0000", "0.0030", "700.0120", "0.0040", "+0.0120", "1.2 failed"],
        ["check two", "check", "35 – 36", "500.0000", "0.0030", "499.9850", "0.0040", "-0.0150", "-1.5 failed"],
    ]


def test_a_measurement_counts_and_sums_as_the_hand_does(measured: tuple[Path, dict[str, Any]]) -> None:
    folder, summary = measured
    # six check points of 9, 9 and 16 um^2, seven others of 8 um^2 each: 204 + 168 over 39 coordinates
    u_mm = (372 / 39) ** 0.5 * UM
    across = (2000.002**2 + 1299.994**2 + 6500.023**2) ** 0.5
    expected = [
        "2 of 2",
        "17; 321",
        "0.1230 px",
        "1.05",
        "1001.00 px",
        "12; 1",
        f"{u_mm:.4f} mm",
        f"1 : {across / u_mm:,.0f}",
        "-0.0150 mm (u 0.005 mm), FAILED: E_n -1.50",
        "nothing failed",
    ]
    assert [value for _, value in summary["figures"]] == expected
    assert (summary["points"], summary["uncoded"], summary["sigma0"]) == (13, 1, 1.05)
    assert summary["interior_u"] == pytest.approx({"cx": 0.1, "fx": 1.0, "fy": 1.0})
    assert json.loads((folder / "measurement.json").read_text())["points"] == 13
    page = Page((folder / "report.html").read_text(encoding="utf-8"))
    assert [value for value, _ in page.tiles] == expected
    rows = {row[0]: row[1:] for row in page.table("point", "x, mm")}
    assert len(rows) == 13
    assert rows["code 21"] == ["1000.011", "0.020", "-0.020", "3.0", "3.0", "4.0", "2", "0.0000"]
    assert rows["code 32"][:6] == ["900.004", "0.000", "2000.000", "2.8", "2.8", "2.8"]
    assert sorted(page.table("all blobs that were looked at")) == [
        ["measured", "17"],
        ["partly hidden or disturbed", "1"],
        ["saturated", "1"],
    ]
    table = page.table("photograph", "x, mm")  # and what it saw, used and lost, which other tests ask
    places = [[v if v != "-0.00" else "0.00" for v in row[:5]] for row in table]
    assert places == [["left", "0.00", "0.00", "-5000.00", "13"], ["right", "-500.00", "0.00", "-5000.00", "4"]]
    assert ["fx", "1001.000", "1"] in page.table("parameter", "found", "u")
    assert ["cy", "399.500", "held"] in page.table("parameter", "found", "u")
    table = {row["point"]: row for row in csv.DictReader((folder / "points.csv").open(encoding="utf-8"))}
    assert (
        table["code 21"]["x_mm"] == "1000.01100"
        and table["code 21"]["u_z_mm"] == "0.00400"
        and table["code 21"]["rays"] == "2"
    )


# ------------------------------------------------------------------ uncertainty
def test_the_figures_of_few_trials_are_those_of_the_arithmetic_by_hand(
    by_hand: HandMade, capsys: pytest.CaptureFixture
) -> None:
    """Four trials: x of target 21 off by -3, -1, 1 and 3 um, and with it nothing else; a fifth lacks a point."""
    points = by_hand.points
    row = int(points.rows([21])[0])
    trials = np.tile(points.xyz_mm, (5, 1, 1))
    trials[:4, row, 0] += np.array([-3, -1, 1, 3]) * UM
    trials[4, 3] = np.nan
    linear = quantities(points, by_hand.world.field, [(21, 22)])
    answer = of_trials(points, linear, by_hand.world.field, trials, 1)
    assert (answer["trials"], answer["incomplete"], answer["gaussian_interval"]) == (4, 1, True)
    assert not answer["settled"] and answer["probability"] == 0.95
    x = next(q for q in answer["quantities"] if q["name"] == "21.x")
    length = next(q for q in answer["quantities"] if q["name"] == "21 to 22")
    u = (20 / 3) ** 0.5
    assert x["linear"] == pytest.approx({"value_mm": 1000.011, "u_mm": 0.003})
    found = x["monte_carlo"]
    for key, um in (("low_mm", -1.959964 * u), ("high_mm", 1.959964 * u), ("value_mm", 0.0)):
        assert found[key] - 1000.011 == pytest.approx(um * UM, abs=1e-8), key
    assert found["u_mm"] == pytest.approx(u * UM, rel=1e-6)
    # Means of four, and standard deviations, of a quantity with u = 3 um, which is more than the trials' own.
    of_end = (1.5**2 + (1.959964 * 3 / 6**0.5) ** 2) ** 0.5
    assert found["s_mm"] == pytest.approx([1.5 * UM, 3 / 6**0.5 * UM, of_end * UM, of_end * UM], rel=1e-6)
    for key in ("d_low_mm", "d_high_mm"):
        assert x[key] == pytest.approx(1.959964 * (3 - u) * UM, rel=1e-5)
    assert x["delta_mm"] == pytest.approx(0.0005) and x["validated"] == "open"
    assert x["check_point"] and not length["check_point"] and length["kind"] == "length"
    # What is common cancels: two ends of 4 um^2 along their line.
    assert length["linear"]["u_mm"] == pytest.approx(8**0.5 * UM, rel=1e-5)
    assert sum(q["check_point"] for q in answer["quantities"]) == 3 * 6  # ends of bars are none
    _show({"run": "by hand", "depth": "exposure", "digits": 1} | answer)
    text = capsys.readouterr().out
    line = next(line for line in text.splitlines() if line.split()[:1] == ["21"] and "to 22" in line)
    assert "u 0.00283  Monte Carlo u 0.00258" in line and "d_low 0.00048  d_high 0.00048  delta 0.00050" in line
    # Only one of 18 coordinates scatters in these trials, so the ratios' median is 0.
    assert "coordinates of check points: 18" in text and "0.000 to 0.861, median 0.000" in text


def test_intervals_of_many_trials_cut_off_as_much_below_as_above() -> None:
    """1 to 100 and 101 to 200: of 200 trials 190 are covered, from the sixth to the 196th."""
    found = adaptive(lambda k: (np.arange(1.0, 101) + 100 * k)[::-1, None], np.array([0.0]), 200)
    assert (found.trials, found.blocks) == (200, 2)
    assert [float(v[0]) for v in (found.value, found.low, found.high)] == [100.5, 6.0, 196.0]
    assert found.u[0] == pytest.approx((200 * 201 / 12) ** 0.5)
    # Both blocks have mean, low and high 100 apart: standard deviation of the mean of two is 50.
    assert found.s[:, 0] == pytest.approx([50, 0, 50, 50], abs=1e-9)


@pytest.mark.parametrize(
    ("low_um", "high_um", "verdict"),
    [(-1.9, 1.9, "yes"), (-1.5, 1.959964, "yes"), (-1.4, 1.9, "no"), (-1.96, 2.6, "no"), (-1.96, 1.4, "no")],
)
def test_both_ends_of_the_interval_must_agree(low_um: float, high_um: float, verdict: str) -> None:
    """u = 1 um: the linear interval ends at 1.96 um, and half a unit of its digit is 0.5 um."""
    one = np.array([UM])
    trials = MonteCarlo(0 * one, one, low_um * one, high_um * one, np.zeros((4, 1)), 10**6, 100, 0.95, False)
    judged = validate(0 * one, one, trials)
    assert judged.verdict[0] == verdict
    assert judged.d_low[0] == pytest.approx(abs(-1.959964 - low_um) * UM, abs=1e-9)
    assert judged.d_high[0] == pytest.approx(abs(1.959964 - high_um) * UM, abs=1e-9)
    assert judged.delta[0] == pytest.approx(0.5 * UM)


# ------------------------------------------------------------------ bench
def test_scatter_bias_and_honesty_of_an_estimator_by_hand() -> None:
    """Five dots, four runs: x is off by 3 and scatters by plus and minus 2, in 0.01 px; y is right. One is lost."""
    n, b, s, bound, claimed = 6, 0.03, 0.02, 0.01, 0.04
    runs = []
    for k in range(4):
        xy = np.tile([b + (s if k % 2 else -s), 0.0], (n, 1))
        ok = np.arange(n) < 5  # the sixth is never measured
        cov = np.tile(claimed**2 * np.eye(2), (n, 1, 1))
        runs.append(Centres(xy, cov, cov, np.ones(n), np.ones(n), np.ones(n), np.ones(n), ok))
    found = scatter(runs, np.zeros((n, 2)), np.tile(bound**2 * np.eye(2), (n, 1, 1)))
    assert (found["measured"], found["not_measured"], found["exposures"]) == (20, 4, 4)
    sigma = (4 / 3 * s**2 / 2) ** 0.5  # four runs have three degrees of freedom, and y has no scatter
    assert found["sigma_px"] == pytest.approx(sigma)
    assert found["efficiency"] == pytest.approx(2 / (4 / 3 * s**2 / bound**2))
    assert found["rms_px"] == pytest.approx(((b**2 + s**2) / 2) ** 0.5)
    assert found["bias_seen"] == pytest.approx(b / sigma)
    # All dots of a run err alike, so chance is that of four means: their variance, 4/3 s^2 and 0, over four.
    assert found["bias"] == pytest.approx((b**2 / 2 - 4 / 3 * s**2 / 2 / 4) ** 0.5 * 2**0.5 / sigma)
    assert found["bias_by_dot_seen"] == pytest.approx((b**2 / 2) ** 0.5 / sigma)
    assert found["chi2"] == pytest.approx((b**2 + s**2) / claimed**2 / 2)
    # Of two runs 0.03125, of two 0.78125; Student's t of 3 degrees is 3.182446.
    assert found["chi2_band"] == pytest.approx([0.40625 + sign * 3.182446 * 0.75 / 12**0.5 for sign in (-1, 1)])
    assert found["sigma_band_px"] == pytest.approx([sigma, sigma])  # every run scatters alike
    assert found["efficiency_band"] == pytest.approx([found["efficiency"]] * 2)


def test_bands_of_an_estimator_hold_though_all_dots_of_an_exposure_err_alike() -> None:
    rng, n, held = np.random.default_rng(12), 6, 0
    cov = np.tile(0.01**2 * np.eye(2), (n, 1, 1))
    for _ in range(200):
        runs = []
        for _ in range(20):
            error = 0.01 * (np.sqrt(0.9) * rng.standard_normal(2) + np.sqrt(0.1) * rng.standard_normal((n, 2)))
            runs.append(Centres(error, cov, cov, *(np.ones(n) for _ in range(4)), np.ones(n, bool)))
        found = scatter(runs, np.zeros((n, 2)), cov)
        bands = [found[f"{name}_band"] for name in ("chi2", "efficiency")] + [100 * np.array(found["sigma_band_px"])]
        held += sum(low <= 1 <= high for low, high in bands)
    assert 0.9 < held / 600 < 0.98


def test_recall_counts_what_is_found_missed_misread_and_false() -> None:
    """Six targets of 20 px: found, misread, turned down, not seen, too tilted but found, hidden but found."""
    at = np.array([[100.0 * k, 50] for k in range(1, 7)])
    view = ClutteredView(
        None,
        None,
        at,
        np.array([1, 2, 3, 4, 5, 6]),
        np.full(6, 20.0),
        np.array([10.0, 30, 50, 50, 65, 10]),
        np.array([True] * 5 + [False]),
    )  # type: ignore[arg-type]
    look = (
        (at[0] + [6.9, 0], 1, MEASURED),
        (at[1], 7, MEASURED),
        (at[2], 3, "disturbed"),
        (at[4], 5, MEASURED),
        (at[5], 6, MEASURED),
        ((900, 300), 9, MEASURED),
        ((950, 300), 0, MEASURED),
        (at[0], 1, "twice"),
    )
    n, none = len(look), np.zeros((len(look), 2, 2))
    found = Targets(
        xy_px=np.array([xy for xy, *_ in look], float),
        cov_px2=none,
        moments_px2=none,
        chi2=np.ones(n),
        misfit=np.ones(n),
        code=np.array([code for _, code, _ in look]),
        affine=none,
        status=np.array([status for *_, status in look], object),
        background_dn=np.full(n, 500.0),
        contrast_dn=np.full(n, 2000.0),
    )
    recall = Recall()
    count(recall, view, found)
    assert (recall.views, recall.rendered, recall.clear, recall.found, recall.right) == (1, 6, 4, 2, 1)
    assert (recall.wrong, recall.false) == (2, 2)  # number 7 for 2, and 9 where nothing is
    assert recall.missed == {"disturbed": 1, "not seen at all": 1}
    assert recall.clear_by_tilt == {"0-20": 1, "20-40": 1, "40-60": 2, "60-70": 1}
    assert recall.found_by_tilt == {"0-20": 1, "20-40": 1, "40-60": 0, "60-70": 1}
    shown = recall.figures()
    assert (shown["found_percent"], shown["decoded_rightly_percent"]) == (50.0, 50.0)
    assert [row["met"] for row in shown["verdicts"]] == [False, False, False, False]
    good = Recall(1, 10, clear=1000, found=995, right=995, empty_views=3)
    assert [row["met"] for row in good.verdicts()] == [True, True, True, True]
    assert [row["measured"] for row in good.verdicts()] == [99.5, 100.0, 0, 0]
    assert not replace(good, found=994, right=994).verdicts()[0]["met"]
    assert not replace(good, right=993).verdicts()[1]["met"]


def test_claims_are_summed_over_trials_as_the_hand_does() -> None:
    """Two parts of two coordinates; u = 1 and 2: (2, 1) and (3, 0), then (0, 0) and (0, 2)."""
    cov = np.diag([1.0, 4, 1, 4])
    trials = [Errors(np.array(e), cov, 2) for e in ([2.0, 1, 3, 0], [0, 0, 0, 2.0])]
    found = summary(trials)
    assert found["nees_each"] == pytest.approx([(4 + 0.25 + 9 + 0) / 4, 1 / 4])
    assert found["nees"] == pytest.approx(14.25 / 8)
    assert (found["degrees_of_freedom"], found["regions"]) == (4, 4)
    assert found["coverage_95"] == 3 / 4  # 9 is more than 5.991, and 4.25, beyond 3.841 of one coordinate, is not
    assert found["nees_band_95"] == pytest.approx([2.180 / 8, 17.535 / 8], rel=1e-3)  # chi-squared of 8, from a table


# ------------------------------------------------------------------ studies
def test_a_studys_table_shows_its_rows_as_formatted_and_nothing_for_nothing() -> None:
    frame = pd.DataFrame({"method": ["a", "b"], "gain": [1.23456, np.nan], "share": [0.5, 0.25]})
    page = Page(as_html(Table("title", frame, formats={"share": "{:.1%}"})))
    assert page.tables == [[["method", "gain", "share"], ["a", "1.235", "50.0%"], ["b", "–", "25.0%"]]]


def test_a_motion_of_all_points_is_no_uncertainty_after_the_fit() -> None:
    xyz = np.array([[0, 0, 0], [2000, 0, 0], [0, 1000, 0], [300, 400, 1500], [-700, 200, 100.0]])
    own, motion = 4e-6 * np.eye(15), rigid_basis(xyz)
    after = aligned_covariance(own + 9e-4 * motion @ motion.T, xyz)
    # Of 15 coordinates six are fitted; the nine that are left have their own variance.
    assert np.sort(np.linalg.eigvalsh(after)) == pytest.approx([0] * 6 + [4e-6] * 9, abs=1e-12)
    assert after == pytest.approx(aligned_covariance(own, xyz), abs=1e-12)
