"""`testfield new algorithm NAME --kind KIND`: a skeleton of an algorithm of your own, that runs as it is."""

import argparse
from pathlib import Path
from typing import Any

KINDS = ("finder", "centroid", "decoder", "detector", "calibrator", "reconstructor", "program")


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "new",
        help="a skeleton of an algorithm of your own, and the recipe that uses it",
        description="Writes NAME.py, which runs as it is, and NAME.toml, a recipe for `testfield compare --recipes`. "
        "What each kind is given and gives back says OWN_ALGORITHMS.md.",
    )
    p.add_argument("what", choices=("algorithm",), metavar="algorithm", help="what is made: algorithm")
    p.add_argument("name", metavar="NAME", help="a name as Python writes them: letters, digits, _")
    p.add_argument("--kind", choices=KINDS, default="centroid", help="which part it is (default: centroid)")
    p.add_argument("--out", type=Path, default=Path(), metavar="FOLDER", help="where the files go (default: here)")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Write both files."""
    from testfield.measure.skeletons import write_skeleton

    for path in write_skeleton(args.name, args.kind, args.out):
        print(path)
    print(f"try it: testfield compare tiny.toml --recipes {args.out / args.name}.toml --centroids forward_model")
    return 0
