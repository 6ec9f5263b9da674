"""Rings in the model: a coded dot's centre beside its ring, and rings that are not as their number has them."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from testfield.camera.circle import disc_image
from testfield.camera.images import SensorSheet
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation
from testfield.certify.reference import ink_in_pixels
from testfield.detect import detect, ring_check
from testfield.detect.centre import Centres
from testfield.detect.centre_ring import Rings, fit_with_rings
from testfield.detect.detect import measure_targets
from testfield.detect.observations import MEASURED
from testfield.detect.ring_pixels import bright_segments, ring_in_pixels, ring_nodes
from testfield.detect.targets import Targets
from testfield.targets.marks import RADII
from testfield.targets.ring_code import code_words, repeats, word_of_number

SHEET = SensorSheet(1.0, 2.0, 100.0, 16)
RADIUS = RADII["1:2:3"]
BITS, FINE, FOCAL_PX, DISTANCE_MM = 14, 8, 2000.0, 1500.0
PINHOLE = np.array([FOCAL_PX, FOCAL_PX, 0, 0, 0, 0, 0, 0, 0])


def pose(diameter_px: float, tilt_deg: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Frame of a leaning target, where it stands, and its dot's radius in mm."""
    R = rotation(np.radians(tilt_deg) * np.array([[np.cos(0.5), np.sin(0.5), 0]]))[0] @ np.diag([1.0, -1, -1])
    return R, np.array([0.31, 0.17, DISTANCE_MM]), diameter_px / 2 * DISTANCE_MM / FOCAL_PX


def ink(word: int, diameter_px: float, tilt_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Areas of ink in pixels `FINE` times as fine, by the certificate's reference, and the first one's place in px."""
    scaled = PINHOLE.copy()
    scaled[:4] *= FINE
    R, t_mm, radius_mm = pose(diameter_px, tilt_deg)
    margin = int(FINE * (10 + 0.45 * diameter_px))
    window = ink_in_pixels(scaled, R, t_mm, radius_mm, word, BITS, margin_px=margin)
    return window.values, (np.array([window.left_px, window.top_px]) + (FINE - 1) / 2) / FINE


def gathered(fine: np.ndarray, blur_px: float) -> np.ndarray:
    blurred = gaussian_filter(fine, blur_px * FINE, truncate=8)
    rows, columns = (n // FINE for n in blurred.shape)
    return blurred[: rows * FINE, : columns * FINE].reshape(rows, FINE, columns, FINE).mean(axis=(1, 3))


def target(
    number: int, diameter_px: float, tilt_deg: float, blur_px: float = 0.6, slope: float = 0.0, bend: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """A code's mean image, 0.05 to 0.85 of light 1 at its middle, and the exact centre of its dot's area. The light
    has a `slope` a px along x, and its opposite's half along y, and a `bend` a px squared."""
    fine, first = ink(int(code_words(BITS)[number - 1]), diameter_px, tilt_deg)
    R, t_mm, radius_mm = pose(diameter_px, tilt_deg)
    stand = Poses(np.eye(3)[None], np.zeros((1, 3)))
    true = disc_image(Interior(100, 100, PINHOLE), stand, t_mm[None], R[:, 2][None], np.array([radius_mm]))
    centre = true.centroid_px[0] - first
    y, x = (np.indices(fine.shape) + 0.5) / FINE - 0.5 - centre[::-1, None, None]
    return gathered((1 + slope * x - slope / 2 * y + bend * x * x) * (0.05 + 0.8 * fine), blur_px), centre


def look(mean: np.ndarray, centroid: str) -> Targets:
    image = (100 + 20000 * mean).astype(np.float32)
    return measure_targets(image, SHEET, centroid, 5.0, BITS, RADIUS)


@pytest.mark.parametrize(("diameter_px", "tilt_deg"), [(8.0, 55.0), (24.0, 30.0)])
def test_pixels_of_a_ring_are_those_of_exact_area_integrals(diameter_px: float, tilt_deg: float) -> None:
    word = int(code_words(BITS)[300])
    R, t_mm, radius_mm = pose(diameter_px, tilt_deg)
    whole, first = ink(word, diameter_px, tilt_deg)
    scaled = np.diag([FINE * FOCAL_PX, FINE * FOCAL_PX, 1.0])
    dot = ink_in_pixels(np.r_[scaled[0, 0], scaled[1, 1], PINHOLE[2:]], R, t_mm, radius_mm, 0, BITS, margin_px=4)
    low = np.rint(first * FINE - (FINE - 1) / 2).astype(int)
    x, y = dot.left_px - low[0], dot.top_px - low[1]
    whole[y : y + dot.values.shape[0], x : x + dot.values.shape[1]] -= dot.values
    reference = gathered(whole, 0.7)
    # From disc coordinates (clockwise in the image, in dot radii) to px about the window's middle.
    half = max(reference.shape) // 2 + 1
    columns = np.column_stack([R[:, 0] * radius_mm, -R[:, 1] * radius_mm, t_mm])
    shift = np.eye(3)
    shift[:2, 2] = -(first + half)
    homography = shift @ np.diag([FOCAL_PX, FOCAL_PX, 1]) @ columns
    bright = bright_segments(np.array([word], np.uint32), BITS)
    nodes = ring_nodes(BITS, RADIUS, diameter_px / 2, 0.7)
    ours = ring_in_pixels(nodes, bright, homography[None], np.array([0.7]), half).value[0]
    rows, columns_ = reference.shape
    # Blurring fine pixels' means adds their own area's variance, 1/768 px^2.
    assert np.abs(ours[:rows, :columns_] - reference).max() < 1.5e-3
    assert np.abs(ours[:rows, :columns_].sum() - reference.sum()) < 1e-5 * reference.sum()


@pytest.mark.parametrize(("diameter_px", "tilt_deg"), [(9.0, 55.0), (12.0, 20.0), (30.0, 50.0)])
def test_the_centre_of_a_code_is_unbiased_with_its_ring_close_by(diameter_px: float, tilt_deg: float) -> None:
    """On a card of its own: no neighbour tells how the light slopes and bends on it."""
    for number in (7, 200):
        mean, centre = target(number, diameter_px, tilt_deg, 0.8, 0.05 / diameter_px, 0.002 / diameter_px**2)
        found = look(mean, "forward_model")
        mine = np.flatnonzero((found.code == number) & (found.status == MEASURED))
        assert len(mine) == 1, found.status
        assert np.linalg.norm(found.xy_px[mine[0]] - centre) < 5e-4


def test_the_centre_of_a_small_code_is_biased_without_its_ring(monkeypatch: pytest.MonkeyPatch) -> None:
    mean, centre = target(7, 9.0, 55.0, 0.8)
    monkeypatch.setattr(detect, "WITH_RINGS", "")
    found = look(mean, "forward_model")
    row = np.flatnonzero(found.code == 7)[0]
    assert np.linalg.norm(found.xy_px[row] - centre) > 5e-3


def test_the_centre_of_a_code_scatters_as_claimed() -> None:
    """Eighty exposures side by side, on cards whose light slopes alike: their neighbours' levels say it does not."""
    random = np.random.default_rng(4)
    mean, centre = target(33, 10.0, 50.0, slope=6e-3)
    lit = 4000 * mean
    electrons = random.poisson(np.tile(lit, (8, 10))) + SHEET.read_noise_e * random.standard_normal(
        (8 * lit.shape[0], 10 * lit.shape[1])
    )
    image = np.rint(electrons + SHEET.black_level_dn).astype(np.float32)
    found = measure_targets(image, SHEET, "forward_model", 5.0, BITS, RADIUS)
    mine = (found.code == 33) & (found.status == MEASURED)
    assert mine.sum() == 80
    e = (found.xy_px[mine] % lit.shape[::-1]) - centre
    nees = np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.cov_px2[mine]), e).mean() / 2
    assert 0.75 < nees < 1.27  # 160 coordinates


def hidden(number: int, angle_deg: float, at: float, width: float) -> np.ndarray:
    """A code of 12 px behind a bar as dark as its ground, `at` and `width` in dot radii from the centre."""
    fine, first = ink(int(code_words(BITS)[number - 1]), 12.0, 0.0)
    y, x = np.indices(fine.shape) / FINE
    middle = np.array([0.31, 0.17]) * FOCAL_PX / DISTANCE_MM - first
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    across = ((x - middle[0]) * c + (y - middle[1]) * s) / 6.0
    return gathered(0.05 + 0.8 * np.where((across > at) & (across < at + width), 0, fine), 0.6)


HIDDEN = [(478, 99.0, 1.42, 2.92), (227, 359.0, 1.57, 2.62), (240, 347.0, 1.84, 2.59), (388, 355.0, 1.77, 1.25)]
"""Numbers and bars that make others of them: 22, 12, 14 and 109."""


def test_a_ring_of_which_a_dark_bar_hides_segments_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for case in HIDDEN:
        for centroid in ("ellipse_model", "forward_model"):
            found = look(hidden(*case), centroid)
            assert not ((found.status == MEASURED) & (found.code > 0)).any(), (case, found.code)
    monkeypatch.setattr(ring_check, "DISAGREE", np.inf)
    for case in HIDDEN:  # without the ring's image another number is read
        found = look(hidden(*case), "ellipse_model")
        wrong = (found.status == MEASURED) & (found.code > 0) & (found.code != case[0])
        assert wrong.any(), case


def test_a_word_that_repeats_itself_leaves_the_turn_open() -> None:
    number = int(np.flatnonzero(repeats(code_words(BITS), BITS))[0] + 1)
    assert not repeats(word_of_number(np.array([33]), BITS), BITS)[0]
    found = look(target(number, 14.0, 20.0)[0], "forward_model")
    row = np.flatnonzero(found.code == number)[0]
    assert found.status[row] == MEASURED
    assert np.isnan(found.affine[row]).all()


def test_a_ring_that_was_never_fitted_does_not_agree_with_its_model() -> None:
    rough, each = Centres.empty(2), np.ones(2)
    xy, cov, moments = np.full((2, 2), 40.0), np.tile(np.eye(2), (2, 1, 1)), np.tile(4.0 * np.eye(2), (2, 1, 1))
    rough.put(np.arange(2), Centres(xy, cov, moments, 200 * each, 100 * each, each, 0 * each, each == 1))
    affine = np.stack([np.full((2, 2), np.nan), 4.0 * np.eye(2)])
    rings = Rings(affine, code_words(BITS)[:2], BITS, RADIUS)
    fitted = fit_with_rings(np.full((80, 80), 150.0), SHEET, rough, rings)
    assert not fitted.centres.ok[0]
    assert np.isinf(fitted.patch[0]) and np.isinf(fitted.patch_sigmas[0])
    assert np.isfinite(fitted.patch[1])
