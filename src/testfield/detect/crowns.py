"""CCTags in one image: found as ellipses within ellipses, read by their profile, measured by the forward model."""

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import map_coordinates
from scipy.special import ndtr

from testfield.camera.images import SensorSheet
from testfield.detect.crown_model import BLUR, CONTRAST, FittedCrowns, fit_crowns, matrix, shape_of
from testfield.targets.crowns import crown_radii

WINDOWS_PX = (11, 31, 91)
DARKER = 5
LEAST_PX = 28.0
"""Smallest outer diameter, across the ellipse's short axis: radii that tell numbers apart then differ by 0.7 px."""
ELLIPTIC = 0.06
"""By how much an outline's area may differ from that of its ellipse."""
CONCENTRIC = 0.2
"""Two ellipses belong together whose centres are nearer than this part of the larger one's short half axis."""
RHO, THETA = np.linspace(0.1, 1.25, 70), np.linspace(0, 2 * np.pi, 64, endpoint=False)
TILTS = (np.linspace(-0.16, 0.16, 5), np.linspace(-0.06, 0.06, 5), np.linspace(-0.02, 0.02, 5))
"""How far from the ellipse's centre the tag's centre may be seen, in its half axes, coarsely and then finer."""
WHOLE = 1.05
"""Radius within which a tag must be in the image."""
FEW_ROUNDS = 6
CANDIDATES = 5
BLURS_PX, LARGER = (0.7, 1.3), np.linspace(0.9, 1.06, 9)
"""Numbers whose profiles fit best, which are then fitted to the pixels."""
WORST_MISFIT, CLEARER = 0.04, 1.3
"""Residual beyond noise, as a part of the contrast, up to which something is a tag; and by how much the next best
number must fit worse, in rms."""
ALONE_MISFIT, ALONE = 0.07, 2.0
"""Bent paper and lenses leave more than that: up to which residual something is a tag that no other number fits as well
by this factor, in rms."""
MOST_BLUR = 0.08
"""Blur, in radii of the tag, beyond which numbers whose edges differ by 0.05 radii are not told apart."""
LEAST_CONTRAST = 5.0
SAME = 0.5


@dataclass(frozen=True)
class Crown:
    """A tag: its `number`, how it was `fitted`, its `outline_px` (16, 2)."""

    number: int
    fitted: FittedCrowns
    outline_px: np.ndarray


def read_crowns(
    image_dn: np.ndarray, pictures: list[np.ndarray], sheet: SensorSheet, crowns: int
) -> tuple[list[Crown], int]:
    """All tags of so many crowns in an image (h, w) of black tags on white, of which `pictures` are the same in bytes;
    and how many things looked like one and were not read."""
    found: list[Crown] = []
    unread = 0
    taken: list[np.ndarray] = []
    for picture in pictures:
        for ellipse in _ellipses(picture):
            centre, short = np.array(ellipse[0]), min(ellipse[1]) / 2
            if any(np.linalg.norm(one.fitted.xy_px - centre) < SAME * short for one in found):
                continue
            if any(
                np.linalg.norm(place[:2] - centre) < 0.1 * short and 0.9 < place[2] / short < 1.1 for place in taken
            ):
                continue
            crown = _read(image_dn, sheet, ellipse, crowns)
            if crown is None:
                unread += 1
                taken.append(np.array([*centre, short]))
            else:
                found.append(crown)
    return found, unread


def _ellipses(picture: np.ndarray) -> list[tuple]:
    """Ellipses that have others within about the same centre, the largest first."""
    ellipses: list[tuple] = []
    for window in WINDOWS_PX:
        if window >= min(picture.shape):
            break
        dark = cv2.adaptiveThreshold(
            picture, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, window, float(DARKER)
        )
        outlines, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            if len(outline) < 12:
                continue
            ellipse = cv2.fitEllipseDirect(outline)
            a, b = ellipse[1]
            if not (np.isfinite([*ellipse[0], a, b]).all() and a > 3 and 3 < b < 8 * a and a < 8 * b):
                continue
            area = np.pi * a * b / 4
            if abs(cv2.contourArea(outline) + len(outline) / 2 - area) < max(ELLIPTIC * area, 0.6 * len(outline)):
                ellipses.append(ellipse)
    if not ellipses:
        return []
    centre, half = np.array([e[0] for e in ellipses]), np.array([min(e[1]) / 2 for e in ellipses])
    order = np.argsort(-half)
    kept = []
    for k in order:
        if 2 * half[k] < LEAST_PX:
            break
        within = (np.linalg.norm(centre - centre[k], axis=1) < CONCENTRIC * half[k]) & (half < 0.93 * half[k])
        if within.any():
            kept.append(ellipses[k])
    return kept


def _read(image_dn: np.ndarray, sheet: SensorSheet, ellipse: tuple, crowns: int) -> Crown | None:
    table = crown_radii(crowns)
    H = _of_ellipse(ellipse)
    numbers: list[tuple[int, float]] = []
    for _ in range(2):  # once more with the right size
        H = _upright(image_dn, H if not numbers else H @ np.diag([numbers[0][1], numbers[0][1], 1]))
        profile = _profile(image_dn, H)
        if profile is None:
            return None
        start = shape_of(H)
        size = float(np.sqrt(abs(start[0] * start[2])))
        numbers = _alike(np.median(profile, axis=1), table, size)
    fits = []
    for number, larger in numbers:
        sized = start * np.array([larger, larger, larger, 1, 1, larger, larger])
        one = fit_crowns(image_dn, sheet, sized, table[number], FEW_ROUNDS)
        if one is not None:
            fits.append((one.chi2, int(number), one))
    if not fits:
        return None
    fits.sort(key=lambda fit: fit[0])
    again = [(fit_crowns(image_dn, sheet, fit[2].theta, table[fit[1]]), fit[1]) for fit in fits[:2]]
    fits = sorted(
        [(one.chi2, number, one) for one, number in again if one is not None] + fits[2:], key=lambda fit: fit[0]
    )
    if not fits:
        return None
    _, number, best = fits[0]
    noise = np.sqrt(sheet.variance_dn2(np.array(sheet.black_level_dn + best.theta[CONTRAST])))
    alone = len(fits) > 1 and fits[1][0] > ALONE**2 * best.chi2
    if best.misfit > (ALONE_MISFIT if alone else WORST_MISFIT) or best.theta[CONTRAST] < LEAST_CONTRAST * noise:
        return None
    if len(fits) > 1 and fits[1][0] < CLEARER**2 * best.chi2:
        return None
    if best.theta[BLUR] > MOST_BLUR * size:
        return None
    angle = 2 * np.pi * np.arange(16) / 16
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    return Crown(number, best, cv2.perspectiveTransform(circle[None], matrix(best.theta))[0])


def _of_ellipse(ellipse: tuple) -> np.ndarray:
    """(3, 3) affine map from the unit circle."""
    (x, y), (a, b), angle = ellipse
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    # Half a pixel: an outline goes through the middles of the outermost dark pixels.
    a, b = a / 2 + 0.5, b / 2 + 0.5
    return np.array([[a * c, -b * s, x], [a * s, b * c, y], [0, 0, 1]])


def _tilted(w: np.ndarray) -> np.ndarray:
    """(3, 3) the map of the unit disc to itself that moves its centre to w (2,), |w| < 1."""
    square = float(w @ w)
    if square < 1e-12:
        return np.eye(3)
    grown = 1 / np.sqrt(1 - square)
    inner = np.eye(2) + (grown - 1) * np.outer(w, w) / square
    return np.block([[inner, grown * w[:, None]], [grown * w[None], np.array([[grown]])]])


def _upright(image_dn: np.ndarray, H: np.ndarray) -> np.ndarray:
    """The map among those of the same outer ellipse under which rings are most alike all around."""
    w = np.zeros(2)
    for steps in TILTS:
        best, least = w, np.inf
        for x in steps:
            for y in steps:
                profile = _profile(image_dn, H @ _tilted(w + [x, y]))
                uneven = np.inf if profile is None else float(profile.var(axis=1).mean())
                if uneven < least:
                    best, least = w + [x, y], uneven
        w = best
    return np.asarray(H @ _tilted(w))


def _profile(image_dn: np.ndarray, H: np.ndarray) -> np.ndarray | None:
    """(radii, angles) values along `RHO` and `THETA`; None where some of the tag is beyond the image. The white around
    it may be: the image's border stands for it."""
    u = RHO[:, None] * np.cos(THETA), RHO[:, None] * np.sin(THETA)
    w = H[2, 0] * u[0] + H[2, 1] * u[1] + H[2, 2]
    x, y = ((H[k, 0] * u[0] + H[k, 1] * u[1] + H[k, 2]) / w for k in (0, 1))
    height, width = image_dn.shape
    own = RHO < WHOLE
    if x[own].min() < 0 or y[own].min() < 0 or x[own].max() > width - 1 or y[own].max() > height - 1:
        return None
    return np.asarray(map_coordinates(image_dn, [y, x], order=1, output=np.float32, mode="nearest"))


def _alike(profile: np.ndarray, table: np.ndarray, size_px: float) -> list[tuple[int, float]]:
    """The numbers whose profiles are most like a profile, the most first, and by how much the outer circle is then
    larger than it was taken for: an outline by a level is off by a pixel or two."""
    signs = (-1.0) ** (np.arange(table.shape[1]) + 1)
    b = profile - profile.mean()
    alike = np.zeros((len(BLURS_PX), len(LARGER), len(table)))
    for j, blur_px in enumerate(BLURS_PX):
        for k, larger in enumerate(LARGER):
            shown = 1 + signs @ ndtr((larger * table[:, :, None] - RHO) * size_px / blur_px)
            a = shown - shown.mean(axis=1, keepdims=True)
            alike[j, k] = a @ b / np.maximum(np.linalg.norm(a, axis=1) * np.linalg.norm(b), 1e-9)
    best = alike.max(axis=0)
    order = np.argsort(-best.max(axis=0))[:CANDIDATES]
    return [(int(number), float(LARGER[best[:, number].argmax()])) for number in order]
