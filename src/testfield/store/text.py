"""Text is UTF-8, whatever the locale says."""

import sys
from io import TextIOWrapper
from pathlib import Path


def read_text(path: Path) -> str:
    """A file's text. Raises `UnicodeDecodeError`, a `ValueError`, where it is not UTF-8."""
    return path.read_text(encoding="utf-8-sig")  # editors on Windows begin files with a byte-order mark


def decoded(content: bytes) -> str:
    """A file's bytes as text, with the ends of lines of any system. Raises as `read_text` does."""
    return content.decode("utf-8-sig").replace("\r\n", "\n")


def write_text(path: Path, text: str) -> None:
    """Write a text. File names may hold bytes that are no text; they are written as escapes."""
    path.write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")


def speak_in_any_locale() -> None:
    """From now on, what standard output and error cannot show in the locale's encoding is printed as escapes."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
