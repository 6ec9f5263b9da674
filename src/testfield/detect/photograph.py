"""Targets in a photograph of which nothing is known but what kind of targets it shows."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from testfield.camera.images import InvertedSheet
from testfield.camera.photograph import Photograph
from testfield.detect.circle_grid import order_grid
from testfield.detect.detect import Targets, measure_targets
from testfield.detect.noise import estimate_sheet
from testfield.detect.observations import MEASURED, TEXTURE, Observations
from testfield.detect.opencv_boards import detect_board
from testfield.detect.photo_corners import measure_read
from testfield.detect.target_spec import TargetSpec
from testfield.targets.marks import RADII, USUAL

ON_BLACK, ON_WHITE, AUTO = "white on black", "black on white", "auto"
SMALLEST_PX = 5.0


@dataclass(frozen=True)
class Found:
    """What a photograph shows: its `observations`, `place` (n, 2) column and row in a grid or -1, and `notes`.

    Of tags `observations.code` is the number and `point` the corner; of grids and boards `point` is the index, row by
    row.
    """

    observations: Observations
    place: np.ndarray
    notes: tuple[str, ...]

    @property
    def summary(self) -> str:
        """One line for a person."""
        o = self.observations
        parts = [f"{int((o.status == MEASURED).sum())} measured"]
        codes = o.code[o.code > 0]
        if len(codes):
            parts.append(f"{len(np.unique(codes))} numbers read")
        if (self.place >= 0).any():
            columns, rows = self.place.max(axis=0) + 1
            parts.append(f"grid of {columns} x {rows}, {int((self.place[:, 0] >= 0).sum())} places filled")
        refused = Counter(o.status[o.status != MEASURED].tolist())
        misfit = o.chi2[(o.status == MEASURED) & np.isfinite(o.chi2)]
        if len(misfit):
            parts.append(f"median chi-squared of the model {np.median(misfit):.2f}")
        if not len(o.status):
            parts.append("nothing there looks like one")
        return "; ".join(parts + [f"{count} {why}" for why, count in refused.most_common(4)])


def detect_in_photograph(
    photograph: Photograph,
    target: TargetSpec,
    radii: str = USUAL,
    polarity: str = AUTO,
    smallest_px: float = SMALLEST_PX,
) -> Found:
    """Everything of one kind in one photograph. `radii` a key of `RADII`; `polarity` one of the three; dots of less
    than `smallest_px` diameter are not looked for. An image that shows nothing gives an empty result."""
    if target.kind not in ("ring", "circles"):
        return _of_board(photograph, target)
    ways = (ON_BLACK, ON_WHITE) if polarity == AUTO else (polarity,)
    found = [_dots(photograph, target, way, radii, smallest_px) for way in ways]
    return max(found, key=_worth)


def _worth(found: Found) -> tuple[int, ...]:
    """What a polarity is chosen by: codes, places in a grid, dots measured; where it has none of these, what was
    refused of the size and shape of a dot, so that the reason is told."""
    o = found.observations
    told = ~np.isin(o.status.astype(str), TEXTURE)
    return (
        int((o.code > 0).sum()), int((found.place[:, 0] >= 0).sum()), int((o.status == MEASURED).sum()),
        int(told.sum()), len(o),
    )  # fmt: skip


def _dots(photograph: Photograph, target: TargetSpec, polarity: str, radii: str, smallest_px: float) -> Found:
    image, sheet = photograph.pixels, estimate_sheet(photograph.pixels, photograph.bits, photograph.end_dn)
    middle = float(np.median(image))
    noise = float(np.sqrt(sheet.variance_dn2(np.array(middle))))
    notes = [polarity, f"noise {noise:.2f} DN at the median of {middle:.0f} DN, estimated from the image"]
    if polarity == ON_WHITE:
        sheet = InvertedSheet(sheet.gain_e_per_dn, sheet.read_noise_e, 0.0, sheet.bits, sheet.full_well_e)
        image = sheet.largest_dn - image
    bits = target.bits if target.kind == "ring" else None
    targets = measure_targets(image, sheet, "ellipse_model", smallest_px, bits, RADII[radii], by_contour=True)
    place = np.full((len(targets.code), 2), -1)
    if target.kind == "circles":
        place = _grid_places(targets, target)
        if target.columns and not (place >= 0).any():
            notes.append(f"no grid of {target.columns} x {target.rows} dots, or one that is part of a larger grid")
    if targets.left_out:
        notes.append(f"{targets.left_out} blobs more than can be looked at were left out")
    numbers, count = np.unique(targets.code[targets.code > 0], return_counts=True)
    if (count > 1).any():
        notes.append(f"read more than once: {', '.join(map(str, numbers[count > 1]))}")
    none = np.full(len(targets.code), -1)
    columns = place[:, 0].max(initial=-1) + 1
    point = np.where(place[:, 0] >= 0, place[:, 1] * columns + place[:, 0], -1)
    return Found(targets.observations(photograph.name, none, point), place, tuple(notes))


def _grid_places(targets: Targets, target: TargetSpec) -> np.ndarray:
    good = targets.status == MEASURED
    place = np.full((len(good), 2), -1)
    diameter = 4 * np.linalg.det(targets.moments_px2[good]) ** 0.25
    place[good] = order_grid(targets.xy_px[good], diameter, target.columns, target.rows)
    return place


def _of_board(photograph: Photograph, target: TargetSpec) -> Found:
    corners = detect_board(photograph.pixels, target)
    observations, notes = measure_read(photograph, target, corners)
    return Found(observations, corners.place, (*corners.notes, *notes))
