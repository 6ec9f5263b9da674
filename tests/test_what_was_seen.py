"""What can be read both ways is read, and "nothing found" says what was seen."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.camera.photograph import photograph_of
from testfield.cli.main import main
from testfield.detect.circle_grid import order_grid
from testfield.detect.observations import MEASURED
from testfield.detect.photograph import Found, detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.simulate.board_image import draw_board, facing
from testfield.targets.board_pattern import BoardPattern, dictionary
from testfield.targets.ring_code import code_words

TO_PX = facing(1.3, (165, 140), 8, 2e-4)


def drawn(pattern: BoardPattern) -> np.ndarray:
    return draw_board(pattern, (330, 280), TO_PX)


def seen(image: np.ndarray, target: str) -> Found:
    noise = np.random.default_rng(0).normal(0, 1, image.shape)
    pixels = np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)
    return detect_in_photograph(photograph_of("it", pixels), parse_target(target))


def said(found: Found) -> str:
    return " ".join(found.notes)


CHARUCO = BoardPattern("charuco", 7, 6, 30, 22, "DICT_4X4_50")
LEGACY = BoardPattern("charuco", 7, 6, 30, 22, "DICT_4X4_50", legacy=True)
CHECKERBOARD = BoardPattern("checkerboard", 8, 6, 28)


def test_a_legacy_board_is_printed_as_opencv_printed_it() -> None:
    board = cv2.aruco.CharucoBoard((7, 6), 30, 22, dictionary("DICT_4X4_50"))
    board.setLegacyPattern(True)
    theirs = board.generateImage((7 * 180, 6 * 180)) < 128
    x, y = (np.arange(7 * 180) + 0.5) / 6 - 105, 90 - (np.arange(6 * 180) + 0.5) / 6
    assert np.array_equal(LEGACY.cells.at(np.stack(np.meshgrid(x, y), axis=-1)), theirs)


@pytest.mark.parametrize(
    ("image", "target"),
    [
        pytest.param(lambda: drawn(LEGACY), "charuco:7x6:DICT_4X4_50:30:22", id="a ChArUco of before OpenCV 4.6"),
        pytest.param(lambda: drawn(CHARUCO), "charuco:6x7:DICT_4X4_50:30:22", id="columns and rows exchanged"),
        pytest.param(lambda: 230 - drawn(CHARUCO), "charuco:7x6:DICT_4X4_50:30:22", id="white on black"),
    ],
)
def test_a_charuco_that_can_be_read_otherwise_is_read_and_it_is_said(image, target: str) -> None:
    found = seen(image(), target)
    here = found.observations
    assert (here.status == MEASURED).sum() == 30
    true = cv2.perspectiveTransform(CHARUCO.points_mm[None], TO_PX)[0]
    assert np.abs(here.xy_px - true[here.point]).max() < 0.2
    assert found.notes


@pytest.mark.parametrize("target", ["checkerboard:7x5", "checkerboard:5x7"])
@pytest.mark.parametrize("white_on_black", [False, True])
def test_a_checkerboard_is_measured_either_way(target: str, white_on_black: bool) -> None:
    image = drawn(CHECKERBOARD)
    assert (seen(230 - image if white_on_black else image, target).observations.status == MEASURED).sum() == 35


def test_tags_printed_white_on_black_are_read() -> None:
    found = seen(230 - drawn(BoardPattern("tags", 4, 3, 50, 36, "DICT_5X5_100")), "aruco:DICT_5X5_100")
    assert (found.observations.status == MEASURED).sum() == 48
    assert found.numbers.tolist() == list(range(12))


@pytest.mark.parametrize(
    ("image", "target", "word"),
    [
        (lambda: drawn(CHARUCO), "charuco:7x6:DICT_5X5_50:30:22", "DICT_4X4_50"),
        (lambda: drawn(CHARUCO), "charuco:9x4:DICT_4X4_50:30:22", "21 tags"),
        (lambda: drawn(BoardPattern("tags", 4, 3, 50, 36, "DICT_5X5_100")), "aruco:DICT_6X6_250", "12 tags"),
        (lambda: drawn(CHECKERBOARD), "checkerboard:8x6", "7 x 5"),
        (lambda: np.full((200, 300), 120.0), "checkerboard:8x6", "blank"),
        (lambda: np.full((200, 300), 300.0), "ring14", "over-exposed"),
        (lambda: 0.02 * drawn(CHECKERBOARD), "ring14", "under-exposed"),
    ],
)
def test_nothing_found_says_what_was_seen(image, target: str, word: str) -> None:
    found = seen(image(), target)
    assert not (found.observations.status == MEASURED).any()
    assert word in said(found)


def discs(columns: int, rows: int, asymmetric: bool) -> np.ndarray:
    """A grid of dark discs on white, 30 px apart; of an asymmetric one OpenCV's columns and rows, 42 px and 21 px."""
    y, x = np.mgrid[0:1200, 0:1800] / 4
    image, step = np.full((1200, 1800), 210.0), (42, 21) if asymmetric else (30, 30)
    for row in range(rows):
        for column in range(columns):
            shift = 21 * (row % 2) if asymmetric else 0
            image[np.hypot(x - 60 - shift - step[0] * column, y - 35 - step[1] * row) < 8] = 40
    return cv2.GaussianBlur(cv2.resize(image, (450, 300), interpolation=cv2.INTER_AREA), (0, 0), 0.7)


@pytest.mark.parametrize(
    ("grid", "target", "word"),
    [
        ((4, 9, True), "acircles:4x11", "asymmetric grid of 4 x 9"),
        ((4, 8, True), "acircles:4x8", "even number of rows"),
        ((10, 8, False), "acircles:4x11", "grid of 10 x 8 dots (--target circles:10x8)"),
        ((10, 8, False), "charuco:7x6:DICT_4X4_50:30:22", "grid of 10 x 8 dots (--target circles:10x8)"),
    ],
)
def test_dots_that_make_no_board_asked_for_are_told_of(grid: tuple[int, int, bool], target: str, word: str) -> None:
    found = seen(discs(*grid), target)
    assert not (found.observations.status == MEASURED).any()
    assert word in said(found)


def rings(inner: float, outer: float, bits: int = 12, words: np.ndarray | None = None) -> np.ndarray:
    """Twelve dots on black with rings of `bits` segments: those of code words, or three of them bright."""
    y, x = (np.mgrid[0:1200, 0:1600] + 0.5) / 4
    image = np.zeros((1200, 1600))
    for k in range(12):
        dx, dy = x - 50 - 95 * (k % 4), y - 50 - 95 * (k // 4)
        r, segment = np.hypot(dx, dy), np.floor(np.arctan2(dy, dx) / (2 * np.pi) * bits) % bits
        here = [k % 3, 5, 8] if words is None else [j for j in range(bits) if int(words[k]) >> (bits - 1 - j) & 1]
        bright = np.isin(segment, here)
        image[(r < 8) | ((r > 8 * inner) & (r < 8 * outer) & bright)] = 180
    return 20 + cv2.GaussianBlur(cv2.resize(image, (400, 300), interpolation=cv2.INTER_AREA), (0, 0), 0.7)


def test_dots_with_rings_of_another_system_are_counted() -> None:
    assert "12 dots with something around them" in said(seen(rings(2.0, 3.0), "ring14"))


@pytest.mark.parametrize("asked", ["ring8", "ring10", "ring12", "ring16", "ring20"])
def test_rings_of_another_length_are_named_though_some_are_read_by_chance(asked: str) -> None:
    image = rings(2.0, 3.0, 14, code_words(14)[:12])
    assert "read more" not in said(seen(image, "ring14")) and "--target" not in said(seen(image, "ring14"))
    assert "--target ring14 --radii 1:2:3 reads" in said(seen(image, asked))


def test_a_grid_of_another_size_is_named() -> None:
    y, x = np.mgrid[0:220, 0:300].astype(float)
    dots = np.full(x.shape, 200.0)
    for k in range(24):
        dots -= 160 * np.clip(8.5 - np.hypot(x - 40.2 - 40 * (k % 6), y - 45.3 - 40 * (k // 6)), 0, 1)
    found = seen(dots, "circles:5x4")
    assert "6 x 4" in said(found)
    assert (found.observations.status == MEASURED).sum() == 24


def test_a_grid_is_named_though_a_dot_is_missing_and_not_without_its_last_row() -> None:
    column, row = np.meshgrid(np.arange(10), np.arange(8))
    place = np.column_stack([column.ravel(), row.ravel()])
    xy = 50 + place @ [[40.0, 3.0], [-4.0, 38.0]] + np.random.default_rng(3).normal(0, 0.3, (80, 2))
    size = np.full(80, 15.0)
    whole = order_grid(xy, size, 10, 8)
    assert (whole == place).all()
    hidden = np.isin(np.arange(80), (33, 47, 9))  # one of them in a corner
    assert (order_grid(xy[~hidden], size[~hidden], 10, 8) == place[~hidden]).all()
    many = np.isin(np.arange(80), np.arange(22, 80, 6))
    assert (order_grid(xy[~many], size[~many], 10, 8) == -1).all()
    last = row.ravel() == 7
    assert (order_grid(xy[~last], size[~last], 10, 8) == -1).all()


@pytest.mark.parametrize(
    ("target", "option"),
    [
        ("charuco:7x6:DICT_4X4_50:30:22", ["--radii", "1:2:3"]),
        ("aruco:DICT_4X4_50", ["--white-on-black"]),
        ("checkerboard:7x5", ["--smallest-px", "5"]),
        ("circles:6x4", ["--radii", "1:2:3"]),
    ],
)
def test_options_that_do_not_apply_are_refused(
    target: str, option: list[str], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main(["detect", str(tmp_path), "--target", target, *option]) == 2
    assert option[0] in capsys.readouterr().err
