"""Every figure of the scorecard, the console and the page against arithmetic by hand on errors that are written down.

The errors are those of `hand_made.py`; nothing here uses what is tested to compute what is expected. A key of the
scorecard that the arithmetic does not cover turns a test red, so that a new figure brings its own.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hand_made import HandMade, Page, flat
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from testfield.camera.images import Frame, SensorSheet
from testfield.camera.pose import Poses
from testfield.cli.show import show_result
from testfield.report.page import write_report
from testfield.scene.load import load_scene
from testfield.score.detection import score_detection
from testfield.score.points import score_points
from testfield.score.scorecard import scorecard, ten_figures, write_scorecard

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
TEXT = object()
"""A leaf that holds words for people."""


def corners_px() -> list[float]:
    """Two pinholes' rays, the rotation between them that SciPy finds best, and what is left at the corners."""
    true, found = (np.array([[f, 0, cx], [0, f, 399.5], [0, 0, 1]]) for f, cx in ((1000.0, 499.5), (1001.0, 499.8)))
    x, y = np.meshgrid(np.linspace(0, 999, 13), np.linspace(0, 799, 11))
    grid = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    rays = [(a / np.linalg.norm(a, axis=1, keepdims=True)) for a in (grid @ np.linalg.inv(K).T for K in (true, found))]
    turn = Rotation.align_vectors(rays[1], rays[0])[0].as_matrix()
    ends = np.array([[-0.5, -0.5, 1], [999.5, -0.5, 1], [999.5, 799.5, 1], [-0.5, 799.5, 1]])
    image = ends @ np.linalg.inv(true).T @ turn.T @ found.T
    return np.linalg.norm(image[:, :2] / image[:, 2:] - ends[:, :2], axis=1).tolist()


def imaging() -> tuple[float, float, float]:
    """Error, u and NEES of the pinhole of `corners_px` at three places, by the turn that least squares finds."""
    at = np.array([[100.0, 100], [900, 150], [500, 700]])
    rays = np.column_stack([(at - [499.5, 399.5]) / 1000, np.ones(3)])

    def seen(turn: np.ndarray, fx: float = 1001, fy: float = 1001, cx: float = 499.8) -> np.ndarray:
        x, y, z = (rays @ Rotation.from_rotvec(turn).as_matrix().T).T
        return np.column_stack([fx * x / z + cx, fy * y / z + 399.5]).ravel()

    turn = least_squares(lambda turn: seen(turn) - at.ravel(), np.zeros(3), xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    steps = 1e-5 * np.eye(3)
    T = np.stack([(seen(turn + s) - seen(turn - s)) / 2e-5 for s in steps], axis=1)
    J = np.stack([seen(turn, **more) - seen(turn) for more in ({"fx": 1002}, {"fy": 1002}, {"cx": 500.8})], axis=1)
    S = np.eye(6) - T @ np.linalg.solve(T.T @ T, T.T)
    error = (S @ (seen(turn) - at.ravel())).reshape(3, 2)
    C = S @ J @ np.array([[1, 0.5, 0], [0.5, 1, 0], [0, 0, 0.01]]) @ J.T @ S.T
    own = [C[k : k + 2, k : k + 2] for k in (0, 2, 4)]
    nees = np.mean([e @ np.linalg.solve(c, e) / 2 for e, c in zip(error, own, strict=True)])
    u = np.sqrt(np.mean([np.trace(c) for c in own]))
    return float(np.sqrt((error**2).sum(axis=1).mean())), float(u), float(nees)


IMAGING = imaging()
CORNERS = corners_px()
RMSE_MM = (28 / 18) ** 0.5 / 1000  # twice 1, 4 and 9 um^2 over 18 coordinates
UNCOUNTED = ("time_s", "program", "made")
"""What tells of the scorecard's making, and nothing of the run."""

BY_HAND: dict[str, object] = {
    "format": 1,
    "seed": 1,
    "scene": "by hand",
    "verdict.passed": False,  # E_n of 1.2 and of -1.5
    "verdict.failures.0": TEXT,
    "verdict.failures.1": TEXT,
    # 8 fully visible, 8 px or wider at the left (one of them obliquely), 5 at the right: less the one of 7.9 px
    "detection.expected": 12,
    "detection.found": 7,
    "detection.found_fraction": 7 / 12,
    "detection.missed": 5,
    "detection.missed_reasons.no blob there": 1,
    "detection.missed_reasons.not identified": 2,
    "detection.missed_reasons.partly hidden or disturbed": 1,
    "detection.missed_reasons.saturated": 1,
    "detection.dirty": 2,
    "detection.dirty_found": 1,
    "detection.false": 2,
    "detection.wrong_code": 3,
    "detection.wrong_dot": 1,
    "detection.measured": 10,
    # squares in 1e-4 px^2: 25 + 1 + 4 + 2 + 9 + 16 + 5 + 5 + 0 + 25 = 92, over 20 coordinates
    "detection.centre_rms_px": 0.01 * (92 / 20) ** 0.5,
    "detection.centre_bias_px": 0.01 * (0.7**2 + 0.3**2) ** 0.5,
    "detection.centre_bias_x_px": -0.007,
    "detection.centre_bias_y_px": -0.003,
    "detection.centre_worst_px": 0.04,
    # 25/4, 1, 4 * 2/3 (correlated), 2, 1, 1, 5, 5, 0, 1, over 10 observations of two coordinates
    "detection.centre_anees": (6.25 + 1 + 8 / 3 + 2 + 1 + 1 + 5 + 5 + 0 + 1) / 20,
    "calibration.method": "hand",
    "calibration.reprojection_rms_px": 0.123,
    "calibration.sigma0": 1.05,
    "calibration.observations": 321,
    "calibration.rejected": 2,
    "calibration.corner_error_px": max(CORNERS),
    **{f"calibration.corner_errors_px.{k}": CORNERS[k] for k in range(4)},
    "calibration.interior_error.fx": 1.0,
    "calibration.interior_error.fy": 1.0,
    "calibration.interior_error.cx": 0.3,
    "calibration.interior_u.fx": 1.0,
    "calibration.interior_u.fy": 1.0,
    "calibration.interior_u.cx": 0.1,
    "calibration.interior_anees": (4 / 3 + 9) / 3,  # (1, 1) under ((1, 1/2), (1/2, 1)); 0.3 px with u = 0.1 px
    "calibration.imaging_error_px": IMAGING[0],
    "calibration.imaging_u_px": IMAGING[1],
    "calibration.imaging_anees": IMAGING[2],
    "calibration.lens_misfit": None,
    "calibration.notes.0": TEXT,
    "boards.joined": 3,
    "boards.names.0": "C",
    "boards.names.1": "B",
    "boards.mark_shift_rms_mm.0": 0.05,  # 0.03 and 0.04
    # 0.12 along the normal, and marks 50 mm from it turned by a thousandth: the chord of that arc
    "boards.mark_shift_rms_mm.1": (0.12**2 + (100 * np.sin(0.0005)) ** 2) ** 0.5,
    "boards.pose_rms_mm": ((0.05**2 + 0.12**2 + (100 * np.sin(0.0005)) ** 2) / 2) ** 0.5,
    "boards.translation_error_mm.0": 0.05,
    "boards.translation_error_mm.1": 0.12,
    "boards.rotation_error_mrad.0": 0.0,
    "boards.rotation_error_mrad.1": 1.0,
    # C: (0.03 / 0.06)^2 + (0.04 / 0.16)^2; B: (1 / 1)^2 + (0.12 / 0.06)^2
    "boards.anees": (0.25 + 0.0625 + 1 + 4) / 12,
    **{
        f"boards.graph.{k}.{j}": v
        for k, e in enumerate((("left", "A", 6), ("right", "B", 4), ("left", "C", 2)))
        for j, v in enumerate(e)
    },
    "points.method": "hand",
    "points.expected": 7,
    "points.measured": 6,
    "points.fit": TEXT,
    "points.rmse_mm": RMSE_MM,
    # each axis is off by its shift six times over: 6 (100 + 400 + 400) + 28 um^2
    "points.rmse_unfitted_mm": (5428 / 18) ** 0.5 / 1000,
    "points.worst_mm": 0.003,
    "points.mean_u_mm": (34 / 3) ** 0.5 / 1000,  # 9, 9 and 16 um^2
    "points.relative_accuracy": 5000 / RMSE_MM,
    "points.relative_accuracy_note": TEXT,
    "points.relative_accuracy_largest_distance": 2000 / RMSE_MM,
    # The mean of six has the variance 4/6 + 5 um^2 (z: 12), and what is left of each has 4 um^2.
    "points.anees": (500 / (4 / 6 + 5) + 400 / (4 / 6 + 12) + 28 / 4) / 18,
    "points.anees_band_95.0": 8.231 / 18,  # chi-squared of 18 degrees of freedom, from a printed table
    "points.anees_band_95.1": 31.526 / 18,
    "points.anees_fitted": 28 / 4 / 12,
    "points.anees_note": TEXT,
    "lengths.check_error_mm": -0.014,
    "lengths.scale_error_ppm": 15.0,  # 35 found, 20 printed
    "lengths.u_scale_ppm": 5.0,
    "lengths.bars.0.name": "control bar",
    "lengths.bars.0.role": "control",
    "lengths.bars.0.measured_mm": 900.004,
    "lengths.bars.0.u_measured_mm": 0.004,
    "lengths.bars.0.true_mm": 900.001,
    "lengths.bars.0.certified_mm": 900.0,
    "lengths.bars.0.u_certified_mm": 0.006,
    "lengths.bars.0.error_mm": 0.003,
    "lengths.bars.0.difference_to_certified_mm": 0.004,
    "lengths.bars.0.en": None,
    "lengths.bars.1.name": "check one",
    "lengths.bars.1.role": "check",
    "lengths.bars.1.measured_mm": 700.012,
    "lengths.bars.1.u_measured_mm": 0.004,
    "lengths.bars.1.true_mm": 700.002,
    "lengths.bars.1.certified_mm": 700.0,
    "lengths.bars.1.u_certified_mm": 0.003,
    "lengths.bars.1.error_mm": 0.010,
    "lengths.bars.1.difference_to_certified_mm": 0.012,
    "lengths.bars.1.en": 1.2,  # 12 um over twice 5 um
    "lengths.bars.2.name": "check two",
    "lengths.bars.2.role": "check",
    "lengths.bars.2.measured_mm": 499.985,
    "lengths.bars.2.u_measured_mm": 0.004,
    "lengths.bars.2.true_mm": 499.999,
    "lengths.bars.2.certified_mm": 500.0,
    "lengths.bars.2.u_certified_mm": 0.003,
    "lengths.bars.2.error_mm": -0.014,
    "lengths.bars.2.difference_to_certified_mm": -0.015,
    "lengths.bars.2.en": -1.5,
    "lengths.bars.3.name": "check three",
    "lengths.bars.3.role": "check",
    "lengths.bars.3.note": TEXT,
}


@pytest.fixture(scope="module")
def folder(by_hand: HandMade, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run's folder with the files that are scored, and the scorecard."""
    place = tmp_path_factory.mktemp("by_hand")
    names = [place / name for name in ("observations.parquet", "calibration.json", "points.parquet")]
    by_hand.observations.save(names[0])
    by_hand.calibration.save(names[1])
    by_hand.points.save(names[2])
    card = scorecard(by_hand.world, by_hand.views, *names)
    write_scorecard(card | {"time_s": {"render": 1.5, "detect": 2.25}}, place / "scorecard.json")
    return place


@pytest.fixture(scope="module")
def page(by_hand: HandMade, folder: Path) -> Page:
    """The page of that folder."""
    (folder / "frames").mkdir()
    grey = np.random.default_rng(1).integers(100, 4000, (800, 1000)).astype(np.uint16)
    Frame("left", grey, SensorSheet(2.6, 2.3, 64.0, 12)).save(folder / "frames/left.png")
    notes = {
        "command": "testfield run x.toml",
        "seed": 7,
        "versions": {"testfield": "0.1.0", "numpy": "2.3"},
        "machine": "a machine",
        "warnings": ["a warning"],
        "images": {
            "left": {"mode": "sampled", "samples": 40, "noise": 0.004, "over_target": 0.01},
            "right": {"mode": "sampled", "samples": 60, "noise": 0.006, "over_target": 0.03},
        },
    }
    scene = load_scene(QUICK)
    write_report(by_hand.world, by_hand.views, scene, folder, notes, folder / "report.html")
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def test_every_figure_of_the_scorecard_is_that_of_the_arithmetic_by_hand(folder: Path) -> None:
    found = flat({k: v for k, v in json.loads((folder / "scorecard.json").read_text()).items() if k not in UNCOUNTED})
    assert found.keys() == BY_HAND.keys()
    wrong = {}
    for key, expected in BY_HAND.items():
        value = found[key]
        if expected is TEXT:
            good = isinstance(value, str) and bool(value)
        elif isinstance(expected, float):
            # So tight that a million and a million less one differ; tables give four digits.
            good = value == pytest.approx(expected, rel=1e-4 if "band" in key else 1e-8, abs=1e-11)
        else:
            good = value == expected and isinstance(value, type(expected))
        if not good:
            wrong[key] = (value, expected)
    assert not wrong


def test_the_console_shows_the_ten_figures_in_their_order(folder: Path, capsys: pytest.CaptureFixture) -> None:
    show_result(folder, as_json=False)
    lines = [line.rsplit("  ", 1) for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert [value for _, value in lines[:10]] == [
        "58.33%",
        "3",
        "0.0214 px",
        "0.1230 px",
        f"{max(CORNERS):.4f} px",
        "0.0985 mm",
        "0.0012 mm",
        "1 : 4,008,919",
        "7.05",
        "-0.0140 mm, FAILED",
    ]
    assert [value for _, value in lines[11:]] == [str(folder / "report.html"), str(folder / "scorecard.json")]
    show_result(folder, as_json=True)
    assert json.loads(capsys.readouterr().out) == json.loads((folder / "scorecard.json").read_text())


def test_the_tiles_of_the_page_are_the_console_s(folder: Path, page: Page) -> None:
    rows = ten_figures(json.loads((folder / "scorecard.json").read_text()))
    assert len(rows) == 10
    assert page.tiles == [(value, title) for title, value in rows]


def test_the_page_counts_detections_as_they_are(page: Page) -> None:
    assert [row[1] for row in page.table("figure", "value")] == [
        "12",
        "7",
        "5",
        "1",
        "2",
        "1",
        "1",
        "2",
        "3",
        "1",
        "0.0214 px",
        "-0.00700, -0.00300 px",
        "0.0400 px",
        "1.25",
    ]
    assert [row[0] for row in page.table("figure", "value")[3:7]] == [
        "no blob there",
        "not identified",
        "partly hidden or disturbed",
        "saturated",
    ]
    looked_at = page.table("all blobs that were looked at")
    assert looked_at[0] == ["measured", "17"]
    assert sorted(looked_at[1:]) == [["partly hidden or disturbed", "1"], ["saturated", "1"]]


def test_the_page_shows_the_camera_true_and_found(page: Page) -> None:
    rows = {row[0]: row[1:] for row in page.table("parameter", "true", "found")}
    assert rows["fx"] == ["1000.0000", "1001.0000", "1", "1"]
    assert rows["cx"] == ["499.5000", "499.8000", "0.3", "0.1"]
    assert rows["cy"] == ["399.5000", "399.5000", "0", "–"]
    assert rows["k1"] == ["0", "0", "0", "–"]
    assert len(rows) == 9
    said = next(text for text in page.paragraphs if "321" in text)
    corners = ", ".join(f"{v:.4f}" for v in CORNERS)
    for figure in ("2 rejected", "1.050", "0.1230 px", "3.44 ", corners):
        assert figure in said
    assert page.table("rejected at") == [
        ["left", "A", "12.3", "45.6", "7.8", "odd"],
        ["right", "–", "65.4", "32.1", "9.8", ""],
    ]


def test_the_page_shows_the_boards_and_their_graph(page: Page) -> None:
    assert page.table("board", "marks' shift rms, mm") == [
        ["C", "0.0500", "0.0500", "0.0000"],
        ["B", "0.1300", "0.1200", "1.0000"],
    ]
    said = next(text for text in page.paragraphs if "+15.00 ppm" in text)
    assert "0.443 " in said and "5.00 ppm" in said
    assert page.table("marks seen", "1", "2") == [
        ["A", "5 0.021 0.75", "·"],
        ["C", "2", "·"],
        ["B", "·", "4 0.034 0.50"],
    ]
    assert page.table("board", "images", "links to the datum") == [
        ["C", "1", "2", "0.0123", "0.0456"],
        ["B", "3", "–", "0.0789", "0.0321"],
    ]
    said = next(text for text in page.paragraphs if "1.125" in text)
    for figure in (
        "0.910 to 1.090",
        "250",
        "NOT passed",
        "0.125",
        "3 observation(s)",
        "4 contradict",
        "2 good",
        "0.345 px",
    ):
        assert figure in said, figure


def test_the_page_shows_each_bar(page: Page) -> None:
    rows = page.table("bar", "role")
    assert rows[:3] == [
        ["control bar", "control", "900.0000", "900.0010", "900.0040", "+0.0030", "0.0040", "–"],
        ["check one", "check", "700.0000", "700.0020", "700.0120", "+0.0100", "0.0040", "1.20 failed"],
        ["check two", "check", "500.0000", "499.9990", "499.9850", "-0.0140", "0.0040", "-1.50 failed"],
    ]
    assert rows[3][:2] == ["check three", "check"] and len(rows[3]) == 3


def test_the_page_shows_each_check_point_the_worst_first(page: Page) -> None:
    u = ["3.0", "3.0", "4.0"]
    rows = [[v if v != "-0.000" else "0.000" for v in row] for row in page.table("code", "x, mm")]
    assert rows == [
        ["26", "0.000", "0.000", "-500.000", "+10.0", "+20.0", "-23.0", *u],
        ["23", "0.000", "600.000", "0.000", "+10.0", "+22.0", "-20.0", *u],
        ["21", "1000.000", "0.000", "0.000", "+11.0", "+20.0", "-20.0", *u],
        ["22", "-1000.000", "0.000", "0.000", "+9.0", "+20.0", "-20.0", *u],
        ["24", "0.000", "-600.000", "0.000", "+10.0", "+18.0", "-20.0", *u],
        ["25", "0.000", "0.000", "500.000", "+10.0", "+20.0", "-17.0", *u],
    ]
    said = next(text for text in page.paragraphs if text.startswith("6 of 7"))
    for figure in ("0.0012 mm", "0.0174 mm", "1 : 4008918 ", "1 : 1603567 ", "7.05 ", "0.46 to 1.75"):
        assert figure in said, figure


def test_the_page_says_how_it_was_made(page: Page) -> None:
    (rows,) = [table for table in page.tables if table[0][0] == "command"]
    shown = {row[0]: row[1] for row in rows}
    assert (shown["command"], shown["seed"], shown["machine"]) == ("testfield run x.toml", "7", "a machine")
    assert shown["versions"] == "testfield 0.1.0, numpy 2.3" and shown["time, s"] == "render 1.5, detect 2.25"
    for figure in ("left, right", "50 samples", "0.40 to 0.60 %", "3.00 %"):
        assert figure in shown["images"]


def test_a_free_network_is_compared_after_a_fit_however_it_is_turned(by_hand: HandMade) -> None:
    free = replace(by_hand.calibration, board_names=(), boards=Poses.identity(0))
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    turned = replace(by_hand.points, xyz_mm=by_hand.points.xyz_mm @ turn.T + 77.0)
    score = score_points(by_hand.world, free, turned)
    card = score.card()
    assert card["rmse_mm"] == pytest.approx(RMSE_MM, rel=1e-6)
    assert card["rmse_unfitted_mm"] is None and np.isnan(card["anees"])
    assert card["anees_fitted"] == pytest.approx(28 / 4 / 12, rel=1e-6)
    outwards = {0.001: 2, 0.002: 2, 0.003: 2}
    sizes, counts = np.unique(np.linalg.norm(score.error_mm, axis=1).round(9), return_counts=True)
    assert dict(zip(sizes.tolist(), counts.tolist(), strict=True)) == outwards


def test_what_lies_just_beyond_a_dots_radius_is_another_thing(by_hand: HandMade) -> None:
    """A dot of 20 px reaches 10 px: what claims it from 9.9 px away is measured badly, from 10.1 px it is wrong."""
    o = by_hand.observations
    row = 2  # code 1 at its place
    for off_px, measured, wrong in ((9.9, 10, 3), (10.1, 9, 4)):
        moved = o.xy_px.copy()
        moved[row] = by_hand.views.disc_px[0, 4] + [0, off_px]
        card = score_detection(by_hand.world, by_hand.views, replace(o, xy_px=moved)).card()
        assert (card["measured"], card["wrong_code"]) == (measured, wrong)


def test_projected_centres_are_compared_with_projected_centres(by_hand: HandMade) -> None:
    shifted = replace(by_hand.observations, centre_of_disc=False)
    card = score_detection(by_hand.world, by_hand.views, shifted).card()
    assert card["centre_bias_x_px"] == pytest.approx(0.493, abs=1e-9)  # the disc lies half a pixel further right
    assert card["centre_bias_y_px"] == pytest.approx(-0.003, abs=1e-9)
