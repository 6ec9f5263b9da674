"""`testfield new TEMPLATE NAME`: a scene to begin with; `testfield new algorithm NAME`: an algorithm of your own."""

import argparse
from pathlib import Path
from typing import Any

KINDS = ("finder", "centroid", "decoder", "detector", "calibrator", "reconstructor", "program")
ALGORITHM = "algorithm"


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "new",
        help="a scene to begin with, from a template, or a skeleton of an algorithm of your own",
        description="With a template (`testfield list templates`): writes NAME.toml, a scene that runs as it is, and "
        "the meshes that it names. With `algorithm`: writes NAME.py, which runs as it is, and NAME.toml, a recipe for "
        "`testfield compare --recipes`; what each kind is given and gives back says OWN_ALGORITHMS.md.",
    )
    p.add_argument("what", metavar="TEMPLATE", help="a template's name, or algorithm")
    p.add_argument("name", metavar="NAME", help="the scene's name, or the algorithm's as Python writes it")
    p.add_argument("--kind", choices=KINDS, default="centroid", help="algorithm: which part it is (default: centroid)")
    p.add_argument("--out", type=Path, default=Path(), metavar="FOLDER", help="where the files go (default: here)")
    p.add_argument("--force", action="store_true", help="template: overwrite files that are there")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Write the files."""
    return _algorithm(args) if args.what == ALGORITHM else _scene(args)


def _algorithm(args: argparse.Namespace) -> int:
    from testfield.cli.refuse import refuse
    from testfield.measure.skeletons import write_skeleton

    refuse(args, "an algorithm, whose files are never written over", {"force": False})

    for path in write_skeleton(args.name, args.kind, args.out):
        print(path)
    print(f"try it: testfield compare tiny.toml --recipes {args.out / args.name}.toml --centroids forward_model")
    return 0


def _scene(args: argparse.Namespace) -> int:
    from testfield.author.templates import described, templates, write_template
    from testfield.cli.refuse import refuse
    from testfield.errors import TestfieldError, nearest

    if args.what not in templates():
        raise TestfieldError("no such template", args.what, nearest(args.what, [*templates(), ALGORITHM]))
    refuse(args, "a template", {"kind": "centroid"})
    paths = write_template(args.what, args.name, args.out, args.force)
    for path in paths:
        print(path)
    print(f"expected: {described(paths[0])[1]}")
    print(f"see it: testfield preview {paths[0]}; check what it will measure: testfield plan {paths[0]}")
    return 0
