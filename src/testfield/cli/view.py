"""`testfield view SCENE|RUN`: the scene in three dimensions, and what it will measure or has measured."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testfield.cli.show import add_load

if TYPE_CHECKING:
    from testfield.author.view_data import ViewData


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "view",
        help="a scene or a finished run in 3-D, as one page that works offline",
        description="Writes one self-contained HTML page: boards with their prints, stations with frusta and optical "
        "axes, targets coloured by rays, convergence angle and predicted standard uncertainty, with error ellipsoids "
        "and sections. Of a run's folder it shows actual errors beside them.",
    )
    p.add_argument(
        "scene",
        type=Path,
        metavar="SCENE|RUN",
        help="a scene file (TOML), the name of one that comes along, or the folder of a finished run",
    )
    p.add_argument(
        "--out",
        type=Path,
        metavar="PAGE.html",
        help="the page (default: renders/<scene's name>-view.html, or view.html in the run's folder)",
    )
    p.add_argument("--open", action="store_true", help="open it in the browser")
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Compute what is to be shown, write the page, and say where it is."""
    from testfield.errors import TestfieldError
    from testfield.report.view_page import MOST_BYTES, view_page
    from testfield.store.text import write_text
    from testfield.store.threads import one_blas_thread

    if args.out is not None and args.out.suffix != ".html":
        raise TestfieldError(f"'{args.out}' does not end in .html", "--out", "the view is an HTML page")
    with one_blas_thread():
        data = _of_run(args.scene) if args.scene.is_dir() else _of_scene(args.scene)
        text = view_page(data)
    name = data.job.scene.name
    out = args.out or (args.scene / "view.html" if args.scene.is_dir() else Path("renders") / f"{name}-view.html")
    out.parent.mkdir(parents=True, exist_ok=True)
    write_text(out, text)
    if len(text) > MOST_BYTES:
        from testfield.cli.show import show_warnings

        show_warnings([f"the page is {len(text) / 1e6:.1f} MB, more than {MOST_BYTES / 1e6:g} MB"])
    print(out)
    if args.open:
        _open(out)
    return 0


def _of_scene(name: Path) -> "ViewData":
    from testfield.author.view_data import view_data
    from testfield.chain.run import check_algorithms
    from testfield.plan.job import Job
    from testfield.scene.document import load_document
    from testfield.scene.load import numbered, scene_from
    from testfield.scene.shipped import find_scene

    path = find_scene(name)
    document = load_document(path)
    scene = scene_from(document)
    with numbered(document):
        check_algorithms(scene, str(path))
        return view_data(Job.of(scene, str(path)))


def _of_run(folder: Path) -> "ViewData":
    from dataclasses import replace

    from testfield.author.view_data import view_data
    from testfield.author.view_run import actual_of
    from testfield.calibrate.calibration import Calibration
    from testfield.chain.belongs import check_truth
    from testfield.chain.run import resume
    from testfield.plan.job import Job
    from testfield.reconstruct.points import Points

    run = resume(folder, 1)
    check_truth(run)
    points = Points.load(run.need("points.parquet", "reconstruct"))
    calibration = Calibration.load(run.need("calibration.json", "calibrate"))
    data = view_data(Job.of(run.scene, run.source))
    return replace(data, actual=actual_of(data.job.world, data.target, calibration, points))


def _open(page: Path) -> None:
    """Show a page in the browser. Raises `TestfieldError` where there is none."""
    import webbrowser

    from testfield.errors import TestfieldError

    if not webbrowser.open(page.resolve().as_uri()):
        raise TestfieldError("no browser was found to open the page with", "--open", f"open {page} yourself")
