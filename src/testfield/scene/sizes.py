"""How large a scene becomes, known before anything of it is built."""

from math import prod

from testfield.errors import TestfieldError
from testfield.scene.board_parts import BoardPart
from testfield.scene.pattern_parts import RuneTagPart
from testfield.scene.schema import SceneFile
from testfield.scene.station_parts import StationGrid, StationPart, StationPose, StationSingle
from testfield.scene.target_parts import CheckGrid, CheckOnMesh, CheckPart, CheckRandom
from testfield.targets.rune_code import CIRCLES, SECTORS

MOST_PIXELS = 200_000_000
MOST_STATIONS = 10_000
MOST_MARKS = 200_000
MOST_VIEWS = 20_000_000
"""Stations times marks: of each the truth keeps about 200 bytes."""


def check_sizes(scene: SceneFile, source: str) -> None:
    """Raise `TestfieldError` where a scene would have more pixels, stations, marks or views than can be held."""
    for camera, where in [(scene.camera, "camera"), *((one, f"cameras[{k}]") for k, one in enumerate(scene.cameras))]:
        _at_most(camera.width_px * camera.height_px, MOST_PIXELS, "pixels", f"{source}, {where}.width_px")
    stations = [stations_of(part) for part in scene.stations]
    _at_most(max(stations), MOST_STATIONS, "stations", f"{source}, stations[{stations.index(max(stations))}]")
    times = 1 + max((len(bar.moves) for bar in scene.scale_bars), default=0)
    held = max((len(rig.cameras) for rig in scene.rigs), default=1)
    images = times * held * sum(stations)
    _at_most(images, MOST_STATIONS, "images" if times * held > 1 else "stations", f"{source}, stations")
    boards = [marks_of(part) for part in scene.boards]
    checks = [checks_of(part) for part in scene.check_targets]
    for name, counts in (("boards", boards), ("check_targets", checks)):
        if counts:
            most = max(counts)
            _at_most(most, MOST_MARKS, "targets", f"{source}, {name}[{counts.index(most)}]")
    others = 2 * len(scene.scale_bars) + sum(1 + len(line.lengths_mm) for line in scene.measuring_lines)
    marks = sum(boards) + sum(checks) + others
    _at_most(marks, MOST_MARKS, "targets", f"{source}, boards and check_targets")
    _at_most(marks * images, MOST_VIEWS, "stations times targets", f"{source}, stations")


def stations_of(part: StationPart) -> int:
    """How many stations a part becomes."""
    if isinstance(part, (StationSingle, StationPose)):
        return 1
    return prod(part.counts) if isinstance(part, StationGrid) else part.count


def checks_of(part: CheckPart) -> int:
    """How many check targets a part becomes."""
    if isinstance(part, CheckGrid):
        return prod(part.counts)
    if isinstance(part, CheckOnMesh):
        return len(part.points_mm) if part.points_mm is not None else part.count or 0
    return part.count if isinstance(part, CheckRandom) else 1


def marks_of(part: BoardPart) -> int:
    """How many marks a board has at most."""
    if isinstance(part.pattern, RuneTagPart):
        return CIRCLES * SECTORS
    if part.pattern is not None:
        return 4 * part.pattern.columns * part.pattern.rows
    return part.extension_zone.count + part.recognition_zone.count


def _at_most(count: int, most: int, what: str, where: str) -> None:
    if count > most:
        raise TestfieldError(f"this makes {count} {what}, and {most} are allowed", where, "lower the counts")
