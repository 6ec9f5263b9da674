"""`testfield bench`: this project's parts against their peers."""

import argparse
import os
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from testfield.cli.clusters import add_cluster, cluster_of
from testfield.cli.colour import judged
from testfield.store.text import read_text


def add(commands: Any) -> None:
    """Enter the command, and each tool with the options that it has."""
    p = commands.add_parser("bench", help="compare parts with their peers, as ratios of one run", description=__doc__)
    tools = p.add_subparsers(dest="what", required=True, metavar="TOOL")

    one = _tool(tools, "render", _render, "the fast renderer against plain path tracing")
    one.add_argument("--scene", type=Path, metavar="SCENE", help="what is rendered (default: shadowed_board)")

    one = _tool(tools, "detect", _detect, "every centroid estimator against the physical limit")
    one.add_argument("--quick", action="store_true", help="a few minutes' worth")
    one.add_argument("--only", choices=("series", "speed"), help="one of its two parts")
    one.add_argument(
        "--out", type=Path, default=Path("renders"), metavar="FOLDER", help="where the page and finished cases go"
    )

    one = _tool(tools, "recall", _recall, "targets found and read in rendered clutter")
    one.add_argument("--targets", type=int, default=20000, metavar="N", help="how many are rendered (default: 20000)")
    one.add_argument("--empty", type=int, default=50, metavar="N", help="views without targets (default: 50)")
    one.add_argument("--quick", action="store_true", help="1,000 targets and 5 views at most")
    one.add_argument(
        "--hard", action="store_true", help="curves of dots that are small, dense, jagged, half in shade or at a border"
    )
    one.add_argument(
        "--kinds",
        action="store_true",
        help="every kind of target over size, tilt, noise and blur, beside public detectors of its kind",
    )
    one.add_argument("--pictures", type=int, metavar="N", help="of --kinds, pictures a step (default: 4; quick: 1)")
    one.add_argument("--out", type=Path, metavar="FOLDER", help="of --kinds, where a page of curves goes")

    one = _tool(tools, "adjust", _adjust, "the bundle against Ceres, COLMAP and OpenCV, and how its time grows")
    one.add_argument("--quick", action="store_true", help="small networks only: half a minute's worth")
    parts = ("ceres", "covariance", "opencv", "growth", "large")
    one.add_argument("--only", choices=parts, help="one of its parts; large: 400 images, 640,000 observations")
    one.add_argument("--against", type=Path, metavar="FOLDER", help="a checkout of another version of testfield")

    one = _tool(tools, "chain", _chain, "the whole chain from nothing, by stages, and beside it another checkout's")
    one.add_argument("--scene", type=Path, metavar="SCENE", help="what is run (default: quick)")
    one.add_argument("--against", type=Path, metavar="FOLDER", help="a checkout of another version of testfield")
    one.add_argument("--times", type=int, default=3, metavar="N", help="runs, of each in turns (default: 3)")

    one = _tool(
        tools, "claims", _claims, "claimed covariances against errors, over drawn worlds or new exposures of a run"
    )
    one.add_argument("--scene", type=Path, metavar="SCENE", help="whose worlds are drawn (default: quick)")
    one.add_argument("--run", type=Path, metavar="RUN", help="the folder of a rendered run to expose again instead")
    one.add_argument("--trials", type=int, default=50, metavar="N", help="worlds or exposures (default: 50)")
    one.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (default: 1)")
    one.add_argument(
        "--out",
        type=Path,
        metavar="FOLDER",
        help="of drawn worlds: where finished ones are kept (default: renders/claims)",
    )
    add_cluster(one)

    one = _tool(tools, "compare", _comparisons, "words and intervals of comparisons whose truth is known")
    one.add_argument("--trials", type=int, default=1000, metavar="N", help="comparisons drawn (default: 1000)")
    one.add_argument("--rendered", action="store_true", help="what common noise is worth on rendered scenes instead")
    one.add_argument("--draws", type=int, default=12, metavar="N", help="of noise in each rendered scene (default: 12)")
    one.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes (default: one a core)"
    )
    one.add_argument(
        "--out", type=Path, default=Path("renders/common_noise"), metavar="FOLDER", help="where finished cases are kept"
    )

    one = _tool(tools, "executor", _executor, "the executor and Dask against a bare loop, and two workers against one")
    one.add_argument("--work", choices=("sleep", "compute"), default="sleep", help="what cases do (default: sleep)")
    one.add_argument("--cases", type=int, default=40, metavar="N", help="(default: 40)")
    one.add_argument("--seconds", type=float, default=1.0, metavar="S", help="that each sleeps (default: 1)")

    one = _tool(
        tools, "scale", _scale, "what becomes of a table on many workers: costs measured here, the rest simulated"
    )
    one.add_argument("--cases", type=int, default=100_000, metavar="N", help="(default: 100000)")
    one.add_argument("--workers", type=int, default=1000, metavar="N", help="(default: 1000)")
    one.add_argument("--seconds", type=float, default=30.0, metavar="S", help="that a case takes (default: 30)")

    one = _tool(tools, "cameras", _cameras, "several cameras together against each one alone, on a run's images")
    one.add_argument("run", type=Path, metavar="RUN", help="the folder of a run with several cameras")

    one = _tool(tools, "plan", _plan, "predicted against rendered scatter, proposed networks against random ones, time")
    one.add_argument("--only", choices=("time", "design", "rendered"), help="one of its three parts")
    one.add_argument("--scenes", nargs="+", metavar="SCENE", help="what is rendered and exposed again and again")
    one.add_argument("--trials", type=int, default=20, metavar="N", help="exposures of each (default: 20)")
    one.add_argument(
        "--out", type=Path, default=Path("renders/plan"), metavar="FOLDER", help="where finished runs and trials go"
    )


def _tool(tools: Any, name: str, act: Callable[[argparse.Namespace], int], what: str) -> argparse.ArgumentParser:
    p: argparse.ArgumentParser = tools.add_parser(name, help=what, description=f"{what[0].upper()}{what[1:]}.")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.set_defaults(act=act)
    return p


def _cameras(args: argparse.Namespace) -> int:
    from testfield.bench.cameras import lines, together_and_alone
    from testfield.chain.run import resume
    from testfield.score.scorecard import plain

    return _say(args, {"cameras": plain(together_and_alone(resume(args.run, 1)))}, lines)


def _executor(args: argparse.Namespace) -> int:
    from testfield.bench.executor import bench_executor, lines

    _at_least(1, args.cases, "--cases")
    return _say(args, bench_executor(args.work, args.cases, args.seconds, _tell), lines)


def _scale(args: argparse.Namespace) -> int:
    from testfield.bench.scale import bench_scale
    from testfield.bench.scale_table import lines
    from testfield.errors import TestfieldError

    for option, value in (("--cases", args.cases), ("--workers", args.workers), ("--seconds", args.seconds)):
        if not value > 0:
            raise TestfieldError(f"value {value:g} is too few", option, "give more than 0")
    return _say(args, bench_scale(args.cases, args.workers, args.seconds, _tell), lines)


def _comparisons(args: argparse.Namespace) -> int:
    import json

    from testfield.bench.comparisons import LEAST_TRIALS, bench_comparisons
    from testfield.evaluate.check import all_passed, table

    if args.rendered:
        return _rendered(args)
    _at_least(LEAST_TRIALS, args.trials, "--trials")
    checks = bench_comparisons(args.trials, _tell)
    print(json.dumps({"checks": [check.row() for check in checks]}) if args.json else table(checks))
    return 0 if all_passed(checks) else 1


def _rendered(args: argparse.Namespace) -> int:
    """What common noise is worth. Exit status 1 only where the noise is not the same or the arithmetic is wrong: how
    much it is worth is the images' to say."""
    import json

    from testfield.bench.rendered_noise import LEAST_DRAWS, SEVERAL, bench_rendered_noise
    from testfield.cli.show import jobs_of
    from testfield.evaluate.check import all_passed, table
    from testfield.store.lock import only_writer

    _at_least(LEAST_DRAWS, args.draws, "--draws")
    with only_writer(args.out):
        checks = bench_rendered_noise(args.draws, args.out, jobs_of(args.jobs), _tell)
    print(json.dumps({"checks": [check.row() for check in checks]}) if args.json else table(checks))
    return 0 if all_passed([check for check in checks if check.limit is not SEVERAL]) else 1


def _plan(args: argparse.Namespace) -> int:
    from testfield.bench.plan import LEAST_TRIALS, SCENES, bench_plan, said
    from testfield.score.scorecard import plain

    _at_least(LEAST_TRIALS, args.trials, "--trials")
    found = bench_plan(args.only, tuple(args.scenes or SCENES), args.trials, args.out, _tell)
    return _say(args, plain(found), said)


def _at_least(least: int, value: int, option: str) -> None:
    """Raise `TestfieldError` where an option's number is less."""
    from testfield.errors import TestfieldError

    if value < least:
        raise TestfieldError(f"value {value} is too few", option, f"give {least} or more")


def _say(args: argparse.Namespace, figures: dict[str, Any], lines: Callable[[dict[str, Any]], Iterable[str]]) -> int:
    """Print figures as one JSON object, or as lines for people."""
    import json

    print(json.dumps(figures) if args.json else "\n".join(lines(figures)))
    return 0


def _tell(what: str) -> None:
    print(f"bench: {what}", file=sys.stderr, flush=True)


def _detect(args: argparse.Namespace) -> int:
    import json

    from testfield.bench.detect import bench_detect
    from testfield.bench.detect_page import write_page
    from testfield.bench.detect_speed import bench_speed
    from testfield.store.lock import only_writer

    figures: dict[str, Any] = {}
    with only_writer(args.out):
        if args.only != "speed":
            figures |= bench_detect(args.quick, args.out, _tell)
        if args.only != "series":
            figures |= {"speed": bench_speed(args.quick, _tell)}
        page = write_page(figures, args.out) if "series" in figures else None
    if args.json:
        print(json.dumps(figures))
        return 0
    _print_series(figures.get("series", {}))
    _print_verdicts(figures.get("verdicts", []))
    if "speed" in figures:
        speed = figures["speed"]
        for name, what in (
            ("find_centre_decode", f"find, centre, decode {speed['targets']} marks at 12 megapixels"),
            ("opencv", "OpenCV's SimpleBlobDetector on the same image"),
            ("opencv_coarse", "the same with few thresholds"),
            ("forward", "forward model of all"),
        ):
            print(f"{what:<51} {speed[f'{name}_s']:.2f} s, of the processors {speed[f'{name}_processor_s']:.2f} s")
    if page:
        print(f"\n{page}")
    return 0


def _print_series(series: dict[str, list[dict[str, Any]]]) -> None:
    from testfield.bench.centring import BEST
    from testfield.bench.detect import text

    for factor, rows in series.items():
        for row in rows:
            best = row["estimators"][BEST]
            shown = ("efficiency", "bias", "bias_by_dot", "chi2")
            figures = "  ".join(f"{k} {best[k]:.3f}" for k in shown if k in best)
            print(f"{factor:<9} {text(row['case'])}\n          {figures}  not measured {best['not_measured']}")


def _print_verdicts(verdicts: list[dict[str, Any]]) -> None:
    from testfield.bench.centring import BEST

    for v in verdicts:
        word, value = (
            judged(v["met"], "met   " if v["met"] else "MISSED"),
            "  none" if v["measured"] is None else f"{v['measured']:6.3f}",
        )
        notes = [f"{v['band'][0]:.3f} to {v['band'][1]:.3f}"] if v.get("band") else []
        notes += [f"{v['seen']:.3f} with chance"] if v.get("seen") is not None else []
        notes += [v["case"]] if "case" in v else []
        limits = " ".join(f"{sign} {v[k]:g}" for sign, k in ((">=", "least"), ("<=", "most")) if v[k] is not None)
        print(f"{word}  {BEST}, {v['of']}: {v['name']:<50} {value}  ({limits})  {'; '.join(notes)}")


def _render(args: argparse.Namespace) -> int:
    from testfield.bench.render import bench_render, blurless, lines
    from testfield.scene.build import build_world
    from testfield.scene.load import load_scene
    from testfield.scene.shipped import find_scene

    world = blurless(build_world(load_scene(find_scene(args.scene or "shadowed_board"))))
    return _say(args, bench_render(world, _tell), lines)


def _recall(args: argparse.Namespace) -> int:
    import json

    from testfield.bench.recall import bench_recall
    from testfield.cli.refuse import refuse

    rendered, of_kinds = {"targets": 20000, "empty": 50}, {"pictures": None, "out": None}
    if args.hard:
        refuse(args, "curves of hard dots", rendered | of_kinds | {"quick": False, "kinds": False})
    elif args.kinds:
        refuse(args, "curves of kinds", rendered)
    else:
        refuse(args, "rendered targets", of_kinds)
    if args.hard:
        from testfield.bench.hard_dots import bench_hard, lines

        return _say(args, bench_hard(_tell), lines)
    if args.kinds:
        from testfield.bench.recall_kinds import figures_of, said

        pictures, empty = (1, 4) if args.quick else (4, 20)
        if args.pictures is not None:
            _at_least(1, args.pictures, "--pictures")
            pictures = args.pictures
        figures = figures_of(pictures, empty, args.quick, _tell)
        if args.out is not None:
            from testfield.bench.recall_page import write_page

            _tell(f"page: {write_page(figures, args.out)}")
        return _say(args, figures, said)
    targets, empty = (min(args.targets, 1000), min(args.empty, 5)) if args.quick else (args.targets, args.empty)
    figures = bench_recall(targets, empty, _tell)
    if args.json:
        print(json.dumps(figures))
        return 0
    for verdict in figures["verdicts"]:
        word, limit = judged(verdict["met"], "met   " if verdict["met"] else "missed"), verdict["limit"]
        print(f"{word}  {verdict['name']:<62} {verdict['measured']:>7.4g}  (asked: {limit})")
    print(f"false finds in {figures['views']} views with targets: {figures['false']}")
    for band, clear in figures["clear_by_tilt"].items():
        found = figures["found_by_tilt"][band]
        print(f"tilt {band:>5} degrees: {found} found of {clear} in clear sight, {100 * found / max(clear, 1):.2f} %")
    for why, times in figures["missed"].items():
        print(f"not found: {times:>4}  {why}")
    return 0


def _adjust(args: argparse.Namespace) -> int:
    from testfield.bench.adjust import bench_adjust
    from testfield.bench.adjust_table import lines

    return _say(args, bench_adjust(args.quick, args.only, args.against, _tell), lines)


def _chain(args: argparse.Namespace) -> int:
    from testfield.bench.chain import bench_chain, lines
    from testfield.scene.shipped import find_scene

    _at_least(1, args.times, "--times")
    return _say(args, bench_chain(find_scene(args.scene or "quick"), args.against, args.times, _tell), lines)


def _claims(args: argparse.Namespace) -> int:
    import json

    from testfield.bench.claim_errors import GROUPS
    from testfield.bench.claims import over_exposures, over_worlds
    from testfield.chain.belongs import check_truth
    from testfield.chain.run import resume, scene_of
    from testfield.cli.show import jobs_of
    from testfield.evaluate.check import Check, table
    from testfield.scene.shipped import find_scene
    from testfield.store.lock import only_writer

    _at_least(2, args.trials, "--trials")
    if args.run is not None:
        scene_of(args.run)
        with only_writer(args.run), cluster_of(args, args.run) as pool:
            run = resume(args.run, jobs_of(args.jobs))
            check_truth(run)
            figures = over_exposures(run, args.trials, pool)
    else:
        scene, out = find_scene(args.scene or "quick"), args.out or Path("renders/claims")
        text = _text(scene)
        with only_writer(out), cluster_of(args, out) as pool:
            figures = over_worlds(text, scene, args.trials, out, jobs_of(args.jobs), pool)
    if args.json:
        print(json.dumps(figures))
        return 0
    for group in (name for name in GROUPS if name in figures):
        of = figures[group]
        band = "{:.3f} to {:.3f}".format(*of["nees_band_95"])
        print(f"{group.replace('_', ' '):<13} NEES per degree of freedom {of['nees']:.3f} (band {band})", end="")
        print(f"  coverage of 95 % regions {100 * of['coverage_95']:.1f} % of {of['regions']}")
    if "rmse_over_u" in figures:
        print(f"check points  RMSE {figures['rmse_mm']:.5f} mm over claimed u {figures['mean_u_mm']:.5f} mm", end="")
        print(f" = {figures['rmse_over_u']:.3f}  sigma0 {figures['sigma0']:.4f}")
    if checks := [Check.of_row(row) for row in figures.get("checks", ())]:
        print(f"\n{table(checks)}")
    return 0


def _text(scene: Path) -> str:
    from testfield.scene.load import load_scene

    load_scene(scene)  # speaks where the file is none
    return read_text(scene)
