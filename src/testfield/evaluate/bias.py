"""Bias and spread apart: what stays of an error over the draws of noise, and what changes."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pandas as pd

CORNERS = 4
"""The first places of the camera's columns are the image's corners."""
CELLS = 12
"""Columns of cells over the image, in which errors of centres are averaged."""
LEAST_IN_CELL = 3
LENGTH_BINS = 8
UM = 1000.0


def bias_table(rows: pd.DataFrame, recipes: Iterable[str]) -> pd.DataFrame:
    """Of each recipe and each kind of error `bias` and `spread` with their unit, root mean squares over all items of
    all setups, of `items` that were measured in every draw."""
    found = []
    for name in recipes:
        own = rows[rows.recipe == name]
        for what, unit, errors in KINDS:
            bias, spread, items = bias_and_spread(own, errors)
            found.append({"recipe": name, "error": what, "unit": unit, "bias": bias, "spread": spread, "items": items})
    return pd.DataFrame(found)


def bias_and_spread(rows: pd.DataFrame, errors: Callable[[Any], pd.DataFrame]) -> tuple[float, float, int]:
    """Bias and spread of one recipe's rows, where `errors` makes a table of a row, one line an item, one column a
    component; and the number of items. With one draw nothing can be told apart."""
    means, variances = [], []
    for _, setup in rows.groupby([name for name in ("scene", "factor", "level") if name in rows]):
        tables = [errors(row) for row in setup.itertuples()]
        tables = [table for table in tables if len(table)]
        if len(tables) < 2:
            continue
        values = pd.concat(tables, axis=1, join="inner").to_numpy(float).reshape(-1, len(tables), tables[0].shape[1])
        spread = values.var(axis=1, ddof=1)
        # The mean of n draws still has an n-th of their variance.
        means.append(values.mean(axis=1) ** 2 - spread / len(tables))
        variances.append(spread)
    if not sum(map(len, means)):
        return np.nan, np.nan, 0
    bias, spread = (float(np.sqrt(max(np.concatenate(v).mean(), 0.0))) for v in (means, variances))
    return bias, spread, sum(map(len, means))


def centre_errors(row: Any) -> pd.DataFrame:
    """The errors in px of a row's centres by image and mark, each once."""
    if _absent(row, "dx_px"):
        return pd.DataFrame()
    table = pd.DataFrame({"x": row.dx_px, "y": row.dy_px}, index=pd.MultiIndex.from_arrays([row.station, row.mark]))
    return table[~table.index.duplicated()]


def corner_errors(row: Any) -> pd.DataFrame:
    """The errors in px of the found camera at the corners of the image."""
    return _camera(row).iloc[:CORNERS]


def camera_errors(row: Any) -> pd.DataFrame:
    """The same over a grid."""
    return _camera(row).iloc[CORNERS:]


def point_errors(row: Any) -> pd.DataFrame:
    """The errors in um of a row's check points by code."""
    if _absent(row, "point_code"):
        return pd.DataFrame()
    values = {axis: UM * np.asarray(getattr(row, f"point_{axis}_mm"), float) for axis in "xyz"}
    table = pd.DataFrame(values, index=np.asarray(row.point_code))
    return table[~table.index.duplicated()]


def length_errors(row: Any) -> pd.DataFrame:
    """The errors in um of a row's lengths, by the length in um."""
    if _absent(row, "length_mm"):
        return pd.DataFrame()
    index = np.round(UM * np.asarray(row.length_mm, float)).astype(np.int64)
    table = pd.DataFrame({"length": UM * np.asarray(row.length_error_mm, float)}, index=index)
    return table[~table.index.duplicated()]


KINDS: tuple[tuple[str, str, Callable[[Any], pd.DataFrame]], ...] = (
    ("centres", "px", centre_errors),
    ("camera, corners of the image", "px", corner_errors),
    ("camera, over the image", "px", camera_errors),
    ("check points", "um", point_errors),
    ("lengths", "um", length_errors),
)


def centre_map(rows: pd.DataFrame, size_px: tuple[float, float]) -> pd.DataFrame:
    """Mean error of one recipe's centres in cells of an image of `size_px`: `x`, `y`, `dx`, `dy`, `count`."""
    with_centres = rows[[not _absent(row, "dx_px") for row in rows.itertuples()]]
    if not len(with_centres):
        return pd.DataFrame(columns=["x", "y", "dx", "dy", "count"])
    x, y, dx, dy = (np.concatenate(with_centres[name].to_list()) for name in ("x_px", "y_px", "dx_px", "dy_px"))
    cell = size_px[0] / CELLS
    table = pd.DataFrame({"column": x // cell, "row": y // cell, "dx": dx, "dy": dy})
    found = (
        table.groupby(["column", "row"]).agg(dx=("dx", "mean"), dy=("dy", "mean"), count=("dx", "size")).reset_index()
    )
    found = found[found["count"] >= LEAST_IN_CELL]
    places = {"x": (found["column"] + 0.5) * cell, "y": (found["row"] + 0.5) * cell}
    return found.assign(**places)[["x", "y", "dx", "dy", "count"]].reset_index(drop=True)


def camera_map(rows: pd.DataFrame, size_px: tuple[float, float]) -> pd.DataFrame:
    """Mean error of one recipe's camera at places of the image, within `size_px`: `x`, `y`, `dx`, `dy`, `count`."""
    tables = [
        pd.DataFrame({"x": row.camera_x_px, "y": row.camera_y_px, "dx": row.camera_dx_px, "dy": row.camera_dy_px})
        for row in rows.itertuples()
        if not _absent(row, "camera_dx_px")
    ]
    if not tables:
        return pd.DataFrame(columns=["x", "y", "dx", "dy", "count"])
    grouped = pd.concat(tables).groupby(["x", "y"])
    found = grouped.agg(dx=("dx", "mean"), dy=("dy", "mean"), count=("dx", "size")).reset_index()
    return found[(found.x <= size_px[0]) & (found.y <= size_px[1])]


def length_curve(rows: pd.DataFrame) -> pd.DataFrame:
    """One recipe's length errors in um over length: bins of as many lengths each, with `length_mm`, `mean`, `rms`,
    `count`."""
    with_lengths = rows[[not _absent(row, "length_mm") for row in rows.itertuples()]]
    lengths = [np.asarray(values, float) for values in with_lengths.get("length_mm", [])]
    if not sum(map(len, lengths)):
        return pd.DataFrame(columns=["length_mm", "mean", "rms", "count"])
    length = np.concatenate(lengths)
    error = UM * np.concatenate([np.asarray(values, float) for values in with_lengths.length_error_mm])
    order = np.argsort(length, kind="stable")
    parts = [part for part in np.array_split(order, LENGTH_BINS) if len(part)]
    return pd.DataFrame(
        {
            "length_mm": [length[part].mean() for part in parts],
            "mean": [error[part].mean() for part in parts],
            "rms": [np.sqrt((error[part] ** 2).mean()) for part in parts],
            "count": [len(part) for part in parts],
        }
    )


def _camera(row: Any) -> pd.DataFrame:
    if _absent(row, "camera_dx_px"):
        return pd.DataFrame()
    return pd.DataFrame({"x": row.camera_dx_px, "y": row.camera_dy_px})


def _absent(row: Any, name: str) -> bool:
    """Whether a row has no such list: a recipe that failed has none."""
    value = getattr(row, name, None)
    return value is None or isinstance(value, float)
