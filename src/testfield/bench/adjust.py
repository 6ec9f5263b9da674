"""The bundle against its peers, and how its time grows: Ceres and COLMAP's covariance by way of pycolmap, OpenCV's
`calibrateCamera`, and another checkout of testfield."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.bench.colmap_covariance import SIZES
from testfield.bench.networks import CAMERA, SIGMA_PX, free_network, one_board, plain_labels
from testfield.errors import TestfieldError

REPEATS = 3
QUICK_REPEATS = 7
"""Of networks that take a tenth of a second."""
CERES = {"small": (10, 300), "large": (40, 1500)}
"""Images and points, every image of every point."""
GROWTH_POINTS = (6_250, 12_500, 25_000, 50_000, 100_000)
GROWTH_IMAGES = 20
LARGE = (400, 40_000, 16)
"""Images, points and rays a point of the network whose memory is measured."""
PARTS = ("ceres", "covariance", "opencv", "growth", "large")


def bench_adjust(quick: bool, only: str | None, against: Path | None, tell: Callable[[str], None]) -> dict[str, Any]:
    """All comparisons, or `only` one of `PARTS`; `quick` on smaller networks. What can be run in the other checkout
    `against` of testfield stands beside. `tell` hears what is being done."""
    sizes = ("small",) if quick else ("small", "large")
    answer: dict[str, Any] = {}
    if only in (None, "ceres"):
        for size in sizes:
            tell(f"the {size} network by Ceres")
            repeats = QUICK_REPEATS if size == "small" else REPEATS
            answer.setdefault("ceres", {})[size] = against_ceres(*CERES[size], repeats)
            if against is not None:
                tell("the same by the other checkout")
                other = _run(f"against_ceres(*{CERES[size]}, {repeats})", against)
                answer["ceres"][f"{size}, other"] = other
    if only in (None, "covariance"):
        for size in sizes:
            tell(f"the {size} network's covariance by COLMAP")
            code = f"beside_colmap(*{SIZES[size]}, {QUICK_REPEATS if size == 'small' else 1})"
            answer.setdefault("covariance", {})[size] = _run(code, None, "testfield.bench.colmap_covariance")
    if only in (None, "opencv"):
        tell("the same board by OpenCV")
        answer["opencv"] = against_opencv()
    if only in (None, "growth"):
        tell("growth with points")
        answer["growth"] = growth(GROWTH_POINTS[:2] if quick else GROWTH_POINTS)
    if only == "large" or (only is None and not quick):
        tell(f"{LARGE[0]} images")
        answer["large"] = large(None)
        if against is not None:
            tell("the same by the other checkout")
            answer["large, other"] = large(against)
    return answer


def against_ceres(images: int, points: int, repeats: int) -> dict[str, Any]:
    """Times and minima of one free network, both sides from the same start, in turn.

    Ceres' time is its solver's alone; ours includes the joint covariance of all cameras and points, for which Ceres
    would need more. `ratio` is the median of the paired ratios, ours over Ceres', `processor_ratio` that of processor
    time.
    """
    from testfield.bench.ceres import solve_with_ceres

    _load_what_is_compiled()
    _, start = free_network(images, points)
    labels = plain_labels(start)
    seconds: dict[str, list[float]] = {
        "ours": [],
        "without_covariance": [],
        "ceres": [],
        "ours_processor": [],
        "ceres_processor": [],
    }
    for _ in range(repeats):
        try:
            theirs = solve_with_ceres(start)
        except TestfieldError as error:
            return {"skipped": str(error)}
        begin, processor = time.perf_counter(), time.process_time()
        found = adjust(start, labels)
        middle = time.perf_counter()
        covariance = found.cov.points(np.arange(points))
        across = found.cov.across(np.arange(points))
        seconds["ours"].append(time.perf_counter() - begin)
        seconds["ours_processor"].append(time.process_time() - processor)
        seconds["without_covariance"].append(middle - begin)
        seconds["ceres"].append(theirs.seconds)
        seconds["ceres_processor"].append(theirs.processor_seconds)
        assert len(covariance) == len(across) == 3 * points
    ours_px2 = found.chi2 * SIGMA_PX**2
    ratios = np.divide(seconds["ours"], seconds["ceres"])
    return {
        "ratio": float(np.median(ratios)),
        "ratios": ratios.tolist(),
        "processor_ratio": float(np.median(np.divide(seconds["ours_processor"], seconds["ceres_processor"]))),
        **{f"{name}_s": float(np.median(values)) for name, values in seconds.items()},
        "images": images,
        "points": points,
        "observations": len(start.point),
        "relative_cost_difference": abs(theirs.squares_px2 / ours_px2 - 1),
        "our_steps": found.steps,
        "their_steps": theirs.steps,
        "sigma0": found.sigma0,
    }


def against_opencv() -> dict[str, float]:
    """RMS of the same observations by `cv2.calibrateCamera` and by the bundle, one exact board, the same model."""
    import cv2

    network = one_board(12, 12, 9)
    board = network.point_mm.astype(np.float32)
    views = [network.xy_px[network.image == k].astype(np.float32) for k in range(len(network.stations))]
    single = replace(network, xy_px=np.concatenate(views).astype(float))  # OpenCV takes single precision
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 1000, 1e-15)
    theirs, *_ = cv2.calibrateCamera(
        [board] * len(views),
        views,
        (CAMERA.width_px, CAMERA.height_px),
        None,
        None,
        criteria=criteria,  # type: ignore[call-overload]
    )
    single = replace(single, point_mm=board.astype(float), known_mm=board.astype(float))
    found = adjust(single, plain_labels(single))
    ours = float(np.sqrt((found.residual_px**2).sum(axis=1).mean()))
    return {"ours_rms_px": ours, "opencv_rms_px": float(theirs), "difference_px": abs(ours - float(theirs))}


def growth(points: tuple[int, ...]) -> dict[str, Any]:
    """Seconds of adjustment and of every point's covariance at a fixed number of cameras, and the exponent."""
    times = {}
    _load_what_is_compiled()
    for n in points:
        _, start = free_network(GROWTH_IMAGES, n, rays=8)
        begin = time.perf_counter()
        found = adjust(start, plain_labels(start))
        found.cov.point_blocks()
        times[n] = (time.perf_counter() - begin) / found.steps
    slope = np.polyfit(np.log(list(times)), np.log(list(times.values())), 1)[0]
    return {"exponent_of_points": float(slope), "seconds_a_step": times, "images": GROWTH_IMAGES}


def _load_what_is_compiled() -> None:
    """Before anything is timed: it takes as long as a small adjustment, once a process."""
    _, small = free_network(4, 20)
    adjust(small, plain_labels(small)).cov.points(np.arange(20))


def large(checkout: Path | None) -> dict[str, Any]:
    """Time and peak memory of a network of hundreds of images, here or by another checkout."""
    return _run("large_here()", checkout)


def large_here() -> dict[str, Any]:
    """Adjust the large network in this process."""
    from testfield.store.pool import end_with_parent

    end_with_parent()
    images, points, rays = LARGE
    _, start = free_network(images, points, rays)
    begin = time.perf_counter()
    found: Adjustment = adjust(start, plain_labels(start))
    return {
        "images": images,
        "points": points,
        "observations": len(start.point),
        "seconds": time.perf_counter() - begin,
        "steps": found.steps,
        "sigma0": found.sigma0,
    }


def _run(what: str, checkout: Path | None, module: str = "testfield.bench.adjust") -> dict[str, Any]:
    """What a call in `module` answers, or prints as its last line, in a process of its own, of this testfield or of
    another checkout's; with the process' `peak_memory_gb` and processor time."""
    code = (
        f"import json, resource; from {module} import *; found = {what}\n"
        "if found: print(json.dumps(found))\n"
        "used = resource.getrusage(resource.RUSAGE_SELF)\n"
        "print(json.dumps([used.ru_maxrss / 1e6, used.ru_utime + used.ru_stime]))"
    )
    environment = dict(os.environ)
    if checkout is not None:
        environment["PYTHONPATH"] = str(checkout.resolve() / "src")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        why = (done.stderr.strip().splitlines() or ["it was ended"])[-1]
        raise TestfieldError(f"a network failed in {checkout or 'a process of its own'}: {why}")
    found, (memory, processor) = map(json.loads, done.stdout.splitlines()[-2:])
    return {**found, "peak_memory_gb": memory, "process_processor_s": processor}
