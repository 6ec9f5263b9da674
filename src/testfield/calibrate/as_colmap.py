"""A network as pycolmap takes it. The module is handed in, for it need not be installed."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from testfield.adjust.network import Network


def as_reconstruction(pycolmap: Any, network: Network, model: str, own: Sequence[str]) -> tuple[Any, list[int]]:
    """The one camera, all images and loose points of a network as a `pycolmap.Reconstruction`, and its points' numbers.

    `model` is COLMAP's name of the lens model, `own` are our names of its parameters in its order. Images count from 1.
    """
    interior = network.interior
    values = [float(interior.parameters[interior.names.index(name)]) for name in own]
    rebuilt = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model=model, width=interior.width_px, height=interior.height_px, params=values, camera_id=1
    )
    rebuilt.add_camera_with_trivial_rig(camera)
    numbers = [rebuilt.add_point3D(xyz, pycolmap.Track(), np.zeros(3, np.uint8)) for xyz in network.point_mm]
    poses = network.camera_from_datum()
    for k in range(len(poses)):
        rows = np.flatnonzero(network.image == k)
        pose = pycolmap.Rigid3d(np.column_stack([poses.R[k], poses.t_mm[k]]))
        image = pycolmap.Image(name=f"{k}", keypoints=network.xy_px[rows], camera_id=1, image_id=k + 1)
        rebuilt.add_image_with_trivial_frame(image, pose)
        for index, row in enumerate(rows):
            rebuilt.add_observation(numbers[network.point[row]], pycolmap.TrackElement(k + 1, index))
    return rebuilt, numbers


def free_bundle(pycolmap: Any, rebuilt: Any, images: int, **solver: Any) -> Any:
    """Ceres' adjustment of all of it, ready to `solve()`, the datum held by two cameras; `solver` its options."""
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.print_summary = False
    for name, value in solver.items():
        setattr(options.ceres.solver_options, name, value)
    config = pycolmap.BundleAdjustmentConfig()
    for k in range(images):
        config.add_image(k + 1)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    # Since COLMAP 4 solvers have a choice of their own; Ceres' is the one that covariances can be asked of.
    make = getattr(pycolmap, "create_default_ceres_bundle_adjuster", pycolmap.create_default_bundle_adjuster)
    return make(options, config, rebuilt)
