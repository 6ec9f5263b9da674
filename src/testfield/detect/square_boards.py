"""Boards of squares and tags in one image: OpenCV reads the tags or the checkerboard, the corner model measures.

What OpenCV reads says where every corner is to a pixel or so, from the corners it knows nearest to it; there the model
(`corner_model.py`) is fitted to those pixels that see nothing but the corner's own two edges.
"""

from dataclasses import dataclass, field
from functools import cached_property

import cv2
import numpy as np

from testfield.camera.images import Frame, SensorSheet
from testfield.camera.plane_image import as_others_say
from testfield.detect.bright import bright_marks
from testfield.detect.clear_pixels import CLEAR_OF_BLUR, CLEAR_PX, NEAREST, clear_pixels, covered
from testfield.detect.corner_model import FittedCorners, fit_corners
from testfield.detect.crown_boards import CrownReader
from testfield.detect.eight_bits import pictures
from testfield.detect.lone_squares import read_lone_squares
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.opencv_boards import checkerboards
from testfield.detect.small_tags import read_tags
from testfield.detect.touching_tags import read_touching_tags
from testfield.registry import known_of
from testfield.targets.board_pattern import CORNERS_A_TAG, SIDES, BoardPattern
from testfield.targets.field import Field, NominalBoard

READ_WITHIN_PX = 0.8
"""How well it is known where neighbouring tags are, which are only read."""
WORST_MISFIT, WORST_OF_USUAL, MOST_USUAL = 0.05, 2.0, 0.08
"""What is a corner leaves no larger residual beyond noise than the first, as a fraction of the contrast; where cameras
sharpen, all corners of an image leave alike, and the second times what is usual there counts, of the third at most."""
DISTURBED, DISTURBED_CHI2, UNUSUAL = 0.006, 2.0, 3.0
"""A corner is partly hidden or touched by something where its residual beyond noise exceeds the first, as a fraction of
the contrast, and the third times what is usual in the image, and its chi-squared exceeds the second times what is usual
(at least times one)."""
NEARLY_FULL = 0.98


@dataclass(frozen=True)
class Seen:
    """What was read of one board: corners (k, 2) in mm on the board and in px; `others_px` (m, 4, 2) corners of what
    else is printed nearby, in which no pixel is looked at."""

    board_mm: np.ndarray
    image_px: np.ndarray
    others_px: np.ndarray = field(default_factory=lambda: np.zeros((0, CORNERS_A_TAG, 2)))


def detect_squares(frame: Frame, sheets: Field) -> tuple[Observations, list[np.ndarray]]:
    """All corners of all boards of squares and tags in one frame, and the outlines (m, 2) px of what is printed."""
    image, sheet = bright_marks(frame, True)
    read = _Reader(image)
    crowns = CrownReader(image, read.pictures, sheet)
    parts, outlines = [_observations(frame.station)], []
    for b, board in enumerate(sheets.boards):
        if board.pattern is not None and board.pattern.crowns:
            observations, around = crowns.board(frame.station, b, board.pattern)
            parts.append(observations)
            outlines += around
            continue
        seen = read.board(board.pattern) if board.pattern is not None and board.has_corners else None
        if seen is None or board.pattern is None:
            continue
        parts.append(measure_corners(image, sheet, frame.station, b, board, seen))
        outlines.append(_outline(board.pattern, seen))
    return Observations.beside(parts), outlines


class _Reader:
    """OpenCV's detectors on one image; tags of one dictionary are looked for once."""

    def __init__(self, image: np.ndarray):
        self.image = image
        self.tags: dict[tuple[str, int, bool], tuple[np.ndarray, np.ndarray]] = {}

    @cached_property
    def pictures(self) -> list[np.ndarray]:
        """The image in bytes, in those ways that are worth a look."""
        return list(pictures(self.image))

    def board(self, pattern: BoardPattern) -> Seen | None:
        try:
            read = known_of("boards", pattern.kind, "read")
            if read is not None:
                return read(self.image, pattern)  # type: ignore[no-any-return]
            if len(pattern.tags):
                return self._tags(pattern)
            return self._checkerboard(pattern) if pattern.of_kind.crossing else self._lone_squares(pattern)
        except cv2.error:  # of points on one line, for example
            return None

    def _tags(self, pattern: BoardPattern) -> Seen | None:
        printed = pattern.names, pattern.border_cells, pattern.of_kind.corner_squares
        if printed not in self.tags:
            numbers, corners = np.zeros(0, int), np.zeros((0, CORNERS_A_TAG, 2))
            for picture in self.pictures:
                found, quads = (
                    read_touching_tags(picture, *printed[:2]) if printed[2] else read_tags(picture, printed[0])
                )
                new = ~np.isin(found, numbers)
                numbers = np.concatenate([numbers, found[new]])
                corners = np.concatenate([corners, quads[new]])
            self.tags[printed] = numbers, corners
        numbers, corners = self.tags[printed]
        once = np.isin(numbers, [k for k in np.unique(numbers) if (numbers == k).sum() == 1])
        mine = np.flatnonzero(once & np.isin(numbers, pattern.tags))
        if len(mine) == 0:
            return None
        board = pattern.tag_corners_mm[numbers[mine] - pattern.first_tag].reshape(-1, 2)
        image = corners[mine].reshape(-1, 2)
        whole = self._agree(board, image).reshape(-1, CORNERS_A_TAG).all(axis=1)
        keep = np.repeat(whole, CORNERS_A_TAG)
        return Seen(board[keep], image[keep]) if whole.any() else None

    def _agree(self, board_mm: np.ndarray, image_px: np.ndarray) -> np.ndarray:
        """(n,) which points (n, 2) of a board were read where the others say, whatever the lens."""
        if len(board_mm) == CORNERS_A_TAG:  # one tag alone contradicts nobody
            return np.ones(CORNERS_A_TAG, bool)
        height, width = self.image.shape
        return as_others_say((board_mm, image_px), (width, height))

    def _checkerboard(self, pattern: BoardPattern) -> Seen | None:
        for picture in self.pictures:
            for corners in checkerboards(picture, pattern.columns - 1, pattern.rows - 1):
                seen = self._turned(pattern, corners)
                if seen is not None:
                    return seen
        return None

    def _lone_squares(self, pattern: BoardPattern) -> Seen | None:
        for picture in self.pictures:
            place, corners = read_lone_squares(
                picture, pattern.columns, pattern.rows, pattern.pitch_mm / pattern.mark_mm
            )
            if len(place):
                board = pattern.points_mm.reshape(-1, CORNERS_A_TAG, 2)[place[:, 1] * pattern.columns + place[:, 0]]
                return Seen(board.reshape(-1, 2), corners.reshape(-1, 2))
        return None

    def _turned(self, pattern: BoardPattern, image: np.ndarray) -> Seen | None:
        """Corners (n, 2) px in OpenCV's order with their places on the board; None where they are no such board."""
        board = pattern.points_mm
        if not self._agree(board, image).all() or len(np.unique(image, axis=0)) < len(image):
            return None
        # Any of the four corners may come first; a board seen from its front is not mirrored, and its squares show
        # which way up it is.
        for x, y in ((1, 1), (-1, -1), (-1, 1), (1, -1)):
            seen = Seen(board * [x, y], image)
            maps = _local_maps(seen, board[:1])
            if maps is not None and np.linalg.det(maps[1][0]) < 0 and self._as_printed(pattern, seen):
                return seen
        return None

    def _as_printed(self, pattern: BoardPattern, seen: Seen) -> bool:
        """Whether black squares are darker than white ones."""
        x, y = (np.arange(1, n - 1) - (n - 1) / 2 for n in (pattern.columns, pattern.rows))
        middle = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) * pattern.pitch_mm
        maps = _local_maps(seen, middle)
        if maps is None:
            return False
        at = np.rint(maps[0]).astype(int).clip(0, np.array(self.image.shape[::-1]) - 1)
        level, black = self.image[at[:, 1], at[:, 0]].astype(float), pattern.cells.at(middle)
        return bool(level[black].mean() < level[~black].mean())


def measure_corners(
    image: np.ndarray, sheet: SensorSheet, station: str, b: int, board: NominalBoard, seen: Seen
) -> Observations:
    """The corners of board number `b` in an image (h, w) of `sheet`, measured by the model from where they were seen;
    what cannot be measured has a status that says why."""
    pattern = board.pattern
    assert pattern is not None
    points = pattern.points_mm
    # A corner is looked for where what is known lies next to it.
    gap = np.linalg.norm(points[:, None] - seen.board_mm[None], axis=2).min(axis=1)
    point = np.flatnonzero(gap <= pattern.of_kind.known_within_mm(pattern) + 1e-6 * pattern.pitch_mm)
    maps = _local_maps(seen, points[point])
    if maps is None or len(point) == 0:
        return _observations(station)
    xy, axes = maps
    height, width = image.shape
    inside = ((xy > 1) & (xy < [width - 2, height - 2])).all(axis=1) & (np.abs(np.linalg.det(axes)) > 1e-12)
    point, xy, axes = point[inside], xy[inside], axes[inside]
    if len(point) == 0:
        return _observations(station)
    # The quadrant between u and v: of crossing edges a white one, of a tag its own black one.
    if not pattern.of_kind.crossing:
        signs = -SIDES[point % CORNERS_A_TAG]
    else:
        up_right = pattern.cells.at(points[point] + 0.01 * pattern.free_mm)
        signs = np.column_stack([np.where(up_right, -1, 1), np.ones(len(point))])
    edges = axes * signs[:, None, :]
    crossing = np.full(len(point), pattern.of_kind.crossing)
    clear = CLEAR_PX
    for _ in range(2):
        use = clear_pixels(board, points[point], xy, axes, clear) & ~covered(seen.others_px, xy, clear + READ_WITHIN_PX)
        fitted = fit_corners(image, sheet, xy, edges, crossing, use)
        if not fitted.ok.any():
            break
        clear = CLEAR_OF_BLUR * float(np.median(fitted.blur_px[fitted.ok]))
        if clear <= CLEAR_PX:
            break
    spread = (board.marks.diameter_mm[point] / 4) ** 2
    moments = spread[:, None, None] * axes @ np.swapaxes(axes, 1, 2)
    return _observations(station, b, point, fitted, xy, moments, _status(fitted, sheet))


def _status(fitted: FittedCorners, sheet: SensorSheet) -> np.ndarray:
    """(n,) `measured` or why not."""
    status = np.full(len(fitted.ok), MEASURED, dtype=object)
    with np.errstate(invalid="ignore"):
        usual = [float(np.median(v[fitted.ok])) if fitted.ok.any() else 0.0 for v in (fitted.misfit, fitted.chi2)]
        worst = max(WORST_MISFIT, WORST_OF_USUAL * min(usual[0], MOST_USUAL))
        disturbed = (fitted.misfit > max(DISTURBED, UNUSUAL * usual[0])) & (
            fitted.chi2 > DISTURBED_CHI2 * max(usual[1], 1.0)
        )
        for bad, why in (
            (~fitted.ok | (fitted.contrast_dn < 0) | (fitted.misfit > worst), "not a corner"),
            (fitted.white_dn >= NEARLY_FULL * sheet.saturation_dn, "saturated"),
            (disturbed, "partly hidden or disturbed"),
        ):
            status[(status == MEASURED) & bad] = why
    return status


def _local_maps(seen: Seen, at_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Places (n, 2) px of points (n, 2) of the board and their derivatives (n, 2, 2) px/mm, from the corners nearest to
    each: a homography of the neighbourhood follows the lens. None where nothing is determined."""
    places, slopes = np.zeros((len(at_mm), 2)), np.zeros((len(at_mm), 2, 2))
    whole, _ = cv2.findHomography(seen.board_mm, seen.image_px)
    if whole is None:
        return None
    for k, at in enumerate(at_mm):
        near = np.argsort(np.linalg.norm(seen.board_mm - at, axis=1), kind="stable")[:NEAREST]
        centred = seen.board_mm[near] - seen.board_mm[near].mean(axis=0)
        straight = np.linalg.svd(centred, compute_uv=False)[-1] < 0.2 * np.linalg.norm(centred) / np.sqrt(2)
        H = None if straight or len(near) < 6 else cv2.findHomography(seen.board_mm[near], seen.image_px[near])[0]
        H = whole if H is None else H
        p = H @ [*at, 1.0]
        places[k] = p[:2] / p[2]
        slopes[k] = (H[:2, :2] - np.outer(places[k], H[2, :2])) / p[2]
    return places, slopes


def _outline(pattern: BoardPattern, seen: Seen) -> np.ndarray:
    """(4, 2) px of the corners of all that is printed."""
    H, _ = cv2.findHomography(seen.board_mm, seen.image_px)
    return np.zeros((4, 2)) if H is None else cv2.perspectiveTransform((SIDES * pattern.half_mm)[None], H)[0]


def _observations(
    station: str,
    board: int = -1,
    point: np.ndarray | None = None,
    fitted: FittedCorners | None = None,
    xy_px: np.ndarray | None = None,
    moments_px2: np.ndarray | None = None,
    status: np.ndarray | None = None,
) -> Observations:
    """Observations of one board's corners; none where only the station is given."""
    if point is None or fitted is None or xy_px is None or moments_px2 is None or status is None:
        none, nothing = np.zeros(0, int), np.zeros((0, 2, 2))
        return Observations(
            stations=(station,),
            station=none,
            xy_px=np.zeros((0, 2)),
            cov_px2=nothing,
            moments_px2=nothing,
            code=none,
            board=none,
            point=none,
            chi2=np.zeros(0),
            status=np.zeros(0, object),
        )
    n = len(point)
    return Observations(
        stations=(station,),
        station=np.zeros(n, int),
        xy_px=np.where(fitted.ok[:, None], fitted.xy_px, xy_px),
        cov_px2=fitted.cov_px2,
        moments_px2=moments_px2,
        code=np.zeros(n, int),
        board=np.full(n, board),
        point=point,
        chi2=fitted.chi2,
        status=status,
    )
