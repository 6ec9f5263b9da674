"""Tags of few pixels, steep ones and blurred ones are read, and nothing else is."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from testfield.bench.drawn_boards import View, clutter
from testfield.bench.recall_kinds import KINDS, drawn, scored
from testfield.detect.small_tags import read_tags
from testfield.detect.tag_bits import read_bits, words_of

APRIL = "DICT_APRILTAG_36h11"
KIND = next(kind for kind in KINDS if kind.name == "AprilTag")
BASE = View(3.0)


@pytest.mark.parametrize("view", [View(2.0), replace(BASE, tilt_deg=60.0), replace(BASE, blur_px=2.0)])
def test_small_steep_and_blurred_tags_are_read_and_their_middles_are_right(view: View) -> None:
    picture = drawn(KIND, view, 1)
    numbers, corners = read_tags(picture.image, APRIL)
    assert scored(KIND, picture, (numbers, corners.mean(axis=1))).tolist() == [12, 12, 0]


def test_clutter_is_no_tag() -> None:
    assert sum(len(read_tags(clutter(View(1.0), seed), APRIL)[0]) for seed in range(3)) == 0


def test_cells_that_blur_mixes_are_the_tag_they_come_from_and_random_ones_are_none() -> None:
    rng = np.random.default_rng(2)
    words = words_of(APRIL)[0, :60].reshape(-1, 6, 6)
    printed = np.pad(np.pad(words, ((0, 0), (1, 1), (1, 1))), ((0, 0), (3, 3), (3, 3)), constant_values=1)
    cells = [cv2.GaussianBlur(40 + 160.0 * np.kron(one, np.ones((8, 8))), (0, 0), 8 * 0.6) for one in printed]
    mixed = np.array(cells).reshape(-1, 14, 8, 14, 8)[:, 3:-3, 2:-2, 3:-3, 2:-2].mean(axis=(2, 4))
    misread = ((mixed > 120)[:, 1:-1, 1:-1] != words).sum(axis=(1, 2))
    assert (misread > 2).sum() > 10
    number, turns, _ = read_bits(mixed + rng.normal(0, 2, mixed.shape), APRIL, 1)
    assert number.tolist() == list(range(60)) and not turns.any()
    noise = np.pad(rng.uniform(40, 200, (200, 6, 6)), ((0, 0), (1, 1), (1, 1)), constant_values=40)
    assert (read_bits(noise, APRIL, 1)[0] < 0).all()
