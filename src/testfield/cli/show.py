"""What commands print."""

import json
import sys
from pathlib import Path


def show_warnings(warnings: list[str]) -> None:
    """Warnings go to standard error, so that standard output stays parseable."""
    for warning in warnings:
        print(f"warning: {warning}", file=sys.stderr)


def show_result(folder: Path, as_json: bool) -> None:
    """The ten figures and where the report is, or the scorecard as one JSON object."""
    from testfield.score.scorecard import ten_figures

    text = (folder / "scorecard.json").read_text()
    if as_json:
        print(text)
        return
    rows = ten_figures(json.loads(text))
    width = max(len(title) for title, _ in rows)
    print()
    for title, value in rows:
        print(f"  {title:<{width}}  {value}")
    print(f"\n  report     {folder / 'report.html'}\n  scorecard  {folder / 'scorecard.json'}")
