"""From starting values to the adjustment of exactly those observations that agree, discs and all."""

from dataclasses import dataclass, replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Camera, Distances, Network, information_of
from testfield.adjust.normals import target_normals
from testfield.calibrate.doubts import geometric_doubts
from testfield.calibrate.lens_misfit import without_lens_misfit
from testfield.calibrate.misfit import NO_MISFIT, Misfit, Names, misfit_of, scatter_note, widened
from testfield.calibrate.start import Start
from testfield.calibrate.units import bars_of_one_unit
from testfield.camera.circle import disc_image
from testfield.camera.project import project
from testfield.camera.rays import meet
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError

REJECT_SIGMA = 6.0
"""An observation is rejected whose residual is larger than this many of its own standard deviations."""
ROUNDS = 12
MISFIT_ROUNDS = 3
SETTLED_PX = 1e-7


@dataclass(frozen=True)
class Settled:
    """An adjustment, the records of observations `rejected` on the way, `notes` for the reader; the `misfit` that is in
    its model, and the factor by which all observed covariances were `widened`; the adjustment by the `plain` model,
    whose residuals are tested: a wrong certificate must not pass for a lens."""

    adjustment: Adjustment
    rejected: list[dict]
    notes: list[str]
    misfit: Misfit = NO_MISFIT
    widened: float = 1.0
    plain: Adjustment | None = None


def settled(start: Start, rows: Observations, empirical: bool = False, misfit: Misfit | None = None) -> Settled:
    """Adjust a start: coarsely, then with everything, until nothing is rejected and the discs' offsets stand still.

    What residuals show that the model does not follow is adjusted too, or the `misfit` that is given. `empirical`
    widens all covariances where observations scatter more than they claim; where the model fails they are widened
    anyway. Where the observations do not determine an unknown, the `TestfieldError` says which geometry is to blame.
    """
    notes: list[str] = []
    discs = _Discs(rows.moments_px2[start.rows], start.radius_mm) if rows.centre_of_disc else None
    try:
        coarse = _coarse(start.network)
        found = adjust(coarse, coarse.labels(start.stations, start.boards))
        network = bars_of_one_unit(_refined(start.network, found.network), start.bars, notes)
        plain = _settle(network, discs, start)
        last = _followed(plain, network, discs, start, misfit)
        adjustment, factor = last.adjustment, 1.0
        if empirical or last.misfit.found:
            adjustment, factor = widened(adjustment, _names(start))
    except TestfieldError as error:
        reasons = geometric_doubts(start.network, start.stations, start.boards)
        raise TestfieldError("; ".join([error.what, *notes, *reasons]), error.where, error.do) from error
    notes += last.misfit.notes
    factor *= last.misfit.variance
    if factor > 1:
        notes.append(scatter_note(factor))
    return replace(last, adjustment=adjustment, notes=notes + last.notes, widened=factor, plain=plain.adjustment)


def _names(start: Start) -> Names:
    return lambda network: network.labels(start.stations, start.boards)


def _followed(last: Settled, network: Network, discs: "_Discs | None", start: Start, given: Misfit | None) -> Settled:
    """Everything settled again with what the model does not follow, beginning with all observations: those that the
    model alone had turned down may be good. Asked again, without it, where other observations are turned down then."""
    names, rejected = _names(start), -1
    plain = last
    for _ in range(MISFIT_ROUNDS):
        misfit = given or misfit_of(plain.adjustment, names, plain.adjustment.freedom)
        if not misfit.found:
            return plain
        there = misfit.applied(plain.adjustment.network, names)
        there = replace(
            network, cameras=there.cameras, stations=there.stations, boards=there.boards, scale=there.scale,
            point_mm=there.point_mm, information=there.information, cov_px2=misfit.variance * network.cov_px2,
        )  # fmt: skip
        last = replace(_settle(there, discs, start), misfit=misfit)
        if given or len(last.rejected) in (rejected, len(plain.rejected)):
            break
        rejected = len(last.rejected)
        kept = last.adjustment.network
        again = replace(
            kept, cameras=without_lens_misfit(kept).cameras, information=network.information,
            cov_px2=kept.cov_px2 / misfit.variance,
        )  # fmt: skip
        plain = Settled(adjust(again, names(again)), last.rejected, [])
    return last


class _Discs:
    """What the shapes of the discs' images add: moments (m, 2, 2) of the observations, radii (n,) of the points."""

    def __init__(self, moments_px2: np.ndarray, radius_mm: np.ndarray):
        self.moments_px2, self.radius_mm = moments_px2, radius_mm

    def take(self, rows: np.ndarray) -> "_Discs":
        return _Discs(self.moments_px2[rows], self.radius_mm)

    def offsets(self, network: Network) -> np.ndarray:
        """(m, 2) centre of the disc's image minus projection of its centre, at the network's present values."""
        normals = network.normals()
        for k in np.flatnonzero(network.point_board < 0):
            v = np.flatnonzero(network.point == k)
            poses = network.stations[network.image[v]]
            normals[k] = target_normals(
                network.interior, poses, np.ones((1, len(v)), bool), network.point_mm[[k]], self.radius_mm[[k]],
                self.moments_px2[v][None],
            )[0]  # fmt: skip
        offset = np.zeros((len(network.point), 2))
        discs = np.flatnonzero(self.radius_mm[network.point] > 0)  # a corner is seen where it is
        poses, point = network.stations[network.image[discs]], network.point[discs]
        centre = network.datum_mm()[point]
        image = disc_image(network.interior, poses, centre, normals[point], self.radius_mm[point])
        offset[discs] = image.centroid_px - project(network.interior, poses, centre)
        return offset


def _settle(network: Network, discs: _Discs | None, start: Start) -> Settled:
    """Adjust until nothing is rejected any more and the discs' offsets stand still.

    What is returned is always the adjustment of exactly the observations that remain.
    """
    labels = network.labels(start.stations, start.boards)
    rejected: list[dict] = []
    for _ in range(ROUNDS):
        if discs:
            network = replace(network, offset_px=discs.offsets(network))
        adjustment = adjust(network, labels)
        network = adjustment.network
        size = _residual_sizes(adjustment)
        # A bad point drags its neighbours along: only residuals near the worst go in one round.
        bad = (size > REJECT_SIGMA) & (size > 0.3 * size.max())
        if not bad.any() and (
            discs is None or np.allclose(discs.offsets(network), network.offset_px, rtol=0, atol=SETTLED_PX)
        ):
            return Settled(adjustment, rejected, _doubts(adjustment))
        for k in np.flatnonzero(bad):
            owner = network.point_board[network.point[k]]
            board = start.boards[owner] if owner >= 0 else ""
            x, y = (float(v) for v in network.xy_px[k])
            station = start.stations[network.image[k]]
            why = f"residual beyond {REJECT_SIGMA:g} standard deviations"
            rejected.append(
                {"station": station, "board": board, "x_px": x, "y_px": y, "sigmas": float(size[k]), "why": why}
            )
        network, discs = network.take(~bad), discs.take(~bad) if discs else None
    adjustment = adjust(network, labels)
    return Settled(adjustment, rejected, ["the rejection of outliers had not come to rest", *_doubts(adjustment)])


def _doubts(adjustment: Adjustment) -> list[str]:
    return [] if adjustment.converged else [f"the bundle had not converged after {adjustment.steps} steps"]


def _coarse(network: Network) -> Network:
    """The first adjustment: boards as on their sheets, a one-parameter lens, weights that forgive."""
    free = network.cameras[0].unknown & np.array([name in ("fx", "fy", "k1") for name in network.interior.names])
    on_boards = network.point_board[network.point] >= 0
    coarse = network.take(on_boards)
    return replace(
        coarse, cameras=(Camera.of(network.interior, free),), u_scale=0.0,
        information=information_of(np.zeros_like(network.known_mm)),
        cov_px2=np.broadcast_to(np.eye(2), coarse.cov_px2.shape).copy(), distances=Distances(),
    )  # fmt: skip


def _refined(network: Network, coarse: Network) -> Network:
    """The full network at the coarse one's camera, stations and boards, its loose points met anew."""
    points = network.point_mm.copy()
    for k in np.flatnonzero(network.point_board < 0):
        v = np.flatnonzero(network.point == k)
        points[k] = meet(coarse.interior, coarse.stations[network.image[v]], network.xy_px[v])
    cameras = (replace(network.cameras[0], interior=coarse.interior),)
    return replace(network, cameras=cameras, stations=coarse.stations, boards=coarse.boards, point_mm=points)


def _residual_sizes(adjustment: Adjustment) -> np.ndarray:
    """(m,) residuals in units of their standard deviations, those of the adjustment's overall misfit."""
    white = np.linalg.solve(np.linalg.cholesky(adjustment.network.cov_px2), adjustment.residual_px[..., None])[..., 0]
    size = np.linalg.norm(white, axis=1)
    typical = np.median(size) / 1.1774  # the median length of a standard normal vector in the plane
    return size / max(typical, 1.0)
