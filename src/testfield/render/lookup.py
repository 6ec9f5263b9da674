"""Places in tables from coordinates that may be anything.

A ray that meets nothing has coordinates that are not numbers, and one that grazes a panel has a footprint beyond all
bounds. Dr.Jit's `clip` and `minimum` pass on what is not a number, and turning it into an integer gives what the
processor likes: an index far outside the table on some. So every float that becomes an index passes through here.
"""

from typing import Any

from testfield.render.variant import mitsuba


def within(value: Any, low: Any, high: Any) -> Any:
    """The value, or the nearer bound where it lies outside; `low` where it is not a number."""
    import drjit as dr

    # Nothing compares greater than what is not a number, so it is `low` that is selected.
    return dr.minimum(dr.select(value > low, value, low), high)


def bin_of(value: Any, count: Any) -> Any:
    """Number of the bin of width 1, of `count` that begin at 0, in which a value lies; the nearest where in none."""
    mi = mitsuba()
    return mi.UInt32(within(value, 0, mi.Float(count) - 1))


def cell_of(value: Any, nodes: Any) -> tuple[Any, Any]:
    """Number of the interval between `nodes` at 0, 1, ... in which a value lies, and where in it, in [0, 1]."""
    import drjit as dr

    mi = mitsuba()
    value = within(value, 0, mi.Float(nodes - 1))
    cell = dr.minimum(mi.UInt32(value), nodes - 2)
    return cell, value - mi.Float(cell)
