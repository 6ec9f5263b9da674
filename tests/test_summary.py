"""A check in words: whatever an algorithm says, machines can read what is said of it."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from testfield.evaluate.regress.check import by_weight
from testfield.evaluate.regress.suite import Figure
from testfield.evaluate.regress.summary import write_junit
from testfield.evaluate.regress.verdict import judged


def test_what_weighs_most_comes_first_also_where_anything_at_all_matters() -> None:
    base, level = np.zeros(8), np.linspace(1, 1.1, 8)
    grown = judged("a", "r", Figure("missed", 5.0, percent=True), base, np.ones(8), 0.01)
    twice = judged("a", "r", Figure("rms", 5.0, percent=True), level, 2 * level, 0.01)
    assert [one.figure.key for one in by_weight([twice, grown])] == ["missed", "rms"]


def test_junit_can_be_read_whatever_an_algorithm_said(tmp_path: Path) -> None:
    said = "\x1b[31mbroken\x1b[0m \x00 & <\ud800> µ"
    one = judged("a", "r", Figure("rms", 1.0), np.ones(4), np.full(4, np.nan), 0.01, why=said)
    write_junit([one], "own", tmp_path / "junit.xml")
    (failure,) = ElementTree.parse(tmp_path / "junit.xml").iter("failure")
    assert "?[31mbroken?[0m ? & <?> µ" in failure.get("message", "")
