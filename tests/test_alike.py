"""Marks of one board vouch for each other's shape."""

import numpy as np

from testfield.camera.plane_image import PlaneImage
from testfield.camera.rough_lens import RoughLens
from testfield.detect.alike import unlike_neighbours

HOMOGRAPHY = np.array([[0.31, 0.04, 400.0], [-0.05, 0.27, 300.0], [1e-4, 6e-5, 1.0]])
DIAMETER_MM = np.full(80, 24.0)


def _board(bow: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A board of 10 x 8 dots seen obliquely, bent so that its dots narrow by `bow` towards one side."""
    x, y = np.meshgrid(75.0 * np.arange(10), 75.0 * np.arange(8))
    xy_mm = np.column_stack([x.ravel(), y.ravel()])
    mapped = np.column_stack([xy_mm, np.ones(80)]) @ HOMOGRAPHY.T
    J = PlaneImage(HOMOGRAPHY, RoughLens.pinhole(np.zeros(2), 1.0)).maps(xy_mm) * (1 + bow * xy_mm[:, :1, None] / 675)
    moments = (DIAMETER_MM**2 / 16)[:, None, None] * J @ np.swapaxes(J, 1, 2)
    return xy_mm, mapped[:, :2] / mapped[:, 2:], moments, np.tile(1e-5 * np.eye(2), (80, 1, 1))


def test_dots_that_are_seen_whole_are_alike_on_flat_and_bent_boards() -> None:
    for bow in (0.0, 0.4):
        xy_mm, xy_px, moments, cov = _board(bow)
        assert not unlike_neighbours(xy_mm, DIAMETER_MM, xy_px, moments, cov).any()


def test_what_an_edge_leaves_of_dots_is_unlike_the_whole_ones_around() -> None:
    xy_mm, xy_px, moments, cov = _board()
    hidden = np.isin(np.arange(80), [23, 24, 25])  # a dark bar across three neighbours
    cut = np.diag([1.0, 0.38])
    moments[hidden] = cut @ moments[hidden] @ cut
    assert (unlike_neighbours(xy_mm, DIAMETER_MM, xy_px, moments, cov) == hidden).all()


def test_a_dot_too_noisy_to_know_its_size_is_not_refused_for_it() -> None:
    xy_mm, xy_px, moments, cov = _board()
    moments[40] *= 1.5
    cov[40] = 0.25 * np.eye(2)
    assert not unlike_neighbours(xy_mm, DIAMETER_MM, xy_px, moments, cov)[40]
