"""What can be wrong with boards of squares, tags and circles: tags used twice, boards that look alike, tops unseen."""

import numpy as np

from testfield.errors import TestfieldError
from testfield.scene.schema import SceneFile
from testfield.scene.truth import Views
from testfield.scene.world import World
from testfield.targets.board_pattern import BoardPattern

LEAST_CELL_PX = 2.0
"""Width of a tag's cell in the image below which it cannot be read."""


def check_patterns(scene: SceneFile, world: World, source: str) -> None:
    """Raise `TestfieldError` where two boards could not be told apart."""
    owners: dict[tuple, int] = {}
    for k, board in enumerate(world.field.boards):
        pattern = board.pattern
        if pattern is None:
            continue
        size = tuple(sorted((pattern.columns, pattern.rows)))
        # A tag is known by its dictionary and number; what has no tags is known by its size alone.
        names: list[tuple] = [(_family(pattern), int(tag)) for tag in pattern.tags] or [(pattern.kind, *size)]
        for name in names:
            if name in owners:
                what = f"tag {name[1]} of {name[0]}" if len(pattern.tags) else f"{pattern.kind} of the same size"
                raise TestfieldError(
                    f"{what} is also on boards[{owners[name]}]",
                    f"{source}, boards[{k}].pattern",
                    "give another first_tag" if len(pattern.tags) else "give it another number of columns",
                )
            owners[name] = k
        for j, other in enumerate(world.field.boards):
            if j != k and other.pattern is not None and not len(pattern.tags) and other.pattern.kind == pattern.kind:
                larger = tuple(sorted((other.pattern.columns, other.pattern.rows)))
                if size != larger and all(a <= b for a, b in zip(size, larger, strict=True)):
                    raise TestfieldError(
                        f"this {pattern.kind} of {pattern.columns} x {pattern.rows} would be found within boards[{j}]",
                        f"{source}, boards[{k}].pattern",
                        "make it longer one way and shorter the other",
                    )
        ink = scene.boards[k].ink or scene.paint.ink
        if pattern.has_corners and ink in ("retro", "luminous"):
            raise TestfieldError(
                f"a board of squares or tags is black on white and cannot have {ink} ink",
                f"{source}, boards[{k}].ink",
                'set it to "matt" or "gloss"',
            )


def _family(pattern: BoardPattern) -> str:
    """What the numbers of a board's tags belong to."""
    return f"CCTags of {pattern.crowns} crowns" if pattern.crowns else pattern.names.upper() or pattern.kind


def _same_upside_down(pattern: BoardPattern) -> bool:
    """Whether nothing on a board of dots or of lone squares tells which end is its top."""
    if len(pattern.tags) or (pattern.has_corners and pattern.of_kind.crossing):
        return False
    middles = pattern.points_mm.reshape(pattern.columns * pattern.rows, -1, 2).mean(axis=1)
    return bool(np.allclose(-middles[::-1], middles, atol=1e-6 * pattern.pitch_mm))


def pattern_warnings(world: World, views: Views, source: str) -> list[str]:
    """A word on tags too small to be read, and on symmetric grids that are seen upside down."""
    warnings = []
    for b, board in enumerate(world.field.boards):
        pattern = board.pattern
        if pattern is None:
            continue
        here = np.flatnonzero(world.marks.board == b)
        seen = (views.visible[:, here] == 1).all(axis=1)
        if _same_upside_down(pattern) and seen.any():
            first, last = views.disc_px[:, here[0]].sum(axis=1), views.disc_px[:, here[-1]].sum(axis=1)
            turned = [world.station_name[s] for s in np.flatnonzero(seen & (first > last))]
            if turned:
                points = "corners" if pattern.has_corners else "dots"
                warnings.append(
                    f"{source}: the symmetric grid '{board.name}' is upside down in {', '.join(turned)}, where its "
                    f"{points} will be named the wrong way round; turn the camera (roll_deg), or use an asymmetric grid"
                )
        if pattern.names:
            px = np.where(views.visible[:, here] == 1, views.diameter_px[:, here], 0).max(initial=0)
            cell_px = px / pattern.free_mm * float(np.diff(pattern.cells.x_mm).min())
            if 0 < cell_px < LEAST_CELL_PX:
                warnings.append(
                    f"{source}: the cells of the tags on '{board.name}' are {cell_px:.1f} px wide at best and need "
                    f"{LEAST_CELL_PX:.0f}"
                )
    return warnings
