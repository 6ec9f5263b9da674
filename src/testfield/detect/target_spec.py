"""What kind of targets a photograph shows, as a person writes it: `ring14`, `circles:10x8`, `charuco:7x5:...`."""

import re
from dataclasses import dataclass

from testfield.errors import TestfieldError
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.code_table import FEWEST_BITS, MOST_BITS
from testfield.targets.ring_code import BITS
from testfield.targets.rune_code import DOT, word_of_rune

KINDS = {
    "ring14": "ring codes of 14 bits and plain dots (also ring8, ring10, ring12, ring16, ring20)",
    "circles": "plain dots; circles:10x8 a symmetric grid of 10 columns and 8 rows",
    "acircles:4x11": "an asymmetric circle grid, by OpenCV",
    "hexcircles:14x24": "a hexagonal grid of circles: in a row, and rows; lengths in mm, as :12:10 from each to its "
    "neighbours, and diameter",
    "checkerboard:9x6": "inner corners of a checkerboard, by OpenCV; to measure with it, its squares in mm, as :25",
    "squares:8x8:22.6:12.7": "a grid of squares that do not touch: from square to square, and a square's side in mm",
    "charuco:7x5:DICT_4X4_50:30:22": "ChArUco: squares, dictionary, side of a square and of a marker in mm, by OpenCV",
    "aruco:DICT_4X4_50": "ArUco markers, by OpenCV; to measure with them, their side in mm, as :40",
    "aprilgrid:6x6:88:26.4": "Kalibr's AprilGrid: tags in x and y, side of a tag and of a corner square in mm",
    "runetag:1234:160": "a RUNE-Tag of 129 places: its number, and to measure with it the diameter of its outer circle",
    "runetag": "RUNE-Tags of 129 places, whichever they are; a mirrored image shows other ones",
    "cctag:3": "CCTags of 3 crowns, or of 4",
    "apriltag:36h11": "AprilTags, by pupil-apriltags where it is installed, else by OpenCV; their side in mm as :40",
    "tags:5x7:DICT_6X6_50:30:24": "a board of ArUco or AprilTags, row by row: columns, rows, dictionary, from tag to "
    "tag and a tag's side in mm; a last :10 where the first tag is not 0",
}
GRIDS = ("circles", "acircles", "hexcircles", "checkerboard")
DOTS = ("circles", "hexcircles", "runetag")
"""Boards that are numbered from the dots that were measured."""

APRIL_GRID_TAGS = "DICT_APRILTAG_36h11"


@dataclass(frozen=True)
class TargetSpec:
    """A kind of target: `kind` the first word; `bits` of a ring code; `columns` and `rows`, 0 where not said;
    `dictionary` of markers; `square_mm` from square, dot or tag to the next (of an asymmetric grid: half the distance
    within a row; of an AprilGrid: the square that stands between its tags), `marker_mm` a marker's side or a dot's
    diameter; `sized` whether `square_mm` was said, and `mark_sized` whether `marker_mm` was; `first` the number of a
    board's first tag; `crowns` of CCTags."""

    kind: str
    bits: int = 0
    columns: int = 0
    rows: int = 0
    dictionary: str = ""
    square_mm: float = 1.0
    marker_mm: float = 0.7
    sized: bool = False
    mark_sized: bool = False
    first: int = 0
    crowns: int = 0

    @property
    def is_board(self) -> bool:
        """Whether the kind says where every point of a board lies, so that it calibrates a camera."""
        return self.kind not in ("ring", "aruco", "apriltag") and self.columns > 0

    @property
    def unknown_rune(self) -> bool:
        """Whether RUNE-Tags are asked for without a number."""
        return self.kind == "runetag" and not self.columns

    @property
    def upright(self) -> tuple[int, int]:
        """Columns and rows of a grid that is numbered from what is seen: its columns run along the longer side."""
        return max(self.columns, self.rows), min(self.columns, self.rows)

    def pattern(self, border_cells: int = 2) -> BoardPattern:
        """The print of an AprilGrid, or a RUNE-Tag."""
        if self.kind == "runetag":
            return BoardPattern("runetag", 1, 1, self.square_mm, self.marker_mm, first_tag=self.first)
        pitch_mm = self.marker_mm + self.square_mm
        tags = self.dictionary, 0, False, border_cells
        return BoardPattern(self.kind, self.columns, self.rows, pitch_mm, self.marker_mm, *tags)


def parse_target(text: str, where: str = "--target") -> TargetSpec:
    """The kind a person names at a place. Raises `TestfieldError` that lists the kinds."""
    kind, *rest = text.strip().split(":")
    ring = re.fullmatch(r"ring(\d+)", kind)
    if ring and not rest:
        if not FEWEST_BITS <= int(ring[1]) <= MOST_BITS:
            raise _wrong(
                text,
                where,
                f"ring codes have {', '.join(map(str, BITS))} bits, with a table {FEWEST_BITS} to {MOST_BITS}",
            )
        return TargetSpec("ring", bits=int(ring[1]))
    try:
        if kind == "circles" and not rest:
            return TargetSpec("circles")
        if kind == "squares" and len(rest) == 3:
            return _grid(text, where, kind, rest)
        if kind in GRIDS and 1 <= len(rest) <= (2 if kind == "checkerboard" else 3):
            return _grid(text, where, kind, rest)
        if (kind == "charuco" and len(rest) == 4) or (kind == "tags" and len(rest) in (4, 5)):
            square, marker = float(rest[2]), float(rest[3])
            if not 0 < marker < square < float("inf"):
                raise _wrong(text, where, "a marker is smaller than its square, and both have a size")
            first = int(rest[4]) if len(rest) == 5 else 0
            if first < 0:
                raise _wrong(text, where, "tags are numbered from 0")
            return TargetSpec(kind, 0, *_size(rest[0]), rest[1], square, marker, True, True, first)
        if kind == "aprilgrid" and len(rest) == 3:
            marker, square = float(rest[1]), float(rest[2])
            if not 0 < square < marker < float("inf"):
                raise _wrong(text, where, "a corner square is smaller than its tag, and both have a size")
            return TargetSpec(kind, 0, *_size(rest[0]), APRIL_GRID_TAGS, square, marker, True, True)
        if kind == "runetag" and not rest:
            return TargetSpec("runetag")
        if kind == "runetag" and len(rest) in (1, 2):
            return _rune(text, where, int(rest[0]), float(rest[1]) if len(rest) == 2 else None)
        if kind == "cctag" and len(rest) == 1:
            if rest[0] not in ("3", "4"):
                raise _wrong(text, where, "CCTags have 3 or 4 crowns")
            return TargetSpec(kind, crowns=int(rest[0]))
        if kind in ("aruco", "apriltag") and len(rest) in (1, 2) and rest[0]:
            side = float(rest[1]) if len(rest) == 2 else 1.0
            if not 0 < side < float("inf"):
                raise _wrong(text, where, "a tag's side is in mm, above 0")
            # A scene names the family as OpenCV does, others as its makers do: both are understood.
            family = re.sub(r"(?i)^(dict_april)?tag_?", "", rest[0]) if kind == "apriltag" else rest[0]
            return TargetSpec(kind, 0, 0, 0, family, side, side, len(rest) == 2, len(rest) == 2)
    except ValueError as error:
        raise _wrong(text, where, str(error)) from error
    like = [name for name in KINDS if name.split(":")[0] == kind]
    if like:
        raise TestfieldError(f"'{text}' does not say all that is needed", where, f"give it like {like[0]}")
    raise _wrong(text, where, "no such kind of target")


def _grid(text: str, where: str, kind: str, rest: list[str]) -> TargetSpec:
    """A grid, its spacing and its dots' diameter where they are said."""
    lengths = [float(word) for word in rest[1:]]
    if not all(0 < length < float("inf") for length in lengths):
        raise _wrong(text, where, "its lengths are in mm, above 0")
    spacing = lengths[0] if lengths else 1.0
    # Dots of the next row of an asymmetric grid are as far as sqrt(2) spacings away.
    nearest = spacing * (2**0.5 if kind == "acircles" else 1.0)
    if len(lengths) == 2 and not lengths[1] < nearest:
        marks, width = ("squares", "side") if kind == "squares" else ("dots", "diameter")
        raise _wrong(text, where, f"its {marks} overlap: spacing and {width} in mm, in this order")
    mark = lengths[1] if len(lengths) == 2 else 0.5 * nearest
    return TargetSpec(kind, 0, *_size(rest[0]), "", spacing, mark, bool(lengths), len(lengths) == 2)


def _rune(text: str, where: str, number: int, diameter_mm: float | None) -> TargetSpec:
    word_of_rune(number)
    size = 1.0 if diameter_mm is None else diameter_mm
    if not 0 < size < float("inf"):
        raise _wrong(text, where, "a tag's diameter is in mm, above 0")
    told = diameter_mm is not None
    return TargetSpec("runetag", 0, 1, 1, "", size, DOT * size, told, told, number)


def _size(text: str) -> tuple[int, int]:
    size = re.fullmatch(r"(\d{1,3})x(\d{1,3})", text)
    if not size or min(int(size[1]), int(size[2])) < 2:
        raise ValueError(f"'{text}' is no size such as 10x8")
    return int(size[1]), int(size[2])


def _wrong(text: str, where: str, why: str) -> TestfieldError:
    return TestfieldError(f"'{text}': {why}", where, f"give one like {', '.join(KINDS)}")
