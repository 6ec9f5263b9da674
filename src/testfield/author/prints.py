"""What is printed on a board or a card, as a field sheet knows it: shapes in mm about the middle, x right, y up."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testfield.targets.board_pattern import Cells, Discs
from testfield.targets.code_table import CodeTable, words_of
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import RADII, USUAL, Marks, RingRadii

BORDER = 0.5
"""Of ground around a dot, in radii: less, and its edge is another's."""


@dataclass(frozen=True)
class Sector:
    """A part of a ring about `xy_mm` between two radii, counter-clockwise from one angle to the other."""

    xy_mm: tuple[float, float]
    inner_mm: float
    outer_mm: float
    first_rad: float
    last_rad: float


@dataclass(frozen=True)
class Print:
    """What is printed on an area of `size_mm` (2,), named after its board.

    `white_on_black`: marks are white and the area black, else the other way round; squares and tags (`cells`) are black
    on white. `marks` are its circles with their codes, whose rings have the shape `radii` and the words of `codes`;
    `board` is the sheet's; `cards` (k, 4) are the areas of several targets, each of which has its own.
    """

    name: str
    size_mm: np.ndarray
    white_on_black: bool
    marks: Marks
    board: NominalBoard | None = None
    cells: Cells | None = None
    radii: RingRadii = RADII[USUAL]
    cards: np.ndarray | None = None
    codes: CodeTable | None = None

    @cached_property
    def sectors(self) -> tuple[Sector, ...]:
        """The rings' bright parts, or the crowns of round tags in two halves each."""
        discs = self.board.pattern.discs if self.board is not None and self.board.pattern is not None else None
        return sectors_of(self.marks, self.radii, self.codes) if discs is None else crowns_of(discs)

    @property
    def areas_mm(self) -> np.ndarray:
        """(k, 4) left, bottom, right, top of what is cut out: the whole, or each of several cards."""
        return np.array([[*-self.size_mm / 2, *self.size_mm / 2]]) if self.cards is None else self.cards

    @property
    def reach_mm(self) -> np.ndarray:
        """(n,) how far from its centre a mark needs its ground: a code's quiet zone, and a border around a dot."""
        return reach_mm(self.marks, self.radii)

    @property
    def finest_mm(self) -> float:
        """The smallest thing that is printed: a dot, a ring's segment or its breadth, a cell."""
        found = [np.diff(self.cells.x_mm).min(), np.diff(self.cells.y_mm).min()] if self.cells else []
        found += [sector.outer_mm - sector.inner_mm for sector in self.sectors if self.cells]
        radius = self.marks.diameter_mm / 2
        if not self.cells and len(radius):
            found.append(2 * radius.min())
            ringed = radius[self.marks.code > 0]
            if len(ringed):
                segment = 2 * np.pi / self.marks.bits * self.radii.inner
                found.append(ringed.min() * min(segment, self.radii.outer - self.radii.inner))
        return float(min(found))


def prints_of(sheet: Field, sizes_mm: dict[str, tuple[float, float]]) -> list[Print]:
    """All boards of a field sheet; `sizes_mm` of those by name that are larger than what is printed on them."""
    return [print_of(board, sheet, sizes_mm.get(board.name)) for board in sheet.boards]


def print_of(board: NominalBoard, sheet: Field, size_mm: tuple[float, float] | None = None) -> Print:
    """What is printed on a board."""
    pattern, marks = board.pattern, board.marks
    bare = Marks(np.zeros((0, 2)), np.zeros(0), np.zeros(0, int), sheet.bits)
    if pattern is not None:
        size = np.array(board.size_mm or size_mm or 2 * pattern.half_mm + pattern.pitch_mm)
        if pattern.has_corners:
            return Print(board.name, size, False, bare, board, pattern.cells)
        return Print(board.name, size, sheet.white_on_black, marks, board)
    around = 2 * (np.abs(marks.xy_mm) + reach_mm(marks, sheet.radii)[:, None]).max(axis=0)
    size = around if size_mm is None else np.array(size_mm)
    return Print(board.name, size, sheet.white_on_black, marks, board, radii=sheet.radii, codes=sheet.codes)


def card_of(code: int, diameter_mm: float, sheet: Field) -> Print:
    """One coded target to be cut out: that of a scale bar, or a sticker."""
    marks = Marks(np.zeros((1, 2)), np.array([diameter_mm]), np.array([code]), sheet.bits)
    size = np.full(2, diameter_mm * sheet.radii.quiet)
    return Print(f"{code}", size, sheet.white_on_black, marks, radii=sheet.radii, codes=sheet.codes)


def reach_mm(marks: Marks, radii: RingRadii) -> np.ndarray:
    """(n,) how far from their centres marks need their ground."""
    return np.asarray(marks.diameter_mm / 2 * np.where(marks.code > 0, radii.quiet, 1 + BORDER))


def crowns_of(discs: Discs) -> tuple[Sector, ...]:
    """The rings of ink between discs of ink and those of paper that follow them, in two halves each."""
    found = []
    for k in np.flatnonzero(discs.sign > 0):
        x, y = discs.xy_mm[k].tolist()
        outer, inner = float(discs.radius_mm[k]), float(discs.radius_mm[k + 1])
        found += [Sector((x, y), inner, outer, first, first + np.pi) for first in (-np.pi, 0.0)]
    return tuple(found)


def sectors_of(marks: Marks, radii: RingRadii, codes: CodeTable | None = None) -> tuple[Sector, ...]:
    """The bright parts of all rings, neighbours in one piece. Segments follow each other clockwise from +x."""
    found = []
    step = 2 * np.pi / marks.bits
    for k in np.flatnonzero(marks.code > 0):
        word = int(words_of(marks.code[k : k + 1], marks.bits, codes)[0])
        bright = [bool(word >> (marks.bits - 1 - j) & 1) for j in range(marks.bits)]
        begins = [j for j in range(marks.bits) if bright[j] and not bright[j - 1]]
        radius = marks.diameter_mm[k] / 2
        x, y = marks.xy_mm[k].tolist()
        for j in begins:
            length = next(n for n in range(1, marks.bits + 1) if not bright[(j + n) % marks.bits])
            found.append(Sector((x, y), radius * radii.inner, radius * radii.outer, -(j + length) * step, -j * step))
    return tuple(found)
