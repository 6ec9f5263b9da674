"""Quantities of findings out of the rows of tables."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.study.finding import Quantity


def row_of(frame: pd.DataFrame, **where: Any) -> pd.Series:
    """The first row where all conditions hold; NaN in every column where there is none."""
    for name, value in where.items():
        frame = frame[frame[name] == value]
    return frame.iloc[0] if len(frame) else pd.Series(np.nan, index=frame.columns)


def of(row: pd.Series, column: str, unit: str = "", ends: tuple[str, str] | None = None) -> Quantity:
    """One column of a row, its interval from the columns `ends`."""
    low, high = (float(row[end]) for end in ends) if ends else (np.nan, np.nan)
    return Quantity(float(row[column]), low, high, unit)


def interval_of(row: pd.Series, column: str, unit: str = "") -> Quantity:
    """One column of a row with the interval that stands beside it."""
    return of(row, column, unit, (f"{column}_low", f"{column}_high"))


def median(row: pd.Series, unit: str = "") -> Quantity:
    """The median of a row with its interval."""
    return of(row, "median", unit, ("low", "high"))


def three(values: tuple[float, float, float], unit: str = "") -> Quantity:
    """A value and the ends of its interval."""
    value, low, high = (float(v) for v in values)
    return Quantity(value, low, high, unit)
