"""Grids of squares that do not touch: found, named by their places, and measured free of what moves edges alike."""

import cv2
import numpy as np
import pytest

from testfield.bench.drawn_boards import View, draw
from testfield.camera.photograph import photograph_of
from testfield.detect.edge_shift import edge_shift
from testfield.detect.observations import MEASURED
from testfield.detect.photograph import Found, detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.errors import TestfieldError
from testfield.measure.patterns import board_pattern
from testfield.targets.board_pattern import BoardPattern

TARGET = parse_target("squares:7x5:22:13")
GRID = board_pattern(TARGET)
SQUARE_PX = 22.0


def picture(tilt_deg: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """An image (h, w) uint8 and where its corners (n, 2) are."""
    drawn = draw(TARGET, GRID, GRID.mark_mm, View(SQUARE_PX, tilt_deg, 60.0, 0.7), seed)
    return drawn.image, drawn.xy_px


def found_in(image: np.ndarray) -> Found:
    return detect_in_photograph(photograph_of("one", image), TARGET)


@pytest.mark.parametrize("tilt_deg", [0, 30, 50])
def test_every_corner_is_where_it_was_drawn(tilt_deg: float) -> None:
    image, xy = picture(tilt_deg)
    o = found_in(image).observations
    assert sorted(o.point.tolist()) == list(range(len(xy)))
    off = o.xy_px - xy[o.point]
    assert (o.status == MEASURED).mean() > 0.97
    assert np.abs(off).max() < 0.15  # none is a neighbour's
    assert np.sqrt((off**2).mean()) < 0.03


def test_the_middles_of_a_board_turned_by_a_lens_are_told_alike() -> None:
    image, xy = picture(20)
    bent = cv2.remap(image, *_barrel(image.shape), cv2.INTER_CUBIC)
    o = found_in(bent).observations
    assert sorted(o.point.tolist()) == list(range(len(xy)))
    came_from = [_at(one, o.xy_px) for one in _barrel(image.shape)]
    assert np.abs(np.column_stack(came_from) - xy[o.point]).max() < 1.5


@pytest.mark.parametrize("columns,rows", [(7, 4), (6, 5), (8, 5)])
def test_a_grid_of_another_size_is_not_found(columns: int, rows: int) -> None:
    other = parse_target(f"squares:{columns}x{rows}:22:13")
    image, _ = picture(20)
    assert not len(detect_in_photograph(photograph_of("one", image), other).observations)


def test_edges_that_a_tone_curve_moves_leave_the_corners_where_they_are() -> None:
    image, xy = picture(30)
    bright = 255 * (image / 255.0) ** 0.55  # half way between black and white lies farther in
    o = found_in(bright.round().astype(np.uint8)).observations
    good = o.status == MEASURED
    off = o.xy_px[good] - xy[o.point[good]]
    middle = xy.reshape(-1, 4, 2).mean(axis=1)[o.point[good] // 4]
    outwards = ((o.xy_px[good] - middle) * off).sum(axis=1) / np.linalg.norm(o.xy_px[good] - middle, axis=1)
    assert good.mean() > 0.9
    assert abs(np.median(outwards)) < 0.01


def test_corners_beside_hidden_ones_are_freed_of_the_shift_as_all_others() -> None:
    image, xy = picture(30)
    bright = (255 * (image / 255.0) ** 0.55).round().astype(np.uint8)
    for x, y in np.rint(xy[::12]).astype(int):
        cv2.circle(bright, (int(x) + 2, int(y)), 2, 120, -1)
    o = found_in(bright).observations
    good = o.status == MEASURED
    partly = good & (np.bincount(o.point[good] // 4, minlength=len(xy) // 4)[o.point // 4] < 4)
    assert partly.sum() > 20
    from_middle = o.xy_px - xy.reshape(-1, 4, 2).mean(axis=1)[o.point // 4]
    outwards = ((o.xy_px - xy[o.point]) * from_middle).sum(axis=1) / np.linalg.norm(from_middle, axis=1)
    assert abs(np.median(outwards[partly])) < 0.02


@pytest.mark.parametrize("shift_px", [0.0, 0.25, -0.1])
def test_the_shift_of_edges_is_the_one_that_was_put_in(shift_px: float) -> None:
    H = np.array([[1.5, 0.2, 200.0], [0.1, -1.4, 150.0], [2e-4, 1e-4, 1.0]])
    corners = GRID.points_mm.reshape(-1, 4, 2)
    seen = cv2.perspectiveTransform(corners.reshape(1, -1, 2), H).reshape(-1, 4, 2)
    side = np.roll(seen, -1, axis=1) - seen
    normal = np.stack([side[..., 1], -side[..., 0]], axis=-1) / np.linalg.norm(side, axis=2)[..., None]
    for square, out in zip(seen, normal, strict=True):
        lines = [np.array([*n, -(n @ p) - shift_px]) for n, p in zip(out, square.copy(), strict=True)]
        crossings = [np.cross(lines[k - 1], lines[k]) for k in range(4)]
        square[:] = [c[:2] / c[2] for c in crossings]
    shift, _, away = edge_shift(corners, seen)
    assert shift == pytest.approx(shift_px, abs=1e-3)
    assert np.allclose(seen - away, cv2.perspectiveTransform(corners.reshape(1, -1, 2), H).reshape(-1, 4, 2), atol=3e-3)


def test_squares_that_overlap_are_refused() -> None:
    with pytest.raises(TestfieldError, match="overlap"):
        parse_target("squares:7x5:13:22")


def test_the_print_has_white_between_all_squares() -> None:
    pattern = BoardPattern("squares", 3, 2, 20.0, 8.0)
    cells = pattern.cells
    assert cells.black.shape == (3, 5)
    assert cells.black.sum() == 6
    corners = pattern.points_mm.reshape(-1, 4, 2)
    middles = corners.mean(axis=1)
    assert cells.at(middles[:, None] + 0.999 * (corners - middles[:, None])).all()
    assert not cells.at(middles[:, None] + 1.001 * (corners - middles[:, None])).any()
    assert cells.at(middles).all()
    assert not cells.at((middles[0] + middles[1]) / 2)


def _at(values: np.ndarray, xy_px: np.ndarray) -> np.ndarray:
    """(n,) values (h, w) at the pixels that places (n, 2) lie in."""
    column, row = np.rint(xy_px).astype(int).T
    return np.asarray(values[row, column])


def _barrel(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Where each pixel of an image with barrel distortion comes from."""
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    middle = np.array([shape[1] / 2, shape[0] / 2], np.float32)
    r2 = ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / (middle**2).sum()
    return middle[0] + (x - middle[0]) * (1 + 0.12 * r2), middle[1] + (y - middle[1]) * (1 + 0.12 * r2)
