"""`testfield list`: the algorithms, by stage."""

import argparse
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("list", help="the algorithms that can be chosen, by stage", description=__doc__)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Print name and first sentence of each."""
    from testfield.registry import STAGES, find, names

    for stage in STAGES:
        print(stage)
        for name in names(stage):
            text = (find(stage, name).__doc__ or "").strip().split("\n")[0]
            print(f"  {name:<16} {text}")
    return 0
