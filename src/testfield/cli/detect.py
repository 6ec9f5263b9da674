"""`testfield detect RUN` or `testfield detect IMAGE... --target KIND`: find, centre, decode and identify targets."""

import argparse
import os
from pathlib import Path
from typing import Any

from testfield.cli.knobs import add_knobs, knobs_of
from testfield.cli.refuse import OF_DOTS, refuse
from testfield.store.text import read_text

OF_PHOTOGRAPHS = dict.fromkeys(("radii", "codes", "polarity", "bayer", "smallest_px", "out")) | OF_DOTS
OF_KINDS = {
    ("radii", "codes"): ("ring",),
    ("polarity",): ("ring", "circles", "hexcircles", "runetag"),
    ("smallest_px",): ("ring", "circles", "acircles", "hexcircles", "runetag"),
    tuple(OF_DOTS): ("ring", "circles", "hexcircles", "runetag"),
}
"""Which options mean something for which kinds of targets."""


def add(commands: Any) -> None:
    """Enter the command."""
    from testfield.cli.stage import STAGES

    p = commands.add_parser(
        "detect",
        help=f"{STAGES['detect']}, or in any photographs",
        description="One stage of a run alone, its inputs taken from the folder as they are: testfield detect RUN. "
        "Or, with --target, any photographs: what is found is drawn and written, and nothing need be known of the "
        "camera.",
    )
    p.add_argument(
        "what", type=Path, nargs="+", metavar="RUN|IMAGE", help="a run's folder; or images, or folders of them"
    )
    p.add_argument(
        "--target",
        metavar="KIND",
        help="what the images show: ring14, circles, circles:10x8, acircles:4x11, hexcircles:14x24, checkerboard:9x6, "
        "charuco:7x5:DICT_4X4_50:30:22 (mm), tags:5x7:DICT_6X6_50:30:24 (mm), aruco:DICT_4X4_50, apriltag:36h11, "
        "squares:8x8:22.6:12.7, aprilgrid:6x6:88:26.4 (mm), cctag:3, runetag, runetag:1234",
    )
    p.add_argument(
        "--radii",
        metavar="A:B:C",
        help="shape of the ring codes: radii of the dot and of the ring's edges (default: 1:2:3)",
    )
    p.add_argument("--codes", metavar="FILE", help="table of the rings' numbers, or the name of a shipped one")
    way = p.add_mutually_exclusive_group()
    way.add_argument("--white-on-black", dest="polarity", action="store_const", const="white on black")
    way.add_argument("--black-on-white", dest="polarity", action="store_const", const="black on white")
    p.add_argument("--bayer", metavar="ORDER", help="the images are raw mosaics: RGGB, BGGR, GRBG or GBRG")
    p.add_argument("--smallest-px", type=float, metavar="PX", help="least diameter of a dot (default: 5)")
    add_knobs(p)
    p.add_argument("--out", type=Path, metavar="FOLDER", help="where pictures and tables go (default: renders/detect)")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.add_argument("--jobs", type=int, metavar="N", help="processes at once (default: one a core)")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """A run's stage without --target, photographs with it."""
    from testfield.cli import stage
    from testfield.errors import TestfieldError
    from testfield.store.lock import only_writer

    if args.target is None:
        if len(args.what) > 1 or args.what[0].is_file():
            raise TestfieldError("no kind of target is named", "--target", "for ring codes of 14 bits: --target ring14")
        refuse(args, "a run, whose scene says it: without --target", OF_PHOTOGRAPHS)
        args.run, args.stage, args.jobs = args.what[0], "detect", args.jobs or os.cpu_count() or 1
        return stage.act(args)
    with only_writer(args.out or Path("renders/detect")):
        return _photographs(args)


def _photographs(args: argparse.Namespace) -> int:
    import json
    import sys

    from testfield.cli.photographs import check_shown, images_in, look_at
    from testfield.detect.photograph import AUTO, SMALLEST_PX, detect_in_photograph
    from testfield.detect.target_spec import parse_target
    from testfield.errors import TestfieldError
    from testfield.measure.kept_detections import Look
    from testfield.report.photograph import write_found
    from testfield.targets.code_table import codes_for
    from testfield.targets.marks import USUAL, ring_radii, shape_name

    target = parse_target(args.target)
    for options, kinds in OF_KINDS.items():
        if target.kind not in kinds:
            refuse(args, f"targets of the kind '{target.kind}'", {name: OF_PHOTOGRAPHS[name] for name in options})
    radii, polarity = args.radii or USUAL, args.polarity or AUTO
    try:
        radii = shape_name(ring_radii(radii))
    except ValueError as error:
        raise TestfieldError(str(error), "--radii", "give the radii of dot, ring's inner and outer edge") from error
    codes = codes_for(args.codes, target.bits, "--codes")
    smallest_px = SMALLEST_PX if args.smallest_px is None else args.smallest_px
    jobs = args.jobs or os.cpu_count() or 1
    check_shown(args.bayer, smallest_px, jobs)
    knobs = knobs_of(args, smallest_px)
    out = args.out or Path("renders/detect")
    say = sys.stderr if args.json else sys.stdout
    look = Look(detect_in_photograph, (target, radii, polarity, smallest_px, codes, knobs), args.bayer)
    seen = look_at(images_in(args.what), look, out, jobs, say)
    if seen.found:
        write_found(seen.names, seen.notes, seen.found, out, seen.sizes_px, args.target)
        for name, read, found in zip(seen.names, seen.notes, seen.found, strict=True):
            if said := "; ".join((*read, *found.notes)):
                print(f"{name}: {said}", file=say)
        print(f"pictures and tables in {out}", file=say)
        if args.json:
            print(json.dumps(json.loads(read_text(out / "detection.json")) | {"unreadable": len(seen.unreadable)}))
    return 2 if seen.unreadable else 0
