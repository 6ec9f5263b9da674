"""What is certified of a field without boards: distances, places of some codes, diameters; and the datum they make."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.distance import pdist

from testfield.adjust.datum import aligned
from testfield.adjust.network import EXACT_MM, Distances, Network
from testfield.calibrate.chirality import refuse_mirrored_points
from testfield.calibrate.loose_discs import measured_radii
from testfield.calibrate.ties import LEAST_RAYS, Ties
from testfield.camera.pose import nearest_rotation
from testfield.targets.field import ScaleBar

OTHER_UNIT = 1.5
"""Two lengths that differ by more than this factor are not in the same unit."""
DISAGREE = 0.02
"""Part by which two distances may disagree before the worse is left out of the scale."""
AGREE = 5e-4
"""Part of their extent by which certified places may miss the others before one of them is suspected."""
ARBITRARY_MM = 1000.0
"""Largest distance between two points of a field whose scale nothing tells."""


@dataclass(frozen=True)
class Certified:
    """`bars`, of which those with the role `control` make the scale; `known` maps a code to its place (3,) and the
    standard uncertainties (3,) of it, all in one frame; `diameter_mm` maps codes to the diameters of their dots, 0
    standing for all others."""

    bars: tuple[ScaleBar, ...] = ()
    known: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    diameter_mm: dict[int, float] = field(default_factory=dict)

    def radii(self, code: np.ndarray) -> np.ndarray:
        """(n,) certified radii, NaN where nothing is said."""
        default = self.diameter_mm.get(0, np.nan)
        return np.array([self.diameter_mm.get(int(c), default) for c in code], float) / 2


@dataclass(frozen=True)
class InDatum:
    """A network in its datum and scale, the `radius_mm` (n,) of its discs (NaN: no disc), `scale_from` where the scale
    is from (`control points`, `distances`, `diameters` or `nothing`), and notes."""

    network: Network
    radius_mm: np.ndarray
    scale_from: str
    notes: tuple[str, ...]


def in_datum(network: Network, ties: Ties, certified: Certified, images_of: dict[int, int]) -> InDatum:
    """Bring a free network into the frame of known points, or centred over its own with the scale of what is certified.

    `images_of` tells in how many images each code was seen before any was left out. What contradicts the rest (a unit,
    a misread certificate) is left out and named.
    """
    notes: list[str] = []
    seen = np.bincount(network.point, minlength=len(ties.code))
    place = {int(code): k for k, code in enumerate(ties.code)}
    # A diameter's own network unit: what the discs' images show before anything is certified.
    own, told = measured_radii(network, ties.moments_px2), certified.radii(ties.code)
    with np.errstate(invalid="ignore"):
        ratio = told / own
    by_diameter = float(np.nanmedian(ratio)) if np.isfinite(ratio).any() else None

    bars, ratios = _usable_bars(network, certified, place, seen, images_of, notes)
    scale, scale_from = None, "nothing"
    known = _usable_known(network, certified, place, seen, notes)
    if len(known):
        points = np.array([place[c] for c in known])
        target = np.array([certified.known[c][0] for c in known])
        scale, scale_from = _similarity(network.point_mm[points], target)[0], "control points"
        agree = np.abs(np.log(ratios / scale)) < np.log1p(DISAGREE) if len(ratios) else np.zeros(0, bool)
        _name_disagreeing([bars[k] for k in np.flatnonzero(~agree)], ratios[~agree] / scale, "control points", notes)
        bars = [bar for bar, fine in zip(bars, agree, strict=True) if fine]
    elif bars:
        middle = _agreed(ratios, by_diameter)
        agree = np.abs(np.log(ratios / middle)) < np.log1p(DISAGREE)
        _name_disagreeing([bars[k] for k in np.flatnonzero(~agree)], ratios[~agree] / middle, "other distances", notes)
        bars = [bar for bar, fine in zip(bars, agree, strict=True) if fine]
        scale, scale_from = float(np.median(ratios[agree])), "distances"
    if scale is not None and by_diameter is not None and not 1 / OTHER_UNIT < by_diameter / scale < OTHER_UNIT:
        wide, said = 2 * scale * float(np.nanmedian(own)), 2 * float(np.nanmedian(told))
        notes.append(
            f"by the {scale_from} the dots are {wide:.4g} mm wide, and they are said to have {said:.4g} mm: one of the "
            "two is in another unit; the diameters are not used"
        )
        told, by_diameter = np.full(len(told), np.nan), None
    if scale is None and by_diameter is not None:
        scale, scale_from = by_diameter, "diameters"
        notes.append("the scale is that of the dots' diameters, good to a few parts in a hundred: no distance is known")
    if scale is None:
        scale = ARBITRARY_MM / float(pdist(network.point_mm[seen >= LEAST_RAYS]).max())
        notes.append(
            "nothing tells the scale: it is arbitrary, the two codes that are farthest apart being about "
            f"{ARBITRARY_MM:g} mm from each other; certify a distance between two codes"
        )
    network = aligned(network, target, points, True) if len(known) else _centred(network, seen, scale)
    if len(known):
        information, values = network.information.copy(), network.known_mm.copy()
        for c, p in zip(known, points, strict=True):
            xyz, u = certified.known[c]
            information[p], values[p] = np.diag(1 / np.maximum(u, EXACT_MM) ** 2), xyz
        network = replace(network, information=information, known_mm=values)
    ends = np.array([[place[c] for c in bar.codes] for bar in bars], int).reshape(-1, 2)
    distances = Distances(
        ends, np.array([b.length_mm for b in bars], float), np.array([b.u_length_mm for b in bars], float)
    )
    own = scale * own
    radius = np.where(np.isfinite(told), told, own)
    return InDatum(replace(network, distances=distances), radius, scale_from, tuple(notes))


def _usable_bars(
    network: Network,
    certified: Certified,
    place: dict[int, int],
    seen: np.ndarray,
    images_of: dict[int, int],
    notes: list[str],
) -> tuple[list[ScaleBar], np.ndarray]:
    """Control bars both of whose ends are points, and certified over present length of each."""
    bars, ratios = [], []
    for bar in certified.bars:
        if bar.role != "control":
            continue
        poor = [c for c in bar.codes if c not in place or seen[place[c]] < LEAST_RAYS]
        if poor:
            said = " and ".join(f"code {c} is in {images_of.get(c, 0)} image(s)" for c in poor)
            notes.append(f"the distance '{bar.name}' is left out: {said}, and two that are joined are needed")
            continue
        a, b = (network.point_mm[place[c]] for c in bar.codes)
        bars.append(bar)
        ratios.append(bar.length_mm / max(float(np.linalg.norm(a - b)), 1e-12))
    return bars, np.array(ratios)


def _usable_known(
    network: Network, certified: Certified, place: dict[int, int], seen: np.ndarray, notes: list[str]
) -> list[int]:
    """Codes whose certified places agree with each other in shape: three that are not on a line, or none."""
    codes = [c for c in certified.known if c in place and seen[place[c]] >= LEAST_RAYS]
    if certified.known and len(codes) < 3:
        notes.append(f"only {len(codes)} certified place(s) can be used, and three are needed: the network is free")
        return []
    if codes:
        points = network.point_mm[[place[c] for c in codes]]
        refuse_mirrored_points(points, np.array([certified.known[c][0] for c in codes]))
    while len(codes) >= 3:
        here = network.point_mm[[place[c] for c in codes]]
        target = np.array([certified.known[c][0] for c in codes])
        spread = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
        if spread[1] < 1e-3 * spread[0]:
            notes.append("the certified places lie on a line: the network is free")
            return []
        off = _misplaced(here, target, np.arange(len(codes)))
        rest = [np.delete(np.arange(len(codes)), k) for k in range(len(codes))] if len(codes) > 3 else []
        alone = [float(np.sqrt((_misplaced(here, target, r)[r] ** 2).mean())) for r in rest]
        worst = int(np.argmin(alone)) if rest else 0
        by_others = _misplaced(here, target, rest[worst])[worst] if rest else off.max()
        allowed = max(AGREE * spread[0], 6 * certified.known[codes[worst]][1].max())
        if by_others < allowed:
            return codes
        if not rest:
            break
        if alone[worst] > 0.5 * np.sqrt((off**2).mean()):
            # Nobody stands out: the network is bent, or all of them are as uncertain as this.
            if off.max() < 20 * allowed:
                return codes
            break
        notes.append(f"code {codes[worst]} is {by_others:.3g} mm off its certified place, which is not used")
        codes.pop(worst)
    if certified.known:
        notes.append("the certified places contradict each other: the network is free")
    return []


def _misplaced(here: np.ndarray, target: np.ndarray, by: np.ndarray) -> np.ndarray:
    """(k,) distances of points from their targets after the similarity that some of them (`by`) make."""
    scale, R, t = _similarity(here[by], target[by])
    return np.linalg.norm(scale * here @ R.T + t - target, axis=1)


def _agreed(ratios: np.ndarray, by_diameter: float | None) -> float:
    """The scale most distances agree on; of equal numbers, that nearer to the diameters', else the first."""
    votes = (np.abs(np.log(ratios[:, None] / ratios)) < np.log1p(DISAGREE)).sum(axis=1)
    best = np.flatnonzero(votes == votes.max())
    if by_diameter is not None:
        return float(ratios[best[np.argmin(np.abs(np.log(ratios[best] / by_diameter)))]])
    return float(ratios[best[0]])


def _name_disagreeing(bars: list[ScaleBar], factor: np.ndarray, others: str, notes: list[str]) -> None:
    for bar, f in zip(bars, factor, strict=True):
        notes.append(
            f"the distance '{bar.name}' ({bar.length_mm:g} mm) is {f:.4g} times what the {others} say: in another "
            "unit, or between other codes; it is left out"
        )


def _similarity(here: np.ndarray, target: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation and shift that bring points (k, 3) nearest to their targets."""
    a, b = here - here.mean(axis=0), target - target.mean(axis=0)
    R = nearest_rotation(b.T @ a)
    scale = float((b * (a @ R.T)).sum() / (a**2).sum())
    return scale, R, target.mean(axis=0) - scale * R @ here.mean(axis=0)


def _centred(network: Network, seen: np.ndarray, scale: float) -> Network:
    """Origin amid the points, z square to the plane that fits them best and towards the cameras, x along the first
    image's rows."""
    good = np.flatnonzero(seen >= LEAST_RAYS)
    points = network.point_mm[good]
    middle = points.mean(axis=0)
    z = np.linalg.svd(points - middle)[2][2]
    z = z if (network.stations.origin_mm - middle).mean(axis=0) @ z > 0 else -z
    row = network.stations.R[0, 0]
    x = row - (row @ z) * z
    if np.linalg.norm(x) < 1e-3:
        x = np.cross(z, network.stations.R[0, 1])
    x /= np.linalg.norm(x)
    R = np.stack([x, np.cross(z, x), z])
    return aligned(network, scale * (points - middle) @ R.T, good, True)
