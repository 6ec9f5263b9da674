"""Every section of the methods that a docstring names is there."""

import re
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src/testfield"


def test_sections_that_are_cited_exist() -> None:
    there = set(re.findall(r"^(?:## |\*\*)(\d(?:\.\d)?)", (SOURCE / "METHODS.md").read_text(), re.MULTILINE))
    cited = {
        (path.name, section)
        for path in SOURCE.rglob("*.py")
        for words in re.findall(r"METHODS,?(?: sections?)?((?: (?:\d(?:\.\d)?|and|to))+)", path.read_text())
        for section in re.findall(r"\d(?:\.\d)?", words)
    }
    assert len(cited) > 20
    assert not {(name, section) for name, section in cited if section.rstrip(".") not in there}
