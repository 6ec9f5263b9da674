"""Boards that people own, by kind (`targets/kinds`): what is printed on them, and where.

Everything is in the board's frame (x right, y up from its middle). Squares and tags are cells between straight lines;
a corner is where two edges cross (checkerboard, ChArUco) or meet (outer corners of tags).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import cv2
import numpy as np

from testfield.registry import find

CORNERS_A_TAG = 4
SIDES = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
"""A tag's outer corners from its middle, in OpenCV's order: clockwise from the top left, seen from the front."""


def dictionaries() -> list[str]:
    """Names of OpenCV's dictionaries of tags."""
    return sorted(word for word in dir(cv2.aruco) if word.startswith("DICT_"))


def dictionary(name: str) -> cv2.aruco.Dictionary:
    """One of OpenCV's dictionaries. Raises `ValueError` where there is none of that name."""
    if name not in dictionaries():
        raise ValueError(f"no dictionary is called '{name}'; known are {', '.join(dictionaries())}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


@dataclass(frozen=True)
class Cells:
    """A print of rectangular cells: `x_mm` (c + 1,), `y_mm` (r + 1,) ascending lines, `black` (r, c) bool."""

    x_mm: np.ndarray
    y_mm: np.ndarray
    black: np.ndarray

    def at(self, xy_mm: np.ndarray) -> np.ndarray:
        """(...) whether points (..., 2) lie on black; beside the cells is white."""
        column = np.searchsorted(self.x_mm, xy_mm[..., 0], side="right") - 1
        row = np.searchsorted(self.y_mm, xy_mm[..., 1], side="right") - 1
        rows, columns = self.black.shape
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        return inside & self.black[row.clip(0, rows - 1), column.clip(0, columns - 1)]

    def scaled(self, factor: float) -> "Cells":
        """The same print, larger."""
        return Cells(self.x_mm * factor, self.y_mm * factor, self.black)


@dataclass(frozen=True)
class Discs:
    """A print of discs one within the other: `xy_mm` (n, 2), `radius_mm` (n,), `sign` (n,) 1 for ink, -1 for paper."""

    xy_mm: np.ndarray
    radius_mm: np.ndarray
    sign: np.ndarray

    def scaled(self, factor: float) -> "Discs":
        """The same print, larger."""
        return Discs(self.xy_mm * factor, self.radius_mm * factor, self.sign)


@dataclass(frozen=True)
class BoardKind:
    """What a kind of boards is: functions of a pattern, and how it is looked for.

    `points_mm` gives (n, 2) corners or centres of circles, row by row from the top left; `half_mm` (2,) half the width
    and height of all that is printed; `free_mm` the diameter around a point in which nothing else is printed (of a
    circle, its own); `cells` the print of squares and tags, None for circles; `tag_middles_mm` (n, 2) the middles of
    its tags, None for boards without.

    Corners are `crossing` where two edges cross, else they are a tag's own; they are looked for within
    `known_within_mm` of one that was read. Circles are `staggered` in an asymmetric grid, and in a `hexagonal` one.
    `shows_front` tells whether an image of the board tells it from its mirror image. `turned_tags` are printed turned
    by half against OpenCV's print, and `corner_squares` touch the corners of all tags. Circles whose `diameters_mm`
    (n,) differ tell them; those `on_circles` about the middle are told by where they stand on them. `discs` gives the
    print of round tags, whose centres are their points; `cells` is then the paper that holds them.

    A kind that OpenCV's finders of tags, checkerboards and grids of circles do not find gives a finder of its own when
    it is registered: `read` (image (h, w), pattern) to a `detect.square_boards.Seen` or None, or `name` (centres
    (n, 2) px, diameters (n,) px, pattern) to (n,) numbers of points, -1 for none.
    """

    points_mm: Callable[["BoardPattern"], np.ndarray]
    half_mm: Callable[["BoardPattern"], np.ndarray]
    free_mm: Callable[["BoardPattern"], float]
    cells: Callable[["BoardPattern"], Cells] | None = None
    tag_middles_mm: Callable[["BoardPattern"], np.ndarray] | None = None
    known_within_mm: Callable[["BoardPattern"], float] = lambda pattern: 0.0
    crossing: bool = True
    staggered: bool = False
    hexagonal: bool = False
    shows_front: bool = True
    turned_tags: bool = False
    corner_squares: bool = False
    discs: Callable[["BoardPattern"], Discs] | None = None
    diameters_mm: Callable[["BoardPattern"], np.ndarray] | None = None
    on_circles: bool = False


@dataclass(frozen=True)
class BoardPattern:
    """What a board shows.

    `kind` a name of a `BoardKind`; `columns`, `rows` of squares, tags or circles; `pitch_mm` from one to the next (of
    an asymmetric grid: half the distance within a row, and from row to row); `mark_mm` a tag's side or a circle's
    diameter, 0 on a checkerboard; `names` the OpenCV dictionary of the tags; `first_tag` the number of the first;
    `legacy`: a ChArUco board as OpenCV printed it before 4.6, black at the bottom left instead of the top left;
    `border_cells` how many cells wide the black border of a tag is; `crowns` of a CCTag.
    """

    kind: str
    columns: int
    rows: int
    pitch_mm: float
    mark_mm: float = 0.0
    names: str = ""
    first_tag: int = 0
    legacy: bool = False
    border_cells: int = 1
    crowns: int = 0

    @property
    def of_kind(self) -> BoardKind:
        """What its kind is. Raises `TestfieldError` where there is none of that name."""
        return _made(find("boards", self.kind))

    @property
    def has_corners(self) -> bool:
        """Whether its points are corners; of the others they are centres of circles."""
        return self.of_kind.cells is not None

    @property
    def tags(self) -> np.ndarray:
        """(n,) numbers of its tags, in the order of `tag_middles_mm`: row by row, mostly from the top left."""
        return self.first_tag + np.arange(len(self.tag_middles_mm))

    @cached_property
    def points_mm(self) -> np.ndarray:
        """(n, 2) corners or centres of circles, row by row from the top left; of tags, four corners each."""
        return self.of_kind.points_mm(self)

    @property
    def free_mm(self) -> float:
        """Diameter of the circle around a corner in which nothing else is printed; of a circle, its own."""
        return float(self.of_kind.free_mm(self))

    @property
    def diameters_mm(self) -> np.ndarray:
        """(n,) diameters of its circles, or around its corners as `free_mm`."""
        make = self.of_kind.diameters_mm
        return np.full(len(self.points_mm), self.free_mm) if make is None else make(self)

    @property
    def half_mm(self) -> np.ndarray:
        """(2,) half the width and height of all that is printed."""
        return self.of_kind.half_mm(self)

    @cached_property
    def cells(self) -> Cells:
        """The print of squares and tags."""
        if self.of_kind.cells is None:
            raise ValueError(f"a board of {self.kind} has no cells")
        return self.of_kind.cells(self)

    @cached_property
    def discs(self) -> Discs | None:
        """The print of round tags, None for boards without."""
        make = self.of_kind.discs
        return None if make is None else make(self)

    @property
    def tag_middles_mm(self) -> np.ndarray:
        """(n, 2) middles of its tags, in the order of `tags`."""
        middles = self.of_kind.tag_middles_mm
        return np.zeros((0, 2)) if middles is None else middles(self)

    @property
    def cells_a_tag(self) -> int:
        """Cells along a tag's side, its border included."""
        return int(dictionary(self.names).markerSize) + 2 * self.border_cells

    @property
    def tag_corners_mm(self) -> np.ndarray:
        """(n, 4, 2) outer corners of its tags, those of a tag in the order in which OpenCV reads them."""
        sides = -SIDES if self.of_kind.turned_tags else SIDES
        return self.tag_middles_mm[:, None] + sides * self.mark_mm / 2


@cache
def _made(make: Callable[[], BoardKind]) -> BoardKind:
    return make()


def grid(columns: int, rows: int, pitch_mm: float) -> np.ndarray:
    """(n, 2) points of a regular grid about the middle, row by row from the top left."""
    x = (np.arange(columns) - (columns - 1) / 2) * pitch_mm
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch_mm
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def corners_of_tags(pattern: BoardPattern) -> np.ndarray:
    """(4n, 2) outer corners of all tags, those of a tag in OpenCV's order."""
    return (pattern.tag_middles_mm[:, None] + SIDES * pattern.mark_mm / 2).reshape(-1, 2)


def free_around_tags_mm(pattern: BoardPattern) -> float:
    """What is free around the corners of tags side by side, whose borders are one cell wide."""
    gap = pattern.pitch_mm - pattern.mark_mm
    return float(2 * min(np.sqrt(2) * pattern.mark_mm / pattern.cells_a_tag, gap))


def half_of_marks_mm(pattern: BoardPattern, middles: np.ndarray) -> np.ndarray:
    """(2,) half the width and height of marks about their middles (n, 2)."""
    return np.asarray(np.abs(middles).max(axis=0) + pattern.mark_mm / 2)


def lines_of_tags(pattern: BoardPattern, first_mm: np.ndarray) -> np.ndarray:
    """All lines of one direction between the cells of tags that begin at places (n,)."""
    return (first_mm[:, None] + np.linspace(0, pattern.mark_mm, pattern.cells_a_tag + 1)).ravel()


def middles_of_cells(x_mm: np.ndarray, y_mm: np.ndarray) -> np.ndarray:
    """(r, c, 2) middles of the cells between ascending lines."""
    return np.stack(np.meshgrid((x_mm[1:] + x_mm[:-1]) / 2, (y_mm[1:] + y_mm[:-1]) / 2), axis=-1)


def with_tags(pattern: BoardPattern, middle: np.ndarray, black: np.ndarray) -> np.ndarray:
    """(r, c) which cells are black, of cells with these middles (r, c, 2), when the tags are printed over `black`."""
    black = black.copy()
    n = pattern.cells_a_tag if len(pattern.tags) else 0
    for number, at in zip(pattern.tags, pattern.tag_middles_mm, strict=True):
        u, v = np.moveaxis((middle - at) / pattern.mark_mm + 0.5, -1, 0)
        inside = (u > 0) & (u < 1) & (v > 0) & (v < 1)
        word = dictionary(pattern.names).generateImageMarker(int(number), n, borderBits=pattern.border_cells) == 0
        word = word[::-1, ::-1] if pattern.of_kind.turned_tags else word
        black[inside] = word[n - 1 - (v[inside] * n).astype(int), (u[inside] * n).astype(int)]
    return black


def cells_of_tags(pattern: BoardPattern) -> Cells:
    """The print of a board that has tags alone, wherever they are."""
    low = pattern.tag_middles_mm - pattern.mark_mm / 2
    x, y = (np.sort(lines_of_tags(pattern, np.unique(low[:, axis]))) for axis in (0, 1))
    middle = middles_of_cells(x, y)
    return Cells(x, y, with_tags(pattern, middle, np.zeros(middle.shape[:2], bool)))


def squares_black(pattern: BoardPattern, middle: np.ndarray, first_white: int) -> np.ndarray:
    """(r, c) which cells with these middles lie in a black square; `first_white` 1 where the top left one is white."""
    half = np.array([pattern.columns, pattern.rows]) * pattern.pitch_mm / 2
    column, row = np.moveaxis(np.floor((middle + half) / pattern.pitch_mm).astype(int), -1, 0)
    return np.asarray((column + pattern.rows - 1 - row) % 2 == first_white)
