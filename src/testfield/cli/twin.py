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
    from testfield.cli.photographs import images_in
    from testfield.cli.show import jobs_of
    from testfield.detect.target_spec import parse_target
    from testfield.errors import TestfieldError
    from testfield.measure.job_file import JOB, load_job
    from testfield.measure.seen import seen_in
    from testfield.scene.load import load_scene
    from testfield.store.text import write_text
    from testfield.targets.field_file import load_field_file

    job = load_job(args.run / JOB)
    named = job.option("--field")
    if named is None or job.cameras:
        raise TestfieldError(
            "a twin is written of a job of one camera that was measured with a field file",
            str(args.run / JOB),
            "measure again with --field FIELD.toml, whose [target] says what --target did (scenes/README.md)",
        )
    measured = Measured.load(args.run)
    field, source = load_field_file(Path(named)), Path(named)
    target = parse_target(field.target.kind, f"{source}, target.kind")
    say = sys.stderr if args.json else sys.stdout
    wanted, photographs = set(measured.observations.stations), []
    for _, path in images_in(job.images):
        if path.stem in wanted:
            photographs.append(read_photograph(path, job.option("--bayer")))
    if not photographs:
        raise TestfieldError("none of the job's photographs is where it was", str(job.images[0]), "put them back")
    seen = seen_in(photographs, measured.observations)
    name = f"twin-{args.run.resolve().name}"
    twin = twin_of(
        name, measured.calibration, measured.points, measured.observations, field, target, seen, source.parent
    )
    path = args.scene or out / "twin.toml"
    if args.scene is None:
        head = "".join(f"# {line}\n" for line in (f"Made by testfield twin of {args.run}.", *twin.notes))
        write_text(path, head + "\n" + tomli_w.dumps(twin.scene))
    scene = load_scene(path)
    colours = "bright on dark" if seen.white_on_black else "dark on bright"
    print(
        f"{len(photographs)} photographs: dots {seen.ink_dn:.0f} DN, around them {seen.ground_dn:.0f} DN ({colours}); "
        f"blur {seen.blur_px:.2f} px; noise {seen.read_noise_e / seen.gain_e_per_dn:.2f} DN in the dark, "
        f"{seen.gain_e_per_dn:.3g} e-/DN; {seen.bits} bits",
        file=say,
    )
    for note in twin.notes:
        print(f"note: {note}", file=say)
    print(f"scene: {path}", file=say)
    if not (args.measure or args.scene):
        if args.json:
            print(json.dumps({"scene": str(path), "seen": asdict(seen), "notes": list(twin.notes)}))
        return 0
    run, _ = complete(path, out / "run", jobs=jobs_of(args.jobs), stages=("render", "expose"))
    _measure_again(run.folder / "frames", job.options, out / "measured")
    again = Measured.load(out / "measured")
    rows, why = compared(measured, again, scene), reasons(measured, again)
    if args.json:
        print(
            json.dumps(
                {
                    "scene": str(path),
                    "seen": asdict(seen),
                    "notes": list(twin.notes),
                    "rows": [asdict(row) for row in rows],
                    "reasons": why,
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
    return 0


def _measure_again(frames: Path, options: tuple[str, ...], out: Path) -> None:
    """Measure rendered frames as the job was measured. Raises `TestfieldError` as `testfield measure` does."""
    import contextlib
    import sys

    from testfield.cli.main import parser

    again = parser().parse_args(["measure", str(frames), *options, "--out", str(out)])
    with contextlib.redirect_stdout(sys.stderr):
        again.act(again)
