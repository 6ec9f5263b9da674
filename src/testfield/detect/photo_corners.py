"""Corners that OpenCV found in a photograph, measured by the corner model where its pixels allow it.

Nobody described the sensor, so the noise is estimated from the image, and what the model leaves unexplained widens the
covariance. Where the model does not fit, the place at which OpenCV read the corner stays, with the status `read` and
the covariance of such readings.
"""

from collections import Counter
from dataclasses import astuple

import numpy as np

from testfield.camera.images import Frame, InvertedSheet, SensorSheet
from testfield.camera.photograph import Photograph
from testfield.detect.corner_model import FARTHEST_PX
from testfield.detect.edge_shift import edge_shift, outwards
from testfield.detect.noise import estimate_sheet
from testfield.detect.observations import MEASURED, READ, Observations
from testfield.detect.opencv_boards import Corners
from testfield.detect.square_boards import Seen, detect_squares, measure_corners
from testfield.detect.target_spec import TargetSpec
from testfield.targets.board_pattern import CORNERS_A_TAG, BoardPattern, dictionaries, dictionary
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks

SAME_PX = 1.5
"""The model's corner is OpenCV's where it is this near."""
READ_PX = {
    "charuco": 0.25,
    "checkerboard": 0.25,
    "aruco": 0.8,
    "apriltag": 0.8,
    "tags": 0.8,
    "aprilgrid": 0.4,
    "squares": 0.8,
    "acircles": 0.25,
}
"""Standard deviations of what is read before a model is fitted, in each direction."""
QUIET_CELLS = (1.0, 0.5, 0.25)
"""White around a tag, in cells: what its makers ask for, and less where it is not there."""
TAG_MM = 1.0


def measure_read(photograph: Photograph, target: TargetSpec, found: Corners) -> tuple[Observations, tuple[str, ...]]:
    """All corners that were `found`, by the model or as they were read, and notes on the latter.

    The points of a checkerboard are counted as it is printed, from its black corner square at the top left, where the
    model told which way up it is, else as OpenCV read them.
    """
    o = _as_read(photograph.name, target, found)
    if not len(o):
        return o, ()
    image, sheet = photograph.pixels, estimate_sheet(photograph.pixels, photograph.bits, photograph.end_dn)
    if found.inverted:
        image, sheet = _inverted(image, sheet)
    if target.kind in ("aruco", "apriltag"):
        corners = _tags(image, sheet, photograph.name, target, found)
    else:
        field = Field(14, _boards(target, found))
        corners, _ = detect_squares(Frame(photograph.name, image, sheet), field)
        if target.kind == "checkerboard" and not len(corners):  # OpenCV reads it either way
            corners, _ = detect_squares(Frame(photograph.name, *_inverted(image, sheet)), field)
    if not len(corners):
        return o, (f"all {len(o)} points are as they were read: no model can be fitted",)
    if target.kind == "checkerboard":  # a board that is read either way is there twice
        corners = corners.take(corners.board == corners.board.min())
    gap = np.linalg.norm(o.xy_px[:, None] - corners.xy_px[None], axis=2)
    if target.kind in ("aruco", "apriltag"):  # tag by tag it is known which corner is which
        tag = np.arange(len(o)) // CORNERS_A_TAG
        gap[(corners.board != tag[:, None]) | (corners.point != o.point[:, None])] = np.inf
    if target.kind in ("tags", "squares"):
        gap[corners.point != o.point[:, None]] = np.inf
    same = gap.argmin(axis=1)
    near = gap.min(axis=1) < (FARTHEST_PX if target.kind in ("aruco", "apriltag", "tags", "squares") else SAME_PX)
    if target.kind == "checkerboard":
        o.point[:] = as_printed(o.point, corners.point[same], near, target, bool(corners.board[0]))
    good = near & (corners.status[same] == MEASURED)
    for name in ("xy_px", "cov_px2", "moments_px2", "chi2", "status"):
        getattr(o, name)[good] = getattr(corners, name)[same[good]]
    why = Counter(np.where(near, corners.status[same], "no model near")[~good].tolist())
    told = "; ".join(f"{count} {reason}" for reason, count in why.most_common())
    notes = [f"{int((~good).sum())} points are as they were read ({told})"] if told else []
    if target.kind in ("tags", "squares"):
        notes += _without_edge_shift(o, _boards(target, found)[0].pattern)
    return o, tuple(notes)


def _without_edge_shift(o: Observations, pattern: BoardPattern | None) -> list[str]:
    """Take from the measured corners of squares and tags what moves all their edges alike, and say by how much."""
    assert pattern is not None
    order = np.argsort(o.point, kind="stable")
    tag = o.point[order] // CORNERS_A_TAG
    whole = np.flatnonzero(np.bincount(tag) == CORNERS_A_TAG)
    rows = order[np.isin(tag, whole)].reshape(-1, CORNERS_A_TAG)
    told = (o.status[rows] == MEASURED).all(axis=1)
    corners_mm = pattern.points_mm.reshape(-1, CORNERS_A_TAG, 2)[whole]
    shift, u, _ = edge_shift(corners_mm[told], o.xy_px[rows[told]])
    if not shift:
        return []
    # A corner moves with its two edges, whether or not all others of its square were measured.
    measured = o.status[rows] == MEASURED
    rows, away = rows[measured], shift * outwards(o.xy_px[rows])[measured]
    o.xy_px[rows] -= away
    o.cov_px2[rows] += (u / shift) ** 2 * away[:, :, None] * away[:, None, :]
    return [f"edges lie {shift:+.3f} px outwards of where their spacing has them ({u:.3f}); corners are freed of it"]


def as_printed(
    read: np.ndarray, printed: np.ndarray, known: np.ndarray, target: TargetSpec, turned: bool
) -> np.ndarray:
    """(n,) numbers of the points of a grid as it is printed, row by row, of their numbers as they were `read`; of those
    that are `known` (n,) the `printed` numbers say how the one becomes the other. `turned`: the printed grid has the
    rows as its columns, and is turned by a quarter to have them as its rows. As read where no turn of the grid fits."""
    columns, rows = target.columns, target.rows
    column, row = read % columns, read // columns
    there = np.column_stack([printed % rows, printed // rows] if turned else [printed % columns, printed // columns])
    if turned:
        there = np.column_stack([there[:, 1], rows - 1 - there[:, 0]])
    ways = [np.column_stack([c, r]) for c in (column, columns - 1 - column) for r in (row, rows - 1 - row)]
    if columns == rows:
        ways += [way[:, ::-1] for way in ways]
    fits = [int((way == there).all(axis=1)[known].sum()) for way in ways]
    best = int(np.argmax(fits))
    if 2 * fits[best] <= known.sum():
        return read
    return np.asarray(ways[best][:, 1] * columns + ways[best][:, 0])


def _inverted(image: np.ndarray, sheet: SensorSheet) -> tuple[np.ndarray, SensorSheet]:
    """The image with black and white exchanged, and the sheet of its noise."""
    other = InvertedSheet(*astuple(sheet))
    return other.largest_dn - image, other


def _as_read(name: str, target: TargetSpec, found: Corners) -> Observations:
    n = len(found.code)
    covariance = np.tile(READ_PX[target.kind] ** 2 * np.eye(2), (n, 1, 1))
    return Observations(
        stations=(name,),
        station=np.zeros(n, int),
        xy_px=found.xy_px.copy(),
        cov_px2=covariance,
        moments_px2=np.full((n, 2, 2), np.nan),
        code=np.maximum(found.code, 0),
        board=np.full(n, -1),
        point=found.point,
        chi2=np.full(n, np.nan),
        status=np.full(n, READ, dtype=object),
        centre_of_disc=found.disc,
    )


def _tags(image: np.ndarray, sheet: SensorSheet, name: str, target: TargetSpec, found: Corners) -> Observations:
    """Each tag is a board of its own, for nobody told their layout; pixels of the other tags are left alone."""
    names = _names(target)
    quads = found.xy_px.reshape(-1, CORNERS_A_TAG, 2)
    parts = [_as_read(name, target, found).take(np.zeros(0, int))]
    for k, number in enumerate(found.code[::CORNERS_A_TAG] if names else ()):
        pattern = BoardPattern("tags", 1, 1, 2 * TAG_MM, TAG_MM, names, int(number))
        order = found.point[CORNERS_A_TAG * k : CORNERS_A_TAG * (k + 1)]
        seen = Seen(pattern.points_mm[order], quads[k], np.delete(quads, k, axis=0))
        best: Observations | None = None
        for quiet in QUIET_CELLS:
            size = TAG_MM * (1 + 2 * quiet / (int(dictionary(names).markerSize) + 2))
            one = measure_corners(image, sheet, name, k, _board(pattern, np.full(2, size)), seen)
            if best is None or (one.status == MEASURED).sum() > (best.status == MEASURED).sum():
                best = one
            if (one.status == MEASURED).all():
                break
        if best is not None:
            parts.append(best)
    return Observations.beside(parts)


def _names(target: TargetSpec) -> str:
    """OpenCV's name of the tags' dictionary, empty where it has none."""
    tags = target.dictionary.removeprefix("tag")
    word = f"DICT_APRILTAG_{tags}" if target.kind == "apriltag" else target.dictionary
    return {name.upper(): name for name in dictionaries()}.get(word.upper(), "")


def _boards(target: TargetSpec, found: Corners) -> tuple[NominalBoard, ...]:
    """What stands for the photograph's board."""
    columns, rows = found.size or (target.columns, target.rows)
    if target.kind == "checkerboard":
        # OpenCV finds it whichever of its sides is called the columns.
        sizes = dict.fromkeys([(columns + 1, rows + 1), (rows + 1, columns + 1)])
        patterns = [BoardPattern("checkerboard", *size, target.square_mm) for size in sizes]
    elif target.kind == "squares":
        patterns = [BoardPattern("squares", *target.upright, target.square_mm, target.marker_mm)]
    elif target.kind == "charuco":
        sides = target.square_mm, target.marker_mm
        patterns = [BoardPattern("charuco", columns, rows, *sides, _names(target), legacy=found.legacy)]
    elif target.kind == "aprilgrid":
        patterns = [target.pattern(found.border)]
    elif target.kind == "tags":
        sides = target.square_mm, target.marker_mm
        patterns = [BoardPattern("tags", columns, rows, *sides, _names(target), target.first)]
    else:
        return ()
    # Beyond the outermost edges there is paper: of squares and tags half as much as between them.
    beyond = target.square_mm - target.marker_mm if target.kind in ("squares", "tags") else 0.0
    return tuple(_board(pattern, 2 * pattern.half_mm + beyond) for pattern in patterns)


def _board(pattern: BoardPattern, size_mm: np.ndarray) -> NominalBoard:
    n = len(pattern.points_mm)
    marks = Marks(pattern.points_mm, np.full(n, pattern.free_mm), np.zeros(n, int))
    return NominalBoard(pattern.kind, marks, 0.0, 0.0, pattern, (float(size_mm[0]), float(size_mm[1])))
