"""The bundle adjustment: Gauss-Newton on the reduced normal equations, with analytic derivatives.

Whitened residuals make every weight one, so the inverse of the normal matrix is the covariance. Levenberg's damping
only guards the way; at the minimum there is none.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testfield.adjust.covariance import Covariance
from testfield.adjust.datum import aligned, open_motions
from testfield.adjust.factor import Factor
from testfield.adjust.groups import Structure
from testfield.adjust.linear import linearise, whitening_of
from testfield.adjust.network import EXACT_MM, Network
from testfield.adjust.normal import NormalEquations
from testfield.camera.project import project_unchecked
from testfield.errors import TestfieldError
from testfield.store.threads import one_blas_thread

MOST_STEPS = 60
NEGLIGIBLE = 1e-2
"""A step of less than this, in units of what its unknown's own observations resolve, is the last but one: the error it
leaves is about its square, and of that the last step leaves the square again."""
FIRST_DAMPING = 1e-5
HUBER = 1.5
"""Size of a residual in standard deviations beyond which robust estimation lets its weight fall."""


@dataclass(frozen=True)
class Adjustment:
    """An adjusted network.

    `residual_px` (m, 2) observed minus predicted; `weight` (m,) by which robust estimation multiplied each
    observation's (ones without it); `chi2` and `freedom` of the whole adjustment, priors and distances included;
    `steps` taken; `converged` whether the last step was negligible; `cov` every covariance.
    """

    network: Network
    cov: Covariance
    equations: NormalEquations
    residual_px: np.ndarray
    weight: np.ndarray
    chi2: float
    freedom: int
    steps: int
    converged: bool

    @property
    def covariance(self) -> np.ndarray:
        """(P, P) of the reduced unknowns in the order of `Network.labels`; rotations are small turns applied after the
        pose's rotation, in rad, translations in mm."""
        return self.cov.reduced

    @property
    def sigma0(self) -> float:
        """Square root of chi-squared per degree of freedom: 1 where the stated covariances are right."""
        return float(np.sqrt(self.chi2 / self.freedom)) if self.freedom > 0 else float("nan")

    @cached_property
    def redundancy(self) -> np.ndarray:
        """(m, 2, 2) redundancy matrices of the whitened observations; their traces sum to the freedom that the images
        have. Near zero: an error of this observation shows in no residual."""
        answer = np.empty((len(self.residual_px), 2, 2))
        with one_blas_thread():  # the same digits whatever the number of threads
            answer[self.equations.structure.order] = np.eye(2) - self.cov.of_predictions()
        return answer


def adjust(
    network: Network,
    labels: list[str],
    robust: bool = False,
    datum_points: np.ndarray | None = None,
    most_steps: int = MOST_STEPS,
) -> Adjustment:
    """Adjust a network from its starting values; with `most_steps` 0 only say how well they are determined there.

    Where nothing holds the datum (or only its scale), it is a free network: the loose `datum_points` (all that are
    seen, if not given) stay on the whole where they started. `robust` gives residuals beyond `HUBER` standard
    deviations less weight (Huber 1964). Raises `TestfieldError` where the observations do not determine all unknowns,
    naming those that are loose.
    """
    with one_blas_thread():  # many small products: BLAS' own threads would only wait for each other
        found = _adjust(network, labels, robust, datum_points, most_steps)
        if found.converged or robust or most_steps == 0:
            return found
        # A weak network creeps along a curved valley: a whole step raises chi-squared before the next lowers it.
        nearer = undamped(found.network, labels, most_steps // 2)
        return _adjust(nearer, labels, robust, datum_points, most_steps) if chi2_of(nearer) < found.chi2 else found


def _adjust(
    network: Network, labels: list[str], robust: bool, datum_points: np.ndarray | None, most_steps: int
) -> Adjustment:
    structure, start = Structure.of(network), network
    whitening = whitening_of(network.cov_px2)
    weight = _weights(network, whitening) if robust else np.ones(len(network.point))
    at = _Place(network, structure, whitening, weight)
    damping, fall, steps, converged = FIRST_DAMPING, 100.0, 0, False
    loose = _datum_points(network) if datum_points is None else datum_points
    free = at.ways[0].shape[1] if len(loose) >= 3 else 0
    in_place = True
    while steps < most_steps:
        steps += 1
        normal, right, inverse = at.equations.reduced(damping)
        step = Factor(normal, labels, at.ways[0]).solve(right)
        moved = at.network.moved(step, at.equations.back_substituted(step, inverse))
        small = at.equations.relative_size(step)
        last = small < NEGLIGIBLE and damping < 1e-8
        if free and last:
            moved = aligned(moved, start.point_mm[loose], loose, free == 7)
        trial = _Place(moved, structure, whitening, weight)
        if np.isfinite(trial.chi2) and trial.chi2 <= at.chi2 * (1 + 1e-12) + 1e-18:
            at, in_place = trial, last
            if last:
                converged = True
                break
            damping = damping / fall if damping > 1e-12 else 0.0
            if robust:
                weight = _weights(at.network, whitening)
                at = _Place(at.network, structure, whitening, weight)
        elif damping > 1e8 or small < NEGLIGIBLE:
            converged = damping <= 1e8
            break
        else:
            # A weak network far from its minimum needs the least damping that still carries it: finer steps from now.
            damping, fall = max(damping * 4, 1e-6), 10.0
    # The equations at the minimum give the covariance, and with it a last step.
    if free and not in_place:
        network = aligned(at.network, start.point_mm[loose], loose, free == 7)
        at = _Place(network, structure, whitening, weight)
    network, equations, ways = at.network, at.equations, at.ways
    normal, right, own = equations.reduced(0.0)
    inverse = Factor(normal, labels, ways[0]).inverse()
    if converged:
        step = inverse @ right
        network = network.moved(step, equations.back_substituted(step, own))
        network = aligned(network, start.point_mm[loose], loose, free == 7) if free else network
    residual_px = network.xy_px - predict(network)
    return Adjustment(
        network=network,
        cov=Covariance(equations, inverse, own, ways, loose),
        equations=equations,
        residual_px=residual_px,
        weight=weight,
        chi2=_chi2(network, np.einsum("nij,nj->ni", whitening, residual_px) * np.sqrt(weight)[:, None]),
        freedom=_freedom(network, equations.size, ways[0].shape[1]),
        steps=steps,
        converged=converged,
    )


class _Place:
    """A network linearised at its values, with its chi-squared there; equations are made when asked for."""

    def __init__(self, network: Network, structure: Structure, whitening: np.ndarray, weight: np.ndarray):
        self.network, self._structure = network, structure
        with np.errstate(all="ignore"):
            self._derivatives = linearise(network, structure, whitening * np.sqrt(weight)[:, None, None])
        self.chi2 = _chi2(network, self._derivatives.residual)

    @cached_property
    def equations(self) -> NormalEquations:
        """The normal equations."""
        return NormalEquations(self.network, self._structure, self._derivatives)

    @cached_property
    def ways(self) -> tuple[np.ndarray, np.ndarray]:
        """The motions that nothing holds."""
        return open_motions(self.network)


def undamped(network: Network, labels: list[str], steps: int) -> Network:
    """The network after Gauss-Newton steps without damping, or as it was where they led away from the minimum.

    For starts so near the minimum that the problem is almost linear, but where it is weak: there each step of the way
    may raise chi-squared by second-order terms that the next step takes away, and `adjust` would creep.
    """
    structure, whitening, weight = Structure.of(network), whitening_of(network.cov_px2), np.ones(len(network.point))
    with one_blas_thread():
        at = best = _Place(network, structure, whitening, weight)
        for _ in range(steps):
            normal, right, inverse = at.equations.reduced(0.0)
            try:
                step = Factor(normal, labels, at.ways[0]).solve(right)
            except TestfieldError:  # so far off that nothing is determined there
                break
            moved = at.network.moved(step, at.equations.back_substituted(step, inverse))
            at = _Place(moved, structure, whitening, weight)
            if not np.isfinite(at.chi2):
                break
            if at.chi2 < best.chi2:
                best = at
    return best.network


def _datum_points(network: Network) -> np.ndarray:
    seen = network.seen_points
    return seen[network.point_board[seen] < 0]


def _freedom(network: Network, size: int, open_ways: int) -> int:
    """Observations and what was known, less unknowns; open motions are no unknowns."""
    seen, kept = network.seen_points, network.kept_points
    used = np.union1d(seen, kept)
    known = int((np.einsum("nii->ni", network.information[used]) > 0).sum())
    known += sum(int(np.isfinite(c.u[c.unknown]).sum()) for c in network.cameras) + network.scale_free
    if network.known_boards:
        known += sum(
            int(np.isfinite(u).sum()) for u, w in zip(network.known_boards.u, network.ways, strict=True) if w.size
        )
    if network.known_members:
        known += int(np.isfinite(network.known_members.u).sum())
    known += sum(bool(np.isfinite(c.u_aspect) and c.unknown[:2].any()) for c in network.cameras)
    unknowns = size - open_ways + 3 * len(np.setdiff1d(seen, kept))
    return 2 * len(network.xy_px) + len(network.distances) + known - unknowns


def predict(network: Network) -> np.ndarray:
    """(m, 2) predicted pixels of all image observations."""
    poses = network.camera_from_datum()
    at_camera = poses[network.image].apply(network.datum_mm()[network.point])
    predicted = np.empty((len(network.image), 2))
    camera = network.images.camera[network.image]
    for k, unknown in enumerate(network.cameras):
        here = camera == k
        predicted[here] = project_unchecked(unknown.interior, at_camera[here])
    return predicted + network.offset_px


def chi2_of(network: Network) -> float:
    """Chi-squared of a network at its present values, priors and distances included."""
    with np.errstate(all="ignore"):
        return _chi2(network, _whitened(network, whitening_of(network.cov_px2)))


def _whitened(network: Network, whitening: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", whitening, network.xy_px - predict(network))


def _weights(network: Network, whitening: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(_whitened(network, whitening), axis=1)
    return np.minimum(1, HUBER / np.maximum(size, 1e-12))


def _chi2(network: Network, white: np.ndarray) -> float:
    """Chi-squared of whitened and weighted residuals (m, 2), priors and distances included."""
    with np.errstate(all="ignore"):
        told = np.flatnonzero(network.information.any(axis=(1, 2)))
        used = told[network.is_seen[told] | np.isin(told, network.kept_points)]
        off = (network.known_mm - network.point_mm)[used]
        total = (white**2).sum() + np.einsum("ni,nij,nj->", off, network.information[used], off)
        for c in network.cameras:
            total += ((((c.known - c.interior.parameters) / c.u)[c.unknown]) ** 2).sum()
            total += (c.aspect @ c.interior.parameters) ** 2
        if network.known_boards:
            moving = np.array([w.size > 0 for w in network.ways])
            off = network.known_boards.deviation(network.boards)[moving]
            total += (network.known_boards.information[moving] * off**2).sum()
        if network.known_members:
            off = network.known_members.deviation(network.members[1:])
            total += (network.known_members.information * off**2).sum()
        at = network.datum_mm(network.distances.ends.ravel()).reshape(-1, 2, 3)
        gap = network.distances.length_mm - np.linalg.norm(at[:, 0] - at[:, 1], axis=1)
        total += ((gap / np.maximum(network.distances.u_mm, EXACT_MM)) ** 2).sum()
        total += ((1 - network.scale) / network.u_scale) ** 2 if network.scale_free else 0.0
        return float(total)
