"""The self-test as a table, for the terminal and in Markdown."""

from collections.abc import Sequence
from pathlib import Path

from testfield.evaluate.regress.selftest import Outcome
from testfield.evaluate.regress.simulation import Alarms
from testfield.store.atomic import whole
from testfield.store.text import write_text

WIDTHS = (48, 10, 6)
SHOWN = 3


def header() -> str:
    """The heads of the columns."""
    return _line("planted", "outcome", "draws", "found by (times what matters)")


def row(one: Outcome) -> str:
    """A line of the table."""
    return _line(one.title, one.status, str(one.draws), _by(one))


def alarms_line(one: Alarms) -> str:
    """What a simulation says."""
    return (
        f"simulated, {one.shape}: {one.alarms} of {one.checks} checks of unchanged code raise an alarm "
        f"({one.alarms / one.checks:.2%}; stated {one.error_rate:.2%} at most)"
    )


def write_table(outcomes: Sequence[Outcome], simulations: Sequence[Alarms], path: Path) -> Path:
    """Write the table; of unchanged code under other noise one row says how many raised an alarm."""
    other = [one for one in outcomes if not one.planted and one.title[-1].isdigit()]
    lines = ["# Self-test of the regression suite", "", "| planted | outcome | draws | found by (times what matters) |"]
    lines += ["|---|---|---|---|"]
    lines += [f"| {one.title} | {one.status} | {one.draws} | {_by(one)} |" for one in outcomes if one not in other]
    lines += [
        "",
        f"Alarms in {len(other)} checks of unchanged code under other noise: {sum(not o.as_it_should for o in other)}.",
    ]
    lines += ["", *(f"- {alarms_line(one)}" for one in simulations)]
    with whole(path) as part:
        write_text(part, "\n".join(lines) + "\n")
    return path


def _by(one: Outcome) -> str:
    named = [
        f"{finding.figure.key} ({finding.weight:.1f})"
        if finding.difference.draws
        else f"{finding.figure.key} (missing)"
        for finding in one.by[:SHOWN]
    ]
    more = len(one.by) - SHOWN
    return ", ".join(named) + (f" and {more} more" if more > 0 else "")


def _line(*cells: str) -> str:
    return "  ".join([*(f"{cell:<{width}}" for cell, width in zip(cells, WIDTHS, strict=False)), *cells[len(WIDTHS) :]])
