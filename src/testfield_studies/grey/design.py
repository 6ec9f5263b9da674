"""The runs of a design, and how twelve methods rank the factors from them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from testfield_studies.grey.factors import DUMMY, NAMES
from testfield_studies.grey.rankings import (
    ANOVA,
    FIRST,
    METHODS,
    TOTAL,
    Runs,
    acting_factors,
    agreement,
    anova_table,
    bootstrap,
    degrees,
    dummy_above,
    dummy_with_offset,
    in_other_orders,
    places,
    sequences,
)

BOOTSTRAPS, ORDERS = 400, 100
DISTURBED = ("absolute", "relative", "synthetic", "T-type", "slope", "B-type")
"""Degrees that depend on the order of the runs."""
FEWEST, FEW = 3, 10
"""Whole base rows that a design must have, and those below which bootstraps of them are no intervals."""


@dataclass(frozen=True)
class Design:
    """The runs of a design's whole base rows, and all that its page needs of them; `made` and `lost` of them at all."""

    runs: Runs
    made: int
    lost: int

    @property
    def base_rows(self) -> int:
        """How many whole base rows there are."""
        return len(self.runs.rmse_mm) // (len(NAMES) + 2)

    @cached_property
    def score(self) -> dict[str, np.ndarray]:
        """(d,) scores by method."""
        return {name: method(self.runs) for name, method in METHODS.items()}

    @cached_property
    def again(self) -> dict[str, np.ndarray]:
        """(k, d) scores by method in bootstraps."""
        return bootstrap(self.runs, BOOTSTRAPS)

    @cached_property
    def tested(self) -> pd.DataFrame:
        """The analysis of variance."""
        return anova_table(self.runs)

    @cached_property
    def acting(self) -> np.ndarray:
        """(d,) which factors act."""
        return acting_factors(self.tested, self.again[ANOVA])

    @cached_property
    def taus(self) -> dict[str, np.ndarray]:
        """(k,) by method, Kendall's tau with the analysis of variance in bootstraps, of which both are drawn anew."""
        return {name: agreement(scores, self.again[ANOVA]) for name, scores in self.again.items()}

    @cached_property
    def spread(self) -> np.ndarray:
        """(d,) coefficients of variation of the factors' levels; the larger, the lower Deng's degree tends to be."""
        levels = sequences(self.runs.unit)
        return levels.std(axis=1) / levels.mean(axis=1)

    @cached_property
    def by_spread(self) -> float:
        """Kendall's tau of Deng's degrees with the levels' smallness of spread."""
        return float(agreement(self.score["Deng"][None], -self.spread)[0])

    @cached_property
    def summary(self) -> pd.DataFrame:
        """A row for each method."""
        return _summary(self)

    @cached_property
    def factors(self) -> pd.DataFrame:
        """A row for each factor, by its share of the variance."""
        return _factors(self)

    @cached_property
    def orders(self) -> pd.DataFrame:
        """How degrees that compare steps from run to run rank the same runs in other orders."""
        return _orders(self)

    @cached_property
    def by(self) -> pd.DataFrame:
        """The summary by method."""
        return self.summary.set_index("method")

    @cached_property
    def offsets(self) -> pd.DataFrame:
        """The dummy with its levels counted from other zeros."""
        return dummy_with_offset(self.runs, self.acting, (0.0, 1.0, 10.0), BOOTSTRAPS // 2)

    @property
    def drawn(self) -> str:
        """What the bounds on the page are."""
        words = f"the middle 95 % of {BOOTSTRAPS} bootstraps of {self.base_rows} base rows"
        return words + (", which of so few is no 95 % interval" if self.base_rows < FEW else "")


def design_of(design: pd.DataFrame) -> Design | None:
    """The design in the rows of its runs; None where too few of its base rows are whole."""
    if design.empty:
        return None
    lost = design["lost"].fillna("") != ""
    found = Design(Runs.of(design[~lost]).whole(), len(design), int(lost.sum()))
    return found if found.base_rows >= FEWEST else None


def _summary(found: Design) -> pd.DataFrame:
    score, rows = found.score, []
    first = _first(score[ANOVA], max(int(found.acting.sum()), 1))
    for name in METHODS:
        above = dummy_above(found.again[name], found.acting)
        low, high = np.nanquantile(found.taus[name], [0.025, 0.975])
        own = name == ANOVA  # of a method against itself there is nothing to say
        rows.append(
            {
                "method": name,
                "tau": 1.0 if own else float(agreement(score[name][None], score[ANOVA])[0]),
                "low": 1.0 if own else float(low),
                "high": 1.0 if own else float(high),
                "tau with total Sobol": float(agreement(score[name][None], score[TOTAL])[0]),
                "of the first factors, found": f"{len(first & _first(score[name], len(first)))} of {len(first)}",
                "dummy's rank": int(places(score[name])[NAMES.index(DUMMY)]),
                "dummy above an acting factor": float((above > 0).mean()),
                "acting factors below the dummy": float(above.mean()),
            }
        )
    return pd.DataFrame(rows)


def _first(scores: np.ndarray, count: int) -> set[int]:
    return set(np.argsort(-scores)[:count].tolist())


def _factors(found: Design) -> pd.DataFrame:
    table = found.tested.copy()
    for name, key in ((ANOVA, "share"), (FIRST, "first Sobol"), (TOTAL, "total Sobol")):
        table[key] = found.score[name]
        table[f"{key}, low"], table[f"{key}, high"] = np.quantile(found.again[name], [0.025, 0.975], axis=0)
    table["Deng's degree"] = found.score["Deng"]
    return table.sort_values("share", ascending=False).reset_index(drop=True)


def _orders(found: Design) -> pd.DataFrame:
    rows = []
    for name in DISTURBED:
        here, there = degrees(name, found.runs), in_other_orders(found.runs, name, ORDERS)
        dummy = places(there)[:, NAMES.index(DUMMY)]
        row = {
            "degree": name,
            "tau, median": float(np.median(agreement(there, here))),
            "dummy's rank, least": int(dummy.min()),
            "dummy's rank, most": int(dummy.max()),
        }
        if found.acting.any():
            row["dummy above an acting factor"] = float((dummy_above(there, found.acting) > 0).mean())
        rows.append(row)
    return pd.DataFrame(rows)
