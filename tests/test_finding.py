"""Targets of all kinds and sizes in rendered clutter; boards of OpenCV; numbers that contradict their board."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import IN_FULL

from testfield.bench.clutter import cluttered_view
from testfield.bench.recall import Recall, count, look, take
from testfield.camera.images import SensorSheet
from testfield.camera.photograph import photograph_of
from testfield.detect.circle_grid import order_grid
from testfield.detect.detect import measure_targets
from testfield.detect.identify import identify
from testfield.detect.observations import MEASURED
from testfield.detect.opencv_boards import detect_board
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.errors import TestfieldError
from testfield.seeds import generator
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import RADII, Marks, RingRadii
from testfield.targets.ring_code import code_words, word_of_number

SCENES = Path(__file__).parents[1] / "scenes"
SHEET = SensorSheet(2.6, 2.3, 64.0, 12)


@pytest.mark.parametrize(
    "index", [8, 9, pytest.param(11, marks=pytest.mark.slow), pytest.param(33, marks=pytest.mark.slow)]
)
def test_targets_in_clutter_are_found_and_no_number_is_wrong(index: int) -> None:
    view, recall = cluttered_view(1, index), Recall()
    count(recall, view, look(view, take(view, index)))
    assert recall.clear > 10
    assert recall.right >= 0.97 * recall.clear
    assert recall.wrong == 0


def test_the_count_notices_a_wrong_number_and_a_false_find() -> None:
    view = cluttered_view(1, 15)
    found = look(view, take(view, 15))
    code = found.code.copy()
    code[np.flatnonzero((found.code > 0) & (found.status == MEASURED))[0]] += 1
    recall = Recall()
    count(recall, view, type(found)(**(vars(found) | {"code": code})))
    assert recall.wrong == 1
    recall = Recall()
    count(recall, view, type(found)(**(vars(found) | {"xy_px": found.xy_px + 200.0})))
    assert recall.false > 5


def drawn(
    number: int, bits: int, radii: RingRadii, dot_px: float, squeeze: float = 1.0, blur: float = 0.6, hide: str = ""
) -> np.ndarray:
    """One ring code, white on black, in DN, drawn from its definition: clockwise in the image, first bit first."""
    half = int(dot_px / 2 * (radii.quiet + 0.5))
    fine = 6 if dot_px < 60 else 2
    grid = (np.arange((2 * half + 1) * fine) + 0.5) / fine - 0.5 - half
    x, y = np.meshgrid(grid, grid / squeeze)
    r, turn = np.hypot(x, y) / (dot_px / 2), (np.arctan2(y, x) % (2 * np.pi)) / (2 * np.pi) * bits
    word = int(word_of_number(np.array([number]), bits)[0]) if number else 0
    bit = (word >> (bits - 1 - np.clip(turn.astype(int), 0, bits - 1))) & 1
    ink = (r < 1) | ((r > radii.inner) & (r < radii.outer) & (bit == 1))
    if hide == "half":
        ink &= x > 0.1 * dot_px
    if hide == "ring":
        ink &= (x > -0.8 * dot_px) | (y > 0.07 * dot_px * radii.outer)
    fine_image = cv2.GaussianBlur(ink.astype(np.float32), (0, 0), blur * fine)
    mean = fine_image.reshape(2 * half + 1, fine, 2 * half + 1, fine).mean(axis=(1, 3))
    noise = np.random.default_rng(number).normal(0, 12, mean.shape)
    return (150 + 2500 * mean + noise).astype(np.float32)


@pytest.mark.parametrize("shape", RADII)
@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16, 20])
def test_all_code_lengths_and_shapes_are_read(bits: int, shape: str) -> None:
    numbers = np.linspace(1, len(code_words(bits)), 6).astype(int)
    for number, (dot_px, squeeze) in zip(
        numbers, [(10, 1), (14, 0.6), (30, 0.5), (60, 1), (40, 0.4), (20, 1)], strict=True
    ):
        image = drawn(int(number), bits, RADII[shape], dot_px, squeeze)
        found = measure_targets(image, SHEET, "ellipse_model", 5.0, bits, RADII[shape], by_contour=True)
        good = found.status == "measured"
        assert found.code[good].tolist() == [number], (number, dot_px, squeeze, found.status)
        middle = (image.shape[0] - 1) / 2
        assert np.abs(found.xy_px[good][0] - middle).max() < 0.05
        mirrored = measure_targets(
            np.ascontiguousarray(image[:, ::-1]), SHEET, "ellipse_model", 5.0, bits, RADII[shape], by_contour=True
        )
        back = int(f"{int(code_words(bits)[number - 1]):0{bits}b}"[::-1], 2)
        assert mirrored.code[mirrored.status == "measured"] != number or _same(back, number, bits)


def _same(word: int, number: int, bits: int) -> bool:
    from testfield.targets.ring_code import number_of_word

    return int(number_of_word(np.array([word], np.uint32), bits)[0]) == number


@pytest.mark.parametrize(("dot_px", "blur"), [(6, 0.6), (12, 1.0), (25, 3.0), (90, 1.0), (200, 1.0)])
def test_dots_of_all_sizes_are_found(dot_px: float, blur: float) -> None:
    image = drawn(33, 14, RADII["1:2:3"], dot_px, 1.0, blur)
    found = measure_targets(image, SHEET, "grey_centroid", 5.0, 14, RADII["1:2:3"], by_contour=True)
    good = (found.status == "measured") & (found.code == 33)
    assert good.sum() == 1, found.status
    assert np.abs(found.xy_px[good][0] - (image.shape[0] - 1) / 2).max() < 0.1


@pytest.mark.parametrize("hide", ["half", "ring", "edge"])
def test_hidden_and_cut_targets_are_refused_with_the_reason(hide: str) -> None:
    image = drawn(301, 14, RADII["1:2:3"], 24, hide=hide)
    if hide == "edge":
        image = np.ascontiguousarray(image[:, 38:])
    found = measure_targets(image, SHEET, "ellipse_model", 5.0, 14, RADII["1:2:3"], by_contour=True)
    assert not ((found.status == "measured") & (found.code > 0)).any()
    middle = np.array([(image.shape[0] - 1) / 2 - (38 if hide == "edge" else 0), (image.shape[0] - 1) / 2])
    here = np.linalg.norm(found.xy_px - middle, axis=1) < 8
    assert not (here & (found.status == "measured")).any()
    if hide == "edge":
        assert "ring cut by the image's edge" in found.status[here].tolist()
    if hide == "ring":
        assert "ring cannot be read" in found.status[here].tolist()


def test_a_wrong_number_betrays_itself_by_its_turn() -> None:
    xy = np.stack(np.meshgrid(np.arange(4) * 100.0, np.arange(3) * 100.0), -1).reshape(-1, 2)
    board = NominalBoard("A", Marks(xy, np.full(12, 20.0), np.arange(1, 13)), 0.01, 0.0)
    straight = np.tile(7.0 * np.eye(2), (2, 1, 1))
    found, _, _ = identify(xy[:2] * 0.7, np.array([1, 2]), straight, Field(14, (board,)))
    assert found.tolist() == [0, 0]
    askew = straight.copy()
    askew[1] = 7.0 * np.array([[0.0, 1.0], [-1.0, 0.0]])
    found, _, reason = identify(xy[:2] * 0.7, np.array([1, 2]), askew, Field(14, (board,)))
    assert (found == -1).all()
    assert set(reason) == {"code contradicts its board's layout"}


def test_a_grid_is_ordered_whatever_surrounds_it() -> None:
    rng = np.random.default_rng(2)
    plane = np.stack(np.meshgrid(np.arange(7.0), np.arange(5.0)), -1).reshape(-1, 2)
    H = np.array([[38, 6, 200], [-9, 33, 150], [0.01, 0.02, 1]])
    image = np.column_stack([plane, np.ones(35)]) @ H.T
    image = image[:, :2] / image[:, 2:]
    strays = rng.uniform(0, 700, (40, 2))
    strays = strays[np.linalg.norm(strays[:, None] - image, axis=2).min(axis=1) > 40]
    place = order_grid(np.vstack([strays, image]), np.full(len(strays) + 35, 12.0), 7, 5)
    assert (place[: len(strays)] == -1).all()
    assert place[len(strays) :].tolist() == plane.astype(int).tolist()


def _board_picture(kind: str) -> np.ndarray:
    words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    if kind.startswith("charuco"):
        return cv2.aruco.CharucoBoard((7, 5), 30, 22, words).generateImage((840, 600), marginSize=40)
    if kind.startswith("aruco"):
        return np.pad(cv2.aruco.generateImageMarker(words, 7, 160), 60, constant_values=255)
    if kind.startswith("apriltag"):
        tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        return np.pad(cv2.aruco.generateImageMarker(tags, 7, 160), 60, constant_values=255)
    squares = (np.indices((7, 10)).sum(axis=0) % 2 * 255).astype(np.uint8)
    return np.pad(np.kron(squares, np.ones((50, 50), np.uint8)), 60, constant_values=255)


@pytest.mark.parametrize(
    ("kind", "points"),
    [("charuco:7x5:DICT_4X4_50:30:22", 24), ("aruco:DICT_4X4_50", 4), ("apriltag:36h11", 4), ("checkerboard:9x6", 54)],
)
def test_boards_people_own_are_found(kind: str, points: int) -> None:
    if kind.startswith("apriltag"):
        pytest.importorskip("pupil_apriltags", reason="pupil-apriltags, an extra, is not installed")
    picture = cv2.GaussianBlur(_board_picture(kind), (0, 0), 0.8)
    found = detect_in_photograph(photograph_of("board", picture), parse_target(kind))
    assert len(found.observations) == points
    xy = found.observations.xy_px
    if kind.startswith(("aruco", "apriltag")):
        assert set(found.observations.code) == {7}
        # A square drawn on whole pixels has its edges half-way between pixel centres.
        assert np.abs(np.sort(np.unique(np.rint(2 * xy) / 2)) - [59.5, 219.5]).max() <= 0.5
        assert np.abs(xy.mean(axis=0) - 139.5).max() < 0.15  # half a pixel off would show
    if kind.startswith("checkerboard"):
        steps = (xy + 0.5 - 60) / 50
        assert np.abs(steps - np.rint(steps)).max() < 0.01


def test_an_unknown_dictionary_is_named() -> None:
    with pytest.raises(TestfieldError, match="DICT_9X9"):
        detect_board(np.zeros((50, 50), np.float32), parse_target("aruco:DICT_9X9"))


def test_a_kind_of_target_that_lacks_its_sizes_is_told_which_and_families_have_two_names() -> None:
    with pytest.raises(TestfieldError, match=r"all that is needed.*like charuco:7x5:DICT_4X4_50:30:22$"):
        parse_target("charuco:7x5")
    families = {parse_target(f"apriltag:{name}").dictionary for name in ("36h11", "tag36h11", "DICT_APRILTAG_36h11")}
    assert families == {"36h11"}


def test_a_photograph_of_nothing_says_so_and_one_of_targets_how_well_the_model_fits() -> None:
    empty = photograph_of("empty", np.full((80, 80), 30, np.uint8))
    assert "0 measured; nothing there looks like one" in detect_in_photograph(empty, parse_target("ring14")).summary
    picture = np.full((80, 80), 30.0)
    cv2.circle(picture, (40, 40), 12, 200.0, -1)
    picture = cv2.GaussianBlur(picture, (0, 0), 1.0) + generator(0, "a dot").normal(0, 2, picture.shape)
    dot = photograph_of("dot", picture.round().astype(np.uint8))
    assert "1 measured; median chi-squared of the model" in detect_in_photograph(dot, parse_target("circles")).summary


def test_a_scene_may_have_wide_rings(tmp_path: Path) -> None:
    from testfield.scene.build import build_world
    from testfield.scene.load import load_scene

    text = IN_FULL.read_text()
    scene = tmp_path / "wide.toml"
    scene.write_text(text.replace("seed = 7", 'seed = 7\ncode_radii = "1:2.5:4"'))
    world, usual = build_world(load_scene(scene)), build_world(load_scene(SCENES / "quick.toml"))
    assert world.marks.radii == RADII["1:2.5:4"]
    coded = world.marks.code > 0
    assert np.allclose(world.marks.printed_radius_mm[coded], usual.marks.printed_radius_mm[coded] * 4 / 3)
    world.field.save(tmp_path / "field.json")
    assert Field.load(tmp_path / "field.json").code_radii == "1:2.5:4"
