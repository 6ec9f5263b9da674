"""`testfield uncertainty RUN`: is the linear result, the covariance that a run claims, validated by Monte Carlo?"""

import argparse
from functools import cache
from pathlib import Path
from typing import Any

from testfield.cli.clusters import add_cluster, cluster_of
from testfield.cli.colour import bad, caution, good

TRIALS = {"rays": 100_000, "calibration": 100, "exposure": 20}


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "uncertainty",
        help="whether a run's claimed uncertainties are validated by Monte Carlo (GUM supplements 1 and 2)",
        description=__doc__,
    )
    p.add_argument("run", type=Path, metavar="RUN", help="a run's folder")
    p.add_argument(
        "--depth",
        choices=tuple(TRIALS),
        default="rays",
        help="rays: pixels and calibration from their covariances, points met again; calibration: noise on all pixels "
        "and certificates, calibrated again; exposure: new noise on the same radiance, the whole chain again",
    )
    p.add_argument(
        "--trials",
        type=int,
        metavar="N",
        help="the most trials (default: rays 100000, calibration 100, exposure 20); fewer where the figures settle",
    )
    p.add_argument("--length", type=int, nargs=2, action="append", default=[], metavar=("A", "B"), help="two codes")
    p.add_argument("--digits", type=int, choices=(1, 2), default=1, help="significant digits of u that must agree")
    p.add_argument("--shortest", action="store_true", help="rays: shortest intervals instead of symmetric ones")
    p.add_argument("--jobs", type=int, default=1, metavar="N", help="calibration, exposure: processes (default: 1)")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    add_cluster(p, store=False)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Make what trials are missing, and print the statement."""
    import json
    from functools import partial

    import numpy as np

    from testfield.chain.belongs import check_truth
    from testfield.chain.progress import bar
    from testfield.chain.run import resume, scene_of
    from testfield.chain.trials import BLOCK, Trials
    from testfield.cli.refuse import refuse
    from testfield.errors import TestfieldError
    from testfield.store.kept import make_each
    from testfield.store.lock import only_writer
    from testfield.store.threads import one_blas_thread
    from testfield.uncertainty.statement import of_blocks, of_trials, quantities

    most = TRIALS[args.depth] if args.trials is None else args.trials
    least = 2 * BLOCK if args.depth == "rays" else 2
    if most < least:
        raise TestfieldError(f"value {most} is too few for the depth '{args.depth}'", "--trials", f"give {least}")
    if args.cluster is not None and args.depth == "rays":
        raise TestfieldError("trials of rays take seconds in one process", "--cluster", "choose another --depth")
    if args.depth != "rays":
        refuse(args, f"the depth '{args.depth}'", {"shortest": False})
    scene_of(args.run)
    with only_writer(args.run), cluster_of(args, args.run) as pool:
        trials = Trials(resume(args.run, 1), args.depth)
        check_truth(trials.run)
        points, field = trials.points, trials.run.field
        result = quantities(points, field, [tuple(pair) for pair in args.length])
        with bar("trials", most, "trials") as move:
            if args.depth == "rays":
                drawn: set[int] = set()

                def block(k: int) -> np.ndarray:
                    made = trials.block(k)
                    move(0 if k in drawn else len(made))
                    drawn.add(k)
                    return made

                statement = of_blocks(points, result, field, block, most, args.digits, args.shortest)
            else:
                files = [(trials.name(k), trials.key) for k in range(most)]
                here = args.jobs <= 1 and pool is None
                write = trials.write if here else partial(_write_trial, args.run.resolve(), args.depth, trials.key)
                with one_blas_thread():
                    make_each(trials.run.ledger, files, write, args.jobs, lambda _: move(1), pool)
                made = np.array([trials.trial(k) for k in range(most)])
                statement = of_trials(points, result, field, made, args.digits)
    statement = {"run": trials.run.scene.name, "depth": args.depth, "digits": args.digits} | statement
    if args.json:
        print(json.dumps(statement))
    else:
        _show(statement)
    return 0


def _write_trial(folder: Path, depth: str, key: str, number: int, path: Path) -> None:
    """What another process does: one trial of the run in a folder. Raises `TestfieldError` where its key would be
    another one: the code is not the same here."""
    _trials(folder, depth, key).write(number, path)


@cache
def _trials(folder: Path, depth: str, key: str) -> Any:
    from testfield.chain.run import resume
    from testfield.chain.trials import Trials
    from testfield.errors import TestfieldError

    trials = Trials(resume(folder, 1), depth)
    if trials.key != key:
        raise TestfieldError(
            "this worker has another run, or other code of the program or an algorithm",
            str(folder),
            "install the same versions there",
        )
    return trials


def _show(statement: dict[str, Any]) -> None:
    rows = statement["quantities"]
    interval = "mean +- k u, trials being few" if statement["gaussian_interval"] else "quantiles"
    print(
        f"{statement['run']}, depth {statement['depth']}: {statement['trials']} trials, intervals at 95 % ({interval})"
    )
    if statement["settled"]:
        print("all figures settled to a fifth of their tolerance")
    else:
        share = 100 * statement["settled_share"]
        print(
            f"{share:.0f} % of the quantities settled to a fifth of their tolerance; the others' figures are known to"
        )
        worst = max(max(r["monte_carlo"]["s_mm"]) / r["linear"]["u_mm"] for r in rows)
        print(f"{200 * worst:.1f} % of u (two standard deviations) at worst; more with --trials")
    if statement.get("incomplete"):
        print(f"{statement['incomplete']} trials lacked a point and are left out")
    check = [r for r in rows if r["check_point"]]
    if check:
        verdicts = {v: sum(r["validated"] == v for r in check) for v in ("yes", "no", "open")}
        ratio = sorted(r["monte_carlo"]["u_mm"] / r["linear"]["u_mm"] for r in check)
        worst_row = max(check, key=_excess)
        print(f"\ncoordinates of check points: {len(check)}")
        print(
            f"  validated   {100 * verdicts['yes'] / len(check):.1f} %, not {verdicts['no']}, open {verdicts['open']}"
        )
        print(f"  u, Monte Carlo over linear   {ratio[0]:.3f} to {ratio[-1]:.3f}, median {ratio[len(ratio) // 2]:.3f}")
        print(f"  worst       {_line(worst_row)}")
    print("\nlengths")
    for row in (r for r in rows if r["kind"] == "length"):
        print(f"  {_line(row)}")
    if regions := statement.get("regions"):
        k = sorted(p["k"] for p in regions["points"])
        said = "settled" if regions["settled"] else "not settled"
        print(
            f"\nellipsoids of points: k {k[0]:.4f} to {k[-1]:.4f} ({said}), of a Gaussian {regions['k_gaussian']:.4f}"
        )


def _excess(row: dict[str, Any]) -> float:
    return float(max(row["d_low_mm"], row["d_high_mm"]) / row["delta_mm"])


def _line(row: dict[str, Any]) -> str:
    line, trials = row["linear"], row["monte_carlo"]
    said = {
        "yes": good("validated"),
        "no": bad("NOT validated"),
        "open": caution("open: too few trials"),
    }[row["validated"]]
    return (
        f"{row['name']:<12} {line['value_mm']:12.4f} mm  u {line['u_mm']:.5f}  Monte Carlo u {trials['u_mm']:.5f}  "
        f"d_low {row['d_low_mm']:.5f}  d_high {row['d_high_mm']:.5f}  delta {row['delta_mm']:.5f}  {said}"
    )
