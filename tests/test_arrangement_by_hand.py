"""What VDI/VDE 2634 part 1 recommends of measuring lines, and what a page says of it, on a box of lines by hand."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hand_made import HandMade, Page

from testfield.camera.pose import Poses
from testfield.reconstruct.points import Points
from testfield.report.accept import accept_page, sentence
from testfield.scene.load import load_scene
from testfield.scene.schema import SceneFile
from testfield.scene.world import CHECK, Panels, TrueMarks, World
from testfield.score.acceptance import acceptance
from testfield.score.arrangement import arrangement
from testfield.score.length_test import Limit
from testfield.targets.field import MeasuringLine

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"


def volume(*size_mm: float, **changes: Any) -> SceneFile:
    """A scene of that size."""
    quick = load_scene(QUICK)
    size = quick.volume.model_copy(update={"size_mm": size_mm})
    return quick.model_copy(update={"volume": size, **changes})


def with_checks(world: World, places: dict[int, tuple[float, float, float]], lines: dict[str, list[int]]) -> World:
    """The world with nothing but check targets at these places, and measuring lines through some of them."""
    n, none = len(places), np.full(len(places), -1)
    xyz = np.array(list(places.values()), float)
    marks = TrueMarks(
        panel=np.arange(n),
        xy_mm=np.zeros((n, 2)),
        diameter_mm=np.full(n, 10.0),
        code=np.array(list(places)),
        role=np.full(n, CHECK),
        board=none,
        point=none,
    )
    panels = Panels(
        name=tuple(f"card {code}" for code in places),
        world_from_panel=Poses(np.tile(np.eye(3), (n, 1, 1)), xyz),
        size_mm=np.full((n, 2), 200.0),
        ground_albedo=np.full(n, 0.1),
        ink_albedo=np.full(n, 0.8),
    )
    measuring = tuple(
        MeasuringLine(name, tuple(codes), _from_first(places, codes), 0.001) for name, codes in lines.items()
    )
    boards = replace(world.field, measuring_lines=measuring, scale_bars=())
    return replace(world, panels=panels, marks=marks, field=boards)


def _from_first(places: dict[int, tuple[float, float, float]], codes: list[int]) -> tuple[float, ...]:
    first = np.array(places[codes[0]])
    return tuple(float(np.linalg.norm(places[code] - first)) for code in codes[1:])


# ------------------------------------------------------------------ arrangement
CORNERS = {101 + k: (300.0 * (k // 4), 400.0 * (k // 2 % 2), 1200.0 * (k % 2)) for k in range(8)}
"""The corners of a box of 300 by 400 by 1200 mm, whose diagonal is 1300 mm."""
LINES = {
    "body": [101, 108],
    "other": [102, 107],
    "third": [103, 106],
    "fourth": [104, 105],
    "edge": [101, 102],
    "edge two": [103, 104],
    "edge three": [105, 106],
}


def boxed(by_hand: HandMade, moved: dict[int, tuple[float, float, float]] | None = None, lines: int = 7) -> World:
    """That box with its lines, on each of which four targets more lie at fifths."""
    places = CORNERS | (moved or {})
    on, code = {}, 201
    for name, (a, b) in list(LINES.items())[:lines]:
        inner = [code + k for k in range(4)]
        start, end = np.array(places[a]), np.array(places[b])
        places |= {c: tuple(start + (k + 1) / 5 * (end - start)) for k, c in enumerate(inner)}
        on[name], code = [a, *inner, b], code + 4
    return with_checks(by_hand.world, places, on)


def rows_of(scene: SceneFile, world: World) -> list[tuple[str, str, str, bool]]:
    rows = arrangement(scene, world)
    assert rows is not None
    return [(row["what"], row["asked"], row["found"], row["met"]) for row in rows]


def test_an_arrangement_that_fills_its_volume_meets_every_recommendation(by_hand: HandMade) -> None:
    assert rows_of(volume(300.0, 400.0, 1200.0), boxed(by_hand)) == [
        ("measuring lines", "7 or more", "7", True),
        ("test lengths on every line", "5 or more", "5", True),
        ("longest length of every line", "the shortest side, 300 mm, or more", "1200 mm or more", True),
        ("one line at least", "two thirds of the diagonal, 867 mm", "1300 mm", True),
        ("the lines span the volume", "300 x 400 x 1200 mm", "300 x 400 x 1200 mm", True),
        ("an end point in every corner", "8", "8", True),
    ]


def met(rows: list[tuple[str, str, str, bool]]) -> list[bool]:
    return [row[3] for row in rows]


def test_six_lines_of_four_lengths_are_too_few(by_hand: HandMade) -> None:
    scene = volume(300.0, 400.0, 1200.0)
    six = boxed(by_hand, lines=6)
    assert rows_of(scene, six)[0][2:] == ("6", False) and met(rows_of(scene, six))[1:] == [True] * 5
    first = six.field.measuring_lines[0]
    fewer = MeasuringLine(first.name, first.codes[1:], first.length_mm[:4], 0.001)
    fewer_lines = replace(six, field=replace(six.field, measuring_lines=(fewer, *six.field.measuring_lines[1:])))
    assert rows_of(scene, fewer_lines)[1][2:] == ("4", False)


@pytest.mark.parametrize(("x_mm", "spans"), [(271.0, True), (269.0, False)])
def test_lines_span_a_volume_that_they_fill_to_nine_tenths(by_hand: HandMade, x_mm: float, spans: bool) -> None:
    narrow = boxed(by_hand, {code: (x_mm, *place[1:]) for code, place in CORNERS.items() if place[0]})
    row = rows_of(volume(300.0, 400.0, 1200.0), narrow)[4]
    assert row[1:] == ("300 x 400 x 1200 mm", f"{x_mm:.0f} x 400 x 1200 mm", spans)


@pytest.mark.parametrize(("off_mm", "corners"), [(29.0, 8), (31.0, 7)])
def test_an_end_is_in_a_corner_up_to_a_tenth_of_the_shortest_side(
    by_hand: HandMade, off_mm: float, corners: int
) -> None:
    """Of 300 mm 30 mm; the other ends still span the box, so that its middle stays."""
    moved = boxed(by_hand, {101: (0.0, 0.0, off_mm)})
    row = rows_of(volume(300.0, 400.0, 1200.0), moved)[5]
    assert row[1:] == ("8", f"{corners}", corners == 8)


def test_the_longest_lengths_are_held_against_the_shortest_side_and_the_diagonal(by_hand: HandMade) -> None:
    """A box of 1900 by 1900 by 1300 mm: the shortest line has 1200 mm, two thirds of the diagonal are 1990 mm."""
    rows = rows_of(volume(1900.0, 1900.0, 1300.0), boxed(by_hand))
    assert rows[2][1:] == ("the shortest side, 1300 mm, or more", "1200 mm or more", False)
    assert rows[3][1:] == ("two thirds of the diagonal, 1990 mm", "1300 mm", False)
    rows = rows_of(volume(1200.0, 1000.0, 1150.0), boxed(by_hand))  # diagonal 1939, of which 1293 are two thirds
    assert met(rows)[2:4] == [True, True] and rows[3][1] == "two thirds of the diagonal, 1293 mm"


def test_a_field_without_lines_has_no_arrangement(by_hand: HandMade) -> None:
    assert arrangement(volume(300.0, 400.0, 1200.0), by_hand.world) is None


# ------------------------------------------------------------------ the page
def test_the_page_says_what_was_asked_and_begins_with_the_verdict(by_hand: HandMade) -> None:
    world = boxed(by_hand, lines=3)
    ends = sorted(int(code) for code in world.marks.code)
    n = len(ends)
    xyz = np.array([world.mark_world_mm[int(np.flatnonzero(world.marks.code == code)[0])] for code in ends])
    points = Points(
        method="hand",
        code=np.array(ends),
        xyz_mm=xyz + 0.001 * np.arange(n)[:, None] / n,
        cov_xyz_mm2=1e-8 * np.eye(3 * n),
        rays=np.full(n, 2),
        residual_rms_px=np.zeros(n),
        rejected=np.zeros(n, int),
    )
    alone = replace(by_hand.calibration, board_names=("A",), boards=by_hand.calibration.boards[:1])
    scene = volume(300.0, 400.0, 1200.0)
    card, found = acceptance(scene, world, alone, points, Limit(0.003, 2.0))
    text = accept_page(world, card, found, Limit(0.003, 2.0), ["a warning"])
    page = Page(text)
    assert "a warning" in text
    assert page.table("recommended", "asked")[0] == ["measuring lines", "7 or more", "3", "not met"]
    assert [row[1] for row in page.table("recommended", "asked")] == [
        "7 or more",
        "5 or more",
        "the shortest side, 300 mm, or more",
        "two thirds of the diagonal, 867 mm",
        "300 x 400 x 1200 mm",
        "8",
    ]
    verdict = next(p for p in page.paragraphs if sentence(card) in p)
    assert "Passed: all 15 errors" in verdict and "(3, asked: 7 or more)" in verdict
    assert len(page.table("line", "ends")) == 15 and all(row[-1] == "within" for row in page.table("line", "ends"))
    open_card, _ = acceptance(scene, world, alone, points)
    page = Page(accept_page(world, open_card, found, None, []))
    assert page.table("line", "ends")[0][-1] == f"{found.en[0]:+.2f}"  # without a limit no verdict on a length
    assert any("No limit was given" in p for p in page.paragraphs)
