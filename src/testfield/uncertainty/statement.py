"""Linear result and Monte Carlo side by side: a statement for people and programs."""

from collections.abc import Callable
from typing import Any

import numpy as np

from testfield.reconstruct.points import Points
from testfield.targets.field import Field
from testfield.uncertainty.monte_carlo import VALIDATING, adaptive, of_few, tolerance, validate
from testfield.uncertainty.propagation import Lengths, Linear, linear
from testfield.uncertainty.supplement2 import adaptive_regions, coverage_factor


def quantities(points: Points, field: Field, asked: list[tuple[int, int]]) -> Linear:
    """The linear result of all points, of the bars both ends of which were reconstructed, and of further lengths
    `asked` for by their codes."""
    known = {int(code) for code in points.code}
    pairs = {bar.name: bar.codes for bar in field.scale_bars if set(bar.codes) <= known}
    pairs |= {f"{a} to {b}": (a, b) for a, b in asked}
    return linear(points, Lengths.between(points, pairs))


def of_blocks(
    points: Points,
    result: Linear,
    field: Field,
    block: Callable[[int], np.ndarray],
    most_trials: int,
    digits: int,
    shortest: bool,
) -> dict[str, Any]:
    """The statement from blocks of thousands of (M, n, 3) positions, as many as the adaptive stop asks for."""
    goal = tolerance(result.u_mm, digits) / VALIDATING
    trials = adaptive(lambda k: result.of(block(k)), goal, most_trials, shortest=shortest)
    judged = validate(result.value_mm, result.u_mm, trials, digits)
    answer = _statement(points, result, field, trials, judged, goal)
    region, reached, drawn = adaptive_regions(block, trials.trials)
    return answer | {
        "regions": {
            "k_gaussian": coverage_factor(),
            "trials": drawn,
            "settled": reached,
            "points": [
                {"code": int(code), "k": float(k), "half_axes_mm": axes.tolist(), "box_mm": box.tolist()}
                for code, k, axes, box in zip(points.code, region.k, region.axes_mm, region.box_mm, strict=True)
            ],
        }
    }


def of_trials(points: Points, result: Linear, field: Field, positions_mm: np.ndarray, digits: int) -> dict[str, Any]:
    """The statement from few costly trials (T, n, 3); those in which a point is missing count for none of them."""
    whole = np.isfinite(positions_mm).all(axis=(1, 2))
    trials = of_few(result.of(positions_mm[whole]), result.u_mm)
    judged = validate(result.value_mm, result.u_mm, trials, digits)
    goal = tolerance(result.u_mm, digits) / VALIDATING
    return _statement(points, result, field, trials, judged, goal) | {"incomplete": int((~whole).sum())}


def _statement(
    points: Points, result: Linear, field: Field, trials: Any, judged: Any, goal: np.ndarray
) -> dict[str, Any]:
    settled = trials.settled(goal)
    ends = {code for bar in field.scale_bars for code in bar.codes}
    rows = []
    for k, name in enumerate(result.names):
        length = k >= 3 * len(points)
        rows.append(
            {
                "name": name,
                "kind": "length" if length else "coordinate",
                "check_point": not length and int(points.code[k // 3]) not in ends,
                "linear": {"value_mm": float(result.value_mm[k]), "u_mm": float(result.u_mm[k])},
                "monte_carlo": {
                    "value_mm": float(trials.value[k]),
                    "u_mm": float(trials.u[k]),
                    "low_mm": float(trials.low[k]),
                    "high_mm": float(trials.high[k]),
                    "s_mm": trials.s[:, k].tolist(),
                    "settled": bool(settled[k]),
                },
                "d_low_mm": float(judged.d_low[k]),
                "d_high_mm": float(judged.d_high[k]),
                "delta_mm": float(judged.delta[k]),
                "validated": str(judged.verdict[k]),
            }
        )
    return {
        "probability": trials.p,
        "trials": trials.trials,
        "blocks": trials.blocks,
        "gaussian_interval": trials.gaussian,
        "settled": bool(settled.all()),
        "settled_share": float(settled.mean()),
        "quantities": rows,
    }
