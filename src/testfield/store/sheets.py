"""Reading JSON and Parquet that somebody may have damaged: types, names, shapes and finiteness, once, at the door.

Everything here raises `ValueError` that says which part is wrong; `errors.speaking` adds the file's name to it.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from testfield.store.text import read_text

FORMAT = 1
"""The version that is written into files; files from before there was one are of version 1."""

Finite = Annotated[float, Field(allow_inf_nan=False)]
Size = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=0, le=2**53)]
Code = Annotated[int, Field(ge=-(2**53), le=2**53)]
LARGEST_MM = 1e9
ROUNDING = 1e-6
"""Part by which numbers of a covariance may differ from exact ones, since files round them."""


class Sheet(BaseModel):
    """A table of a JSON file that holds these fields and no others."""

    model_config = ConfigDict(extra="forbid", strict=False)


class OpenSheet(BaseModel):
    """A table of a JSON file that may hold more than these fields."""

    model_config = ConfigDict(extra="allow")


Model = TypeVar("Model", bound=BaseModel)


def read_json(path: Path) -> dict[str, Any]:
    """The table in a JSON file of a version that this program knows."""
    data = json.loads(read_text(path))
    if not isinstance(data, dict):
        raise ValueError("no table")
    version = data.pop("format", FORMAT)
    if version not in range(1, FORMAT + 1):
        raise ValueError(f"format {version!r} is not known, only {FORMAT}")
    return data


def checked(model: type[Model], data: Any) -> Model:
    """A table as its model."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"{place}: {first['msg'][0].lower()}{first['msg'][1:]}") from error


def array(value: Any, name: str, *shape: int | None, kind: type = float) -> np.ndarray:
    """A finite array of a shape, None for any length. An empty list is an array of nothing."""
    try:
        found = np.asarray(value if len(value) else np.zeros([n or 0 for n in shape]))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} is no regular list of numbers") from error
    if found.dtype.kind not in "iuf" or (kind is int and found.dtype.kind == "f" and found.size):
        raise ValueError(f"{name} holds what is no {'whole ' if kind is int else ''}number")
    if found.ndim != len(shape) or any(want not in (None, n) for want, n in zip(shape, found.shape, strict=True)):
        raise ValueError(
            f"{name} is of shape {list(found.shape)} instead of {['n' if n is None else n for n in shape]}"
        )
    found = found.astype(kind)
    if not np.isfinite(found).all():
        raise ValueError(f"{name} holds what is not finite")
    return found


def covariance(value: Any, name: str, size: int) -> np.ndarray:
    """A covariance (size, size): finite, symmetric, positive semidefinite to rounding."""
    found = array(value, name, size, size)
    if size and (np.diag(found).min() < 0 or np.abs(found - found.T).max() > ROUNDING * np.abs(found).max()):
        raise ValueError(f"{name} is no covariance")
    if not semidefinite(found):
        raise ValueError(f"{name} is no covariance: it is not positive semidefinite")
    return found


def semidefinite(symmetric: np.ndarray) -> bool:
    """Whether a finite symmetric matrix (n, n) with a diagonal of zero or more has no negative eigenvalue beyond the
    rounding of numbers in a file, each unknown in units of its own uncertainty."""
    size = np.sqrt(np.diag(symmetric))
    size = np.where(size > 0, size, 1.0)
    try:
        np.linalg.cholesky(symmetric / size[:, None] / size + ROUNDING * np.eye(len(size)))
    except np.linalg.LinAlgError:
        return False
    return True


def unique(names: Any, what: str) -> None:
    """Refuse names that occur twice."""
    names = list(names)
    if len(set(names)) < len(names):
        twice = next(name for k, name in enumerate(names) if name in names[:k])
        raise ValueError(f"{what} '{twice}' occurs twice")


def notes_of(table: Any) -> dict[str, str]:
    """What goes with an Arrow table beside its columns; what is no text is read as far as it goes."""
    every = (table.schema.metadata or {}).items()
    return {k.decode(errors="replace"): v.decode(errors="replace") for k, v in every if k != b"ARROW:schema"}


def read_columns(path: Path, kinds: Mapping[str, str]) -> tuple[dict[str, Any], dict[str, str]]:
    """Columns of a Parquet file by name, and its notes. `kinds` of NumPy: "f" finite numbers, "n" numbers that may be
    NaN, "i" whole numbers, "O" lists of numbers, "?" such lists, in a column that may be missing. There may be more
    columns, each once, but no nulls in these."""
    import pyarrow.parquet as pq

    unique(pq.read_schema(path).names, "column")
    table = pq.read_table(path, columns=None)
    notes = notes_of(table)
    version = notes.get("format", str(FORMAT))
    if version not in [str(k) for k in range(1, FORMAT + 1)]:
        raise ValueError(f"format {version!r} is not known, only {FORMAT}")
    columns: dict[str, Any] = {}
    for name, kind in kinds.items():
        if kind == "?" and name not in table.column_names:
            continue
        if name not in table.column_names:
            raise ValueError(f"there is no column '{name}'")
        column = table[name]
        if column.null_count:
            raise ValueError(f"column '{name}' has nulls")
        values = column.to_numpy(zero_copy_only=False)
        if kind in "O?":
            columns[name] = [np.asarray(row, float) for row in values]
        elif kind == "n":
            columns[name] = values.astype(float)
        else:
            columns[name] = array(values, f"column '{name}'", None, kind={"f": float, "i": int}[kind])
    return columns, notes
