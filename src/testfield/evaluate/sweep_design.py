"""Which values a sweep gives to which fields: one factor at a time, grids, Latin hypercubes, Sobol's sequence."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from scipy.stats import qmc

from testfield.errors import TestfieldError
from testfield.seeds import generator

MOST_CASES = 10_000
"""A sweep of more is refused before anything is made of it."""


class Design(StrEnum):
    """How values are combined."""

    ONE = "one"
    """Each value of each field alone, everything else as in the scene."""
    GRID = "grid"
    """Every value with every other."""
    LATIN = "latin_hypercube"
    """Samples of which each field's values are spread evenly (McKay, Beckman and Conover 1979)."""
    SOBOL = "sobol"
    """Owen-scrambled points of Sobol's sequence, which fill the space evenly."""


@dataclass(frozen=True)
class Levels:
    """What a field may be: listed `values`, or a range from `low` to `high` of so many `levels`, spaced evenly or by
    their logarithm; `whole` numbers only where that is asked for."""

    values: tuple[Any, ...] = ()
    low: float = 0.0
    high: float = 0.0
    levels: int = 5
    log: bool = False
    whole: bool = False

    @property
    def listed(self) -> tuple[Any, ...]:
        """All values, for grids and for one factor at a time."""
        return self.values or tuple(dict.fromkeys(self.at(u) for u in np.linspace(0, 1, self.levels)))

    def at(self, u: float) -> Any:
        """The value at a place of the unit interval."""
        if self.values:
            return self.values[min(int(u * len(self.values)), len(self.values) - 1)]
        if self.log:
            value = math.exp(math.log(self.low) + u * (math.log(self.high) - math.log(self.low)))
        else:
            value = self.low + u * (self.high - self.low)
        return round(value) if self.whole else float(f"{value:.10g}")


def count_of(design: Design, fields: Mapping[str, Levels], samples: int) -> tuple[int, str]:
    """How many combinations a design has, without making them, and how that comes about."""
    sizes = [len(one.listed) for one in fields.values()]
    if design is Design.GRID:
        return math.prod(sizes), f"a grid of {' x '.join(map(str, sizes))}"
    if design is Design.ONE:
        return sum(sizes), f"one factor at a time, {' + '.join(map(str, sizes))}"
    return samples, f"{samples} samples of {len(sizes)} fields by {design.value}"


def combinations(design: Design, fields: Mapping[str, Levels], samples: int, seed: int) -> list[dict[str, Any]]:
    """The values of the fields for each combination. Raises `TestfieldError` where there are more than `MOST_CASES`, or
    a Sobol design has not a power of two of them."""
    count, how = count_of(design, fields, samples)
    if count > MOST_CASES:
        raise TestfieldError(
            f"{count:,} cases ({how}), and {MOST_CASES:,} are allowed",
            "vary",
            'give fewer values, or design = "sobol" with some hundred samples',
        )
    if design is Design.ONE:
        return [{path: value} for path, one in fields.items() for value in one.listed]
    if design is Design.GRID:
        places = np.indices([len(one.listed) for one in fields.values()]).reshape(len(fields), -1).T
        listed = [one.listed for one in fields.values()]
        return [{path: listed[k][n] for k, (path, n) in enumerate(zip(fields, row, strict=True))} for row in places]
    if design is Design.SOBOL and samples & (samples - 1):
        below = 1 << (samples.bit_length() - 1)
        raise TestfieldError(
            f"{samples} samples: Sobol's points are even in powers of two",
            "vary.samples",
            f"give {below} or {2 * below}",
        )
    random = generator(seed, f"sweep/{design.value}")
    engine: Any = qmc.Sobol if design is Design.SOBOL else qmc.LatinHypercube
    units = engine(len(fields), seed=random).random(samples)
    return [{path: one.at(u) for (path, one), u in zip(fields.items(), row, strict=True)} for row in units]
