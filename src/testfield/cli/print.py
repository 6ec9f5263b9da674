"""`testfield print SCENE`: boards and cards true to scale, and the field sheet that belongs to them."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from testfield.targets.field import Field


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "print",
        help="a scene's boards and targets true to scale, with the field sheet that belongs to them",
        description="Writes PDF (and SVG, DXF, PNG) pages of all boards, of the coded targets of bars and stickers, "
        "and field.json, by which photographs of them are measured. With --tile a board goes over several pages, each "
        "of which is a board of its own in the sheet: how well they were glued together is measured, not trusted. What "
        "somebody measured of the print is entered with --scale-x and --scale-y, or --points.",
    )
    p.add_argument(
        "scene", type=Path, metavar="SCENE", help="a scene file, the name of one that comes along, or a field.json"
    )
    p.add_argument("--board", action="append", default=[], metavar="NAME", help="this board alone; again for more")
    p.add_argument(
        "--paper",
        default="A4",
        metavar="NAME",
        help="A4, A3, A2, A1, A0, Letter, Tabloid; board: as large as the board",
    )
    p.add_argument("--tile", action="store_true", help="put what is larger than the paper over several pages")
    p.add_argument("--overlap", type=float, default=10.0, metavar="MM", help="strip for glue (default: 10)")
    p.add_argument("--margin", type=float, default=5.0, metavar="MM", help="what the printer leaves (default: 5)")
    p.add_argument(
        "--dpi", type=float, default=600.0, metavar="N", help="the printer's, and that of PNG (default: 600)"
    )
    p.add_argument("--formats", default="pdf", metavar="LIST", help="of pdf, svg, dxf, png, with commas (default: pdf)")
    p.add_argument("--scale-x", type=float, metavar="F", help="measured: printed width over drawn width")
    p.add_argument("--scale-y", type=float, metavar="F", help="measured: printed height over drawn height")
    p.add_argument(
        "--u-scale",
        type=float,
        metavar="U",
        help="relative standard uncertainty of the scale (default: 0.0005 of a print "
        "that nobody measured; needed with --scale-x, and with --points of all boards)",
    )
    p.add_argument(
        "--points",
        action="append",
        default=[],
        metavar="BOARD=FILE.csv",
        help="measured: places of a board's marks (columns x_mm, y_mm, mark or code, u_mm)",
    )
    p.add_argument("--u-um", type=float, metavar="UM", help="standard uncertainty of each coordinate of --points")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="where the files go (default: renders/<name>-print)")
    p.add_argument("--force", action="store_true", help="write over an earlier print")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Write the files and say which they are."""
    import datetime
    import json
    from dataclasses import replace

    from testfield.author.print_files import FORMATS, Paper, cards_of, pages_of, write
    from testfield.errors import TestfieldError, nearest

    formats = [one.strip().lower() for one in args.formats.split(",")]
    for one in formats:
        if one not in FORMATS:
            raise TestfieldError(
                f"'{one}' is no format of prints",
                "--formats",
                nearest(one, FORMATS) or f"choose of {', '.join(FORMATS)}",
            )
    for option, value, least in (("--overlap", args.overlap, 0), ("--margin", args.margin, 0), ("--dpi", args.dpi, 50)):
        if not least <= value < 1e5:
            raise TestfieldError(f"value {value}", option, f"give {least} or more")
    name, sheet, sizes = _sheet_of(args.scene)
    known = [board.name for board in sheet.boards]
    for wanted in args.board:
        if wanted not in known:
            raise TestfieldError(
                f"no board is called '{wanted}'", "--board", nearest(wanted, known) or f"known are {', '.join(known)}"
            )
    if args.board:
        sheet = replace(sheet, boards=tuple(b for b in sheet.boards if b.name in args.board), loose={})
    if not sheet.boards and not sheet.loose:
        raise TestfieldError(
            "nothing is printed: the sheet has no boards and no targets", str(args.scene), "give another"
        )
    how = Paper(args.paper, args.margin, args.tile, args.overlap, args.dpi)
    pages, printed = pages_of(sheet, sizes, how)
    cards = cards_of(sheet, how)
    drawn, printed = printed, _as_measured(printed, args)
    out = args.out or Path("renders") / f"{name}-print"
    if (out / "field.json").exists() and not args.force:
        raise TestfieldError("a print is here already", str(out / "field.json"), "give --force, or another --out")
    day = datetime.date.today().isoformat()
    files = write(out, name, pages, cards, printed, how, formats, day, drawn)
    if args.json:
        print(json.dumps({"files": [str(file) for file in files], "pages": len(pages), "cards": len(cards)}))
        return 0
    for file in files:
        print(file)
    print(
        f"{len(pages)} pages of boards, {len(cards)} of cards: print at 100 %, then check the ruler with a steel scale"
    )
    return 0


def _sheet_of(path: Path) -> "tuple[str, Field, dict[str, tuple[float, float]]]":
    """A name, the field sheet as it is drawn, and the sizes of boards that are larger than their print."""
    from dataclasses import replace

    from testfield.author.print_files import U_SCALE
    from testfield.scene.build import build_world
    from testfield.scene.load import load_scene
    from testfield.scene.shipped import find_scene
    from testfield.targets.field import Field

    if path.suffix == ".json":
        return path.parent.name or "field", Field.load(path), {}
    scene = load_scene(find_scene(path))
    sizes = {board.name: (board.size_mm[0], board.size_mm[1]) for board in scene.boards}
    return scene.name, replace(build_world(scene).field, u_scale=U_SCALE), sizes


def _as_measured(sheet: "Field", args: argparse.Namespace) -> "Field":
    from dataclasses import replace

    from testfield.author.measured_print import load_points, measured, stretched
    from testfield.errors import TestfieldError, nearest

    for option, value in (("--scale-x", args.scale_x), ("--scale-y", args.scale_y)):
        if value is not None and not 0.9 < value < 1.1:
            raise TestfieldError(f"{value} is no print's scale", option, "give printed over drawn, as 1.0004")
    if args.u_scale is not None and not 0 <= args.u_scale < 0.1:
        raise TestfieldError(f"value {args.u_scale}", "--u-scale", "give a relative uncertainty, as 0.00002")
    if args.scale_x is not None or args.scale_y is not None:
        if args.u_scale is None:
            raise TestfieldError("a measured scale has an uncertainty", "--u-scale", "give it, as 0.00002")
        sheet = stretched(sheet, args.scale_x or 1.0, args.scale_y or 1.0, args.u_scale)
    elif args.u_scale is not None:
        sheet = replace(sheet, u_scale=args.u_scale)
    boards, told = {board.name: board for board in sheet.boards}, set[str]()
    for given in args.points:
        board, equals, file = given.partition("=")
        if not equals or board not in boards:
            raise TestfieldError(
                f"'{given}' names no board of the print",
                "--points",
                nearest(board, boards) or f"give BOARD=FILE.csv; boards are {', '.join(boards)}",
            )
        u_mm = None if args.u_um is None else args.u_um / 1000
        boards[board] = measured(boards[board], load_points(Path(file), boards[board], u_mm))
        told.add(board)
    if args.u_scale is None and told and told == set(boards):
        raise TestfieldError(
            "all boards were measured, so their scale is the measuring machine's, and no longer the printer's",
            "--u-scale",
            "give the machine's, as 0.000003",
        )
    return replace(sheet, boards=tuple(boards.values()))
