"""Discs are told from what blur makes look like them: squares, triangles, rings, spots of light."""

import cv2
import numpy as np
import pytest

from testfield.bench.recall import Recall
from testfield.camera.images import SensorSheet
from testfield.detect import detect
from testfield.detect.disc import disc_in_pixels, ellipse_outline
from testfield.detect.outline import CORNERS, harmonics
from testfield.detect.outline_fit import HOLE, fit_outlines
from testfield.targets.marks import RADII

SHEET = SensorSheet(2.6, 2.3, 64.0, 12)
FINE, SIZE = 8, 96


def polygon(corners: int, turn: float = 0.3) -> np.ndarray:
    """Corners of a regular polygon whose second moments are those of the unit disc."""
    angle = 2 * np.pi * np.arange(corners) / corners + turn
    r = np.linspace(-1, 1, 2001) * np.pi / corners
    return np.column_stack([np.cos(angle), np.sin(angle)]) / np.cos(np.pi / corners) / np.mean(np.cos(r) ** -4) ** 0.25


DISC = polygon(200)


def picture(shapes: list[tuple[np.ndarray, float]], blur_px: float, light: tuple[float, float] = (0, 0)) -> np.ndarray:
    """Outlines (k, 2) in px filled with levels one after the other, blurred, under light that slopes (parts a px), with
    the noise of `SHEET`."""
    fine = np.zeros((SIZE * FINE, SIZE * FINE), np.float32)
    for outline, level in shapes:
        corners = np.rint(((outline + 0.5) * FINE - 0.5) * 256).astype(np.int32)
        cv2.fillPoly(fine, [corners], level, lineType=cv2.LINE_8, shift=8)
    fine = cv2.GaussianBlur(fine, (0, 0), blur_px * FINE)
    y, x = np.mgrid[:SIZE, :SIZE] - SIZE / 2
    mean = (fine.reshape(SIZE, FINE, SIZE, FINE).mean(axis=(1, 3)) * 1800 + 120) * (1 + light[0] * x + light[1] * y)
    noise = np.random.default_rng(len(shapes)).normal(0, 1, mean.shape) * np.sqrt(SHEET.variance_dn2(mean + 64))
    return (64 + mean + noise).astype(np.float32)


def status(image: np.ndarray) -> list[str]:
    """Of what lies in the picture's middle."""
    found = detect.measure_targets(image, SHEET, "ellipse_model", 5.0, 14, RADII["1:2:3"], by_contour=True)
    middle = np.linalg.norm(found.xy_px - 0.5 * SIZE, axis=1) < 4
    return [str(why) for why in found.status[middle]]


def flattened(outline: np.ndarray, diameter_px: float, ratio: float, turn: float) -> np.ndarray:
    """In px about the picture's middle, tilted so that its axes have the ratio and a circle of this area."""
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, -s], [s, c]]) @ np.diag([ratio**-0.5, ratio**0.5]) * diameter_px / 2
    return outline @ axes.T + 0.5 * SIZE + [0.2, -0.3]


CASES = [
    (6.0, 1.0, 1.0),
    (6.5, 1.2, 1.0),
    (8.0, 1.5, 0.9),
    (9.0, 1.9, 0.95),
    (10.0, 1.8, 0.6),
    (10.0, 0.9, 0.4),
    (24.0, 3.0, 0.7),
]
"""Diameter of the disc of like moments, blur, ratio of the axes."""


@pytest.mark.parametrize(("diameter_px", "blur_px", "ratio"), CASES)
@pytest.mark.parametrize("corners", [3, 4])
def test_a_blurred_square_or_triangle_is_not_taken_for_a_dot(
    corners: int, diameter_px: float, blur_px: float, ratio: float
) -> None:
    for turn in (0.0, 0.5, 1.1):
        image = picture([(flattened(polygon(corners, turn), diameter_px, ratio, 2 * turn), 1.0)], blur_px)
        seen = status(image)
        assert "measured" not in seen
        assert seen or corners == 3  # a triangle may not even fill its ellipse; a square has to be refused


DOTS = [
    (6.0, 1.0, 1.0),
    (7.0, 1.2, 0.8),
    (8.0, 1.4, 0.9),
    (10.0, 1.5, 0.6),
    (10.0, 0.9, 0.4),
    (9.0, 0.7, 0.34),
    (20.0, 3.0, 1.0),
    (24.0, 3.0, 0.7),
]
"""Blurred more than about 0.175 diameters they could not be told from pentagons."""


@pytest.mark.parametrize(("diameter_px", "blur_px", "ratio"), DOTS)
@pytest.mark.parametrize("light", [(0.0, 0.0), (0.012, -0.008)])
def test_a_blurred_dot_of_the_same_size_is_not_refused(
    diameter_px: float, blur_px: float, ratio: float, light: tuple[float, float]
) -> None:
    dot = flattened(DISC, diameter_px, ratio, 0.4)
    assert status(picture([(dot, 1.0)], blur_px, light)) == ["measured"]


def test_a_dot_with_a_neighbour_close_by_is_not_refused() -> None:
    dot = flattened(DISC, 9.0, 0.8, 0.4)
    assert status(picture([(dot, 1.0), (dot + [15.0, 4.0], 1.0)], 0.8)) == ["measured"]


def test_without_the_question_squares_would_be_dots(monkeypatch: pytest.MonkeyPatch) -> None:
    image = picture([(flattened(polygon(4), 6.5, 1.0, 0.2), 1.0)], 1.2)
    assert "measured" not in status(image)
    monkeypatch.setattr(detect, "shapes", lambda image, sheet, xy, moments: np.zeros(len(xy), int))
    assert status(image) == ["measured"]


@pytest.mark.parametrize("corners", CORNERS)
@pytest.mark.parametrize("blur_px", [0.7, 1.5])
def test_the_harmonic_of_a_polygon_is_its_own_and_a_disc_has_none(corners: int, blur_px: float) -> None:
    for outline, expected in ((polygon(corners), 1.0), (DISC, 0.0)):
        image = picture([(flattened(outline, 18.0, 0.8, 0.3), 1.0)], blur_px)
        c, s = np.cos(0.3), np.sin(0.3)
        turn = np.array([[c, -s], [s, c]])
        moments = turn @ np.diag([9.0**2 / 0.8, 9.0**2 * 0.8]) @ turn.T / 4
        found = harmonics(image, SHEET, np.array([[0.5 * SIZE + 0.2, 0.5 * SIZE - 0.3]]), moments[None])
        part = np.linalg.norm(found.part[0, CORNERS.index(corners)])
        if corners == 3 and expected:
            assert part > 0.8  # a triangle is no small change of a disc
        else:
            assert abs(part - expected) < 0.2


def test_equations_of_a_few_sums_are_those_of_all_pixels() -> None:
    """In `fit_outlines` pixels that no edge reaches enter as sums; here every pixel has its row of derivatives."""
    image = picture([(flattened(DISC, 18.0, 0.8, 0.3), 1.0)], 0.7, (0.01, -0.006))
    half, noise = 17, np.array(SHEET.noise_line())
    axes = np.array([[9.3, 0.4], [0.4, 8.6]])
    theta, normal, right, good = fit_outlines(
        image, np.array([[0.5 * SIZE + 0.2, 0.5 * SIZE - 0.3]]), axes[None], np.array([half]), noise
    )
    assert good.all()
    t, grid, points = theta[0], np.arange(-half, half + 1.0)[None], 400
    angle = 2 * np.pi * np.arange(points) / points
    outline, tangent, by = ellipse_outline(t[[2, 3, 3, 4]].reshape(1, 2, 2), points)
    waves = np.concatenate([[np.cos(k * angle), np.sin(k * angle)] for k in CORNERS])[:, :, None] * outline
    by, level = np.concatenate([by, waves])[None], t[None, 5]
    disc = disc_in_pixels(outline + t[:2], tangent, by, level, grid, grid)
    hole = disc_in_pixels(HOLE * outline + t[:2], HOLE * tangent, by[:, :0], level, grid, grid).value[0]
    dy, dx = np.meshgrid(grid[0] - t[1], grid[0] - t[0], indexing="ij")
    d, shape, lit, one = disc.value[0], disc.by_shape[0], t[6] + t[8] * dx + t[9] * dy, np.ones_like(hole)
    rows = [lit * shape[0] - t[8] * d - t[10], lit * shape[1] - t[9] * d - t[11], *(lit * shape[2:5])]
    rows += [lit * disc.by_blur[0], d, one, d * dx, d * dy, dx, dy, *(lit * shape[5:]), hole]
    value = t[7] + t[10] * dx + t[11] * dy + lit * d
    q = np.linalg.norm(np.stack([dx - 0.2 + t[0], dy + 0.3 + t[1]], axis=-1) @ np.linalg.inv(axes), axis=-1)
    use = (q <= 1.6) & ((q <= 1.1) | ((2 - q) * np.hypot(dx - 0.2 + t[0], dy + 0.3 + t[1]) >= 1.8 * q))
    J, whole = np.array(rows)[:, use], image[0 - half + 48 : half + 49, 48 - half : half + 49]
    weight = 1 / (noise[0] + noise[1] * (value[use] - noise[2]))
    expected, score = (J * weight) @ J.T, (J * weight) @ (whole[use] - value[use])
    scale = np.sqrt(np.diag(expected))
    assert np.abs((normal[0] - expected) / np.outer(scale, scale)).max() < 1e-4
    assert np.abs((right[0] - score) / scale).max() < 0.02  # in standard deviations


def test_rings_and_holes_are_no_dots() -> None:
    disc = flattened(DISC, 16.0, 0.8, 0.4)
    middle = disc.mean(axis=0)
    ring = picture([(disc, 1.0), (middle + 0.6 * (disc - middle), 0.0)], 2.5)
    assert "measured" not in status(ring)
    around = [(middle + k * (disc - middle), level) for k, level in ((3.0, 1.0), (1.7, 0.0), (1.0, 1.0))]
    hole = picture(around, 0.6)
    assert "measured" not in status(hole)
    assert status(picture(around[1:], 0.6)) == ["measured"]


def test_recall_is_met_by_what_was_tried_only() -> None:
    def met(recall: Recall) -> list[bool]:
        return [verdict["met"] for verdict in recall.verdicts()]

    assert met(Recall()) == [False] * 4
    good = {"rendered": 1000, "clear": 1000, "found": 996, "right": 996, "empty_views": 5}
    assert met(Recall(**good)) == [True] * 4
    for change, which in (({"found": 994, "right": 994}, 0), ({"right": 990}, 1), ({"wrong": 1}, 2)):
        assert met(Recall(**good | change)) == [k != which for k in range(4)]
    assert met(Recall(**good, false_in_empty_views=1)) == [True, True, True, False]
