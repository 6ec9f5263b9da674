"""Options of whatever detects dots in photographs: what is decided by default may be turned."""

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from testfield.detect.knobs import Knobs


def add_knobs(p: argparse.ArgumentParser) -> None:
    """Enter them."""
    p.add_argument("--largest-px", type=float, metavar="PX", help="largest diameter of a dot (default: 210)")
    p.add_argument(
        "--unclear",
        choices=("alike", "none", "all"),
        help="dots so small or so blurred that pixels do not tell them from squares: measured where most of their "
        "neighbours are alike (default), never, or always",
    )
    p.add_argument(
        "--lines",
        choices=("auto", "all", "even"),
        help="which lines of an image count: the even ones where the odd ones are shifted, as interlaced video has it "
        "(default), all, or the even ones",
    )
    p.add_argument(
        "--no-dense",
        dest="dense",
        action="store_false",
        help="leave out dots that crowd each other, not fit them together",
    )
    p.add_argument(
        "--no-shade", dest="shade", action="store_false", help="take dots that a shadow's edge crosses as they are"
    )


def knobs_of(args: argparse.Namespace, smallest_px: float) -> "Knobs":
    """As they were given. Raises `TestfieldError` for what cannot be."""
    from testfield.detect.knobs import DEFAULT, Knobs
    from testfield.errors import TestfieldError

    largest = DEFAULT.largest_px if args.largest_px is None else args.largest_px
    if not smallest_px < largest <= 2000:
        raise TestfieldError(f"value {largest:g}", "--largest-px", f"give more than {smallest_px:g}, up to 2000")
    return Knobs(largest, args.unclear or DEFAULT.unclear, args.lines or DEFAULT.lines, args.dense, args.shade)
