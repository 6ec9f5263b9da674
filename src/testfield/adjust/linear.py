"""One linearisation of a network: whitened residuals and their derivatives, in the order of its structure."""

from dataclasses import dataclass

import numpy as np

from testfield.adjust.chain import Places, at_cameras, chain
from testfield.adjust.groups import Structure
from testfield.adjust.network import Network
from testfield.adjust.side_by_side import side_by_side
from testfield.camera.project import camera_jacobian

BATCH_ROWS = 4096
"""Observations that are linearised together: few enough to stay in a core's cache."""


@dataclass(frozen=True)
class Derivatives:
    """Of m observations in the structure's order, whitened: `by_unknown` (m, 2, w) by the unknowns that their groups
    depend on, `by_point` (m, 2, 3), and `residual` (m, 2), observed minus predicted."""

    by_unknown: np.ndarray
    by_point: np.ndarray
    residual: np.ndarray


def linearise(network: Network, structure: Structure, whitening: np.ndarray) -> Derivatives:
    """Derivatives at the network's values; `whitening` (m, 2, 2), in the network's order, maps residuals in px to such
    of unit covariance."""
    places, order = places_of(network), structure.order
    white = whitening[order]
    target = network.xy_px[order] - network.offset_px[order]
    m = len(order)
    by_unknown, by_point = np.zeros((m, 2, structure.width)), np.empty((m, 2, 3))
    residual = np.empty((m, 2))
    camera = network.images.camera[structure.image]
    edges = np.concatenate([[0], np.flatnonzero(np.diff(camera)) + 1, [m]])
    batches = [
        slice(at, min(at + BATCH_ROWS, stop))
        for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
        for at in range(start, stop, BATCH_ROWS)
    ]

    def fill(here: slice) -> None:
        image, point, own = structure.image[here], structure.point[here], network.cameras[camera[here.start]]
        at_camera = at_cameras(image, point, places)
        uv, by_interior, by_camera = camera_jacobian(own.interior, at_camera)
        off = target[here] - uv
        residual[here, 0] = white[here, 0, 0] * off[:, 0] + white[here, 0, 1] * off[:, 1]
        residual[here, 1] = white[here, 1, 0] * off[:, 0] + white[here, 1, 1] * off[:, 1]
        unknown = np.flatnonzero(own.unknown)
        chain(
            image,
            point,
            places,
            white[here],
            at_camera,
            by_interior,
            unknown,
            by_camera,
            by_unknown[here],
            by_point[here],
        )

    for _ in side_by_side(fill, batches, 5000 * m):
        pass
    return Derivatives(by_unknown, by_point, residual)


def places_of(network: Network) -> Places:
    """Where everything of a network stands."""
    images, boards = network.images, network.boards
    ways = np.zeros((len(boards), 6, max((w.shape[1] for w in network.ways), default=0)))
    for b, own in enumerate(network.ways):
        ways[b, :, : own.shape[1]] = own
    return Places(
        station_R=np.array(network.stations.R[images.station], float),
        station_t=np.array(network.stations.t_mm[images.station], float),
        member_R=np.array(network.members.R[images.member], float),
        member_t=np.array(network.members.t_mm[images.member], float),
        member=np.array(images.member, np.int64),
        board_R=np.array(boards.R, float, order="C"),
        board_t=np.array(boards.t_mm, float, order="C"),
        ways=ways,
        way_count=np.array([w.shape[1] for w in network.ways], np.int64),
        scale=float(network.scale),
        scale_free=bool(network.scale_free),
        mm=np.array(network.point_mm, float, order="C"),
        board=np.array(network.point_board, np.int64),
    )


def whitening_of(cov_px2: np.ndarray) -> np.ndarray:
    """(m, 2, 2) inverses of the lower Cholesky factors of covariances (m, 2, 2). Raises `LinAlgError` where one is not
    positive definite."""
    with np.errstate(all="ignore"):
        x = 1 / np.sqrt(cov_px2[:, 0, 0])
        off = cov_px2[:, 1, 0] * x
        y = 1 / np.sqrt(cov_px2[:, 1, 1] - off * off)
    answer = np.zeros((len(cov_px2), 2, 2))
    answer[:, 0, 0], answer[:, 1, 1] = x, y
    answer[:, 1, 0] = -off * x * y
    if not (np.isfinite(x) & np.isfinite(y)).all():
        raise np.linalg.LinAlgError("a covariance of pixels is not positive definite")
    return answer
