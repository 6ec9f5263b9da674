"""TOML that a person or a program wrote: read within bounds, so that no number or nesting can fill the memory."""

import tomllib
from pathlib import Path
from typing import Any

from testfield.errors import TestfieldError
from testfield.store.text import decoded

LARGEST_FILE_BYTES = 10_000_000
DEEPEST = 20
LONGEST_TEXT = 10_000
LONGEST_LIST = 100_000
LARGEST = 1e9
"""No length in mm, no radiance and no count of a scene is larger."""
LARGEST_SEED = 2**63 - 1


def read_toml(path: Path, what: str) -> bytes:
    """The bytes of a TOML file. Raises `TestfieldError`, which calls it a `what`, where there is none to be read."""
    try:
        if not path.is_file() and path.exists():
            kind = "a folder" if path.is_dir() else "no file"
            raise TestfieldError(f"this is {kind}", str(path), f"name a {what}")
        size = path.stat().st_size
        if size > LARGEST_FILE_BYTES:
            raise TestfieldError(
                f"this {what} has {size} bytes, and {LARGEST_FILE_BYTES} are allowed", str(path), "make it smaller"
            )
        return path.read_bytes()
    except FileNotFoundError as error:
        raise TestfieldError(f"no such {what}", str(path), "check the path") from error
    except OSError as error:
        raise TestfieldError(f"cannot be read ({error.strerror})", str(path)[:300], "check the path") from error


def toml_or_nothing(path: Path) -> dict[str, Any]:
    """The document in a TOML file, to see of what kind it is; nothing where it is none."""
    try:
        return parse_toml(read_toml(path, "file"), str(path))
    except TestfieldError:
        return {}


def parse_toml(content: bytes | str, source: str) -> dict[str, Any]:
    """The document in a TOML text. Raises `TestfieldError` where it is none, or holds what is beyond all bounds."""
    try:
        text = content if isinstance(content, str) else decoded(content)
    except UnicodeDecodeError as error:
        raise TestfieldError("this is not a text file", source, "a TOML file is wanted, in UTF-8") from error
    try:
        data = tomllib.loads(text)
    except RecursionError as error:
        raise TestfieldError(f"nested more than {DEEPEST} levels deep", source, "a scene is flatter") from error
    except ValueError as error:  # of numbers with thousands of digits, not only of what is no TOML
        raise TestfieldError(f"not valid TOML ({' '.join(str(error).split())[:200]})", source) from error
    _within_bounds(data, source)
    return data


def _within_bounds(data: Any, source: str) -> None:
    left: list[tuple[str, str, int, Any]] = [("", "", 0, data)]
    while left:
        place, key, depth, value = left.pop()
        where = f"{source}, {place}"[:400]
        if depth > DEEPEST:
            raise TestfieldError(f"nested more than {DEEPEST} levels deep", where, "a scene is flatter")
        if isinstance(value, (dict, list)) and len(value) > LONGEST_LIST:
            raise TestfieldError(f"a list of {len(value)}, and {LONGEST_LIST} are allowed", where, "shorten it")
        if isinstance(value, str) and len(value) > LONGEST_TEXT:
            raise TestfieldError(
                f"a text of {len(value)} characters, and {LONGEST_TEXT} are allowed", where, "shorten it"
            )
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            most = LARGEST_SEED if key in ("seed", "noise_seed") else LARGEST
            # Infinity and what is no number are left to the field, which says that it must be finite.
            if abs(value) > most and value not in (float("inf"), float("-inf")):
                raise TestfieldError(f"value {value:.4g} is beyond {most:.4g}, the largest there is", where, "lower it")
        if isinstance(value, dict):
            left += [(f"{place}.{k}" if place else k, k, depth + 1, v) for k, v in reversed(value.items())]
        elif isinstance(value, list):
            left += [(f"{place}[{k}]", key, depth + 1, v) for k, v in reversed(list(enumerate(value)))]
