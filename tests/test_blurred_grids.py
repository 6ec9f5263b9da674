"""Dots as blurred as they are wide are measured where they fill the grid that was asked for; squares never do."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from testfield.bench.drawn_boards import View
from testfield.bench.recall_kinds import KINDS, drawn, scored
from testfield.camera.photograph import Photograph
from testfield.detect.observations import MEASURED, READ
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.target_spec import parse_target

KIND = next(kind for kind in KINDS if kind.name == "circles")
SPEC = parse_target(KIND.word)


@pytest.mark.parametrize(
    ("size_px", "blur_px"),
    [(7.0, 2.0), pytest.param(7.0, 1.2, marks=pytest.mark.slow), pytest.param(10.0, 3.0, marks=pytest.mark.slow)],
)
def test_every_dot_of_a_blurred_grid_is_found_and_as_near_as_it_states(size_px: float, blur_px: float) -> None:
    picture = drawn(KIND, replace(View(size_px), blur_px=blur_px), 1)
    found = detect_in_photograph(Photograph("drawn", picture.image.astype(np.float32), 8, ()), SPEC).observations
    found = found.take(np.isin(found.status.astype(str), (MEASURED, READ)))
    assert scored(KIND, picture, (found.point, found.xy_px)).tolist() == [35, 35, 0]
    found = found.take(found.status == MEASURED)
    error = found.xy_px - picture.xy_px[np.linalg.norm(found.xy_px[:, None] - picture.xy_px, axis=2).argmin(axis=1)]
    assert np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_px2), error).mean() / 2 < 1.5


def test_a_grid_of_squares_is_no_grid_of_dots() -> None:
    rng = np.random.default_rng(1)
    level = np.full((150, 190), 200.0)
    for row in range(5):
        for column in range(7):
            cv2.rectangle(level, (20 + 22 * column, 20 + 22 * row), (30 + 22 * column, 30 + 22 * row), 40.0, -1)
    image = cv2.GaussianBlur(level, (0, 0), 0.8) + rng.normal(0, 5, level.shape)
    found = detect_in_photograph(Photograph("squares", image.round().astype(np.float32), 8, ()), SPEC)
    assert (found.place < 0).all() and (found.observations.status != MEASURED).all()
