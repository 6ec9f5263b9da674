"""Digests of files and of values."""

import hashlib
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np


def file_digest(path: Path) -> str:
    """SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest(*things: Any) -> str:
    """SHA-256 of values: numbers, texts, arrays, dataclasses and containers of them."""
    state = hashlib.sha256()
    for thing in things:
        _feed(state, thing)
    return state.hexdigest()


def _feed(state: Any, thing: Any) -> None:
    if isinstance(thing, np.ndarray):
        state.update(f"{thing.dtype}{thing.shape}".encode())
        state.update(repr(thing.tolist()).encode() if thing.dtype == object else np.ascontiguousarray(thing).tobytes())
    elif is_dataclass(thing) and not isinstance(thing, type):
        state.update(type(thing).__name__.encode())
        for field in fields(thing):
            _feed(state, getattr(thing, field.name))
    elif isinstance(thing, (list, tuple)):
        state.update(f"{len(thing)}(".encode())
        for item in thing:
            _feed(state, item)
    elif isinstance(thing, dict):
        _feed(state, sorted(thing.items()))
    else:
        state.update(f"{type(thing).__name__}:{thing!r};".encode())
