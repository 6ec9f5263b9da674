"""By how much an adjustment misses each certified length and place, and how well that is known."""

from dataclasses import dataclass

import numpy as np

from testfield.adjust.bundle import Adjustment
from testfield.adjust.network import EXACT_MM, Network
from testfield.adjust.reliability import global_test
from testfield.calibrate.certified import Certified
from testfield.calibrate.loose_discs import measured_radii
from testfield.calibrate.similarity import robust_similarity
from testfield.calibrate.ties import Ties
from testfield.camera.pose import cross_matrix
from testfield.targets.field import ScaleBar

U_DIAMETER = 0.07
"""Relative standard uncertainty of a scale by dots' diameters: what blur, paint and oblique views do to them."""
DISTANCE, PLACE, DIAMETERS, PLACES = "distance", "place", "diameters", "places"


@dataclass(frozen=True)
class Item:
    """A certificate as a possible blunder: its kind, its rows of the misclosure, its columns there (q, d), how it is
    called."""

    kind: str
    key: int
    columns: np.ndarray
    name: str


@dataclass(frozen=True)
class Misclosure:
    """Certified minus predicted `value` (q,) in mm with `cov` (q, q), the unknowns' `design` (q, p), of which the last
    is the network's relative scale; the certificates as possible blunders; the points at `here_mm` (k, 3); the dots'
    certified `diameter_mm`, their median."""

    value: np.ndarray
    cov: np.ndarray
    design: np.ndarray
    items: list[Item]
    here_mm: dict[int, np.ndarray]
    diameter_mm: float


def place_of(ties: Ties, code: int) -> int:
    """The row of a code among the points."""
    return int(np.flatnonzero(ties.code == code)[0])


def misclosure_of(
    adjustment: Adjustment,
    ties: Ties,
    bars: list[ScaleBar],
    known: dict[int, tuple[np.ndarray, np.ndarray]],
    certified: Certified,
) -> Misclosure:
    """The misclosure of what is certified, and its covariance, in an adjusted network."""
    network = adjustment.network
    codes = sorted({*known, *(c for bar in bars for c in bar.codes)})
    points = np.array([place_of(ties, c) for c in codes])
    column = {c: slice(3 * k, 3 * k + 3) for k, c in enumerate(codes)}
    test = global_test(adjustment)
    misfit = test.variance if test.variance > max(test.high, 1.0) else 1.0
    C = misfit * adjustment.cov.points(points)
    X = network.point_mm[points]
    s, R, t = 1.0, np.eye(3), np.zeros(3)
    if known:
        rows = [codes.index(c) for c in known]
        s, R, t = robust_similarity(X[rows], np.array([xyz for xyz, _ in known.values()]))
    at = {c: s * R @ X[k] + t for k, c in enumerate(codes)}
    own = radii_ratio(network, ties, certified)
    q = 3 * len(known) + len(bars) + (own is not None)
    value, own_cov, gain = np.zeros(q), np.zeros(q), np.zeros((q, 3 * len(codes)))
    motion, scale = np.zeros((q, 6)), np.zeros(q)
    items: list[Item] = []
    middle = np.mean([at[c] for c in codes], axis=0)
    for k, (c, (xyz, u)) in enumerate(known.items()):
        row = slice(3 * k, 3 * k + 3)
        value[row], own_cov[row] = xyz - at[c], np.maximum(u, EXACT_MM) ** 2
        gain[row, column[c]] = -s * R
        motion[row, :3], motion[row, 3:] = np.eye(3), -cross_matrix((at[c] - middle)[None])[0]
        scale[row] = at[c] - middle
        items.append(Item(PLACE, c, _columns(q, row), f"code {c}"))
    for k, bar in enumerate(bars):
        line = 3 * len(known) + k
        a, b = bar.codes
        length = float(np.linalg.norm(at[a] - at[b]))
        toward = (at[a] - at[b]) / max(length, 1e-12)
        value[line], own_cov[line] = bar.length_mm - length, max(bar.u_length_mm, EXACT_MM) ** 2
        gain[line, column[a]], gain[line, column[b]] = -s * toward @ R, s * toward @ R
        scale[line] = length
        items.append(Item(DISTANCE, k, _columns(q, slice(line, line + 1)), bar.name))
    if known and (bars or own is not None):
        items.append(
            Item(PLACES, 0, np.where(np.arange(q) < 3 * len(known), scale, 0)[:, None], "the certified places")
        )
    if own is not None:
        # In thousandths, so that the row is of the size of the others.
        value[-1], own_cov[-1], scale[-1] = 1000 * (own / s - 1), (1000 * U_DIAMETER) ** 2, 1000
        items.append(Item(DIAMETERS, 0, _columns(q, slice(q - 1, q)), "the dots' diameters"))
    design = np.column_stack([motion, scale]) if known else scale[:, None]
    told = certified.radii(ties.code)
    diameter = 2 * float(np.nanmedian(told)) if np.isfinite(told).any() else np.nan
    return Misclosure(value, np.diag(own_cov) + gain @ C @ gain.T, design, items, at, diameter)


def _columns(q: int, row: slice) -> np.ndarray:
    return np.eye(q)[:, row]


def radii_ratio(network: Network, ties: Ties, certified: Certified) -> float | None:
    """Certified over measured diameter of the dots, their median; none where nothing is certified or measured."""
    with np.errstate(invalid="ignore"):
        ratio = certified.radii(ties.code) / measured_radii(network, ties.moments_px2)
    return float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else None
