"""How often to expose, and where (second-order design: the weights of observations)."""

from dataclasses import replace
from typing import Any

import numpy as np

from testfield.plan.goals import Goal, floor_of
from testfield.plan.network import Planned
from testfield.plan.predict import predict

COUNTS = (1, 2, 4, 8, 16)


def by_exposures(plan: Planned, goal: Goal) -> dict[str, Any]:
    """The goal's figure with n exposures from every station, whose mean has an n-th of the noise's variance; the
    `floor` that none of them passes, and what causes it."""
    rows = [{"exposures": n, "value": goal.of(predict(plan, n**-0.5))} for n in COUNTS]
    floor, shares = floor_of(plan, goal)
    return {
        "goal": goal.name,
        "rows": rows,
        "floor": floor,
        "floor_from": [{"certificate": name, "falls_by": share} for name, share in shares],
    }


def worth_of_stations(plan: Planned, goal: Goal) -> list[dict[str, Any]]:
    """Of every station the part by which a second exposure from it alone lowers the figure, the largest first."""
    network, before = plan.network, goal.of(predict(plan))
    place, rows = network.images.station[network.image], []
    for k, name in enumerate(plan.places):
        factor = np.where(place == k, 0.5, 1.0)
        better = replace(plan, network=replace(network, cov_px2=factor[:, None, None] * network.cov_px2))
        rows.append({"station": name, "gain": 1 - goal.of(predict(better)) / before})
    return sorted(rows, key=lambda row: -row["gain"])
