"""The boards of a scene file: zones of dots and ring codes, a pattern in their place (`pattern_parts`), dirt."""

import math

from pydantic import (
    Field,
    PositiveInt,
    model_validator,
)

from testfield.scene.bend import curvature_of, extent_mm
from testfield.scene.fields import Count, Direction, Ink, Label, Pair, Part, PositiveFloat, Size, Vector3
from testfield.scene.pattern_parts import PatternPart


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
