"""What a person writes of a field that was photographed: its targets, and what is certified of it (TOML)."""

from collections import Counter
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    PositiveInt,
    ValidationError,
    model_validator,
)

from testfield.choices import LensName
from testfield.store.faults import faults_of
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml
from testfield.targets.marks import USUAL, RingShape

SEE = "see scenes/README.md, field files"
Triple = tuple[float, float, float]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class TargetPart(_Part):
    """The kind of target, as `testfield detect --target` names it, and how large its dots are."""

    kind: str = Field(
        description="ring14 and the like; circles:10x8 and the like for [grid]; or one of the boards' kinds."
    )
    radii: RingShape = Field(USUAL, description="Shape of the ring codes, as 1:2:3.")
    codes: str | None = Field(None, description="Table of the rings' numbers: a file, or the name of a shipped one.")
    white_on_black: bool | None = Field(None, description="Bright dots on dark ground; absent, whichever is found.")
    diameter_mm: float | None = Field(None, gt=0, description="Diameter of all dots that are not listed.")
    diameters_mm: dict[PositiveInt, PositiveFloat] = Field(default_factory=dict, description="Diameters by code.")


class PlacePart(_Part):
    """A certified place of a code."""

    code: int = Field(ge=1)
    xyz_mm: Triple
    u_mm: NonNegativeFloat | tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] | None = Field(
        None, description="Standard uncertainty of the coordinates, or of each."
    )


class BoardPart(_Part):
    """Certified coordinates of codes in one frame, which becomes the frame of the result."""

    name: str = "board"
    u_mm: float = Field(0.0, ge=0, description="Standard uncertainty of every coordinate that has none of its own.")
    points: tuple[PlacePart, ...] = Field(min_length=3)

    @model_validator(mode="after")
    def _once(self) -> "BoardPart":
        if twice := _twice([place.code for place in self.points]):
            raise ValueError(f"code {twice[0]} is listed twice")
        return self


class RoughPlace(_Part):
    """About where a code is."""

    code: int = Field(ge=1)
    xyz: Triple = Field(description="In the group's own frame and unit.")


class GroupPart(_Part):
    """Codes that move rigidly together, with approximate places in a frame and unit of their own, as `testfield field
    new` proposes them. Nothing is certified: they say what belongs together, and are compared with what is measured."""

    name: str = Field(min_length=1)
    u: float = Field(gt=0, description="How well the places are known, in their own unit.")
    points: tuple[RoughPlace, ...] = Field(min_length=1)


class DistancePart(_Part):
    """A certified distance between two codes."""

    name: str
    codes: tuple[PositiveInt, PositiveInt]
    length_mm: float = Field(gt=0)
    u_mm: float = Field(0.0, ge=0, description="Standard uncertainty of the length.")
    role: Literal["control", "check"] = Field("control", description="`check` is compared and makes no scale.")

    @model_validator(mode="before")
    @classmethod
    def _named(cls, data: Any) -> Any:
        """A distance without a name is called after its codes."""
        if isinstance(data, dict) and "name" not in data and isinstance(data.get("codes"), list | tuple):
            ends = data["codes"]
            ends = sorted(ends) if all(isinstance(end, int) for end in ends) else ends
            return data | {"name": f"bar {'-'.join(map(str, ends))}"}
        return data

    @model_validator(mode="after")
    def _two(self) -> "DistancePart":
        if self.codes[0] == self.codes[1]:
            raise ValueError("both ends have the same code")
        return self


class GridPart(_Part):
    """A flat grid of circles, which calibrates the camera as a board of known dots does."""

    spacing_mm: float = Field(gt=0)
    u_mm: float = Field(0.0, ge=0, description="Standard uncertainty of each dot's place in the plane.")
    u_flat_mm: float = Field(0.0, ge=0, description="Standard uncertainty of each dot's height.")


class PatternPart(_Part):
    """A board whose print says where all its points lie: it calibrates the cameras that photographed it."""

    kind: str = Field(
        description="checkerboard:9x6:25, charuco:7x5:DICT_4X4_50:30:22, circles:10x8:25:15, acircles:4x11:20:12, "
        "hexcircles:14x24:12:10, tags:5x7:DICT_6X6_50:30:24; lengths in mm."
    )
    name: str = Field("", description="What it is called; absent, its kind.")
    u_mm: float | None = Field(
        None,
        ge=0,
        description="Standard uncertainty of each point's place in the plane; absent, as printed by anybody.",
    )
    u_flat_mm: float | None = Field(
        None, ge=0, description="Standard uncertainty of each point's height; absent, as printed by anybody."
    )
    u_scale: float | None = Field(
        None, ge=0, lt=1, description="Relative standard uncertainty of its spacing; absent, 0 where u_mm is given."
    )


def _twice(values: list[Any]) -> list[Any]:
    """What occurs more than once, in order."""
    return sorted(value for value, count in Counter(values).items() if count > 1)


class CameraPart(_Part):
    """One of several cameras: the photographs in a folder."""

    name: str = Field(min_length=1, description="Its name.")
    folder: str = Field(
        "", description="The folder of its photographs as it is called on the command line; absent, one of its name."
    )
    lens: LensName | None = Field(None, description="Its lens model; absent, that of the command line.")


class RigPart(_Part):
    """Cameras that a bar or frame holds: their photographs of one file name were taken together."""

    name: str = "rig"
    cameras: tuple[str, ...] = Field(min_length=2, description="Names of the cameras.")


class FieldFile(_Part):
    """A field file."""

    name: str = "field"
    target: TargetPart
    boards: tuple[BoardPart, ...] = Field((), max_length=1, description="At most one: a result has one frame.")
    groups: tuple[GroupPart, ...] = Field((), max_length=1000, description="Boards of which places are known roughly.")
    distances: tuple[DistancePart, ...] = ()
    grid: GridPart | None = None
    patterns: tuple[PatternPart, ...] = Field((), max_length=100, description="Boards that calibrate the cameras.")
    cameras: tuple[CameraPart, ...] = Field((), max_length=100, description="Several cameras.")
    rigs: tuple[RigPart, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _of_patterns(cls, data: Any) -> Any:
        """Where boards are declared, they are the targets unless others are named."""
        boards = data.get("patterns") if isinstance(data, dict) else None
        if isinstance(boards, list | tuple) and boards and "target" not in data and isinstance(boards[0], dict):
            return data | {"target": {"kind": str(boards[0].get("kind", ""))}}
        return data

    @model_validator(mode="after")
    def _whole(self) -> "FieldFile":
        if twice := _twice([distance.name for distance in self.distances]):
            raise ValueError(f"two distances are called '{twice[0]}': give each a name of its own")
        if twice := _twice([group.name for group in self.groups]):
            raise ValueError(f"two groups are called '{twice[0]}': give each a name of its own")
        if twice := _twice([point.code for group in self.groups for point in group.points]):
            raise ValueError(f"code {twice[0]} stands in the groups twice")
        if twice := _twice([camera.name for camera in self.cameras]):
            raise ValueError(f"two cameras are called '{twice[0]}': give each a name of its own")
        held = [name for rig in self.rigs for name in rig.cameras]
        if self.cameras and (alien := [name for name in held if name not in {one.name for one in self.cameras}]):
            raise ValueError(f"a rig holds '{alien[0]}', and no camera is called so")
        if twice := _twice(held):
            raise ValueError(f"camera '{twice[0]}' is held twice")
        if twice := _twice([pattern.kind for pattern in self.patterns]):
            raise ValueError(f"two patterns show the same print, '{twice[0]}': no image tells them from each other")
        if twice := _twice([pattern.name for pattern in self.patterns if pattern.name]):
            raise ValueError(f"two patterns are called '{twice[0]}': give each a name of its own")
        circles = self.target.kind.strip().startswith("circles") and not self.calibrating
        if circles and self.grid is None:
            raise ValueError("a grid of circles needs [grid] with spacing_mm")
        if circles and self.target.diameter_mm is None:
            raise ValueError("a grid of circles needs target.diameter_mm")
        if circles and ":" not in self.target.kind:
            raise ValueError('a grid of circles needs its columns and rows: target.kind = "circles:10x8"')
        if self.grid is not None and not circles:
            raise ValueError(f'[grid] belongs to target.kind = "circles:10x8", not to "{self.target.kind}"')
        return self

    @property
    def calibrating(self) -> tuple[PatternPart, ...]:
        """The boards that calibrate the cameras: those of [[patterns]], or that of the target's kind where it says all
        lengths."""
        if self.patterns:
            return self.patterns
        kind = self.target.kind.strip()
        if kind.startswith(
            ("checkerboard", "charuco", "acircles", "hexcircles", "tags", "aprilgrid", "squares", "runetag")
        ):
            return (PatternPart(kind=kind),)
        if self.grid is None and self.target.diameter_mm is None and kind.startswith("circles:"):
            return (PatternPart(kind=kind),)
        return ()


def field_of_target(kind: str) -> FieldFile:
    """The field of which only the kind of its targets is known."""
    return FieldFile(name=kind, target=TargetPart(kind=kind))


def is_field_file(data: Mapping[str, Any], others: Collection[str]) -> bool:
    """Whether a TOML document is rather a field file than one of the kind that has the fields `others`."""
    own = set(FieldFile.model_fields) - set(others)
    return bool(own & data.keys()) and not (data.keys() & set(others)) - set(FieldFile.model_fields)


def load_field_file(path: Path) -> FieldFile:
    """Read a field file. Raises `TestfieldError` that names every fault: its line, the field, the value."""
    content = read_toml(path, "field file")
    data = parse_toml(content, str(path))
    try:
        return FieldFile.model_validate(data)
    except ValidationError as error:
        raise faults_of(error, FieldFile, data, decoded(content), str(path), SEE) from error
