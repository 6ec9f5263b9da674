"""The tables on the page of the study on stitched boards."""

import numpy as np
import pandas as pd

from testfield.study.study import Table

COLUMNS = {"corner_px": "corner, px", "check_rmse_mm": "check points, mm", "mother_rms_mm": "mother board, mm"}
MICROMETRES = ("rms_mm", "low_mm", "high_mm", "claimed_mm", "law_mm", "law_shared_mm", "shift_mm", "mother_rms_mm")


def tables_of(counts: pd.DataFrame, links: pd.DataFrame, faults: pd.DataFrame, cuts: pd.DataFrame) -> list[Table]:
    """All tables that have a row."""
    tables = [
        Table(
            "All fields",
            _fields(counts),
            "Medians [95 % interval, of fewer than six worlds their range]; NEES: "
            "means per degree of freedom, 1 where the claims are true.",
            {"coverage %": "{:.0f}", "s0": "{:.3f}"},
        ),
        Table(
            "The last board of each chain",
            _last(links),
            "rms over worlds of its error out of the plane and upwards; a world that failed is not among them.",
        ),
        Table(
            "Bent boards and own scales",
            _faults(faults),
            "Medians over all worlds, one that failed being beyond all; why most of those failed.",
        ),
        Table("Observations confined to a part of the image", _cuts(cuts), "Error at the corners, px."),
    ]
    return [table for table in tables if len(table.frame)]


def _fields(counts: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for (target, boards, evidence), part in counts.groupby(["target", "boards", "evidence"]):
        first = part.iloc[0]
        row = {
            "target": target,
            "boards": boards,
            "evidence": evidence,
            "worlds": first["worlds"],
            "failed": first["failed"],
            "coverage %": 100 * first["coverage"],
        }
        for quantity, title in COLUMNS.items():
            here = part[part["quantity"] == quantity]
            row[title] = interval(*here.iloc[0][["median", "low", "high"]]) if len(here) else "–"
        rows.append(
            row
            | {
                "s0": first["sigma0"],
                "NEES camera": first["interior_nees"],
                "NEES boards": first["boards_nees"],
                "NEES check": first["check_nees"],
            }
        )
    return pd.DataFrame(rows)


def _last(links: pd.DataFrame) -> pd.DataFrame:
    last = links[links["links"] == links["boards"] - 1].drop(columns=["links", "turn_lag_low", "turn_lag_high"])
    return last.assign(**{name: 1e3 * last[name] for name in MICROMETRES}).rename(
        columns=lambda name: name.replace("_mm", ", µm") if name != "print_mm" else "print, mm"
    )


def _faults(faults: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        [
            {
                "fault": row["experiment"],
                "level": row["level"],
                "target": row["target"],
                "evidence": row["evidence"],
                "worlds": row["worlds"],
                "failed": row["failed"],
                "corner, px": interval(row["median"], row["low"], row["high"]),
                "check points, mm": interval(row["check_rmse_mm"], row["check_low"], row["check_high"]),
                "mother board, mm": number(row["mother_rms_mm"]),
                "s0": number(row["sigma0"]),
                "NEES check": number(row["check_nees"]),
                "test passed": row["passed"],
                "reason": row["reason"] or "–",
            }
            for row in faults.to_dict("records")
        ]
    )


def _cuts(cuts: pd.DataFrame) -> pd.DataFrame:
    shown = cuts.drop(columns=["median", "low", "high"])
    ends = zip(cuts["median"], cuts["low"], cuts["high"], strict=True)
    return shown.assign(**{"corner, px": [interval(*three) for three in ends]})


def interval(median: float, low: float, high: float) -> str:
    """A median with its interval, in words where nothing was determined."""
    if not np.isfinite(median):
        return "beyond all"
    return f"{number(median)} [{number(low)}, {number(high)}]"


def number(value: float) -> str:
    """Three figures, in words where nothing was determined."""
    return f"{value:.3g}" if np.isfinite(value) else "beyond all"
