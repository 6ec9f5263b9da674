"""The findings of the study on stitched boards: fields of boards. Those of chains and of faulty boards stand beside."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from testfield.statistics.consistency import hit_band
from testfield.statistics.intervals import ratio_of
from testfield.study.finding import Finding, Outcome, Quantities, Quantity, Rule, below, less
from testfield_studies.quantities import median, of, row_of, three

GOOD_PX = 0.02
"""A lens known this well at the image's corners costs little beside the error of a mark's centre."""
TELLING_WORLDS = 4
"""That ranges of fewer worlds each do not overlap happens by chance more than once in twenty times."""
CHARUCO = ("ChArUco, OpenCV", "ChArUco, this bundle", "ChArUco, this bundle, no bar")


@dataclass(frozen=True)
class Fields:
    """The medians of all fields, as `counts_of` gives them."""

    counts: pd.DataFrame

    @property
    def most(self) -> int:
        """The largest number of planned boards that was drawn."""
        drawn = self.counts[(self.counts["target"] == "planned") & (self.counts["evidence"] == "drawn")]["boards"]
        return int(drawn.max()) if len(drawn) else 0

    def row(self, target: str, boards: int, quantity: str = "corner_px", evidence: str = "drawn") -> pd.Series:
        """The row of one field and quantity."""
        return row_of(self.counts, evidence=evidence, quantity=quantity, target=target, boards=boards)

    def corner(self, target: str, boards: int, evidence: str = "drawn") -> Quantity:
        """The error of the camera at the worst corner."""
        return median(self.row(target, boards, "corner_px", evidence), "px")

    def mm(self, target: str, boards: int, quantity: str) -> Quantity:
        """A length of a drawn field."""
        return median(self.row(target, boards, quantity), "mm")

    def compared(
        self, name: str, question: str, fields: dict[str, tuple[str, int]], quantity: str = "corner_px"
    ) -> Finding:
        """Whether the first of two fields is better than the second; others are told beside them."""
        unit = quantity.rpartition("_")[2]
        quantities = {key: median(self.row(*place, quantity), unit) for key, place in fields.items()}
        one, other = list(fields)[:2]
        worlds = min(self.row(*fields[key], quantity)["worlds"] for key in (one, other))
        quantities["worlds"] = Quantity(float(worlds))
        return Finding(name, question, quantities, less(one, other, enough=("worlds", TELLING_WORLDS)))


def field_findings(counts: pd.DataFrame, cuts: pd.DataFrame, rows: pd.DataFrame) -> list[Finding]:
    """What fields of boards tell; `rows` are those of the cases, `counts` and `cuts` their summaries."""
    f = Fields(counts)
    return [
        _method(f),
        _letter(f, rows),
        f.compared(
            "as_full",
            f"Do {f.most} stitched boards know the lens better than an ideal full-size board with as many marks?",
            {"stitched": ("planned", f.most), "full_size": ("full-size", f.most)},
        ),
        f.compared(
            "as_full_points",
            "Do they give better check points?",
            {"stitched": ("planned", f.most), "full_size": ("full-size", f.most)},
            "check_rmse_mm",
        ),
        *(_rendered(f, *place) for place in (("planned", "planned"), ("full", "full-size"), ("close", CLOSE))),
        _enough(f),
        f.compared(
            "points",
            f"Do {f.most} boards give better check points than one?",
            {"most": ("planned", f.most), "one": ("planned", 1), "three": ("planned", 3)},
            "check_rmse_mm",
        ),
        *_placed(f),
        _coverage(cuts),
        *(_flat(f, name, boards) for name, boards in (("three", 3), ("most", f.most))),
        f.compared(
            "full_three",
            "Does a full-size board know the lens better than three sub-boards with as many marks?",
            {"full_size": ("full-size", 3), "three": ("planned", 3)},
        ),
        f.compared(
            "bar",
            "Does a control bar help one board left in its place?",
            {"with_bar": ("planned", 1), "without": ("one of them alone", 1)},
        ),
        f.compared(
            "close",
            "For the lens alone, is one small board shown all over the image from close by better?",
            {"close": (CLOSE, 1), "stitched": ("planned", f.most)},
        ),
        _charuco(f),
    ]


CLOSE = "sub-board, close"


def _method(f: Fields) -> Finding:
    quantities = {
        "corner": f.corner("planned", f.most),
        "boards": Quantity(f.most or np.nan),
        "worlds": of(f.row("planned", f.most), "worlds"),
    }
    question = f"Do stitched boards know the lens well, to {GOOD_PX} px at the image's corners?"
    return Finding("method", question, quantities, below("corner", GOOD_PX, enough=("worlds", TELLING_WORLDS)))


def _letter(f: Fields, rows: pd.DataFrame) -> Finding:
    """What it costs not to know where the boards are: check points in the datum's frame, stitched over given."""
    here = rows[(rows["experiment"] == "count") & (rows["boards"] == f.most) & (rows["evidence"] == "drawn")]
    here = here[(here["target"] == "planned") & (here["cut"] == "")]
    both = here.pivot_table(index="world", columns="method", values="check_unfitted_mm")
    both = both.reindex(columns=["stitched", "stitched_given"]).dropna()
    stitched, given = both["stitched"].to_numpy(), both["stitched_given"].to_numpy()
    quantities = {
        "cost_ratio": three(ratio_of(stitched, given)),
        "unknown_poses": Quantity(_rms(stitched), unit="mm"),
        "given_poses": Quantity(_rms(given), unit="mm"),
        "worlds": Quantity(len(both) or np.nan),
        "mother_board": f.mm("planned", f.most, "mother_rms_mm"),
    }
    question = "Are boards of unknown pose as good as boards of given pose (check points in the first board's frame)?"
    return Finding("letter", question, quantities, below("cost_ratio", 1))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else np.nan


def _rendered(f: Fields, name: str, target: str) -> Finding:
    """A rendered field beside the drawn worlds of the same one, with as many boards as were rendered."""
    tried = f.counts[(f.counts["evidence"] == "rendered") & (f.counts["target"] == target)]["boards"]
    boards = f.most if (tried == f.most).any() or not len(tried) else int(tried.max())
    drawn = f.row(target, boards)
    quantities = {
        "rendered": f.corner(target, boards, "rendered"),
        "worlds": of(f.row(target, boards, evidence="rendered"), "worlds"),
        "drawn": f.corner(target, boards),
        "drawn_least": of(drawn, "least", "px"),
        "drawn_largest": of(drawn, "largest", "px"),
        "boards": Quantity(boards or np.nan),
    }

    def decide(q: Quantities) -> Outcome:
        if q["drawn"].low <= q["rendered"].value <= q["drawn"].high:
            return Outcome.HOLDS
        among = q["drawn_least"].value <= q["rendered"].value <= q["drawn_largest"].value
        return Outcome.OPEN if among else Outcome.FAILS

    words = "the rendered value lies in the interval of the drawn median; open where only among the drawn worlds"
    question = f"Do rendered images give what drawn pixels give ({target})?"
    return Finding(f"rendered_{name}", question, quantities, Rule(words, ("rendered", "drawn"), decide))


def _enough(f: Fields) -> Finding:
    """The smallest number of boards from which on every number tried is good, and the coverage of that one."""
    here = f.counts[(f.counts["evidence"] == "drawn") & (f.counts["quantity"] == "corner_px")]
    planned = here[here["target"] == "planned"].sort_values("boards")
    bad = planned[~(planned["high"] <= GOOD_PX)]["boards"]
    good = planned[planned["boards"] > bad.max()] if len(bad) else planned
    quantities = {
        "enough_boards": Quantity(float(good["boards"].iloc[0]) if len(good) else 0.0 if len(planned) else np.nan),
        "coverage": Quantity(100 * float(good["coverage"].iloc[0]) if len(good) else np.nan, unit="%"),
        "one": f.corner("planned", 1),
        "three": f.corner("planned", 3),
        "most": f.corner("planned", f.most),
    }

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["enough_boards"].value > 0 else Outcome.FAILS

    words = f"from some number on, all intervals of the corner's error end below {GOOD_PX} px"
    return Finding("enough", "Is there a number of boards that does?", quantities, Rule(words, ("one",), decide))


def _placed(f: Fields) -> list[Finding]:
    found = []
    for name, boards in (("three", 3), ("most", f.most)):
        for placed in ("random", "flat"):
            question = f"Are {boards} planned boards better than {boards} {placed} ones?"
            fields = {"planned": ("planned", boards), placed: (placed, boards)}
            found.append(f.compared(f"{placed}_{name}", question, fields))
    return found


def _coverage(cuts: pd.DataFrame) -> Finding:
    places = {
        "spread": (0.5, "spread"),
        "middle": (0.5, "middle"),
        "middle_80": (0.8, "middle"),
        "all": (1.0, "middle"),
    }
    rows = {key: row_of(cuts, window=window, name=cut, evidence="drawn") for key, (window, cut) in places.items()}
    quantities = {key: median(row, "px") for key, row in rows.items()}
    quantities["worlds"] = Quantity(float(min(rows["spread"]["worlds"], rows["middle"]["worlds"])))
    question = "Do as many marks from all over the image know the lens better than those of its middle half?"
    return Finding("coverage", question, quantities, less("spread", "middle", enough=("worlds", TELLING_WORLDS)))


def _flat(f: Fields, name: str, boards: int) -> Finding:
    row = f.row("flat", boards)
    worlds = f.row("flat", boards, "mother_flatness_mm")["worlds"]
    quantities = {
        "flatness": f.mm("flat", boards, "mother_flatness_mm"),
        "true_flatness": of(row, "true_flatness_mm", "mm"),
        "passed": Quantity(100 * float(row["flat_passed"]), unit="%"),
        "worlds": Quantity(float(worlds)),
    }

    def decide(q: Quantities) -> Outcome:
        low, high = hit_band(int(q["worlds"].value), 0.95)
        passed = round(q["passed"].value / 100 * q["worlds"].value)
        return Outcome.HOLDS if low <= passed <= high else Outcome.FAILS

    words = "as many worlds pass the test of one plane as 95 % give in 99 cases of 100"
    question = f"Is the mother board of {boards} boards on one wall as flat as the bundle says?"
    return Finding(f"flatness_{name}", question, quantities, Rule(words, ("passed", "worlds"), decide))


def _charuco(f: Fields) -> Finding:
    """Rendered images only: OpenCV draws no pixels."""
    tried = f.counts[(f.counts["evidence"] == "rendered") & (f.counts["target"] == CHARUCO[0])]["boards"]
    boards = int(tried.max()) if len(tried) else 0
    names = {"opencv": CHARUCO[0], "this_bundle": CHARUCO[1], "this_bundle_no_bar": CHARUCO[2]}
    names |= {"stitched": "planned", "stitched_no_bar": "planned, no bar"}
    quantities = {key: f.corner(target, boards, "rendered") for key, target in names.items()}
    quantities["close"] = f.corner("charuco, close", 1, "rendered")
    quantities["boards"] = Quantity(boards or np.nan)
    worlds = [f.row(target, boards, evidence="rendered")["worlds"] for target in ("planned, no bar", CHARUCO[0])]
    quantities["worlds"] = Quantity(float(min(worlds)))
    question = "Without the bar, are stitched boards better than ChArUco of the same area with OpenCV?"
    return Finding(
        "charuco", question, quantities, less("stitched_no_bar", "opencv", enough=("worlds", TELLING_WORLDS))
    )
