"""`testfield field new IMAGE...`: a field file proposed from photographs of coded targets."""

import argparse
import os
from pathlib import Path
from typing import Any

from testfield.cli.knobs import add_knobs, knobs_of
from testfield.cli.refuse import refuse
from testfield.registry import names


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "field",
        help="photographs of coded targets: a field file proposed from them, with pictures of all boards and numbers",
        description="A field file for `testfield measure`, proposed from photographs.",
    )
    kinds = p.add_subparsers(dest="what", metavar="new", required=True)
    p = kinds.add_parser(
        "new",
        help="propose a field file from what photographs show",
        description="Photographs of ring codes, CCTags or single tags by one camera. Codes that move rigidly together, "
        "or lie in one plane, are proposed as boards, with approximate places; one distance between two codes is to be "
        "filled in.",
    )
    p.add_argument("images", type=Path, nargs="+", metavar="IMAGE", help="images, or folders of them")
    p.add_argument(
        "--target",
        default="ring14",
        metavar="KIND",
        help="ring codes: ring12, ring14 ...; CCTags: cctag:3; single tags: aruco:DICT_4X4_50, apriltag:36h11 "
        "(default: ring14)",
    )
    p.add_argument("--radii", metavar="A:B:C", help="shape of the rings (default: 1:2:3)")
    p.add_argument("--codes", metavar="TABLE", help="table of the rings' numbers: a file, or the name of a shipped one")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="where everything goes (default: renders/field)")
    p.add_argument("--lens", choices=names("lenses"), default="brown", help="lens model")
    p.add_argument("--hold", default="", metavar="NAMES", help="lens coefficients held at zero: k3,p1,p2")
    p.add_argument("--focal-px", type=float, metavar="PX", help="a first guess of the focal length; not needed")
    p.add_argument("--smallest-px", type=float, default=5.0, metavar="PX", help="least diameter of a dot (default: 5)")
    add_knobs(p)
    p.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes that detect (default: all cores)"
    )
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Detect, calibrate, group, write."""
    from testfield.store.lock import only_writer
    from testfield.store.threads import one_blas_thread

    with only_writer(args.out or Path("renders/field")), one_blas_thread():
        return _propose(args)


def _propose(args: argparse.Namespace) -> int:
    import shutil
    import sys
    from collections import Counter

    from testfield.camera.photograph import read_photograph
    from testfield.cli.cameras import decoded_of, headers_of
    from testfield.cli.photographs import check_shown, held_of, images_in, look_at
    from testfield.detect.photograph import AUTO, ON_BLACK, ON_WHITE, detect_in_photograph
    from testfield.detect.target_spec import parse_target
    from testfield.errors import TestfieldError
    from testfield.measure.kept_detections import Look
    from testfield.measure.one_camera import check_one_camera, focal_of
    from testfield.measure.proposed_field import propose
    from testfield.measure.proposed_text import field_text
    from testfield.measure.single_tags import KINDS as SINGLE_TAGS
    from testfield.measure.single_tags import as_coded
    from testfield.report.proposed_field import draw_board, draw_photograph
    from testfield.store.atomic import whole
    from testfield.store.text import write_text
    from testfield.targets.code_table import codes_for
    from testfield.targets.field_file import load_field_file
    from testfield.targets.marks import USUAL, ring_radii

    target = parse_target(args.target, "--target")
    if target.kind not in ("ring", "cctag", *SINGLE_TAGS):
        raise TestfieldError(
            f"'{args.target}' has no numbers to be grouped",
            "--target",
            "name ring codes, CCTags or single tags; a board says all by its print",
        )
    if target.kind != "ring":
        refuse(args, f"targets of the kind '{target.kind}'", dict.fromkeys(("radii", "codes")))
    hold = held_of(args.hold, args.lens)
    radii = args.radii or USUAL
    try:
        ring_radii(radii)
    except ValueError as error:
        raise TestfieldError(str(error), "--radii", "give three ascending numbers, as 1:2:3") from error
    check_shown(None, args.smallest_px, args.jobs)
    codes = codes_for(args.codes, target.bits, "--codes", Path())
    out = args.out or Path("renders/field")
    places = images_in(args.images)
    headers = headers_of(places, None)
    check_one_camera(headers)
    look = Look(
        detect_in_photograph, (target, radii, AUTO, args.smallest_px, codes, knobs_of(args, args.smallest_px)), None
    )
    seen = look_at(places, look, out / "photographs", args.jobs, sys.stdout)
    if not seen.found:
        raise TestfieldError("no image can be read", str(args.images[0]), "give photographs")
    labels, found, sizes = seen.names, seen.found, seen.sizes_px
    if target.kind in SINGLE_TAGS:  # each corner is a point with a code of its own
        found, notes = as_coded(found)
        print(*notes, sep="\n", end="\n" if notes else "")
    check_one_camera(decoded_of(labels, None, sizes))
    size = Counter(sizes).most_common(1)[0][0]
    proposal = propose(tuple(labels), found, size, args.lens, hold, args.focal_px or focal_of(headers))

    said: dict[str, Any] = {"kind": args.target}
    if radii != USUAL:
        said["radii"] = radii
    if args.codes:
        table = Path(args.codes)
        said["codes"] = str(table.resolve()) if table.is_file() else args.codes
    ways = Counter(note for one in found for note in one.notes if note in (ON_BLACK, ON_WHITE))
    if len(ways) == 1:
        said["white_on_black"] = next(iter(ways)) == ON_BLACK
    title = args.images[0].resolve().stem if args.images[0].is_dir() else args.images[0].resolve().parent.stem
    file = out / "FIELD.toml"
    text = field_text(proposal, said, title)
    if file.is_file() and file.read_text(encoding="utf-8") != text:
        shutil.copyfile(file, out / "FIELD.before.toml")  # somebody may have filled it in
        print(f"the file that was there is kept as {out / 'FIELD.before.toml'}")
    with whole(file) as part:
        write_text(part, text)
    load_field_file(file)  # what is proposed must be what `measure` accepts
    for number, group in enumerate(proposal.groups):
        name = group.name.replace(" ", "_")
        draw_board(group, number, out / f"{name}.png", proposal.longest[:2])
        bodies = f", moves with body {group.body + 1}" if proposal.arranged.moved else ""
        print(f"{group.name}: {len(group.code)} codes{bodies}; picture {out / f'{name}.png'}")
    most = max(range(len(found)), key=lambda k: len(found[k].numbers))
    draw_photograph(read_photograph(seen.files[most]), found[most].observations, proposal, out / "photograph.png")
    c = proposal.network.calibration
    print(
        f"images joined, of those given: {len(c.station_names)} of {len(places)}; reprojection "
        f"{c.reprojection_rms_px:.3f} px; photograph with all numbers: {out / 'photograph.png'}"
    )
    for path in seen.unreadable:
        print(f"note: '{path.name}' cannot be read and is left out")
    for note in proposal.notes:
        print(f"note: {note}")
    a, b, _ = proposal.longest
    print(
        f"{file} is written. Fill in one distance (as between codes {a} and {b}), then: "
        f"testfield measure {' '.join(map(str, args.images))} --field {file}"
    )
    return 0
