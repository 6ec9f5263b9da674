"""Targets in a photograph of which nothing is known but what kind of targets it shows."""

from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np

from testfield.camera.images import InvertedSheet
from testfield.camera.photograph import Photograph
from testfield.detect.crown_boards import observed
from testfield.detect.crowns import read_crowns
from testfield.detect.eight_bits import pictures
from testfield.detect.every_dot import measured
from testfield.detect.grid_places import grid_places, runes
from testfield.detect.hints import exposure, of_boards, of_dots, of_grids, of_rings
from testfield.detect.knobs import DEFAULT, Knobs
from testfield.detect.noise import estimate_sheet
from testfield.detect.observations import MEASURED, TEXTURE, Observations
from testfield.detect.opencv_boards import detect_board
from testfield.detect.photo_corners import measure_read
from testfield.detect.target_spec import DOTS, TargetSpec
from testfield.targets.code_table import CodeTable
from testfield.targets.marks import USUAL, ring_radii, shape_name

ON_BLACK, ON_WHITE, AUTO = "white on black", "black on white", "auto"
SMALLEST_PX = 5.0
SAME_DOT = 0.25
"""A measured dot is one that was read where it is this near, in diameters."""


@dataclass(frozen=True)
class Found:
    """What a photograph shows: its `observations`, `place` (n, 2) column and row in a grid or -1, and `notes`;
    `passed_over` how many blobs of a dot's size have no row, by reason.

    Of tags `observations.code` is the number and `point` the corner; of grids and boards `point` is the index, row by
    row, and of a board of tags four to a tag.
    """

    observations: Observations
    place: np.ndarray
    notes: tuple[str, ...]
    passed_over: dict[str, int] = field(default_factory=dict)

    @property
    def numbers(self) -> np.ndarray:
        """Which numbers were read, ascending. A tag may have the number 0, which a dot without a code has too."""
        o = self.observations
        return np.unique(o.code[(o.code > 0) | ((o.code == 0) & (o.point >= 0) & (self.place[:, 0] < 0))])

    @property
    def summary(self) -> str:
        """One line for a person."""
        o = self.observations
        parts = [f"{int((o.status == MEASURED).sum())} measured"]
        if len(self.numbers):
            parts.append(f"{len(self.numbers)} numbers read")
        if (self.place >= 0).any():
            columns, rows = self.place.max(axis=0) + 1
            shown = f"grid of {columns} x {rows}" if rows > 1 else "in one tag"
            parts.append(f"{shown}, {int((self.place[:, 0] >= 0).sum())} places filled")
        refused = Counter(o.status[o.status != MEASURED].tolist())
        misfit = o.chi2[(o.status == MEASURED) & np.isfinite(o.chi2)]
        if len(misfit):
            parts.append(f"median chi-squared of the model {np.median(misfit):.2f}")
        if not len(o.status):
            parts.append("nothing there looks like one")
        if not (o.status == MEASURED).any():
            refused.update(self.passed_over)
        return "; ".join(parts + [f"{count} {why}" for why, count in refused.most_common(4)])


def detect_in_photograph(
    photograph: Photograph,
    target: TargetSpec,
    radii: str = USUAL,
    polarity: str = AUTO,
    smallest_px: float = SMALLEST_PX,
    codes: CodeTable | None = None,
    knobs: Knobs = DEFAULT,
) -> Found:
    """Everything of one kind in one photograph. `radii` the rings' shape, as 1:2:3; `polarity` one of the three; dots
    of less than `smallest_px` diameter are not looked for. An image that shows nothing gives an empty result. `codes`
    is the table of the rings' numbers where it is not that of their bits; `knobs` turn what is decided by default."""
    if target.kind not in ("ring", *DOTS):
        board = _of_crowns(photograph, target) if target.crowns else _of_board(photograph, target, smallest_px)
        if not len(board.observations):
            seen = of_boards(photograph, target) or of_dots(_plain_dots(photograph, smallest_px).observations)
            board = replace(board, notes=(*board.notes, *exposure(photograph), *seen))
        return board
    ways = (ON_BLACK, ON_WHITE) if polarity == AUTO else (polarity,)
    found = [_dots(photograph, target, way, radii, smallest_px, codes, knobs) for way in ways]
    best = max(found, key=_worth)
    shown = (best.observations.code > 0).any() or (best.place >= 0).any()
    return best if shown else replace(best, notes=(*best.notes, *exposure(photograph)))


def _worth(found: Found) -> tuple[int, ...]:
    """What a polarity is chosen by: codes, places in a grid, dots measured; where it has none of these, what was
    refused of the size and shape of a dot, so that the reason is told."""
    o = found.observations
    told = ~np.isin(o.status.astype(str), TEXTURE)
    return (
        int((o.code > 0).sum()),
        int((found.place[:, 0] >= 0).sum()),
        int((o.status == MEASURED).sum()),
        int(told.sum()),
        len(o),
    )


def _dots(
    photograph: Photograph,
    target: TargetSpec,
    polarity: str,
    radii: str,
    smallest_px: float,
    codes: CodeTable | None = None,
    knobs: Knobs = DEFAULT,
) -> Found:
    image, sheet = photograph.pixels, estimate_sheet(photograph.pixels, photograph.bits, photograph.end_dn)
    middle = float(np.median(image))
    noise = float(np.sqrt(sheet.variance_dn2(np.array(middle))))
    notes = [polarity, f"noise {noise:.2f} DN at the median of {middle:.0f} DN, estimated from the image"]
    if polarity == ON_WHITE:
        sheet = InvertedSheet(sheet.gain_e_per_dn, sheet.read_noise_e, 0.0, sheet.bits, sheet.full_well_e)
        image = sheet.largest_dn - image
    bits, shape = target.bits if target.kind == "ring" else None, ring_radii(radii)

    targets, said = measured(image, sheet, bits, shape, smallest_px, codes, knobs)
    notes += said
    place, rune = np.full((len(targets.code), 2), -1), np.full(len(targets.code), -1)
    if target.unknown_rune:
        rune = runes(targets)
        if not (rune >= 0).any():
            notes.append(f"no RUNE-Tag of 129 places among {int((targets.status == MEASURED).sum())} dots")
    elif target.kind in DOTS:
        place = grid_places(targets, target, (image.shape[1], image.shape[0]))
        if target.kind == "runetag" and not (place >= 0).any():
            notes.append(f"no RUNE-Tag of number {target.first} among {int((targets.status == MEASURED).sum())} dots")
        elif target.columns and not (place >= 0).any():
            notes.append(f"no grid of {target.columns} x {target.rows} dots, or one that is part of a larger grid")
            notes += of_grids(targets.observations(photograph.name, place[:, 0], place[:, 0]), target)
    if targets.left_out:
        notes.append(f"{targets.left_out} blobs more than can be looked at were left out")
    numbers, count = np.unique(targets.code[targets.code > 0], return_counts=True)
    if (count > 1).any() and not target.unknown_rune:
        notes.append(f"read more than once: {', '.join(map(str, numbers[count > 1]))}")
    if target.kind == "ring":
        if targets.radii is not None and targets.radii != shape:
            notes.append(f"the rings are {shape_name(targets.radii)}, not {shape_name(shape)}")
        seen = targets.observations(photograph.name, place[:, 0], place[:, 0])
        notes += of_rings(image, seen, targets.background_dn, targets.contrast_dn)
    none = np.full(len(targets.code), -1)
    columns = place[:, 0].max(initial=-1) + 1
    point = np.where(place[:, 0] >= 0, place[:, 1] * columns + place[:, 0], rune)
    return Found(targets.observations(photograph.name, none, point), place, tuple(notes), targets.passed_over)


def _of_crowns(photograph: Photograph, target: TargetSpec) -> Found:
    """CCTags by their numbers."""
    image, sheet = photograph.pixels, estimate_sheet(photograph.pixels, photograph.bits, photograph.end_dn)
    found, unread = read_crowns(image, list(pictures(image)), sheet, target.crowns)
    notes = [f"{unread} things of circles one within the other that are none of these tags"] if unread else []
    numbers = [one.number for one in found]
    if twice := sorted({number for number in numbers if numbers.count(number) > 1}):
        notes.append(f"read more than once: {', '.join(map(str, twice))}")
    none = np.full(len(found), -1)
    observations = observed(photograph.name, found, none, np.zeros(len(found), int), codes=True)
    return Found(observations, np.full((len(found), 2), -1), tuple(notes))


def _of_board(photograph: Photograph, target: TargetSpec, smallest_px: float) -> Found:
    corners = detect_board(photograph.pixels, target)
    observations, notes = measure_read(photograph, target, corners)
    place = corners.place
    if target.kind == "acircles" and len(observations):
        notes = _measured_dots(observations, _plain_dots(photograph, smallest_px).observations.measured)
    if target.kind == "checkerboard" and len(observations):
        place = np.column_stack([observations.point % target.columns, observations.point // target.columns])
    return Found(observations, place, (*corners.notes, *notes))


def _plain_dots(photograph: Photograph, smallest_px: float) -> Found:
    ways = (_dots(photograph, TargetSpec("circles"), way, USUAL, smallest_px) for way in (ON_WHITE, ON_BLACK))
    return max(ways, key=_worth)


def _measured_dots(read: Observations, dots: Observations) -> tuple[str, ...]:
    """Put measured dots in the place of those that were only read, and say how many were not."""
    if len(dots):
        gap = np.linalg.norm(read.xy_px[:, None] - dots.xy_px[None], axis=2)
        same = gap.argmin(axis=1)
        near = gap.min(axis=1) < SAME_DOT * dots.diameter_px[same]
        for name in ("xy_px", "cov_px2", "moments_px2", "chi2", "status"):
            getattr(read, name)[near] = getattr(dots, name)[same[near]]
    left = int((read.status != MEASURED).sum())
    return (f"{left} dots are as OpenCV read them",) if left else ()
