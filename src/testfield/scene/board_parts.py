"""The boards of a scene file: zones of dots and ring codes, patterns of squares, tags and circles, dirt."""

import math
from typing import Annotated, Literal

from pydantic import (
    Field,
    PositiveInt,
    model_validator,
)

from testfield.scene.bend import curvature_of, extent_mm
from testfield.scene.fields import Count, Dictionary, Direction, Ink, Label, Pair, Part, PositiveFloat, Size, Vector3
from testfield.targets.board_pattern import BoardPattern, dictionary
from testfield.targets.crowns import crown_radii
from testfield.targets.rune_code import DOT, word_of_rune

LEAST_CCTAG_PITCH = 1.25
"""Distance of CCTags in diameters: each needs paper around it."""


class ExtensionZone(Part):
    """A grid of plain circular dots."""

    columns: Count = Field(10, description="Dots in x.")
    rows: Count = Field(9, description="Dots in y.")
    pitch_mm: PositiveFloat = Field(75, description="Distance of neighbouring dots.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of each dot.")
    centre_mm: Pair = Field(
        (0, 0), description="Middle of the grid on the board, x right and y up from the board's middle."
    )
    places_mm: tuple[Pair, ...] | None = Field(
        None,
        min_length=1,
        max_length=10000,
        description="Places of dots one by one, from `centre_mm`, instead of columns, rows and pitch_mm.",
    )

    @property
    def count(self) -> int:
        """How many dots it has."""
        return self.columns * self.rows if self.places_mm is None else len(self.places_mm)


class RecognitionZone(Part):
    """A grid of ring-coded targets with consecutive numbers, or those listed."""

    columns: Count = Field(3, description="Targets in x.")
    rows: Count = Field(4, description="Targets in y.")
    pitch_mm: PositiveFloat = Field(150, description="Distance of neighbouring targets.")
    diameter_mm: PositiveFloat = Field(
        20, description="Diameter of the central dot; the ring reaches three times as far."
    )
    centre_mm: Pair = Field((0, 0), description="Middle of the grid on the board.")
    first_code: PositiveInt | None = Field(
        None, description="Number of the first target; the rest follow row by row from the top left."
    )
    codes: tuple[PositiveInt, ...] | None = Field(None, description="Numbers one by one instead of first_code.")
    places_mm: tuple[Pair, ...] | None = Field(
        None,
        min_length=1,
        max_length=10000,
        description="Places of targets one by one, from `centre_mm`, instead of columns, rows and pitch_mm.",
    )

    @property
    def count(self) -> int:
        """How many targets it has."""
        return self.columns * self.rows if self.places_mm is None else len(self.places_mm)


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


class DirtPart(Part):
    """Round spots of dirt at random places of a board, over ground and marks."""

    count: Count = Field(description="How many.")
    diameter_mm: PositiveFloat = Field(description="Diameter of each.")
    albedo: float = Field(0.25, ge=0, le=0.95, description="Diffuse reflectance.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")


class BoardPart(Part):
    """A sub-board with its two zones: flat by its certificate, and in truth where `bow_mm` is 0."""

    name: Label = Field(description="Unique name.")
    size_mm: Size = Field((1100, 800), description="Width and height.")
    thickness_mm: PositiveFloat = Field(10, description="The back lies this far behind the front.")
    position_mm: Vector3 = Field(description="Where the middle of the front is.")
    normal: Direction = Field((0, -1, 0), description="Direction the front faces; any length.")
    spin_deg: float = Field(0, description="Rotation about the normal, counter-clockwise seen from the front.")
    extension_zone: ExtensionZone = Field(ExtensionZone(), description="The plain dots.")
    recognition_zone: RecognitionZone = Field(RecognitionZone(first_code=1), description="The coded targets.")
    pattern: PatternPart | None = Field(
        None,
        description="In the place of both zones: a board of squares, tags or circles. Squares and tags are black "
        "on white whatever paint.white_on_black says, and their lines have no errors but the boards' common scale.",
    )
    ink: Ink | None = Field(None, description="Material of its ink; absent, that of paint.ink.")
    print_sigma_mm: float = Field(
        0.01, ge=0, le=10, description="Standard deviation of each mark's true x and y about the nominal."
    )
    scale_error_ppm: float = Field(
        0,
        ge=-100000,
        le=100000,
        description="By how much this board is printed larger than the scale all boards share; its certificate knows "
        "nothing of it.",
    )
    bow_mm: float = Field(
        0,
        description="How far the middle stands out from the edges across the bending axis, positive towards the "
        "viewer: the printed sheet is bent to a circular cylinder without stretching, and its certificate knows "
        "nothing of it.",
    )
    bow_axis_deg: float = Field(
        90, description="Direction of the bending axis on the board, counter-clockwise from its x; 90 is upright."
    )
    marks_off_mm: tuple[Vector3, ...] | None = Field(
        None,
        description="By how much each mark truly lies off its nominal place, as somebody measured: in x, in y and "
        "towards the viewer, of coded targets first and then of dots, or of all circles of a pattern, row by row from "
        "the top left. Marks with heights lie on flat pieces that lean as their neighbours lie: a wavy sheet.",
    )
    dirt: DirtPart | None = Field(None, description="Spots of dirt; absent for a clean board.")

    @model_validator(mode="after")
    def _bendable(self) -> "BoardPart":
        curvature_of(self.bow_mm, extent_mm(self.size_mm, math.radians(self.bow_axis_deg)))
        return self

    @model_validator(mode="after")
    def _places_off(self) -> "BoardPart":
        if self.marks_off_mm is None:
            return self
        if self.pattern is not None and self.pattern.pattern.has_corners:
            raise ValueError(
                f"the lines of a {self.pattern.kind} board are printed in one piece: leave out marks_off_mm"
            )
        if self.bow_mm and any(height for _, _, height in self.marks_off_mm):
            raise ValueError("both bow_mm and heights in marks_off_mm are given; give one of them")
        return self

    @model_validator(mode="after")
    def _one_print(self) -> "BoardPart":
        if self.pattern is None:
            return self
        zones = sorted(self.model_fields_set & {"extension_zone", "recognition_zone"})
        if zones:
            raise ValueError(f"a board with a pattern has no {' or '.join(zones)}")
        printed = self.pattern.pattern
        if not printed.has_corners:
            return self
        if self.bow_mm:
            raise ValueError(f"a board of squares or tags ({self.pattern.kind}) is flat; set bow_mm to 0")
        if "print_sigma_mm" in self.model_fields_set and self.print_sigma_mm:
            raise ValueError(
                f"the lines of a {self.pattern.kind} board are printed in one piece; leave out print_sigma_mm"
            )
        return self
