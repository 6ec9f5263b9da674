"""How long a 12-megapixel image with 1,200 dots takes, beside OpenCV's blob detector in the same run."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.images import Frame
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.detect.detect import measure_targets
from testfield.detect.observations import MEASURED
from testfield.registry import find
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.stage import build_stage
from testfield.scene.world import BOARD, Panels, TrueMarks, World
from testfield.sensor.expose import Sensor, expose
from testfield.targets.field import Field
from testfield.targets.marks import RADII

WIDTH_PX, HEIGHT_PX, COLUMNS, ROWS, DIAMETER_PX, BITS = 4096, 3000, 40, 30, 24.0, 14
CODE_EVERY = 3
REPEATS = 3
SMALLEST_PX, LARGEST_PX = 5.0, 60.0


def bench_speed(quick: bool, tell: Callable[[str], None]) -> dict[str, Any]:
    """Seconds for each step, the ratio to OpenCV's detector, and the exponents of growth.

    Every third mark is a ring code. `quick` leaves out the growth.
    """
    tell("a 12-megapixel image")
    frame, true_px = image_of(COLUMNS, ROWS, WIDTH_PX, HEIGHT_PX)
    tell("speed")
    result = _times(frame, true_px)
    if not quick:
        tell("growth with targets and pixels")
        boards = [(COLUMNS // k, ROWS // k) for k in (4, 2, 1)]
        by_targets = {c * r: _times(*image_of(c, r, WIDTH_PX, HEIGHT_PX)) for c, r in boards}
        sizes = [(WIDTH_PX // k, HEIGHT_PX // k) for k in (4, 2, 1)]
        by_pixels = {w * h: _times(*image_of(10, 7, w, h)) for w, h in sizes}
        for name in ("find_centre_decode_s", "forward_s"):
            result[name.removesuffix("_s") + "_exponent_of_targets"] = _slope(
                {n: t[name] for n, t in by_targets.items()}
            )
            result[name.removesuffix("_s") + "_exponent_of_pixels"] = _slope({n: t[name] for n, t in by_pixels.items()})
    return result


def _times(frame: Frame, true_px: np.ndarray) -> dict[str, Any]:
    image = frame.pixels_dn.astype(np.float32)
    grey = (image * (255 / image.max())).astype(np.uint8)
    settings = cv2.SimpleBlobDetector.Params()
    settings.filterByColor, settings.blobColor = True, 255
    settings.minArea, settings.maxArea = np.pi / 4 * SMALLEST_PX**2, np.pi / 4 * LARGEST_PX**2
    detector = cv2.SimpleBlobDetector.create(settings)
    forward = find("centroids", "forward_model")
    seconds: dict[str, list[float]] = {name: [] for name in ("find_centre_decode_s", "forward_s", "opencv_s")}
    for _ in range(REPEATS):
        start = time.perf_counter()
        found = measure_targets(image, frame.sheet, "grey_centroid", SMALLEST_PX, BITS, RADII["1:2:3"], LARGEST_PX)
        begin = time.perf_counter()
        target = np.flatnonzero(found.status == MEASURED)
        fitted = forward(image, frame.sheet, found.xy_px[target], found.moments_px2[target])
        fit = time.perf_counter()
        points = detector.detect(grey)
        end = time.perf_counter()
        for name, value in zip(seconds, (begin - start, fit - begin, end - fit), strict=True):
            seconds[name].append(value)
    median = {name: float(np.median(values)) for name, values in seconds.items()}
    return {
        "targets": len(true_px),
        "pixels": int(image.size),
        "found": _matched(found.xy_px[target], true_px),
        "fitted": _matched(fitted.xy_px[fitted.ok], true_px),
        "opencv_found": _matched(np.array([point.pt for point in points]).reshape(-1, 2), true_px),
        **median,
        "opencv_over_ours": median["opencv_s"] / median["find_centre_decode_s"],
    }


def _matched(xy: np.ndarray, true_px: np.ndarray) -> int:
    """How many true centres have one found within half a pixel."""
    return int((cKDTree(xy).query(true_px)[0] < 0.5).sum()) if len(xy) else 0


def _slope(times: dict[int, float]) -> float:
    return float(np.polyfit(np.log(list(times)), np.log(list(times.values())), 1)[0])


def image_of(columns: int, rows: int, width_px: int, height_px: int) -> tuple[Frame, np.ndarray]:
    """A frame of one evenly lit board that fills it, and where its dots' centres are (n, 2)."""
    focal = 4000.0
    pitch = np.array([(width_px - 120) / max(columns - 1, 1), (height_px - 120) / max(rows - 1, 1)])
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    px = (grid - (np.array([columns, rows]) - 1) / 2) * pitch  # from the image's middle; one px is one mm
    n = len(px)
    zero = np.zeros(n, int)
    code = np.where(np.arange(n) % CODE_EVERY == 0, 1 + np.arange(n) % 516, 0)
    marks = TrueMarks(zero, px * [1, -1], np.full(n, DIAMETER_PX), code, zero + BOARD, zero, np.arange(n))
    size = np.array([[width_px * 1.2, height_px * 1.2]])
    panels = Panels(("board",), Poses.identity(1), size, np.array([0.04]), np.array([0.85]))
    middle = np.array([(width_px - 1) / 2, (height_px - 1) / 2])
    interior = Interior(width_px, height_px, np.array([focal, focal, *middle, 0, 0, 0, 0, 0]))
    pose = Poses(np.diag([1.0, -1, -1])[None], np.array([[0, 0, focal]]))
    world = World(
        "speed", 1, 2500.0, panels, marks, Poses.identity(1), ("s",), pose, interior, 0.6, (), 0.0, Field(BITS, ())
    )
    sensor = Sensor(3.45, 8.0, 1.0, 550.0, 0.6, 1e5, 2.3, 2.6, 64.0, 12)
    radiance = render_fast(build_stage(world), Irradiance.even(1, np.pi), 0, 3)
    peak_e = radiance.values.max() * sensor.electrons_per_radiance
    return expose(radiance, replace(sensor, time_ms=8000 / peak_e), 1), px + middle
