"""The curves of every kind of target: what is drawn is found where it is drawn, and only what is there counts."""

from pathlib import Path

import numpy as np
import pytest

from testfield.bench.drawn_boards import View, clutter
from testfield.bench.public_detectors import of_kind
from testfield.bench.recall_kinds import KINDS, OURS, Kind, behind, drawn, lines, ours, scored
from testfield.bench.recall_page import write_page
from testfield.detect.target_spec import parse_target


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_the_truth_fed_in_is_all_found_and_shifted_it_is_all_wrong(kind: Kind) -> None:
    picture = drawn(kind, View(kind.steps_px[2]), 1)
    n = len(picture.number)
    assert scored(kind, picture, (picture.number, picture.xy_px)).tolist() == [n, n, 0]
    assert scored(kind, picture, (picture.number, picture.xy_px + 20)).tolist() == [n, 0, n]
    assert scored(kind, picture, (picture.number + 1000, picture.xy_px)).tolist() == [n, 0, n]


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_every_kind_drawn_well_is_found_with_nothing_wrong(kind: Kind) -> None:
    picture = drawn(kind, View(kind.steps_px[3]), 2)
    there, found, wrong = scored(kind, picture, ours(picture.image, parse_target(kind.word)))
    assert (found, wrong) == (there, 0)
    for read in of_kind(kind.word).values():
        assert scored(kind, picture, read(picture.image))[2] == 0


def test_clutter_holds_none_of_them() -> None:
    image = clutter(View(1.0), 3)
    for kind in KINDS[4:8]:
        assert len(ours(image, parse_target(kind.word))[0]) == 0


def test_who_finds_more_is_said_unless_its_false_finds_are_more() -> None:
    row = {"kind": "AprilTag", "factor": "snr", "value": 5.0, "there": 12, "wrong": 0, "false": 0, "empty": 1}
    rows = [row | {"detector": OURS, "found": 8}, row | {"detector": "other", "found": 9}]
    assert len(behind(rows)) == 1
    assert not behind([rows[0], rows[1] | {"false": 1}])
    assert any("67 %" in line for line in lines(rows))
    assert np.all([len(kind.steps_px) == 5 for kind in KINDS])


def test_the_page_draws_every_detector_and_names_where_ours_is_behind(tmp_path: Path) -> None:
    row = {"kind": "AprilTag", "factor": "snr", "there": 12, "wrong": 0, "false": 0, "empty": 1}
    rows = [
        row | {"value": v, "detector": name, "found": found}
        for name, found in ((OURS, 8), ("other", 9))
        for v in (5.0, 60.0)
    ]
    page = write_page({"rows": rows, "behind": behind(rows)}, tmp_path).read_text()
    assert page.count("other finds 9, we 8 of 12") == 2
    assert "<svg" in page and (tmp_path / "recall_kinds.png").stat().st_size > 5000
