"""Boards that people own: ChArUco, checkerboards, grids of tags, grids of circles. What is printed on them, and where.

Everything is in the board's frame (x right, y up from its middle). Squares and tags are cells between straight lines;
a corner is where two edges cross (checkerboard, ChArUco) or meet (outer corners of tags).
"""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

SQUARES = ("charuco", "checkerboard", "tags")
CIRCLES = ("circles", "acircles")
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
class BoardPattern:
    """What a board shows.

    `kind` of `SQUARES` or `CIRCLES`; `columns`, `rows` of squares, tags or circles; `pitch_mm` from one to the next (of
    an asymmetric grid: half the distance within a row, and from row to row); `mark_mm` a tag's side or a circle's
    diameter, 0 on a checkerboard; `names` the OpenCV dictionary of the tags; `first_tag` the number of the first;
    `legacy`: a ChArUco board as OpenCV printed it before 4.6, black at the bottom left instead of the top left.
    """

    kind: str
    columns: int
    rows: int
    pitch_mm: float
    mark_mm: float = 0.0
    names: str = ""
    first_tag: int = 0
    legacy: bool = False

    @property
    def has_corners(self) -> bool:
        """Whether its points are corners; of the others they are centres of circles."""
        return self.kind in SQUARES

    @property
    def tags(self) -> np.ndarray:
        """(n,) numbers of its tags, row by row from the top left."""
        if self.kind == "charuco":
            return self.first_tag + np.arange(self.columns * self.rows // 2)
        return self.first_tag + np.arange(self.columns * self.rows if self.kind == "tags" else 0)

    @cached_property
    def points_mm(self) -> np.ndarray:
        """(n, 2) corners or centres of circles, row by row from the top left; of tags, four corners each."""
        if self.kind == "acircles":
            row, k = np.divmod(np.arange(self.columns * self.rows), self.columns)
            xy = np.column_stack([2 * k + row % 2, -row]) * self.pitch_mm
            return xy - (xy.max(axis=0) + xy.min(axis=0)) / 2
        if self.kind == "tags":
            return (self.tag_middles_mm[:, None] + SIDES * self.mark_mm / 2).reshape(-1, 2)
        less = 1 if self.has_corners else 0
        return _grid(self.columns - less, self.rows - less, self.pitch_mm)

    @property
    def free_mm(self) -> float:
        """Diameter of the circle around a corner in which nothing else is printed; of a circle, its own."""
        if self.kind == "charuco":  # a tag's corner is next, along the diagonal of its square
            return float(np.sqrt(2) * (self.pitch_mm - self.mark_mm))
        if self.kind == "tags":  # a tag's border is one cell wide
            gap = self.pitch_mm - self.mark_mm
            return float(2 * min(np.sqrt(2) * self.mark_mm / self._cells_a_tag, gap))
        return 2 * self.pitch_mm if self.kind == "checkerboard" else self.mark_mm

    @property
    def half_mm(self) -> np.ndarray:
        """(2,) half the width and height of all that is printed."""
        if self.kind in ("charuco", "checkerboard"):
            return np.array([self.columns, self.rows]) * self.pitch_mm / 2
        middles = self.tag_middles_mm if self.kind == "tags" else self.points_mm
        return np.asarray(np.abs(middles).max(axis=0) + self.mark_mm / 2)

    @cached_property
    def cells(self) -> Cells:
        """The print of squares and tags."""
        if not self.has_corners:
            raise ValueError(f"a board of {self.kind} has no cells")
        half = self.half_mm
        x, y = (self._lines(n, h) for n, h in zip((self.columns, self.rows), half, strict=True))
        middle = np.stack(np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2), axis=-1)
        if self.kind == "tags":
            black = np.zeros(middle.shape[:2], bool)
        else:
            column, row = np.moveaxis(np.floor((middle + half) / self.pitch_mm).astype(int), -1, 0)
            black = (column + self.rows - 1 - row) % 2 == self._first_white
        for number, at in zip(self.tags, self.tag_middles_mm, strict=True):
            u, v = np.moveaxis((middle - at) / self.mark_mm + 0.5, -1, 0)
            inside = (u > 0) & (u < 1) & (v > 0) & (v < 1)
            n = self._cells_a_tag
            word = dictionary(self.names).generateImageMarker(int(number), n) == 0
            black[inside] = word[n - 1 - (v[inside] * n).astype(int), (u[inside] * n).astype(int)]
        return Cells(x, y, black)

    @property
    def _first_white(self) -> int:
        """1 where the square at the top left is white, which holds a tag."""
        return int(self.legacy and self.rows % 2 == 0)

    @property
    def _cells_a_tag(self) -> int:
        return int(dictionary(self.names).markerSize) + 2

    @property
    def tag_middles_mm(self) -> np.ndarray:
        """(n, 2) middles of its tags, in the order of `tags`."""
        if self.kind == "tags":
            return _grid(self.columns, self.rows, self.pitch_mm)
        if self.kind != "charuco":
            return np.zeros((0, 2))
        row, column = np.divmod(np.arange(self.columns * self.rows), self.columns)
        return _grid(self.columns, self.rows, self.pitch_mm)[(row + column) % 2 != self._first_white]

    def _lines(self, count: int, half_mm: float) -> np.ndarray:
        """All lines of one direction: those of squares, and those of the cells of the tags in them."""
        lines = np.arange(count + 1) * self.pitch_mm - half_mm if self.kind != "tags" else np.zeros(0)
        if self.mark_mm:
            inset = (self.pitch_mm - self.mark_mm) / 2 if self.kind == "charuco" else 0.0
            first = np.arange(count)[:, None] * self.pitch_mm - half_mm + inset
            cells = first + np.linspace(0, self.mark_mm, self._cells_a_tag + 1)
            lines = np.concatenate([lines, cells.ravel()])
        return np.sort(lines)


def _grid(columns: int, rows: int, pitch_mm: float) -> np.ndarray:
    """(n, 2) points of a regular grid about the middle, row by row from the top left."""
    x = (np.arange(columns) - (columns - 1) / 2) * pitch_mm
    y = ((rows - 1) / 2 - np.arange(rows)) * pitch_mm
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
