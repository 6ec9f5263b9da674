"""`testfield sensor FRAMES`: a camera's sensor from flat-field pairs and darks, as EMVA 1288 release 4 does."""

import argparse
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "sensor",
        help="flat-field pairs and darks: gain, noise, full well, linearity, nonuniformity; a sensor for scenes",
        description="Characterises a camera as EMVA 1288 release 4.0 (linear model) does. FRAMES is a folder whose "
        "names tell (dark_10ms, flat_10ms, flat_10ms_5000photons), a table of frames (.toml, .csv), or an EMVA 1288 "
        "descriptor file. Two frames or more of each level, without a lens before an even light.",
    )
    p.add_argument("frames", type=Path, metavar="FRAMES", help="folder, table (.toml, .csv) or EMVA 1288 descriptor")
    p.add_argument("--bayer", metavar="ORDER", help="the frames are raw mosaics: RGGB, BGGR, GRBG or GBRG")
    p.add_argument("--bits", type=int, metavar="N", help="of the converter (default: by the largest number)")
    p.add_argument("--wavelength-nm", type=float, metavar="NM", help="of the light, for the scene's sensor")
    p.add_argument("--pitch-um", type=float, metavar="UM", help="pixel pitch, for the scene's camera")
    p.add_argument(
        "--time-unit",
        choices=["ns", "us", "ms", "s"],
        help="of the exposure times in an EMVA 1288 descriptor (default: ns)",
    )
    p.add_argument("--out", type=Path, metavar="FOLDER", help="where everything goes (default: renders/sensor)")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Read, compute, write."""
    from testfield.store.lock import only_writer
    from testfield.store.threads import one_blas_thread

    with only_writer(args.out or Path("renders/sensor")), one_blas_thread():
        return _characterise(args)


def _characterise(args: argparse.Namespace) -> int:
    import json
    import sys
    from dataclasses import replace

    from testfield.characterise.characterise import characterise
    from testfield.characterise.sources import series_of
    from testfield.errors import TestfieldError
    from testfield.report.sensor import rows_of, write_sensor

    if args.bits is not None and not 1 <= args.bits <= 16:
        raise TestfieldError(f"value {args.bits}", "--bits", "give 1 to 16")
    for name in ("wavelength_nm", "pitch_um"):
        value = getattr(args, name)
        if value is not None and not 0 < value < 1e5:
            raise TestfieldError(f"value {value}", f"--{name.replace('_', '-')}", "give a positive number")
    series = series_of(args.frames, args.time_unit)
    given = {
        "bayer": args.bayer,
        "bits": args.bits,
        "wavelength_nm": args.wavelength_nm,
        "pixel_pitch_um": args.pitch_um,
    }
    series = replace(series, **{name: value for name, value in given.items() if value is not None})
    total, done = sum(len(level.images) for level in series.levels), 0

    def seen(path: Path) -> None:
        nonlocal done
        done += 1
        if sys.stderr.isatty():
            end = "\n" if done == total else ""
            print(f"\r\033[Kframe {done} of {total}: {path.name}", end=end, file=sys.stderr, flush=True)

    sheet = characterise(series, seen)
    out = args.out or Path("renders/sensor")
    data = write_sensor(sheet, out)
    if args.json:
        print(json.dumps(data, allow_nan=False))
        return 0
    print(
        f"{total} frames of {len(series.levels)} levels, {sheet.size_px[0]} x {sheet.size_px[1]} px, {sheet.bits} bits"
    )
    for title, value, u, unit in rows_of(sheet.figures):
        print(f"{title:<42}{value:>12} {'± ' + u if u else '':<12} {unit}".rstrip())
    for note in sheet.notes:
        print(f"note: {note}")
    print(f"standard uncertainties (k = 1); page, JSON and the sensor for scenes in {out}")
    return 0
