"""Whether measuring lines are arranged as VDI/VDE 2634 recommends."""

from typing import Any

import numpy as np

from testfield.scene.schema import SceneFile
from testfield.scene.world import CHECK, World


def check_positions(world: World) -> dict[int, np.ndarray]:
    """True positions of the check targets in the world, by code."""
    here = np.flatnonzero(world.marks.role == CHECK)
    return {int(world.marks.code[k]): xyz for k, xyz in zip(here, world.mark_world_mm[here], strict=True)}


LINES, LENGTHS = 7, 5
"""Measuring lines, and test lengths on each, that VDI/VDE 2634 part 1 recommends."""
CORNER = 0.1
"""An end point this near to a corner, in shortest sides of the volume, is in that corner."""


def arrangement(scene: SceneFile, world: World) -> list[dict[str, Any]] | None:
    """What VDI/VDE 2634 part 1 recommends of the measuring lines, one by one; None of a field that has none.

    The corners are those of a volume of the declared size about the middle of all lines' ends.
    """
    lines = world.field.measuring_lines
    if not lines:
        return None
    at, size = check_positions(world), np.array(scene.volume.size_mm)
    ends = np.array([at[code] for line in lines for code in (line.codes[0], line.codes[-1])])
    low, high = ends.min(axis=0), ends.max(axis=0)
    corners = (low + high) / 2 + size * (np.array(list(np.ndindex(2, 2, 2))) - 0.5)
    near = np.linalg.norm(corners[:, None] - ends[None], axis=-1).min(axis=1) <= CORNER * size.min()
    longest = np.array([line.length_mm[-1] for line in lines])
    fewest, diagonal = min(len(line.length_mm) for line in lines), float(np.linalg.norm(size))
    asked = (
        ("measuring lines", f"{LINES} or more", f"{len(lines)}", len(lines) >= LINES),
        ("test lengths on every line", f"{LENGTHS} or more", f"{fewest}", fewest >= LENGTHS),
        (
            "longest length of every line",
            f"the shortest side, {size.min():.0f} mm, or more",
            f"{longest.min():.0f} mm or more",
            longest.min() >= size.min() - 1e-6,
        ),
        (
            "one line at least",
            f"two thirds of the diagonal, {2 / 3 * diagonal:.0f} mm",
            f"{longest.max():.0f} mm",
            longest.max() >= 2 / 3 * diagonal,
        ),
        (
            "the lines span the volume",
            " x ".join(f"{v:.0f}" for v in size) + " mm",
            " x ".join(f"{v:.0f}" for v in high - low) + " mm",
            bool((high - low >= (1 - CORNER) * size).all()),
        ),
        ("an end point in every corner", "8", f"{near.sum()}", bool(near.all())),
    )
    return [{"what": what, "asked": wish, "found": found, "met": bool(met)} for what, wish, found, met in asked]
