"""Where the next stations gain most (first-order design; Grafarend 1974, Fraser 1984): one after another, each the best
of the candidates by what the whole bundle would then know, and exchanged while another does better.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testfield.errors import TestfieldError
from testfield.plan.goals import Goal, floor_of
from testfield.plan.predict import Prediction
from testfield.plan.subsets import Choice

SHORTLIST = 24
"""Candidates that are predicted in full for every station; more are sieved by a quick look first."""
EXCHANGES = 3
"""Rounds in which every proposed station may be exchanged."""
GAIN = 1e-3
"""Part by which an exchange must be better."""
MOST_STATIONS = 60
HOPELESS = 1e15


@dataclass(frozen=True)
class Design:
    """What was proposed: `chosen` candidates by number, in the order in which they gain; `steps` (n + 1) figures of the
    goal with none, one, two ... of them before exchanges; `found` the prediction with all; `value` its figure."""

    chosen: tuple[int, ...]
    steps: tuple[float, ...]
    found: Prediction
    value: float
    reached: bool


def propose(
    choice: Choice,
    goal: Goal,
    most: int = MOST_STATIONS,
    least: int = 0,
    keep: tuple[int, ...] | None = None,
    tell: Callable[[str], None] = lambda _: None,
    shortlist: int = SHORTLIST,
) -> Design:
    """Stations added to those of the scene (or to those of them that are kept) until the goal is reached, at most
    `most`, at least `least`, and exactly `most` where the goal is only to become as small as can be; then exchanged.

    Raises `TestfieldError`, saying what limits it, where the goal is not reached by that many.
    """
    base = list(range(choice.stations)) if keep is None else list(keep)
    added: list[int] = []
    here = choice.predict(base)
    value, steps = goal.score(here), [goal.of(here) if here else float("inf")]
    if np.isfinite(goal.most):
        _refuse_what_nothing_reaches(choice, goal)
    else:
        least = most
    while len(added) < most and (value > goal.most or len(added) < least):
        best, value = _best(choice, goal, base, added, here, shortlist)
        if best is None:
            break
        added.append(best)
        here = choice.predict(base + added)
        steps.append(value)
        tell(f"station {len(added)}: {goal.name} {value:.4g}")
    added, value = exchanged(choice, goal, base, added, value, shortlist, tell)
    found = choice.predict(base + added)
    if found is None:
        raise TestfieldError(
            "no choice of the candidates determines the network", f"{choice.job.source}, stations", "add boards"
        )
    value = goal.of(found)
    if value > goal.most:
        raise _not_reached(choice, goal, found, len(added))
    numbers = tuple(k - choice.stations for k in added)
    return Design(numbers, tuple(steps), found, value, value <= goal.most)


def _best(
    choice: Choice, goal: Goal, base: list[int], added: list[int], here: Prediction | None, shortlist: int
) -> tuple[int | None, float]:
    """The candidate that makes the figure smallest, and the figure."""
    all_new = range(choice.stations, choice.stations + len(choice.candidates))
    free = [k for k in all_new if k not in added]
    if len(free) > shortlist:
        free = promising(choice, here, free, shortlist)
    scores = [_score(choice, goal, [*base, *added, k]) for k in free]
    if not scores:
        return None, float("inf")
    at = int(np.argmin(scores))
    return free[at], scores[at]


def _score(choice: Choice, goal: Goal, chosen: list[int]) -> float:
    """The figure to be made smallest; of networks too small to have any, the fewer observations the larger."""
    found = goal.score(choice.predict(chosen))
    return found if np.isfinite(found) else HOPELESS - sum(len(choice.rows_of(k)) for k in chosen)


def promising(choice: Choice, here: Prediction | None, free: list[int], count: int) -> list[int]:
    """Half of the candidates by what they tell of points as if their own poses were known (limiting error propagation,
    Fraser 1984), the rest spread over all the others, as they may help the camera or the boards instead."""
    if here is None or not len(here.code):
        return [free[k] for k in np.linspace(0, len(free) - 1, count).astype(int)]
    gains = [_limiting(choice, here, k) for k in free]
    order = np.argsort(gains)
    first = order[: count // 2]
    others = np.setdiff1d(np.arange(len(free)), first)
    spread = others[np.unique(np.linspace(0, len(others) - 1, count - len(first)).astype(int))]
    return [free[k] for k in (*first, *spread)]


def _limiting(choice: Choice, here: Prediction, number: int) -> float:
    """The points' mean variance with one station more whose pose and camera are known."""
    from testfield.camera.project import camera_jacobian

    rows = choice.rows_of(number)
    code = choice.job.world.marks.code[rows.mark]
    point = np.searchsorted(here.code, code)
    met = (choice.job.world.marks.board[rows.mark] < 0) & (point < len(here.code))
    met[met] = here.code[point[met]] == code[met]
    rows, point = rows.take(met), point[met]
    pose = choice.candidates.poses[np.full(len(rows), number - choice.stations)]
    datum = here.planned.datum
    at_camera = pose.apply(choice.job.world.mark_world_mm[rows.mark])
    B = camera_jacobian(here.adjustment.network.interior, at_camera)[2] @ pose.R @ datum.R[0]
    information = np.linalg.inv(here.blocks)
    np.add.at(information, point, np.swapaxes(B, 1, 2) @ np.linalg.solve(rows.cov_px2, B))
    return float(np.einsum("nii->", np.linalg.inv(information)))


def exchanged(
    choice: Choice,
    goal: Goal,
    base: list[int],
    added: list[int],
    value: float,
    shortlist: int = SHORTLIST,
    tell: Callable[[str], None] = lambda _: None,
) -> tuple[list[int], float]:
    """The stations after every one was offered an exchange, until none gains any more."""
    for _ in range(EXCHANGES if len(added) > 1 else 0):
        before = value
        for k in range(len(added)):
            others = added[:k] + added[k + 1 :]
            here = choice.predict(base + others) if base or others else None
            best, found = _best(choice, goal, base, others, here, shortlist)
            if best is not None and found < value * (1 - GAIN):
                added, value = [*others[:k], best, *others[k:]], found
                tell(f"station {k + 1} exchanged: {goal.name} {value:.4g}")
        if value >= before * (1 - GAIN):
            break
    return added, value


def _refuse_what_nothing_reaches(choice: Choice, goal: Goal) -> None:
    """Raise where even perfect pixels from everywhere leave more than the goal: certificates decide then.

    Where a part of many candidates reaches it, all do, so all are only asked where the part does not."""
    everything = list(range(choice.stations + len(choice.candidates)))
    asked = [everything]
    if len(everything) > MOST_STATIONS:
        chosen = np.linspace(0, len(everything) - 1, MOST_STATIONS).astype(int)
        asked.insert(0, [everything[k] for k in np.unique([*range(choice.stations), *chosen])])
    for stations in asked:
        found = choice.predict(stations)
        if found is None:
            return
        floor, shares = floor_of(found.planned, goal)
        if floor <= goal.most:
            return
    named = ", ".join(f"{name} {100 * share:.0f} %" for name, share in shares if share > 0.01)
    raise TestfieldError(
        f"no number of stations reaches {goal.name} = {goal.most:g}: with perfect pixels from all {len(everything)} "
        f"places {floor:.4g} is left" + (f" (exact, its square would fall by: {named})" if named else ""),
        f"{choice.job.source}, stations",
        f"better certificates, or ask for more than {floor:.3g}",
    )


def _not_reached(choice: Choice, goal: Goal, found: Prediction, added: int) -> TestfieldError:
    floor, shares = floor_of(found.planned, goal)
    name, share = shares[0]
    pixels = 1 - (floor / goal.of(found)) ** 2
    most = f"{100 * pixels:.0f} % with perfect pixels" + (
        f", then {100 * share:.0f} % with {name} exact" if share > 0.01 else ""
    )
    return TestfieldError(
        f"{goal.name} = {goal.most:g} is not reached with {added} stations more: {goal.of(found):.4g} is left "
        f"(its square would fall by {most})",
        f"{choice.job.source}, stations",
        "allow more with --most, nearer or other --candidates, a longer lens, or more exposures (--exposures)",
    )
