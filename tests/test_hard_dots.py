"""Dots that are small, dense or jagged are found, as exactly as their covariance says, and clutter is not."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from testfield.bench.hard_dots import Picture, at_border, draw, found_of, hexagonal, interlaced, shaded, small
from testfield.camera.photograph import Photograph
from testfield.cli.main import main
from testfield.detect.dense_dots import colours, fit_together
from testfield.detect.interlace import combed
from testfield.detect.knobs import ALL, ALL_LINES, NONE, Knobs
from testfield.detect.noise import estimate_sheet
from testfield.detect.observations import MEASURED
from testfield.detect.photograph import ON_BLACK, Found, detect_in_photograph
from testfield.detect.target_spec import TargetSpec
from testfield.targets.marks import USUAL


def look(photograph: Photograph, knobs: Knobs = Knobs()) -> Found:  # noqa: B008
    """At bright dots."""
    return detect_in_photograph(photograph, TargetSpec("circles"), USUAL, ON_BLACK, 5.0, None, knobs)


@pytest.mark.parametrize("diameter_px", [5.0, 5.5, 6.0, 7.0])
def test_dots_of_five_pixels_are_measured_at_a_contrast_of_twenty(diameter_px: float) -> None:
    seen = found_of(small(diameter_px, 20), look)
    assert seen["found"] >= 97
    assert seen["false"] == 0
    assert seen["error_px"] < 1.15 * seen["stated_px"]


@pytest.mark.parametrize("diameter_px", [12.0, 20.0, 40.0])
def test_a_hexagonal_grid_with_gaps_of_a_seventh_is_measured_whole(diameter_px: float) -> None:
    seen = found_of(hexagonal(0.15, diameter_px), look)
    alone = found_of(hexagonal(1.0, diameter_px), look)
    assert (seen["found"], seen["false"]) == (336, 0)
    # Neighbours cost nothing: what they hide is known.
    assert seen["error_px"] < 1.3 * alone["error_px"]


@pytest.mark.parametrize("shift_px", [2.0, 3.0, -2.5])
def test_jagged_dots_of_interlaced_video_are_measured_in_the_even_lines(shift_px: float) -> None:
    picture = interlaced(shift_px, 12)
    seen = found_of(picture, look)
    assert seen["found"] >= 99
    assert seen["error_px"] < 1.2 * seen["stated_px"]
    assert any("interlaced" in note for note in look(draw(picture)).notes)


@pytest.mark.parametrize(("shade", "diameter_px"), [(0.7, 20.0), (0.5, 10.0), (0.5, 20.0), (0.3, 14.0)])
def test_dots_half_in_the_shade_are_where_the_light_is_even(shade: float, diameter_px: float) -> None:
    picture = shaded(shade, diameter_px)
    seen = found_of(picture, look)
    assert (seen["found"], seen["false"]) == (100, 0)
    assert seen["error_px"] < 1.4 * seen["stated_px"]
    # The step draws the centre to the lit side where nobody takes it out.
    as_it_is = found_of(picture, lambda p: look(p, Knobs(shade=False)))
    assert as_it_is["found"] < 50 or as_it_is["error_px"] > 4 * seen["error_px"]


@pytest.mark.parametrize("angle_deg", [60.0, 70.0])
def test_dots_at_the_border_of_a_fisheye_are_measured(angle_deg: float) -> None:
    seen = found_of(at_border(angle_deg, 12), look)
    assert (seen["found"], seen["false"]) == (seen["dots"], 0)


def test_no_image_of_one_exposure_is_taken_for_two() -> None:
    random = np.random.default_rng(3)
    for picture in (small(6, 20), hexagonal(0.15, 10), at_border(60, 12), interlaced(0.5, 12)):
        assert combed(draw(picture).pixels) is None
    assert combed(random.normal(100, 10, (200, 200)).astype(np.float32)) is None
    stripes = np.tile(np.where(np.arange(200) // 2 % 2, 200.0, 50.0)[:, None], (1, 200)).astype(np.float32)
    assert combed(stripes) is None


def test_small_squares_anywhere_are_no_dots() -> None:
    """Alike only by chance: sizes and levels as clutter has them."""
    random, image = np.random.default_rng(1), np.full((400, 400), 160.0, np.float32)
    for at in np.stack(np.meshgrid(np.arange(14), np.arange(14)), -1).reshape(-1, 2) * 28 + 18:
        half = random.uniform(1.8, 5.0, 2)
        x, y = (np.clip(half[k] + 0.5 - np.abs(np.arange(400) - at[k]), 0, 1) for k in (0, 1))
        image += np.outer(y, x) * random.uniform(600, 2300)
    image = cv2.GaussianBlur(image, (0, 0), 0.8) + random.normal(0, 100, image.shape)
    found = look(Photograph("squares", np.rint(image).astype(np.float32), 12, ()))
    assert (found.observations.status == MEASURED).sum() == 0


def test_what_is_unclear_is_decided_by_its_knob() -> None:
    picture = small(5.5, 20)
    assert found_of(picture, lambda p: look(p, Knobs(unclear=NONE)))["found"] == 0
    few = replace(picture, outline_px=picture.outline_px[:5])  # no company
    assert found_of(few, look)["found"] == 0
    assert found_of(few, lambda p: look(p, Knobs(unclear=ALL)))["found"] == 5


def test_dense_dots_and_lines_are_decided_by_their_knobs() -> None:
    dense, jagged = hexagonal(0.15, 20), interlaced(3, 12)
    assert found_of(dense, lambda p: look(p, Knobs(dense=False)))["found"] == 0
    assert found_of(jagged, lambda p: look(p, Knobs(lines=ALL_LINES)))["found"] == 0
    assert found_of(dense, lambda p: look(p, Knobs(largest_px=12)))["found"] == 0


def test_dots_fitted_together_are_where_they_are_without_noise() -> None:
    picture = hexagonal(0.15, 16, snr=1e4)
    photograph = draw(picture)
    sheet = estimate_sheet(photograph.pixels, 12)
    rough = picture.xy_px + np.random.default_rng(0).uniform(-0.4, 0.4, picture.xy_px.shape)
    theta, fitted = fit_together(photograph.pixels, sheet, rough, np.tile(13.0 * np.eye(2), (len(rough), 1, 1)))
    assert fitted.all()
    assert np.abs(theta[:, :2] - picture.xy_px).max() < 0.01
    number = colours(theta)
    gap = np.linalg.norm(theta[:, None, :2] - theta[:, :2], axis=2)[number[:, None] == number]
    assert gap[gap > 0].min() > 3.3 * 8
    assert number.max() <= 4


def test_a_largest_diameter_below_the_smallest_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["detect", "none.png", "--target", "circles", "--largest-px", "4"]) == 2
    assert "--largest-px" in capsys.readouterr().err


def test_a_picture_without_dots_is_a_picture() -> None:
    empty = Picture(64, 64, np.zeros((0, 8, 2)))
    assert found_of(empty, look)["found"] == 0
