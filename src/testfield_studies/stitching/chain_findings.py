"""The findings of the study on stitched boards: errors that grow along a chain, and boards with faults."""

import numpy as np
import pandas as pd

from testfield.score.chain_growth import link_of_marks
from testfield.statistics.decide import Side, side_of
from testfield.statistics.intervals import LEAST_WORLDS, ratio_of, share_of
from testfield.study.finding import Finding, Outcome, Quantities, Quantity, Rule, above, less, within
from testfield_studies.quantities import median, of, row_of, three
from testfield_studies.stitching.findings import TELLING_WORLDS, Fields
from testfield_studies.stitching.plan import CHAIN, LONG_CHAIN, PRINT_MM
from testfield_studies.stitching.scenes import sub_board_marks_mm

CHANCE = 0.05
"""Share of worlds that the global test turns down where nothing is wrong."""
MOST_TURNED_DOWN = 0.5
"""Below this share the global test hardly notices."""
PRINTS = {"exact": 0.0, "printed": PRINT_MM}
AXES = {"out": "out of the plane", "up": "upwards"}


def chain_findings(links: pd.DataFrame, rows: pd.DataFrame) -> list[Finding]:
    """What chains tell; `rows` are those of the cases, `links` their summary."""
    laws = [(CHAIN, what, axis) for what in PRINTS for axis in AXES]
    laws += [(LONG_CHAIN, "exact", "out"), (LONG_CHAIN, "printed", "up")]
    return [
        _grows(links),
        *(_law(links, *place) for place in laws),
        _independent(links),
        _random_walk(links),
        *(_loops(links, rows, what, axis) for what in PRINTS for axis in (*AXES, "mother")),
        *(_nees(links, evidence) for evidence in ("drawn", "rendered")),
    ]


def _last(links: pd.DataFrame, boards: int, what: str, axis: str, wide: int = 0, link: int | None = None) -> pd.Series:
    """A board of a drawn chain, the last one unless `link` is given."""
    here = {"boards": boards, "print_mm": PRINTS[what], "wide": wide, "axis": axis}
    return row_of(links, evidence="drawn", links=boards - 1 if link is None else link, **here)


def _rms(row: pd.Series) -> Quantity:
    return three(tuple(1e3 * row[f"{end}_mm"] for end in ("rms", "low", "high")), "µm")  # type: ignore[arg-type]


def _lag(row: pd.Series) -> Quantity:
    return of(row, "turn_lag", ends=("turn_lag_low", "turn_lag_high"))


def _grows(links: pd.DataFrame) -> Finding:
    last = _last(links, CHAIN, "printed", "out")
    quantities = {
        "first": _rms(_last(links, CHAIN, "printed", "out", link=1)),
        "last": _rms(last),
        "worlds": of(last, "worlds"),
    }
    question = f"Does the error out of the plane grow along a chain of {CHAIN - 1} links?"
    return Finding("grows", question, quantities, less("first", "last"))


def _law(links: pd.DataFrame, boards: int, what: str, axis: str) -> Finding:
    row = _last(links, boards, what, axis)
    quantities = {
        "found": _rms(row),
        "law": Quantity(1e3 * row["law_mm"], unit="µm"),
        "law_shared": Quantity(1e3 * row["law_shared_mm"], unit="µm"),
        "claimed": Quantity(1e3 * row["claimed_mm"], unit="µm"),
        "with_wide_views": _rms(_last(links, boards, what, axis, wide=4)),
    }

    def decide(q: Quantities) -> Outcome:
        low, high = q["found"].ends
        return Outcome.HOLDS if low <= q["law"].value <= high else Outcome.FAILS

    words = "the law of independent links lies in the interval of what was found"
    long = "long_" if boards == LONG_CHAIN else ""
    question = f"Do {boards} boards, {_printed(what)}, follow the law of independent links, {AXES[axis]}?"
    return Finding(f"{long}law_{what}_{axis}", question, quantities, Rule(words, ("found", "law"), decide))


def _printed(what: str) -> str:
    return "printed exactly" if what == "exact" else f"with print errors of {PRINT_MM} mm"


def _independent(links: pd.DataFrame) -> Finding:
    quantities = {"correlation": _lag(_last(links, CHAIN, "exact", "out"))}

    def decide(q: Quantities) -> Outcome:
        apart = side_of(*q["correlation"].ends) in (Side.ABOVE, Side.BELOW)
        return Outcome.FAILS if apart else Outcome.OPEN

    words = "never for sure: fails where the turns of neighbouring links correlate, else it is open"
    question = "Are links independent of each other, by image noise alone?"
    return Finding("independent", question, quantities, Rule(words, ("correlation",), decide))


def _random_walk(links: pd.DataFrame) -> Finding:
    """A random walk of the links would follow the law; prints that turn back their neighbours stay below it."""
    row = _last(links, CHAIN, "printed", "up")
    turns = [_last(links, CHAIN, what, "up", link=1)["turn_mrad"] for what in ("printed", "exact")]
    quantities = {
        "correlation": _lag(row),
        "found": _rms(row),
        "law": Quantity(1e3 * row["law_mm"], unit="µm"),
        "worlds": of(row, "worlds"),
        # Print errors of both boards of a link, beyond what the images add.
        "print_turn": Quantity(float(np.sqrt(np.maximum(turns[0] ** 2 - turns[1] ** 2, 0))), unit="mrad"),
        "print_turn_expected": Quantity(
            1e3 * np.sqrt(2) * link_of_marks(sub_board_marks_mm(), PRINT_MM)[1], unit="mrad"
        ),
    }

    def decide(q: Quantities) -> Outcome:
        low, high = q["found"].ends
        law = side_of(low, high, q["law"].value)
        back = side_of(*q["correlation"].ends)
        if (law is Side.BELOW and back is Side.BELOW) or law is Side.ABOVE or back is Side.ABOVE:
            return Outcome.FAILS
        agree = law is Side.OPEN and back is Side.OPEN and q["worlds"].value >= LEAST_WORLDS
        return Outcome.HOLDS if agree else Outcome.OPEN

    words = (
        f"the law agrees and neighbours do not correlate, in {LEAST_WORLDS} worlds or more; fails where it asks too "
    )
    words += "much and they turn each other back, where it asks too little, or where turns add up"
    rule = Rule(words, ("found", "law", "correlation"), decide)
    return Finding("random_walk", "Do print errors make a random walk?", quantities, rule)


def _loops(links: pd.DataFrame, rows: pd.DataFrame, what: str, axis: str) -> Finding:
    """By what four wide views divide the error of a chain's last board, or of the whole after a fit: close views' rms
    over that with wide views, in the same worlds."""
    chains = rows[(rows["experiment"] == "chain") & (rows["evidence"] == "drawn") & (rows["boards"] == CHAIN)]
    last = chains[(chains["links"] == CHAIN - 1) & (chains["level"] == PRINTS[what])]
    column = "mother_rms_mm" if axis == "mother" else f"{axis}_mm"
    both = last.pivot_table(index="world", columns="wide", values=column).reindex(columns=[0.0, 4.0]).dropna()
    quantities = {
        "divided_by": three(ratio_of(both[0.0].to_numpy(), both[4.0].to_numpy())),
        "worlds": Quantity(len(both) or np.nan),
    }
    for name, wide in (("close_views", 0), ("wide_views", 4)):
        row = _last(links, CHAIN, what, "up" if axis == "mother" else axis, wide)
        mother = Quantity(1e3 * row["mother_rms_mm"], unit="µm")
        quantities[name] = mother if axis == "mother" else _rms(row)
    part = "of the whole chain after a fit of six parameters" if axis == "mother" else f"of the last board {AXES[axis]}"
    question = f"Do four wide views lessen the error {part}, boards {_printed(what)}?"
    return Finding(f"loops_{what}_{axis}", question, quantities, above("divided_by", 1))


def _nees(links: pd.DataFrame, evidence: str) -> Finding:
    part = links[links["evidence"] == evidence]
    quantities = {
        "nees": Quantity(float(part["nees"].mean())),
        "worlds": Quantity(float(part["worlds"].max()) if len(part) else np.nan),
    }
    question = f"Are the bundle's claims of board poses true along the chain ({evidence})?"
    return Finding(f"claims_{evidence}", question, quantities, within("nees", 0.8, 1.25))


def fault_findings(faults: pd.DataFrame, counts: pd.DataFrame) -> list[Finding]:
    """What bent boards and boards with a scale of their own tell, six planned boards each."""
    f = Fields(counts)
    bent, full, scale = (
        row_of(faults, experiment=fault, level=level, target=target, evidence="drawn")
        for fault, level, target in (("bent", 1.0, "planned"), ("bent", 1.0, "full-size"), ("scale", 200.0, "planned"))
    )
    quantities = {
        "small": median(bent, "px"),
        "full_size": median(full, "px"),
        "worlds": Quantity(float(min(bent["worlds"], full["worlds"]))),
        "flat": f.corner("planned", 6),
        "flat_points": f.mm("planned", 6, "check_rmse_mm"),
    }
    question = "Of one curvature, do small boards err less at the corners than a full-size board?"
    return [
        Finding("bent", question, quantities, less("small", "full_size", enough=("worlds", TELLING_WORLDS))),
        _noticed("bent", "boards bent by 1 mm over 400 mm", bent),
        _noticed("bent_full", "a full-size board of that curvature", full),
        _noticed("scale", "boards with scale errors of their own of 200 ppm", scale),
    ]


def _noticed(name: str, fault: str, row: pd.Series) -> Finding:
    down = row["worlds"] - row["passed"]
    quantities = {
        "turned_down": three(share_of(down, row["worlds"])),
        "worlds": of(row, "worlds"),
        "s0": of(row, "sigma0"),
        "corner": median(row, "px"),
        "points": of(row, "check_rmse_mm", "mm", ("check_low", "check_high")),
        "nees": of(row, "check_nees"),
    }

    def decide(q: Quantities) -> Outcome:
        low, high = q["turned_down"].ends
        return Outcome.HOLDS if low > CHANCE else Outcome.FAILS if high < MOST_TURNED_DOWN else Outcome.OPEN

    words = (
        f"more than {CHANCE:.0%} of worlds are surely turned down; fails where surely fewer than {MOST_TURNED_DOWN:.0%}"
    )
    return Finding(
        f"noticed_{name}", f"Does the global test notice {fault}?", quantities, Rule(words, ("turned_down",), decide)
    )
