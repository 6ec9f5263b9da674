"""The rows of the study on stitched boards, summed up: medians and rms with intervals, and the key figures."""

from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binom, chi2

from testfield.study.chain_growth import grown, link_of_marks
from testfield.study.stitching_plan import CHAIN, LONG_CHAIN, PRINT_MM
from testfield.study.stitching_scenes import PITCH_MM, sub_board_marks_mm

GOOD_PX = 0.02
"""A lens known this well at the image's corners costs little beside the error of a mark's centre."""
TARGETS = ("planned", "flat", "random")


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


def named(fields: pd.DataFrame) -> pd.DataFrame:
    """The rows with what readers call their target, by method."""
    named = fields.copy()
    alone = named["target"].isin(TARGETS) & (named["method"] == "zhang")
    named.loc[alone, "target"] = "one of them alone"
    for method, name in (("opencv", "ChArUco, OpenCV"), ("stitched", "ChArUco, this bundle")):
        named.loc[(named["target"] == "charuco") & (named["method"] == method), "target"] = name
    return named


QUANTITIES = ("corner_px", "check_rmse_mm", "mother_rms_mm")


def counts_of(fields: pd.DataFrame) -> pd.DataFrame:
    """One row a target, number of boards, kind of evidence and quantity: its median over worlds."""
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


def cuts_of(fields: pd.DataFrame) -> pd.DataFrame:
    """Corner errors of calibrations that used a part of the image only."""
    rows = fields[fields["cut"] != ""]
    found = [
        {"name": cut, "window": window, "evidence": evidence} | median_of(part["corner_px"].to_numpy(float))
        | {"observations": part["observations"].median(), "coverage": part["coverage"].median()}
        for (cut, window, evidence), part in rows.groupby(["cut", "window", "evidence"])
    ]  # fmt: skip
    columns = ["name", "window", "evidence", "worlds", "median", "low", "high", "observations", "coverage"]
    return pd.DataFrame(found, columns=columns)


def faults_of(fields: pd.DataFrame) -> pd.DataFrame:
    """Corner errors, check points and signs of trouble of bent boards and of boards with scales of their own."""
    rows = fields[fields["experiment"].isin(["bent", "scale"])]
    found = [
        {"experiment": experiment, "target": target, "level": level, "evidence": evidence}
        | median_of(part["corner_px"].to_numpy(float))
        | {"check_rmse_mm": part["check_rmse_mm"].median(), "mother_rms_mm": part["mother_rms_mm"].median(),
           "sigma0": part["sigma0"].median(), "check_nees": part["check_nees"].median(),
           "test_passed": part["test_passed"].astype(float).mean()}
        for (experiment, target, level, evidence), part in rows.groupby(["experiment", "target", "level", "evidence"])
    ]  # fmt: skip
    columns = ["experiment", "target", "level", "evidence", "worlds", "median", "low", "high", "check_rmse_mm",
               "mother_rms_mm", "sigma0", "check_nees", "test_passed"]  # fmt: skip
    return pd.DataFrame(found, columns=columns)


def links_of(chains: pd.DataFrame) -> pd.DataFrame:
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


def _value(frame: pd.DataFrame, column: str, **where: Any) -> float:
    """The one value of `column` where all conditions hold; NaN where there is no such row."""
    for name, value in where.items():
        frame = frame[frame[name] == value]
    return float(frame[column].iloc[0]) if len(frame) else float("nan")


def figures_of(
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
            ("alone", "one of them alone", 1),
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
    six = drawn[(drawn["target"] == "planned") & (drawn["boards"] == 6)]
    figures["clean_corner_px"] = _value(six, "median", quantity="corner_px")
    figures["clean_check_mm"] = _value(six, "median", quantity="check_rmse_mm")
    columns = {"median": "corner_px", "check_rmse_mm": "check_mm", "sigma0": "sigma0", "test_passed": "passed"}
    for fault, level, target, name in (
        ("bent", 1.0, "planned", "bent"), ("bent", 1.0, "full-size", "bent_full"), ("scale", 200.0, "planned", "scale"),
    ):  # fmt: skip
        where = {"experiment": fault, "level": level, "target": target, "evidence": "drawn"}
        for column, end in (columns | {"check_nees": "nees"}).items():
            figures[f"{name}_{end}"] = _value(faults, column, **where)
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
    # Print errors of both boards of a link, beyond what the images add.
    turns = [_value(drawn, "turn_mrad", boards=CHAIN, print_mm=v, wide=0, axis="up") for v in (PRINT_MM, 0.0)]
    found["print_turn_mrad"] = float(np.sqrt(max(turns[0] ** 2 - turns[1] ** 2, 0)))
    found["print_turn_expected_mrad"] = 1e3 * np.sqrt(2) * link_of_marks(sub_board_marks_mm(), PRINT_MM)[1]
    for name, part in (("drawn", drawn), ("rendered", links[links["evidence"] == "rendered"])):
        found[f"chain_{name}_nees"] = float(part["nees"].mean()) if len(part) else float("nan")
        found[f"chain_{name}_worlds"] = int(part["worlds"].max()) if len(part) else 0
    return found
