"""`testfield measure IMAGE... --field FIELD.toml`: real photographs to coordinates with their covariance."""

import argparse
import os
from pathlib import Path
from typing import Any

from testfield.cli.knobs import add_knobs, knobs_of
from testfield.cli.refuse import OF_DOTS
from testfield.cli.show import add_load, add_strict


def add(commands: Any) -> None:
    """Enter the command."""
    from testfield.registry import names

    p = commands.add_parser(
        "measure",
        help="photographs of coded targets or of a calibration board: camera, coordinates, lengths, with covariance",
        description="Photographs by one camera, of which nothing is known: targets are found, the camera calibrates "
        "itself, dots without a code are named by their rays, and coordinates are reported with covariance. The "
        "field file names the targets and what is certified: places of codes, or distances between two. Boards "
        "(checkerboard, ChArUco, tags, circles) calibrate the camera: --target names one, without a field file.",
    )
    p.add_argument("images", type=Path, nargs="*", metavar="IMAGE", help="images, or folders of them")
    what = p.add_mutually_exclusive_group(required=True)
    what.add_argument("--field", type=Path, metavar="FIELD.toml", help="targets, and what is certified")
    what.add_argument(
        "--target",
        metavar="KIND",
        help="the targets, of which nothing is certified: ring14, cctag:3, aruco:DICT_4X4_50:40 or "
        "apriltag:36h11:40 (single tags and their side in mm), or a board, its lengths in mm: "
        "checkerboard:9x6:25, charuco:7x5:DICT_4X4_50:30:22, circles:10x8:25:15, acircles:4x11:20:12, "
        "hexcircles:14x24:12:10, tags:5x7:DICT_6X6_50:30:24, squares:8x8:22.6:12.7, "
        "aprilgrid:6x6:88:26.4, runetag:1234:160",
    )
    p.add_argument(
        "--observations", type=Path, metavar="FILE", help="what `testfield detect` wrote (or its folder), not images"
    )
    p.add_argument("--size-px", metavar="WxH", help="size of the images of --observations, where no file beside tells")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="where everything goes (default: renders/measure)")
    p.add_argument("--lens", choices=names("lenses"), default="brown", help="lens model")
    p.add_argument("--hold", default="", metavar="NAMES", help="lens coefficients held at zero: k3,p1,p2")
    p.add_argument(
        "--by-folder",
        action="store_true",
        help="each folder given is a camera of its own (default: as the field file's [[cameras]] say, else one camera)",
    )
    p.add_argument(
        "--rig",
        action="store_true",
        help="as --by-folder, and a rig holds the cameras: photographs of one file name were taken together",
    )
    p.add_argument("--focal-px", type=float, metavar="PX", help="a first guess of the focal length; not needed")
    p.add_argument("--bayer", metavar="ORDER", help="the images are raw mosaics: RGGB, BGGR, GRBG or GBRG")
    p.add_argument("--smallest-px", type=float, default=5.0, metavar="PX", help="least diameter of a dot (default: 5)")
    add_knobs(p)
    p.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes that detect (default: all cores)"
    )
    p.add_argument("--json", action="store_true", help="print one JSON object")
    add_load(p)
    add_strict(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Detect, calibrate, write."""
    from testfield.measure.job_file import job_of, save_job
    from testfield.store.lock import only_writer
    from testfield.store.threads import one_blas_thread

    with only_writer(args.out or Path("renders/measure")), one_blas_thread():
        status = _measure(args)
        save_job(job_of(vars(args)), args.out or Path("renders/measure"))  # what `testfield twin` asks again
        return status


def _measure(args: argparse.Namespace) -> int:
    import json
    import sys
    from collections import Counter
    from dataclasses import replace
    from functools import partial

    from testfield.cli.cameras import decoded_of, headers_of, owners_of, taken_of
    from testfield.cli.photographs import Looks, check_shown, held_of, images_in, look_at
    from testfield.cli.refuse import refuse
    from testfield.cli.show import status_of
    from testfield.detect.photograph import AUTO, ON_BLACK, ON_WHITE, detect_in_photograph
    from testfield.errors import TestfieldError
    from testfield.measure.beside_boards import KINDS as BESIDE
    from testfield.measure.kept_detections import Look
    from testfield.measure.observed import parse_size, read_observed
    from testfield.measure.one_camera import check_one_camera, focal_of, unlike_exif
    from testfield.measure.patterns import look_for
    from testfield.measure.photographs import measure
    from testfield.report.measured import write_measurement
    from testfield.targets.code_table import codes_for

    field, source, beside, target, patterns = targets_of(args)
    what, idle = idle_of(args, target, patterns)
    refuse(args, what, idle)
    hold = held_of(args.hold, args.lens)
    check_shown(args.bayer, args.smallest_px, args.jobs)
    if args.focal_px is not None and not args.focal_px > 0:
        raise TestfieldError(f"value {args.focal_px}", "--focal-px", "give a focal length in pixels")
    codes = codes_for(field.target.codes, target.bits, f"{source}, target.codes", beside)
    polarity = {None: AUTO, True: ON_BLACK, False: ON_WHITE}[field.target.white_on_black]
    out = args.out or Path("renders/measure")
    say = sys.stderr if args.json else sys.stdout
    if bool(args.images) == (args.observations is not None):
        raise TestfieldError("nothing to measure, or two things", "IMAGE", "give images, or --observations FILE")
    if args.observations is not None and (args.by_folder or args.rig or field.cameras):
        raise TestfieldError("observations do not say which camera took an image", "--observations", "give the images")
    owners = owners_of(args.images, field, source, args.lens, args.by_folder, args.rig) if args.images else None
    seen, places = Looks(), images_in(args.images)
    headers = headers_of(places, owners)
    check_one_camera(headers)
    if args.observations is not None:
        size_px = parse_size(args.size_px, "--size-px") if args.size_px else None
        observed = read_observed(args.observations, target, patterns, size_px)
        seen = Looks(list(observed.names), found=observed.found, sizes_px=observed.sizes)
    knobs = knobs_of(args, args.smallest_px)
    look = Look(
        detect_in_photograph, (target, field.target.radii, polarity, args.smallest_px, codes, knobs), args.bayer
    )
    if patterns:
        boards = tuple((one.name, one.target) for one in patterns)
        coded = (target, field.target.radii, codes) if field.patterns and target.kind in BESIDE else None
        look = Look(look_for, (boards, polarity, args.smallest_px, knobs, coded), args.bayer)
    if places:
        seen = look_at(places, look, out, args.jobs, say, owners.name_of if owners else lambda stem, _: stem)
    trouble = [f"'{path.name}' cannot be read and is left out" for path in seen.unreadable]
    names, sizes = seen.names, seen.sizes_px
    if not seen.found:
        raise TestfieldError("no image can be read", str((args.images or [args.observations])[0]), "give photographs")
    taken = taken_of(owners, seen.given, [path.stem for path in seen.files], sizes) if owners else None
    size = taken.cameras[0].size_px if taken else Counter(sizes).most_common(1)[0][0]
    # The files' headers need not tell what was decoded.
    check_one_camera(decoded_of(names, taken.camera if taken else None, sizes))
    told = None if taken else focal_of(headers)
    measured = partial(measure, tuple(names), seen.found, size, field, target, args.lens, hold, taken=taken)
    try:
        result = measured(focal_px=args.focal_px or told, patterns=patterns)
    except TestfieldError:
        if args.focal_px or told is None or patterns:
            raise
        # The header may be of the image before it was cropped or reduced.
        result = measured(focal_px=None, patterns=patterns)
    trouble += unlike_exif(result.calibration.interior.fx, told)
    noted = replace(result.calibration, notes=(*trouble, *result.calibration.notes))
    result = replace(result, calibration=noted, unread=tuple(path.name for path in seen.unreadable))
    summary = write_measurement(result, field, out, tuple(str(p) for p in args.images or [args.observations]))
    for title, value in summary["figures"]:
        print(f"{title:<48} {value}", file=say)
    for doubt in summary["doubts"]:
        print(f"doubtful: {doubt}", file=say)
    for note in result.calibration.notes:
        if note not in summary["failures"]:
            print(f"note: {note}", file=say)
    print(f"coordinates, covariance and report in {out}", file=say)
    if args.json:
        print(json.dumps(summary))
    return status_of(summary["failures"], args.strict)


def idle_of(args: argparse.Namespace, target: Any, patterns: tuple) -> tuple[str, dict[str, Any]]:
    """In words what is measured, and the options that mean nothing for it, with their defaults."""
    dots = OF_DOTS | {"smallest_px": 5.0}
    if args.observations is not None:
        return "observations that are there", dots | {"bayer": None}
    kinds = {one.target.kind for one in patterns} | {target.kind}
    idle: dict[str, Any] = {"size_px": None}
    if not kinds & {"ring", "circles", "hexcircles", "runetag"}:
        idle |= OF_DOTS if "acircles" in kinds else dots
    if patterns:
        idle["focal_px"] = None
    return f"photographs of {', '.join(sorted(kinds))}", idle


def targets_of(args: argparse.Namespace) -> tuple[Any, str, Path, Any, tuple]:
    """The field, where it stands, the folder beside it, its targets and the boards that calibrate.

    Raises `TestfieldError` for targets that cannot be measured.
    """
    from testfield.detect.target_spec import parse_target
    from testfield.errors import TestfieldError
    from testfield.measure.beside_boards import KINDS as BESIDE
    from testfield.measure.patterns import patterns_of
    from testfield.scene.shipped import find_field
    from testfield.targets.field_file import field_of_target, load_field_file

    if args.field is None:
        source, kind_of, beside = "--target", "--target", Path()
        if parse_target(args.target).kind == "circles" and ":" not in args.target:
            raise TestfieldError("'circles' names no grid", kind_of, "give its size: circles:10x8:25:15")
        field = field_of_target(args.target)
    else:
        args.field = find_field(args.field)
        source, kind_of, beside = str(args.field), f"{args.field}, target.kind", args.field.parent
        field = load_field_file(args.field)
    target, patterns = parse_target(field.target.kind, kind_of), patterns_of(field, source)
    if field.patterns and target.kind in BESIDE:
        if args.observations is not None:
            raise TestfieldError(
                "observations do not say which are of boards and which beside them",
                "--observations",
                "give the images",
            )
        if field.boards or any(one.role == "control" for one in field.distances):
            raise TestfieldError(
                "beside boards that calibrate, places and distances make no datum",
                source,
                'certify the boards ([[patterns]], u_mm), and give distances role = "check"',
            )
    return field, source, beside, target, patterns
