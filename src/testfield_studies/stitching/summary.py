"""The rows of the study on stitched boards, summed up: one table a question, with fixed columns, empty where no case of
a kind is done."""

from typing import Any

import numpy as np
import pandas as pd

from testfield.score.chain_growth import grown
from testfield.statistics.intervals import lag_of, median_of, rms_of
from testfield_studies.stitching.experiment import NO_BAR
from testfield_studies.stitching.scenes import PITCH_MM

TARGETS = ("planned", "flat", "random")
QUANTITIES = ("corner_px", "check_rmse_mm", "mother_rms_mm", "mother_flatness_mm")
TEXTS = ("experiment", "target", "evidence", "method", "failed", "cut")
NUMBERS = (
    "boards",
    "level",
    "world",
    "window",
    "corner_px",
    "interior_nees",
    "sigma0",
    "test_passed",
    "observations",
    "coverage",
    "boards_nees",
    "mother_rms_mm",
    "mother_flatness_mm",
    "true_flatness_mm",
    "flat_passed",
    "check_nees",
    "check_rmse_mm",
    "check_unfitted_mm",
    "wide",
    "links",
    "nees",
    "out_mm",
    "up_mm",
    "u_out_mm",
    "u_up_mm",
    "shift_out_mm",
    "shift_up_mm",
    "turn_out_rad",
    "turn_up_rad",
)


def rows_of(table: pd.DataFrame) -> pd.DataFrame:
    """The cases' rows with every column that is read here, whatever cases are done."""
    rows = table.reindex(columns=[*TEXTS, *NUMBERS])
    rows[[*TEXTS]] = rows[[*TEXTS]].astype(object).fillna("")
    return rows.astype(dict.fromkeys(NUMBERS, float))


def named(fields: pd.DataFrame) -> pd.DataFrame:
    """The rows with what readers call their target, by method."""
    named = fields.copy()
    alone = named["target"].isin(TARGETS) & (named["method"] == "zhang")
    named.loc[alone, "target"] = "one of them alone"
    named.loc[named["target"].isin(TARGETS) & (named["method"] == NO_BAR), "target"] += ", no bar"
    for method, name in (
        ("opencv", "ChArUco, OpenCV"),
        ("stitched", "ChArUco, this bundle"),
        (NO_BAR, "ChArUco, this bundle, no bar"),
    ):
        named.loc[(named["target"] == "charuco") & (named["method"] == method), "target"] = name
    return named


def counts_of(fields: pd.DataFrame) -> pd.DataFrame:
    """One row a target, number of boards, kind of evidence and quantity: its median over worlds."""
    rows = fields[(fields["experiment"] == "count") & (fields["cut"] == "") & (fields["method"] != "stitched_given")]
    found = []
    for (target, boards, evidence), part in rows.groupby(["target", "boards", "evidence"]):
        for quantity in QUANTITIES:
            # Without check targets there is nothing to say; a calibration that gives no points is beyond all.
            if quantity != "corner_px" and not part[quantity].notna().any():
                continue
            found.append(
                {"target": target, "boards": int(boards), "evidence": evidence, "quantity": quantity}
                | median_of(part[quantity].to_numpy())
                | {"least": part[quantity].min(), "largest": part[quantity].fillna(np.inf).max()}
                | {
                    "failed": int((part["failed"] != "").sum()),
                    "coverage": part["coverage"].median(),
                    "sigma0": part["sigma0"].median(),
                    "interior_nees": part["interior_nees"].mean(),
                    "boards_nees": part["boards_nees"].mean(),
                    "check_nees": part["check_nees"].mean(),
                    "true_flatness_mm": part["true_flatness_mm"].median(),
                    "flat_passed": part["flat_passed"].mean(),
                }
            )
    columns = [
        "target",
        "boards",
        "evidence",
        "quantity",
        "worlds",
        "median",
        "low",
        "high",
        "least",
        "largest",
        "failed",
        "coverage",
        "sigma0",
        "interior_nees",
        "boards_nees",
        "check_nees",
        "true_flatness_mm",
        "flat_passed",
    ]
    return pd.DataFrame(found, columns=columns)


def cuts_of(fields: pd.DataFrame) -> pd.DataFrame:
    """Corner errors of calibrations that used a part of the image only."""
    rows = fields[fields["cut"] != ""]
    found = [
        {"name": cut, "window": window, "evidence": evidence}
        | median_of(part["corner_px"].to_numpy())
        | {"observations": part["observations"].median(), "coverage": part["coverage"].median()}
        for (cut, window, evidence), part in rows.groupby(["cut", "window", "evidence"])
    ]
    columns = ["name", "window", "evidence", "worlds", "median", "low", "high", "observations", "coverage"]
    return pd.DataFrame(found, columns=columns)


def faults_of(fields: pd.DataFrame) -> pd.DataFrame:
    """Corner errors, check points and signs of trouble of bent boards and of boards with scales of their own.

    All are medians over all worlds, in which a world that failed is beyond all; `passed` counts the worlds that the
    global test did not turn down, `reason` is why most of the others failed.
    """
    rows = fields[fields["experiment"].isin(["bent", "scale"])]
    found = []
    for (experiment, target, level, evidence), part in rows.groupby(["experiment", "target", "level", "evidence"]):
        why = part["failed"][part["failed"] != ""]
        medians = {
            name: median_of(part[name].to_numpy())["median"]
            for name in ("check_rmse_mm", "mother_rms_mm", "sigma0", "check_nees")
        }
        found.append(
            {"experiment": experiment, "target": target, "level": level, "evidence": evidence}
            | median_of(part["corner_px"].to_numpy())
            | medians
            | {f"check_{end}": median_of(part["check_rmse_mm"].to_numpy())[end] for end in ("low", "high")}
            | {
                "passed": int((part["test_passed"] == 1).sum()),
                "failed": len(why),
                "reason": why.value_counts().index[0] if len(why) else "",
            }
        )
    columns = [
        "experiment",
        "target",
        "level",
        "evidence",
        "worlds",
        "median",
        "low",
        "high",
        "check_rmse_mm",
        "check_low",
        "check_high",
        "mother_rms_mm",
        "sigma0",
        "check_nees",
        "passed",
        "failed",
        "reason",
    ]
    return pd.DataFrame(found, columns=columns)


def links_of(chains: pd.DataFrame) -> pd.DataFrame:
    """Of every board of a chain the error across it, what was claimed, and what the law predicts; over the worlds that
    did not fail, `failed` being the number of the others."""
    found: list[dict[str, Any]] = []
    for (boards, sigma, evidence, wide), every in chains.groupby(["boards", "level", "evidence", "wide"]):
        part = every[every["failed"] == ""]
        for axis in ("out", "up"):
            shift, turn = part[f"shift_{axis}_mm"], part[f"turn_{axis}_rad"]
            s, t, shared = np.sqrt((shift**2).mean()), np.sqrt((turn**2).mean()), float((shift * turn).mean())
            lag = lag_of(part.pivot_table(index="world", columns="links", values=turn.name).to_numpy())
            for k, here in part.groupby("links"):
                rms, low, high = rms_of(here[f"{axis}_mm"].to_numpy())
                found.append(
                    {
                        "boards": int(boards),
                        "print_mm": sigma,
                        "evidence": evidence,
                        "wide": int(wide),
                        "axis": axis,
                        "links": int(k),
                        "worlds": len(here),
                        "failed": int((every["failed"] != "").sum()),
                        "rms_mm": rms,
                        "low_mm": low,
                        "high_mm": high,
                        "claimed_mm": float(np.sqrt((here[f"u_{axis}_mm"] ** 2).mean())),
                        "law_mm": float(np.sqrt(grown(k, s, t, PITCH_MM))),
                        "law_shared_mm": float(np.sqrt(np.maximum(grown(k, s, t, PITCH_MM, shared), 0))),
                        "shift_mm": s,
                        "turn_mrad": 1e3 * t,
                        "turn_lag": lag[0],
                        "turn_lag_low": lag[1],
                        "turn_lag_high": lag[2],
                        "nees": here["nees"].mean(),
                        "mother_rms_mm": float(np.sqrt((here["mother_rms_mm"] ** 2).mean())),
                    }
                )
    columns = [
        "boards",
        "print_mm",
        "evidence",
        "wide",
        "axis",
        "links",
        "worlds",
        "failed",
        "rms_mm",
        "low_mm",
        "high_mm",
        "claimed_mm",
        "law_mm",
        "law_shared_mm",
        "shift_mm",
        "turn_mrad",
        "turn_lag",
        "turn_lag_low",
        "turn_lag_high",
        "nees",
        "mother_rms_mm",
    ]
    return pd.DataFrame(found, columns=columns)
