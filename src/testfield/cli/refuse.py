"""Options that were given where they mean nothing: an error, not silence."""

import argparse
from collections.abc import Mapping
from typing import Any

OF_DOTS: dict[str, Any] = {"largest_px": None, "unclear": None, "lines": None, "dense": True, "shade": True}
"""What turns the detection of dots (`knobs.py`), with what stands there where nobody gave it."""
NAMES = {"polarity": "--white-on-black or --black-on-white", "dense": "--no-dense", "shade": "--no-shade"}
"""How options are written whose name is not theirs."""


def refuse(args: argparse.Namespace, what: str, options: Mapping[str, Any]) -> None:
    """Refuse `options` (with their defaults) that were given and mean nothing for `what`. Raises `TestfieldError` that
    names the first."""
    from testfield.errors import TestfieldError

    for option, default in options.items():
        if getattr(args, option) != default:
            name = NAMES.get(option, f"--{option.replace('_', '-')}")
            raise TestfieldError(f"this option does not apply to {what}", name, "leave it out")
