"""Which certificates of a free network hold: distances, places, diameters, each tested against what the images made of
it and against each other, before it may pull at anything (Baarda's w-test; `adjust.snooping`).

The images settle among themselves first, so a wrong certificate costs no observation. Its misclosure is certified minus
predicted, with the covariance of both; unknown is only where the network lies and how large it is.
"""

from dataclasses import dataclass, replace

import numpy as np

from testfield.adjust.bundle import Adjustment
from testfield.adjust.datum import aligned
from testfield.adjust.network import EXACT_MM, Distances, Network
from testfield.adjust.snooping import Blunder, Snooped, snoop
from testfield.calibrate.certificates_said import (
    called,
    other_unit,
    part_of,
    record_of,
    said_of_certificates,
    scale_source,
)
from testfield.calibrate.certified import OTHER_UNIT, Certified, radii
from testfield.calibrate.loose_discs import measured_radii
from testfield.calibrate.misclosure import DIAMETERS, DISTANCE, PLACE, PLACES, Item, Misclosure, misclosure_of, place_of
from testfield.calibrate.similarity import on_a_line, robust_similarity
from testfield.calibrate.ties import Ties
from testfield.targets.field import ScaleBar

FALSE_ALARM = 0.001
"""Chance that any good certificate at all of a field is called wrong. Small, as in Baarda (1968): a good bar that is
left out takes the scale with it, and certificates that are wrong are wrong by many times what they claim."""
SCATTERED, CONTRADICT = 1.5, 3.0
"""How many times as much as they claim certificates scatter from which it is said, and from which they do not hold."""
DOTS_MM = (0.1, 1000.0)
"""Between these are the diameters of targets that people print and stick; others make a length's unit doubtful."""
BENT = 0.01
"""Part of their extent by which most certified places may miss the network before all of them are in doubt."""
MOST_LEFT_OUT = {PLACE: 0.4, DISTANCE: 0.5}
"""Part of the certificates of a kind that may be wrong before nobody can say which are: two distances of four that
agree confirm each other; three places of six, of which seven unknowns are determined, hardly do."""


@dataclass(frozen=True)
class Tested:
    """Certificates after their test: `bars` (with uncertainties that cover a contradiction nothing decides) and `known`
    places that hold; `scale` that brings the network to them, where no places do; `scale_from` as in `InDatum`;
    `records`, one a certificate; `notes`; `failures`, sentences on what nothing decides."""

    bars: tuple[ScaleBar, ...]
    known: dict[int, tuple[np.ndarray, np.ndarray]]
    scale: float
    scale_from: str
    records: tuple[dict, ...] = ()
    notes: tuple[str, ...] = ()
    failures: tuple[str, ...] = ()


def without_certificates(network: Network, ties: Ties, certified: Certified) -> Network:
    """The network as the images alone have it, at its present scale.

    One distance holds that scale, as long as the network has it now: alone, it contradicts nothing.
    """
    place = {int(code): k for k, code in enumerate(ties.code)}
    bars = [bar for bar in certified.bars if set(bar.codes) <= set(place)]
    known = [c for c in certified.known if c in place]
    free = replace(network, distances=Distances(), information=np.zeros_like(network.information))
    if bars:
        ends, u = [place[c] for c in bars[0].codes], bars[0].u_length_mm
    elif len(known) >= 3:
        at = network.point_mm[[place[c] for c in known]]
        far = [int(np.argmax(np.linalg.norm(at - at[0], axis=1)))]
        far.append(int(np.argmax(np.linalg.norm(at - at[far[0]], axis=1))))
        ends, u = [place[known[k]] for k in far], float(certified.known[known[far[0]]][1].max())
    else:
        return free
    length = float(np.linalg.norm(network.point_mm[ends[0]] - network.point_mm[ends[1]]))
    return replace(free, distances=Distances(np.array([ends]), np.array([length]), np.array([u])))


def tested(adjustment: Adjustment, ties: Ties, certified: Certified, scale_from: str) -> Tested:
    """Test what is `certified` against an adjustment without it, whose points are near their scale and datum."""
    have = set(ties.code.tolist())
    bars = [bar for bar in certified.bars if set(bar.codes) <= have]
    lost = [bar for bar in certified.bars if not set(bar.codes) <= have]
    notes = [f"the distance '{bar.name}' lost an end to rejected observations and is left out" for bar in lost]
    known = {c: v for c, v in certified.known.items() if c in have}
    if known and (len(known) < 3 or on_a_line(np.array([v[0] for v in known.values()]))):
        notes.append("too few certified places are left: the network is free")
        known = {}
    if not bars and not known:
        left = scale_from if scale_from == "diameters" else "nothing"
        return Tested((), {}, 1.0, left, notes=tuple(notes))
    if known and (said := _in_doubt(adjustment.network, ties, known)):
        known, failed = {}, (said,)
        rest = tested(adjustment, ties, Certified(tuple(bars), {}, certified.diameter_mm), "nothing")
        return replace(rest, notes=(*notes, said, *rest.notes), failures=(*failed, *rest.failures))
    off = misclosure_of(adjustment, ties, bars, known, certified)
    snooped = snoop(
        off.value,
        off.cov,
        off.design,
        [item.columns for item in off.items],
        [item.kind for item in off.items],
        [_rank(item) for item in off.items],
        FALSE_ALARM,
    )
    return _judged(off, snooped, bars, known, notes)


def attached(
    network: Network, ties: Ties, radius_mm: np.ndarray, held: Tested, certified: Certified
) -> tuple[Network, np.ndarray]:
    """The network with the certificates that hold, near its scale and datum, and its discs' radii (n,)."""
    place = {int(code): k for k, code in enumerate(ties.code)}
    if held.known:
        points = np.array([place[c] for c in held.known])
        network = aligned(network, np.array([v[0] for v in held.known.values()]), points, True)
        information, values = network.information.copy(), network.known_mm.copy()
        for p, (xyz, u) in zip(points, held.known.values(), strict=True):
            information[p], values[p] = np.diag(1 / np.maximum(u, EXACT_MM) ** 2), xyz
        network = replace(network, information=information, known_mm=values)
    elif held.scale != 1.0:
        seen = network.seen_points
        middle = network.point_mm[seen].mean(axis=0)
        network = aligned(network, middle + held.scale * (network.point_mm[seen] - middle), seen, True)
    if abs(held.scale - 1) > 1e-3:
        radius_mm = radii(certified.radii(ties.code), measured_radii(network, ties.moments_px2))
    ends = np.array([[place[c] for c in bar.codes] for bar in held.bars], int).reshape(-1, 2)
    lengths = np.array([bar.length_mm for bar in held.bars], float)
    u = np.array([bar.u_length_mm for bar in held.bars], float)
    return replace(network, distances=Distances(ends, lengths, u)), radius_mm


def doubtful_scale(network: Network, ties: Ties, held: Tested) -> list[str]:
    """A question where by what holds the dots become of a size that no targets have."""
    with np.errstate(invalid="ignore"):
        diameter = 2 * measured_radii(network, ties.moments_px2)
    if not (held.bars or held.known) or not np.isfinite(diameter).any():
        return []
    middle = float(np.nanmedian(diameter))
    if DOTS_MM[0] <= middle <= DOTS_MM[1]:
        return []
    by = "the certified places" if held.known else f"the distance '{held.bars[0].name}'"
    unit = "metres, feet or inches" if middle < DOTS_MM[0] else "micrometres"
    return [f"with {by} the dots would be {middle:.3g} mm in diameter: is it in {unit} instead of millimetres?"]


def _in_doubt(network: Network, ties: Ties, known: dict[int, tuple[np.ndarray, np.ndarray]]) -> str:
    """A sentence where most places miss the network by more than it can be bent; none else."""
    here = network.point_mm[[place_of(ties, c) for c in known]]
    target = np.array([xyz for xyz, _ in known.values()])
    if len(known) < 4:
        return ""

    def middle(at: np.ndarray) -> float:
        scale, R, t = robust_similarity(at, target)
        return float(np.median(np.linalg.norm(scale * at @ R.T + t - target, axis=1)))

    extent = float(np.linalg.norm(np.ptp(target, axis=0)))
    allowed = max(BENT * extent, 6 * max(float(u.max()) for _, u in known.values()))
    off = middle(here)
    if off < allowed:
        return ""
    mirrored = middle(here * [-1, 1, 1]) < allowed
    why = (
        "they fit its mirror image (are x and y exchanged?)"
        if mirrored
        else "are they of other codes, or another field?"
    )
    return f"most certified places miss the network by {off:.3g} mm or more: {why}; none of them is used"


def _rank(item: Item) -> int:
    """Which certificate is left out where nothing decides: diameters first, then the last of the distances."""
    return {PLACES: -1, PLACE: 0, DISTANCE: 1 + item.key, DIAMETERS: 1_000_000}[item.kind]


def _judged(
    off: Misclosure,
    snooped: Snooped,
    bars: list[ScaleBar],
    known: dict[int, tuple[np.ndarray, np.ndarray]],
    notes: list[str],
) -> Tested:
    """What holds, and what is said of what does not."""
    failures: list[str] = []
    dropped: dict[int, Blunder] = {b.number: b for b in snooped.found}
    gone: dict[str, list[int]] = {DISTANCE: [], PLACE: []}
    for k in dropped:
        gone.setdefault(off.items[k].kind, []).append(off.items[k].key)
    places = {} if PLACES in gone else {c: v for c, v in known.items() if c not in gone[PLACE]}
    if len(places) < 3 or on_a_line(np.array([v[0] for v in places.values()])):
        places = {}
    left = {k: bar for k, bar in enumerate(bars) if k not in gone[DISTANCE]}
    scale_from = "control points" if places else "distances" if left else "nothing"
    widest = 0.0
    for k, blunder in dropped.items():
        item = off.items[k]
        rivals = [off.items[j] for j in blunder.alike]
        said = said_of_certificates(item, blunder, off, bars, known)
        if not rivals:
            notes.append(f"{said}: it is left out")
            if item.kind == DIAMETERS and other_unit(1 + float(blunder.amount[0]) / 1000):
                failures.append(notes[-1])
            continue
        names = ", ".join(called(rival, bars) for rival in rivals)
        part = part_of(item, blunder, bars)
        source = scale_source(scale_from, left.values())
        sentence = f"{said}, and nothing decides between it and {names}: the scale is from {source}"
        if item.kind == DISTANCE and any(r.kind == DISTANCE for r in rivals) and part < OTHER_UNIT - 1:
            widest = max(widest, part / np.sqrt(2))
            sentence += f", with an uncertainty of {100 * widest:.2g} % that covers the other"
        notes.append(sentence)
        failures.append(sentence)
    if known and not places:
        notes.append("the certified places contradict each other or the rest: the network is free")
        failures.append(notes[-1])
    for kind, count in ((PLACE, len(known)), (DISTANCE, len(bars))):
        if count > 2 and len(gone[kind]) > MOST_LEFT_OUT[kind] * count and not failures:
            notes.append(
                f"{len(gone[kind])} of {count} {kind}s are left out: those that are left may be the wrong ones"
            )
            failures.append(notes[-1])
    scatter = float(snooped.scatter.max(initial=1.0))
    if scatter > SCATTERED:
        notes.append(
            f"the certificates scatter about the network {scatter:.1f} times as much as both claim, none of them "
            "alone: the lens is not what the model says, or they are less certain than stated; their uncertainty is "
            "taken from their scatter"
        )
        failures += [notes[-1]] if scatter > CONTRADICT else []
    more = _scattered(off, snooped.scatter) if scatter > SCATTERED else {}
    held = tuple(
        replace(
            bar,
            u_length_mm=float(np.linalg.norm([bar.u_length_mm, widest * bar.length_mm, more.get((DISTANCE, k), 0.0)])),
        )
        for k, bar in left.items()
    )
    places = {c: (xyz, np.hypot(u, more.get((PLACE, c), 0.0))) for c, (xyz, u) in places.items()}
    found = [off.items[k].columns for k in dropped]
    scale = 1.0 if places else _scale(off, found)
    records = [record_of(off.items[k], snooped.sigmas[k], dropped.get(k), off, bars) for k in range(len(off.items))]
    return Tested(held, places, scale, scale_from, tuple(r for r in records if r), tuple(notes), tuple(failures))


def _scattered(off: Misclosure, scatter: np.ndarray) -> dict[tuple[str, int], float]:
    """By kind and key, the standard uncertainty that a certificate must have beside its own to scatter as its kind
    does."""
    variance = np.diag(off.cov)
    return {
        (item.kind, item.key): float(np.sqrt((times**2 - 1) * variance[item.columns.any(axis=1)].mean()))
        for item, times in zip(off.items, scatter, strict=True)
        if item.kind in (PLACE, DISTANCE)
    }


def _scale(off: Misclosure, blunders: list[np.ndarray]) -> float:
    """What the network is to be multiplied with to fit what holds."""
    root = np.linalg.cholesky(off.cov)
    columns = np.linalg.solve(root, np.column_stack([*blunders, off.design]))
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    return 1 + float((np.linalg.lstsq(columns / size, np.linalg.solve(root, off.value), rcond=1e-10)[0] / size)[-1])
