"""What a plan can be asked to reach, and what keeps it from getting there."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testfield.adjust.network import Distances
from testfield.errors import TestfieldError, nearest
from testfield.plan.card import corner_px, over_length
from testfield.plan.network import Planned
from testfield.plan.predict import Prediction, predict

EXACT = 1e-3
"""By which a source's uncertainty is multiplied to ask what it costs."""


def largest_length_mm(found: Prediction) -> float:
    """The largest standard uncertainty of a check bar or of a measuring line's length; without any, of the distances
    between check targets."""
    bars = [bar.codes for bar in found.job.field.scale_bars if bar.role == "check"]
    lines = [(line.codes[0], code) for line in found.job.field.measuring_lines for code in line.codes[1:]]
    ends = [rows for codes in (*bars, *lines) if (rows := found.rows(codes)) is not None]
    if bars or lines:
        if len(ends) < len(bars) + len(lines):
            return float("inf")
        return float(found.points.u_lengths_mm(np.array(ends), found.xyz_mm).max())
    return max((row["u_most_mm"] for row in over_length(found)), default=float("inf"))


def _check(found: Prediction) -> np.ndarray:
    u = found.u_mm[found.is_check]
    return u if len(u) else found.u_mm


def rms_mm(found: Prediction) -> float:
    """Root mean square uncertainty per coordinate of the check targets, or of all points where there are none."""
    u = _check(found)
    return float(np.sqrt((u**2).mean())) if len(u) else float("inf")


def worst_mm(found: Prediction) -> float:
    """The largest uncertainty of a check target, root of its axes' sum."""
    u = _check(found)
    return float(np.sqrt((u**2).sum(axis=1)).max()) if len(u) else float("inf")


GOALS: dict[str, Callable[[Prediction], float]] = {
    "u_length_mm": largest_length_mm,
    "u_rms_mm": rms_mm,
    "u_worst_mm": worst_mm,
    "u_corner_px": corner_px,
}
"""By name, what a goal is about: smaller is better."""


@dataclass(frozen=True)
class Goal:
    """A figure by `name` of GOALS, and the `most` that it may be (infinity: as small as can be)."""

    name: str
    most: float = float("inf")

    @staticmethod
    def parse(text: str) -> "Goal":
        """`u_length_mm=0.02` as a goal. Raises `TestfieldError` for a name or a number that is none."""
        name, equals, value = text.partition("=")
        if name not in GOALS:
            raise TestfieldError(f"no goal is called '{name}'", "--goal", nearest(name, list(GOALS)))
        try:
            most = float(value)
        except ValueError:
            most = float("nan")
        if not equals or not 0 < most < float("inf"):
            raise TestfieldError(f"value '{value}' is no uncertainty", f"--goal {name}", f"write {name}=0.02")
        return Goal(name, most)

    def of(self, found: Prediction) -> float:
        """The figure."""
        return GOALS[self.name](found)

    def score(self, found: Prediction | None) -> float:
        """What is made smallest: the figure, and much more for every target that is not measured."""
        if found is None:
            return float("inf")
        missing = len(found.job.field.loose) - len(found.code)
        value = self.of(found)
        if not np.isfinite(value):
            value = rms_mm(found) + found.job.world.field_diagonal_mm
        return value + missing * found.job.world.field_diagonal_mm


def floor_of(plan: Planned, goal: Goal) -> tuple[float, list[tuple[str, float]]]:
    """The figure with perfect pixels, as of infinitely many exposures, which no station can mend, and by which part its
    square would fall if each kind of certificate were exact, the largest first. Together they may exceed 1: where two
    sources determine the same, either would do."""
    floor = goal.of(predict(plan, EXACT))
    shares = []
    for name, better in certificates_exact(plan).items():
        left = goal.of(predict(better, EXACT))
        shares.append((name, float(np.clip(1 - (left / floor) ** 2, 0, 1))) if floor > 0 else (name, 0.0))
    return floor, sorted(shares, key=lambda share: -share[1])


def certificates_exact(plan: Planned) -> dict[str, Planned]:
    """The plan with each kind of certificate a thousand times as good."""
    network, found = plan.network, {}
    d = network.distances
    if len(d):
        bars = Distances(d.ends, d.length_mm, EXACT * d.u_mm)
        found["the control bars' certificates"] = replace(network, distances=bars)
    if network.u_scale > 0:
        found["the scale of the prints"] = replace(network, u_scale=EXACT * network.u_scale)
    found["the places of the marks on their boards"] = replace(network, information=network.information / EXACT**2)
    return {name: replace(plan, network=better) for name, better in found.items()}
