"""What the shapes of loose discs' images tell: their radii, and where the centre of area lies beside the projection of
the centre."""

import numpy as np

from testfield.adjust.network import Network
from testfield.adjust.normals import target_normals
from testfield.camera.circle import disc_image
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import camera_jacobian, project
from testfield.camera.several import by_camera


def by_point(network: Network) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n, k) of the network's observations by point, padded, and which of them are there (n, k)."""
    n, m = len(network.point_mm), len(network.point)
    order = np.argsort(network.point, kind="stable")
    count = np.bincount(network.point, minlength=n)
    first = np.cumsum(count) - count
    slot = np.arange(max(int(count.max(initial=1)), 1))
    there = slot < count[:, None]
    return order[np.minimum(first[:, None] + slot, max(m - 1, 0))], there


def measured_radii(network: Network, moments_px2: np.ndarray) -> np.ndarray:
    """(n,) radii of the discs in the network's unit, NaN of points that show none.

    Across the line of sight's tilt a disc is seen in its full width, so the longer half-axis of its image over the
    scale there is its radius; the median over all images. Good to a few parts in a hundred far off the axis.
    """
    at_camera = network.camera_from_datum()[network.image].apply(network.datum_mm()[network.point])
    jacobian = by_camera(_by_point, network.interiors, network.camera, at_camera)
    scale = np.linalg.svd(jacobian, compute_uv=False).prod(axis=1) ** 0.5
    with np.errstate(invalid="ignore"):
        bad = ~np.isfinite(moments_px2).all(axis=(1, 2))
        moments = np.where(bad[:, None, None], 0, moments_px2)
        radius = 2 * np.sqrt(np.maximum(np.linalg.eigvalsh(moments)[:, 1], 0)) / scale
    radius[bad] = np.nan
    rows, there = by_point(network)
    table = np.where(there, radius[rows], np.nan)
    answer = np.full(len(table), np.nan)
    some = np.isfinite(table).any(axis=1)
    answer[some] = np.nanmedian(table[some], axis=1)
    return answer


def disc_offsets(network: Network, moments_px2: np.ndarray, radius_mm: np.ndarray) -> np.ndarray:
    """(m, 2) centre of the disc's image minus projection of its centre, at the network's present values; zero for
    points without a radius (NaN) or a shape, and for those seen once."""
    offset = np.zeros((len(network.point), 2))
    rows, there = by_point(network)
    there = there & np.isfinite(moments_px2).all(axis=(1, 2))[rows]
    discs = np.flatnonzero((there.sum(axis=1) >= 2) & np.isfinite(radius_mm) & (radius_mm > 0))
    if not len(discs):
        return offset
    poses = network.camera_from_datum()
    normal = np.full((len(network.point_mm), 3), np.nan)
    moments = np.where(np.isfinite(moments_px2), moments_px2, 0)[rows[discs]]
    normal[discs] = target_normals(
        network.interiors,
        network.camera[rows[discs]].ravel(),
        poses[network.image[rows[discs]].ravel()],
        there[discs],
        network.point_mm[discs],
        radius_mm[discs],
        moments,
    )
    here = np.flatnonzero(np.isfinite(normal[network.point]).all(axis=1))
    point, seen_from = network.point[here], poses[network.image[here]]
    centre = network.point_mm[point]
    seen = (seen_from, centre, normal[point], radius_mm[point])
    offset[here] = np.nan_to_num(by_camera(eccentricity, network.interiors, network.camera[here], *seen))
    return offset


def eccentricity(
    interior: Interior, poses: Poses, centre_mm: np.ndarray, normal: np.ndarray, radius_mm: np.ndarray
) -> np.ndarray:
    """(n, 2) px from the projections of discs' centres to the centres of their images; arguments as of `disc_image`."""
    image = disc_image(interior, poses, centre_mm, normal, radius_mm)
    return image.centroid_px - project(interior, poses, centre_mm)


def _by_point(interior: Interior, at_camera: np.ndarray) -> np.ndarray:
    return camera_jacobian(interior, at_camera)[2]
