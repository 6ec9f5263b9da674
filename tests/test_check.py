"""A check says pass, fail, open, or that no limit was stated."""

import json

import numpy as np
import pytest

from testfield.errors import TestfieldError
from testfield.evaluate.check import Check, Limit, Outcome, all_passed, table


@pytest.mark.parametrize(
    ("value", "interval", "limit", "outcome"),
    [
        (1.0, None, Limit(most=1.0), Outcome.PASS),
        (1.1, None, Limit(most=1.0), Outcome.FAIL),
        (np.nan, None, Limit(most=1.0), Outcome.FAIL),
        (0.95, None, Limit(least=0.9), Outcome.PASS),
        (1.0, (0.95, 1.05), Limit(0.9, 1.1), Outcome.PASS),
        (1.0, (0.85, 1.15), Limit(0.9, 1.1), Outcome.OPEN),
        (1.05, (0.95, 1.15), Limit(0.9, 1.1), Outcome.OPEN),
        (1.2, (1.15, 1.25), Limit(0.9, 1.1), Outcome.FAIL),
        (np.nan, (np.nan, np.nan), Limit(0.9, 1.1), Outcome.FAIL),
        (1.0, (-np.inf, np.inf), Limit(0.9, 1.1), Outcome.OPEN),
        (5.0, None, None, Outcome.NONE_STATED),
    ],
)
def test_the_outcome_is_that_of_the_interval(
    value: float, interval: tuple[float, float] | None, limit: Limit | None, outcome: Outcome
) -> None:
    assert Check(name="figure", value=value, interval=interval, limit=limit).outcome is outcome


def test_a_limit_that_nothing_keeps_is_refused() -> None:
    with pytest.raises(TestfieldError, match="no value lies"):
        Limit(least=2, most=1)


def test_checks_pass_together_where_none_failed_or_is_open() -> None:
    good, unasked = Check(name="a", value=1, limit=Limit(most=2)), Check(name="b", value=9)
    unsure = Check(name="c", value=1, interval=(0, 3), limit=Limit(most=2))
    assert all_passed([good, unasked]) and not all_passed([good, unsure])


def test_a_check_is_json_without_infinities() -> None:
    check = Check(
        name="rms", value=np.float64(0.1), interval=(-np.inf, 0.2), limit=Limit(most=0.3), unit="px", how="so"
    )
    row = json.loads(json.dumps(check.row(), allow_nan=False))
    assert row == {
        "name": "rms",
        "value": 0.1,
        "low": None,
        "high": 0.2,
        "least": None,
        "most": 0.3,
        "unit": "px",
        "outcome": "pass" if check.passed else "open",
        "how": "so",
    }


def test_a_table_has_a_line_a_check_with_value_interval_and_limit() -> None:
    lines = table(
        [
            Check(name="rms", value=0.1, interval=(0.05, 0.15), limit=Limit(most=0.2), unit="px"),
            Check(name="share", value=0.5, limit=Limit(0.9, 1)),
            Check(name="count", value=3),
        ]
    ).splitlines()
    assert [line.split()[0] for line in lines] == ["pass", "fail", "none"]
    assert "0.1 [0.05, 0.15] px" in lines[0] and lines[1].endswith("0.9 to 1") and table([]) == ""
