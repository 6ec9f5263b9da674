"""Colour for verdicts, where a terminal shows it and nobody has said no (NO_COLOR, https://no-color.org)."""

import os
import sys
from typing import TextIO

GREEN, RED, YELLOW = "32", "31", "33"


def good(text: str, stream: TextIO | None = None) -> str:
    """A verdict that is as it should be."""
    return _coloured(text, GREEN, stream)


def bad(text: str, stream: TextIO | None = None) -> str:
    """A verdict that is not."""
    return _coloured(text, RED, stream)


def caution(text: str, stream: TextIO | None = None) -> str:
    """What is neither, and should be read."""
    return _coloured(text, YELLOW, stream)


def judged(passed: bool, text: str, stream: TextIO | None = None) -> str:
    """A verdict in the colour that it deserves."""
    return good(text, stream) if passed else bad(text, stream)


def _coloured(text: str, colour: str, stream: TextIO | None) -> str:
    shown = sys.stdout if stream is None else stream
    plain = not shown.isatty() or os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb"
    return text if plain else f"\x1b[{colour}m{text}\x1b[0m"
