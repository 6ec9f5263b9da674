"""What `testfield plan` prints: tables of a prediction."""

from collections.abc import Iterator
from typing import Any

MOST_STATIONS = 12
"""Stations of which the worth of a second exposure is shown."""


def tables(card: dict[str, Any]) -> Iterator[list[str]]:
    """Tables in order, each as its lines."""
    rows = figures(card)
    width = max(len(title) for title, _ in rows)
    yield [f"{title:<{width}}  {value}" for title, value in rows]
    for table in (_boards, _bars, _over_length, _scale, _proposal, _exposures):
        if lines := table(card):
            yield lines
    for note in card["notes"]:
        yield [f"note: {note}"]


def figures(card: dict[str, Any]) -> list[tuple[str, str]]:
    """The figures that matter: title and value."""
    calibration, points, scale, seen = card["calibration"], card["points"], card["scale"], card["detection"]
    rows = [
        ("images; observations expected; used", f"{card['images']}; {seen['expected']}; {seen['used']}"),
        ("calibration: freedom; mean redundancy", f"{calibration['freedom']}; {calibration['mean_redundancy']:.3f}"),
        ("gross error found in 80 of 100, median", f"{number(calibration['detectable_px'], 'none')} px"),
    ]
    for camera in calibration["cameras"]:
        named = f" of '{camera['name']}'" if len(calibration["cameras"]) > 1 else ""
        rows.append((f"interior orientation{named}, worst corner", f"{camera['corner_u_px']:.4f} px"))
    rows.append(("board poses, rms of their marks", f"{card['boards']['pose_rms_mm']:.4f} mm"))
    rows.append(("check points measured of those there are", f"{points['measured']} of {points['expected']}"))
    if points["u_rms_mm"] is not None:
        worst = f"{points['u_worst_mm']:.4f} mm (target {points['worst_code']})"
        rows.append(("check points, rms per coordinate; worst", f"{points['u_rms_mm']:.4f}; {worst}"))
    if points["rmse_mm"] is not None:
        rows.append(("check points, RMSE after a 6-parameter fit", f"{points['rmse_mm']:.4f} mm"))
        rows.append(("relative accuracy, field diagonal / RMSE", f"1 : {points['relative_accuracy']:,.0f}"))
    if points["axes"]:
        x, y, z = points["axes"][0]["direction"]
        rows.append(("weakest direction", f"({x:+.2f}, {y:+.2f}, {z:+.2f}), {points['axes'][0]['u_rms_mm']:.4f} mm"))
    if card["datum"]["costs"] is not None:
        datum = card["datum"]
        rows.append((f"the datum, board '{datum['board']}', over inner constraints", f"{datum['costs']:.2f} times"))
    found = scale["smallest_detectable_ppm"]
    said = "none: nothing controls it" if found is None else f"{found:.1f} ppm, by '{scale['shown_by']}'"
    rows.append(("smallest scale error found in 80 of 100", said))
    return rows


def _boards(card: dict[str, Any]) -> list[str]:
    rows = card["boards"]["boards"]
    if not rows:
        return []
    wide = max(16, *(len(row["name"]) for row in rows))
    datum = {row["board"]: row["u_rms_mm"] for row in card["datum"]["boards"]}
    head = f"{'board':<{wide}} {'images':>6} {'u position, mm':>15} {'u turn, mrad':>13} {'points held by it, mm':>22}"
    return [head] + [
        f"{row['name']:<{wide}} {row['images']:>6} {number(row['u_position_mm'], 'datum'):>15} "
        f"{number(row['u_turn_mrad'], ''):>13} {number(datum.get(row['name']), ''):>22}"
        for row in rows
    ]


def _bars(card: dict[str, Any]) -> list[str]:
    rows = card["lengths"]["bars"]
    if not rows:
        return []
    wide = max(16, *(len(row["name"]) for row in rows))
    head = f"{'length':<{wide}} {'role':>8} {'certified, mm':>14} {'u, mm':>9} {'u of measured, mm':>18}"
    return [head] + [
        f"{row['name']:<{wide}} {row['role']:>8} {row['certified_mm']:>14.3f} {row['u_certified_mm']:>9.4f} "
        f"{number(row['u_measured_mm'], 'not measured'):>18}"
        for row in rows
    ]


def _over_length(card: dict[str, Any]) -> list[str]:
    rows = card["lengths"]["over_length"]
    head = f"{'distances of check points, mm':<30} {'pairs':>6} {'u rms, mm':>10} {'largest':>9}"
    return [head] * bool(rows) + [
        f"{row['length_mm']:<30.0f} {row['pairs']:>6} {row['u_rms_mm']:>10.4f} {row['u_most_mm']:>9.4f}" for row in rows
    ]


def _scale(card: dict[str, Any]) -> list[str]:
    rows = card["scale"]["sources"]
    head = f"{'what the scale rests on':<24} {'u, ppm':>8} {'redundancy':>11} {'smallest detectable, ppm':>25}"
    return [head] * bool(rows) + [
        f"{row['source']:<24} {row['u_ppm']:>8.2f} {row['redundancy']:>11.3f} "
        f"{number(row['detectable_ppm'], 'none', '{:.1f}'):>25}"
        for row in rows
    ]


def _proposal(card: dict[str, Any]) -> list[str]:
    found = card.get("proposal")
    if not found:
        return []
    if not found["stations"]:
        asked = f", and {found['most']:g} was asked for" if found["most"] < float("inf") else ""
        return [f"no station is needed: {found['goal']} is {found['value']:.4g} already{asked}"]
    steps = ", ".join(number(value, "none", "{:.4g}") for value in found["steps"])
    lines = [
        f"{len(found['stations'])} stations proposed of {found['candidates']} candidates; {found['goal']} with 0, 1, 2 "
        f"... of them: {steps}; after exchanges {found['value']:.4g}"
    ]
    lines.append(f"{'x, mm':>10} {'y, mm':>10} {'z, mm':>10}   looking at, mm                  roll, deg")
    for one in found["stations"]:
        x, y, z = one["position_mm"]
        at = ", ".join(f"{v:.0f}" for v in one["look_at_mm"])
        lines.append(f"{x:>10.0f} {y:>10.0f} {z:>10.0f}   {at:<31} {one['roll_deg']:>9.0f}")
    return lines


def _exposures(card: dict[str, Any]) -> list[str]:
    found = card.get("exposures")
    if not found:
        return []
    rows = ", ".join(f"{row['exposures']}: {row['value']:.4g}" for row in found["rows"])
    causes = ", ".join(f"{one['certificate']} {100 * one['falls_by']:.0f} %" for one in found["floor_from"])
    worth = ", ".join(f"{one['station']} {100 * one['gain']:.1f} %" for one in found["stations"][:MOST_STATIONS])
    return [
        f"{found['goal']} with so many exposures from every station: {rows}; never below {found['floor']:.4g}",
        f"exact, its square would then fall by: {causes}",
        f"a second exposure from one station alone lowers it by: {worth}",
    ]


def number(value: float | None, absent: str, form: str = "{:.4f}") -> str:
    """A number as text; `absent` where there is none."""
    return absent if value is None or value != value or abs(value) == float("inf") else form.format(value)
