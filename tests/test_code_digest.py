"""Keys of kept results hash what code does, not how it is written."""

import pytest

from testfield.store.code import what_it_does

SOURCE = b'''
"""What it is."""
import math
from pathlib import Path

LIMIT_MM = 2.5
"""Its reason."""


class Settings:
    """Settings."""

    steps: int = 3


def f(x: float, y: float = 2.0) -> float:
    """Halve."""
    half: float = x / 2  # why
    return math.sqrt(half + y) if half > LIMIT_MM else g(half)
'''


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"What it is.", b"What it is, said better."),
        (b"Halve.", b"Halve,\n    and say so."),
        (b'"""Its reason."""\n', b""),
        (b'    """Settings."""\n', b""),
        (b"  # why", b""),
        (b"x / 2", b"(x /\n        2)"),
        (b"-> float", b"-> 'int'"),
        (b"x: float", b"x"),
        (b"half: float =", b"half ="),
        (b"import math\nfrom pathlib import Path\n", b"from pathlib import Path\nimport math\n"),
    ],
)
def test_docstrings_comments_annotations_layout_and_the_order_of_imports_do_not_count(old: bytes, new: bytes) -> None:
    edited = SOURCE.replace(old, new)
    assert edited != SOURCE and what_it_does(edited) == what_it_does(SOURCE)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"2.5", b"2.6"),
        (b"x / 2", b"x * 2"),
        (b"y: float = 2.0", b"y: float = 2.1"),
        (b"math.sqrt", b"math.cbrt"),
        (b"g(half)", b"g(x)"),
        (b"half > LIMIT", b"half >= LIMIT"),
        (b"half + y", b"y + half"),
        (b"steps: int", b"steps: float"),
        (b"steps: int = 3", b"steps: int"),
        (b"import Path", b"import PurePath"),
        (b"return ", b""),
    ],
)
def test_constants_operators_defaults_calls_fields_and_names_count(old: bytes, new: bytes) -> None:
    edited = SOURCE.replace(old, new)
    assert edited != SOURCE and what_it_does(edited) != what_it_does(SOURCE)


def test_a_docstring_counts_where_the_code_reads_it() -> None:
    reads = SOURCE + b"\nprint(__doc__)\n"
    assert what_it_does(reads) != what_it_does(reads.replace(b"What it is.", b"What it was."))
