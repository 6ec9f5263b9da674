"""What is full and what is merely white: quiet paper is measured, a cut plateau is not, and the reason is told."""

from functools import cache

import cv2
import numpy as np
import pytest

from testfield.camera.photograph import photograph_of
from testfield.detect.noise import estimate_sheet
from testfield.detect.photograph import Found, detect_in_photograph
from testfield.detect.target_spec import parse_target

COLUMNS, ROWS, FINE = 6, 4, 5


@cache
def covered(blur_px: float) -> np.ndarray:
    """How much of each pixel (260, 330) a grid of dots of 20 px covers, blurred."""
    y, x = (np.mgrid[0 : 260 * FINE, 0 : 330 * FINE] + 0.5) / FINE - 0.5
    middle = [(50.2 + 44 * k + 0.21 * j, 50.4 + 44 * j - 0.13 * k) for j in range(ROWS) for k in range(COLUMNS)]
    inside = np.min([np.hypot(x - a, y - b) for a, b in middle], axis=0) < 10
    share = cv2.resize(inside.astype(float), (330, 260), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(share, (0, 0), blur_px) if blur_px else share


def dots(paper: float, ink: float, blur_px: float = 0.7) -> np.ndarray:
    """The grid on paper, without noise."""
    return paper + (ink - paper) * covered(blur_px)


def noisy(image: np.ndarray, sigma_dn: float) -> np.ndarray:
    return image + np.random.default_rng(2).normal(0, sigma_dn, image.shape)


def stored(image: np.ndarray, dtype: type = np.uint8, largest: int = 0) -> np.ndarray:
    return np.clip(np.rint(image), 0, largest or np.iinfo(dtype).max).astype(dtype)


def found_in(image: np.ndarray) -> Found:
    return detect_in_photograph(photograph_of("grid", image), parse_target(f"circles:{COLUMNS}x{ROWS}"))


@pytest.mark.parametrize("sigma_dn", [0, 0.1, 0.3, 0.5, 1.5])
def test_quiet_paper_is_not_saturated_however_quiet_it_is(sigma_dn: float) -> None:
    found = found_in(stored(noisy(dots(200, 40), sigma_dn)))
    assert (found.observations.status == "measured").sum() == COLUMNS * ROWS
    assert (found.place[:, 0] >= 0).sum() == COLUMNS * ROWS


@pytest.mark.parametrize(
    "image",
    [
        pytest.param(lambda: stored(noisy(dots(1010, 100), 2), np.uint16), id="some of 16 bits"),
        pytest.param(lambda: stored(dots(40000, 3000), np.uint16), id="16 bits without noise"),
        pytest.param(lambda: stored(noisy(dots(252, 20), 0.5)), id="just below the end of 8 bits"),
        pytest.param(lambda: stored(noisy(dots(800, 90), 3), np.uint16) << 6, id="10 bits to the left"),
        pytest.param(lambda: dots(0.8, 0.1).astype(np.float32), id="floating point"),
        pytest.param(lambda: stored(dots(200, 40, blur_px=0)), id="a drawing without blur"),
        pytest.param(lambda: stored(dots(40, 200)), id="white on black without noise"),
    ],
)
def test_white_below_the_end_of_the_numbers_is_measured(image) -> None:
    assert (found_in(image()).observations.status == "measured").sum() == COLUMNS * ROWS


@pytest.mark.parametrize(
    "image",
    [
        pytest.param(lambda: stored(noisy(dots(300, 40), 2)), id="8 bits"),
        pytest.param(lambda: stored(noisy(dots(280, 40), 2), largest=250), id="a tone curve that ends at 250"),
        pytest.param(lambda: stored(noisy(dots(280, 40), 2), largest=254), id="a tone curve that ends at 254"),
        pytest.param(lambda: stored(noisy(dots(4600, 300), 20), np.uint16, 4095), id="12 bits in 16"),
        pytest.param(lambda: stored(noisy(dots(4600, 300), 20), np.uint16, 3800), id="a full well below 12 bits"),
        pytest.param(lambda: stored(noisy(dots(1200, 90), 5), np.uint16, 1023) << 6, id="10 bits to the left"),
        pytest.param(lambda: np.minimum(noisy(dots(1.2, 0.1), 0.01), 1).astype(np.float32), id="floating point"),
        pytest.param(lambda: stored(noisy(dots(40, 300), 2)), id="white on black"),
    ],
)
def test_a_cut_plateau_is_saturated_and_the_reason_is_told(image) -> None:
    found = found_in(image())
    assert (found.observations.status == "saturated").sum() == COLUMNS * ROWS
    assert "saturated" in found.summary


def test_the_weakest_colour_of_a_mosaic_is_full_first() -> None:
    gains = np.where(np.add.outer(np.arange(260), np.arange(330)) % 2, 1.0, 0.5)
    raw = stored(noisy(dots(1400, 100) * gains, 4), np.uint16, 1023)
    photograph = photograph_of("mosaic", raw, "RGGB")
    sheet = estimate_sheet(photograph.pixels, photograph.bits, photograph.end_dn)
    assert sheet.saturation_dn < 0.9 * 1023
    found = detect_in_photograph(photograph, parse_target(f"circles:{COLUMNS}x{ROWS}"))
    assert not (found.observations.status == "measured").any()
