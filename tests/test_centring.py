"""Estimators by name: exact on exact images, honest about their scatter, silent outside their range."""

from functools import lru_cache

import numpy as np
import pytest

from testfield.camera.circle import disc_image
from testfield.camera.images import SensorSheet
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation
from testfield.certify.reference import ink_in_pixels
from testfield.detect import centre_forward
from testfield.detect.disc import disc_in_pixels, ellipse_outline
from testfield.detect.light import local_gradients
from testfield.registry import find, names

SHEET = SensorSheet(1.0, 2.0, 100.0, 16)
LENS = np.array([3478.0, 3478.0, 20.0, 900.0, -0.2, 0.1, -0.05, 1e-3, -1e-3])
SYSTEMATIC_PX = {
    "forward_model": 2e-5,
    "ellipse_model": 5e-4,
    "template": 5e-4,
    "dual_conic": 1e-3,
    "star": 1e-3,
    "weighted_centroid": 0.01,
    "grey_centroid": 0.02,
    "edge_gradient": 0.015,
    "edge_zernike": 0.015,
    "opencv_blob": 0.02,
    "skimage_regionprops": 0.06,
    "opencv_fit_ellipse": 0.12,
}
"""What the pixels' grid may do to each on noise-free discs of 12 to 24 px, rms; the rest is for nobody to have."""
PROPER = sorted(set(SYSTEMATIC_PX) - {"opencv_blob", "skimage_regionprops", "opencv_fit_ellipse"})


@lru_cache
def board(
    diameter: float, tilt_deg: float = 25.0, blur: float = 0.6, side: int = 5, slope: float = 0.0, seed: int = 3
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean image, 0.05 to 1 of ink, of ellipses in rows; centres (n, 2); moments (2, 2). `slope` of the light a px."""
    random = np.random.default_rng(seed)
    turn = rotation(np.array([[0, 0, 0.4]]))[0, :2, :2]
    axes = turn @ np.diag([diameter / 2, diameter / 2 * np.cos(np.radians(tilt_deg))]) @ turn.T
    pitch = int(2.2 * diameter + 12 * blur + 6)
    size = side * pitch
    grid = np.floor((np.arange(side) + 0.5) * pitch)
    centre = np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2) + random.uniform(-0.5, 0.5, (side**2, 2))
    outline, tangent, by_shape = ellipse_outline(axes[None], 512)
    image, uneven = np.full((size, size), 0.05), np.arange(size) - size / 2
    window = np.arange(float(pitch))[None]
    for c in centre:
        x, y = (c - pitch / 2).astype(int)
        disc = disc_in_pixels(outline + c - [x, y], tangent, by_shape[None], np.array([blur]), window, window)
        lit = 1 + slope * uneven[x : x + pitch]
        spread = slope * (blur**2 + 1 / 12) * disc.by_shape[0, 0]
        image[y : y + pitch, x : x + pitch] += 0.95 * (disc.value[0] - spread / lit)
    return image * (1 + slope * uneven), centre, axes @ axes / 4


def exposed(mean_e: np.ndarray, random: np.random.Generator) -> np.ndarray:
    electrons = random.poisson(mean_e) + SHEET.read_noise_e * random.standard_normal(mean_e.shape)
    return np.rint(electrons + SHEET.black_level_dn).astype(np.float32)


def nees(name: str, mean_e: np.ndarray, centre: np.ndarray, moments: np.ndarray, exposures: int) -> tuple[float, float]:
    """Squared errors by the claimed covariance per coordinate, and the part that was measured."""
    random = np.random.default_rng(8)
    values, ok = [], []
    rough = np.repeat((1.05 * moments + 0.2 * np.eye(2))[None], len(centre), axis=0)
    for _ in range(exposures):
        start = centre + random.normal(0, 0.2, centre.shape)
        found = find("centroids", name)(exposed(mean_e, random), SHEET, start, rough)
        e = (found.xy_px - centre)[found.ok]
        values.append(np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.cov_px2[found.ok]), e) / 2)
        ok.append(found.ok)
    return float(np.concatenate(values).mean()), float(np.mean(ok))


def exact_image(
    parameters: np.ndarray, R: np.ndarray, t_mm: np.ndarray, radius_mm: float, blur: float
) -> tuple[np.ndarray, np.ndarray]:
    """One disc by the certificate's reference, which shares no code with the estimators: areas of pixels eight times
    as fine, blurred and gathered. Also where its first pixel's middle is, in px."""
    from scipy.ndimage import gaussian_filter

    fine = 8
    scaled = parameters.copy()
    scaled[:4] *= fine
    window = ink_in_pixels(scaled, R, t_mm, radius_mm, 0, 14, margin_px=10 * fine)
    blurred = gaussian_filter(window.values, blur * fine, truncate=8)
    rows, columns = (n // fine for n in blurred.shape)
    image = blurred[: rows * fine, : columns * fine].reshape(rows, fine, columns, fine).mean(axis=(1, 3))
    return image, (np.array([window.left_px, window.top_px]) + (fine - 1) / 2) / fine


def leaning(tilt_deg: float) -> np.ndarray:
    """(3, 3) frame of a plane that faces the camera but for a tilt."""
    return rotation(np.radians(tilt_deg) * np.array([[np.cos(0.5), np.sin(0.5), 0]]))[0] @ np.diag([1.0, -1, -1])


@pytest.mark.parametrize("size", [(4.0, 0.0), (6.0, 60.0), (24.0, 45.0), (40.0, 60.0)])
def test_pixels_of_a_disc_are_those_of_exact_area_integrals(size: tuple[float, float]) -> None:
    R, plain = leaning(size[1]), np.array([2000.0, 2000.0, 0, 0, 0, 0, 0, 0, 0])
    t_mm, radius_mm = np.array([0.31, 0.17, 1000.0]), size[0] / 4
    reference, first = exact_image(plain, R, t_mm, radius_mm, 0.7)
    angle = 2 * np.pi * np.arange(256) / 256
    rim = radius_mm * np.column_stack([np.cos(angle), -np.sin(angle)]) @ R[:, :2].T + t_mm
    outline = 2000 * rim[:, :2] / rim[:, 2:]
    tangent = np.fft.ifft(np.fft.fft(outline, axis=0) * 1j * np.fft.fftfreq(256, 1 / 256)[:, None], axis=0).real
    y, x = (start + np.arange(n)[None] for start, n in zip(first[::-1], reference.shape, strict=True))
    ours = disc_in_pixels(outline[None], tangent[None], np.zeros((1, 0, 256, 2)), np.array([0.7]), x, y)
    # Blurring fine pixels' means and not the disc adds their own area's variance, 1/768 px^2.
    assert np.abs(ours.value[0] - reference).max() < 1.5e-3
    assert np.abs(ours.value[0].sum() - reference.sum()) < 1e-5 * reference.sum()


def seen_through_the_lens(diameter_px: float, tilt_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, Interior]:
    """One disc through a strong lens, its exact centre of area and moments, and the camera of that part."""
    R, t_mm, radius_mm = leaning(tilt_deg), np.array([700.0, 500.0, 3000.0]), diameter_px / 2 * 3000 / LENS[0]
    interior = Interior(4096, 3000, LENS)
    pose = Poses(np.eye(3)[None], np.zeros((1, 3)))
    true = disc_image(interior, pose, t_mm[None], R[:, 2][None], np.array([radius_mm]))
    values, first = exact_image(LENS, R, t_mm, radius_mm, 0.6)
    part = interior.with_parameters(LENS - np.array([0, 0, *first, 0, 0, 0, 0, 0]))
    return values, true.centroid_px - first, true.moments_px2, part


@pytest.mark.parametrize("name", sorted(SYSTEMATIC_PX))
@pytest.mark.parametrize("diameter", [12.0, 24.0])
def test_an_exact_image_gives_the_exact_centre(name: str, diameter: float) -> None:
    image, centre, moments = board(diameter)
    rough = np.repeat((1.05 * moments + 0.2 * np.eye(2))[None], len(centre), axis=0)
    start = centre + np.random.default_rng(1).normal(0, 0.2, centre.shape)
    found = find("centroids", name)((10000 * image + 100).astype(np.float32), SHEET, start, rough)
    assert found.ok.all()
    assert np.sqrt(np.mean((found.xy_px - centre) ** 2)) < SYSTEMATIC_PX[name]


@pytest.mark.parametrize(("diameter", "tilt_deg"), [(40.0, 0.0), (120.0, 60.0)])
def test_the_forward_model_sees_the_circle_through_the_lens(diameter: float, tilt_deg: float) -> None:
    values, centre, moments, interior = seen_through_the_lens(diameter, tilt_deg)
    image = (20000 * values + 1000).astype(np.float32)
    with_camera = centre_forward.forward_model(image, SHEET, centre + 0.2, moments, interior)
    without = centre_forward.forward_model(image, SHEET, centre + 0.2, moments)
    assert with_camera.ok.all()
    assert np.abs(with_camera.xy_px - centre).max() < 1e-4
    if diameter > 100:  # an ellipse in the image is not what the lens makes of a circle, and this test can see it
        assert np.abs(without.xy_px - centre).max() > 5e-4


@pytest.mark.parametrize("name", PROPER)
def test_claimed_covariances_are_those_observed(name: str) -> None:
    image, centre, moments = board(14.0)
    value, measured = nees(name, 2500 * image, centre, moments, 16)
    assert measured == 1
    # 800 coordinates scatter by 5 %; sampling is systematic for the edges, whose claim is rougher.
    low, high = (0.82, 1.22) if name in ("forward_model", "ellipse_model") else (0.5, 1.9)
    assert low < value < high


@pytest.mark.parametrize(("diameter", "tilt_deg"), [(6.0, 60.0), (24.0, 30.0)])
def test_the_forward_model_reaches_the_bound_and_says_so(diameter: float, tilt_deg: float) -> None:
    """The claim is the bound by construction; errors as large as claimed are at the bound."""
    image, centre, moments = board(diameter, tilt_deg)
    value, measured = nees("forward_model", 2000 * image, centre, moments, 16)
    assert measured == 1
    assert 0.82 < value < 1.22


def test_a_gradient_of_the_light_moves_no_centre(monkeypatch: pytest.MonkeyPatch) -> None:
    image, centre, moments = board(16.0, slope=2e-3)
    rough = np.repeat(moments[None], len(centre), axis=0)
    pixels = (10000 * image + 100).astype(np.float32)
    right = centre_forward.forward_model(pixels, SHEET, centre, rough)
    assert np.abs(right.xy_px - centre).max() < 1e-3

    def dark(theta: np.ndarray, variance: np.ndarray, good: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((len(theta), 4)), np.repeat(1e12 * np.eye(4)[None], len(theta), axis=0)

    monkeypatch.setattr(centre_forward, "_light", dark)
    monkeypatch.setattr(centre_forward, "CONTRADICTION", np.inf)
    wrong = centre_forward.forward_model(pixels, SHEET, centre, rough)
    assert (wrong.xy_px - centre)[:, 0].mean() > 0.01  # about slope R^2 / 4 (METHODS 6.1), and the weights


def test_neighbours_that_lie_are_not_believed() -> None:
    """A dot at the edge of another light keeps its centre: its own pixels contradict its neighbours."""
    image, centre, moments = board(16.0)
    step = image.shape[1] * 0.6
    lit = image * np.where(np.arange(image.shape[1]) < step, 1.0, 0.4)
    whole = np.abs(centre[:, 0] - step) > 14
    value, _ = nees("forward_model", 8000 * lit, centre[whole], moments, 8)
    assert value < 1.6


def test_local_gradients_follow_a_curved_light_and_know_their_doubt() -> None:
    random = np.random.default_rng(5)
    xy = np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0)), -1).reshape(-1, 2) * 50
    values = 1000 + 0.5 * xy[:, 0] - 0.2 * xy[:, 1] + 1e-4 * (xy**2).sum(axis=1) + random.normal(0, 1, 100)
    values[37] *= 3  # a dot that is no dot
    gradient, information = local_gradients(
        xy, values, np.ones(100), np.ones(100, bool), np.tile(10 * np.eye(2), (100, 1, 1))
    )
    true = np.array([0.5, -0.2]) + 2e-4 * xy
    e = np.delete(gradient - true, 37, axis=0)
    chi2 = np.einsum("ni,nij,nj->n", e, np.delete(information, 37, axis=0), e) / 2
    assert np.abs(e).max() < 0.1
    assert np.median(chi2) < 2
    alone = local_gradients(xy[:5], values[:5], np.ones(5), np.ones(5, bool), np.tile(10 * np.eye(2), (5, 1, 1)))
    assert not alone[1].any()


@pytest.mark.parametrize("name", ["edge_gradient", "edge_zernike", "dual_conic", "star"])
def test_a_dot_too_small_for_an_estimator_is_not_measured(name: str) -> None:
    image, centre, moments = board(3.0, 0.0)
    found = find("centroids", name)(
        (3000 * image + 100).astype(np.float32), SHEET, centre, np.repeat(moments[None], 25, 0)
    )
    assert not found.ok.any()


@pytest.mark.parametrize("name", sorted(SYSTEMATIC_PX))
def test_where_there_is_no_dot_nothing_is_measured_and_nothing_breaks(name: str) -> None:
    noise = np.random.default_rng(2).normal(500, 20, (60, 60)).astype(np.float32)
    flat = np.full((60, 60), 500, np.float32)
    at, moments = np.array([[30.0, 30.0], [1.0, 58.0]]), np.repeat(4 * np.eye(2)[None], 2, axis=0)
    for image in (noise, flat):
        found = find("centroids", name)(image, SHEET, at, moments)
        good = found.ok & (found.contrast_dn > 5 * 20)
        assert not good.any()
        assert np.isfinite(found.xy_px[found.ok]).all()
    assert len(find("centroids", name)(noise, SHEET, at[:0], moments[:0]).ok) == 0


def test_every_estimator_is_entered_by_name() -> None:
    assert set(SYSTEMATIC_PX) <= set(names("centroids"))


def test_a_model_with_the_wrong_pixel_is_seen_to_be_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the pixel's area out of the model's light, or shift it by a hundredth: the tests above must fall."""
    image, centre, moments = board(12.0)
    true = centre_forward.ellipse_outline

    def shifted(half_axes_px: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        outline, *rest = true(half_axes_px, points)
        return outline + np.array([0.01, 0]), *rest

    monkeypatch.setattr(centre_forward, "ellipse_outline", shifted)
    value, _ = nees("forward_model", 20000 * image, centre, moments, 4)
    assert value > 1.5
