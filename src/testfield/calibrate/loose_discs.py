"""What the shapes of loose discs' images tell: their radii, and where the centre of area lies beside the projection of
the centre."""

import numpy as np

from testfield.adjust.network import Network
from testfield.adjust.normals import target_normals
from testfield.camera.circle import disc_image
from testfield.camera.project import camera_jacobian, project


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
    _, _, jacobian = camera_jacobian(network.interior, at_camera)
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
        network.interior, poses[network.image[rows[discs]].ravel()], there[discs], network.point_mm[discs],
        radius_mm[discs], moments,
    )  # fmt: skip
    here = np.flatnonzero(np.isfinite(normal[network.point]).all(axis=1))
    point, seen_from = network.point[here], poses[network.image[here]]
    centre = network.point_mm[point]
    image = disc_image(network.interior, seen_from, centre, normal[point], radius_mm[point])
    offset[here] = np.nan_to_num(image.centroid_px - project(network.interior, seen_from, centre))
    return offset
