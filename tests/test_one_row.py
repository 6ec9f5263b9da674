"""One dot, one row: no two rows of an image lie within a dot's radius of each other."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

from testfield.camera.photograph import photograph_of
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.one_row import first_rows
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.target_spec import parse_target

PLATE = Path(__file__).parents[1] / "../shared/real/ring14_plate/plate_0005.png"


def pairs(o: Observations) -> int:
    """How many pairs of rows share a dot."""
    there = np.isfinite(o.xy_px).all(axis=1) & np.isfinite(o.diameter_px)
    xy, radius = o.xy_px[there], o.diameter_px[there] / 2
    return sum(len(hits) - 1 for hits in cKDTree(xy).query_ball_point(xy, radius))


def test_the_row_that_was_read_stays_and_then_the_one_that_was_measured() -> None:
    xy = np.array([[10.0, 10], [10.2, 10], [11, 10], [40, 40], [43, 40], [np.nan, 0]])
    code = np.array([0, 7, 0, 0, 0, 0])
    status = np.array([MEASURED, MEASURED, "too small", "too small", MEASURED, MEASURED], object)
    kept = first_rows(xy, np.array([8.0, 8, 8, 3, 8, 8]), code, status, np.ones(6))
    assert kept.tolist() == [1, 4, 5]


@pytest.mark.parametrize("seed", [1, 2])
def test_clutter_gives_one_row_a_blob(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = sum(s * cv2.GaussianBlur(rng.normal(0, 40, (500, 600)), (0, 0), s) for s in (2, 5, 9))
    for x, y in rng.uniform(40, 460, (25, 2)):
        cv2.circle(image, (round(x), round(y)), int(rng.integers(4, 30)), 120, -1, cv2.LINE_AA)
    image = np.clip(cv2.GaussianBlur(image, (0, 0), 1) + 60 + rng.normal(0, 1, image.shape), 0, 255).astype(np.uint8)
    found = detect_in_photograph(photograph_of("clutter", image), parse_target("circles")).observations
    assert len(found) > 20
    assert pairs(found) == 0


@pytest.mark.skipif(not PLATE.is_file(), reason="the real photographs (../shared/real) are not here")
def test_a_real_plate_gives_one_row_a_blob() -> None:
    image = cv2.imread(str(PLATE), cv2.IMREAD_UNCHANGED)[300:900, 300:1300]
    found = detect_in_photograph(photograph_of("plate", image), parse_target("ring14")).observations
    assert (found.status == MEASURED).sum() > 20
    assert pairs(found) == 0
