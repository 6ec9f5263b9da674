"""What every file for people says of itself: its format, the program that wrote it, seeds, and when.

Files whose bytes are compared between runs (FORMATS.md lists them) carry their format alone; run.json says the rest.
"""

from datetime import UTC, datetime
from typing import Any

from testfield.store.sheets import FORMAT
from testfield.version import __version__


def stamp(seed: int | None = None, noise_seed: int | None = None) -> dict[str, Any]:
    """The first keys of a JSON file: `format`, `program`, `made` (UTC) and, where there are any, `seed`,
    `noise_seed`."""
    seeds = {"seed": seed, "noise_seed": noise_seed}
    said = {"format": FORMAT, "program": f"testfield {__version__}", "made": now()}
    return said | {name: value for name, value in seeds.items() if value is not None}


def now() -> str:
    """The time in UTC to the second, as ISO 8601 writes it."""
    return datetime.now(UTC).isoformat(timespec="seconds")
