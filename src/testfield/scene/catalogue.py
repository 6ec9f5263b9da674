"""What comes along by name: boards by makers' published dimensions, camera bodies, lights, each with its source."""

import tomllib
from functools import cache
from pathlib import Path
from typing import Any

from testfield.store.text import read_text

FOLDER = Path(__file__).parents[1] / "catalogue"
LISTS = ("boards", "cameras", "lights")


@cache
def catalogue(kind: str) -> dict[str, dict[str, Any]]:
    """All entries of one of `LISTS` by name: `what` it is, its `source`, whether that was `verified`, and the `fields`
    that a scene takes from it."""
    return tomllib.loads(read_text(FOLDER / f"{kind}.toml"))
