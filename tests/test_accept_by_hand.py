"""Every figure of `testfield accept` against arithmetic by hand, on the points and bars of `hand_made.py`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_made import HandMade, Page, flat
from scipy.special import ndtr
from scipy.stats import kstwo

from testfield.cli.accept import _show
from testfield.report.accept import accept_page
from testfield.scene.load import load_scene
from testfield.scene.schema import SceneFile
from testfield.scene.target_parts import CheckGrid
from testfield.scene.world import World
from testfield.score.acceptance import acceptance, planes, points_card, spacing
from testfield.score.length_test import Limit, MeasuredLengths, figures, judge
from testfield.targets.field import MeasuringLine

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
TEXT = object()
LIMIT = Limit(0.003, 2, 0.006)

UM = 1e-3
"""Lengths below: three lines of 2000, 1200 and 1000 mm, too long by 2, 4 and 6 um, and check bars of 700 and 500 mm,
too long by 12 um and too short by 15 um against their certificates. The targets of a line scatter by 2 um each, so that
its length has the variance 8 um^2; those of a bar 16 um^2; certificates add 9 um^2."""
L = (2000.0, 1200.0, 1000.0, 700.0, 500.0)
DL_UM = (2, 4, 6, 12, -15)
U_UM = (17**0.5, 17**0.5, 17**0.5, 5, 5)
EN = [dl / 2 / u for dl, u in zip(DL_UM, U_UM, strict=True)]
MEASURED = (2000.002, 1200.004, 1000.006, 700.012, 499.985)
E = (0.006, 0.0054, 0.005, 0.0044, 0.004)
NAMES, CODES = ("x", "y", "z", "check one", "check two"), ((22, 21), (24, 23), (26, 25), (33, 34), (35, 36))
# dl over L: the mean length is 1080 mm; sum of squares about it 1,348,000 mm^2, of products 5980 um mm
SLOPE_PPM = 5980 / 1348
U_SLOPE = ((17 * 867_200 + 25 * 480_800) / 1_348_000**2) ** 0.5 * 1000
SCATTER = ((408.8 - 5980**2 / 1_348_000) / 3 / 1_348_000) ** 0.5 * 1000
RMSE_MM = (28 / 18) ** 0.5 * UM


def ks(z: list[float]) -> float:
    """Kolmogorov's distance of values from the normal law."""
    F, k = ndtr(np.sort(z)), np.arange(len(z))
    return float(max((F - k / len(z)).max(), ((k + 1) / len(z) - F).max()))


ROWS = {
    f"rows.{k}.{key}": value
    for k in range(5)
    for key, value in {
        "line": NAMES[k],
        "codes.0": CODES[k][0],
        "codes.1": CODES[k][1],
        "calibrated_mm": L[k],
        "u_calibrated_mm": 0.003,
        "measured_mm": MEASURED[k],
        "u_measured_mm": (8**0.5 if k < 3 else 4) * UM,
        "dl_mm": DL_UM[k] * UM,
        "en": EN[k],
        "limit_mm": E[k],
        "within": k < 2,
    }.items()
}
BY_HAND: dict[str, object] = ROWS | {
    "scene": "by hand",
    "lengths.lengths": 5,
    "lengths.shortest_mm": 500.0,
    "lengths.longest_mm": 2000.0,
    "lengths.max_abs_dl_mm": 0.015,
    "lengths.mean_dl_mm": 9 / 5 * UM,
    "lengths.rms_dl_mm": (425 / 5) ** 0.5 * UM,
    "lengths.rms_u_dl_mm": (101 / 5) ** 0.5 * UM,
    "lengths.mean_relative_ppm": (1 + 10 / 3 + 6 + 120 / 7 - 30) / 5,
    "lengths.slope.slope_ppm": SLOPE_PPM,
    "lengths.slope.u_slope_ppm": U_SLOPE,
    "lengths.slope.offset_mm": (1.8 - 1.08 * SLOPE_PPM) * UM,
    "lengths.slope.ci_low_ppm": SLOPE_PPM - 1.95996398454 * U_SLOPE,
    "lengths.slope.ci_high_ppm": SLOPE_PPM + 1.95996398454 * U_SLOPE,
    "lengths.slope.scatter_low_ppm": SLOPE_PPM - 3.18244630528 * SCATTER,  # Student's t of 3 degrees, from a table
    "lengths.slope.scatter_high_ppm": SLOPE_PPM + 3.18244630528 * SCATTER,
    "lengths.envelope.a_mm": 0.015,
    "lengths.envelope.k_ppm": 0.0,
    "lengths.envelope.a_without_k_mm": 0.015,
    "lengths.envelope.k_without_a_ppm": 30.0,
    "lengths.rule": TEXT,
    "lengths.missing.0.line": "check three",
    "lengths.missing.0.codes.0": 37,
    "lengths.missing.0.codes.1": 38,
    "verdict.a_mm": 0.003,
    "verdict.k_ppm": 2,
    "verdict.b_mm": 0.006,
    "verdict.verdict": "failed",
    "verdict.outside": 3,
    "verdict.of": 5,
    "verdict.missing": 1,
    "verdict.worst_codes.0": 35,
    "verdict.worst_codes.1": 36,
    "verdict.worst_dl_mm": -0.015,
    "verdict.worst_limit_mm": 0.004,
    "verdict.with_test_uncertainty": "refuted",
    "verdict.arrangement_met": False,
    **{
        f"arrangement.{k}.{key}": value
        for k, (found, met) in enumerate(
            [
                ("3", False),
                ("1", False),
                ("1000 mm or more", True),
                ("2000 mm", True),
                ("1200 x 2000 x 1000 mm", True),
                ("0", False),
            ]
        )
        for key, value in {"what": TEXT, "asked": TEXT, "found": found, "met": met}.items()
    },
    "adjustment.scale_bars.0": "control bar",
    "adjustment.note": TEXT,
    "spacing.rule": TEXT,
    "spacing.spacings": 5,
    "spacing.max_abs_mm": 0.015,
    "spacing.worst_codes.0": 35,
    "spacing.worst_codes.1": 36,
    "spacing.rms_mm": (425 / 5) ** 0.5 * UM,
    "spacing.rms_u_mm": (101 / 5) ** 0.5 * UM,
    "flatness.0.plane": TEXT,
    "flatness.0.targets": 4,
    "flatness.0.measured_mm": 0.0,
    "flatness.0.true_mm": 0.0,
    "flatness.0.error_mm": 0.0,
    "points.check_points": 6,
    "points.expected": 7,
    "points.fitted_parameters": 6,
    "points.rmse_mm": RMSE_MM,
    "points.sigma_mm": (4 * 12 / 18) ** 0.5 * UM,
    "points.external_over_internal": (28 / 48) ** 0.5,
    "points.largest_distance_mm": 2000.0,
    "points.diagonal_mm": 5000.0,
    "points.relative_accuracy_sigma": 2000 / (4 * 12 / 18) ** 0.5 / UM,
    "points.relative_accuracy_rmse": 2000 / RMSE_MM,
    "points.relative_accuracy_sigma_diagonal": 5000 / (4 * 12 / 18) ** 0.5 / UM,
    "points.relative_accuracy_rmse_diagonal": 5000 / RMSE_MM,
    "points.anees": (500 / (4 / 6 + 5) + 400 / (4 / 6 + 12) + 28 / 4) / 18,
    "points.after_fit": False,
    "points.anees_band_95.0": 8.231 / 18,
    "points.anees_band_95.1": 31.526 / 18,
    "points.coverage_95": 0.0,  # all are off by 30 um with u = 3 and 4 um
    "points.coverage_band_99.0": TEXT,
    "points.coverage_band_99.1": 1.0,  # of correlated ones: not by hand
    "points.en_worst": 22 / 6,
    "points.en_within_1": 0.0,
    "points.pit.values": 18,
    "points.pit.distance": TEXT,
    "points.pit.p": TEXT,  # of correlated ones: not by hand
    # x: 11, 9 and four of 10; y: 22, 18 and 20, over 3 um; z: -17, -23 and -20 over 4 um
    "points.pit.distance_of_coordinates": ks(
        [v / 3 for v in (11, 9, *[10] * 4, 22, 18, *[20] * 4)] + [v / 4 for v in (-17, -23, *[-20] * 4)]
    ),
    "points.of_lengths.en_worst": -1.5,
    "points.of_lengths.en_within_1": 3 / 5,
    "points.of_lengths.covered_95": 3 / 5,
    "points.of_lengths.zeta_worst": -3.0,
    "points.of_lengths.zeta_within_2": 3 / 5,
    "points.of_lengths.zeta_pit_distance": ks([2 * en for en in EN]),
    "points.of_lengths.lengths": 5,
}


@pytest.fixture(scope="module")
def scene() -> SceneFile:
    """A scene of the hand-made field's volume, whose check targets 21 to 24 are a grid one target deep."""
    quick = load_scene(QUICK)
    grid = next(part for part in quick.check_targets if isinstance(part, CheckGrid))
    flat_grid = grid.model_copy(update={"first_code": 21, "counts": (2, 2, 1)})
    volume = quick.volume.model_copy(update={"size_mm": (1200.0, 2000.0, 1000.0)})
    return quick.model_copy(update={"check_targets": (flat_grid,), "volume": volume})


def with_lines(world: World, *lines: MeasuringLine) -> World:
    return replace(world, field=replace(world.field, measuring_lines=lines))


@pytest.fixture(scope="module")
def lined(by_hand: HandMade) -> World:
    lines = [MeasuringLine(NAMES[k], CODES[k], (L[k],), 0.003) for k in range(3)]
    return with_lines(by_hand.world, *lines)


def wrong(found: dict, expected: dict) -> dict:
    """Leaves that are not as expected."""
    assert found.keys() == expected.keys()
    answer = {}
    for key, value in expected.items():
        if value is TEXT:
            good = found[key] not in (None, "")
        elif isinstance(value, float):
            good = found[key] == pytest.approx(value, rel=1e-4 if "band" in key else 1e-8, abs=1e-11)
        else:
            good = found[key] == value and type(found[key]) is type(value)
        if not good:
            answer[key] = (found[key], value)
    return answer


def test_every_figure_of_the_acceptance_is_that_of_the_arithmetic_by_hand(
    by_hand: HandMade, scene: SceneFile, lined: World
) -> None:
    card, _ = acceptance(scene, lined, by_hand.calibration, by_hand.points, LIMIT)
    assert not wrong(flat(card), BY_HAND)


def test_claims_of_points_are_judged_point_by_point_and_coordinate_by_coordinate(by_hand: HandMade) -> None:
    """Every coordinate has u = 3 um and no correlation; all points are 5.5 um low, and outwards by 1, 2 and 3 um."""
    low = by_hand.points.xyz_mm - np.where(by_hand.points.code[:, None] < 30, [0.010, 0.020, -0.0145], 0)
    points = replace(by_hand.points, xyz_mm=low, cov_xyz_mm2=9e-6 * np.eye(39))
    one = MeasuredLengths(("x",), np.array([[22, 21]]), np.ones(1), np.zeros(1), np.ones(1), np.ones((1, 1)))
    card = points_card(by_hand.world, by_hand.calibration, points, one)
    assert card is not None
    z = [v / 3 for v in (1, -1, 2, -2, *[0] * 8, *[-5.5] * 4, -2.5, -8.5)]
    expected = {
        # 26 is off by 8.5 um along z: 72.25 / 9 is more than 7.815; the next, 23, by 2 and 5.5 um
        "coverage_95": 5 / 6,
        "en_within_1": 17 / 18,
        "en_worst": -8.5 / 6,
        "anees": (28 + 6 * 5.5**2) / 9 / 18,
        "sigma_mm": 0.003 * (12 / 18) ** 0.5,
        "rmse_mm": RMSE_MM,
        "external_over_internal": (28 / 12) ** 0.5 / 3,
    }
    assert {key: card[key] for key in expected} == pytest.approx(expected, rel=3e-6)
    # The axes of an uncorrelated covariance are the coordinates'.
    assert card["pit"]["distance"] == pytest.approx(ks(z), abs=1e-6)
    assert card["pit"]["distance_of_coordinates"] == pytest.approx(ks(z), abs=1e-6)
    assert card["pit"]["p"] == pytest.approx(kstwo.sf(ks(z), 18), rel=1e-4)


@pytest.mark.parametrize(("part", "worst"), [(0.9e-5, -8.5 / 6), (1.1e-5, -5.5 / (6 * 1.1e-5))])
def test_a_coordinate_without_a_hundred_thousandth_of_the_others_uncertainty_has_none(
    by_hand: HandMade, part: float, worst: float
) -> None:
    """As before, but z of 23, 5.5 um low, has that part of the others' 3 um."""
    p = by_hand.points
    low = p.xyz_mm - np.where(p.code[:, None] < 30, [0.010, 0.020, -0.0145], 0)
    u = np.full(39, 0.003)
    u[3 * int(np.flatnonzero(p.code == 23)[0]) + 2] *= part
    one = MeasuredLengths(("x",), np.array([[22, 21]]), np.ones(1), np.zeros(1), np.ones(1), np.ones((1, 1)))
    points = replace(p, xyz_mm=low, cov_xyz_mm2=np.diag(u**2))
    card = points_card(by_hand.world, by_hand.calibration, points, one)
    assert card is not None and card["en_worst"] == pytest.approx(worst, rel=1e-5)


def test_neighbours_on_a_line_share_the_uncertainty_of_two_places(by_hand: HandMade) -> None:
    """25 to 21 is sqrt(1.25) m; the first is 3 um, the second 1 um further out, together sqrt(5) um along it."""
    world = with_lines(by_hand.world, MeasuringLine("z", (26, 25, 21), (1000.0, 1000 + 1250**0.5 * 1000**0.5), 0.003))
    found = spacing(world, by_hand.points)
    assert found is not None and found["spacings"] == 4 and found["worst_codes"] == [35, 36]
    expected = {
        "max_abs_mm": 0.015,
        "rms_mm": ((144 + 225 + 36 + 5) / 4) ** 0.5 * UM,
        "rms_u_mm": ((25 + 25 + 17 + 26) / 4) ** 0.5 * UM,
    }
    assert {key: found[key] for key in expected} == pytest.approx(expected, rel=1e-5)


def test_a_saddle_of_a_twentieth_is_a_form_error_of_a_tenth(by_hand: HandMade, scene: SceneFile) -> None:
    lift = {21: 0.05, 22: 0.05, 23: -0.05, 24: -0.05}
    up = np.array([[0, 0, lift.get(int(code), 0.0)] for code in by_hand.points.code])
    (plane,) = planes(scene, by_hand.world, replace(by_hand.points, xyz_mm=by_hand.points.xyz_mm + up))
    assert plane["targets"] == 4
    assert plane["measured_mm"] == pytest.approx(0.1, abs=1e-7)
    assert plane["true_mm"] == pytest.approx(0.0, abs=1e-9)
    assert plane["error_mm"] == pytest.approx(0.1, abs=1e-7)


def lengths(calibrated_mm: list[float], dl_um: list[float], u_um: float = 0.0) -> MeasuredLengths:
    L_mm, n = np.array(calibrated_mm), len(calibrated_mm)
    return MeasuredLengths(
        ("line",) * n,
        np.arange(2 * n).reshape(n, 2),
        L_mm,
        np.full(n, u_um * UM),
        L_mm + UM * np.array(dl_um),
        1e-6 * np.eye(n),
    )


def test_the_lowest_envelope_touches_two_errors() -> None:
    """6, 7 and 12 um at 1, 2 and 3 m: 3 um + 3 ppm L goes through the first and the last, and passes above 7 um."""
    found = figures(lengths([1000, 2000, 3000], [6, -7, 12]))["envelope"]
    expected = {"a_mm": 0.003, "k_ppm": 3, "a_without_k_mm": 0.012, "k_without_a_ppm": 6}
    assert found == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize(
    ("dl_um", "missing", "verdict", "shown", "outside"),
    [
        ([3, -3], 0, "passed", "shown", 0),
        ([3, -3], 2, "incomplete", "open", 0),
        ([5, -5], 0, "passed", "shown", 0),  # 5 + 2 is just within 7 um, the limit at one metre
        ([5.5, 0], 0, "passed", "open", 0),
        ([8, 0], 0, "failed", "open", 1),
        ([9.5, 0], 0, "failed", "refuted", 1),
        ([0, 12.5], 0, "failed", "refuted", 1),
        ([7.5, 11.5], 3, "failed", "open", 2),
    ],
)
def test_the_verdict_by_hand(dl_um: list[float], missing: int, verdict: str, shown: str, outside: int) -> None:
    """E = 4 um + 3 ppm L, at most 10 um, at 1 m and 3 m: 7 and 10 um; calibrated lengths have U = 2 um."""
    found = judge(lengths([1000, 3000], dl_um, 1.0), Limit(0.004 + 1e-12, 3, 0.010), missing)
    assert (found["verdict"], found["with_test_uncertainty"], found["outside"]) == (verdict, shown, outside)
    assert found["missing"] == missing and found["of"] == 2


def test_the_console_of_an_acceptance_shows_these_figures(
    by_hand: HandMade, scene: SceneFile, lined: World, capsys: pytest.CaptureFixture
) -> None:
    card, _ = acceptance(scene, lined, by_hand.calibration, by_hand.points, LIMIT)
    _show(card, Path("accept.html"))
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    table = [
        next(line for line in lines if line.startswith(f"{name} {a}-{b} "))
        for name, (a, b) in zip(NAMES, CODES, strict=True)
    ]
    assert [line.split("-", 1)[1] for line in table] == [
        "21 2000.0000 2000.0020 +0.0020 0.0028 +0.24 0.0060",
        "23 1200.0000 1200.0040 +0.0040 0.0028 +0.49 0.0054",
        "25 1000.0000 1000.0060 +0.0060 0.0028 +0.73 0.0050 outside",
        "34 700.0000 700.0120 +0.0120 0.0040 +1.20 0.0044 outside",
        "36 500.0000 499.9850 -0.0150 0.0040 -1.50 0.0040 outside",
    ]
    text = "\n".join(lines)
    for figure in (
        "0.0150; +0.0018; 0.0092 mm",
        "+4.44 ppm; -3.09 to +11.96",
        "0.0150 mm + 0.00 ppm L",
        "largest of 5 errors",
        "1 : 1,224,745; 1 : 1,603,567",
        " 0.76",
        " 0.0 %",
        "7.05 (0.46 to 1.75)",
        "60.0 %; -1.50",
    ):
        assert figure in text, figure


def test_the_page_of_an_acceptance_shows_these_figures(by_hand: HandMade, scene: SceneFile, lined: World) -> None:
    card, found = acceptance(scene, lined, by_hand.calibration, by_hand.points, LIMIT)
    page = Page(accept_page(lined, card, found, LIMIT, []))
    assert page.table("line", "ends") == [
        ["x", "22–21", "2000.0000", "0.0030", "2000.0020", "0.0028", "+0.0020", "+0.24", "0.0060", "within"],
        ["y", "24–23", "1200.0000", "0.0030", "1200.0040", "0.0028", "+0.0040", "+0.49", "0.0054", "within"],
        ["z", "26–25", "1000.0000", "0.0030", "1000.0060", "0.0028", "+0.0060", "+0.73", "0.0050", "outside"],
        ["check one", "33–34", "700.0000", "0.0030", "700.0120", "0.0040", "+0.0120", "+1.20", "0.0044", "outside"],
        ["check two", "35–36", "500.0000", "0.0030", "499.9850", "0.0040", "-0.0150", "-1.50", "0.0040", "outside"],
    ]
    first, second = [table[1:] for table in page.tables if table[0] == ["figure", "value"]]
    assert [row[1] for row in first] == [
        "5",
        "1",
        "500.0 mm; 2000.0 mm",
        "0.0150 mm",
        "+0.0018 mm",
        "0.0092 mm; 0.0045 mm",
        "-0.50 ppm",
        "+4.44 ppm; -3.09 to +11.96",
        "-26.51 to +35.38",
        "0.0150 mm; 0.00 ppm",
        "0.0150 mm; 30.00 ppm",
    ]
    shown = [row[1] for row in second]
    assert shown[:-2] == [
        "6 of 7",
        "0.0012 mm",
        "0.0016 mm",
        "0.76",
        "1 : 1,224,745",
        "1 : 1,603,567",
        "1 : 3,061,862; 1 : 4,008,919",
        "7.05; 0.46 to 1.75",
        "0.0 %; 33.3 to 100.0 %",
        "0.0 %; +3.67",
    ]
    assert "of 18; p = " in shown[-2] and shown[-1] == f"{BY_HAND['points.pit.distance_of_coordinates']:.2f}"
    assert [row[2:] for row in page.table("recommended", "asked")] == [
        ["3", "not met"],
        ["1", "not met"],
        ["1000 mm or more", "met"],
        ["2000 mm", "met"],
        ["1200 x 2000 x 1000 mm", "met"],
        ["0", "not met"],
    ]
    assert [row[1:] for row in page.table("plane", "targets")] == [["4", "0.0000", "0.0000", "0.0000"]]
    text = " ".join(page.paragraphs)
    for figure in (
        "Of 5, the largest error is 0.0150 mm (targets 35 and 36), rms 0.0092 mm, claimed u 0.0045 mm",
        "60.0 %",
        "-1.50",
        f"{BY_HAND['points.of_lengths.zeta_pit_distance']:.2f};",
    ):
        assert figure in text, figure
