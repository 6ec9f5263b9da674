"""`testfield list`: the algorithms, by stage, and the sensors that have presets."""

import argparse
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("list", help="the algorithms that can be chosen, by stage", description=__doc__)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Print name and first sentence of each."""
    from testfield.registry import KINDS, find, names
    from testfield.sensor.presets import presets

    for stage in KINDS:
        print(stage)
        for name in names(stage):
            text = (find(stage, name).__doc__ or "").strip().split("\n")[0]
            print(f"  {name:<16} {text}")
    print("sensors (sensor.preset)")
    for name, figures in presets().items():
        doubt = "" if figures["verified"] else " (not verified)"
        print(f"  {name:<16} {figures['description']}{doubt}")
        print(f"  {'':<16} {figures['source']}")
    return 0
