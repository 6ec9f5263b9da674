"""`testfield plan SCENE`: what a scene will measure, predicted before any image."""

import argparse
from pathlib import Path
from typing import Any

from testfield.cli.show import add_load


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser("plan", help="predict what a scene will measure, before any image", description=__doc__)
    p.add_argument("scene", type=Path, metavar="SCENE", help="a scene file (TOML), or the name of one that comes along")
    p.add_argument("--json", action="store_true", help="print one JSON object: every point, length and parameter")
    add_load(p)
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Predict, and show it."""
    import json

    from testfield.cli.show import show_warnings
    from testfield.plan.card import card_of
    from testfield.plan.job import Job
    from testfield.plan.predict import predict_scene
    from testfield.scene.load import load_scene, numbered
    from testfield.scene.shipped import find_scene
    from testfield.score.scorecard import plain
    from testfield.store.sheets import FORMAT
    from testfield.store.threads import one_blas_thread

    path = find_scene(args.scene)
    scene = load_scene(path)
    with one_blas_thread(), numbered(path.read_bytes(), str(path)):
        found = predict_scene(Job.of(scene, str(path)))
        card = card_of(found)
    show_warnings(card["warnings"])
    if args.json:
        print(json.dumps({"format": FORMAT, "file": str(path)} | plain(card), indent=1, allow_nan=False))
    else:
        show(card)
    return 0


def show(card: dict[str, Any]) -> None:
    """The prediction as tables."""
    print(f"{card['scene']}: predicted, standard uncertainties (k = 1)\n")
    rows = figures(card)
    width = max(len(title) for title, _ in rows)
    for title, value in rows:
        print(f"  {title:<{width}}  {value}")
    if card["boards"]["boards"]:
        print(
            f"\n  {'board':<16} {'images':>6} {'u position, mm':>15} {'u turn, mrad':>13} {'points held by it, mm':>22}"
        )
        datum = {row["board"]: row["u_rms_mm"] for row in card["datum"]["boards"]}
        for row in card["boards"]["boards"]:
            print(
                f"  {row['name']:<16} {row['images']:>6} {_number(row['u_position_mm'], 'datum'):>15} "
                f"{_number(row['u_turn_mrad'], ''):>13} {_number(datum.get(row['name']), ''):>22}"
            )
    lengths = card["lengths"]
    if lengths["bars"]:
        print(f"\n  {'length':<16} {'role':>8} {'certified, mm':>14} {'u, mm':>9} {'u of measured, mm':>18}")
        for row in lengths["bars"]:
            print(
                f"  {row['name']:<16} {row['role']:>8} {row['certified_mm']:>14.3f} {row['u_certified_mm']:>9.4f} "
                f"{_number(row['u_measured_mm'], 'not measured'):>18}"
            )
    if lengths["over_length"]:
        print(f"\n  {'distances of check points, mm':<30} {'pairs':>6} {'u rms, mm':>10} {'largest':>9}")
        for row in lengths["over_length"]:
            print(f"  {row['length_mm']:<30.0f} {row['pairs']:>6} {row['u_rms_mm']:>10.4f} {row['u_most_mm']:>9.4f}")
    if card["scale"]["sources"]:
        print(f"\n  {'what the scale rests on':<24} {'u, ppm':>8} {'redundancy':>11} {'smallest detectable, ppm':>25}")
        for row in card["scale"]["sources"]:
            print(
                f"  {row['source']:<24} {row['u_ppm']:>8.2f} {row['redundancy']:>11.3f} "
                f"{_number(row['detectable_ppm'], 'none', '{:.1f}'):>25}"
            )
    for note in card["notes"]:
        print(f"\n  note: {note}")


def figures(card: dict[str, Any]) -> list[tuple[str, str]]:
    """The figures that matter: title and value."""
    calibration, points, scale = card["calibration"], card["points"], card["scale"]
    rows = [
        (
            "images; observations expected; used",
            f"{card['images']}; {card['detection']['expected']}; {card['detection']['used']}",
        ),
        ("calibration: freedom; mean redundancy", f"{calibration['freedom']}; {calibration['mean_redundancy']:.3f}"),
        ("gross error found in 80 of 100, median", f"{_number(calibration['detectable_px'], 'none')} px"),
    ]
    for camera in calibration["cameras"]:
        named = f" of '{camera['name']}'" if len(calibration["cameras"]) > 1 else ""
        rows.append((f"interior orientation{named}, worst corner", f"{camera['corner_u_px']:.4f} px"))
    rows.append(("board poses, rms of their marks", f"{card['boards']['pose_rms_mm']:.4f} mm"))
    rows.append(("check points measured of those there are", f"{points['measured']} of {points['expected']}"))
    if points["u_rms_mm"] is not None:
        rows.append(
            (
                "check points, rms per coordinate; worst",
                f"{points['u_rms_mm']:.4f}; {points['u_worst_mm']:.4f} mm (target {points['worst_code']})",
            )
        )
    if points["rmse_mm"] is not None:
        rows.append(("check points, RMSE after a 6-parameter fit", f"{points['rmse_mm']:.4f} mm"))
        rows.append(("relative accuracy, field diagonal / RMSE", f"1 : {points['relative_accuracy']:,.0f}"))
    if card["datum"]["costs"] is not None:
        datum = card["datum"]
        rows.append((f"the datum, board '{datum['board']}', over inner constraints", f"{datum['costs']:.2f} times"))
    found = scale["smallest_detectable_ppm"]
    said = "none: nothing controls it" if found is None else f"{found:.1f} ppm, by '{scale['shown_by']}'"
    rows.append(("smallest scale error found in 80 of 100", said))
    return rows


def _number(value: float | None, absent: str, form: str = "{:.4f}") -> str:
    return absent if value is None or value != value or value == float("inf") else form.format(value)
