"""Stitched sub-boards: homographies, the graph of images and boards, one bundle (METHODS section 4)."""

from dataclasses import replace

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Camera, Distances, Network, information_of
from testfield.adjust.normals import target_normals
from testfield.calibrate.calibration import Calibration
from testfield.calibrate.start import Start, starting_network
from testfield.camera.circle import disc_image
from testfield.camera.project import project
from testfield.camera.rays import meet
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field

REJECT_SIGMA = 6.0
"""An observation is rejected whose residual is larger than this many of its own standard deviations."""
ROUNDS = 12
SETTLED_PX = 1e-7


@register("calibrators", "stitched")
def stitched(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
) -> Calibration:
    """Sub-boards of unknown pose joined through their coded targets, in one bundle.

    Calibrates the `lens` model named, its parameters named in `hold` kept at zero, from what detection measured and the
    field's sheet; no starting values are needed. Raises `TestfieldError` where no board, or too little of them, was
    seen, and where the observations do not determine a parameter.
    """
    rows = observations.measured
    finite = np.isfinite(rows.xy_px).all(axis=1) & np.isfinite(rows.cov_px2).all(axis=(1, 2))
    if not finite.all():
        bad = int(np.argmin(finite))
        station = rows.stations[rows.station[bad]]
        raise TestfieldError(
            f"observation {bad} (station '{station}', code {rows.code[bad]}) is not finite",
            "observations.parquet", "detect again, or drop the row",
        )  # fmt: skip
    start = starting_network(rows, field, width_px, height_px, lens, hold)
    discs = _Discs(rows.moments_px2[start.rows], start.radius_mm) if rows.centre_of_disc else None
    coarse = adjust(_coarse(start.network), _coarse(start.network).labels(start.stations, start.boards))
    network = _refined(start.network, coarse.network)
    adjustment, rejected, notes = _settle(network, discs, start)
    network = adjustment.network

    labels = network.labels(start.stations, start.boards)
    index = np.arange(len(labels) - 3 * len(network.kept_points))
    misread = [
        _record(rows.stations[rows.station[k]], field.boards[rows.board[k]].name, rows.xy_px[k], np.inf)
        for k in start.gross
    ]
    return Calibration(
        "stitched", network.interior, start.stations, network.stations, start.boards, network.boards, network.scale,
        adjustment.covariance[np.ix_(index, index)], tuple(labels[: len(index)]), adjustment.sigma0, adjustment.freedom,
        float(np.sqrt((adjustment.residual_px**2).sum(axis=1).mean())), len(network.xy_px), tuple(misread + rejected),
        network.xy_px, adjustment.residual_px, start.graph, tuple(start.notes + notes),
    )  # fmt: skip


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


def _settle(network: Network, discs: _Discs | None, start: Start) -> tuple[Adjustment, list[dict], list[str]]:
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
            return adjustment, rejected, _doubts(adjustment)
        for k in np.flatnonzero(bad):
            owner = network.point_board[network.point[k]]
            board = start.boards[owner] if owner >= 0 else ""
            rejected.append(_record(start.stations[network.image[k]], board, network.xy_px[k], size[k]))
        network, discs = network.take(~bad), discs.take(~bad) if discs else None
    adjustment = adjust(network, labels)
    return adjustment, rejected, ["the rejection of outliers had not come to rest", *_doubts(adjustment)]


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


def _record(station: str, board: str, xy_px: np.ndarray, sigmas: float) -> dict:
    """An observation that was turned down; one that was misread has no finite size."""
    size = float(sigmas) if np.isfinite(sigmas) else None
    return {"station": station, "board": board, "x_px": float(xy_px[0]), "y_px": float(xy_px[1]), "sigmas": size}
