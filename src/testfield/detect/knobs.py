"""What a person may turn where detection in photographs decides otherwise than wanted, beside the smallest diameter."""

from dataclasses import dataclass

LARGEST_PX = 210.0
ALIKE, NONE, ALL = "alike", "none", "all"
UNCLEAR = (ALIKE, NONE, ALL)
"""What becomes of dots so small or so blurred that pixels do not tell them from squares: they are measured where most
of their neighbours are alike; never; or always."""
AUTO_LINES, ALL_LINES, EVEN_LINES = "auto", "all", "even"
LINES = (AUTO_LINES, ALL_LINES, EVEN_LINES)
"""Which lines of an image count: the even ones where the odd ones are shifted against them, as interlaced video has it;
all of them; the even ones."""


@dataclass(frozen=True)
class Knobs:
    """`largest_px` diameter of a dot; `unclear` and `lines` as `UNCLEAR` and `LINES` say; `dense` whether dots that
    crowd each other are fitted together, `shade` whether those that a shadow's edge crosses are lit evenly first."""

    largest_px: float = LARGEST_PX
    unclear: str = ALIKE
    lines: str = AUTO_LINES
    dense: bool = True
    shade: bool = True


DEFAULT = Knobs()
