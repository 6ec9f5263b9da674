"""Is a blob the image of a disc or of a polygon? Asked of every pixel, under the blur that is there.

Blur makes a small square so round that its edge looks elliptic. What is left of its corners is known, though. In the
plane where a dot is a circle the outline of a regular polygon of n corners differs from it first of all by
cos(n angle), and what pixels see of that follows from the same integral as what they see of the disc (`disc.py`). So a
blurred and unevenly lit ellipse is fitted, and then each of those harmonics is measured with all of the ellipse's
parameters free: how large it is, and how well the pixels tell.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.centre import half_widths, usable, windows
from testfield.detect.disc import ellipse_outline, outline_points
from testfield.detect.normal_equations import by_cholesky
from testfield.detect.outline_equations import ELLIPSE, outline_equations
from testfield.detect.screen import half_axes_of

DISC, POLYGON, UNEVEN, UNTOLD = range(4)
CORNERS = (3, 4, 5, 6)
"""Of the polygons that are asked after. Tilt makes any affine image of a regular one, which is fitted with the rest."""
MOST_CORNERS = CORNERS.index(5)
ROUNDED = np.array([0.3, 0.6, 0.6, 0.6])
"""The part of a regular polygon's harmonic that a polygon has at least: corners are rounded, none is regular, and half
discs and sectors have less of three corners."""
HOLE, HOLLOW = 0.5, 0.6
"""Radius of the hole that is asked after, and how much darker or brighter than the dot it must be to be one, as a part
of the contrast."""
FLOOR_PX = 0.04
"""Standard deviation of a dot's outline from an ellipse, in each harmonic, that paint and a converter's interpolation
leave: a photograph of dots of 10 px after resampling and JPEG has 0.03 to 0.05."""
SURE = 3.0
"""Standard deviations by which an outline must differ from an ellipse to be a polygon's."""
TOLD = 2 * SURE
"""Standard deviations between a disc and a pentagon below which the pixels do not tell. That is asked of squares too:
what is too blurred for a pentagon may be a smooth spot of light."""
LARGEST_PX = 32.0
"""Larger dots are looked at in images of half the size, and so on."""
ROUNDS, NEAR_PX = 12, 1e-3
FIRST_BLUR_PX, LEAST_BLUR_PX, MOST_BLUR_PX = 0.8, 0.25, 6.0
LEAST_POINTS = 48
CX, CY, AXX, AXY, AYY, BLUR, CONTRAST, BACKGROUND, CONTRAST_X, CONTRAST_Y, BACKGROUND_X, BACKGROUND_Y = range(12)


def polygon_harmonic(corners: int) -> float:
    """Amplitude, as a part of the radius, of cos(corners * angle) in the outline of a regular polygon about the disc of
    the same second moments, such that the moment in which they differ first is the polygon's own.

    That is what counts under a blur that leaves nothing but moments; of sharp edges one would take a few hundredths
    less.
    """
    angle = np.pi / corners * np.linspace(-1, 1, 2001)
    r = 1 / np.cos(angle)  # between two corners, in units of the inscribed circle's radius
    radius = np.mean(r**4) ** 0.25
    moment = 2 * np.mean(r ** (corners + 2) * np.cos(corners * angle)) / (corners + 2)
    return float(abs(moment) / radius ** (corners + 2))


AMPLITUDE = np.array([polygon_harmonic(corners) for corners in CORNERS])


@dataclass(frozen=True)
class Harmonics:
    """What the pixels tell of n blobs, NaN where no ellipse could be fitted.

    For each of `CORNERS`: `part` (n, c, 2) the harmonic's cosine and sine in units of the polygon's amplitude,
    `information` (n, c, 2, 2) the inverse of its covariance, with `FLOOR_PX` in it, `separation` (n, c) standard
    deviations of noise alone between disc and polygon, however that is turned. `hollow` (n,) how much darker the
    middle is than the rest, as a part of the contrast, and `u_hollow` (n,) its standard deviation.
    """

    part: np.ndarray
    information: np.ndarray
    separation: np.ndarray
    hollow: np.ndarray
    u_hollow: np.ndarray


def shapes(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> np.ndarray:
    """(n,) of `DISC`, `POLYGON`, `UNEVEN` for rings and spots, `UNTOLD` where the pixels do not tell, for bright blobs
    at (n, 2) px with moments (n, 2, 2) in an image (h, w) float32."""
    answer = np.full(len(xy_px), UNTOLD)
    level, scale = image_dn, 1
    diameter = 4 * np.maximum(np.linalg.det(moments_px2), 0) ** 0.25
    while min(level.shape) >= 2:
        here = (diameter < LARGEST_PX * scale) & (diameter >= (LARGEST_PX * scale / 2 if scale > 1 else 0))
        if here.any():
            xy = (xy_px[here] + 0.5) / scale - 0.5
            answer[here] = _answer(harmonics(level, sheet, xy, moments_px2[here] / scale**2))
        if not (diameter >= LARGEST_PX * scale).any():
            return answer
        # A mean of four pixels has a quarter of the variance that the sheet says: for large dots that does no harm.
        even = level[: level.shape[0] // 2 * 2, : level.shape[1] // 2 * 2]
        level = cv2.resize(even, (even.shape[1] // 2, even.shape[0] // 2), interpolation=cv2.INTER_AREA)
        scale *= 2
    return answer


def _answer(found: "Harmonics") -> np.ndarray:
    """(n,) as of `shapes`."""
    part, information = np.nan_to_num(found.part), np.nan_to_num(found.information)
    # The likelihoods of a disc and of the best polygon, turned as it may be and rounded as far as polygons are.
    turn = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    polygon = np.column_stack([np.cos(turn), np.sin(turn)])
    along = np.einsum("nci,ncij,kj->nck", part, information, polygon)
    square = np.einsum("ki,ncij,kj->nck", polygon, information, polygon)
    nearer = (along > ROUNDED[:, None] / 2 * square).any(axis=2)
    off = np.einsum("nci,ncij,ncj->nc", part, information, part)
    answer = np.where((nearer & (off > SURE**2)).any(axis=1), POLYGON, DISC)
    hollow = np.abs(np.nan_to_num(found.hollow))
    answer[(answer == DISC) & (hollow > HOLLOW / 2) & (hollow > SURE * np.nan_to_num(found.u_hollow))] = UNEVEN
    told = np.nan_to_num(found.separation[:, MOST_CORNERS]) >= TOLD
    return np.where((answer == DISC) & ~told, UNTOLD, answer)


def harmonics(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Harmonics:
    """What the pixels tell of the outlines of bright blobs; arguments as of `shapes`."""
    n, c = len(xy_px), len(CORNERS)
    found = Harmonics(*(np.full(shape, np.nan) for shape in ((n, c, 2), (n, c, 2, 2), (n, c), n, n)))
    for rows, values, x, y, inside in windows(image_dn, xy_px, half_widths(moments_px2)):
        origin, side = np.rint(xy_px[rows]), round(np.sqrt(values.shape[1]))
        window = _Window(values, x - origin[:, :1], y - origin[:, 1:], inside, side)
        theta, good = _start(window, xy_px[rows] - origin, moments_px2[rows], sheet)
        _fit(window, theta, good, sheet)
        for whole, part in zip(vars(found).values(), _measure(window, theta, sheet), strict=True):
            whole[rows[good]] = part[good]
    return found


@dataclass
class _Window:
    """Pixels (n, k) of n windows of `side`^2 = k: their values, places relative to a whole pixel in the middle, and
    which of them may be used."""

    values: np.ndarray
    x: np.ndarray
    y: np.ndarray
    use: np.ndarray
    side: int


def _start(window: _Window, xy: np.ndarray, moments: np.ndarray, sheet: SensorSheet) -> tuple[np.ndarray, np.ndarray]:
    """Parameters (n, 12) and which of them are sound; leaves in `window.use` what no ring can reach."""
    axes = half_axes_of(moments)
    theta = np.zeros((len(xy), ELLIPSE))
    theta[:, :2], theta[:, BLUR] = xy, FIRST_BLUR_PX
    theta[:, AXX], theta[:, AXY], theta[:, AYY] = axes[:, 0, 0], axes[:, 0, 1], axes[:, 1, 1]
    dx, dy = window.x - xy[:, :1], window.y - xy[:, 1:]
    u, v = np.moveaxis(np.stack([dx, dy], axis=-1) @ np.linalg.inv(axes), -1, 0)
    q = np.hypot(u, v)
    window.use = window.use & usable(q, dx, dy)
    inner, outer = window.use & (q < 0.6), window.use & (q > 1.2)
    theta[:, BACKGROUND] = (window.values * outer).sum(axis=1) / np.maximum(outer.sum(axis=1), 1)
    theta[:, CONTRAST] = (window.values * inner).sum(axis=1) / np.maximum(inner.sum(axis=1), 1)
    theta[:, CONTRAST] -= theta[:, BACKGROUND]
    good = _sound(theta, window.side)
    theta[~good] = _harmless(sheet)
    return theta, good


def _harmless(sheet: SensorSheet) -> np.ndarray:
    """Parameters that keep a lost blob from disturbing the others of its batch."""
    return np.array([0, 0, 2.0, 0, 2.0, 1.0, 100.0, sheet.black_level_dn, 0, 0, 0, 0])


def _sound(theta: np.ndarray, side: int) -> np.ndarray:
    finite = np.isfinite(theta).all(axis=1)
    low, high = np.linalg.eigvalsh(np.where(finite[:, None, None], _axes(theta), np.eye(2))).T
    return (
        finite & (low > 0.2) & (high < side) & (np.abs(theta[:, :2]).max(axis=1) < side / 2) & (theta[:, CONTRAST] > 0)
    )


def _axes(theta: np.ndarray) -> np.ndarray:
    """(n, 2, 2) symmetric matrices that map the unit circle onto the outlines."""
    return theta[:, [AXX, AXY, AXY, AYY]].reshape(-1, 2, 2)


def _fit(window: _Window, theta: np.ndarray, good: np.ndarray, sheet: SensorSheet) -> None:
    """Gauss and Newton's iteration on `theta`; what is lost is struck from `good`."""
    left = good.copy()
    for _ in range(ROUNDS):
        rows = np.flatnonzero(left)
        if not len(rows):
            return
        now = theta[rows]
        normal, score = _equations(window, rows, now, sheet, False)
        step = np.einsum("nij,nj->ni", _inverse(normal), score)
        longest = np.abs(step[:, : BLUR + 1]).max(axis=1)
        now += np.minimum(1, 0.5 / np.maximum(longest, 1e-12))[:, None] * step
        now[:, BLUR] = now[:, BLUR].clip(LEAST_BLUR_PX, MOST_BLUR_PX)
        sound = _sound(now, window.side)
        now[~sound] = _harmless(sheet)
        theta[rows], good[rows] = now, sound
        # One that has settled stays: it takes no time, and how often it is stepped does not depend on the others.
        left[rows] = sound & ~(longest < NEAR_PX)


def _measure(window: _Window, theta: np.ndarray, sheet: SensorSheet) -> tuple[np.ndarray, ...]:
    """What `Harmonics` holds, about fitted ellipses."""
    normal, score = _equations(window, np.arange(len(theta)), theta, sheet, True)
    eliminate = normal[:, ELLIPSE:, :ELLIPSE] @ _inverse(normal[:, :ELLIPSE, :ELLIPSE])
    information = normal[:, ELLIPSE:, ELLIPSE:] - eliminate @ normal[:, :ELLIPSE, ELLIPSE:]
    score = score[:, ELLIPSE:] - np.einsum("nij,nj->ni", eliminate, score[:, :ELLIPSE])
    radius = np.sqrt(np.maximum(np.linalg.det(_axes(theta)), 1e-12))
    parts, informations, separations = [], [], []
    for k, amplitude in enumerate(AMPLITUDE):
        pair = slice(2 * k, 2 * k + 2)
        covariance = np.linalg.pinv(information[:, pair, pair], 1e-9, hermitian=True)
        parts.append(np.einsum("nij,nj->ni", covariance, score[:, pair]) / amplitude)
        least = np.linalg.eigvalsh(information[:, pair, pair])[:, 0]
        separations.append(amplitude * np.sqrt(np.maximum(least, 0)))
        covariance = covariance + ((FLOOR_PX / radius) ** 2)[:, None, None] * np.eye(2)
        informations.append(np.linalg.inv(covariance) * amplitude**2)
    variance = 1 / np.maximum(information[:, -1, -1], 1e-300)
    contrast = theta[:, CONTRAST]
    hollow, u_hollow = -variance * score[:, -1] / contrast, np.sqrt(variance) / contrast
    return np.stack(parts, axis=1), np.stack(informations, axis=1), np.stack(separations, axis=1), hollow, u_hollow


def _equations(
    window: _Window, rows: np.ndarray, theta: np.ndarray, sheet: SensorSheet, with_harmonics: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrices (n, p, p) and right sides (n, p) of some windows, by the ellipse's parameters, and, where asked,
    by cosine and sine of each harmonic, in parts of the radius, and by the level of a disc in the middle."""
    n, axes = len(theta), _axes(theta)
    largest = float(np.abs(np.linalg.eigvalsh(axes)).max())
    count = max(outline_points(largest, float(theta[:, BLUR].min())), LEAST_POINTS)
    outline, tangent, by_shape = ellipse_outline(axes, count)
    by_shape, centre, hole = np.broadcast_to(by_shape, (n, *by_shape.shape)), theta[:, None, :2], None
    if with_harmonics:
        angle = 2 * np.pi * np.arange(count) / count
        waves = np.concatenate([[np.cos(k * angle), np.sin(k * angle)] for k in CORNERS])
        by_shape = np.concatenate([by_shape, waves[:, :, None] * outline[:, None]], axis=1)
        hole = HOLE * outline + centre, HOLE * tangent
    square = n, window.side, window.side
    values, use = window.values[rows].reshape(square), window.use[rows].reshape(square)
    return outline_equations(values, use, theta, (outline + centre, tangent, by_shape), hole, sheet.noise_line())


def _inverse(normal: np.ndarray) -> np.ndarray:
    """Inverses of normal matrices, whatever their parameters' units; what the pixels do not tell stays as it is."""
    found, whole = by_cholesky(np.ascontiguousarray(normal))
    rest = np.flatnonzero(~whole)
    if len(rest):
        scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", normal[rest]), 1e-300))
        unit = np.nan_to_num(normal[rest] * scale[:, :, None] * scale[:, None, :])
        found[rest] = np.linalg.pinv(unit, 1e-9, hermitian=True) * scale[:, :, None] * scale[:, None, :]
    return found
