"""A corner is measured, or it is only read and says so; either way its covariance holds."""

import cv2
import numpy as np
import pytest

from testfield.camera.photograph import photograph_of
from testfield.detect.observations import MEASURED, READ, Observations
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.simulate.board_image import draw_board, facing
from testfield.targets.board_pattern import BoardPattern


def tags(gap_mm: float, side_mm: float, px_a_mm: float, blur_px: float, seed: int) -> tuple[Observations, np.ndarray]:
    """What a photograph of 4 x 3 tags shows, and the errors (n, 2) px of what was found."""
    rng = np.random.default_rng(seed)
    pattern = BoardPattern("tags", 4, 3, side_mm + gap_mm, side_mm, "DICT_4X4_50")
    size = tuple((2.2 * pattern.half_mm * px_a_mm + 60).astype(int).tolist())
    to_px = facing(px_a_mm, (size[0] / 2 + rng.random(), size[1] / 2), rng.uniform(4, 12), rng.uniform(-3e-4, 3e-4))
    image = draw_board(pattern, size, to_px, blur_px, fine=5)
    image = np.rint(image + rng.normal(0, 1.5, image.shape)).clip(0, 255).astype(np.uint8)
    found = detect_in_photograph(photograph_of("tags", image), parse_target("aruco:DICT_4X4_50")).observations
    true = cv2.perspectiveTransform(pattern.points_mm[None], to_px)[0]
    return found, found.xy_px - true[4 * found.code + found.point]


@pytest.mark.parametrize(("gap_mm", "side_mm"), [(2, 30), (1.2, 30), (2, 54)])
def test_tags_near_each_other_are_measured(gap_mm: float, side_mm: float) -> None:
    """Two millimetres are six pixels here: less than a cell of the tag, which its makers ask for."""
    found, error = tags(gap_mm, side_mm, 3.0, 0.8, 1)
    assert len(found) >= 40  # OpenCV does not read all of them
    assert (found.status == MEASURED).all()
    assert np.abs(error).max() < 0.15
    assert np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.cov_px2), error).mean() / 2 < 2.5


def test_what_is_only_read_says_so_and_its_covariance_holds() -> None:
    """Tags of cells of two pixels, and tags that nearly touch: the model has too few pixels of its own."""
    parts = [tags(*what, seed) for what in ((6, 10, 1.5, 0.6), (6, 10, 2.2, 1.2), (0.6, 20, 2, 0.7)) for seed in (0,)]
    status = np.concatenate([found.status for found, _ in parts])
    error, covariance = (np.concatenate(v) for v in zip(*((e, f.cov_px2) for f, e in parts), strict=True))
    assert set(status) == {MEASURED, READ}
    assert np.isfinite(covariance).all()
    nees = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error) / 2
    read = status == READ
    assert read.sum() > 40
    assert 0.4 < nees[read].mean() < 2
    assert (np.abs(error[~read]).max(axis=1) > 1).sum() == 0
