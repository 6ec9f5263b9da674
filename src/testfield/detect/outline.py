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
from testfield.detect.centre import half_widths
from testfield.detect.normal_equations import by_cholesky
from testfield.detect.outline_fit import AXX, AXY, AYY, CONTRAST, ELLIPSE, FIRST_CORNERS, WAVES, fit_outlines
from testfield.detect.screen import half_axes_of

DISC, POLYGON, UNEVEN, UNTOLD = range(4)
CORNERS = tuple(range(FIRST_CORNERS, FIRST_CORNERS + WAVES))
"""Of the polygons that are asked after. Tilt makes any affine image of a regular one, which is fitted with the rest."""
MOST_CORNERS = CORNERS.index(5)
ROUNDED = np.array([0.3, 0.6, 0.6, 0.6])
"""The part of a regular polygon's harmonic that a polygon has at least: corners are rounded, none is regular, and half
discs and sectors have less of three corners."""
HOLLOW = 0.6
"""How much darker or brighter than the dot its middle must be to be a hole, as a part of the contrast."""
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
    if n:
        places, axes, noise = (
            np.ascontiguousarray(xy_px, float),
            half_axes_of(moments_px2),
            np.array(sheet.noise_line()),
        )
        theta, normal, right, good = fit_outlines(image_dn, places, axes, half_widths(moments_px2), noise)
        for whole, part in zip(vars(found).values(), _told(theta[good], normal[good], right[good]), strict=True):
            whole[good] = part
    return found


def _told(theta: np.ndarray, normal: np.ndarray, score: np.ndarray) -> tuple[np.ndarray, ...]:
    """What `Harmonics` holds, from the equations about fitted ellipses."""
    eliminate = normal[:, ELLIPSE:, :ELLIPSE] @ _inverse(normal[:, :ELLIPSE, :ELLIPSE])
    information = normal[:, ELLIPSE:, ELLIPSE:] - eliminate @ normal[:, :ELLIPSE, ELLIPSE:]
    score = score[:, ELLIPSE:] - np.einsum("nij,nj->ni", eliminate, score[:, :ELLIPSE])
    radius = np.sqrt(np.maximum(theta[:, AXX] * theta[:, AYY] - theta[:, AXY] ** 2, 1e-12))
    pairs = np.arange(2 * len(CORNERS)).reshape(-1, 2)
    own = information[:, pairs[:, :, None], pairs[:, None, :]]
    separation = AMPLITUDE * np.sqrt(np.maximum(np.linalg.eigvalsh(own)[..., 0], 0))
    covariance = np.linalg.pinv(own, 1e-9, hermitian=True)
    part = np.einsum("ncij,ncj->nci", covariance, score[:, pairs]) / AMPLITUDE[:, None]
    covariance = covariance + ((FLOOR_PX / radius) ** 2)[:, None, None, None] * np.eye(2)
    own = np.linalg.inv(covariance) * (AMPLITUDE**2)[:, None, None]
    variance = 1 / np.maximum(information[:, -1, -1], 1e-300)
    contrast = theta[:, CONTRAST]
    hollow, u_hollow = -variance * score[:, -1] / contrast, np.sqrt(variance) / contrast
    return part, own, separation, hollow, u_hollow


def _inverse(normal: np.ndarray) -> np.ndarray:
    """Inverses of normal matrices, whatever their parameters' units; what the pixels do not tell stays as it is."""
    found, whole = by_cholesky(np.ascontiguousarray(normal))
    rest = np.flatnonzero(~whole)
    if len(rest):
        scale = 1 / np.sqrt(np.maximum(np.einsum("nii->ni", normal[rest]), 1e-300))
        unit = np.nan_to_num(normal[rest] * scale[:, :, None] * scale[:, None, :])
        found[rest] = np.linalg.pinv(unit, 1e-9, hermitian=True) * scale[:, :, None] * scale[:, None, :]
    return found
