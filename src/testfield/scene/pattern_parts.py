"""Boards that people own, as a scene file has them: patterns of squares, tags and circles, of each kind one part."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from testfield.scene.fields import Dictionary, Part, PositiveFloat
from testfield.targets.board_pattern import BoardPattern, dictionary
from testfield.targets.crowns import crown_radii
from testfield.targets.rune_code import DOT, word_of_rune

LEAST_CCTAG_PITCH = 1.25
"""Distance of CCTags in diameters: each needs paper around it."""


class CharucoPart(Part):
    """A ChArUco board: a checkerboard, black at its top left, with a tag in each white square."""

    kind: Literal["charuco"] = Field(description="A checkerboard with tags.")
    columns: int = Field(ge=2, le=100, description="Squares in x.")
    rows: int = Field(ge=2, le=100, description="Squares in y.")
    square_mm: PositiveFloat = Field(description="Side of a square.")
    marker_mm: PositiveFloat = Field(description="Side of a tag, its black border included.")
    dictionary: Dictionary = Field("DICT_4X4_50", description="OpenCV's dictionary of the tags.")
    first_tag: int = Field(0, ge=0, description="Number of the first tag; the rest follow row by row.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(
            self.kind, self.columns, self.rows, self.square_mm, self.marker_mm, self.dictionary, self.first_tag
        )

    @model_validator(mode="after")
    def _tags(self) -> "CharucoPart":
        if self.marker_mm >= self.square_mm:
            raise ValueError(f"marker_mm {self.marker_mm:g} is not smaller than square_mm {self.square_mm:g}")
        _enough_tags(self.pattern)
        return self


class CheckerboardPart(Part):
    """A checkerboard, black at its top left. One of columns and rows is odd, or nobody could tell which way is up."""

    kind: Literal["checkerboard"] = Field(description="Squares alone.")
    columns: int = Field(ge=4, le=100, description="Squares in x.")
    rows: int = Field(ge=4, le=100, description="Squares in y.")
    square_mm: PositiveFloat = Field(description="Side of a square.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, self.columns, self.rows, self.square_mm)

    @model_validator(mode="after")
    def _one_way_up(self) -> "CheckerboardPart":
        if (self.columns + self.rows) % 2 == 0:
            raise ValueError(
                f"{self.columns} x {self.rows} squares look the same upside down; add a column or a row of them"
            )
        return self


class TagGridPart(Part):
    """A grid of ArUco tags or AprilTags, whose outer corners are measured."""

    kind: Literal["aruco", "apriltag"] = Field(description="Tags in a grid.")
    columns: int = Field(ge=1, le=100, description="Tags in x.")
    rows: int = Field(ge=1, le=100, description="Tags in y.")
    marker_mm: PositiveFloat = Field(description="Side of a tag, its black border included.")
    gap_mm: PositiveFloat = Field(description="White between neighbouring tags.")
    dictionary: Dictionary | None = Field(
        None, description="OpenCV's dictionary; absent: DICT_4X4_50, for apriltag DICT_APRILTAG_36h11."
    )
    first_tag: int = Field(0, ge=0, description="Number of the first tag; the rest follow row by row.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        names = self.dictionary or ("DICT_4X4_50" if self.kind == "aruco" else "DICT_APRILTAG_36h11")
        pitch_mm = self.marker_mm + self.gap_mm
        return BoardPattern("tags", self.columns, self.rows, pitch_mm, self.marker_mm, names, self.first_tag)

    @model_validator(mode="after")
    def _tags(self) -> "TagGridPart":
        april = self.pattern.names.upper().startswith("DICT_APRILTAG")
        if april != (self.kind == "apriltag"):
            raise ValueError(f"'{self.dictionary}' is no dictionary of {self.kind} tags")
        _enough_tags(self.pattern)
        return self


class AprilGridPart(Part):
    """Kalibr's AprilGrid: AprilTags from the lower left, with a black square at each of their corners."""

    kind: Literal["aprilgrid"] = Field(description="Kalibr's AprilGrid.")
    columns: int = Field(ge=1, le=100, description="Tags in x, Kalibr's tagCols.")
    rows: int = Field(ge=1, le=100, description="Tags in y, Kalibr's tagRows.")
    marker_mm: PositiveFloat = Field(description="Side of a tag, its black border included: Kalibr's tagSize.")
    gap_mm: PositiveFloat = Field(description="Side of the corner squares: Kalibr's tagSpacing times tagSize.")
    dictionary: Dictionary = Field("DICT_APRILTAG_36h11", description="OpenCV's dictionary of the tags.")
    border_cells: int = Field(2, ge=1, le=2, description="Width of a tag's black border in cells; Kalibr prints 2.")
    first_tag: int = Field(0, ge=0, description="Number of the tag at the lower left; the rest follow row by row.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(
            self.kind,
            self.columns,
            self.rows,
            self.marker_mm + self.gap_mm,
            self.marker_mm,
            self.dictionary,
            self.first_tag,
            border_cells=self.border_cells,
        )

    @model_validator(mode="after")
    def _tags(self) -> "AprilGridPart":
        if self.gap_mm >= self.marker_mm:
            raise ValueError(f"gap_mm {self.gap_mm:g} is not smaller than marker_mm {self.marker_mm:g}")
        _enough_tags(self.pattern)
        return self


class CCTagPart(Part):
    """A grid of CCTags: concentric black crowns whose radii tell their numbers."""

    kind: Literal["cctag"] = Field(description="CCTags in a grid.")
    columns: int = Field(ge=1, le=100, description="Tags in x.")
    rows: int = Field(ge=1, le=100, description="Tags in y.")
    pitch_mm: PositiveFloat = Field(description="Distance of neighbouring tags.")
    diameter_mm: PositiveFloat = Field(description="Diameter of a tag's outer circle.")
    crowns: Literal[3, 4] = Field(3, description="Crowns of a tag: of 3 there are 32 tags, of 4 there are 128.")
    first_tag: int = Field(0, ge=0, description="Number of the first tag; the rest follow row by row.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(
            self.kind,
            self.columns,
            self.rows,
            self.pitch_mm,
            self.diameter_mm,
            first_tag=self.first_tag,
            crowns=self.crowns,
        )

    @model_validator(mode="after")
    def _tags(self) -> "CCTagPart":
        if self.pitch_mm < LEAST_CCTAG_PITCH * self.diameter_mm:
            raise ValueError(
                f"pitch_mm {self.pitch_mm:g} leaves too little white around tags of {self.diameter_mm:g} mm: "
                f"make it {LEAST_CCTAG_PITCH * self.diameter_mm:g} or more"
            )
        there, last = len(crown_radii(self.crowns)), int(self.pattern.tags[-1])
        if last >= there:
            raise ValueError(f"tags to number {last} are needed, and those of {self.crowns} crowns end at {there - 1}")
        return self


class RuneTagPart(Part):
    """A RUNE-Tag of 129 places: dots on three circles, which is known with half of it hidden."""

    kind: Literal["runetag"] = Field(description="One RUNE-Tag.")
    diameter_mm: PositiveFloat = Field(description="Diameter of the circle on which the outermost dots stand.")
    number: int = Field(ge=0, description="Its number in the reference's table of 17,000 tags.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, 1, 1, self.diameter_mm, DOT * self.diameter_mm, first_tag=self.number)

    @model_validator(mode="after")
    def _there(self) -> "RuneTagPart":
        word_of_rune(self.number)
        return self


class CirclesPart(Part):
    """A symmetric grid of plain dots. It looks the same upside down, so cameras must see it more or less upright."""

    kind: Literal["circles"] = Field(description="A symmetric grid of dots.")
    columns: int = Field(ge=3, le=1000, description="Dots in x, more than rows.")
    rows: int = Field(ge=2, le=1000, description="Dots in y.")
    pitch_mm: PositiveFloat = Field(description="Distance of neighbouring dots.")
    diameter_mm: PositiveFloat = Field(description="Diameter of each dot.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, self.columns, self.rows, self.pitch_mm, self.diameter_mm)

    @model_validator(mode="after")
    def _longer_than_high(self) -> "CirclesPart":
        _wider_than_high(self.columns, self.rows)
        return self


class SquaresPart(Part):
    """A grid of squares that do not touch. It looks the same upside down, so cameras must see it more or less
    upright."""

    kind: Literal["squares"] = Field(description="A grid of squares that do not touch.")
    columns: int = Field(ge=2, le=100, description="Squares in x, more than rows.")
    rows: int = Field(ge=2, le=100, description="Squares in y.")
    square_mm: PositiveFloat = Field(description="Side of a square.")
    gap_mm: PositiveFloat = Field(description="White between neighbouring squares.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, self.columns, self.rows, self.square_mm + self.gap_mm, self.square_mm)

    @model_validator(mode="after")
    def _longer_than_high(self) -> "SquaresPart":
        _wider_than_high(self.columns, self.rows)
        return self


class AsymmetricCirclesPart(Part):
    """An asymmetric grid of plain dots, as OpenCV counts it: every other row is shifted by `pitch_mm`."""

    kind: Literal["acircles"] = Field(description="An asymmetric grid of dots.")
    columns: int = Field(ge=2, le=1000, description="Dots in a row.")
    rows: int = Field(ge=3, le=1000, description="Rows, an odd number of them: of an even one nobody can tell the top.")
    pitch_mm: PositiveFloat = Field(description="Distance of rows, and half the distance of neighbours in a row.")
    diameter_mm: PositiveFloat = Field(description="Diameter of each dot.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, self.columns, self.rows, self.pitch_mm, self.diameter_mm)

    @model_validator(mode="after")
    def _one_way_up(self) -> "AsymmetricCirclesPart":
        if self.rows % 2 == 0:
            raise ValueError(f"{self.rows} rows look the same upside down; give an odd number")
        return self


class HexagonalCirclesPart(Part):
    """A hexagonal grid of plain dots, as BoofCV prints them: every other row from the second lowest is shifted by half
    a distance. One of an even number of rows looks the same upside down, so cameras must see it more or less upright.
    """

    kind: Literal["hexcircles"] = Field(description="A hexagonal grid of dots.")
    columns: int = Field(ge=2, le=1000, description="Dots in a row.")
    rows: int = Field(ge=3, le=1000, description="Rows; of an even number nobody can tell the top.")
    pitch_mm: PositiveFloat = Field(description="Distance of a dot from its six neighbours.")
    diameter_mm: PositiveFloat = Field(description="Diameter of each dot.")

    @property
    def pattern(self) -> BoardPattern:
        """What is printed."""
        return BoardPattern(self.kind, self.columns, self.rows, self.pitch_mm, self.diameter_mm)


PatternPart = Annotated[
    CharucoPart
    | CheckerboardPart
    | TagGridPart
    | AprilGridPart
    | CCTagPart
    | RuneTagPart
    | CirclesPart
    | SquaresPart
    | AsymmetricCirclesPart
    | HexagonalCirclesPart,
    Field(discriminator="kind"),
]


def _wider_than_high(columns: int, rows: int) -> None:
    if columns <= rows:
        raise ValueError(f"columns ({columns}) must exceed rows ({rows}): they tell x from y")


def _enough_tags(pattern: BoardPattern) -> None:
    there = len(dictionary(pattern.names).bytesList)
    if len(pattern.tags) and pattern.tags[-1] >= there:
        raise ValueError(f"tags to number {pattern.tags[-1]} are needed, and {pattern.names} ends at {there - 1}")
