"""How good each joint of image and board is, how well each board's place is known, and what the residuals say."""

from collections import deque

import numpy as np
from scipy.stats import binom

from testfield.adjust.bundle import Adjustment
from testfield.adjust.reliability import SIGNIFICANCE, global_test, reliability


def joints(adjustment: Adjustment, stations: tuple[str, ...], boards: tuple[str, ...]) -> tuple[dict, ...]:
    """One entry an image and board: `marks`, their residuals' `rms_px`, their mean `redundancy` number (0 to 1)."""
    network, found = adjustment.network, []
    board = network.point_board[network.point]
    share = np.einsum("mii->m", adjustment.redundancy) / 2
    square = (adjustment.residual_px**2).sum(axis=1)
    pairs, place = np.unique(np.column_stack([network.image, board]), axis=0, return_inverse=True)
    for k, (i, b) in enumerate(pairs):
        if b < 0:
            continue
        here = place.ravel() == k
        found.append(
            {
                "station": stations[i],
                "board": boards[b],
                "marks": int(here.sum()),
                "rms_px": float(np.sqrt(square[here].mean())),
                "redundancy": float(share[here].mean()),
            }
        )
    return tuple(found)


def board_quality(
    covariance: np.ndarray, labels: tuple[str, ...], boards: tuple[str, ...], edges: tuple[dict, ...]
) -> tuple[dict, ...]:
    """One entry a board: standard uncertainties `u_position_mm` and `u_turn_mrad` (root of the axes' sum, none for
    the datum), `images` that show it, and `links`, how
    many images away from the datum board it is (none if apart)."""
    place = {label: k for k, label in enumerate(labels)}
    away = _links(boards, edges)
    found = []
    for name in boards:
        u = []
        for axes in (("tx", "ty", "tz"), ("rx", "ry", "rz")):
            at = [place[key] for axis in axes if (key := f"board:{name}.{axis}") in place]
            u.append(float(np.sqrt(covariance[at, at].sum())) if at else None)
        turn = None if u[1] is None else 1e3 * u[1]
        images = sum(edge["board"] == name for edge in edges)
        found.append({"board": name, "u_position_mm": u[0], "u_turn_mrad": turn, "images": images, "links": away[name]})
    return tuple(found)


def residual_test(adjustment: Adjustment) -> dict:
    """The global test; how many observations `contradict` all others at the level at which 0.1 % of good ones do, and
    `contradict_at_most` of good ones; how well they control each other."""
    test = global_test(adjustment)
    control = reliability(adjustment)
    worst = float(control.redundancy.min(initial=1.0))
    contradict = int(control.gross_errors.sum())
    return {
        "variance": test.variance,
        "low": test.low,
        "high": test.high,
        "freedom": test.freedom,
        "passed": test.passed,
        "contradict": contradict,
        "contradict_at_most": int(binom.ppf(0.975, len(control.test), SIGNIFICANCE)),
        "least_redundancy": worst,
        "uncontrolled": int(control.uncontrolled.sum()),
        "detectable_px": float(np.median(control.detectable_px)),
    }


def _links(boards: tuple[str, ...], edges: tuple[dict, ...]) -> dict[str, int | None]:
    seen_by: dict[str, set] = {name: {e["station"] for e in edges if e["board"] == name} for name in boards}
    away: dict[str, int | None] = {name: None for name in boards}
    away[boards[0]], queue = 0, deque([boards[0]])
    while queue:
        here = queue.popleft()
        for other in boards:
            if away[other] is None and seen_by[here] & seen_by[other]:
                away[other] = (away[here] or 0) + 1
                queue.append(other)
    return away
