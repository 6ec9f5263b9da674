"""Where two programs do one thing, they agree: which corner is which, what comes first, where a pixel's middle is."""

import cv2
import numpy as np
import pytest

from testfield.camera.images import SensorSheet
from testfield.detect import opencv_boards
from testfield.detect.circle_grid import order_grid
from testfield.detect.eight_bits import pictures
from testfield.detect.opencv_boards import Corners, detect_board
from testfield.detect.target_spec import parse_target
from testfield.registry import find, names
from testfield.simulate.board_image import draw_board, facing
from testfield.targets.board_pattern import BoardPattern

FAMILIES = ("16h5", "25h9", "36h10", "36h11")
SIZE = (250, 230)


def tag(family: str, number: int, turn_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """A drawn tag, and where its corners (4, 2) are in the order of the field sheet."""
    pattern = BoardPattern("tags", 1, 1, 200, 100.0, f"DICT_APRILTAG_{family}", number)
    to_px = facing(1.3, (125.3, 114.8), turn_deg, 2e-4)
    corners = cv2.perspectiveTransform(pattern.points_mm[None], to_px)[0]
    return draw_board(pattern, SIZE, to_px), corners


@pytest.mark.parametrize("turn_deg", [4, 94, 184, 274])
@pytest.mark.parametrize("family", FAMILIES)
def test_both_april_tag_libraries_number_corners_as_the_field_sheet(
    family: str, turn_deg: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    image, corners = tag(family, 7, turn_deg)
    target = parse_target(f"apriltag:{family}")
    found = {"as installed": detect_board(image.astype(np.float32), target)}
    monkeypatch.setattr(opencv_boards, "pupil", lambda _: None)
    found["OpenCV"] = detect_board(image.astype(np.float32), target)
    for name, one in found.items():
        assert one.code.tolist() == [7] * 4, name
        assert np.abs(one.xy_px - corners[one.point]).max() < 0.5, name
        assert np.abs((one.xy_px - corners[one.point]).mean(axis=0)).max() < 0.1, name


@pytest.mark.parametrize("family", ["16h5", "25h9", "36h11"])
def test_the_library_that_invented_the_tags_is_asked_where_it_is_installed(family: str) -> None:
    pytest.importorskip("pupil_apriltags")
    found = detect_board(tag(family, 3, 20)[0].astype(np.float32), parse_target(f"apriltag:{family}"))
    assert "by pupil-apriltags" in found.notes


def board_px(turn_deg: float) -> tuple[np.ndarray, np.ndarray]:
    pattern = BoardPattern("checkerboard", 8, 5, 20.0)
    to_px = facing(1.2, (125.2, 115.4), turn_deg, 3e-4)
    return draw_board(pattern, SIZE, to_px), cv2.perspectiveTransform(pattern.points_mm[None], to_px)[0]


@pytest.mark.parametrize("turn_deg", [0, 10, 190])
def test_both_checkerboard_finders_of_opencv_mean_the_same_pixels(turn_deg: float) -> None:
    image, true = board_px(turn_deg)
    ours = detect_board(image.astype(np.float32), parse_target("checkerboard:7x4")).xy_px
    found, classic = cv2.findChessboardCorners(next(pictures(image.astype(np.float32))), (7, 4))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    assert found
    classic = cv2.cornerSubPix(image.astype(np.float32), classic, (4, 4), (-1, -1), stop).reshape(-1, 2)
    for corners in (ours, classic):
        near = np.linalg.norm(corners[:, None] - true, axis=2)
        assert sorted(near.argmin(axis=1)) == list(range(28))
        assert np.abs((corners - true[near.argmin(axis=1)]).mean(axis=0)).max() < 0.05


def drawn_dots(xy: np.ndarray, diameter: float, size: tuple[int, int]) -> np.ndarray:
    y, x = (np.mgrid[0 : 4 * size[1], 0 : 4 * size[0]] + 0.5) / 4 - 0.5
    inside = np.min([np.hypot(x - a, y - b) for a, b in xy], axis=0) < diameter / 2
    share = cv2.GaussianBlur(cv2.resize(inside.astype(float), size, interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    return 200 - 170 * share


def test_our_grid_of_circles_and_opencvs_hold_the_same_dots() -> None:
    xy = np.stack(np.meshgrid(40.3 + 32 * np.arange(6), 45.1 + 32 * np.arange(4)), -1).reshape(-1, 2)
    image = drawn_dots(xy, 15, (260, 190))
    place = order_grid(xy, np.full(24, 15.0), 6, 4)
    found, centres = cv2.findCirclesGrid(next(pictures(image.astype(np.float32))), (6, 4))
    assert found
    assert place[:, 1].tolist() == np.repeat(np.arange(4), 6).tolist()
    centres = centres.reshape(-1, 2)
    order = centres if np.linalg.norm(centres[0] - xy[0]) < 5 else centres[::-1]
    assert np.abs(order - xy).max() < 0.3
    assert np.abs((order - xy).mean(axis=0)).max() < 0.05


def test_all_centroid_estimators_mean_the_same_pixels() -> None:
    """A centre in the middle of the first pixel is at 0, not at a half: an estimator that counts otherwise is found."""
    rng = np.random.default_rng(4)
    xy = np.stack(np.meshgrid(40 + 36 * np.arange(5), 40 + 36 * np.arange(4)), -1).reshape(-1, 2) + rng.random((20, 2))
    bright = (230 - drawn_dots(xy, 14, (230, 190))).astype(np.float32)
    sheet = SensorSheet(20.0, 5.0, 0.0, 8)
    moments = np.tile(np.eye(2) * (14 / 4) ** 2, (20, 1, 1))
    for name in names("centroids"):
        centres = find("centroids", name)(bright, sheet, np.rint(xy), moments)
        assert centres.ok.mean() > 0.9, name
        assert np.abs((centres.xy_px - xy)[centres.ok].mean(axis=0)).max() < 0.05, name


def test_a_lamp_hides_no_board_however_bright_and_near() -> None:
    pattern = BoardPattern("charuco", 7, 5, 28.0, 21.0, "DICT_5X5_100")
    image = draw_board(pattern, (400, 320), facing(1.6, (200, 160), 8, 3e-4), fine=4, black_and_white=(300, 1800))
    image += np.random.default_rng(1).normal(0, 12, image.shape)
    y, x = np.mgrid[:320, :400]
    lamp = np.hypot(x - 385, y - 20) < 28
    circumstances = {
        "a lamp": np.where(lamp, 60000, image),
        "a black corner under haze": np.where(lamp, 0, image + 40000),
        "light that falls off": image * np.exp(x / 120),
        "8 bits": np.where(lamp, 255, np.rint(image / 150)),
    }
    for name, pixels in circumstances.items():
        found: Corners = detect_board(pixels.astype(np.float32), parse_target("charuco:7x5:DICT_5X5_100:28:21"))
        assert sorted(found.point) == list(range(24)), name
