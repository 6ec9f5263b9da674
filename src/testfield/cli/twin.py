"""`testfield twin RUN`: a scene of a measured job, to ask what error to expect."""

import argparse
import os
from pathlib import Path
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "twin",
        help="a scene of a measured job: camera, stations, targets, light and noise as photographs showed them",
        description="Writes the scene of a job that `testfield measure` has measured: twin.toml, which can be changed, "
        "validated and rendered like any scene. With --measure it is rendered and measured as the job was, and the "
        "job's residuals and the twin's are printed side by side, with the twin's actual errors.",
    )
    p.add_argument("run", type=Path, metavar="RUN", help="a folder of `testfield measure`")
    p.add_argument("--out", type=Path, metavar="FOLDER", help="where the twin goes (default: RUN/twin)")
    p.add_argument("--measure", action="store_true", help="render the twin, measure it, and compare")
    p.add_argument(
        "--scene",
        type=Path,
        metavar="FILE.toml",
        help="a twin that was changed: rendered, measured and compared instead",
    )
    p.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes at once")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Look at the photographs once more, write the scene, render and measure it where asked."""
    from testfield.store.lock import only_writer
    from testfield.store.threads import one_blas_thread

    out = args.out or args.run / "twin"
    with only_writer(out), one_blas_thread():
        return _twin(args, out)


def _twin(args: argparse.Namespace, out: Path) -> int:
    import json
    import sys
    from dataclasses import asdict

    import tomli_w

    from testfield.author.twin import twin_of
    from testfield.author.twin_compare import Measured, compared, reasons
    from testfield.camera.photograph import read_photograph
    from testfield.chain.complete import complete
    from testfield.cli.show import jobs_of
    from testfield.measure.job_file import JOB, load_job
    from testfield.report.twin import write_twin
    from testfield.scene.load import load_scene
    from testfield.store.text import write_text

    job = load_job(args.run / JOB)
    field, source, beside, target, patterns = _targets(job, args.run / JOB)
    measured = Measured.load(args.run)
    say = sys.stderr if args.json else sys.stdout
    taken = _photographs(job, field, source, measured)
    seen = tuple(
        _seen_by(measured, taken, k, job.option("--bayer")) for k in range(len(measured.calibration.interiors))
    )
    name = f"twin-{args.run.resolve().name}"
    hold = tuple(word.strip() for word in (job.option("--hold") or "").split(",") if word.strip())
    twin = twin_of(
        name,
        measured.calibration,
        measured.points,
        measured.observations,
        field,
        target,
        patterns,
        seen,
        beside,
        hold,
    )
    path = args.scene or out / "twin.toml"
    if args.scene is None:
        head = "".join(f"# {line}\n" for line in (f"Made by testfield twin of {args.run}.", *twin.notes))
        write_text(path, head + "\n" + tomli_w.dumps(twin.scene))
    scene = load_scene(path)
    for camera, one in zip(measured.calibration.camera_names or ("",), seen, strict=True):
        colours = "bright on dark" if one.white_on_black else "dark on bright"
        print(
            f"{camera}{': ' * bool(camera)}marks {one.ink_dn:.0f} DN, around them {one.ground_dn:.0f} DN ({colours}); "
            f"blur {one.blur_px:.2f} px; noise {one.read_noise_e / one.gain_e_per_dn:.2f} DN in the dark, "
            f"{one.gain_e_per_dn:.3g} e-/DN; {one.bits} bits",
            file=say,
        )
    for note in twin.notes:
        print(f"note: {note}", file=say)
    print(f"scene: {path}", file=say)
    if not (args.measure or args.scene):
        if args.json:
            print(json.dumps({"scene": str(path), "seen": [asdict(one) for one in seen], "notes": list(twin.notes)}))
        return 0
    run, _ = complete(path, out / "run", jobs=jobs_of(args.jobs), stages=("render", "expose"))
    frames = _as_taken(taken, run.folder / "frames", out / "photographs") if job.cameras else [run.folder / "frames"]
    _measure_again(frames, job.options, out / "measured")
    again = Measured.load(out / "measured")
    rows, why = compared(measured, again, scene), reasons(measured, again)
    images = [
        (station, read_photograph(file, job.option("--bayer")).pixels, read_photograph(frame).pixels)
        for station, file, *_ in taken
        if (frame := run.folder / "frames" / f"{station}.png").is_file()
    ]
    drawn = write_twin(out, name, str(path), rows, why, twin.notes, images)
    if args.json:
        print(
            json.dumps(
                {
                    "scene": str(path),
                    "seen": [asdict(one) for one in seen],
                    "notes": list(twin.notes),
                    "rows": [asdict(row) for row in rows],
                    "reasons": why,
                    "page": str(drawn),
                }
            )
        )
        return 0
    print(f"{'':<46}{'photographs':>18}{'twin':>18}{'ratio':>8}")
    for row in rows:
        ratio = "" if row.ratio is None else f"{row.ratio:.2f}"
        print(f"{row.title:<46}{row.job:>18}{row.twin:>18}{ratio:>8}".rstrip())
    for reason in why:
        print(f"reason: {reason}")
    print(f"page: {drawn}")
    return 0


def _targets(job: Any, where: Path) -> tuple[Any, str, Path, Any, tuple]:
    """What the job measured. Raises `TestfieldError` where it does not say so, or where its photographs are not told
    from each other any more."""
    from testfield.cli.measure import targets_of
    from testfield.errors import TestfieldError

    field, target = job.option("--field"), job.option("--target")
    if not job.images:
        raise TestfieldError(
            "this job was measured from observations: no photograph shows its light",
            str(where),
            "measure the photographs",
        )
    given = argparse.Namespace(field=Path(field) if field else None, target=target or "ring14")
    found = targets_of(given)
    if job.cameras and not found[0].cameras and not {"--rig", "--by-folder"} & set(job.options):
        raise TestfieldError("nothing says which camera took which photograph", str(where), "measure again")
    return found


def _photographs(job: Any, field: Any, source: str, measured: Any) -> list[tuple[str, Path, str, Path]]:
    """Name, file, camera and folder of each of the job's photographs that was oriented.

    Raises `TestfieldError` where none is where it was.
    """
    from testfield.cli.cameras import owners_of
    from testfield.cli.photographs import images_in
    from testfield.errors import TestfieldError

    lens = job.option("--lens") or "brown"
    by_folder, rig = "--by-folder" in job.options, "--rig" in job.options
    owners = owners_of(list(job.images), field, source, lens, by_folder, rig) if job.cameras else None
    wanted, taken = set(measured.calibration.station_names), []
    for folder, path in images_in(job.images):
        name = owners.name_of(path.stem, folder) if owners else path.stem
        if name in wanted:
            taken.append((name, path, owners.by_folder[folder] if owners else "", folder))
    if not taken:
        raise TestfieldError("none of the job's photographs is where it was", str(job.images[0]), "put them back")
    return taken


def _seen_by(measured: Any, taken: list[tuple[str, Path, str, Path]], camera: int, bayer: str | None) -> Any:
    """What the photographs of one of the cameras show of their light."""
    from dataclasses import replace

    from testfield.camera.photograph import read_photograph
    from testfield.measure.seen import seen_in

    names = measured.calibration.camera_names
    own = [one for one in taken if not names or one[2] == names[camera]]
    return seen_in([replace(read_photograph(path, bayer), name=name) for name, path, *_ in own], measured.observations)


def _as_taken(taken: list[tuple[str, Path, str, Path]], frames: Path, out: Path) -> list[Path]:
    """Rendered frames laid out as the photographs were: a folder for each camera, names as they were."""
    import shutil

    folders: dict[Path, Path] = {}
    for name, path, _, folder in taken:
        own = folders.setdefault(folder, out / folder.name)
        own.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(frames / f"{name}.png", own / f"{path.stem}.png")
    return list(folders.values())


def _measure_again(frames: list[Path], options: tuple[str, ...], out: Path) -> None:
    """Measure rendered frames as the job was measured. Raises `TestfieldError` as `testfield measure` does."""
    import contextlib
    import sys

    from testfield.cli.main import parser

    again = parser().parse_args(["measure", *map(str, frames), *options, "--out", str(out)])
    with contextlib.redirect_stdout(sys.stderr):
        again.act(again)
