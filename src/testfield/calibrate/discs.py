"""What the shapes of boards' and bars' discs add to the projections of their centres."""

import numpy as np

from testfield.adjust.network import Network
from testfield.adjust.normals import target_normals
from testfield.calibrate.loose_discs import eccentricity
from testfield.camera.several import by_camera


class Discs:
    """What the shapes of the discs' images add: moments (m, 2, 2) of the observations, radii (n,) of the points."""

    def __init__(self, moments_px2: np.ndarray, radius_mm: np.ndarray):
        self.moments_px2, self.radius_mm = moments_px2, radius_mm

    def take(self, rows: np.ndarray) -> "Discs":
        """Those of some observations."""
        return Discs(self.moments_px2[rows], self.radius_mm)

    def offsets(self, network: Network) -> np.ndarray:
        """(m, 2) centre of the disc's image minus projection of its centre, at the network's present values."""
        normals, poses = network.normals(), network.camera_from_datum()
        for k in np.flatnonzero(network.point_board < 0):
            v = np.flatnonzero(network.point == k)
            normals[k] = target_normals(
                network.interiors,
                network.camera[v],
                poses[network.image[v]],
                np.ones((1, len(v)), bool),
                network.point_mm[[k]],
                self.radius_mm[[k]],
                self.moments_px2[v][None],
            )[0]
        offset = np.zeros((len(network.point), 2))
        discs = np.flatnonzero(self.radius_mm[network.point] > 0)  # a corner is seen where it is
        point = network.point[discs]
        seen = (poses[network.image[discs]], network.datum_mm()[point], normals[point], self.radius_mm[point])
        offset[discs] = by_camera(eccentricity, network.interiors, network.camera[discs], *seen)
        return offset
