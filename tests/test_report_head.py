"""The head of a report: verdict, date, and the picture of any station."""

import json
import re

import pytest

from testfield.chain.run import Run
from testfield.detect.observations import Observations
from testfield.report import page as report


def test_the_head_says_verdict_date_and_seed(tiny: Run) -> None:
    html = (tiny.folder / "report.html").read_text(encoding="utf-8")
    card = json.loads((tiny.folder / "scorecard.json").read_text())
    (head,) = re.findall(r'<p class="verdict (\w+)">(.*?)</p>', html, re.S)
    assert head[0] == ("passed" if card["verdict"]["passed"] else "failed")
    assert card["made"][:10] in head[1] and f"Seed {tiny.scene.seed}" in head[1]
    assert html.index("verdict") < html.index("data:image")


def test_the_picture_of_any_station_can_be_chosen(tiny: Run) -> None:
    html = (tiny.folder / "report.html").read_text(encoding="utf-8")
    offered = re.findall(r"<option[^>]*>([^<]+)</option>", html)
    assert tuple(offered) == tiny.stations
    held = json.loads(re.search(r"const others = (\{.*?\});", html, re.S)[1])  # type: ignore[index]
    shown = re.search(r"<option selected>([^<]+)<", html)[1]  # type: ignore[index]
    assert set(held) == set(tiny.stations) - {shown}
    assert all(picture.startswith("data:image/jpeg;base64,") for picture in held.values())


def test_pictures_are_left_out_before_the_page_grows_too_large(tiny: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    observations = Observations.load(tiny.folder / "observations.parquet")
    every = report._other_pictures(tiny.folder, tiny.stations[0], observations)
    sizes = [len(picture) for picture in every.values()]
    monkeypatch.setattr(report, "MOST_BYTES", sum(sizes[:2]))
    assert list(report._other_pictures(tiny.folder, tiny.stations[0], observations)) == list(every)[:2]
    assert report.MOST_BYTES < 8e6
