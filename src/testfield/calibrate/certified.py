"""What is certified of a field without boards: distances, places of some codes, diameters; and the datum they make.

Here they make a start only, by what most of them agree on; which of them hold is tested in `certificates`, once the
images have settled among themselves.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.distance import pdist

from testfield.adjust.datum import aligned
from testfield.adjust.network import Network
from testfield.calibrate.chirality import refuse_mirrored_points
from testfield.calibrate.loose_discs import measured_radii
from testfield.calibrate.similarity import on_a_line, robust_similarity
from testfield.calibrate.ties import LEAST_RAYS, Ties
from testfield.targets.field import ScaleBar

OTHER_UNIT = 1.5
"""Two lengths that differ by more than this factor are not in the same unit."""
DISAGREE = 0.02
"""Part by which two distances may disagree and still vote for the same scale to begin with."""
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
    """A network near its datum and scale, the `radius_mm` (n,) of its discs (NaN: no disc), `usable` certificates
    whose points are seen, `scale_from` where the scale is from (`control points`, `distances`, `diameters` or
    `nothing`), and notes."""

    network: Network
    radius_mm: np.ndarray
    usable: Certified
    scale_from: str
    notes: tuple[str, ...]


def in_datum(network: Network, ties: Ties, certified: Certified, images_of: dict[int, int]) -> InDatum:
    """Bring a free network near the frame of known points, or centred over its own with the scale of what is certified.

    `images_of` tells in how many images each code was seen before any was left out. What cannot be used is named.
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
    if known:
        points = np.array([place[c] for c in known])
        target = np.array([certified.known[c][0] for c in known])
        scale, R, t = robust_similarity(network.point_mm[points], target)
        scale_from = "control points"
        moved = aligned(network, scale * network.point_mm[points] @ R.T + t, points, True)
    else:
        if bars:
            middle = _agreed(ratios, by_diameter)
            agree = np.abs(np.log(ratios / middle)) < np.log1p(DISAGREE)
            scale, scale_from = float(np.median(ratios[agree])), "distances"
        elif by_diameter is not None:
            scale, scale_from = by_diameter, "diameters"
            notes.append(
                "the scale is that of the dots' diameters, good to a few parts in a hundred: there is no control "
                "distance"
            )
        else:
            scale = ARBITRARY_MM / float(pdist(network.point_mm[seen >= LEAST_RAYS]).max())
            notes.append(
                "nothing tells the scale: it is arbitrary, the two codes that are farthest apart being about "
                f"{ARBITRARY_MM:g} mm from each other; certify a distance between two codes"
            )
        moved = _centred(network, seen, scale)
    usable = Certified(tuple(bars), {c: certified.known[c] for c in known}, certified.diameter_mm)
    return InDatum(moved, radii(told, scale * own), usable, scale_from, tuple(notes))


def radii(told: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(n,) radii of discs: as certified, where that is the unit in which they are measured, else as measured."""
    with np.errstate(invalid="ignore"):
        ratio = told / own
    middle = np.nanmedian(ratio) if np.isfinite(ratio).any() else 1.0
    if not 1 / OTHER_UNIT < middle < OTHER_UNIT:
        return own
    return np.where(np.isfinite(told), told, own)


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
    """Codes of certified places that were seen: three at least that are not on a line, or none."""
    codes = [c for c in certified.known if c in place and seen[place[c]] >= LEAST_RAYS]
    if certified.known and len(codes) < 3:
        notes.append(f"only {len(codes)} certified place(s) can be used, and three are needed: the network is free")
        return []
    if codes and on_a_line(np.array([certified.known[c][0] for c in codes])):
        notes.append("the certified places lie on a line: the network is free")
        return []
    if codes:
        points = network.point_mm[[place[c] for c in codes]]
        refuse_mirrored_points(points, np.array([certified.known[c][0] for c in codes]))
    return codes


def _agreed(ratios: np.ndarray, by_diameter: float | None) -> float:
    """The scale most distances agree on; of equal numbers, that nearer to the diameters', else the first."""
    votes = (np.abs(np.log(ratios[:, None] / ratios)) < np.log1p(DISAGREE)).sum(axis=1)
    best = np.flatnonzero(votes == votes.max())
    if by_diameter is not None:
        return float(ratios[best[np.argmin(np.abs(np.log(ratios[best] / by_diameter)))]])
    return float(ratios[best[0]])


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
