"""What photographs show of their light, lens and sensor beside the targets: grey levels, blur, noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr

from testfield.camera.photograph import Photograph
from testfield.detect.noise import estimate_sheet
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.measure.seen_corners import crossings

LEAST_DIAMETER_PX, MOST_DOTS = 8.0, 60
INSIDE, OUTSIDE_RADII = 0.75, (1.25, 1.6)
"""Shares of a dot's radius within which it is all ink, and between which all ground (a code's ring begins at 2)."""
PIXEL_VARIANCE_PX2 = 1 / 12


@dataclass(frozen=True)
class Seen:
    """Medians over the photographs: `ink_dn` of dots and `ground_dn` around them, `elsewhere_dn` of whole images;
    `blur_px` the sigma of the optics' blur, the pixel's own area taken out; `gain_e_per_dn`, `read_noise_e` as the
    quiet parts show noise; `bits`; `full_dn` at which pixels are full."""

    ink_dn: float
    ground_dn: float
    elsewhere_dn: float
    blur_px: float
    gain_e_per_dn: float
    read_noise_e: float
    bits: int
    full_dn: float

    @property
    def white_on_black(self) -> bool:
        """Whether dots are brighter than what is around them."""
        return self.ink_dn > self.ground_dn


def seen_in(photographs: Sequence[Photograph], observations: Observations) -> Seen:
    """What photographs, by their names in `observations`, show. Where corners were measured and no dots, white is the
    ground and black the ink of the squares.

    Raises `TestfieldError` where no photograph shows a measured dot or crossing corner that is large enough.
    """
    levels, blurs, sheets = [], [], []
    station = {name: k for k, name in enumerate(observations.stations)}
    for photograph in photographs:
        own = observations.take((observations.station == station[photograph.name]) & (observations.status == MEASURED))
        sheets.append(estimate_sheet(photograph.pixels, photograph.bits, photograph.end_dn))
        if not own.centre_of_disc:
            for black, white, sigma in crossings(photograph.pixels, own.xy_px, MOST_DOTS):
                levels.append((black, white))
                blurs.append(sigma)
            continue
        large = np.flatnonzero(own.diameter_px >= LEAST_DIAMETER_PX)
        large = large[np.argsort(-own.diameter_px[large], kind="stable")][:: max(1, len(large) // MOST_DOTS)]
        for k in large:
            one = _dot(photograph.pixels, own.xy_px[k], own.moments_px2[k])
            if one is not None:
                levels.append(one[:2])
                blurs.append(one[2])
    if not levels:
        raise TestfieldError(
            f"no measured dot of {LEAST_DIAMETER_PX:g} px or more and no corner of squares",
            "photographs",
            "give larger images of the targets",
        )
    ink, ground = np.median(np.array(levels), axis=0)
    gain = float(np.clip(np.median([sheet.gain_e_per_dn for sheet in sheets]), 1e-3, 1e4))
    dark_dn2 = float(np.median([(sheet.read_noise_e / sheet.gain_e_per_dn) ** 2 for sheet in sheets]))
    largest = float((1 << photographs[0].bits) - 1)
    full = min(min(sheet.full_well_e / sheet.gain_e_per_dn for sheet in sheets), largest)
    return Seen(
        float(ink),
        float(ground),
        float(np.median([np.median(photograph.pixels) for photograph in photographs])),
        float(np.sqrt(max(np.median(np.square(blurs)) - PIXEL_VARIANCE_PX2, 0.0))),
        gain,
        float(np.sqrt(dark_dn2)) * gain,
        photographs[0].bits,
        full,
    )


def _dot(pixels: np.ndarray, xy: np.ndarray, moments: np.ndarray) -> tuple[float, float, float] | None:
    """Levels of a dot and of what is around it, and the sigma of its edge in px; None where it tells nothing."""
    reach = int(np.ceil(2 * np.sqrt(np.linalg.eigvalsh(moments)[1]) * OUTSIDE_RADII[1])) + 1
    x0, y0 = (round(float(v)) - reach for v in xy)
    if x0 < 0 or y0 < 0 or x0 + 2 * reach >= pixels.shape[1] or y0 + 2 * reach >= pixels.shape[0]:
        return None
    part = pixels[y0 : y0 + 2 * reach + 1, x0 : x0 + 2 * reach + 1].astype(float)
    grid = np.stack(np.meshgrid(np.arange(part.shape[1]) + x0, np.arange(part.shape[0]) + y0), axis=-1) - xy
    inverse = np.linalg.inv(moments) / 4
    pulled = grid @ inverse
    radius = np.sqrt(np.maximum((grid * pulled).sum(axis=-1), 1e-12))
    distance = (radius - 1) * radius / np.maximum(np.linalg.norm(pulled, axis=-1), 1e-12)
    inside, outside = radius < INSIDE, (radius > OUTSIDE_RADII[0]) & (radius < OUTSIDE_RADII[1])
    if inside.sum() < 5 or outside.sum() < 8:
        return None
    ink, ground = float(np.median(part[inside])), float(np.median(part[outside]))
    near = (np.abs(distance) < 4) & (radius < OUTSIDE_RADII[1])
    d, value = distance[near], part[near]

    def misfit(theta: np.ndarray) -> np.ndarray:
        a, b, shift, sigma = theta
        return a + (b - a) * ndtr((d - shift) / max(sigma, 0.05)) - value

    fit = least_squares(misfit, [ink, ground, 0.0, 0.8], loss="soft_l1", f_scale=max(abs(ink - ground) / 50, 0.5))
    sigma = float(fit.x[3])
    return (ink, ground, sigma) if 0.1 < sigma < 6 else None
