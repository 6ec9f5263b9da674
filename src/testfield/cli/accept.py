"""`testfield accept RUN`: what a standard would ask of a finished run, computed as in VDI/VDE 2634."""

import argparse
from pathlib import Path
from typing import Any

MOST_ROWS = 40


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "accept", help="length measurement errors and a verdict, computed as in VDI/VDE 2634", description=__doc__
    )
    p.add_argument("run", type=Path, metavar="RUN", help="a finished run's folder")
    p.add_argument("--a-mm", type=float, metavar="A", help="limit E = A + K L of the error, instead of the scene's")
    p.add_argument("--k-ppm", type=float, metavar="K", help="the part that grows with the length (default: 0)")
    p.add_argument("--b-mm", type=float, metavar="B", help="the most that the limit may be (default: none)")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Judge the run, print the verdict and the table, and write `accept.html` into the run's folder.

    The exit status is 1 where a limit was given and the run does not pass: it failed, or lengths are missing.
    """
    from testfield.chain.run import scene_of
    from testfield.store.lock import only_writer
    from testfield.store.threads import one_blas_thread

    asked = _limit(args)
    scene_of(args.run)
    with only_writer(args.run), one_blas_thread():
        return _judge(args, asked)


def _judge(args: argparse.Namespace, asked: tuple[float, ...] | None) -> int:
    import json

    from testfield.calibrate.calibration import Calibration
    from testfield.chain.belongs import check_truth
    from testfield.chain.run import resume
    from testfield.chain.stages import remarks
    from testfield.cli.show import show_warnings
    from testfield.reconstruct.points import Points
    from testfield.report.accept import accept_page
    from testfield.score.acceptance import acceptance
    from testfield.score.length_test import Limit, limit_of
    from testfield.score.scorecard import plain
    from testfield.store.digests import digest
    from testfield.store.text import write_text

    run = resume(args.run, 1)
    check_truth(run)
    calibration = Calibration.load(run.need("calibration.json", "calibrate"))
    points = Points.load(run.need("points.parquet", "reconstruct"))
    card, lengths = acceptance(run.scene, run.world, calibration, points, None if asked is None else Limit(*asked))
    limit = None if card["verdict"] is None else limit_of(card["verdict"])
    warnings = remarks(run)
    html = accept_page(run.world, card, lengths, limit, warnings)
    run.ledger.make("accept.html", digest(html), lambda path: write_text(path, html))
    show_warnings(warnings)
    if args.json:
        print(json.dumps(plain(card), allow_nan=False))
    else:
        _show(card, args.run / "accept.html")
    return 0 if card["verdict"] is None or card["verdict"]["verdict"] == "passed" else 1


def _limit(args: argparse.Namespace) -> tuple[float, ...] | None:
    """A, K and B as given. Raises `TestfieldError` where they are no limit."""
    from testfield.errors import TestfieldError

    for name in ("a_mm", "k_ppm", "b_mm"):
        value = getattr(args, name)
        if value is not None and not 0 <= value < float("inf"):
            raise TestfieldError(f"value {value} is no limit", f"--{name.replace('_', '-')}", "give 0 or more")
    if args.a_mm is None:
        if args.k_ppm is not None or args.b_mm is not None:
            raise TestfieldError("K or B alone is no limit", "--a-mm", "give A too, 0 if there is none")
        return None
    return (args.a_mm, args.k_ppm or 0.0, float("inf") if args.b_mm is None else args.b_mm)


def _show(card: dict[str, Any], page: Path) -> None:
    import textwrap

    from testfield.cli.colour import bad, judged
    from testfield.report.accept import sentence

    print(f"{textwrap.fill(f'{sentence(card)} Computed as in VDI/VDE 2634 part 1.', 110)}\n")
    rows, verdict, found = card["rows"], card["verdict"], card["lengths"]
    shown = sorted(rows, key=lambda row: -abs(row["dl_mm"]))[:MOST_ROWS] if len(rows) > MOST_ROWS else rows
    width = max(len(row["line"]) for row in shown)
    limit = "     E, mm" if verdict else ""
    print(f"{'line':<{width}}  {'ends':>9}      l_k, mm      l_m, mm    dl, mm  u(l_m), mm    E_n{limit}")
    for row in shown:
        ends = "-".join(str(code) for code in row["codes"])
        line = (
            f"{row['line']:<{width}}  {ends:>9}  {row['calibrated_mm']:11.4f}  {row['measured_mm']:11.4f}  "
            f"{row['dl_mm']:+8.4f}  {row['u_measured_mm']:10.4f}  {row['en']:+5.2f}"
        )
        print(line + (f"  {row['limit_mm']:8.4f}{'' if row['within'] else bad('  outside')}" if verdict else ""))
    if len(shown) < len(rows):
        print(f"the {len(shown)} largest of {len(rows)} errors; all with --json")
    print(f"\n{found['rule']}")
    if found["missing"]:
        print(f"{len(found['missing'])} lengths were not measured: an end was not reconstructed")
    for title, value in _figures(card):
        print(f"  {title:<52}  {value}")
    for row in card["arrangement"] or ():
        said = judged(row["met"], "met" if row["met"] else f"NOT met, asked: {row['asked']}")
        print(f"  {row['what'] + ': ' + row['found']:<52}  {said}")
    print(f"\n  page  {page}")


def _figures(card: dict[str, Any]) -> list[tuple[str, str]]:
    found, points, envelope = card["lengths"], card["points"], card["lengths"]["envelope"]
    rows = [
        (
            "largest |dl|; mean; rms",
            f"{found['max_abs_dl_mm']:.4f}; {found['mean_dl_mm']:+.4f}; {found['rms_dl_mm']:.4f} mm",
        )
    ]
    if slope := found["slope"]:
        rows.append(
            (
                "slope of dl over L; 95 % by what was claimed",
                f"{slope['slope_ppm']:+.2f} ppm; {slope['ci_low_ppm']:+.2f} to {slope['ci_high_ppm']:+.2f}",
            )
        )
    rows.append(("smallest envelope, A and K", f"{envelope['a_mm']:.4f} mm + {envelope['k_ppm']:.2f} ppm L"))
    if spacing := card["spacing"]:
        rows.append((f"spacing of targets, largest of {spacing['spacings']} errors", f"{spacing['max_abs_mm']:.4f} mm"))
    rows += [(f"flatness error, {plane['plane']}", f"{plane['error_mm']:.4f} mm") for plane in card["flatness"]]
    if "rmse_mm" in points:
        band = points["anees_band_95"]
        rows += [
            (
                "relative accuracy: largest distance over sigma; RMSE",
                f"1 : {points['relative_accuracy_sigma']:,.0f}; 1 : {points['relative_accuracy_rmse']:,.0f}",
            ),
            ("external over internal accuracy", f"{points['external_over_internal']:.2f}"),
            ("check points within 95 % ellipsoids", f"{100 * points['coverage_95']:.1f} %"),
            (
                "NEES per degree of freedom (95 % of true claims)",
                f"{points['anees']:.2f} ({band[0]:.2f} to {band[1]:.2f})",
            ),
        ]
    share = points["of_lengths"]
    rows.append(("lengths with |E_n| <= 1; worst E_n", f"{100 * share['en_within_1']:.1f} %; {share['en_worst']:+.2f}"))
    return rows
