"""Blobs from runs along the rows are OpenCV's connected components."""

import cv2
import numpy as np
import pytest

from testfield.camera.images import SensorSheet
from testfield.detect.find import _halved, find_blobs
from testfield.detect.runs import Runs, runs_above

SHEET = SensorSheet(2.6, 2.3, 64.0, 12)


def runs_of(mask: np.ndarray) -> Runs:
    """Those of the pixels that exceed a threshold of one half."""
    h, w = mask.shape
    return runs_above(mask, np.full((max(h // 2, 1), max(w // 2, 1)), 0.5, np.float32), 1, (0.0, 0.0, 0.0))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.6, 0.9, 1.0])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (61, 97)])
def test_runs_make_up_the_components_that_opencv_finds(shape: tuple[int, int], share: float) -> None:
    mask = (np.random.default_rng(3).random(shape) < share).astype(np.uint8)
    runs = runs_of(mask)
    n, labels, stats, centres = cv2.connectedComponentsWithStats(mask, connectivity=4)
    assert runs.length.sum() == mask.sum()
    if n == 1:
        assert len(runs.blob) == 0
        return
    theirs = np.zeros(n - 1, int)
    theirs[runs.blob] = labels[runs.row, runs.first]
    assert sorted(theirs) == list(range(1, n))
    blobs = runs.sums()
    left, top, right, bottom = blobs.left, blobs.top, blobs.right, blobs.bottom
    np.testing.assert_array_equal(np.column_stack([left, top, right - left, bottom - top]), stats[theirs, :4])
    np.testing.assert_array_equal(blobs.area, stats[theirs, 4])
    np.testing.assert_allclose(np.column_stack([blobs.x, blobs.y]), centres[theirs], atol=1e-9)
    largest = int(np.argmax(blobs.area))
    rows, columns = np.nonzero(labels == theirs[largest])
    truth = np.cov(np.stack([columns, rows]), bias=True) + np.eye(2) / 12
    np.testing.assert_allclose(
        [[blobs.xx[largest], blobs.xy[largest]], [blobs.xy[largest], blobs.yy[largest]]], truth, atol=1e-9
    )


@pytest.mark.parametrize("width", [1, 3, 9, 21])
@pytest.mark.parametrize("shape", [(64, 80), (65, 81), (131, 44), (2, 2), (3, 2)])
def test_the_threshold_is_the_mean_of_the_neighbourhood_and_the_noise_of_that(
    shape: tuple[int, int], width: int
) -> None:
    h, w = shape
    image = np.random.default_rng(5).random(shape, np.float32)
    half = _halved(image)
    width = min(width, 2 * min(half.shape) - 1)
    mean = cv2.blur(half, (width, width), borderType=cv2.BORDER_REFLECT)
    small = mean + np.sqrt(0.01 + np.maximum(0.05 * (mean - 0.5), 0))
    whole = cv2.resize(small, (2 * half.shape[1], 2 * half.shape[0]), interpolation=cv2.INTER_LINEAR)
    whole = cv2.copyMakeBorder(whole, 0, h - len(whole), 0, w - whole.shape[1], cv2.BORDER_REPLICATE)
    sure = np.abs(image - whole) > 1e-5  # single precision
    assert sure.mean() > 0.99
    mask = np.zeros(shape, bool)
    runs = runs_above(image, half, width, (0.01, 0.05, 0.5))
    for row, first, length in zip(runs.row, runs.first, runs.length, strict=True):
        mask[row, first : first + length] = True
    np.testing.assert_array_equal(mask[sure], (image > whole)[sure])
    assert len(half) < 8 or 0.05 < mask.mean() < 0.6


def test_what_is_found_does_not_depend_on_what_lies_far_above() -> None:
    y, x = np.mgrid[:301, :403]
    image = 200 + 1500 / (1 + np.exp(np.hypot(x % 50 - 25.3, y % 43 - 21.6) - 6))
    image = (image + np.random.default_rng(6).normal(0, 10, image.shape)).astype(np.float32)
    usual = find_blobs(image, SHEET, 5.0, 60.0)
    assert len(usual) >= 8 * 7
    above = np.random.default_rng(7).uniform(0, 4095, (200, 403)).astype(np.float32)
    moved = find_blobs(np.concatenate([above, image]), SHEET, 5.0, 60.0)
    for xy in usual.xy_px[usual.xy_px[:, 1] > 60]:
        assert np.abs(moved.xy_px - [0, 200] - xy).sum(axis=1).min() < 1e-4


def test_a_pixel_more_or_less_is_noticed() -> None:
    mask = np.zeros((9, 9), np.uint8)
    mask[2:6, 3:7] = 1
    area = runs_of(mask).sums().area
    mask[6, 3] = 1
    assert runs_of(mask).sums().area == area + 1
    mask[6, 3], mask[6, 7] = 0, 1  # only a corner is shared
    np.testing.assert_array_equal(runs_of(mask).sums().area, [16, 1])
