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
        cameras=cameras,
        stations=poses,
        images=each,
        boards=Poses.identity(0),
        ways=(),
        point_mm=point_mm,
        point_board=np.full(n, -1),
        known_mm=point_mm,
        information=np.zeros((n, 3, 3)),
        image=ties.image,
        point=ties.point,
        xy_px=ties.xy_px,
        cov_px2=ties.cov_px2,
        offset_px=np.zeros((len(ties), 2)),
    )
