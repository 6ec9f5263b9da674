"""A field sheet proposed from photographs: boards by codes that move rigidly together and lie in one plane, with their
approximate places; what nobody certified stays open, so the scale is to be filled in."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist, pdist, squareform

from testfield import seeds
from testfield.calibrate.self_calibration import free_network
from testfield.calibrate.self_job import FreeNetwork
from testfield.calibrate.similarity import robust_similarity
from testfield.calibrate.ties import coded_ties
from testfield.detect.observations import Observations
from testfield.detect.photograph import Found
from testfield.errors import TestfieldError
from testfield.measure.moved import LEAST_FIT, renumbered, said_settings
from testfield.measure.settings import Arranged, arranged
from testfield.targets.field import TIME

LEAST_PLANE = 6
"""Codes that make a board of its own where nothing moved: by chance five are soon near a plane."""
FLAT = 0.004
"""Distance from a plane, in the extent of all codes, within which a code lies in it; or `FLAT_U` claimed standard
uncertainties, where that is more."""
FLAT_U = 4.0
FLATTER = 0.0002
"""The same of points whose board is flatter than that: those off the plane of the others by more than `OFF` of the
others' standard deviations, and this, belong to something that the plane runs through."""
OFF = 4.0
GAP = 3.5
"""Gap in a board, in the median distance of its codes from their nearest neighbours."""
OTHERS = "others"
IN_ROWS = 0.5
"""Alignment of nearest neighbours, 1 being a square grid's, from which a board's axes run along its rows."""
TRIALS = 600
GENEROUS = 0.01
"""The stated uncertainty of a place, in the extent of its board."""


@dataclass(frozen=True)
class Group:
    """A proposed board: `code` (n,) at `xyz` (n, 3) in its own frame (z square to its plane and towards the cameras,
    origin in its middle) and in an arbitrary unit, known to about `u`; `flat_rms` its points' distance from their
    plane; `body` which of the rigid bodies it belongs to."""

    name: str
    code: np.ndarray
    xyz: np.ndarray
    u: float
    flat_rms: float
    body: int


@dataclass(frozen=True)
class Proposal:
    """`groups`, the `longest` distance that could be measured as the scale (two codes and its length in the arbitrary
    unit), the `arranged` photographs, those that joined, `notes` in words, and the free `network` behind all."""

    groups: tuple[Group, ...]
    longest: tuple[int, int, float]
    arranged: Arranged
    notes: tuple[str, ...]
    network: FreeNetwork


def propose(
    names: tuple[str, ...],
    found: list[Found],
    size_px: tuple[int, int],
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    focal_px: float | None = None,
) -> Proposal:
    """Boards as photographs of coded targets by one camera show them.

    Raises `TestfieldError` where the photographs cannot be joined to each other.
    """
    observations = Observations.join([one.observations for one in found], names)
    ties, _ = coded_ties(observations)
    if not len(ties):
        raise TestfieldError("no photograph shows a code", "photographs", "name the targets: --target, --radii")
    seen = arranged(ties, size_px, lens, hold, focal_px)
    notes: list[str] = []
    if seen.moved:
        notes.append(f"boards were moved between the photographs: {said_settings(names, seen)}")
        if seen.guessed:
            notes.append(
                f"{len(seen.guessed)} code(s) are in one arrangement only, so that nothing tells with which board they "
                f"move: they stand with their nearest neighbours ({', '.join(map(str, seen.guessed[:20]))})"
            )
        found = renumbered(found, seen.setting, set(seen.moving))
        observations = Observations.join([one.observations for one in found], names)
    ties, said = coded_ties(observations)
    network = free_network(ties, *size_px, lens, hold, None, focal_px, True, said)
    groups = _groups(network, seen)
    placed = {int(c) for group in groups for c in group.code}
    if lost := sorted({int(c) % TIME for c in ties.code} - placed):
        notes.append(
            f"{len(lost)} code(s) are in fewer than two photographs that are joined and have no place: "
            f"{', '.join(map(str, lost[:20]))}"
        )
    notes += [note for note in network.calibration.notes if "scale" not in note]
    flat = [group for group in groups if not group.name.startswith(OTHERS)]
    largest = max(flat or groups, key=lambda group: float(pdist(group.xyz).max(initial=0)))
    apart = squareform(pdist(largest.xyz))
    a, b = np.unravel_index(int(apart.argmax()), apart.shape)
    longest = (int(largest.code[a]), int(largest.code[b]), float(apart[a, b]))
    return Proposal(groups, longest, seen, tuple(notes), network)


def _groups(network: FreeNetwork, seen: Arranged) -> tuple[Group, ...]:
    u = np.sqrt(np.diag(network.cov_xyz_mm2).reshape(-1, 3).mean(axis=1))
    extent = float(pdist(network.xyz_mm).max())
    cameras = network.calibration.stations.origin_mm.mean(axis=0)
    parts: list[tuple[int, int, np.ndarray, np.ndarray, float]] = []
    for body in sorted(set(seen.body.values())):
        code, xyz, own_u = _of_body(network, [c for c, b in seen.body.items() if b == body], u)
        if not len(code):
            continue
        plane = planes(xyz, np.maximum(FLAT * extent, FLAT_U * own_u), np.maximum(FLATTER * extent, FLAT_U * own_u))
        for number in sorted(set(plane.tolist()), key=lambda p: (p < 0, p)):
            here = plane == number
            parts.append((body, number, code[here], xyz[here], float(np.median(own_u[here]))))
    # The board with the most codes comes first, what lies in no plane last.
    parts.sort(key=lambda part: (part[1] < 0, -len(part[2])))
    groups = []
    for k, (body, number, code, xyz, typical_u) in enumerate(parts):
        local, flat = _own_frame(xyz, cameras)
        reach = float(pdist(local).max(initial=0)) or extent
        name = f"board {k + 1}" if number >= 0 else (f"{OTHERS} {body + 1}" if seen.moved else OTHERS)
        groups.append(Group(name, code, local, max(GENEROUS * reach, 5 * typical_u), flat, body))
    return tuple(groups)


def _of_body(network: FreeNetwork, codes: Sequence[int], u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Codes of a rigid body, their places and uncertainties, all in the arrangement that shows most of them."""
    setting, plain = network.code // TIME, network.code % TIME
    own = np.isin(plain, list(codes)) & (network.code > 0)
    shown = np.bincount(setting[own]) if own.any() else np.zeros(1, int)
    first = int(shown.argmax())
    base = own & (setting == first)
    code, xyz, own_u = plain[base], network.xyz_mm[base], u[base]
    for s in np.flatnonzero(shown):
        here = own & (setting == s)
        common = np.intersect1d(plain[here], code)
        new = here & ~np.isin(plain, code)
        if s == first or not new.any() or len(common) < LEAST_FIT:
            continue
        source = np.array([network.xyz_mm[here & (plain == c)][0] for c in common])
        target = np.array([xyz[code == c][0] for c in common])
        scale, R, t = robust_similarity(source, target)
        code = np.concatenate([code, plain[new]])
        xyz = np.vstack([xyz, scale * network.xyz_mm[new] @ R.T + t])
        own_u = np.concatenate([own_u, u[new]])
    order = np.argsort(code)
    return code[order], xyz[order], own_u[order]


def planes(xyz: np.ndarray, near: np.ndarray, least: np.ndarray) -> np.ndarray:
    """(n,) which plane each point (n, 3) lies in within `near` (n,), -1 for none; no nearer than `least` (n,) is asked
    of any. The largest plane comes first; two boards in one plane are two where a gap is between them."""
    answer = np.full(len(xyz), -1)
    left, number = np.arange(len(xyz)), 0
    rng = seeds.generator(0, "planes of a proposed field")
    while len(left) >= LEAST_PLANE:
        mine = left[_largest_plane(xyz[left], near[left], rng)]
        mine = mine[_as_flat_as_most(xyz[mine], least[mine], rng)] if len(mine) >= LEAST_PLANE else mine
        if len(mine) < LEAST_PLANE:
            break
        answer[mine] = number
        left, number = np.setdiff1d(left, mine), number + 1
    return answer


def _largest_plane(xyz: np.ndarray, near: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Places of the points of the largest connected set in one plane, which is drawn through neighbours."""
    count = min(len(xyz), 9)
    neighbours = cKDTree(xyz).query(xyz, count)[1]
    best = np.zeros(0, int)
    for _ in range(TRIALS):
        a = int(rng.integers(len(xyz)))
        b, c = neighbours[a][1 + rng.choice(count - 1, 2, replace=False)]
        normal = np.cross(xyz[b] - xyz[a], xyz[c] - xyz[a])
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            continue
        here = np.flatnonzero(np.abs((xyz - xyz[a]) @ normal) / length < 2 * near)
        if len(here) > len(best):
            here = _connected(xyz, here)
        if len(here) > len(best):
            middle, axis = _plane_of(xyz[here])
            best_of_fit = np.flatnonzero(np.abs((xyz - middle) @ axis) < near)
            fitted = _connected(xyz, best_of_fit)
            best = fitted if len(fitted) > len(best) else best
    return best


def _as_flat_as_most(xyz: np.ndarray, least: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Which points lie in the plane of the others as well as these do (least median of squares, Rousseeuw 1984)."""
    best, median = np.zeros(len(xyz)), np.inf
    for _ in range(TRIALS):
        a, b, c = xyz[rng.choice(len(xyz), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            continue
        off = np.abs((xyz - a) @ normal) / length
        if np.median(off) < median:
            best, median = off, float(np.median(off))
    sigma = 1.4826 * (1 + 5 / max(len(xyz) - 3, 1)) * median
    return np.asarray(best < np.maximum(OFF * sigma, least))


def _plane_of(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    middle = xyz.mean(axis=0)
    return middle, np.linalg.svd(xyz - middle)[2][2]


def _connected(xyz: np.ndarray, here: np.ndarray) -> np.ndarray:
    """The largest part of some points that no gap divides."""
    if len(here) < 3:
        return here
    apart = cdist(xyz[here], xyz[here])
    nearest = np.sort(apart, axis=1)[:, 1]
    _, part = connected_components(apart < GAP * np.median(nearest), directed=False)
    return here[part == np.bincount(part).argmax()]


def _own_frame(xyz: np.ndarray, cameras: np.ndarray) -> tuple[np.ndarray, float]:
    """Places (n, 3) in a frame of their own, and their rms distance from their plane."""
    middle = xyz.mean(axis=0)
    if len(xyz) < 3:
        return xyz - middle, 0.0
    z = np.linalg.svd(xyz - middle)[2][2]
    z = z if (cameras - middle) @ z > 0 else -z
    # The datum's x runs along the first image's rows, so a board keeps its left and right.
    x = np.eye(3)[0] - z[0] * z if abs(z[0]) < 0.9 else np.cross(np.eye(3)[1], z)
    x /= np.linalg.norm(x)
    local = (xyz - middle) @ np.stack([x, np.cross(z, x), z]).T
    c, s = np.cos(turn := _grid_turn(local[:, :2])), np.sin(turn)
    local[:, :2] = local[:, :2] @ np.array([[c, -s], [s, c]])
    return local, float(np.sqrt((local[:, 2] ** 2).mean()))


def _grid_turn(xy: np.ndarray) -> float:
    """The angle, at most an eighth of a turn, at which points (n, 2) lie in rows and columns; 0 where they do not."""
    step = xy[cKDTree(xy).query(xy, 2)[1][:, 1]] - xy
    each = np.exp(4j * np.arctan2(step[:, 1], step[:, 0]))
    mean = each.mean()
    along = np.abs(np.angle(each / mean)) < np.radians(40)  # of a quarter turn that is 10 degrees
    mean = each[along].sum() / len(each)
    return float(np.angle(mean) / 4) if abs(mean) > IN_ROWS else 0.0
