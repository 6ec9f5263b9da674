"""What a run's page and a measurement's say where little is known or nothing is wrong: by hand, at the bounds."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hand_made import HandMade, Page

from testfield.camera.images import Frame, SensorSheet
from testfield.camera.pose import Poses
from testfield.measure.certified import Length
from testfield.measure.photographs import Measurement
from testfield.report.measured import _figures
from testfield.report.page import write_report
from testfield.scene.load import load_scene
from testfield.score.floor import renderer_digest
from testfield.score.scorecard import load_scorecard, scorecard, write_scorecard

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
Made = tuple[Page, dict[str, Any]]


@pytest.fixture
def page_of(by_hand: HandMade, tmp_path: Path) -> Callable[..., Made]:
    """Makes the page of the hand-made run with another calibration or other points, and with a changed card."""

    def make(changed: Callable[[dict[str, Any]], object] = lambda card: None, **other: Any) -> Made:
        folder = tmp_path / "run"
        (folder / "frames").mkdir(parents=True)
        names = [folder / name for name in ("observations.parquet", "calibration.json", "points.parquet")]
        by_hand.observations.save(names[0])
        other.get("calibration", by_hand.calibration).save(names[1])
        other.get("points", by_hand.points).save(names[2])
        card = scorecard(by_hand.world, by_hand.views, *names) | {"time_s": {}}
        changed(card)
        write_scorecard(card, folder / "scorecard.json")
        grey = np.full((800, 1000), 900, np.uint16)
        Frame("left", grey, SensorSheet(2.6, 2.3, 64.0, 12)).save(folder / "frames/left.png")
        write_report(by_hand.world, by_hand.views, load_scene(QUICK), folder, {}, folder / "report.html")
        text = (folder / "report.html").read_text(encoding="utf-8")
        return Page(text), load_scorecard(folder / "scorecard.json")

    return make


def certify(folder: Path, floor_px: float, sound: bool) -> None:
    """A certificate beside a run in that folder; one that is not sound is quick, old, and has not passed."""
    measured = {"a: edge, rms": floor_px / 2, "b: centre, rms": floor_px, "b: worst": 0.2}
    verdicts = [
        {"part": name.split(": ")[0], "name": name.split(": ")[1], "measured": value, "limit": 0.5, "unit": "px"}
        for name, value in measured.items()
    ]
    light = {"part": "c", "name": "light, rms", "measured": 0.9, "limit": 1.0, "unit": "%"}
    code = renderer_digest() if sound else "another"
    certificate = {"made": "a day", "passed": sound, "quick": not sound, "code": code, "verdicts": [*verdicts, light]}
    (folder / "certificate.json").write_text(json.dumps(certificate), encoding="utf-8")


def says_what_the_certificate_says(page: Page, floor_px: float, sound: bool) -> None:
    """The centre error is 0.02145 px."""
    assert page.table("certified figure", "measured") == [
        ["a: edge, rms", f"{floor_px / 2:g}", "0.5", "px"],
        ["b: centre, rms", f"{floor_px:g}", "0.5", "px"],
        ["b: worst", "0.2", "0.5", "px"],
    ]
    text = next(text for text in page.paragraphs if text.startswith("Certificate of a day"))
    assert f"{floor_px:.5f} px rms" in text
    assert f"0.02145 px, lies {'above' if floor_px < 0.02145 else 'NOT above'} this floor" in text
    assert ("not every verdict passes" in text) == ("(quick)" in text) == ("another version" in text) == (not sound)


def test_a_page_marks_what_fails_and_nothing_else(
    by_hand: HandMade, page_of: Callable[..., Made], tmp_path: Path
) -> None:
    """E_n of 1 and -1 are just good enough."""
    certify(tmp_path, 0.02, sound=True)

    def bounds(card: dict[str, Any]) -> None:
        card["verdict"] = {"passed": True, "failures": []}
        card["lengths"]["bars"][1]["en"], card["lengths"]["bars"][2]["en"] = 1.0, -1.0
        card["lengths"]["u_scale_ppm"] = None

    test = by_hand.calibration.test | {"variance": 1.0, "passed": True}
    page, _ = page_of(bounds, calibration=replace(by_hand.calibration, test=test, rejected=()))
    assert [row[-1] for row in page.table("bar", "role")[:3]] == ["–", "1.00", "-1.00"]
    assert page.tiles[-1][0] == "-0.0140 mm" and 'class="failed"' not in page.html
    assert "Not passed" not in page.html
    said = next(text for text in page.paragraphs if "+15.00 ppm" in text)
    assert "claimed u" not in said
    said = next(text for text in page.paragraphs if "0.910 to 1.090" in text)
    assert "1.000" in said and ": within" in said and "Verdict: passed" in said
    assert not [table for table in page.tables if table and table[0][:1] == ["rejected at"]]
    says_what_the_certificate_says(page, 0.02, sound=True)


def test_a_page_says_what_failed_and_that_no_check_point_was_measured(
    by_hand: HandMade, page_of: Callable[..., Made], tmp_path: Path
) -> None:
    certify(tmp_path, 0.03, sound=False)
    lost = replace(
        by_hand.points, code=np.where(by_hand.points.code < 30, by_hand.points.code + 900, by_hand.points.code)
    )
    page, card = page_of(points=lost)
    assert len(card["verdict"]["failures"]) == 2 and page.html.count("Not passed:") == 2
    assert page.html.count('class="failed"') == 1 and page.tiles[-1][0] == "-0.0140 mm, FAILED"
    assert [value for value, _ in page.tiles[6:9]] == ["not measured"] * 3
    assert any("(7 in the scene)" in text for text in page.paragraphs)
    assert not [table for table in page.tables if table and table[0][:1] == ["code"]]
    assert "Elevation and plan" not in page.html and "Claimed uncertainty against" not in page.html
    said = next(text for text in page.paragraphs if "0.910 to 1.090" in text)
    assert "1.125" in said and ": NOT within" in said and "Verdict: NOT passed" in said
    says_what_the_certificate_says(page, 0.03, sound=False)


def test_the_page_of_a_free_network_compares_after_the_fit(by_hand: HandMade, page_of: Callable[..., Made]) -> None:
    c = by_hand.calibration
    own = c.index(["cx", "fx", "fy"])
    free = replace(
        c,
        labels=("cx", "fx", "fy"),
        covariance=c.covariance[np.ix_(own, own)],
        board_names=(),
        boards=Poses.identity(0),
        joints=(),
        graph=(),
        board_quality=(),
    )
    page, card = page_of(calibration=free)
    assert card["points"]["rmse_unfitted_mm"] is None and card["boards"]["pose_rms_mm"] is None
    assert (page.tiles[5][0], page.tiles[8][0]) == ("not measured", "0.58") and page.tiles[8][1].endswith("fit")
    said = next(text for text in page.paragraphs if text.startswith("6 of 7"))
    assert "0.0012 mm" in said and "without one" not in said and "NEES 0.58" in said
    assert not any("ppm" in text for text in page.paragraphs)
    rows = page.table("code", "x, mm")
    assert sorted(max(abs(float(v)) for v in row[4:7]) for row in rows) == [1, 1, 2, 2, 3, 3]


# ------------------------------------------------------------------ measurements
def length(role: str, en: float | None, off_mm: float = 0.0) -> Length:
    """A distance of 500 mm with u of 3 um, measured with u of 4 um: 5 um together."""
    return Length("bar", role, (1, 2), 500.0, 0.003, 500.0 + off_mm, 0.004, en)


@pytest.mark.parametrize(
    ("lengths", "value"),
    [
        ((length("check", 1.0, 0.01),), "+0.0100 mm (u 0.005 mm), passed: E_n +1.00"),
        ((length("check", -1.0, -0.01),), "-0.0100 mm (u 0.005 mm), passed: E_n -1.00"),
        ((length("check", 1.1, 0.011), length("check", -1.2, -0.012)), "-0.0120 mm (u 0.005 mm), FAILED: E_n -1.20"),
        ((length("check", 0.0), length("control", 5.0, 0.05)), "+0.0000 mm (u 0.005 mm), passed: E_n +0.00"),
        ((length("control", None), length("control", 5.0, 0.05)), None),
        ((length("check", None),), None),
        ((), None),
    ],
)
def test_a_measurements_worst_check_distance_is_told(
    by_hand: HandMade, lengths: tuple[Length, ...], value: str | None
) -> None:
    rows = _figures(Measurement(by_hand.observations, by_hand.calibration, by_hand.points, lengths, "by hand"))
    said = [text for title, text in rows if "check distance" in title]
    assert said == ([] if value is None else [value])
    assert rows[-1][1] == "nothing failed"


def test_a_measurement_without_points_says_nothing_of_them(by_hand: HandMade) -> None:
    p = by_hand.points
    none = replace(
        p,
        code=p.code[:0],
        xyz_mm=p.xyz_mm[:0],
        cov_xyz_mm2=np.zeros((0, 0)),
        rays=p.rays[:0],
        residual_rms_px=p.residual_rms_px[:0],
        rejected=p.rejected[:0],
    )
    some, without = (
        [title for title, _ in _figures(Measurement(by_hand.observations, by_hand.calibration, points, (), "by hand"))]
        for points in (p, none)
    )
    assert len(some) - len(without) == 3 and set(without) < set(some)
