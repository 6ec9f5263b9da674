"""Dots of hexagonal grids get their numbers, whichever way the grid lies and whatever lies beside it."""

import numpy as np
import pytest

from testfield.detect.hexagonal_grid import order_hexagonal
from testfield.targets.board_pattern import BoardPattern

HOMOGRAPHY = np.array([[1.0, 0.12, 300], [-0.08, 0.9, 250], [4e-4, -6e-4, 1.0]])


def seen(pattern: BoardPattern, turn_deg: float, mirrored: bool = False) -> np.ndarray:
    """(n, 2) px of the grid's dots, turned and in perspective."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    xy = pattern.points_mm * [-1 if mirrored else 1, -1] @ np.array([[c, -s], [s, c]]).T
    lifted = np.column_stack([xy, np.ones(len(xy))]) @ HOMOGRAPHY.T
    return np.asarray(lifted[:, :2] / lifted[:, 2:])


@pytest.mark.parametrize("turn_deg", range(0, 360, 24))
def test_every_dot_gets_its_place_whichever_way_the_grid_lies(turn_deg: int) -> None:
    pattern = BoardPattern("hexcircles", 6, 7, 20.0, 16.0)
    xy = seen(pattern, turn_deg)
    shuffled = np.random.default_rng(turn_deg).permutation(len(xy))
    strays = np.array([[20.0, 20.0], [700.0, 60.0]])
    place = order_hexagonal(np.vstack([xy[shuffled], strays]), np.full(len(xy) + 2, 10.0), 6, 7)
    number = np.where(place[:, 0] >= 0, place[:, 1] * 6 + place[:, 0], -1)
    assert (number[-2:] == -1).all()
    assert number[:-2].tolist() == shuffled.tolist()


def test_of_an_even_number_of_rows_the_end_nearest_to_the_top_left_is_the_first() -> None:
    pattern = BoardPattern("hexcircles", 6, 8, 20.0, 16.0)
    for turn_deg in (10, 190):
        xy = seen(pattern, turn_deg)
        place = order_hexagonal(xy, np.full(len(xy), 10.0), 6, 8)
        number = place[:, 1] * 6 + place[:, 0]
        assert sorted(number) == list(range(48))
        assert xy[number == 0].sum() < xy[number == 47].sum()


def test_a_grid_of_another_size_and_one_with_a_gap_are_not_numbered() -> None:
    pattern = BoardPattern("hexcircles", 6, 7, 20.0, 16.0)
    xy = seen(pattern, 5)
    diameter = np.full(len(xy), 10.0)
    assert (order_hexagonal(xy, diameter, 7, 6) == -1).all()
    assert (order_hexagonal(xy, diameter, 5, 6) == -1).all()
    assert (order_hexagonal(np.delete(xy, 17, axis=0), diameter[1:], 6, 7) == -1).all()
