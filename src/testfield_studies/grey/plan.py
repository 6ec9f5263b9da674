"""The table of cases of the study of grey methods.

Whole: five laws, 60 exposures of one scene, a Saltelli design of 16 base rows (224 runs), and sweeps of one factor at a
time. Each level of a sweep is measured several times over, with another noise and another workshop, for the RMSE of ten
targets scatters by itself as much as many a factor moves it. Quick: fewer rows and exposures, and no sweeps.

On a response like this one's, even 32 base rows give Sobol's first-order indices with a standard error of 0.11 and
total indices with 0.08, while a regression on the same 448 runs gives first-order shares with 0.016: so the runs are
those that Sobol's estimators need, and what the grey degrees are held against is the analysis of variance.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from testfield.evaluate.case import Case
from testfield_studies.grey.factors import FACTORS, NAMES, WORKSHOP, levels_of, scene_of
from testfield_studies.grey.samples import LAWS

RUNS, SAMPLES = "testfield_studies.grey.runs", "testfield_studies.grey.samples"
CENTROIDS = ("forward_model", "grey_centroid")
NOISE_E = 200.0
LEVELS, REPEATS = 5, 3
"""Of a sweep, and how often each level is measured: pictures are shared, so a repeat costs no rendering."""
QUICK_ROWS = 3


def cases(quick: bool) -> list[Case]:
    """All cases; laws first, for they take seconds, and a study that is not finished has them already."""
    if quick:
        designed = [entry for entry in design(4) if entry["base"] < QUICK_ROWS]
        return laws(20_000) + exposures(8) + runs(designed)
    return laws(200_000) + exposures(60) + runs(design(16) + sweep(LEVELS, REPEATS))


def laws(count: int) -> list[Case]:
    """Samples of laws by name."""
    return [
        Case({"part": "law", "law": law}, f"{SAMPLES}:sample_law", options={"law": law, "count": count}) for law in LAWS
    ]


def exposures(count: int, block: int = 20) -> list[Case]:
    """Exposures of the scene with all factors at their middles, in blocks, for two centroid estimators."""
    levels = levels_of(np.full(len(FACTORS), 0.5)) | {"stations": 4}
    found = []
    for centroid in CENTROIDS:
        for first in range(0, count, block):
            numbers = list(range(first, min(first + block, count)))
            options = {"centroid": centroid, "read_noise_e": NOISE_E, "exposures": numbers}
            labels = {"part": "exposures", "centroid": centroid, "first exposure": first}
            found.append(Case(labels, f"{RUNS}:expose_again", scene_of(levels), options, weight=2.0 * len(numbers)))
    return found


def design(base_rows: int) -> list[dict[str, Any]]:
    """Runs of Saltelli's design: for each base row its A, one AB for each factor, and B, as SALib orders them."""
    from SALib.sample.sobol import sample

    unit = sample(problem(), base_rows, calc_second_order=False, seed=6)
    blocks = ["A", *NAMES, "B"]
    return [
        {
            "run": f"design {k}",
            "repeat": 0,
            "set": "design",
            "base": k // len(blocks),
            "block": blocks[k % len(blocks)],
            "unit": row,
        }
        for k, row in enumerate(unit.tolist())
    ]


def sweep(levels: int, repeats: int) -> list[dict[str, Any]]:
    """Runs of one factor at a time, all others at their middles: as published grey analyses are made, but repeated."""
    found = []
    for k, name in enumerate(NAMES):
        for level, place in enumerate(np.linspace(0, 1, levels)):
            unit = np.full(len(FACTORS), 0.5)
            unit[k] = place
            entry = {"set": "sweep", "base": level, "block": name, "unit": unit.tolist()}
            found += [{"run": f"sweep {name} {level} {again}", "repeat": again} | entry for again in range(repeats)]
    return found


def problem() -> dict[str, Any]:
    """The design space as SALib names it."""
    return {"num_vars": len(FACTORS), "names": list(NAMES), "bounds": [[0, 1]] * len(FACTORS)}


def runs(designed: list[dict[str, Any]]) -> list[Case]:
    """Cases of runs: those that share a picture share a case. To measure a picture takes 0.7 of its rendering."""
    pictures: dict[str, Case] = {}
    for entry in designed:
        levels = levels_of(np.array(entry["unit"]))
        scene = scene_of(levels)
        labels = {"part": "runs", "picture": len(pictures)}
        new = Case(labels, f"{RUNS}:measure_runs", scene, {"runs": []} | WORKSHOP)
        case = pictures.setdefault(repr(scene), new)
        case.options["runs"].append(entry | {"read_noise_e": levels[NAMES[0]]})
    return [
        replace(case, weight=len((case.scene or {})["stations"]) * (1 + 0.7 * len(case.options["runs"])))
        for case in pictures.values()
    ]
