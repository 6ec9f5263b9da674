"""A study's conclusion: a Markdown text whose paragraphs stand where findings have the outcomes that they assert.

Each paragraph follows a comment that names its findings, `<!-- gain: holds; cost: fails or open -->`, and may show the
quantities of these findings: `{rmse:.3g}` with unit and interval, `{rmse.value:.3g}` as a bare number.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from string import Formatter

from testfield.errors import TestfieldError
from testfield.store.text import read_text
from testfield.study.finding import Finding, Outcome, Quantity

MARKER = re.compile(r"<!--\s*(.*?)\s*-->", re.DOTALL)


@dataclass(frozen=True)
class Paragraph:
    """A text, and which outcomes of which findings it asserts."""

    asserted: dict[str, frozenset[Outcome]]
    text: str

    @property
    def placeholders(self) -> set[str]:
        """Names of the quantities that it shows."""
        return {name.partition(".")[0] for _, name, _, _ in Formatter().parse(self.text) if name}


def read_conclusion(path: Path) -> list[Paragraph]:
    """The paragraphs of a conclusion. Raises `TestfieldError` where a comment asserts no outcome."""
    before, *parts = MARKER.split(read_text(path))
    if before.strip():
        raise TestfieldError("a paragraph belongs to no finding", str(path), "begin it with <!-- finding: outcome -->")
    return [
        Paragraph(_asserted(marker, path), " ".join(text.split()))
        for marker, text in zip(parts[::2], parts[1::2], strict=True)
    ]


def _asserted(marker: str, path: Path) -> dict[str, frozenset[Outcome]]:
    found = {}
    for part in marker.split(";"):
        name, _, outcomes = part.partition(":")
        try:
            found[name.strip()] = frozenset(Outcome(word.strip()) for word in outcomes.split(" or "))
        except ValueError as error:
            raise TestfieldError(
                f"'{part.strip()}' asserts no outcome", str(path), f"write one of {', '.join(Outcome)} after the colon"
            ) from error
    return found


def concluded(paragraphs: list[Paragraph], findings: list[Finding]) -> list[str]:
    """The texts of those paragraphs whose findings have the outcomes that they assert, with their figures; not those of
    findings that are open for want of figures, nor those that show a quantity which was not measured.

    Raises `TestfieldError` where a paragraph names a finding or a quantity that there is not.
    """
    by_name = {finding.name: finding for finding in findings}
    texts = []
    for paragraph in paragraphs:
        shown = _quantities(paragraph, by_name)
        asserted = all(
            by_name[name].measured and by_name[name].outcome in wanted for name, wanted in paragraph.asserted.items()
        )
        if asserted and all(name in shown and shown[name].known for name in paragraph.placeholders):
            texts.append(paragraph.text.format(**shown))
    return texts


def _quantities(paragraph: Paragraph, by_name: dict[str, Finding]) -> dict[str, Quantity]:
    """The quantities of a paragraph's findings by name, those named first before others of the same name."""
    shown: dict[str, Quantity] = {}
    for name in paragraph.asserted:
        if name not in by_name:
            raise TestfieldError(f"no finding is called '{name}'", "conclusion", f"there are {', '.join(by_name)}")
        shown = by_name[name].quantities | shown
    unknown = paragraph.placeholders - set(shown)
    if unknown and all(by_name[name].quantities for name in paragraph.asserted):
        raise TestfieldError(
            f"no quantity of {', '.join(paragraph.asserted)} is called '{min(unknown)}'",
            "conclusion",
            f"there are {', '.join(shown)}",
        )
    return shown
