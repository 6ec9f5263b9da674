"""How long a 12-megapixel image with 1,200 dots takes, beside OpenCV's blob detector in the same run."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from testfield.camera.images import Frame
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.detect.centre import Centres
from testfield.detect.centre_ring import Rings, fit_with_rings
from testfield.detect.detect import measure_targets
from testfield.detect.observations import MEASURED
from testfield.detect.targets import Targets
from testfield.registry import find
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.stage import build_stage
from testfield.scene.world import BOARD, Panels, TrueMarks, World
from testfield.sensor.expose import Sensor, expose
from testfield.targets.field import Field
from testfield.targets.marks import RADII
from testfield.targets.ring_code import word_of_number

WIDTH_PX, HEIGHT_PX, COLUMNS, ROWS, DIAMETER_PX, BITS = 4096, 3000, 40, 30, 24.0, 14
CODE_EVERY = 3
REPEATS, GROWTH_REPEATS = 7, 3
SMALLEST_PX, LARGEST_PX = 5.0, 60.0
CENTRES = "xy_px", "cov_px2", "moments_px2", "contrast_dn", "background_dn", "chi2", "misfit"
COARSE_STEP = 40.0
"""OpenCV's detector looks at one binary image a step of its threshold: 17 by default, five at this step."""


def bench_speed(quick: bool, tell: Callable[[str], None]) -> dict[str, Any]:
    """Median seconds for each step, the ratio to OpenCV's detector, and the exponents of growth.

    Every third mark is a ring code. The detectors take turns, so that whatever else the machine does slows both.
    OpenCV's is given the image in 8 bits, the range of areas that we are given, white blobs, and its defaults in all
    else; `opencv_coarse_s` is the same with few thresholds. `forward_s` is the forward model of all dots, `rings_s`
    that of the coded ones with their rings. Ours uses threads, so times of the processor stand beside the clock's.
    `quick` leaves out the growth.
    """
    tell("a 12-megapixel image")
    largest = image_of(COLUMNS, ROWS, WIDTH_PX, HEIGHT_PX)
    tell("speed")
    result = _times(*largest, REPEATS)
    if not quick:
        tell("growth with targets and pixels")
        few = image_of(COLUMNS // 4, ROWS // 4, WIDTH_PX, HEIGHT_PX)
        boards = [few, image_of(COLUMNS // 2, ROWS // 2, WIDTH_PX, HEIGHT_PX), largest]
        sizes = [*(image_of(COLUMNS // 4, ROWS // 4, WIDTH_PX // k, HEIGHT_PX // k) for k in (4, 2)), few]
        for of_what, count, images in (("targets", "targets", boards), ("pixels", "pixels", sizes)):
            times = [_times(*image, GROWTH_REPEATS) for image in images]
            for name in ("find_centre_decode", "forward"):
                slope = np.polyfit(np.log([t[count] for t in times]), np.log([t[f"{name}_s"] for t in times]), 1)[0]
                result[f"{name}_exponent_of_{of_what}"] = float(slope)
    return result


def _times(frame: Frame, true_px: np.ndarray, repeats: int) -> dict[str, Any]:
    image = frame.pixels_dn.astype(np.float32)
    grey = (image * (255 / image.max())).astype(np.uint8)
    opencv, coarse = _opencv_detector(), _opencv_detector(COARSE_STEP)
    forward = find("centroids", "forward_model")

    def ours() -> Targets:
        return measure_targets(image, frame.sheet, "grey_centroid", SMALLEST_PX, BITS, RADII["1:2:3"], LARGEST_PX)

    ours()  # what is loaded at the first use is loaded now
    seconds: dict[str, list[float]] = {}
    processor: dict[str, list[float]] = {}

    def timed(name: str, act: Callable[[], Any]) -> Any:
        start, busy = time.perf_counter(), time.process_time()
        result = act()
        seconds.setdefault(name, []).append(time.perf_counter() - start)
        processor.setdefault(name, []).append(time.process_time() - busy)
        return result

    for turn in range(repeats):
        found = timed("find_centre_decode", ours)
        points = timed("opencv", partial(opencv.detect, grey))
        timed("opencv_coarse", partial(coarse.detect, grey))
        if turn < GROWTH_REPEATS:
            target = np.flatnonzero(found.status == MEASURED)
            rough = found.xy_px[target], found.moments_px2[target]
            fitted = timed("forward", partial(forward, image, frame.sheet, *rough))
            timed("rings", partial(fit_with_rings, image, frame.sheet, *_rings(found)))
    median = {f"{name}_s": float(np.median(values)) for name, values in seconds.items()}
    busy = {f"{name}_processor_s": float(np.median(values)) for name, values in processor.items()}
    return {
        "targets": len(true_px),
        "pixels": int(image.size),
        "repeats": repeats,
        "found": _matched(found.xy_px[target], true_px),
        "fitted": _matched(fitted.xy_px[fitted.ok], true_px),
        "opencv_found": _matched(np.array([point.pt for point in points]).reshape(-1, 2), true_px),
        **median,
        **busy,
        "opencv_over_ours": median["opencv_s"] / median["find_centre_decode_s"],
        "opencv_settings": {
            name: getattr(opencv.getParams(), name) for name in dir(opencv.getParams()) if not name.startswith("_")
        },
    }


def _rings(found: Targets) -> tuple[Centres, Rings]:
    """The coded targets whose turn is known, as they are fitted together with their rings."""
    rows = np.flatnonzero((found.code > 0) & np.isfinite(found.affine).all(axis=(1, 2)) & (found.status == MEASURED))
    rough = Centres(**{name: getattr(found, name)[rows] for name in CENTRES}, ok=np.ones(len(rows), bool))
    return rough, Rings(found.affine[rows], word_of_number(found.code[rows], BITS), BITS, RADII["1:2:3"])


def _opencv_detector(step: float | None = None) -> cv2.SimpleBlobDetector:
    settings = cv2.SimpleBlobDetector.Params()
    settings.filterByColor, settings.blobColor = True, 255
    settings.minArea, settings.maxArea = np.pi / 4 * SMALLEST_PX**2, np.pi / 4 * LARGEST_PX**2
    if step is not None:
        settings.thresholdStep = step
    return cv2.SimpleBlobDetector.create(settings)


def _matched(xy: np.ndarray, true_px: np.ndarray) -> int:
    """How many true centres have one found within half a pixel."""
    return int((cKDTree(xy).query(true_px)[0] < 0.5).sum()) if len(xy) else 0


def image_of(columns: int, rows: int, width_px: int, height_px: int) -> tuple[Frame, np.ndarray]:
    """A frame of one evenly lit board that fills it, and where its dots' centres are (n, 2)."""
    focal = 4000.0
    pitch = np.array([(width_px - 120) / max(columns - 1, 1), (height_px - 120) / max(rows - 1, 1)])
    grid = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)
    px = (grid - (np.array([columns, rows]) - 1) / 2) * pitch  # from the image's middle; one px is one mm
    n = len(px)
    zero = np.zeros(n, int)
    code = np.where(np.arange(n) % CODE_EVERY == 0, 1 + np.arange(n) % 516, 0)
    marks = TrueMarks(
        panel=zero,
        xy_mm=px * [1, -1],
        diameter_mm=np.full(n, DIAMETER_PX),
        code=code,
        role=zero + BOARD,
        board=zero,
        point=np.arange(n),
    )
    size = np.array([[width_px * 1.2, height_px * 1.2]])
    panels = Panels(
        name=("board",),
        world_from_panel=Poses.identity(1),
        size_mm=size,
        ground_albedo=np.array([0.04]),
        ink_albedo=np.array([0.85]),
    )
    middle = np.array([(width_px - 1) / 2, (height_px - 1) / 2])
    interior = Interior(width_px, height_px, np.array([focal, focal, *middle, 0, 0, 0, 0, 0]))
    pose = Poses(np.diag([1.0, -1, -1])[None], np.array([[0, 0, focal]]))
    world = World(
        name="speed",
        seed=1,
        field_diagonal_mm=2500.0,
        panels=panels,
        marks=marks,
        world_from_board=Poses.identity(1),
        station_name=("s",),
        camera_from_world=pose,
        interior=interior,
        psf_sigma_px=0.6,
        lights=(),
        ambient_radiance=0.0,
        field=Field(BITS, ()),
    )
    sensor = Sensor(3.45, 8.0, 1.0, 550.0, 0.6, 1e5, 2.3, 2.6, 64.0, 12)
    radiance = render_fast(build_stage(world), Irradiance.even(1, np.pi), 0, 3)
    peak_e = radiance.values.max() * sensor.electrons_per_radiance
    return expose(radiance, replace(sensor, time_ms=8000 / peak_e), 1), px + middle
