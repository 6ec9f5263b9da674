"""What commands print."""

import argparse
import json
import sys
from pathlib import Path

from testfield.cli.colour import bad, caution, judged
from testfield.errors import TestfieldError


def show_warnings(warnings: list[str]) -> None:
    """Warnings go to standard error, so that standard output stays parseable."""
    for warning in warnings:
        print(f"{caution('warning:', sys.stderr)} {warning}", file=sys.stderr)


def failures_in(path: Path) -> list[str]:
    """What a scorecard or a calibration calls failed; nothing of one from before there was a verdict."""
    from testfield.errors import speaking
    from testfield.store.sheets import read_json

    card = speaking("result")(read_json)(path)
    verdict = card.get("verdict", card)
    return [str(failure) for failure in verdict.get("failures", ())] if isinstance(verdict, dict) else []


def add_load(parser: argparse.ArgumentParser) -> None:
    """The option `--load`, which `main` has obeyed before it knew the command."""
    parser.add_argument(
        "--load",
        type=Path,
        action="append",
        default=[],
        metavar="FILE.py",
        help="a Python file of your own, whose registered algorithms are known then (OWN_ALGORITHMS.md)",
    )


def add_strict(parser: argparse.ArgumentParser) -> None:
    """The option `--strict`, in the words that all commands have for it."""
    parser.add_argument(
        "--strict",
        action="store_true",
        help="exit with status 1 where something failed: a check distance with |E_n| > 1, certificates that contradict "
        "each other with nothing to decide between them, a board or an image that loses more than its share of "
        "observations",
    )


def status_of(failures: list[str], strict: bool) -> int:
    """Say what failed, on standard error; the exit status."""
    for failure in failures:
        print(f"{bad('failed:', sys.stderr)} {failure}", file=sys.stderr)
    return 1 if failures and strict else 0


def jobs_of(asked: int) -> int:
    """The number of processes asked for. Raises `TestfieldError` for less than one."""
    if asked < 1:
        raise TestfieldError(f"value {asked} is less than one", "--jobs", "give 1 or more")
    return asked


def seed_of_option(option: str, seed: int | None) -> int | None:
    """A seed as given. Raises `TestfieldError` where it is negative."""
    if seed is not None and seed < 0:
        raise TestfieldError(f"value {seed} is negative", option, "give 0 or more")
    return seed


def show_result(folder: Path, as_json: bool) -> None:
    """The ten figures and where the report is, or the scorecard as one JSON object."""
    from testfield.score.scorecard import load_scorecard, ten_figures
    from testfield.store.sheets import FORMAT

    card = load_scorecard(folder / "scorecard.json")
    if as_json:
        print(json.dumps({"format": FORMAT} | card, indent=1, allow_nan=False))
        return
    rows = ten_figures(card)
    width = max(len(title) for title, _ in rows)
    failures = failures_in(folder / "scorecard.json")
    said = f"NOT passed: {len(failures)} failure(s)" if failures else "no failure"
    rows.append(("verdict", judged(not failures, said)))
    print()
    for title, value in rows:
        print(f"  {title:<{width}}  {value}")
    print(f"\n  report     {folder / 'report.html'}\n  scorecard  {folder / 'scorecard.json'}")
