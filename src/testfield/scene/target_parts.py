"""Bars, check targets and measuring lines of a scene file."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import (
    Field,
    PositiveInt,
    model_validator,
)

from testfield.scene.fields import Box, Count, Direction, Label, Pair, Part, PositiveFloat, Vector3


class MovePart(Part):
    """Where a scale bar lies at a later time."""

    position_mm: Vector3 = Field(description="Where its middle is.")
    direction: Direction = Field((1, 0, 0), description="From the first target to the second; any length.")
    normal: Direction = Field((0, -1, 0), description="Direction the targets face.")


class ScaleBarPart(Part):
    """A bar with a ring-coded target at either end."""

    name: Label = Field(description="Unique name.")
    role: Literal["control", "check"] = Field(
        description="control: its length enters the calibration; check: it only tests it."
    )
    length_mm: float = Field(gt=10, description="Certified distance between the two targets' centres.")
    u_length_mm: float = Field(
        0.005,
        ge=0,
        description="Standard uncertainty of the certified length; the true length differs by a draw from it.",
    )
    codes: tuple[PositiveInt, PositiveInt] = Field(description="Numbers of the two targets.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the targets' central dots.")
    position_mm: Vector3 = Field(description="Where the middle of the bar is.")
    direction: Direction = Field((1, 0, 0), description="From the first target to the second; any length.")
    normal: Direction = Field((0, -1, 0), description="Direction the targets face; made square to `direction`.")
    moves: tuple[MovePart, ...] = Field(
        (), max_length=1000, description="Where it lies at later times, at each of which every camera takes an image."
    )


class CheckSingle(Part):
    """One check target on a card of its own."""

    generator: Literal["single"] = "single"
    code: PositiveInt = Field(description="Its number.")
    position_mm: Vector3 = Field(description="Where its centre is.")
    normal: Direction = Field((0, -1, 0), description="Direction it faces.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dot.")


class CheckOnBoard(Part):
    """One check target stuck on a board; the board's sheet does not list it."""

    generator: Literal["on_board"]
    board: str = Field(description="The board's name.")
    code: PositiveInt = Field(description="Its number.")
    xy_mm: Pair = Field(description="Where it is on the board, from the board's middle.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dot.")


class CheckGrid(Box):
    """Check targets on a regular lattice in the volume."""

    generator: Literal["grid"]
    first_code: PositiveInt = Field(description="Number of the first; the rest follow, x fastest, then y, then z.")
    counts: tuple[Count, Count, Count] = Field(description="How many along x, y and z.")
    normal: Direction = Field((0, -1, 0), description="Direction all face.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dots.")


class CheckRandom(Box):
    """Check targets at random places of a box, apart from each other and clear of the boards."""

    generator: Literal["random"]
    first_code: PositiveInt = Field(description="Number of the first.")
    count: Count = Field(description="How many.")
    normal: Direction = Field((0, -1, 0), description="Mean direction they face.")
    spread_deg: float = Field(25, ge=0, lt=90, description="Each faces within this angle of the mean direction.")
    spacing_mm: float = Field(200, ge=0, description="Least distance between any two.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dots.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")


class CheckOnMesh(Part):
    """Check targets stuck on a mesh: flat stickers that touch its surface."""

    generator: Literal["on_mesh"]
    mesh: str = Field(description="The mesh's name.")
    first_code: PositiveInt = Field(description="Number of the first.")
    points_mm: tuple[Vector3, ...] | None = Field(
        None, min_length=1, description="Points in the world; each target sits where the surface is nearest to one."
    )
    count: Count | None = Field(None, description="How many at random places of the surface, instead of points_mm.")
    spacing_mm: float = Field(0, ge=0, description="Least distance between any two random places.")
    facing: Direction | None = Field(None, description="Random places only where the surface faces this direction.")
    within_deg: float = Field(60, gt=0, le=180, description="Angle between the surface's normal and `facing`, at most.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dots.")
    seed: int = Field(0, ge=0, description="Another seed gives another arrangement.")

    @model_validator(mode="after")
    def _one_of_two(self) -> "CheckOnMesh":
        if (self.points_mm is None) == (self.count is None):
            raise ValueError("give either points_mm or count")
        return self


CheckPart = Annotated[
    CheckSingle | CheckOnBoard | CheckGrid | CheckRandom | CheckOnMesh, Field(discriminator="generator")
]


class MeasuringLinePart(Part):
    """Check targets along a line, with calibrated distances from the first: for `testfield accept`."""

    name: Label = Field(description="Unique name.")
    first_code: PositiveInt = Field(description="Number of the target at the start; the rest follow along the line.")
    start_mm: Vector3 = Field(description="Where the first target is.")
    direction: Direction = Field(description="From the first target to the others; any length.")
    lengths_mm: tuple[PositiveFloat, ...] = Field(
        min_length=1,
        max_length=100,
        description="Calibrated distances of the other targets from the first; five or more in VDI/VDE 2634 part 1.",
    )
    u_length_mm: float = Field(
        0.002, ge=0, description="Standard uncertainty of these distances; the true ones differ by draws from it."
    )
    normal: Direction = Field((0, -1, 0), description="Direction the targets face.")
    diameter_mm: PositiveFloat = Field(20, description="Diameter of the central dots.")

    @model_validator(mode="after")
    def _ascending(self) -> "MeasuringLinePart":
        if any(a >= b for a, b in pairwise(self.lengths_mm)):
            raise ValueError(f"lengths_mm {list(self.lengths_mm)} do not grow from one target to the next")
        return self


class AcceptancePart(Part):
    """The limit of the length measurement error, E = A + K L but no more than B, for `testfield accept`."""

    a_mm: float = Field(ge=0, description="A: the part that does not depend on the length.")
    k_ppm: float = Field(0, ge=0, description="K: the part that grows with the length, in mm a kilometre.")
    b_mm: PositiveFloat | None = Field(None, description="B: the most that the limit may be; absent for none.")
