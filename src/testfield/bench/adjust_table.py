"""The figures of `testfield bench adjust` as lines for a person."""

from collections.abc import Iterator
from typing import Any


def lines(figures: dict[str, Any]) -> Iterator[str]:
    """Lines of all parts that were run."""
    for size, row in figures.get("ceres", {}).items():
        yield from _ceres(size, row)
    for size, row in figures.get("covariance", {}).items():
        yield from _covariance(size, row)
    if "opencv" in figures:
        row = figures["opencv"]
        yield (
            f"OpenCV      rms {row['opencv_rms_px']:.9f} px, ours {row['ours_rms_px']:.9f} px, "
            f"difference {row['difference_px']:.1e} px"
        )
    if "growth" in figures:
        yield f"growth      time of a step grows as points^{figures['growth']['exponent_of_points']:.2f}"
    for name, row in figures.items():
        if name.startswith("large"):
            yield (
                f"{name:<12}{_size(row)}: {row['seconds']:.1f} s, {row['peak_memory_gb']:.1f} GB; "
                f"of the processors, setting up included, {row['process_processor_s']:.1f} s"
            )


def _size(row: dict[str, Any]) -> str:
    return f"{row['images']} images, {row['points']} points, {row['observations']} observations"


def _ceres(size: str, row: dict[str, Any]) -> Iterator[str]:
    if "skipped" in row:
        yield f"Ceres       not compared: {row['skipped']}"
        return
    yield f"Ceres       {size}: {_size(row)}"
    processor = f"; of the processors {row['processor_ratio']:.2f}" if "processor_ratio" in row else ""
    yield f"            time with all covariances over Ceres' without any {row['ratio']:.2f}{processor}"
    yield f"            ours {row['ours_s']:.3f} s in {row['our_steps']} steps, covariances included"
    yield f"            ours {row['without_covariance_s']:.3f} s without them"
    yield f"            Ceres {row['ceres_s']:.3f} s in {row['their_steps']} steps"
    yield f"            relative difference of the cost {row['relative_cost_difference']:.1e}"


def _covariance(size: str, row: dict[str, Any]) -> Iterator[str]:
    if "skipped" in row:
        yield f"covariance  not compared: {row['skipped']}"
        return
    yield f"covariance  {size}: {_size(row)}"
    yield f"            ours over COLMAP's own {row['ratio']:.2f}; of the processors {row['processor_ratio']:.2f}"
    yield f"            ours {row['ours_s']:.3f} s, COLMAP {row['colmap_s']:.3f} s, {row['peak_memory_gb']:.1f} GB both"
    yield f"            relative difference of standard uncertainties {row['relative_difference_of_u']:.1e}"
