"""Compare every figure of two folders of runs: `scorecards.py BEFORE AFTER`, to one part in 1e9.

Made once before a rebuilding and once after it, by the same command: `testfield run NAME --out FOLDER/NAME`.
"""

import json
import math
import sys
from pathlib import Path
from typing import Any

SAME = 1e-9
NOT_COMPARED = ("time_s", "program", "made", "format", "seed")
"""What says when, how long and by which program."""


def figures(card: Any, place: str = "") -> dict[str, float]:
    """All numbers of a scorecard by their dotted place."""
    if isinstance(card, dict):
        parts = [(f"{place}.{key}" if place else key, value) for key, value in card.items() if key not in NOT_COMPARED]
    elif isinstance(card, list):
        parts = [(f"{place}.{k}", value) for k, value in enumerate(card)]
    else:
        number = isinstance(card, (int, float)) and not isinstance(card, bool)
        return {place: float(card)} if number else {}
    return {name: value for key, part in parts for name, value in figures(part, key).items()}


def compare(before: Path, after: Path) -> int:
    """Print what differs; returns in how many scenes anything does."""
    differ = 0
    for path in sorted(after.glob("*/scorecard.json")):
        scene = path.parent.name
        old = figures(json.loads((before / scene / "scorecard.json").read_text()))
        new = figures(json.loads(path.read_text()))
        off = {
            name: (old[name], new.get(name, math.nan))
            for name in old
            if not math.isclose(old[name], new.get(name, math.nan), rel_tol=SAME, abs_tol=1e-15)
        }
        differ += bool(off)
        print(f"{scene:<30} {len(old):>5} figures, {len(off)} differ")
        for name, (a, b) in list(off.items())[:10]:
            print(f"    {name}: {a!r} {b!r}")
    return differ


if __name__ == "__main__":
    sys.exit(min(compare(Path(sys.argv[1]), Path(sys.argv[2])), 1))
