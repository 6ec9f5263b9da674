"""Blobs from runs along the rows are OpenCV's connected components."""

import cv2
import numpy as np
import pytest

from testfield.camera.images import SensorSheet
from testfield.detect import find
from testfield.detect.find import _doubled, _halved, find_blobs
from testfield.detect.runs import Runs, changes, empty_mask, runs_between

SHEET = SensorSheet(2.6, 2.3, 64.0, 12)


def runs_of(mask: np.ndarray) -> Runs:
    line, inside = empty_mask(*mask.shape)
    inside[:] = mask
    return runs_between(changes(line), mask.shape[1])


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
    left, top, right, bottom = runs.box()
    np.testing.assert_array_equal(np.column_stack([left, top, right - left, bottom - top]), stats[theirs, :4])
    np.testing.assert_array_equal(runs.area(), stats[theirs, 4])
    x, y, xx, xy, yy = runs.moments()
    np.testing.assert_allclose(np.column_stack([x, y]), centres[theirs], atol=1e-9)
    largest = int(np.argmax(runs.area()))
    rows, columns = np.nonzero(labels == theirs[largest])
    truth = np.cov(np.stack([columns, rows]), bias=True) + np.eye(2) / 12
    np.testing.assert_allclose([[xx[largest], xy[largest]], [xy[largest], yy[largest]]], truth, atol=1e-9)


def test_only_the_kept_blobs_stay_and_in_their_order() -> None:
    mask = (np.random.default_rng(4).random((50, 60)) < 0.4).astype(np.uint8)
    runs = runs_of(mask)
    keep = runs.area() > 5
    np.testing.assert_array_equal(runs.only(keep).area(), runs.area()[keep])
    for kept, every in zip(runs.only(keep).moments(), runs.moments(), strict=True):
        np.testing.assert_array_equal(kept, every[keep])


@pytest.mark.parametrize("shape", [(64, 80), (65, 81), (131, 40), (3, 2)])
def test_bands_of_the_doubled_image_are_those_of_the_whole(shape: tuple[int, int]) -> None:
    h, w = shape
    half = _halved(np.random.default_rng(5).random(shape, np.float32))
    whole = _doubled(half, slice(0, h), w)
    assert whole.shape == shape
    for band in (2, 16, 64):
        parts = [_doubled(half, slice(top, min(top + band, h)), w) for top in range(0, h, band)]
        np.testing.assert_allclose(np.concatenate(parts), whole, atol=1e-6)  # single precision


@pytest.mark.parametrize("band", [2, 16, 4096])
def test_what_is_found_does_not_depend_on_the_bands(band: int, monkeypatch: pytest.MonkeyPatch) -> None:
    y, x = np.mgrid[:301, :403]
    image = 200 + 1500 / (1 + np.exp(np.hypot(x % 50 - 25.3, y % 43 - 21.6) - 6))
    image = (image + np.random.default_rng(6).normal(0, 10, image.shape)).astype(np.float32)
    usual = find_blobs(image, SHEET, 5.0, 60.0)
    assert len(usual) >= 8 * 7
    monkeypatch.setattr(find, "BAND_ROWS", band)
    banded = find_blobs(image, SHEET, 5.0, 60.0)
    np.testing.assert_array_equal(usual.xy_px, banded.xy_px)
    np.testing.assert_array_equal(usual.moments_px2, banded.moments_px2)


def test_a_pixel_more_or_less_is_noticed() -> None:
    mask = np.zeros((9, 9), np.uint8)
    mask[2:6, 3:7] = 1
    area = runs_of(mask).area()
    mask[6, 3] = 1
    assert runs_of(mask).area() == area + 1
    mask[6, 3], mask[6, 7] = 0, 1  # only a corner is shared
    np.testing.assert_array_equal(runs_of(mask).area(), [16, 1])
