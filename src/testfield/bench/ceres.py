"""The same network given to Ceres, by way of pycolmap: the opponent of the bundle."""

from dataclasses import dataclass
from time import perf_counter, process_time

import numpy as np

from testfield.adjust.network import Network
from testfield.calibrate.as_colmap import as_reconstruction, free_bundle
from testfield.errors import TestfieldError

AS_COLMAP = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
"""The parameters of COLMAP's OPENCV camera. Its Brown model has no k3, so that must be held at zero."""


@dataclass(frozen=True)
class CeresResult:
    """What Ceres found: `squares_px2` sum of squared residuals, `seconds` and
    `processor_seconds` of its solver, `steps`, `points_mm` (n, 3),
    `parameters` (8,) in the order of `AS_COLMAP`."""

    squares_px2: float
    seconds: float
    processor_seconds: float
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
    rebuilt, numbers = as_reconstruction(pycolmap, network, "OPENCV", AS_COLMAP)
    images = len(network.images.station)
    adjuster = free_bundle(pycolmap, rebuilt, images, function_tolerance=1e-10, gradient_tolerance=1e-10)
    begin, processor = perf_counter(), process_time()
    summary = adjuster.solve()
    seconds, processor_seconds = perf_counter() - begin, process_time() - processor
    ceres = summary.ceres_summary  # type: ignore[attr-defined]
    points = np.array([rebuilt.point3D(number).xyz for number in numbers])
    steps = int(ceres.num_successful_steps)
    return CeresResult(
        squares_px2=2 * ceres.final_cost,
        seconds=seconds,
        processor_seconds=processor_seconds,
        steps=steps,
        points_mm=points,
        parameters=np.array(rebuilt.camera(1).params),
    )
