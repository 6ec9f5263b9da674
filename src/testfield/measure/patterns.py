"""Boards that calibrate a camera by their print: the sheet of each, and which of its points each photograph shows."""

from collections import Counter
from dataclasses import dataclass, replace

import cv2
import numpy as np

from testfield.camera.photograph import Photograph
from testfield.detect.knobs import DEFAULT, Knobs
from testfield.detect.observations import MEASURED, READ, Observations
from testfield.detect.photograph import AUTO, SMALLEST_PX, Found, detect_in_photograph
from testfield.detect.target_spec import TargetSpec, parse_target
from testfield.errors import TestfieldError
from testfield.measure.beside_boards import numbered
from testfield.targets.board_pattern import BoardPattern, dictionaries
from testfield.targets.code_table import CodeTable
from testfield.targets.field import Field, NominalBoard
from testfield.targets.field_file import FieldFile, PatternPart
from testfield.targets.marks import USUAL, Marks

NOMINAL_U, NOMINAL_U_FLAT = 0.002, 0.01
"""Standard uncertainties of a point's place and height on a board that nobody measured, in spacings: 0.06 and 0.3 mm at
30 mm, as office printers place toner and as paper lies on a plate."""
NOMINAL_U_SCALE = 0.005
"""The same of the spacing itself: printers and plotters are off by some tenths of a percent."""
SAME_FIT = 1.05
"""Ways to number a grid whose misfits differ by less are alike: the first is taken."""


@dataclass(frozen=True)
class Pattern:
    """A board that a field file declares: its `name`, what it looks like, and what is known of it."""

    name: str
    target: TargetSpec
    part: PatternPart

    @property
    def u_mm(self) -> tuple[float, float]:
        """Standard uncertainties of a point's place in the plane and of its height."""
        u, flat, step = self.part.u_mm, self.part.u_flat_mm, board_pattern(self.target).pitch_mm
        return NOMINAL_U * step if u is None else u, NOMINAL_U_FLAT * step if flat is None else flat

    @property
    def u_scale(self) -> float:
        """Relative standard uncertainty of the spacing."""
        if self.part.u_scale is not None:
            return self.part.u_scale
        return NOMINAL_U_SCALE if self.part.u_mm is None else 0.0


def patterns_of(field: FieldFile, source: str) -> tuple[Pattern, ...]:
    """The boards that calibrate, as a field file at `source` declares them. Raises `TestfieldError` for kinds that are
    no boards."""
    answer = []
    for k, part in enumerate(field.calibrating):
        where = f"{source}, patterns.{k + 1}.kind" if field.patterns else source
        target = parse_target(part.kind, where)
        if not target.is_board:
            raise TestfieldError(
                f"'{part.kind}' does not say where its points lie", where, "give a board, as checkerboard:9x6:25"
            )
        if target.dictionary and target.dictionary.upper() not in [name.upper() for name in dictionaries()]:
            raise TestfieldError(f"no dictionary is called '{target.dictionary}'", where, "name one of OpenCV's")
        answer.append(Pattern(part.name or part.kind, target, part))
    return tuple(answer)


def look_for(
    photograph: Photograph,
    boards: tuple[tuple[str, TargetSpec], ...],
    polarity: str,
    smallest_px: float = SMALLEST_PX,
    knobs: Knobs = DEFAULT,
    coded: tuple[TargetSpec, str, CodeTable | None] | None = None,
) -> Found:
    """What a photograph shows of all boards, their names with their kinds, together: `board` of each observation is the
    board's number. `coded` are targets beside them (kind, rings' shape, table), as if of one board more; `polarity` is
    theirs then."""
    way = polarity if coded is None else AUTO
    parts = [detect_in_photograph(photograph, target, USUAL, way, smallest_px, None, knobs) for _, target in boards]
    if len(parts) == 1 and coded is None:
        return _of_pattern(parts[0], 0)
    boarded = [_of_pattern(part, b) for b, part in enumerate(parts)]
    if coded is not None:
        target, radii, codes = coded
        parts.append(detect_in_photograph(photograph, target, radii, polarity, smallest_px, codes, knobs))
        boarded.append(_beside(parts[-1], len(boards)))
        boards = (*boards, (target.kind, target))
    notes = [f"{name}: {note}" for (name, _), part in zip(boards, parts, strict=True) for note in part.notes]
    discs = any(part.observations.centre_of_disc for part in parts if len(part.observations))
    joined = Observations.beside([part.observations for part in boarded])
    return Found(
        replace(joined, centre_of_disc=discs), np.vstack([part.place for part in boarded]), tuple(dict.fromkeys(notes))
    )


def _beside(found: Found, b: int) -> Found:
    o = found.observations
    # Where rows are projections of centres themselves, no disc's moments may be taken for more.
    moments = o.moments_px2 if o.centre_of_disc else np.full_like(o.moments_px2, np.nan)
    return replace(found, observations=replace(o, board=np.full(len(o), b), moments_px2=moments))


def _of_pattern(found: Found, b: int) -> Found:
    o = found.observations
    on = (o.point >= 0) & ((o.status == MEASURED) | (o.status == READ))
    return replace(found, observations=replace(o, board=np.where(on, b, -1)))


def of_boards(
    found: list[Found],
    names: tuple[str, ...],
    patterns: tuple[Pattern, ...],
    white_on_black: bool | None = None,
    coded: TargetSpec | None = None,
) -> tuple[Observations, Field, list[str]]:
    """The observations of all images with `board` and `point` of the boards' sheet, the sheet, and notes.

    What was read where no model could be fitted takes part with the uncertainty of such readings. A dot's diameter that
    nobody told is measured against the spacing. Of targets `coded` beside the boards the numbers are kept.
    """
    o = Observations.join([one.observations for one in found], names)
    discs = any(one.observations.centre_of_disc for one in found if len(one.observations))
    place = np.concatenate([one.place for one in found])
    board, point, status = np.full(len(o), -1), np.full(len(o), -1), o.status.copy()
    # An image in which nothing was found says nothing of the others' discs.
    boards, notes = [], []
    for b, pattern in enumerate(patterns):
        here = (o.board == b) & np.isfinite(o.xy_px).all(axis=1) & np.isfinite(o.cov_px2).all(axis=(1, 2))
        board_pattern, number, said = _numbered(pattern, o, here, place)
        notes += said
        read = here & (number >= 0) & (o.status == READ)
        if read.any():
            notes.append(
                f"{int(read.sum())} of {int(here.sum())} points of '{pattern.name}' are as they were read, and take "
                "part with the uncertainty of such readings"
            )
        status[read] = MEASURED
        board[here & (number >= 0)] = b
        point[here & (number >= 0)] = number[here & (number >= 0)]
        u, u_flat = pattern.u_mm
        n = len(board_pattern.points_mm)
        marks = Marks(board_pattern.points_mm, board_pattern.diameters_mm, np.zeros(n, int), 14)
        half = 2 * board_pattern.half_mm
        boards.append(NominalBoard(pattern.name, marks, u, u_flat, board_pattern, (float(half[0]), float(half[1]))))
        if not pattern.target.sized:
            notes.append(f"nobody said the spacing of '{pattern.name}': it is called 1 mm, and lengths are in spacings")
        elif pattern.part.u_mm is None:
            notes.append(
                f"'{pattern.name}' is taken as printed: each point to {u:.2g} mm in the plane and {u_flat:.2g} mm in "
                f"height, the spacing to {100 * pattern.u_scale:.2g} %; a field file's [[patterns]] can tell better"
            )
    # A number that a tag had is that of its board's point now.
    beside = o.board == len(patterns) if coded else np.zeros(len(o), bool)
    named = replace(o, board=board, point=np.where(beside, o.point, point), status=status, centre_of_disc=discs)
    named = numbered(named, beside, coded or patterns[0].target)
    scale = max((pattern.u_scale for pattern in patterns), default=0.0)
    return named, Field(14, tuple(boards), white_on_black=bool(white_on_black), u_scale=scale), notes


def board_pattern(target: TargetSpec, mark_mm: float | None = None, turned: bool = False) -> BoardPattern:
    """What a kind of board shows. `mark_mm` of its dots where nobody said; `turned`: columns and rows exchanged."""
    columns, rows = (target.rows, target.columns) if turned else (target.columns, target.rows)
    if target.kind == "checkerboard":
        return BoardPattern("checkerboard", columns + 1, rows + 1, target.square_mm)
    if target.kind in ("circles", "acircles", "hexcircles"):
        if target.kind == "circles":
            columns, rows = target.upright
        diameter = target.marker_mm if mark_mm is None else mark_mm
        return BoardPattern(target.kind, columns, rows, target.square_mm, diameter)
    if target.kind in ("aprilgrid", "runetag"):
        return target.pattern()
    if target.kind == "squares":
        return BoardPattern(target.kind, *target.upright, target.square_mm, target.marker_mm)
    names = {name.upper(): name for name in dictionaries()}[target.dictionary.upper()]
    return BoardPattern(target.kind, columns, rows, target.square_mm, target.marker_mm, names, target.first)


def _numbered(
    pattern: Pattern, o: Observations, here: np.ndarray, place: np.ndarray
) -> tuple[BoardPattern, np.ndarray, list[str]]:
    """What the board shows, and (n,) which of its points the observations `here` (n,) are, -1 for none."""
    target = pattern.target
    notes: list[str] = []
    if target.kind in ("tags", "aprilgrid", "squares"):
        return board_pattern(target), np.where(here, o.point, -1), notes
    if target.kind == "runetag":
        return board_pattern(target), np.where(here, place[:, 0], -1), notes
    images = [np.flatnonzero(here & (o.station == s)) for s in range(len(o.stations))]
    images = [rows for rows in images if len(rows)]
    shown = board_pattern(target)
    grid = _grid_of(shown)
    sizes = Counter(tuple((place[rows].max(axis=0) + 1).tolist()) for rows in images)
    wider = sum(count for size, count in sizes.items() if (np.array(size) > grid).any())
    if target.kind == "charuco" and 2 * wider > len(images):
        shown = board_pattern(target, turned=True)
        grid = _grid_of(shown)
        notes.append(f"'{pattern.name}' has {shown.columns} x {shown.rows} squares, its columns and rows exchanged")
    if target.kind in ("circles", "acircles", "hexcircles") and not target.mark_sized:
        ratio = _diameter_over_spacing(shown, o, place, images)
        if ratio is not None:
            shown = board_pattern(target, ratio * target.square_mm)
            notes.append(f"the dots of '{pattern.name}' are {ratio:.3f} spacings wide as the images show them")
    number = np.full(len(o), -1)
    for rows in images:
        inside = (place[rows] < grid).all(axis=1) & (place[rows] >= 0).all(axis=1)
        if not inside.all():
            size = place[rows].max(axis=0) + 1
            notes.append(
                f"image '{o.stations[o.station[rows[0]]]}' shows a grid of {size[0]} x {size[1]}, not of "
                f"{grid[0]} x {grid[1]}: it is left out"
            )
            continue
        number[rows] = _turned(shown, place[rows], o.xy_px[rows])
    return shown, number, notes


def _grid_of(pattern: BoardPattern) -> np.ndarray:
    """(2,) columns and rows of a pattern's points."""
    inner = int(pattern.has_corners)
    return np.array([pattern.columns - inner, pattern.rows - inner])


def _turned(pattern: BoardPattern, place: np.ndarray, xy_px: np.ndarray) -> np.ndarray:
    """(n,) numbers of points of a grid by column and row (n, 2), counted from another corner where they would be seen
    from behind, or where their rows are staggered otherwise."""
    columns, rows = _grid_of(pattern)
    last = np.array([columns - 1, rows - 1])
    if pattern.kind not in ("checkerboard", "acircles") or len(place) < 6:
        return np.asarray(place[:, 1] * columns + place[:, 0])
    best, least = place[:, 1] * columns + place[:, 0], np.inf
    for flip in ((0, 0), (1, 1), (1, 0), (0, 1)):
        there = np.where(np.array(flip, bool), last - place, place)
        number = there[:, 1] * columns + there[:, 0]
        H, _ = cv2.findHomography(pattern.points_mm[number], xy_px)
        if H is None or np.linalg.det(H) >= 0:
            continue
        seen = cv2.perspectiveTransform(pattern.points_mm[number][None], H)[0]
        misfit = float(np.sqrt(((seen - xy_px) ** 2).sum(axis=1).mean()))
        if misfit * SAME_FIT < least:
            best, least = number, misfit
    return np.asarray(best)


def _diameter_over_spacing(
    pattern: BoardPattern, o: Observations, place: np.ndarray, images: list[np.ndarray]
) -> float | None:
    """The dots' diameter in spacings: areas of ellipses over those of the board's unit squares at the same places, both
    of which perspective makes alike smaller. None where no dot's area is known."""
    ratios = []
    for rows in images:
        inside = rows[(place[rows] < _grid_of(pattern)).all(axis=1)]
        area = np.pi * o.diameter_px[inside] ** 2 / 4
        number = place[inside, 1] * _grid_of(pattern)[0] + place[inside, 0]
        if len(inside) < 6 or not np.isfinite(area).any():
            continue
        H, _ = cv2.findHomography(pattern.points_mm[number], o.xy_px[inside])
        if H is None:
            continue
        depth = np.column_stack([pattern.points_mm[number], np.ones(len(number))]) @ H[2]
        square = abs(np.linalg.det(H)) / np.abs(depth) ** 3 * pattern.pitch_mm**2
        ratios.append(float(np.nanmedian(np.sqrt(4 * area / np.pi / square))))
    return float(np.median(ratios)) if ratios else None
