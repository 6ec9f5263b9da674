"""Which parts of boards' sheets hold: marks, a sheet's spacing, certified poses, the common scale, control bars.

All of them are observations of the bundle, so each is tested by its own residual: what is known minus adjusted, whose
covariance is that of what was known less that of what was adjusted (Baarda 1968). A wrong sheet shows in many pixels,
none of which is wrong; so sheets are asked before pixels are rejected, and the larger misfit is believed.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist, squareform
from scipy.stats import chi2 as chi_squared

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import EXACT_MM, Distances, Network
from testfield.adjust.reliability import global_test
from testfield.adjust.snooping import TOLD_APART, Blunder, snoop
from testfield.calibrate.units import unit_of

FALSE_ALARM = 0.001
"""Chance that any good certificate at all of one kind is called wrong."""
LEAST_MM, LEAST_RAD = 1e-3, 1e-6
"""Standard deviations to which exact certificates are loosened while they are suspected: of what cannot move nothing
shows."""
FEW = 0.2
"""Part of a board's marks that may be misplaced one by one before the board's whole sheet is called wrong."""
CONTROLLED = 1e-6
"""Redundancy number below which a certificate's error shows nowhere."""
SHAPE = 0.5
"""Part of neighbouring marks that must be as much too far apart as the others before a sheet is called stretched."""


@dataclass(frozen=True)
class Suspect:
    """The part of a sheet that misses the rest most: `value` of its test, chi-squared of `rank` degrees of freedom if
    all is well; `board`, and `marks` of it by their points' numbers in the network, or its `pose`, or, with none of
    both, its whole sheet; `alike`, another board that explains it as well; what is `said` of it."""

    value: float
    rank: int
    board: int
    marks: tuple[int, ...]
    pose: bool
    alike: int | None
    said: str


def loosened(network: Network) -> Network:
    """The network with exact marks and poses known to `LEAST_MM` and `LEAST_RAD` only."""
    diagonal = np.einsum("nii->ni", network.information)
    most = np.minimum(diagonal, 1 / LEAST_MM**2)
    known = network.known_boards
    if known:
        known = replace(known, u=np.maximum(known.u, [LEAST_RAD] * 3 + [LEAST_MM] * 3))
    return replace(network, information=most[:, :, None] * np.eye(3), known_boards=known)


def suspect(adjustment: Adjustment, boards: tuple[str, ...], names: list[str], typical: float) -> Suspect | None:
    """The part of a sheet that misses the rest most, if any does by more than chance, where all misfits are `typical`
    times what is claimed; `names` (n,) of the points."""
    network = adjustment.network
    found = [*_poses(adjustment, boards, typical)]
    blocks = adjustment.cov.point_blocks()
    for b in range(len(boards)):
        found += _of_board(adjustment, b, blocks, boards, names, typical)
    limit = FALSE_ALARM / max(len(names), 1)
    found = [s for s in found if s.rank and s.value > chi_squared.ppf(1 - limit, s.rank)]
    if not found:
        return None
    best = max(found, key=lambda s: s.value - s.rank)
    if best.pose or best.marks or network.point_board.max() < 1:
        return best
    rivals = [s for s in found if s.board != best.board and not s.pose and not s.marks]
    close = [s for s in rivals if s.value > best.value - max(TOLD_APART, 0.02 * best.value)]
    if not close:
        return best
    # Where two boards stand against each other, the one that comes first on the sheet is believed.
    last = max([best, *close], key=lambda s: s.board)
    return replace(last, alike=min(s.board for s in [best, *close]))


def _of_board(
    adjustment: Adjustment, b: int, blocks: np.ndarray, boards: tuple[str, ...], names: list[str], typical: float
) -> list[Suspect]:
    """The board's stretched sheet and its most misplaced marks; `blocks` (n, 3, 3) are the points' covariances."""
    network = adjustment.network
    marks = np.intersect1d(np.flatnonzero(network.point_board == b), network.seen_points)
    known = np.einsum("nii->ni", network.information)[marks]
    marks, known = marks[known[:, 0] > 0], known[known[:, 0] > 0]
    if len(marks) < 4:
        return []
    v = (network.known_mm - network.point_mm)[marks] / typical
    x, y = (network.known_mm[marks, :2] - network.known_mm[marks, :2].mean(axis=0)).T
    columns = np.zeros((3, len(marks), 3))
    columns[0, :, 0], columns[1, :, 1] = x, y
    columns[2, :, 0], columns[2, :, 1] = y, x
    # With weights P and residuals v of covariance U - C, a blunder H has the normal matrix H' P (U - C) P H and the
    # right side H' P v.
    pulled = (columns * known).reshape(3, -1)
    C = adjustment.cov.joint(np.zeros((3, len(adjustment.covariance))), marks, pulled)
    value, rank, _ = _test(pulled @ v.ravel(), pulled @ columns.reshape(3, -1).T - C)
    said = f"the sheet of board '{boards[b]}' does not fit it ({np.sqrt(value):.3g} standard deviations)"
    answer = [Suspect(value, rank, b, (), False, None, said)]
    tests = [_test(p * e, np.diag(p) - p[:, None] * c * p) for p, e, c in zip(known, v, blocks[marks], strict=True)]
    values = np.array([t[0] for t in tests])
    rays = np.bincount(network.point, minlength=len(network.point_mm))[marks]
    values[rays < 2] = 0
    worst = int(np.argmax(values))
    chosen = np.flatnonzero((values > 0.5 * values[worst]) & (values > 30))
    chosen = chosen if len(chosen) else np.array([worst])
    said = "; ".join(
        f"{names[marks[k]]} of board '{boards[b]}' is {np.linalg.norm(tests[k][2]) * typical:.3g} mm off its sheet "
        f"({np.sqrt(values[k]):.3g} standard deviations)"
        for k in chosen
    )
    answer.append(Suspect(values[worst], tests[worst][1], b, tuple(marks[chosen].tolist()), False, None, said))
    return answer


def _poses(adjustment: Adjustment, boards: tuple[str, ...], typical: float) -> list[Suspect]:
    """Every certified pose."""
    network = adjustment.network
    if not network.known_boards:
        return []
    labels = network.labels(tuple(map(str, range(len(network.stations)))), tuple(map(str, range(len(boards)))))
    off = network.known_boards.deviation(network.boards)
    answer = []
    for b, ways in enumerate(network.ways):
        P = network.known_boards.information[b]
        if not ways.size or not (P > 1e-18).any():
            continue
        at = [labels.index(f"board:{b}.{axis}") for axis in ("rx", "ry", "rz", "tx", "ty", "tz")]
        C = adjustment.covariance[np.ix_(at, at)]
        v = off[b] / typical
        value, rank, amount = _test(P * v, np.diag(P) - P[:, None] * C * P)
        amount = amount * typical
        answer.append(
            Suspect(
                value,
                rank,
                b,
                (),
                True,
                None,
                f"the certified pose of board '{boards[b]}' is off by {np.linalg.norm(amount[3:]):.3g} mm and "
                f"{1e3 * np.linalg.norm(amount[:3]):.3g} mrad ({np.sqrt(value):.3g} standard deviations)",
            )
        )
    return answer


def _test(right: np.ndarray, normal: np.ndarray) -> tuple[float, int, np.ndarray]:
    """Value, rank and estimate of a blunder from its normal equations, at unit diagonal; what nothing controls left
    out."""
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    values, vectors = np.linalg.eigh(normal / size[:, None] / size)
    kept = values > CONTROLLED
    along = vectors[:, kept].T @ (right / size)
    amount = vectors[:, kept] @ (along / values[kept]) / size
    return float((along**2 / values[kept]).sum()), int(kept.sum()), amount


def stretch(network: Network, board: int, labels: list[str]) -> tuple[float, float, float]:
    """How many times too large a board's sheet makes the distances between neighbours in x and in y, as the other
    boards show it, and the part (0 to 1) of neighbours of which that is so.

    Its marks are adjusted as if hardly anything were known of them. Medians: a zone of the board may be right.
    """
    marks = np.intersect1d(np.flatnonzero(network.point_board == board), network.seen_points)
    known = network.known_mm[marks, :2]
    information = network.information.copy()
    information[marks] = np.eye(3) / (0.1 * float(np.linalg.norm(np.ptp(known, axis=0)))) ** 2
    found = adjust(replace(network, information=information), labels).network.point_mm[marks, :2]
    a, b = np.nonzero(np.triu(squareform(pdist(known)) < 1.5 * np.median(cKDTree(known).query(known, 2)[0][:, 1]), 1))
    sheet, seen = known[b] - known[a], found[b] - found[a]
    factor, alike = [1.0, 1.0], []
    for axis in (0, 1):
        along = np.abs(sheet[:, axis]) > 4 * np.abs(sheet[:, 1 - axis])
        if along.sum() < 3:
            continue
        ratio = np.linalg.norm(sheet[along], axis=1) / np.maximum(np.linalg.norm(seen[along], axis=1), 1e-12)
        factor[axis] = float(np.median(ratio))
        alike.append(np.abs(ratio / factor[axis] - 1) < 0.3 * np.abs(np.array(factor) - 1).max() + 1e-4)
    return factor[0], factor[1], float(np.concatenate([*alike, np.zeros(0)]).mean()) if alike else 0.0


def without_suspect(network: Network, found: Suspect) -> Network:
    """The network with a suspected mark or pose known no more."""
    if found.pose and network.known_boards:
        u = network.known_boards.u.copy()
        u[found.board] = np.inf
        return replace(network, known_boards=replace(network.known_boards, u=u))
    information = network.information.copy()
    information[list(found.marks)] = 0
    return replace(network, information=information)


@dataclass(frozen=True)
class Bars:
    """Control bars after their test: the `network` with those that hold, `records`, `notes` and `failures`."""

    network: Network
    records: tuple[dict, ...]
    notes: tuple[str, ...]
    failures: tuple[str, ...]


def tested_bars(adjustment: Adjustment, bars: Distances, names: tuple[str, ...]) -> Bars:
    """Test distances `bars` called `names` against an adjustment without them, and the boards' scale against them."""
    network = adjustment.network
    seen = np.asarray(np.isin(bars.ends, network.seen_points).all(axis=1))
    notes = [
        f"control bar '{names[k]}' lost an end to rejected observations and is left out" for k in np.flatnonzero(~seen)
    ]
    names = tuple(name for name, here in zip(names, seen, strict=True) if here)
    bars = Distances(bars.ends[seen], bars.length_mm[seen], bars.u_mm[seen])
    if not len(bars):
        return Bars(network, (), tuple(notes), ())
    points, place = np.unique(bars.ends, return_inverse=True)
    place = place.reshape(-1, 2)
    gap = network.point_mm[bars.ends[:, 0]] - network.point_mm[bars.ends[:, 1]]
    length = np.linalg.norm(gap, axis=1)
    gain = np.zeros((len(bars), len(points), 3))
    rows = np.arange(len(bars))
    gain[rows, place[:, 0]] += gap / length[:, None]
    gain[rows, place[:, 1]] -= gap / length[:, None]
    flat = gain.reshape(len(bars), -1)
    test = global_test(adjustment)
    misfit = test.variance if test.variance > max(test.high, 1.0) else 1.0
    cov = misfit * flat @ adjustment.cov.points(points) @ flat.T
    cov += np.diag(np.maximum(bars.u_mm, EXACT_MM) ** 2)
    possible = [np.eye(len(bars))[:, [k]] for k in rows] + [length[:, None]]
    off = snoop(
        bars.length_mm - length,
        cov,
        np.zeros((len(bars), 0)),
        possible,
        ["distance"] * len(bars) + ["scale"],
        [*(1 + rows).tolist(), 0],
        FALSE_ALARM,
    )
    failures: list[str] = []
    good, u_scale = np.ones(len(bars), bool), network.u_scale
    for blunder in off.found:
        rivals = [f"control bar '{names[k]}'" if k < len(bars) else "the boards' sheets" for k in blunder.alike]
        if blunder.number < len(bars):
            good[blunder.number] = False
            part = abs(float(blunder.amount[0])) / length[blunder.number]
            said = f"{_of_bar(blunder, bars, names)} It is left out"
            if len(bars) in blunder.alike and part < 0.5:
                u_scale = float(np.hypot(u_scale, part / np.sqrt(2)))
        else:
            part = float(blunder.amount[0])
            u_scale = max(1.0, abs(part))
            said = f"by the control bars, which make the scale, all boards' sheets are off by {100 * part:+.3g} %"
        if rivals:
            left = "the boards' sheets" if len(bars) in blunder.alike or good.sum() == 0 else "the others"
            said += f"; nothing decides between it and {', '.join(rivals)}: the scale is from {left}"
            failures.append(said)
        notes.append(said)
    records = tuple(
        {
            "certificate": name,
            "kind": "distance",
            "sigmas": float(off.sigmas[k]),
            "used": bool(good[k]),
            "off": float(bars.length_mm[k] - length[k]),
            "contradicts": [],
        }
        for k, name in enumerate(names)
    )
    kept = Distances(bars.ends[good], bars.length_mm[good], bars.u_mm[good])
    return Bars(replace(network, distances=kept, u_scale=u_scale), records, tuple(notes), tuple(failures))


def _of_bar(blunder: Blunder, bars: Distances, names: tuple[str, ...]) -> str:
    k, by = blunder.number, float(blunder.amount[0])
    certified = bars.length_mm[k]
    ratio = max((certified - by) / certified, 1e-12)
    unit = f" {unit_of(ratio)}" if abs(np.log(ratio)) > np.log(1.5) else ""
    return (
        f"control bar '{names[k]}' is certified as {certified:g} mm, and the rest makes it {certified - by:.7g} mm: "
        f"{by:+.4g} mm, {blunder.sigmas:.3g} standard deviations.{unit}"
    )
