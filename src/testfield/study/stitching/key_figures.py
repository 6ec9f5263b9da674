"""The key figures of the study on stitched boards by name; NaN where no finished case gives them.

A figure with an interval has its ends under `NAME_low` and `NAME_high`, and its worlds under `NAME_worlds`.
"""

from typing import Any

import numpy as np
import pandas as pd

from testfield.study.stitching.chain_growth import link_of_marks
from testfield.study.stitching.intervals import ratio_of, share_of
from testfield.study.stitching.plan import CHAIN, LONG_CHAIN, PRINT_MM
from testfield.study.stitching.scenes import sub_board_marks_mm

GOOD_PX = 0.02
"""A lens known this well at the image's corners costs little beside the error of a mark's centre."""
UNITS = {
    "corner_px": "corner_px", "check_rmse_mm": "check_mm", "mother_rms_mm": "mother_mm",
    "mother_flatness_mm": "flatness_mm",
}  # fmt: skip
Figures = dict[str, Any]


def figures_of(
    counts: pd.DataFrame, cuts: pd.DataFrame, faults: pd.DataFrame, links: pd.DataFrame, rows: pd.DataFrame
) -> Figures:
    """The key numbers by name."""
    corners = counts[(counts["evidence"] == "drawn") & (counts["quantity"] == "corner_px")]
    planned = corners[corners["target"] == "planned"].sort_values("boards")
    most = int(planned["boards"].max()) if len(planned) else 0
    figures: Figures = {"most_boards": most} | _enough(planned)
    figures |= _drawn(counts[counts["evidence"] == "drawn"], most)
    figures |= _rendered(counts[counts["quantity"] == "corner_px"], most)
    for name, window, cut in (
        ("middle", 0.5, "middle"), ("spread", 0.5, "spread"), ("most", 0.8, "middle"), ("all", 1.0, "middle"),
    ):  # fmt: skip
        here = _row(cuts, window=window, name=cut, evidence="drawn")
        figures |= _interval(f"window_{name}_corner_px", here)
    return figures | _faults(faults) | _cost(rows, most) | _growth(links) | _loops(rows)


def _enough(planned: pd.DataFrame) -> Figures:
    """The smallest number of boards from which on every number tried is good, and the coverage of that one."""
    bad = planned[~(planned["high"] <= GOOD_PX)]["boards"]
    good = planned[planned["boards"] > bad.max()] if len(bad) else planned
    if not len(good):
        return {"enough_boards": 0, "enough_coverage": float("nan")}
    return {"enough_boards": int(good["boards"].iloc[0]), "enough_coverage": float(good["coverage"].iloc[0])}


def _drawn(drawn: pd.DataFrame, most: int) -> Figures:
    found: Figures = {}
    for name, target, boards in (
        ("one", "planned", 1), ("three", "planned", 3), ("planned", "planned", most), ("flat", "flat", most),
        ("random", "random", most), ("random_three", "random", 3), ("flat_three", "flat", 3),
        ("full", "full-size", most), ("full_three", "full-size", 3), ("close", "sub-board, close", 1),
        ("alone", "one of them alone", 1), ("clean", "planned", 6),
    ):  # fmt: skip
        for quantity, unit in UNITS.items():
            found |= _interval(f"{name}_{unit}", _row(drawn, quantity=quantity, target=target, boards=boards))
        corner = _row(drawn, quantity="corner_px", target=target, boards=boards)
        for column in ("coverage", "true_flatness_mm", "flat_passed"):
            found[f"{name}_{column}"] = corner[column]
    return found


def _rendered(corners: pd.DataFrame, most: int) -> Figures:
    """Corner errors on rendered images; of targets that are drawn too, beside the drawn interval."""
    rendered = corners[corners["evidence"] == "rendered"]
    charuco = rendered[rendered["target"] == "ChArUco, OpenCV"]["boards"]
    as_charuco = int(charuco.max()) if len(charuco) else 0
    found: Figures = {"charuco_boards": as_charuco}
    for name, target, boards in (
        ("charuco_opencv", "ChArUco, OpenCV", as_charuco), ("charuco_bundle", "ChArUco, this bundle", as_charuco),
        ("charuco_no_bar", "ChArUco, this bundle, no bar", as_charuco),
        ("planned_as_charuco", "planned", as_charuco), ("no_bar_as_charuco", "planned, no bar", as_charuco),
        ("charuco_close", "charuco, close", 1),
    ):  # fmt: skip
        found |= _interval(f"{name}_corner_px", _row(rendered, target=target, boards=boards))
    for name, target in (("planned", "planned"), ("full", "full-size"), ("close", "sub-board, close")):
        tried = rendered[rendered["target"] == target]["boards"]
        boards = most if (tried == most).any() or not len(tried) else int(tried.max())
        found[f"rendered_{name}_boards"] = boards
        found |= _interval(f"rendered_{name}_corner_px", _row(rendered, target=target, boards=boards))
        drawn = _row(corners, evidence="drawn", target=target, boards=boards)
        found |= _interval(f"rendered_{name}_drawn_corner_px", drawn)
        found |= {f"rendered_{name}_drawn_{end}_px": drawn[end] for end in ("least", "largest")}
    return found


def _faults(faults: pd.DataFrame) -> Figures:
    found: Figures = {}
    for name, fault, level, target in (
        ("bent", "bent", 1.0, "planned"), ("bent_full", "bent", 1.0, "full-size"), ("scale", "scale", 200.0, "planned"),
    ):  # fmt: skip
        row = _row(faults, experiment=fault, level=level, target=target, evidence="drawn")
        found |= _interval(f"{name}_corner_px", row)
        found |= {f"{name}_check_mm": row["check_rmse_mm"], f"{name}_check_mm_low": row["check_low"],
                  f"{name}_check_mm_high": row["check_high"],
                  f"{name}_check_mm_worlds": row["worlds"]}  # fmt: skip
        found |= {f"{name}_{column}": row[column] for column in ("sigma0", "check_nees", "worlds")}
        turned_down = row["worlds"] - row["passed"]
        there = turned_down == turned_down  # NaN without such cases
        share = share_of(int(turned_down), int(row["worlds"])) if there else (np.nan,) * 3
        found[f"{name}_turned_down"] = turned_down
        found |= _three(f"{name}_turned_down_share", share)
    return found


def _cost(rows: pd.DataFrame, most: int) -> Figures:
    """What it costs not to know where the boards are: check points in the datum's frame, stitched over given."""
    here = rows[(rows["experiment"] == "count") & (rows["boards"] == most) & (rows["evidence"] == "drawn")
                & (rows["target"] == "planned") & (rows["cut"] == "")]  # fmt: skip
    both = here.pivot_table(index="world", columns="method", values="check_unfitted_mm")
    both = both.reindex(columns=["stitched", "stitched_given"]).dropna()
    found: Figures = {
        f"{name}_unfitted_mm": float(np.sqrt((both[method] ** 2).mean()))
        for name, method in (("stitched", "stitched"), ("given", "stitched_given"))
    }
    ratio = ratio_of(both["stitched"].to_numpy(), both["stitched_given"].to_numpy())
    return found | _three("cost_ratio", ratio) | {"cost_worlds": len(both)}


def _loops(rows: pd.DataFrame) -> Figures:
    """By what four wide views divide errors of a chain's last board, and of the whole after a fit: close views' rms
    over that with wide views, in the same worlds."""
    found: Figures = {}
    chains = rows[(rows["experiment"] == "chain") & (rows["evidence"] == "drawn") & (rows["boards"] == CHAIN)]
    last = chains[chains["links"] == CHAIN - 1]
    for what, sigma in (("exact", 0.0), ("printed", PRINT_MM)):
        for axis, column in (("out", "out_mm"), ("up", "up_mm"), ("mother", "mother_rms_mm")):
            table = last[last["level"] == sigma].pivot_table(index="world", columns="wide", values=column)
            both = table.reindex(columns=[0.0, 4.0]).dropna()
            found |= _three(f"loops_{what}_{axis}", ratio_of(both[0.0].to_numpy(), both[4.0].to_numpy()))
            found[f"loops_{what}_{axis}_worlds"] = len(both)
    return found


def _growth(links: pd.DataFrame) -> Figures:
    found: Figures = {}
    drawn = links[links["evidence"] == "drawn"]
    for name, boards in (("chain", CHAIN), ("long", LONG_CHAIN)):
        for what, sigma in (("exact", 0.0), ("printed", PRINT_MM)):
            for wide, views in ((0, "close"), (4, "wide")):
                for axis in ("out", "up"):
                    where = {"boards": boards, "print_mm": sigma, "wide": wide, "axis": axis}
                    key, last = f"{name}_{what}_{views}_{axis}", _row(drawn, **where, links=boards - 1)
                    first = _row(drawn, **where, links=1)
                    for column in ("rms_mm", "low_mm", "high_mm", "claimed_mm", "law_mm", "law_shared_mm",
                                   "mother_rms_mm", "turn_lag", "turn_lag_low", "turn_lag_high", "worlds"):  # fmt: skip
                        found[f"{key}_{column}"] = last[column]
                    found |= {f"{key}_first_{end}_mm": first[f"{end}_mm"] for end in ("rms", "low", "high")}
    # Print errors of both boards of a link, beyond what the images add.
    turns = [_row(drawn, boards=CHAIN, print_mm=v, wide=0, axis="up", links=1)["turn_mrad"] for v in (PRINT_MM, 0.0)]
    found["print_turn_mrad"] = float(np.sqrt(np.maximum(turns[0] ** 2 - turns[1] ** 2, 0)))
    found["print_turn_expected_mrad"] = 1e3 * np.sqrt(2) * link_of_marks(sub_board_marks_mm(), PRINT_MM)[1]
    for name, part in (("drawn", drawn), ("rendered", links[links["evidence"] == "rendered"])):
        found[f"chain_{name}_nees"] = float(part["nees"].mean())
        found[f"chain_{name}_worlds"] = int(part["worlds"].max()) if len(part) else 0
    return found


def _row(frame: pd.DataFrame, **where: Any) -> pd.Series:
    """The one row where all conditions hold; NaN in every column where there is none."""
    for name, value in where.items():
        frame = frame[frame[name] == value]
    return frame.iloc[0] if len(frame) else pd.Series(np.nan, index=frame.columns)


def _interval(key: str, row: pd.Series) -> Figures:
    return _three(key, (row["median"], row["low"], row["high"])) | {f"{key}_worlds": row["worlds"]}


def _three(key: str, values: tuple[float, float, float]) -> Figures:
    return {key: float(values[0]), f"{key}_low": float(values[1]), f"{key}_high": float(values[2])}
