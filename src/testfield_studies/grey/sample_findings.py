"""The findings of the study of grey methods on the grey uncertainty of small samples."""

import numpy as np

from testfield.study.finding import Finding, Outcome, Quantities, Quantity, Rule, above, below
from testfield_studies.grey.small_samples import (
    BESSEL,
    DOT,
    IMAGE,
    NAMED,
    SUM,
    SUP,
    SURE,
    UNSORTED,
    Judged,
    Samples,
)

KEYS = {SUP: "largest_gap", SUM: "sum_of_gaps", BESSEL: "bessel"}


def sample_findings(samples: Samples | None) -> list[Finding]:
    """All findings; without quantities where nothing of them is there."""
    normal = samples.judged if samples and "normal" in samples.laws else None
    several = samples if samples and len(samples.laws) > 1 else None
    described = {row["errors"]: row for row in samples.described} if samples else {}
    real = [(kind, centroid) for kind in (DOT, IMAGE) for centroid in NAMED]
    return [
        _scatter(normal),
        _interval(normal),
        _optimism(normal),
        _unbiased(normal),
        _sorted(normal),
        _laws(several),
        _whatever_law(several),
        *(_tails(described.get(f"{kind} ({NAMED[centroid]})"), kind, centroid) for kind, centroid in real),
        *(_bias(described.get(f"{DOT} ({NAMED[centroid]})"), centroid) for centroid in NAMED),
    ]


def _difference(judged: Judged, law: str, n: int, key: str = "mean_ratio", one: str = SUP) -> Quantity:
    """An estimator less another's figure with its interval."""
    low, high = judged.off(law, one, BESSEL if one == SUP else SUP, n, key)
    return Quantity((low + high) / 2, low, high)


def _sure(judged: Judged, estimator: str, n: int, key: str, times: float = 1.0) -> Quantity:
    """A figure of normal values with its interval."""
    value, wide = judged.of("normal", estimator, n, key), SURE * judged.of("normal", estimator, n, f"u_{key}")
    return Quantity(times * value, times * (value - wide), times * (value + wide))


def _scatter(judged: Judged | None) -> Finding:
    quantities = {}
    if judged:
        quantities = {"difference": _difference(judged, "normal", 3, "scatter")}
        quantities |= {name: _sure(judged, key, 3, "scatter", 100) for key, name in KEYS.items()}
    question = "Of three normal values, does the largest gap scatter less than Bessel's formula?"
    return Finding("scatter", question, quantities, below("difference", 0))


def _interval(judged: Judged | None) -> Finding:
    quantities = {}
    if judged:
        quantities = {
            "percent_of_3": _sure(judged, SUP, 3, "mean_covered_2", 100),
            "percent_of_5": _sure(judged, SUP, 5, "mean_covered_2", 100),
            "percent_with_own_factor": _sure(judged, SUP, 3, "mean_covered_t", 100),
            "percent_of_bessel_and_t": _sure(judged, BESSEL, 3, "mean_covered_t", 100),
        }

    def decide(q: Quantities) -> Outcome:
        low, high = q["percent_of_3"].ends
        return Outcome.HOLDS if low <= 95 <= high else Outcome.FAILS

    question = "Does the mean of three plus or minus 2 u / sqrt(3), without degrees of freedom, hold the truth in 95 %?"
    rule = Rule("the interval of its share holds 95 %", ("percent_of_3",), decide)
    return Finding("interval", question, quantities, rule)


def _optimism(judged: Judged | None) -> Finding:
    quantities = {}
    if judged:
        for n in (3, 5, 10):
            quantities[f"difference_of_{n}"] = _difference(judged, "normal", n)
            quantities |= {f"{name}_of_{n}": _sure(judged, key, n, "mean_ratio") for key, name in KEYS.items()}

    def decide(q: Quantities) -> Outcome:
        ends = [q[f"difference_of_{n}"].ends for n in (3, 5, 10)]
        if all(high < 0 for _, high in ends):
            return Outcome.HOLDS
        return Outcome.FAILS if all(low > 0 for low, _ in ends) else Outcome.OPEN

    question = "Of small normal samples, is the largest gap more optimistic than Bessel's formula?"
    words = "it gives less of sigma on the mean at 3, 5 and 10 values; fails where more at all three"
    return Finding("optimism", question, quantities, Rule(words, ("difference_of_3",), decide))


def _unbiased(judged: Judged | None) -> Finding:
    quantities = {f"of_{n}": _sure(judged, SUM, n, "mean_ratio") for n in (3, 5, 10)} if judged else {}

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if all(x.low < 1 < x.high for x in q.values()) else Outcome.FAILS

    question = "Is the sum of gaps of normal values free of bias?"
    rule = Rule("the intervals of 3, 5 and 10 values hold 1", ("of_3", "of_5", "of_10"), decide)
    return Finding("unbiased", question, quantities, rule)


def _sorted(judged: Judged | None) -> Finding:
    quantities = {}
    if judged:
        quantities = {
            "difference": _difference(judged, "normal", 5, "scatter", UNSORTED),
            "unsorted": _sure(judged, UNSORTED, 5, "mean_ratio"),
            "scatter_unsorted": _sure(judged, UNSORTED, 5, "scatter", 100),
            "scatter_sorted": _sure(judged, SUP, 5, "scatter", 100),
        }
    question = "Without sorting, does the same formula scatter more, by the order of the values?"
    return Finding("sorted", question, quantities, above("difference", 0))


def _laws(samples: Samples | None) -> Finding:
    """How far the estimate over sigma of 30 values goes from law to law, beside Bessel's."""
    quantities: dict[str, Quantity] = {}
    if samples:
        judged, spread = samples.judged, {}
        for key, name in KEYS.items():
            low, high, spread[key], u = judged.spread(samples.laws, key, 30)
            spread[f"u {key}"] = u
            quantities |= {f"{name}_least": Quantity(judged.of(low, key, 30))}
            quantities |= {f"{name}_most": Quantity(judged.of(high, key, 30))}
        off, wide = spread[SUP] - spread[BESSEL], SURE * float(np.hypot(spread[f"u {SUP}"], spread[f"u {BESSEL}"]))
        quantities |= {"difference": Quantity(off, off - wide, off + wide), "range_of_30": Quantity(spread[SUP])}
        quantities["range_of_10"] = Quantity(judged.spread(samples.laws, SUP, 10)[2])
    question = "Does the largest gap depend on the law less than Bessel's formula (range over laws, 30 values)?"
    return Finding("laws", question, quantities, below("difference", 0))


def _whatever_law(samples: Samples | None) -> Finding:
    quantities = {}
    if samples:
        every = [*samples.laws, *samples.images]
        ends = [samples.judged.off(law, SUP, BESSEL, 10, "scatter") for law in every]
        quantities = {
            "laws": Quantity(len(every)),
            "less": Quantity(sum(high < 0 for _, high in ends)),
            "more": Quantity(sum(low > 0 for low, _ in ends)),
        }

    def decide(q: Quantities) -> Outcome:
        if q["less"].value == q["laws"].value:
            return Outcome.HOLDS
        return Outcome.FAILS if q["more"].value else Outcome.OPEN

    question = "Of ten values, does the largest gap scatter less than Bessel's formula whatever the law?"
    rule = Rule("it does for every law; fails where it scatters more for one", ("laws",), decide)
    return Finding("whatever_law", question, quantities, rule)


def _tails(row: dict | None, kind: str, centroid: str) -> Finding:
    quantities = {}
    if row:
        quantities = {
            "kurtosis": Quantity(row["excess kurtosis"]),
            "normal_from": Quantity(row["normal kurtosis, low"]),
            "normal_to": Quantity(row["normal kurtosis, high"]),
            "values": Quantity(row["n"]),
        }
        for name in ("largest gap", "sum of gaps", "Bessel"):
            key = name.lower().replace(" ", "_")
            quantities |= {key: Quantity(row[name]), f"normal_{key}": Quantity(row[f"normal {name}"])}

    def decide(q: Quantities) -> Outcome:
        like = q["normal_from"].value <= q["kurtosis"].value <= q["normal_to"].value
        return Outcome.HOLDS if like else Outcome.FAILS

    question = f"Have real centre errors the tails of normal ones ({kind}, {NAMED[centroid]})?"
    rule = Rule("their kurtosis lies where 95 % of normal errors of the same shape do", ("kurtosis",), decide)
    return Finding(f"tails_{'dot' if kind == DOT else 'image'}_{centroid}", question, quantities, rule)


def _bias(row: dict | None, centroid: str) -> Finding:
    quantities = {}
    if row:
        quantities = {
            "bias_over_scatter": Quantity(row["bias over scatter"]),
            "seen": Quantity(float(row["bias is seen"])),
            "scatter": Quantity(row["scatter"], unit="px"),
        }

    def decide(q: Quantities) -> Outcome:
        return Outcome.HOLDS if q["seen"].value else Outcome.OPEN

    question = f"Have single dots a bias that no estimator sees in repeated images ({NAMED[centroid]})?"
    rule = Rule(
        f"it is more than {SURE:g} standard uncertainties of what chance gives; else it is open", ("seen",), decide
    )
    return Finding(f"bias_{centroid}", question, quantities, rule)
