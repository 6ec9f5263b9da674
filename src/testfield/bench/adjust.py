"""The bundle against its peers, and how its time grows: Ceres by way of pycolmap, and OpenCV's `calibrateCamera`."""

import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.network import Network
from testfield.bench.networks import CAMERA, SIGMA_PX, free_network, one_board
from testfield.errors import TestfieldError

REPEATS = 3
GROWTH_POINTS = (6_250, 12_500, 25_000, 50_000, 100_000)
GROWTH_IMAGES = 20
LARGE = (400, 40_000, 16)
"""Images, points and rays a point of the network whose memory is measured."""


def bench_adjust(quick: bool, tell: Callable[[str], None]) -> dict[str, Any]:
    """All comparisons; `quick` on smaller networks. `tell` hears what is being done."""
    answer: dict[str, Any] = {}
    tell("the same network by Ceres")
    answer["ceres"] = against_ceres(10 if quick else 40, 300 if quick else 1500, 1 if quick else REPEATS)
    tell("the same board by OpenCV")
    answer["opencv"] = against_opencv()
    tell("growth with points")
    answer["growth"] = growth(GROWTH_POINTS[:2] if quick else GROWTH_POINTS)
    if not quick:
        tell(f"{LARGE[0]} images")
        answer["large"] = large()
    return answer


def against_ceres(images: int, points: int, repeats: int) -> dict[str, Any]:
    """Times and minima of one free network, both sides from the same start, in turn.

    Ceres' time is its solver's alone; ours includes the joint covariance of all cameras and points, for which Ceres
    would need more. `ratio` is the median of the paired ratios, ours over Ceres'.
    """
    from testfield.bench.ceres import solve_with_ceres

    _, start = free_network(images, points)
    labels = _labels(start)
    seconds: dict[str, list[float]] = {"ours": [], "without_covariance": [], "ceres": []}
    for _ in range(repeats):
        try:
            theirs = solve_with_ceres(start)
        except TestfieldError as error:
            return {"skipped": str(error)}
        begin = time.perf_counter()
        found = adjust(start, labels)
        middle = time.perf_counter()
        covariance = found.cov.points(np.arange(points))
        across = found.cov.across(np.arange(points))
        seconds["ours"].append(time.perf_counter() - begin)
        seconds["without_covariance"].append(middle - begin)
        seconds["ceres"].append(theirs.seconds)
        assert len(covariance) == len(across) == 3 * points
    ours_px2 = found.chi2 * SIGMA_PX**2
    ratios = np.divide(seconds["ours"], seconds["ceres"])
    return {
        "ratio": float(np.median(ratios)),
        "ratios": ratios.tolist(),
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
    found = adjust(single, _labels(single))
    ours = float(np.sqrt((found.residual_px**2).sum(axis=1).mean()))
    return {"ours_rms_px": ours, "opencv_rms_px": float(theirs), "difference_px": abs(ours - float(theirs))}


def growth(points: tuple[int, ...]) -> dict[str, Any]:
    """Seconds of adjustment and of every point's covariance at a fixed number of cameras, and the exponent."""
    times = {}
    for n in points:
        _, start = free_network(GROWTH_IMAGES, n, rays=8)
        begin = time.perf_counter()
        found = adjust(start, _labels(start))
        found.cov.point_blocks()
        times[n] = (time.perf_counter() - begin) / found.steps
    slope = np.polyfit(np.log(list(times)), np.log(list(times.values())), 1)[0]
    return {"exponent_of_points": float(slope), "seconds_a_step": times, "images": GROWTH_IMAGES}


def large() -> dict[str, Any]:
    """Time and peak memory of a network of hundreds of images, in a process of its own."""
    code = "from testfield.bench.adjust import large_here; large_here()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    if done.returncode:
        raise TestfieldError(f"the large network failed: {done.stderr.strip().splitlines()[-1]}")
    import json

    return dict(json.loads(done.stdout.splitlines()[-1]))


def large_here() -> None:
    """Adjust the large network and print its figures."""
    import json

    from testfield.store.pool import end_with_parent

    end_with_parent()

    images, points, rays = LARGE
    _, start = free_network(images, points, rays)
    begin = time.perf_counter()
    found: Adjustment = adjust(start, _labels(start))
    print(
        json.dumps(
            {
                "images": images,
                "points": points,
                "observations": len(start.point),
                "seconds": time.perf_counter() - begin,
                "steps": found.steps,
                "sigma0": found.sigma0,
                "peak_memory_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
            }
        )
    )


def _labels(network: Network) -> list[str]:
    boards = tuple(f"B{k}" for k in range(len(network.boards)))
    return network.labels(tuple(f"S{k}" for k in range(len(network.stations))), boards)
