"""A network of loose points and of images, with nothing known."""

import numpy as np

from testfield.adjust.network import Camera, Images, Network
from testfield.calibrate.ties import Ties
from testfield.camera.pose import Poses


def loose_network(
    ties: Ties, cameras: tuple[Camera, ...], camera: np.ndarray, poses: Poses, point_mm: np.ndarray
) -> Network:
    """A network of loose points and of images, each by its `camera` (I,) from a place of its own; nothing is known."""
    n, images = len(point_mm), len(poses)
    each = Images(np.arange(images), camera, np.zeros(images, int))
    return Network(
        cameras,
        poses,
        each,
        Poses.identity(0),
        (),
        point_mm,
        np.full(n, -1),
        point_mm,
        np.zeros((n, 3, 3)),
        ties.image,
        ties.point,
        ties.xy_px,
        ties.cov_px2,
        np.zeros((len(ties), 2)),
    )
