"""What kind of targets a photograph shows, as a person writes it: `ring14`, `circles:10x8`, `charuco:7x5:...`."""

import re
from dataclasses import dataclass

from testfield.errors import TestfieldError
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.code_table import FEWEST_BITS, MOST_BITS
from testfield.targets.ring_code import BITS

KINDS = {
    "ring14": "ring codes of 14 bits and plain dots (also ring8, ring10, ring12, ring16, ring20)",
    "circles": "plain dots; circles:10x8 a symmetric grid of 10 columns and 8 rows",
    "acircles:4x11": "an asymmetric circle grid, by OpenCV",
    "checkerboard:9x6": "inner corners of a checkerboard, by OpenCV",
    "charuco:7x5:DICT_4X4_50:30:22": "ChArUco: squares, dictionary, side of a square and of a marker in mm, by OpenCV",
    "aruco:DICT_4X4_50": "ArUco markers, by OpenCV",
    "aprilgrid:6x6:88:26.4": "Kalibr's AprilGrid: tags in x and y, side of a tag and of a corner square in mm",
    "apriltag:36h11": "AprilTags, by pupil-apriltags where it is installed, else by OpenCV",
}

APRIL_GRID_TAGS = "DICT_APRILTAG_36h11"


@dataclass(frozen=True)
class TargetSpec:
    """A kind of target: `kind` the first word; `bits` of a ring code; `columns` and `rows`, 0 where not said;
    `dictionary` of markers; `square_mm`, `marker_mm` of a ChArUco board, and of an AprilGrid, whose squares stand
    between its tags."""

    kind: str
    bits: int = 0
    columns: int = 0
    rows: int = 0
    dictionary: str = ""
    square_mm: float = 1.0
    marker_mm: float = 0.7

    def pattern(self, border_cells: int = 2) -> BoardPattern:
        """The print of an AprilGrid."""
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
        if kind in ("circles", "acircles", "checkerboard") and len(rest) == 1:
            return TargetSpec(kind, 0, *_size(rest[0]))
        if kind == "charuco" and len(rest) == 4:
            square, marker = float(rest[2]), float(rest[3])
            if not 0 < marker < square < float("inf"):
                raise _wrong(text, where, "a marker is smaller than its square, and both have a size")
            return TargetSpec(kind, 0, *_size(rest[0]), rest[1], square, marker)
        if kind == "aprilgrid" and len(rest) == 3:
            marker, square = float(rest[1]), float(rest[2])
            if not 0 < square < marker < float("inf"):
                raise _wrong(text, where, "a corner square is smaller than its tag, and both have a size")
            return TargetSpec(kind, 0, *_size(rest[0]), APRIL_GRID_TAGS, square, marker)
        if kind in ("aruco", "apriltag") and len(rest) == 1 and rest[0]:
            # A scene names the family as OpenCV does, others as its makers do: both are understood.
            family = re.sub(r"(?i)^(dict_april)?tag_?", "", rest[0]) if kind == "apriltag" else rest[0]
            return TargetSpec(kind, dictionary=family)
    except ValueError as error:
        raise _wrong(text, where, str(error)) from error
    like = [name for name in KINDS if name.split(":")[0] == kind]
    if like:
        raise TestfieldError(f"'{text}' does not say all that is needed", where, f"give it like {like[0]}")
    raise _wrong(text, where, "no such kind of target")


def _size(text: str) -> tuple[int, int]:
    size = re.fullmatch(r"(\d{1,3})x(\d{1,3})", text)
    if not size or min(int(size[1]), int(size[2])) < 2:
        raise ValueError(f"'{text}' is no size such as 10x8")
    return int(size[1]), int(size[2])


def _wrong(text: str, where: str, why: str) -> TestfieldError:
    return TestfieldError(f"'{text}': {why}", where, f"give one like {', '.join(KINDS)}")
