"""One frame to its observations: find, centre, decode, identify."""

from dataclasses import astuple, dataclass

import numpy as np

from testfield.camera.images import Frame, InvertedSheet, SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.contour import ROUGHLY, is_elliptic
from testfield.detect.decode import CROWDED, CUT, PLAIN, UNREADABLE, decode
from testfield.detect.find import find_blobs
from testfield.detect.identify import identify
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.outline import POLYGON, UNEVEN, UNTOLD, shapes
from testfield.detect.screen import may_be_dots
from testfield.registry import find
from testfield.targets.field import Field
from testfield.targets.marks import RingRadii

LARGEST_PX = 210.0
ROUGH = "grey_centroid"
"""The estimator that looks at every blob before the one that was asked for."""
WORST_MISFIT = 0.06
"""Rms residual beyond noise, as a fraction of the contrast, above which a blob is no dot."""
WORST_UNEVEN, CERTAIN_CHI2 = ((4.0, 12.0), (0.04, 0.3)), 2.0
"""The same where the edge's shape is asked separately: at radii in px, and where chance does not explain it. Shadows
cross large dots; a small one has no edge that could tell it from a square."""
DISTURBED, DISTURBED_CHI2, UNUSUAL = 0.004, 1.6, 3.0
"""A dot is partly hidden or touched by something where its residual beyond noise exceeds the first, as a fraction of
the contrast, and the third times what is usual in the image, and its chi-squared exceeds the second times what is usual
(at least times one). Real paint, lenses and converters leave every dot some residual."""
NEARLY_FULL = 0.98
LEAST_CONTRAST = 5.0
"""Contrast over noise below which nothing is measured."""


def detect(frame: Frame, field: Field, centroid: str, smallest_px: float) -> Observations:
    """Observations of one frame.

    `field` tells which code the rings carry, their polarity and what the boards look like; `centroid` names the
    estimator; dots of less than `smallest_px` are not looked for.
    """
    image, sheet = bright_marks(frame, field.white_on_black)
    targets = measure_targets(image, sheet, centroid, smallest_px, field.bits, field.radii)
    good = targets.status == MEASURED
    n = len(targets.status)
    board, point = np.full(n, -1), np.full(n, -1)
    board[good], point[good], refused = identify(targets.xy_px[good], targets.code[good], targets.affine[good], field)
    targets.status[good] = np.where(refused == "", MEASURED, refused)
    return targets.observations(frame.station, board, point)


@dataclass(frozen=True)
class Targets:
    """Everything in one image that was looked at, n rows: `xy_px`, `cov_px2`, `moments_px2`, `chi2` and `misfit` as
    in `Centres`; `code` (n,) as `decode` gives it, `CROWDED` where nothing was read; `affine` (n, 2, 2) likewise;
    `status` (n,) `measured` or why not; `left_out` how many blobs there were beyond `MOST_BLOBS`."""

    xy_px: np.ndarray
    cov_px2: np.ndarray
    moments_px2: np.ndarray
    chi2: np.ndarray
    misfit: np.ndarray
    code: np.ndarray
    affine: np.ndarray
    status: np.ndarray
    left_out: int = 0

    def observations(self, station: str, board: np.ndarray, point: np.ndarray) -> Observations:
        """As observations of one station, once the boards (n,) and points (n,) are known."""
        return Observations(
            (station,), np.zeros(len(self.code), int), self.xy_px, self.cov_px2, self.moments_px2,
            np.maximum(self.code, 0), board, point, self.chi2, self.status,
        )  # fmt: skip


def measure_targets(
    image: np.ndarray,
    sheet: SensorSheet,
    centroid: str,
    smallest_px: float,
    bits: int | None,
    radii: RingRadii,
    largest_px: float = LARGEST_PX,
    by_contour: bool = False,
) -> Targets:
    """Find, centre and decode in an image (h, w) float32 of bright marks; `bits` None: plain dots, rings are not read.

    `by_contour`: whether a dot is whole is asked of its edge alone, not of every pixel. Photographs need it, whose
    shadows cross dots and whose noise is only estimated; what the model leaves unexplained then widens the covariance.
    Every blob that stands alone on darker ground gets a row, whether it was measured or not.
    """
    blobs = find_blobs(image, sheet, smallest_px, largest_px)
    rough = find("centroids", ROUGH)(image, sheet, blobs.xy_px, blobs.moments_px2)
    noise = np.sqrt(sheet.variance_dn2(np.nan_to_num(rough.background_dn + rough.contrast_dn / 2)))
    rough_ok = rough.ok & (_diameter(rough.moments_px2) > 0.7 * smallest_px)
    rough_ok &= may_be_dots(image, rough.xy_px, rough.moments_px2, rough.contrast_dn, noise)
    xy, moments, cut = rough.xy_px[rough_ok], rough.moments_px2[rough_ok], blobs.cut[rough_ok]
    elliptic = is_elliptic(image, xy, moments, noise[rough_ok] / rough.contrast_dn[rough_ok], ROUGHLY)
    xy, moments, cut = xy[elliptic], moments[elliptic], cut[elliptic]
    if centroid == ROUGH:
        rows = np.flatnonzero(rough_ok)[elliptic]
        centres = Centres(**{name: values[rows] for name, values in vars(rough).items()})
    else:
        centres = find("centroids", centroid)(image, sheet, xy, moments)
    n = len(xy)
    status = np.full(n, MEASURED, dtype=object)
    status[~centres.ok] = "no ellipse fits"
    with np.errstate(invalid="ignore", divide="ignore"):
        noise = np.sqrt(sheet.variance_dn2(centres.background_dn + centres.contrast_dn / 2))
        if by_contour:
            not_elliptic = ~is_elliptic(image, centres.xy_px, centres.moments_px2, noise / centres.contrast_dn)
            worst = np.interp(_diameter(centres.moments_px2) / 2, *WORST_UNEVEN)
            not_elliptic |= (centres.misfit > worst) & (centres.chi2 > CERTAIN_CHI2)
        else:
            not_elliptic = centres.misfit > WORST_MISFIT
        diameter = _diameter(centres.moments_px2)
        for bad, why in (
            (cut, "cut by the image's edge"),
            (not_elliptic, "not an ellipse"),
            (centres.contrast_dn < LEAST_CONTRAST * noise, "too little contrast"),
            (_full(centres, sheet), "saturated"),
            (diameter < smallest_px, "too small"),
        ):
            status[(status == MEASURED) & bad] = why

    code, affine = np.full(n, CROWDED), np.full((n, 2, 2), np.nan)
    good = status == MEASURED
    if bits is None:
        code[good] = PLAIN
    else:
        # A number is worth knowing even where the centre is not to be trusted.
        read = good | (status == "saturated")
        code[read], affine[read] = decode(
            image,
            centres.xy_px[read],
            centres.moments_px2[read],
            centres.contrast_dn[read],
            centres.background_dn[read],
            bits,
            radii,
        )
    if by_contour:
        asked = np.flatnonzero(good & (code >= 0))
        shape = shapes(image, sheet, centres.xy_px[asked], centres.moments_px2[asked])
        status[asked[shape == POLYGON]], code[asked[shape == POLYGON]] = "a polygon", CROWDED
        for what, why in ((UNEVEN, "a ring or a spot"), (UNTOLD, "too blurred to tell its shape")):
            # A ring code that was read vouches for its dot.
            status[asked[(shape == what) & (code[asked] == PLAIN)]] = why
        good &= status == MEASURED
    else:
        status[good & (code >= 0) & _disturbed(centres, good & (code >= 0))] = "partly hidden or disturbed"
    for what, why in (
        (CROWDED, "surroundings are not a target's"),
        (UNREADABLE, "ring cannot be read"),
        (CUT, "ring cut by the image's edge"),
    ):
        status[good & (code == what)] = why
    _drop_ring_parts(centres.xy_px, centres.moments_px2, code, status, radii)
    xy_px = np.where(centres.ok[:, None], centres.xy_px, xy)
    return Targets(
        xy_px, centres.cov_px2, centres.moments_px2, centres.chi2, centres.misfit, code, affine, status, blobs.left_out
    )


def _diameter(moments_px2: np.ndarray) -> np.ndarray:
    """(n,) diameters of the circles of the same area."""
    m = moments_px2
    return 4 * np.maximum(m[:, 0, 0] * m[:, 1, 1] - m[:, 0, 1] ** 2, 0) ** 0.25


def _disturbed(centres: Centres, targets: np.ndarray) -> np.ndarray:
    """(n,) which dots fit clearly worse than the image's targets (a mask) usually do."""
    if not targets.any():
        return np.zeros(len(targets), bool)
    misfit, chi2 = (float(np.median(values[targets])) for values in (centres.misfit, centres.chi2))
    return (centres.misfit > max(DISTURBED, UNUSUAL * misfit)) & (centres.chi2 > DISTURBED_CHI2 * max(chi2, 1.0))


def _full(centres: Centres, sheet: SensorSheet) -> np.ndarray:
    """(n,) whether the white side of a dot's edge is as bright as a pixel can be."""
    if isinstance(sheet, InvertedSheet):
        white = sheet.largest_dn - centres.background_dn
    else:
        white = centres.background_dn + centres.contrast_dn
    return white >= NEARLY_FULL * sheet.saturation_dn


def bright_marks(frame: Frame, white_on_black: bool) -> tuple[np.ndarray, SensorSheet]:
    """The frame as float32 with bright marks, and the sheet that describes its noise."""
    image = frame.pixels_dn.astype(np.float32)
    if white_on_black:
        return image, frame.sheet
    inverted = InvertedSheet(*astuple(frame.sheet))
    return inverted.largest_dn - image, inverted


def _drop_ring_parts(
    xy: np.ndarray, moments: np.ndarray, code: np.ndarray, status: np.ndarray, radii: RingRadii
) -> None:
    """A segment of a ring may look like a dot: whatever lies on the ring of a decoded target is part of it."""
    dots = np.flatnonzero((code <= 0) & np.isfinite(xy).all(axis=1))
    for k in np.flatnonzero(code > 0):
        d = xy[dots] - xy[k]
        q = np.sqrt(np.einsum("ni,ij,nj->n", d, np.linalg.inv(4 * moments[k]), d))
        status[dots[(q > 1.2) & (q < radii.outer + 0.4)]] = "part of a ring"
