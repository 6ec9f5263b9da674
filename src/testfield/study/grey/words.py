"""Words that follow from figures."""

from collections.abc import Sequence


def chosen(low: float, high: float, below: str, unknown: str, above: str) -> str:
    """Which words an interval (low, high) of a difference asks for: it lies below zero, holds zero, or lies above."""
    return above if low > 0 else below if high < 0 else unknown


def listed(names: Sequence[str]) -> str:
    """Names in a sentence: a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def without_units(names: Sequence[str]) -> str:
    """Factors in a sentence, without their units."""
    return listed([name.split(",")[0] for name in names])
