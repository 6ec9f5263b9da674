"""What the study on stitched boards found."""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binom, chi2

from testfield.study.chain_growth import grown
from testfield.study.stitching import CHAIN, LONG_CHAIN, PRINT_MM, cases
from testfield.study.stitching_figures import draw_chain, draw_counts, draw_coverage, draw_faults
from testfield.study.stitching_scenes import PITCH_MM
from testfield.study.study import Findings, Plot, Study, Table

GOOD_PX = 0.02
"""A lens known this well at the image's corners costs little beside the error of a mark's centre."""
CLAIM = (
    "Small two-dimensional boards, placed freely and joined through their coded targets, make one large virtual board: "
    "they are stitched without errors, and calibrate a camera as a full-size board would."
)
TARGETS = ("planned", "flat", "random")


def read(table: pd.DataFrame) -> Findings:
    """Verdict, answers, tables and figures from the rows of the cases."""
    fields = _named(table[table["experiment"] != "chain"])
    counts, cuts, faults = _counts(fields), _cuts(fields), _faults(fields)
    links = _links(table[table["experiment"] == "chain"])
    figures = _figures(counts, cuts, faults, links, table)
    short, long = links[links["boards"] == CHAIN], links[links["boards"] == LONG_CHAIN]
    everywhere = counts[counts["quantity"] == "corner_px"].rename(columns={"target": "name"})
    plots = [
        Plot("stitching_counts", "How many boards, and against whom",
             "Medians over worlds; bars are the medians' 95 % intervals (of fewer than six worlds, their range). Lines "
             "and full marks: pixels drawn at the physical bound. Open marks, and ChArUco: rendered images. Horizontal: "
             "one board shown all over the image from close by.", counts, draw_counts, (9.6, 4.2), 2),
        Plot("stitching_chain", "How errors grow along a chain",
             f"Boards of a row {PITCH_MM:.0f} mm apart; bars are 95 % intervals of the rms. The law takes the scatter of "
             "links from the same worlds and knows nothing of the boards' print errors.",
             short, draw_chain, (9.6, 7.2), 2, 2),
        Plot("stitching_faults", "Bent boards, and boards with a scale of their own",
             "Six planned boards, whose sheets know nothing of it. The full-size board is bent with the same curvature, "
             "so its bow is 25 times as large. Open marks: rendered images.", faults, draw_faults, (9.6, 3.8), 2),
        Plot("stitching_coverage", "How much of the image must be covered",
             "Left: twelve planned boards, observations outside the middle of the image left out, against as many drawn "
             "from all over it. Right: every field of the study, drawn pixels.",
             pd.concat([cuts.assign(what="cut"), everywhere[everywhere["evidence"] == "drawn"].assign(what="field")]),
             draw_coverage, (9.6, 3.8), 2),
    ]  # fmt: skip
    if len(long):
        plots.insert(2, Plot("stitching_long_chain", f"The same with {LONG_CHAIN} boards", "As above; drawn pixels only.",
                             long, draw_chain, (9.6, 7.2), 2, 2))  # fmt: skip
    return Findings(_verdict(figures), _sentences(figures), _tables(counts, links, faults, cuts), plots, figures)


# ------------------------------------------------------------------------------------------------- statistics


def median_of(values: np.ndarray) -> dict[str, float]:
    """Median with the 95 % interval that order statistics give whatever the distribution; of fewer than six values
    their range. What is not finite counts as beyond all."""
    v = np.sort(np.where(np.isfinite(values), values, np.inf))
    k = int(binom.ppf(0.025, len(v), 0.5))
    middle = float(v[(len(v) - 1) // 2 : len(v) // 2 + 1].mean())
    return {
        "worlds": len(v),
        "median": middle,
        "low": float(v[max(k - 1, 0)]),
        "high": float(v[min(len(v) - k, len(v) - 1)]),
    }


def rms_of(values: np.ndarray) -> tuple[float, float, float]:
    """Root mean square and its 95 % interval for errors that are normal about zero."""
    n, rms = len(values), float(np.sqrt(np.mean(np.square(values))))
    return rms, rms * np.sqrt(n / chi2.ppf(0.975, n)), rms * np.sqrt(n / chi2.ppf(0.025, n))


def _named(fields: pd.DataFrame) -> pd.DataFrame:
    """The rows with what readers call their target, by method."""
    named = fields.copy()
    alone = named["target"].isin(TARGETS) & (named["method"] == "zhang")
    named.loc[alone, "target"] = "one of them alone"
    for method, name in (("opencv", "ChArUco, OpenCV"), ("stitched", "ChArUco, this bundle")):
        named.loc[(named["target"] == "charuco") & (named["method"] == method), "target"] = name
    return named


QUANTITIES = ("corner_px", "check_rmse_mm", "mother_rms_mm")


def _counts(fields: pd.DataFrame) -> pd.DataFrame:
    rows = fields[(fields["experiment"] == "count") & (fields["cut"] == "") & (fields["method"] != "stitched_given")]
    found = []
    for (target, boards, evidence), part in rows.groupby(["target", "boards", "evidence"]):
        for quantity in QUANTITIES:
            values = part[quantity] if quantity in part else pd.Series(dtype=float)
            # Without check targets there is nothing to say; a calibration that gives no points is beyond all.
            if quantity != "corner_px" and not values.notna().any():
                continue
            found.append(
                {"target": target, "boards": int(boards), "evidence": evidence, "quantity": quantity}
                | median_of(values.to_numpy(float))
                | {"coverage": part["coverage"].median(), "sigma0": part["sigma0"].median(),
                   "interior_nees": part["interior_nees"].mean(), "boards_nees": part["boards_nees"].mean(),
                   "check_nees": part["check_nees"].mean() if "check_nees" in part else np.nan}
            )  # fmt: skip
    return pd.DataFrame(found)


def _cuts(fields: pd.DataFrame) -> pd.DataFrame:
    rows = fields[fields["cut"] != ""]
    found = [
        {"name": cut, "window": window, "evidence": evidence} | median_of(part["corner_px"].to_numpy(float))
        | {"observations": part["observations"].median(), "coverage": part["coverage"].median()}
        for (cut, window, evidence), part in rows.groupby(["cut", "window", "evidence"])
    ]  # fmt: skip
    columns = ["name", "window", "evidence", "worlds", "median", "low", "high", "observations", "coverage"]
    return pd.DataFrame(found, columns=columns)


def _faults(fields: pd.DataFrame) -> pd.DataFrame:
    rows = fields[fields["experiment"].isin(["bent", "scale"])]
    found = [
        {"experiment": experiment, "target": target, "level": level, "evidence": evidence}
        | median_of(part["check_rmse_mm"].to_numpy(float))
        | {"corner_px": part["corner_px"].median(), "mother_rms_mm": part["mother_rms_mm"].median(),
           "sigma0": part["sigma0"].median(), "check_nees": part["check_nees"].median(),
           "test_passed": part["test_passed"].astype(float).mean()}
        for (experiment, target, level, evidence), part in rows.groupby(["experiment", "target", "level", "evidence"])
    ]  # fmt: skip
    columns = ["experiment", "target", "level", "evidence", "worlds", "median", "low", "high", "corner_px",
               "mother_rms_mm", "sigma0", "check_nees", "test_passed"]  # fmt: skip
    return pd.DataFrame(found, columns=columns)


def _links(chains: pd.DataFrame) -> pd.DataFrame:
    """Of every board of a chain the error across it, what was claimed, and what the law predicts."""
    found: list[dict[str, Any]] = []
    for (boards, sigma, evidence, wide), part in chains.groupby(["boards", "level", "evidence", "wide"]):
        for axis in ("out", "up"):
            shift, turn = part[f"shift_{axis}_mm"], part[f"turn_{axis}_rad"]
            s, t, shared = np.sqrt((shift**2).mean()), np.sqrt((turn**2).mean()), float((shift * turn).mean())
            lag = _lag(part.pivot_table(index="world", columns="links", values=turn.name).to_numpy())
            for k, here in part.groupby("links"):
                rms, low, high = rms_of(here[f"{axis}_mm"].to_numpy())
                found.append(
                    {"boards": int(boards), "print_mm": sigma, "evidence": evidence, "wide": int(wide), "axis": axis,
                     "links": int(k), "worlds": len(here), "rms_mm": rms, "low_mm": low, "high_mm": high,
                     "claimed_mm": float(np.sqrt((here[f"u_{axis}_mm"] ** 2).mean())),
                     "law_mm": float(np.sqrt(grown(k, s, t, PITCH_MM))),
                     "law_shared_mm": float(np.sqrt(np.maximum(grown(k, s, t, PITCH_MM, shared), 0))),
                     "shift_mm": s, "turn_mrad": 1e3 * t, "turn_lag": lag, "nees": here["nees"].mean(),
                     "mother_rms_mm": float(np.sqrt((here["mother_rms_mm"] ** 2).mean()))}
                )  # fmt: skip
    columns = ["boards", "print_mm", "evidence", "wide", "axis", "links", "worlds", "rms_mm", "low_mm", "high_mm",
               "claimed_mm", "law_mm", "law_shared_mm", "shift_mm", "turn_mrad", "turn_lag", "nees",
               "mother_rms_mm"]  # fmt: skip
    return pd.DataFrame(found, columns=columns)


def _lag(turns: np.ndarray) -> float:
    """Correlation of neighbouring links' turns (worlds, links) about zero; NaN of a single link."""
    if turns.shape[1] < 2:
        return float("nan")
    return float((turns[:, 1:] * turns[:, :-1]).mean() / (turns**2).mean())


# ------------------------------------------------------------------------------------------------- answers


def _value(frame: pd.DataFrame, column: str, **where: Any) -> float:
    """The one value of `column` where all conditions hold; NaN where there is no such row."""
    for name, value in where.items():
        frame = frame[frame[name] == value]
    return float(frame[column].iloc[0]) if len(frame) else float("nan")


def _figures(
    counts: pd.DataFrame, cuts: pd.DataFrame, faults: pd.DataFrame, links: pd.DataFrame, table: pd.DataFrame
) -> dict[str, Any]:
    """The key numbers by name."""
    drawn = counts[counts["evidence"] == "drawn"]
    planned = drawn[(drawn["target"] == "planned") & (drawn["quantity"] == "corner_px")].sort_values("boards")
    good = planned[planned["high"] <= GOOD_PX]
    most = int(planned["boards"].max()) if len(planned) else 0
    figures: dict[str, Any] = {"most_boards": most, "enough_boards": int(good["boards"].min()) if len(good) else 0}
    figures["enough_coverage"] = float(good["coverage"].min()) if len(good) else float("nan")
    for quantity, unit in (("corner_px", "corner_px"), ("check_rmse_mm", "check_mm"), ("mother_rms_mm", "mother_mm")):
        part = drawn[drawn["quantity"] == quantity]
        for name, target, boards in (
            ("one", "planned", 1), ("three", "planned", 3), ("planned", "planned", most), ("flat", "flat", most),
            ("random", "random", most), ("random_three", "random", 3), ("flat_three", "flat", 3),
            ("full", "full-size", most), ("full_three", "full-size", 3), ("close", "sub-board, close", 1),
        ):  # fmt: skip
            for column, end in (("median", ""), ("low", "_low"), ("high", "_high")):
                figures[f"{name}_{unit}{end}"] = _value(part, column, target=target, boards=boards)
    rendered = counts[(counts["evidence"] == "rendered") & (counts["quantity"] == "corner_px")]
    charuco = rendered[rendered["target"] == "ChArUco, OpenCV"]["boards"]
    figures["charuco_boards"] = int(charuco.max()) if len(charuco) else 0
    for name, target, boards in (
        ("charuco_opencv", "ChArUco, OpenCV", figures["charuco_boards"]),
        ("charuco_bundle", "ChArUco, this bundle", figures["charuco_boards"]),
        ("planned_as_charuco", "planned", figures["charuco_boards"]), ("charuco_close", "charuco, close", 1),
        ("rendered_planned", "planned", most), ("rendered_close", "sub-board, close", 1),
    ):  # fmt: skip
        figures[f"{name}_corner_px"] = _value(rendered, "median", target=target, boards=boards)
    figures |= _cost(table, most) | _growth(links)
    for name, window, cut in (
        ("middle", 0.5, "middle"),
        ("spread", 0.5, "spread"),
        ("most", 0.8, "middle"),
        ("all", 1.0, "middle"),
    ):
        figures[f"window_{name}_px"] = _value(cuts, "median", window=window, name=cut, evidence="drawn")
    clean = _value(drawn, "median", target="planned", boards=6, quantity="check_rmse_mm")
    figures["clean_check_mm"] = clean
    for fault, level, name in (("bent", 1.0, "bent"), ("scale", 200.0, "scale")):
        for target, prefix in (("planned", name), ("full-size", f"{name}_full")):
            where = {"experiment": fault, "level": level, "target": target, "evidence": "drawn"}
            for column, end in (
                ("median", "check_mm"),
                ("sigma0", "sigma0"),
                ("test_passed", "passed"),
                ("check_nees", "nees"),
            ):
                figures[f"{prefix}_{end}"] = _value(faults, column, **where)
    return figures


def _cost(table: pd.DataFrame, most: int) -> dict[str, float]:
    """What it costs not to know where the boards are: check points in the datum's frame, stitched over given."""
    rows = table[(table["experiment"] == "count") & (table["boards"] == most) & (table["evidence"] == "drawn")
                 & (table["target"] == "planned")]  # fmt: skip
    rms = {
        method: float(np.sqrt((part["check_unfitted_mm"] ** 2).mean()))
        for method, part in rows.groupby("method") if "check_unfitted_mm" in part
    }  # fmt: skip
    return {"stitched_unfitted_mm": rms.get("stitched", np.nan), "given_unfitted_mm": rms.get("stitched_given", np.nan)}


def _growth(links: pd.DataFrame) -> dict[str, Any]:
    found: dict[str, Any] = {}
    drawn = links[links["evidence"] == "drawn"]
    for name, boards in (("chain", CHAIN), ("long", LONG_CHAIN)):
        for what, sigma in (("exact", 0.0), ("printed", PRINT_MM)):
            for wide, views in ((0, "close"), (4, "wide")):
                for axis in ("out", "up"):
                    where = {"boards": boards, "print_mm": sigma, "wide": wide, "axis": axis, "links": boards - 1}
                    for column in ("rms_mm", "low_mm", "high_mm", "claimed_mm", "law_mm", "law_shared_mm",
                                   "mother_rms_mm", "turn_lag"):  # fmt: skip
                        found[f"{name}_{what}_{views}_{axis}_{column}"] = _value(drawn, column, **where)
    for name, part in (("drawn", drawn), ("rendered", links[links["evidence"] == "rendered"])):
        found[f"chain_{name}_nees"] = float(part["nees"].mean()) if len(part) else float("nan")
        found[f"chain_{name}_worlds"] = int(part["worlds"].max()) if len(part) else 0
    return found


def _verdict(f: dict[str, Any]) -> str:
    as_full = f["planned_corner_px"] / f["full_corner_px"]
    loops = f["chain_exact_close_out_rms_mm"] / f["chain_exact_wide_out_rms_mm"]
    return (
        f"Holds as a method, not to the letter. {f['most_boards']} stitched boards know the lens at the image's corners to "
        f"{f['planned_corner_px']:.4f} px, {_times(as_full)} the error of an ideal full-size board with as many marks "
        f"({f['full_corner_px']:.4f} px). But stitching has an error: it is estimated with everything else, and what "
        f"is left of it grows along a chain to {1e3 * f['chain_printed_close_out_rms_mm']:.0f} µm after {CHAIN - 1} links "
        f"of {PITCH_MM:.0f} mm. Wide views lessen what image noise adds {_times(loops)}; nothing lessens the print errors "
        "of the board that holds the frame. And for the lens alone stitching is not needed: one small board "
        f"shown all over the image from close by reaches {f['close_corner_px']:.4f} px."
    )


def _sentences(f: dict[str, Any]) -> list[str]:
    enough = (
        f"from {f['enough_boards']} planned boards on it stays below {GOOD_PX} px (coverage {100 * f['enough_coverage']:.0f} %)"
        if f["enough_boards"] else f"none of the numbers tried stays below {GOOD_PX} px"
    )  # fmt: skip
    found = [
        f"How many: at the worst corner the camera errs by {_px(f, 'one')} with one board in the middle of the field, "
        f"{_px(f, 'three')} with three and {_px(f, 'planned')} with {f['most_boards']}; {enough}. Check points in the volume "
        f"improve from {f['one_check_mm']:.4f} to {f['planned_check_mm']:.4f} mm.",
        f"How placed, three boards: planned {_px(f, 'three')}, random {_px(f, 'random_three')}"
        + (f", flat on one wall {_px(f, 'flat_three')}" if _known(f["flat_three_corner_px"]) else "")
        + ". "
        + (
            f"With {f['most_boards']} it hardly matters: planned {f['planned_corner_px']:.4f}, random "
            f"{f['random_corner_px']:.4f}, flat {f['flat_corner_px']:.4f} px."
            if _known(f["random_corner_px"]) else ""
        )
        + " A board's own lean counts less than where in the image it is seen, as long as the stations converge and roll.",
        f"How much coverage: with {f['most_boards']} boards and only the middle half of the image's sides used, the corner "
        f"errs by {f['window_middle_px']:.3f} px; as many observations from all over the image give "
        f"{f['window_spread_px']:.4f} px. The middle 80 % give {f['window_most_px']:.4f} px, the whole "
        f"{f['window_all_px']:.4f} px. Coverage decides, not the number of marks: reach the corners.",
        f"Against an ideal full-size board: of as many marks it gives {_px(f, 'full')} for {f['most_boards']} boards and "
        f"{_px(f, 'full_three')} for three. Three small boards leave parts of the image empty that it fills.",
        f"Against one sub-board alone: left in its place it does not determine the lens at the corners "
        f"({f['one_corner_px']:.2f} px); shown all over the image in ten close views it gives {_px(f, 'close')} "
        f"({f['rendered_close_corner_px']:.4f} px on rendered images). Such views calibrate the lens, "
        "but at another distance than that of the work, and give no frame in the volume.",
        f"Against ChArUco of the area of {f['charuco_boards']} boards, rendered: OpenCV {f['charuco_opencv_corner_px']:.3f} px, "
        f"the same corners in this project's bundle {f['charuco_bundle_corner_px']:.3f} px, stitched boards "
        f"{f['planned_as_charuco_corner_px']:.4f} px; a small ChArUco from close by with OpenCV "
        f"{f['charuco_close_corner_px']:.3f} px.",
        f"What stitching costs: check points in the first board's frame err by {f['stitched_unfitted_mm']:.4f} mm with "
        f"{f['most_boards']} boards of unknown pose, and by {f['given_unfitted_mm']:.4f} mm where all poses are given "
        f"exactly. The mother board as a whole is true to {f['planned_mother_mm']:.4f} mm, the boards' print errors "
        "(0.01 mm) included.",
        *_on_growth(f),
    ]  # fmt: skip
    if _known(f["bent_check_mm"]):
        found.append(
            f"Bent by 1 mm each, six boards give check points to {f['bent_check_mm']:.3f} mm (flat: "
            f"{f['clean_check_mm']:.4f} mm), and s0 of {f['bent_sigma0']:.1f} says so; a full-size board of the same "
            f"curvature {f['bent_full_check_mm']:.3f} mm. Small boards bend less: that is their true advantage."
        )
        told = "the global test notices" if f["scale_passed"] < 0.5 else "and the global test does not notice"
        found.append(
            f"Own scale errors of 200 ppm give {f['scale_check_mm']:.4f} mm; {told} (s0 {f['scale_sigma0']:.2f}, passed in "
            f"{100 * f['scale_passed']:.0f} % of worlds). NEES of the check points becomes {f['scale_nees']:.0f}: the sheet's "
            "uncertainties do not know of it."
        )
    return found


def _on_growth(f: dict[str, Any]) -> list[str]:
    def law(key: str) -> str:
        law_um, shared_um, claimed_um = (1e3 * f[f"{key}_{end}_mm"] for end in ("law", "law_shared", "claimed"))
        return (
            f"law {law_um:.0f} µm, with the covariance of a link's shift and turn {shared_um:.0f} µm, claimed by the "
            f"bundle {claimed_um:.0f} µm"
        )

    found = [
        f"Growth by image noise alone (boards printed exactly), after {CHAIN - 1} links: out of the plane "
        f"{_um(f, 'chain_exact_close_out')} ({law('chain_exact_close_out')}); upwards {_um(f, 'chain_exact_close_up')} "
        f"({law('chain_exact_close_up')}). The law is right in form and size, and its independent links are an "
        "approximation: a link's shift and turn come from the same marks, and all links share one camera. Four wide views "
        f"bring it to {_um(f, 'chain_exact_wide_out')} and {_um(f, 'chain_exact_wide_up')}.",
        f"Growth with print errors of {PRINT_MM} mm: out of the plane {_um(f, 'chain_printed_close_out')} "
        f"({law('chain_printed_close_out')}), where images still rule; upwards {_um(f, 'chain_printed_close_up')} "
        f"({law('chain_printed_close_up')}). There the law says too much, for print errors do not accumulate as a walk: "
        "what turns a board against one neighbour turns it back against the next (neighbouring links' turns correlate by "
        f"{f['chain_printed_close_up_turn_lag']:.2f}). Those of the first board remain and turn the whole chain, in "
        f"proportion to the distance: four wide views leave {_um(f, 'chain_printed_wide_up')}. After a 6-parameter fit of "
        f"the mother board {1e3 * f['chain_printed_close_up_mother_rms_mm']:.1f} µm rms remain without and "
        f"{1e3 * f['chain_printed_wide_up_mother_rms_mm']:.1f} µm with wide views: a chain needs a frame from all its "
        "boards more than it needs loops.",
    ]  # fmt: skip
    if _known(f["long_exact_close_out_rms_mm"]):
        found.append(
            f"{LONG_CHAIN} boards printed exactly: out of the plane {_um(f, 'long_exact_close_out')} "
            f"({law('long_exact_close_out')}), with wide views over eight boards each {_um(f, 'long_exact_wide_out')}; "
            f"printed, upwards {_um(f, 'long_printed_close_up')} and {_um(f, 'long_printed_wide_up')}."
        )
    found.append(
        "What the bundle claims along the chain is true: NEES of board poses per degree of freedom "
        f"{f['chain_drawn_nees']:.2f} on drawn pixels, {f['chain_rendered_nees']:.2f} over "
        f"{f['chain_rendered_worlds']} rendered world(s)."
    )
    return found


def _known(value: float) -> bool:
    return bool(value == value)


def _px(f: dict[str, Any], name: str) -> str:
    values = [f[f"{name}_corner_px{end}"] for end in ("", "_low", "_high")]
    digits = 4 if values[0] < 0.1 else 2
    return f"{values[0]:.{digits}f} px [{values[1]:.{digits}f}, {values[2]:.{digits}f}]"


def _um(f: dict[str, Any], name: str) -> str:
    rms, low, high = (1e3 * f[f"{name}_{end}_mm"] for end in ("rms", "low", "high"))
    return f"{rms:.0f} µm [{low:.0f}, {high:.0f}]"


def _times(ratio: float) -> str:
    return f"{ratio:.1f} times"


def _tables(counts: pd.DataFrame, links: pd.DataFrame, faults: pd.DataFrame, cuts: pd.DataFrame) -> list[Table]:
    rows = []
    for (target, boards, evidence), part in counts.groupby(["target", "boards", "evidence"]):
        first = part.iloc[0]
        row = {"target": target, "boards": boards, "evidence": evidence, "worlds": first["worlds"],
               "coverage %": 100 * first["coverage"]}  # fmt: skip
        for quantity, title in (
            ("corner_px", "corner, px"),
            ("check_rmse_mm", "check points, mm"),
            ("mother_rms_mm", "mother board, mm"),
        ):
            here = part[part["quantity"] == quantity]
            row[title] = _interval(here.iloc[0]) if len(here) else "–"
        rows.append(row | {"s0": first["sigma0"], "NEES camera": first["interior_nees"],
                           "NEES boards": first["boards_nees"], "NEES check": first["check_nees"]})  # fmt: skip
    last = links[links["links"] == links["boards"] - 1]
    chain = last.drop(columns="links").assign(
        **{name: 1e3 * last[name] for name in ("rms_mm", "low_mm", "high_mm", "claimed_mm", "law_mm", "law_shared_mm",
                                                "shift_mm", "mother_rms_mm")}
    ).rename(columns=lambda name: name.replace("_mm", ", µm") if name != "print_mm" else "print, mm")  # fmt: skip
    return [
        Table("All fields", pd.DataFrame(rows), "Medians [95 % interval, of fewer than six worlds their range]; NEES: "
              "means per degree of freedom, 1 where the claims are true.", {"coverage %": "{:.0f}", "s0": "{:.3f}"}),
        Table("The last board of each chain", chain, "rms over worlds of its error out of the plane and upwards."),
        Table("Bent boards and own scales", faults, "median, low, high: RMSE of check points in mm."),
        Table("Observations confined to a part of the image", cuts, "median, low, high: error at the worst corner, px."),
    ]  # fmt: skip


def _interval(row: pd.Series) -> str:
    if not np.isfinite(row["median"]):
        return "beyond all"
    return f"{row['median']:.3g} [{row['low']:.3g}, {row['high']:.3g}]"


STUDY = Study("stitching", "The flexible stitched board", CLAIM, cases, read)
