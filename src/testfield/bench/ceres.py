"""The same network given to Ceres, by way of pycolmap: the opponent of the bundle."""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from testfield.adjust.network import Network
from testfield.camera.pose import Poses
from testfield.errors import TestfieldError

AS_COLMAP = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
"""The parameters of COLMAP's OPENCV camera. Its Brown model has no k3, so that must be held at zero."""


@dataclass(frozen=True)
class CeresResult:
    """What Ceres found: `squares_px2` sum of squared residuals, `seconds` of its solver, `steps`, `points_mm` (n, 3),
    `parameters` (8,) in the order of `AS_COLMAP`."""

    squares_px2: float
    seconds: float
    steps: int
    points_mm: np.ndarray
    parameters: np.ndarray


def solve_with_ceres(network: Network) -> CeresResult:
    """Adjust a free network of one Brown camera without k3 and of loose points, all pixels of equal weight.

    Setting the problem up counts for nobody. Raises `TestfieldError` where pycolmap is not installed.
    """
    try:
        import pycolmap
    except ImportError as error:
        raise TestfieldError("pycolmap is not installed", do="pip install 'testfield[peers]'") from error
    interior = network.interior
    values = [float(interior.parameters[interior.names.index(name)]) for name in AS_COLMAP]
    rebuilt = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model="OPENCV", width=interior.width_px, height=interior.height_px, params=values, camera_id=1
    )
    rebuilt.add_camera_with_trivial_rig(camera)
    numbers = [rebuilt.add_point3D(xyz, pycolmap.Track(), np.zeros(3, np.uint8)) for xyz in network.point_mm]
    poses: Poses = network.camera_from_datum()
    for k in range(len(network.images.station)):
        rows = np.flatnonzero(network.image == k)
        pose = pycolmap.Rigid3d(np.column_stack([poses.R[k], poses.t_mm[k]]))
        image = pycolmap.Image(name=f"{k}", keypoints=network.xy_px[rows], camera_id=1, image_id=k + 1)
        rebuilt.add_image_with_trivial_frame(image, pose)
        for index, row in enumerate(rows):
            rebuilt.add_observation(numbers[network.point[row]], pycolmap.TrackElement(k + 1, index))

    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point = True
    options.print_summary = False
    options.ceres.solver_options.function_tolerance = 1e-10
    options.ceres.solver_options.gradient_tolerance = 1e-10
    config = pycolmap.BundleAdjustmentConfig()
    for k in range(len(network.images.station)):
        config.add_image(k + 1)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_bundle_adjuster(options, config, rebuilt)
    begin = perf_counter()
    summary = adjuster.solve()
    seconds = perf_counter() - begin
    ceres = summary.ceres_summary  # type: ignore[attr-defined]
    points = np.array([rebuilt.point3D(number).xyz for number in numbers])
    steps = int(ceres.num_successful_steps)
    return CeresResult(2 * ceres.final_cost, seconds, steps, points, np.array(rebuilt.camera(1).params))
