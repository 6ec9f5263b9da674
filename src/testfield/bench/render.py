"""The fast renderer against plain path tracing: figure of merit, and how time grows."""

import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from testfield.certify.light import first_moment_centres
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance, compute_irradiance
from testfield.render.path import render_path
from testfield.render.stage import build_stage
from testfield.scene.world import BOARD, Panels, TrueMarks, World

PATH_SAMPLES, PATH_REPEATS = 16, 3
CELLS, SPACING_MM, PATHS = 3, 30.0, 4096
"""What a scene has by default."""


def bench_render(world: World, tell: Callable[[str], None]) -> dict[str, Any]:
    """Compare on one world, whose camera has no blur; `tell` hears what is being done.

    Error is against the converged image (fast with finer cells and light of eight times the paths and a third of the
    spacing), so that a lighting gradient, which is physics, counts for neither side. The figure of merit is 1 / (time x
    mean squared centre error). The light is view-independent: `figure_of_merit_ratio` takes it as known, as it is from
    the second view on; `figure_of_merit_ratio_first_view` charges all of it to a single view.
    """
    stage = build_stage(world)
    tell("converged image")
    exact = compute_irradiance(stage, SPACING_MM / 3, 8 * PATHS, 99, lambda _: None)
    converged = first_moment_centres(world, render_fast(stage, exact, 0, 8).values.astype(float))

    tell("fast renderer")
    light, light_s = _timed(lambda: compute_irradiance(stage, SPACING_MM, PATHS, 1, lambda _: None))
    render_fast(stage, light, 0, CELLS)  # compiles the kernels
    images, fast_s = [], []
    for seed in range(PATH_REPEATS):
        other = compute_irradiance(stage, SPACING_MM, PATHS, 10 + seed, lambda _: None)
        image, seconds = _timed(partial(render_fast, stage, other, 0, CELLS))
        images.append(first_moment_centres(world, image.values.astype(float)))
        fast_s.append(seconds)
    tell("path tracing")
    render_path(stage, 0, 1, 1)
    paths, path_s = [], []
    for seed in range(PATH_REPEATS):
        image, seconds = _timed(partial(render_path, stage, 0, PATH_SAMPLES, 100 + seed))
        paths.append(first_moment_centres(world, image.values.astype(float)))
        path_s.append(seconds)
    fast = {"time_s": float(np.median(fast_s)), "centre_rms_px": _rms(images, converged)}
    path = {"time_s": float(np.median(path_s)), "centre_rms_px": _rms(paths, converged), "samples": PATH_SAMPLES}
    merit = {name: 1 / (side["time_s"] * side["centre_rms_px"] ** 2) for name, side in (("fast", fast), ("path", path))}
    first = 1 / ((fast["time_s"] + light_s) * fast["centre_rms_px"] ** 2)
    tell("growth with targets and pixels")
    return {
        "figure_of_merit_ratio": merit["fast"] / merit["path"],
        "figure_of_merit_ratio_first_view": first / merit["path"],
        "dots": len(converged),
        "fast": fast,
        "light_s": light_s,
        "path": path,
        **_growth(),
        "peak_memory_gb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
    }


def _timed(work: Callable[[], Any]) -> tuple[Any, float]:
    start = time.perf_counter()
    result = work()
    return result, time.perf_counter() - start


def _rms(runs: list[np.ndarray], reference: np.ndarray) -> float:
    return float(np.sqrt(np.mean([(run - reference) ** 2 for run in runs])))


def _growth() -> dict[str, Any]:
    """Seconds for one view with 1,000 targets at 12 megapixels, and the exponents of growth over a factor of 16."""
    targets = {n: _view_seconds(n, 4096, 3000) for n in (63, 250, 1000)}
    pixels = {w * h: _view_seconds(1000, w, h) for w, h in ((1024, 750), (2048, 1500), (4096, 3000))}
    return {
        "view_12_megapixels_1000_targets_s": targets[1000],
        "exponent_of_targets": _slope(targets),
        "exponent_of_pixels": _slope(pixels),
    }


def _slope(times: dict[int, float]) -> float:
    return float(np.polyfit(np.log(list(times)), np.log(list(times.values())), 1)[0])


def _view_seconds(targets: int, width_px: int, height_px: int) -> float:
    """Median of three renders of an evenly lit board that fills the image."""
    from testfield.camera.interior import Interior
    from testfield.camera.pose import Poses
    from testfield.targets.field import Field

    side = int(np.ceil(np.sqrt(targets)))
    grid = (np.arange(side) + 0.5) / side - 0.5
    xy = np.stack(np.meshgrid(grid * 1900, grid * 1400), -1).reshape(-1, 2)[:targets]
    n = len(xy)
    zero = np.zeros(n, int)
    panels = Panels(
        name=("A",),
        world_from_panel=Poses.identity(1),
        size_mm=np.array([[2000.0, 1500.0]]),
        ground_albedo=np.array([0.04]),
        ink_albedo=np.array([0.85]),
    )
    marks = TrueMarks(
        panel=zero, xy_mm=xy, diameter_mm=np.full(n, 14.0), code=zero, role=zero + BOARD, board=zero, point=np.arange(n)
    )
    focal = 1.5 * width_px
    camera = Interior(width_px, height_px, np.array([focal, focal, width_px / 2, height_px / 2, -0.1, 0.05, 0, 0, 0]))
    pose = Poses(np.diag([1.0, -1, -1])[None], np.array([[0, 0, 3000.0]]))
    world = World(
        name="growth",
        seed=1,
        field_diagonal_mm=2500.0,
        panels=panels,
        marks=marks,
        world_from_board=Poses.identity(1),
        station_name=("s",),
        camera_from_world=pose,
        interior=camera,
        psf_sigma_px=0.6,
        lights=(),
        ambient_radiance=1.0,
        field=Field(14, ()),
    )
    stage, light = build_stage(world), Irradiance.even(1, np.pi)
    render_fast(stage, light, 0, CELLS)
    return float(np.median([_timed(lambda: render_fast(stage, light, 0, CELLS))[1] for _ in range(3)]))


def blurless(world: World) -> World:
    """The world with a lens that does not blur: path tracing carries no blur."""
    return replace(world, psf_sigma_px=0.0)


def lines(figures: dict[str, Any]) -> Iterator[str]:
    """What `bench_render` found, for people."""
    yield f"figure of merit, fast over path     {figures['figure_of_merit_ratio']:,.0f}  (light known)"
    first = f"{figures['figure_of_merit_ratio_first_view']:,.0f}"
    yield f"                                    {first}  (light charged to one view)"
    for name in ("fast", "path"):
        side = figures[name]
        yield f"{name}   {side['time_s']:6.2f} s a view   centres {side['centre_rms_px']:.5f} px rms"
    yield f"{figures['dots']} dots; path with {figures['path']['samples']} samples a pixel"
    yield f"light  {figures['light_s']:6.2f} s a scene"
    yield f"12 megapixels, 1,000 targets        {figures['view_12_megapixels_1000_targets_s']:.2f} s"
    yield f"time grows as targets^{figures['exponent_of_targets']:.2f}, pixels^{figures['exponent_of_pixels']:.2f}"
    yield f"peak memory                         {figures['peak_memory_gb']:.2f} GB"
