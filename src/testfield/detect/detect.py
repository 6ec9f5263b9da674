"""One frame to its observations: find, centre, decode, identify."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.images import Frame, InvertedSheet, SensorSheet
from testfield.detect.alike import unlike_neighbours
from testfield.detect.bright import bright_marks
from testfield.detect.centre import RING_BEGINS, Centres
from testfield.detect.centre_ring import Rings
from testfield.detect.circle_boards import name_circles
from testfield.detect.contour import ROUGHLY, has_contour, is_elliptic
from testfield.detect.decode import CROWDED, CUT, PLAIN, UNREADABLE, decode
from testfield.detect.find import find_blobs
from testfield.detect.identify import identify
from testfield.detect.knobs import ALIKE, LARGEST_PX
from testfield.detect.observations import MEASURED, SURROUNDED, Observations, diameters
from testfield.detect.one_row import first_rows
from testfield.detect.ones_own import blobs_of, numbers_of
from testfield.detect.outline import DISC, POLYGON, UNEVEN, UNTOLD, shapes
from testfield.detect.ring_check import OTHERS, compared
from testfield.detect.screen import may_be_dots
from testfield.detect.small_dots import SMALLEST_PART, believed_dots, fit_small
from testfield.detect.square_boards import detect_squares
from testfield.detect.targets import Targets
from testfield.registry import find
from testfield.targets.code_table import CodeTable, words_of
from testfield.targets.field import Field
from testfield.targets.marks import RingRadii
from testfield.targets.ring_code import repeats

NO_OPTIONS: Mapping[str, Any] = MappingProxyType({})
ROUGH = "grey_centroid"
"""The estimator that looks at every blob before the one that was asked for."""
WITH_RINGS = "forward_model"
"""The estimator that measures a dot once more together with its ring when that has been read."""
WORST_MISFIT = 0.06
"""Rms residual beyond noise, as a fraction of the contrast, above which a blob is no dot."""
WORST_UNEVEN, CERTAIN_CHI2 = ((4.0, 12.0), (0.04, 0.3)), 2.0
"""The same where the edge's shape is asked separately: at radii in px, and where chance does not explain it. Shadows
cross large dots; a small one has no edge that could tell it from a square."""
DISTURBED, DISTURBED_CHI2, UNUSUAL = 0.004, 1.6, 3.0
"""A dot is partly hidden or touched by something where its residual beyond noise exceeds the first, as a fraction of
the contrast, and the third times what is usual in the image, and its chi-squared exceeds the second times what is usual
(at least times one). Real paint, lenses and converters leave every dot some residual."""
DOUBTFUL = 0.3
"""Doubt of `decode` beyond which a code is compared with the image of its ring even in a hurry."""
NEARLY_FULL = 0.98
LEAST_CONTRAST = 5.0
"""Contrast over noise below which nothing is measured."""


def detect(
    frame: Frame,
    field: Field,
    centroid: str,
    smallest_px: float,
    options: Mapping[str, Any] = NO_OPTIONS,
    finder: Callable | None = None,
    decoder: Callable | None = None,
) -> Observations:
    """Observations of one frame.

    `field` tells which code the rings carry, their polarity and what the boards look like; `centroid` names the
    estimator, which is given `options`; dots of less than `smallest_px` are not looked for. A `finder` or a `decoder`
    of somebody's own (OWN_ALGORITHMS.md) takes the place of `find_blobs` or `decode`.
    """
    squares, printed = detect_squares(frame, field)
    if not field.loose and all(board.has_corners for board in field.boards):
        return squares
    image, sheet = bright_marks(frame, field.white_on_black)
    targets = measure_targets(
        image,
        sheet,
        centroid,
        smallest_px,
        field.bits,
        field.radii,
        options=options,
        finder=finder,
        decoder=decoder,
        codes=field.codes,
    )
    good = targets.status == MEASURED
    n = len(targets.status)
    board, point = np.full(n, -1), np.full(n, -1)
    middle = (np.array(image.shape[::-1]) - 1) / 2
    board[good], point[good], refused = identify(
        targets.xy_px[good], targets.code[good], targets.affine[good], field, middle
    )
    targets.status[good] = np.where(refused == "", MEASURED, refused)
    for b, nominal in enumerate(field.boards):
        mine = np.flatnonzero((board == b) & (targets.status == MEASURED))
        marks = nominal.marks.xy_mm[point[mine]], nominal.marks.diameter_mm[point[mine]]
        seen = targets.xy_px[mine], targets.moments_px2[mine], targets.cov_px2[mine]
        unlike = unlike_neighbours(*marks, *seen, middle)
        targets.status[mine[unlike]] = "partly hidden or disturbed"
    plain = (targets.status == MEASURED) & (targets.code == PLAIN) & (board == -1)
    for outline in printed:
        inside = [cv2.pointPolygonTest(outline.astype(np.float32), xy, False) >= 0 for xy in targets.xy_px.tolist()]
        targets.status[plain & np.array(inside, bool)] = "part of a tag or a square"
    plain &= targets.status == MEASURED
    crowded = np.isin(targets.status.astype(str), SURROUNDED)
    named, number = name_circles(targets.xy_px, diameters(targets.moments_px2), plain, field, crowded)
    # Dots that stand as near to each other as those of a RUNE-Tag look like parts of a ring.
    told = crowded & (named >= 0)
    targets.status[told], targets.code[told] = MEASURED, PLAIN
    board, point = np.where(named >= 0, named, board), np.where(named >= 0, number, point)
    return Observations.beside([targets.observations(frame.station, board, point), squares])


def measure_targets(
    image: np.ndarray,
    sheet: SensorSheet,
    centroid: str,
    smallest_px: float,
    bits: int | None,
    radii: RingRadii,
    largest_px: float = LARGEST_PX,
    by_contour: bool = False,
    options: Mapping[str, Any] = NO_OPTIONS,
    finder: Callable | None = None,
    decoder: Callable | None = None,
    codes: CodeTable | None = None,
    unclear: str = ALIKE,
) -> Targets:
    """Find, centre and decode in an image (h, w) float32 of bright marks; `bits` None: plain dots, rings are not read.
    `codes`: the rings' numbers in a table of a maker's own, whose words have so many bits.

    `by_contour`: whether a dot is whole is asked of its edge alone, not of every pixel. Photographs need it, whose
    shadows cross dots and whose noise is only estimated; what the model leaves unexplained then widens the covariance.
    Every blob that stands alone on darker ground gets a row, whether it was measured or not. `unclear` as `UNCLEAR` of
    `knobs.py`.
    """
    if finder is None:
        blobs = find_blobs(image, sheet, smallest_px, largest_px)
    else:
        blobs = blobs_of(finder(image, sheet, smallest_px, largest_px))
    begins = RING_BEGINS if bits is None else min(radii.inner, RING_BEGINS)
    rough = find("centroids", ROUGH)(image, sheet, blobs.xy_px, blobs.moments_px2, ring_begins=begins)
    with np.errstate(invalid="ignore"):  # of what is no target, levels may be infinite
        noise = np.sqrt(sheet.variance_dn2(np.nan_to_num(rough.background_dn + rough.contrast_dn / 2)))
    of_size = rough.ok & (diameters(rough.moments_px2) > 0.7 * smallest_px)
    rough_ok = of_size & may_be_dots(image, rough.xy_px, rough.moments_px2, rough.contrast_dn, noise, begins)
    xy, moments, cut = rough.xy_px[rough_ok], rough.moments_px2[rough_ok], blobs.cut[rough_ok]
    elliptic = is_elliptic(image, xy, moments, noise[rough_ok] / rough.contrast_dn[rough_ok], ROUGHLY)
    passed_over = {
        "not brighter than what lies around, or too near to something as bright": int((of_size & ~rough_ok).sum()),
        "nowhere near an ellipse": int((~elliptic).sum()),
    }
    xy, moments, cut = xy[elliptic], moments[elliptic], cut[elliptic]
    rows = np.flatnonzero(rough_ok)[elliptic]
    centres = Centres(**{name: values[rows] for name, values in vars(rough).items()})
    if centroid != ROUGH:
        centres = find("centroids", centroid)(image, sheet, xy, moments, **options).completed(centres)
        if by_contour:
            fit_small(image, sheet, xy, moments, rough.contrast_dn[rows], centres, unclear)
    n = len(xy)
    status = np.full(n, MEASURED, dtype=object)
    status[~centres.ok] = "no ellipse fits"
    with np.errstate(invalid="ignore", divide="ignore"):
        noise = np.sqrt(sheet.variance_dn2(centres.background_dn + centres.contrast_dn / 2))
        if by_contour:
            not_elliptic = ~is_elliptic(image, centres.xy_px, centres.moments_px2, noise / centres.contrast_dn)
            # Of an edge as wide as the dot only the pixels tell, and the company.
            wide = not_elliptic & ~has_contour(image, centres.xy_px, centres.moments_px2, centres.contrast_dn)
            not_elliptic &= ~wide
            worst = np.interp(diameters(centres.moments_px2) / 2, *WORST_UNEVEN)
            hollow = ~not_elliptic & (centres.misfit > worst) & (centres.chi2 > CERTAIN_CHI2)
        else:
            not_elliptic = centres.misfit > WORST_MISFIT
            hollow = wide = np.zeros(n, bool)
        diameter = diameters(centres.moments_px2)
        for bad, why in (
            (cut, "cut by the image's edge"),
            (not_elliptic | hollow, "not an ellipse"),
            (centres.contrast_dn < LEAST_CONTRAST * noise, "too little contrast"),
            (_full(centres, sheet), "saturated"),
            (diameter < (SMALLEST_PART * smallest_px if by_contour else smallest_px), "too small"),
        ):
            status[(status == MEASURED) & bad] = why

    code, affine, doubt = np.full(n, CROWDED), np.full((n, 2, 2), np.nan), np.full(n, np.inf)
    shape = radii
    good = status == MEASURED
    if bits is None:
        code[good] = PLAIN
    else:
        # A number is worth knowing even where the centre is not to be trusted.
        hollow &= status == "not an ellipse"
        read = good | (status == "saturated") | hollow
        dots = (centres.xy_px, centres.moments_px2, centres.contrast_dn, centres.background_dn)
        xy_px, moments_px2, contrast_dn, background_dn = (values[read] for values in dots)
        asked_of = (image, xy_px, moments_px2, contrast_dn, background_dn, bits, radii)
        if decoder is None:
            code[read], affine[read], doubt[read] = decode(*asked_of, codes)
        else:
            code[read] = numbers_of(decoder(*asked_of), int(read.sum()))
        # A dot may have a hole or a cross in its middle where its ring can be read, which vouches for it.
        vouched = hollow & (code > 0) & (centres.contrast_dn >= LEAST_CONTRAST * noise) & ~_full(centres, sheet)
        status[vouched & (diameter >= smallest_px) & ~cut] = MEASURED
        code[hollow & ~vouched] = CROWDED
        good = status == MEASURED
        # Somebody else's numbers say nothing of where a ring's segments are.
        number = np.flatnonzero(code > 0) if decoder is None else np.zeros(0, int)
        words = words_of(code[number], bits, codes)
        rows = number[good[number]]
        if centroid == ROUGH:  # who asks for it is in a hurry
            rows = rows[_asked(doubt[rows])]
        of_row = np.searchsorted(number, rows)
        part = Centres(**{name: values[rows] for name, values in vars(centres).items()})
        rings = Rings(affine[rows], words[of_row], bits, radii)
        fitted, disagree, shape = compared(image, sheet, part, rings, doubt[rows], by_contour)
        # Estimators that know no ring keep clear of one that begins at two radii: nearer ones pull their centres.
        if centroid == WITH_RINGS or (by_contour and centroid != ROUGH and shape.inner < RING_BEGINS):
            done = np.flatnonzero(fitted.centres.ok)
            centres.put(rows[done], Centres(**{name: values[done] for name, values in vars(fitted.centres).items()}))
            # Alone such a dot would be centred with its ring's halo in it.
            status[rows[~fitted.centres.ok]] = "its ring cannot be fitted"
        status[rows[disagree]] = "partly hidden or disturbed"
        affine[number[repeats(words, bits)]] = np.nan
    if by_contour:
        asked = np.flatnonzero(good & (code >= 0))
        form = shapes(image, sheet, centres.xy_px[asked], centres.moments_px2[asked])
        form[wide[asked] & (form == DISC)] = UNTOLD
        status[asked[form == POLYGON]], code[asked[form == POLYGON]] = "a polygon", CROWDED
        dots, plain = status == MEASURED, code[asked] == PLAIN
        dots[asked] &= plain & ((form == DISC) | (form == UNTOLD))
        believed = believed_dots(centres, dots, asked[plain & (form == UNTOLD)], unclear)
        form[believed[asked]] = DISC
        for what, why in ((UNEVEN, "a ring or a spot"), (UNTOLD, "too blurred to tell its shape")):
            # A ring code that was read vouches for its dot.
            status[asked[(form == what) & (code[asked] == PLAIN)]] = why
        good &= status == MEASURED
    else:
        for kind in (good & (code == PLAIN), good & (code > 0)):
            others = kind if kind.sum() >= OTHERS else good & (code >= 0)
            status[kind & _disturbed(centres, others)] = "partly hidden or disturbed"
    for what, why in (
        (CROWDED, "surroundings are not a target's"),
        (UNREADABLE, "ring cannot be read"),
        (CUT, "ring cut by the image's edge"),
    ):
        status[good & (code == what)] = why
    _drop_ring_parts(centres.xy_px, centres.moments_px2, code, status, shape)
    xy_px = np.where(centres.ok[:, None], centres.xy_px, xy)
    moments = np.where(centres.ok[:, None, None], centres.moments_px2, moments)
    one = first_rows(xy_px, diameters(moments), code, status, centres.chi2)
    return Targets(
        xy_px=xy_px[one],
        cov_px2=centres.cov_px2[one],
        moments_px2=moments[one],
        chi2=centres.chi2[one],
        misfit=centres.misfit[one],
        code=code[one],
        affine=affine[one],
        status=status[one],
        background_dn=centres.background_dn[one],
        contrast_dn=centres.contrast_dn[one],
        left_out=blobs.left_out,
        radii=shape,
        passed_over={why: count for why, count in passed_over.items() if count},
        blobs=blobs,
    )


def _disturbed(centres: Centres, targets: np.ndarray) -> np.ndarray:
    """(n,) which dots fit clearly worse than the image's targets (a mask) usually do."""
    if not targets.any():
        return np.zeros(len(targets), bool)
    misfit, chi2 = (float(np.median(values[targets])) for values in (centres.misfit, centres.chi2))
    return (centres.misfit > max(DISTURBED, UNUSUAL * misfit)) & (centres.chi2 > DISTURBED_CHI2 * max(chi2, 1.0))


def _asked(doubt: np.ndarray) -> np.ndarray:
    """Rows of codes (n,) whose rings are compared with their models: the doubtful, and some to compare these with."""
    order = np.argsort(doubt)
    doubtful = order[doubt[order] > DOUBTFUL]
    return (
        np.sort(np.concatenate([doubtful, order[: len(order) - len(doubtful)][:OTHERS]])) if len(doubtful) else doubtful
    )


def _full(centres: Centres, sheet: SensorSheet) -> np.ndarray:
    """(n,) whether the white side of a dot's edge is as bright as a pixel can be."""
    if isinstance(sheet, InvertedSheet):
        white = sheet.largest_dn - centres.background_dn
    else:
        white = centres.background_dn + centres.contrast_dn
    return white >= NEARLY_FULL * sheet.saturation_dn


def _drop_ring_parts(
    xy: np.ndarray, moments: np.ndarray, code: np.ndarray, status: np.ndarray, radii: RingRadii
) -> None:
    """A segment of a ring may look like a dot: whatever lies on the ring of a decoded target is part of it."""
    dots = np.flatnonzero((code <= 0) & np.isfinite(xy).all(axis=1))
    rings = np.flatnonzero(code > 0)
    if len(dots) == 0 or len(rings) == 0:
        return
    end = radii.outer + 0.4
    reach = 2 * end * np.sqrt(np.linalg.eigvalsh(moments[rings])[:, 1])
    near = cKDTree(xy[dots]).query_ball_point(xy[rings], reach)
    ring = np.repeat(rings, [len(those) for those in near])
    dot = dots[np.concatenate(near).astype(int)]
    d = xy[dot] - xy[ring]
    q = np.sqrt(np.einsum("ni,nij,nj->n", d, np.linalg.inv(4 * moments[ring]), d))
    status[dot[(q > 1.2) & (q < end)]] = "part of a ring"
