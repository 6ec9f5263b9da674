"""What commands print."""

import json
import sys
from pathlib import Path

from testfield.errors import TestfieldError


def show_warnings(warnings: list[str]) -> None:
    """Warnings go to standard error, so that standard output stays parseable."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


def jobs_of(asked: int) -> int:
    """The number of processes asked for. Raises `TestfieldError` for less than one."""
    if asked < 1:
        raise TestfieldError(f"value {asked} is less than one", "--jobs", "give 1 or more")
    return asked


def show_result(folder: Path, as_json: bool) -> None:
    """The ten figures and where the report is, or the scorecard as one JSON object."""
    from testfield.score.scorecard import load_scorecard, ten_figures

    card = load_scorecard(folder / "scorecard.json")
    if as_json:
        print(json.dumps(card, indent=1, allow_nan=False))
        return
    rows = ten_figures(card)
    width = max(len(title) for title, _ in rows)
    print()
    for title, value in rows:
        print(f"  {title:<{width}}  {value}")
    print(f"\n  report     {folder / 'report.html'}\n  scorecard  {folder / 'scorecard.json'}")
