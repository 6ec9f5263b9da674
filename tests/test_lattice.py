"""Smooth light between rays: what is straight costs a sixteenth of the rays, what is not gets them all."""

from collections.abc import Callable

import numpy as np
import pytest

from testfield.render.lattice import BOW, STEP_PX, smooth_pixels

SHAPE = (203, 301)
NONE = np.zeros(SHAPE, bool)
Light = Callable[[np.ndarray, np.ndarray], np.ndarray]
ROUNDING = 3e-7


def seen(light: Light, crossed: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Smooth pixels of a light, the light itself there, and how many rays it took."""
    rays = 0

    def ray(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        nonlocal rays
        rays += len(row)
        return light(row.astype(float), column.astype(float)).astype(np.float32)

    found = smooth_pixels(ray, crossed)
    return found, np.where(crossed, 0, light(*np.indices(crossed.shape).astype(float))), rays


def test_straight_light_is_exact_and_takes_few_rays() -> None:
    found, true, rays = seen(lambda row, column: 1 + 1e-3 * row - 2e-3 * column + 1e-6 * row * column, NONE)
    assert np.abs(found / true - 1).max() < ROUNDING
    assert rays < 0.15 * found.size


@pytest.mark.parametrize("turn_rad", [0.0, 0.4, np.pi / 2])
@pytest.mark.parametrize("step", [1e-7, 3e-6, 1e-5, 1e-3])
def test_light_with_a_kink_is_off_by_half_of_what_is_allowed_at_most(step: float, turn_rad: float) -> None:
    def light(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        along = np.cos(turn_rad) * (column - 150.3) + np.sin(turn_rad) * (row - 101.6)
        return 1 + step * np.maximum(along, 0)

    found, true, rays = seen(light, NONE)
    # Both ways at once where the kink is aslant.
    assert np.abs(found / true - 1).max() < BOW + ROUNDING
    assert rays < 0.3 * found.size


def test_light_that_bows_evenly_is_off_by_an_eighth_both_ways() -> None:
    bow = 0.9 * BOW / STEP_PX**2
    found, true, rays = seen(lambda row, column: 1 + bow / 2 * ((row - 100) ** 2 + (column - 150) ** 2), NONE)
    assert rays < 0.15 * found.size
    assert np.abs(found / true - 1).max() < BOW / 4 + ROUNDING


def test_light_that_bows_more_is_seen_pixel_by_pixel() -> None:
    found, true, rays = seen(lambda row, column: 2 + np.sin(row / 9) * np.cos(column / 7), NONE)
    assert np.abs(found / true - 1).max() < BOW + ROUNDING
    assert rays > 0.9 * found.size


def test_nothing_is_carried_across_what_an_edge_crosses() -> None:
    """Dark discs on light ground, outlined: one that no node sees is crossed all the same."""
    row, column = np.indices(SHAPE)
    off = np.hypot(row - 61, column - 77), np.hypot(row - 130.6, column - 202.4) - 40
    disc = (off[0] < 1.3) | (off[1] < 0)
    crossed = (off[0] < 3.0) | (np.abs(off[1]) < 1.6)

    def light(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return np.where(disc[row.astype(int), column.astype(int)], 0.1, 0.8)

    found, true, rays = seen(light, crossed)
    assert (np.abs(found - true) < ROUNDING).all()
    assert (found[crossed] == 0).all()
    assert rays < 0.4 * found.size


@pytest.mark.parametrize("shape", [(1, 1), (3, 50), (8, 9), (9, 9), (10, 13)])
def test_images_of_any_size_are_whole(shape: tuple[int, int]) -> None:
    found, true, _ = seen(lambda row, column: 1 + 1e-4 * row + 1e-3 * column, np.zeros(shape, bool))
    assert np.abs(found - true).max() < ROUNDING


def test_a_lamp_in_view_makes_nothing_else_coarser() -> None:
    def light(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return np.where(column > 240, 1e5, 1 + 0.2 * np.sin(row / 9))

    crossed = np.abs(np.indices(SHAPE)[1] - 240.5) < 2
    found, true, _ = seen(light, crossed)
    assert np.abs(found - true)[~crossed & (true < 2)].max() < 2 * BOW


def test_where_edges_are_everywhere_no_ray_is_cast() -> None:
    found, _, rays = seen(lambda row, column: 1 + row, np.ones(SHAPE, bool))
    assert rays == 0 and not found.any()
