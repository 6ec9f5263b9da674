"""The packages of the extra `cluster`, which everything else works without."""

import logging
from importlib import import_module
from types import ModuleType

from testfield.errors import TestfieldError


def needed(module: str) -> ModuleType:
    """A module of the extra. Raises `TestfieldError` where it is not installed."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0].startswith("testfield"):
            raise
        raise TestfieldError(
            f"clusters need the package '{error.name.partition('.')[0]}', which is missing",
            "",
            "install the extra 'cluster': pip install 'testfield[cluster]'",
        ) from error


def silence() -> None:
    """Have Dask keep quiet: it speaks of every connection that ends, and what matters of it is said in a sentence."""
    for name in (name for name in logging.root.manager.loggerDict if name.partition(".")[0] in CHATTY):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)


CHATTY = ("distributed", "tornado", "asyncio")
