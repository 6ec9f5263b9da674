"""One frame to its observations: find, centre, decode, identify."""

from dataclasses import astuple

import numpy as np

from testfield.camera.images import Frame, InvertedSheet, SensorSheet
from testfield.detect.decode import decode
from testfield.detect.find import find_blobs
from testfield.detect.identify import identify
from testfield.detect.observations import MEASURED, Observations
from testfield.registry import find
from testfield.targets.field import Field

LARGEST_PX = 60.0
WORST_MISFIT = 0.06
"""Rms residual beyond noise, as a fraction of the contrast, above which a blob is no dot."""
DISTURBED, DISTURBED_CHI2 = 0.004, 1.6
"""A dot is partly hidden or touched by something where its residual beyond noise exceeds the first, as a fraction of
the contrast, and its chi-squared exceeds the second times what is usual in the image (at least times one)."""
NEARLY_FULL = 0.98
LEAST_CONTRAST = 5.0
"""Contrast over noise below which nothing is measured."""


def detect(frame: Frame, field: Field, centroid: str, smallest_px: float) -> Observations:
    """Observations of one frame.

    `field` tells which code the rings carry, their polarity and what the boards look like; `centroid` names the
    estimator; dots of less than `smallest_px` are not looked for.
    """
    image, sheet = _bright_marks(frame, field.white_on_black)
    xy, moments = find_blobs(image, sheet, smallest_px, LARGEST_PX)
    centres = find("centroids", centroid)(image, sheet, xy, moments)
    n = len(xy)
    status = np.full(n, MEASURED, dtype=object)
    status[~centres.ok] = "no ellipse fits"
    with np.errstate(invalid="ignore"):
        noise = np.sqrt(sheet.variance_dn2(centres.background_dn + centres.contrast_dn / 2))
        top = centres.background_dn + centres.contrast_dn
        white = top if field.white_on_black else sheet.largest_dn - centres.background_dn
        plausible = centres.ok & (centres.misfit < WORST_MISFIT)
        usual = max(float(np.median(centres.chi2[plausible])), 1.0) if plausible.any() else 1.0
        saturated = white >= NEARLY_FULL * sheet.saturation_dn
        m = centres.moments_px2
        diameter = 4 * np.maximum(m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] ** 2, 0) ** 0.25
        for bad, why in (
            (centres.misfit > WORST_MISFIT, "not an ellipse"),
            (
                (centres.misfit > DISTURBED) & (centres.chi2 > DISTURBED_CHI2 * usual),
                "partly hidden or disturbed",
            ),
            (centres.contrast_dn < LEAST_CONTRAST * noise, "too little contrast"),
            (saturated, "saturated"),
            (diameter < smallest_px, "too small"),
        ):
            status[(status == MEASURED) & bad] = why

    code, affine = np.full(n, -2), np.full((n, 2, 2), np.nan)
    good = status == MEASURED
    code[good], affine[good] = decode(
        image,
        centres.xy_px[good],
        centres.moments_px2[good],
        centres.contrast_dn[good],
        centres.background_dn[good],
        field.bits,
    )
    status[good & (code == -2)] = "surroundings are not a target's"
    status[good & (code == -1)] = "ring cannot be read"
    _drop_ring_parts(centres.xy_px, centres.moments_px2, code, status)

    good = status == MEASURED
    board, point = np.full(n, -1), np.full(n, -1)
    board[good], point[good], refused = identify(centres.xy_px[good], code[good], affine[good], field)
    status[good] = np.where(refused == "", MEASURED, refused)
    xy_px = np.where(centres.ok[:, None], centres.xy_px, xy)
    return Observations(
        (frame.station,), np.zeros(n, int), xy_px, centres.cov_px2, centres.moments_px2,
        np.maximum(code, 0), board, point, centres.chi2, status,
    )  # fmt: skip


def _bright_marks(frame: Frame, white_on_black: bool) -> tuple[np.ndarray, SensorSheet]:
    """The frame as float32 with bright marks, and the sheet that describes its noise."""
    image = frame.pixels_dn.astype(np.float32)
    if white_on_black:
        return image, frame.sheet
    inverted = InvertedSheet(*astuple(frame.sheet))
    return inverted.largest_dn - image, inverted


def _drop_ring_parts(xy: np.ndarray, moments: np.ndarray, code: np.ndarray, status: np.ndarray) -> None:
    """A segment of a ring may look like a dot: whatever lies on the ring of a decoded target is part of it."""
    dots = np.flatnonzero((code == 0) & (status == MEASURED))
    for k in np.flatnonzero((code > 0) & (status == MEASURED)):
        d = xy[dots] - xy[k]
        q = np.sqrt(np.einsum("ni,ij,nj->n", d, np.linalg.inv(4 * moments[k]), d))
        status[dots[(q > 1.2) & (q < 3.4)]] = "part of a ring"
