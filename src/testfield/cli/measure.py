"""`testfield measure IMAGE... --field FIELD.toml`: real photographs to coordinates with their covariance."""

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from testfield.cli.knobs import add_knobs, knobs_of
from testfield.cli.show import add_load, add_strict

if TYPE_CHECKING:
    from testfield.measure.kept_detections import Kept, Look


def add(commands: Any) -> None:
    """Enter the command."""
    from testfield.registry import names

    p = commands.add_parser(
        "measure",
        help="photographs of coded targets: camera, coordinates, lengths, with their covariance",
        description="Photographs by one camera, of which nothing is known: targets are found, the camera calibrates "
        "itself, dots without a code are named by their rays, and coordinates are reported with their covariance. The "
        "field file names the targets and what is certified: places of codes, or distances between two of them.",
    )
    p.add_argument("images", type=Path, nargs="+", metavar="IMAGE", help="images, or folders of them")
    p.add_argument("--field", type=Path, required=True, metavar="FIELD.toml", help="targets, and what is certified")
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
    from testfield.store.lock import only_writer
    from testfield.store.threads import one_blas_thread

    with only_writer(args.out or Path("renders/measure")), one_blas_thread():
        return _measure(args)


def _measure(args: argparse.Namespace) -> int:
    import json
    import sys
    from collections import Counter
    from dataclasses import replace

    import numpy as np

    from testfield.camera.interior import check_held
    from testfield.camera.mosaic import ORDERS
    from testfield.cli.cameras import owners_of, taken_of
    from testfield.cli.detect import _images, refuse_over
    from testfield.cli.show import status_of
    from testfield.detect.photograph import AUTO, ON_BLACK, ON_WHITE, detect_in_photograph
    from testfield.detect.target_spec import parse_target
    from testfield.errors import TestfieldError
    from testfield.measure.kept_detections import Look, put_picture
    from testfield.measure.photographs import measure
    from testfield.report.measured import write_measurement
    from testfield.scene.shipped import find_field
    from testfield.targets.code_table import codes_for
    from testfield.targets.field_file import load_field_file

    args.field = find_field(args.field)
    field = load_field_file(args.field)
    target = parse_target(field.target.kind, f"{args.field}, target.kind")
    if target.kind not in ("ring", "circles"):
        raise TestfieldError(
            f"'{field.target.kind}' cannot be measured", f"{args.field}, target.kind", "ring codes and circle grids can"
        )
    hold = tuple(name.strip() for name in args.hold.split(",") if name.strip())
    check_held(hold, args.lens, "--hold")
    if args.bayer is not None and args.bayer not in ORDERS:
        raise TestfieldError(f"no Bayer order is called '{args.bayer}'", "--bayer", f"one of {', '.join(ORDERS)}")
    if args.jobs < 1:
        raise TestfieldError(f"value {args.jobs}", "--jobs", "give 1 or more")
    if not 2 <= args.smallest_px <= 200:
        raise TestfieldError(f"value {args.smallest_px}", "--smallest-px", "give 2 to 200")
    if args.focal_px is not None and not args.focal_px > 0:
        raise TestfieldError(f"value {args.focal_px}", "--focal-px", "give a focal length in pixels")
    codes = codes_for(field.target.codes, target.bits, f"{args.field}, target.codes", args.field.parent)
    polarity = {None: AUTO, True: ON_BLACK, False: ON_WHITE}[field.target.white_on_black]
    out = args.out or Path("renders/measure")
    say = sys.stderr if args.json else sys.stdout
    owners = owners_of(args.images, field, str(args.field), args.lens, args.by_folder, args.rig)
    names: list[str] = []
    found, sizes, trouble, folders, places = [], [], [], [], []
    given = [(folder, path) for folder in args.images for path in _images([folder])]
    arguments = (target, field.target.radii, polarity, args.smallest_px, codes, knobs_of(args, args.smallest_px))
    look = Look(detect_in_photograph, arguments, args.bayer)
    kept = _detections([path for _, path in given], look, out / "detections", args.jobs, say)
    for (folder, path), one in zip(given, kept, strict=True):
        if one.found is None:
            trouble.append(f"'{path.name}' cannot be read and is left out")
            continue
        name = owners.name_of(path.stem, folder) if owners else path.stem
        if name in names:
            count = next(k for k in range(2, len(names) + 3) if f"{name}-{k}" not in names)
            name = f"{name}-{count}"
        refuse_over(args.images, out / f"{name}.png")
        put_picture(one, out / f"{name}.png")
        names.append(name)
        folders.append(folder)
        places.append(path.stem)
        found.append(one.found)
        sizes.append(one.size_px)
    if not found:
        raise TestfieldError("no image can be read", str(args.images[0]), "give photographs")
    taken = taken_of(owners, folders, places, sizes) if owners else None
    size = Counter(sizes).most_common(1)[0][0]
    expected = [size] * len(names)
    if taken:
        by_name = {camera.name: camera.size_px for camera in taken.cameras}
        expected = [by_name[camera] for camera in taken.camera]
        size = taken.cameras[0].size_px
    for name, other, size_of in zip(names, sizes, expected, strict=True):
        if other != size_of:
            trouble.append(
                f"image '{name}' is {other[0]} x {other[1]} px and the others {size_of[0]} x {size_of[1]}: it is "
                "of another camera, or cropped, and is left out"
            )
    keep = [k for k, other in enumerate(sizes) if other == expected[k]]
    result = measure(
        tuple(names[k] for k in keep),
        [found[k] for k in keep],
        size,
        field,
        target,
        args.lens,
        hold,
        args.focal_px,
        taken.of(np.array(keep, int)) if taken else None,
    )
    result = replace(result, calibration=replace(result.calibration, notes=(*trouble, *result.calibration.notes)))
    summary = write_measurement(result, field, out, tuple(str(p) for p in args.images))
    for title, value in summary["figures"]:
        print(f"{title:<48}{value}", file=say)
    for note in result.calibration.notes:
        if note not in summary["failures"]:
            print(f"note: {note}", file=say)
    print(f"coordinates, covariance and report in {out}", file=say)
    if args.json:
        print(json.dumps(summary))
    return status_of(summary["failures"], args.strict)


def _detections(paths: Sequence[Path], look: "Look", folder: Path, jobs: int, say: TextIO) -> list["Kept"]:
    """What is seen in photographs, a line each as it becomes known."""
    import sys

    from testfield.measure.kept_detections import detect_each
    from testfield.report.photograph import draw_found

    done = 0

    def tell(number: int, kept: "Kept", before: bool) -> None:
        nonlocal done
        done += 1
        if kept.found is None:
            print(f"testfield: {kept.trouble}", file=sys.stderr, flush=True)
            return
        head = f"{done} of {len(paths)}, {paths[number].name}: "
        print(f"{head}{kept.found.summary}{' (kept from before)' if before else ''}", file=say, flush=True)

    return detect_each(paths, look, folder, draw_found, jobs, tell)
