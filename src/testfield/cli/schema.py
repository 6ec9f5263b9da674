"""`testfield schema`: the JSON Schema of scene files."""

import argparse
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("schema", help="the JSON Schema of scene files, for editors", description=__doc__)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Print it."""
    import json

    from testfield.scene.load import scene_schema

    print(json.dumps(scene_schema(), indent=2))
    return 0
