"""`testfield certify`: measure the ruler itself."""

import argparse
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "certify",
        help="measure the renderer and the sensor, and write a certificate with verdicts",
        description="Measures the ruler itself: geometry, light, lens, focus and motion, sensor, sameness. "
        "Exit status 1 where a verdict fails.",
    )
    p.add_argument("--quick", action="store_true", help="fewer and smaller measurements, in about a minute")
    p.add_argument(
        "--scene", type=Path, default=Path("quick"), metavar="SCENE", help="whose light is judged (default: quick)"
    )
    p.add_argument("--out", type=Path, default=Path("renders"), metavar="FOLDER", help="where the certificate goes")
    p.add_argument("--json", action="store_true", help="print the certificate as one JSON object")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Print a verdict a line as it falls; write certificate.json and certificate.html."""
    import json
    import sys

    from testfield.certify.certificate import certify, write_certificate
    from testfield.certify.verdict import Verdict
    from testfield.cli.colour import judged
    from testfield.scene.shipped import find_scene
    from testfield.store.lock import only_writer

    def tell(verdict: Verdict) -> None:
        say = sys.stderr if args.json else sys.stdout
        mark = judged(verdict.passed, "pass" if verdict.passed else "FAIL", say)
        figure = f"{verdict.measured:.3g} (limit {verdict.limit:.3g} {verdict.unit})"
        print(
            f"{mark}  {verdict.part:<9} {verdict.name:<58} {figure}",
            file=say,
            flush=True,
        )

    with only_writer(args.out):
        certificate = certify(find_scene(args.scene), args.quick, tell)
        write_certificate(certificate, args.out)
    if args.json:
        print(json.dumps(certificate))
    else:
        print(f"\n{args.out / 'certificate.html'}")
    return 0 if certificate["passed"] else 1
