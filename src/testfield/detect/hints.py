"""What a photograph shows where what was asked for is not found: one sentence for each thing that was seen."""

from collections import Counter
from dataclasses import replace

import cv2
import numpy as np

from testfield.camera.photograph import Photograph
from testfield.detect.circle_grid import order_grid
from testfield.detect.decode import decode
from testfield.detect.eight_bits import pictures
from testfield.detect.noise import noise_of_pixels
from testfield.detect.observations import MEASURED, SURROUNDED, Observations
from testfield.detect.opencv_boards import detect_board
from testfield.detect.ring_shape import seen_shape
from testfield.detect.small_tags import tag_detector
from testfield.detect.target_spec import TargetSpec
from testfield.targets.board_pattern import dictionaries, dictionary
from testfield.targets.marks import RADII, RingRadii, shape_name
from testfield.targets.ring_code import BITS

BLANK_SIGMAS, MOSTLY, DARK = 12.0, 0.5, 0.03
"""A range of less than the first is nothing but noise; more than the second part of all pixels full is too long an
exposure, all below the third part of the range is too short a one."""
LEAST_CODES, LEAST_TAGS = 3, 2
LARGEST_PX = 1600
"""Larger images are reduced before other dictionaries and sizes are tried."""


def exposure(photograph: Photograph) -> tuple[str, ...]:
    """Whether the image is blank, or mostly too bright or too dark to show anything."""
    pixels, end = photograph.pixels, (1 << photograph.bits) - 1
    high = float(np.percentile(pixels, 99.5))
    full = float((pixels >= end).mean())
    if full > MOSTLY:
        return (f"over-exposed: {100 * full:.0f} % of the pixels are full",)
    if high < DARK * end:
        return (f"under-exposed: of {end} DN the brightest pixels have {high:.0f}",)
    if pixels.max() - pixels.min() < BLANK_SIGMAS * noise_of_pixels(pixels):
        return (f"blank: all pixels are {np.median(pixels):.0f} DN but for noise",)
    return ()


def of_rings(image: np.ndarray, o: Observations, background_dn: np.ndarray, contrast_dn: np.ndarray) -> tuple[str, ...]:
    """Dots with something around them that is not the ring code asked for, and as which other code they can be read;
    nothing where more rings are read as asked for than are not.

    `image` (h, w) of bright marks; the levels (n,) of each row of `o` as in `Centres`."""
    ringed = np.flatnonzero(np.isin(o.status.astype(str), SURROUNDED))
    read = len(np.unique(o.code[o.code > 0]))
    plain = int((o.status == MEASURED).sum())
    said = [f"{plain} dots without a ring"] if plain and not read else []
    if len(ringed) <= read:
        return tuple(said)
    if not read:
        said.append(f"{len(ringed)} dots with something around them: another shape of rings or another code system?")
    # A ring of another length is read by chance now and then, so another code must read more than was read already.
    levels = o.xy_px[ringed], o.moments_px2[ringed], contrast_dn[ringed], background_dn[ringed]
    best, as_what = max(LEAST_CODES - 1, 2 * read), ""
    seen = seen_shape(image, *levels)
    tried = dict(RADII)
    if seen is not None:
        rounded = RingRadii(round(20 * seen.inner) / 20, round(20 * seen.outer) / 20)
        tried.setdefault(shape_name(rounded), rounded)
    for radii, shape in tried.items():
        for bits in BITS:
            code = decode(image, *levels, bits, shape)[0]
            count = len(np.unique(code[code > 0]))
            if count > best:
                best, as_what = count, f"--target ring{bits} --radii {radii} reads {count} numbers"
    return (*said, as_what) if as_what else tuple(said)


def of_grids(o: Observations, target: TargetSpec) -> tuple[str, ...]:
    """The largest grid that the measured dots make up, beside the one asked for."""
    dots, columns, rows, here = _largest_grid(o)
    if not here:
        return (f"{dots} dots, which make up no grid",) if dots else ()
    missing = columns * rows - here
    but = f", {missing} of them missing" if missing else ""
    return (f"a grid of {columns} x {rows} dots{but}; {target.columns} x {target.rows} were asked for",)


def of_boards(photograph: Photograph, target: TargetSpec) -> tuple[str, ...]:
    """Tags of other dictionaries, boards and asymmetric grids of other sizes."""
    pixels = photograph.pixels
    scale = LARGEST_PX / max(pixels.shape)
    if scale < 1:
        pixels = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    try:
        if target.kind == "checkerboard":
            return _other_checkerboard(pixels, target)
        if target.kind == "acircles":
            return _other_asymmetric(pixels, target)
        if target.kind in ("charuco", "aruco", "apriltag", "tags"):
            return _other_tags(pixels, target)
    except cv2.error:
        return ()
    return ()


def _other_checkerboard(pixels: np.ndarray, target: TargetSpec) -> tuple[str, ...]:
    for picture in pictures(pixels):
        found, _, cells = cv2.findChessboardCornersSBWithMeta(picture, (3, 3), cv2.CALIB_CB_LARGER)
        if found and cells is not None:
            rows, columns = sorted(cells.shape[:2], reverse=target.rows > target.columns)
            return (
                f"a checkerboard of {columns} x {rows} inner corners; {target.columns} x {target.rows} were asked for",
            )
    return ()


def _other_asymmetric(pixels: np.ndarray, target: TargetSpec) -> tuple[str, ...]:
    columns, rows = target.columns, target.rows
    if rows % 2 == 0:
        return (
            "an asymmetric grid of an even number of rows looks alike upside down, and OpenCV finds none: "
            "columns x rows of a printed one has an odd number of rows, as 4x11",
        )
    near = [(columns + c, rows + r) for c in (0, -1, 1) for r in (0, -1, 1, -2, 2) if (c, r) != (0, 0)]
    for size in ((rows, columns), *near):
        if min(size) > 1 and len(detect_board(pixels, replace(target, columns=size[0], rows=size[1])).point):
            return (f"an asymmetric grid of {size[0]} x {size[1]} dots; {columns} x {rows} were asked for",)
    return ()


def of_dots(dots: Observations) -> tuple[str, ...]:
    """What the dots (`measured` as such) of an image are that was asked for something else."""
    count, columns, rows, here = _largest_grid(dots)
    if count < LEAST_CODES:
        return ()
    if here and here == columns * rows:
        return (f"a grid of {columns} x {rows} dots (--target circles:{columns}x{rows})",)
    return (f"{count} dots (--target circles, or ring14 where they have rings)",)


def _largest_grid(o: Observations) -> tuple[int, int, int, int]:
    """How many dots are measured; columns and rows of the largest grid they make up, and how many of them are in it."""
    good = o.take(np.isfinite(o.xy_px).all(axis=1) & (o.status == MEASURED))
    place = order_grid(good.xy_px, good.diameter_px)
    here = place[:, 0] >= 0
    columns, rows = place[here].max(axis=0, initial=-1) + 1
    return len(good), int(columns), int(rows), int(here.sum())


def _other_tags(pixels: np.ndarray, target: TargetSpec) -> tuple[str, ...]:
    """Which dictionary reads the most, of each size the largest; the board's own too, whose layout may be another."""
    counts: Counter[str] = Counter()
    most: dict[str, int] = {}
    for inverted in (False, True):
        for name in dictionaries():
            if name.endswith(("_50", "_100", "_250")):
                continue
            for picture in pictures(pixels):
                numbers = tag_detector(dictionary(name)).detectMarkers(255 - picture if inverted else picture)[1]
                if numbers is not None and len(numbers) > counts[name]:
                    counts[name], most[name] = len(numbers), int(np.max(numbers))
        if max(counts.values(), default=0) >= LEAST_TAGS:
            break
    if not counts:
        return ()
    name, count = max(counts.items(), key=lambda item: (item[1], item[0]))
    if count < LEAST_TAGS:
        return ()
    small = name.replace("_1000", f"_{next(n for n in (50, 100, 250, 1000) if most[name] < n)}")
    if target.kind in ("charuco", "tags") and small.split("_")[:2] == target.dictionary.upper().split("_")[:2]:
        return (f"{count} tags of {small}, the largest number {most[name]}: a board of another layout?",)
    return (f"{count} tags of {small}; {target.dictionary} was asked for",)
