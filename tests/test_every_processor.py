"""The renderer is the same on every machine, and what goes wrong in a kernel stops the run."""

import os
import platform
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testfield.camera.images import Radiance
from testfield.camera.motion import Twist
from testfield.errors import TestfieldError
from testfield.render import fetch, jit_core
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.llvm import usable_library
from testfield.render.lookup import bin_of, cell_of
from testfield.render.stage import build_stage
from testfield.render.variant import mitsuba
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.world import PointLight

TESTS = Path(__file__).parent
KINDS = "dots", "bent", "dirt", "charuco", "checkerboard", "aruco", "apriltag", "circles", "acircles"
INKS = "gloss", "retro", "luminous"
LESSER = "x86-64-v2", "x86-64-v3"
FLOAT32 = 1e-5
"""Relative difference that roundings of float32 leave after a few hundred operations. Measured: 3e-7 on matt prints,
3e-6 where a coat's reflections are sampled, 6e-6 where narrow retro-reflection is path traced."""

on_x86 = pytest.mark.skipif(
    platform.machine() not in ("x86_64", "AMD64") or usable_library() is None, reason="LLVM on x86-64 alone"
)


def environment(**more: str) -> dict[str, str]:
    """This process' environment for a child that renders on the processor's own terms, unless `more` says otherwise."""
    return (
        {k: v for k, v in os.environ.items() if k != jit_core.VARIABLE} | {"TESTFIELD_VARIANT": "llvm_ad_mono"} | more
    )


def rendered(out: Path, *kinds: str, **more: str) -> dict[str, np.ndarray]:
    command = [sys.executable, str(TESTS / "prints_in_the_void.py"), str(out), *kinds]
    done = subprocess.run(command, env=environment(**more), capture_output=True, text=True)
    assert done.returncode == 0, (done.returncode, done.stderr[-2000:])
    with np.load(out) as data:
        return dict(data)


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> dict[str, np.ndarray]:
    """Every kind of print, rendered for this processor with all look-ups checked."""
    return rendered(tmp_path_factory.mktemp("own") / "own.npz", "all", "stickers", *INKS, CHECK_BOUNDS="1")


def assert_alike(images: dict[str, np.ndarray], others: dict[str, np.ndarray]) -> None:
    for name in others.keys() - {"width"}:
        image, other = images[name].astype(float), others[name].astype(float)
        assert np.isfinite(other).all()
        difference = np.abs(image - other) / np.maximum(np.abs(image), 1e-3 * image.max())
        assert difference.max() < FLOAT32, name


@on_x86
def test_no_look_up_of_a_ray_that_misses_lies_outside_its_table(own: dict[str, np.ndarray]) -> None:
    for name in own.keys() - {"width"}:
        # There are misses, where it is dark, and hits.
        assert 0.2 < (own[name] == 0).mean() < 0.95, name


@on_x86
@pytest.mark.parametrize("target", LESSER)
def test_kernels_for_lesser_processors_give_the_same_radiance(
    target: str, own: dict[str, np.ndarray], tmp_path: Path
) -> None:
    others = rendered(tmp_path / "other.npz", "all", TESTFIELD_LLVM_TARGET=target)
    assert others["width"] == jit_core.TARGETS[target].width
    assert_alike(own, others)


@pytest.mark.slow
@on_x86
@pytest.mark.parametrize("target", LESSER)
def test_each_print_alone_in_each_light_is_the_same_on_lesser_processors(target: str, tmp_path: Path) -> None:
    kinds = [f"{kind}!" for kind in (*KINDS, "stickers", *INKS)]
    own = rendered(tmp_path / "own.npz", *kinds)
    others = rendered(tmp_path / "other.npz", *kinds, TESTFIELD_LLVM_TARGET=target)
    assert_alike(own, others)


@pytest.mark.slow
@on_x86
@pytest.mark.parametrize("target", LESSER)
def test_geometry_is_certified_on_lesser_processors(target: str) -> None:
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", str(TESTS / "test_certify_geometry.py")]
    done = subprocess.run(command, env=environment(TESTFIELD_LLVM_TARGET=target), capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-2000:]


@on_x86
@pytest.mark.parametrize(
    ("variable", "wrong", "right"),
    [(jit_core.VARIABLE, "x86-64-v7", "x86-64-v3"), ("TESTFIELD_VARIANT", "llvm_ad_rgb", "llvm_ad_mono")],
)
def test_a_target_or_variant_that_does_not_exist_is_named(variable: str, wrong: str, right: str) -> None:
    code = "from testfield.render.variant import mitsuba; mitsuba()"
    more = environment(**{variable: wrong})
    done = subprocess.run([sys.executable, "-c", code], env=more, capture_output=True, text=True)
    said = done.stderr.splitlines()[-1]
    assert done.returncode == 1
    assert all(name in said for name in ("TestfieldError", variable, wrong, right))


def test_a_target_that_the_processor_cannot_run_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jit_core, "llvm_features", lambda: "+sse4.2,-avx2,+fma,+bmi2,+f16c")
    with pytest.raises(TestfieldError, match="avx2"):
        jit_core.set_llvm_target("x86-64-v3")


def test_a_processor_without_fused_arithmetic_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    mitsuba()
    jit_core.require_fused_arithmetic()
    monkeypatch.setattr(jit_core, "llvm_features", lambda: "+sse2,+avx,-fma,-fma4")
    with pytest.raises(TestfieldError, match="FMA"):
        jit_core.require_fused_arithmetic()


def test_what_is_not_a_number_has_the_first_place_and_what_lies_outside_the_nearest() -> None:
    mi = mitsuba()
    wild = mi.Float([float("nan"), -float("inf"), -1e30, -0.5, 0.0, 2.9, 4.0, 5.0, 7e9, float("inf")])
    assert fetch.fetch(bin_of(wild, 5)).tolist() == [0, 0, 0, 0, 0, 2, 4, 4, 4, 4]
    assert fetch.fetch(bin_of(wild, mi.UInt32(5))).tolist() == [0, 0, 0, 0, 0, 2, 4, 4, 4, 4]
    cell, where = (fetch.fetch(values) for values in cell_of(wild, mi.UInt32(5)))
    assert cell.tolist() == [0, 0, 0, 0, 0, 2, 3, 3, 3, 3]
    assert where == pytest.approx([0, 0, 0, 0, 0, 0.9, 1, 1, 1, 1], abs=1e-6)


def test_what_dr_jit_complains_of_stops_a_run() -> None:
    mi = mitsuba()
    import drjit as dr

    with dr.scoped_set_flag(dr.JitFlag.Debug, True):
        outside = dr.gather(mi.Float, mi.Float([1.0, 2.0, 3.0]), mi.UInt32([0, 5, 2]))
        with pytest.raises(TestfieldError, match="array of size 3"):
            fetch.fetch(outside)
    # The complaint is told once, and messages about speed stop nothing.
    fetch._hear(fetch.WARNING, b"jit_flush_malloc_cache(): this is an expensive operation")
    assert fetch.fetch(mi.Float([1.0])) == [1.0]
    fetch._hear(
        fetch.WARNING, b"jit_eval(): Disabling this ray tracing operation to avoid potential undefined behavior."
    )
    with pytest.raises(TestfieldError, match="ray tracing"):
        fetch.fetch(mi.Float([1.0]))


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_radiance_that_is_no_number_stops_a_run_by_station_and_pixel(value: float, tmp_path: Path) -> None:
    values = np.ones((4, 6), np.float32)
    image = Radiance("station07", values)
    values[2, 5] = value
    with pytest.raises(TestfieldError, match=r"station07.*x = 5, y = 2"):
        Radiance("station07", values)
    image.save(tmp_path / "view.exr")  # the array is the damaged one by now
    with pytest.raises(TestfieldError, match=r"view\.exr.*station07.*x = 5, y = 2"):
        Radiance.load(tmp_path / "view.exr")


def scenes_traced(code: str) -> int:
    """Different scenes in which a kernel's LLVM code traces: the second argument of each call, by its register."""
    calls = re.findall(r"call void %\w+\(ptr %\w+_in_0_1, ptr (%\w+), ptr %\w+_in_ctx_1,", code)
    assert len(calls) == code.count("- Ray t")
    return len(set(calls))


def test_no_kernel_traces_in_two_scenes() -> None:
    """On a GPU such a kernel's rays miss. A moving target has the most scenes: what rests, what moves, and shadows."""
    mi = mitsuba()
    import drjit as dr

    if not mi.variant().startswith("llvm"):
        pytest.skip("counts in LLVM's code")
    world = build_world(load_scene(TESTS.parent / "scenes/quick.toml"))
    small = replace(
        world.interior, width_px=80, height_px=64, parameters=world.interior.parameters * ([1 / 16] * 4 + [1] * 5)
    )
    motion = replace(world.motion, target=Twist((50.0, 0.0, 0.0)), exposure_s=0.02, row_s=1e-5)
    world = replace(world, interior=small, motion=motion, point_lights=(PointLight((0.0, 0.0, 4000.0), 5.0),))
    stage = build_stage(world)

    def counts() -> list[int]:
        kernels = dr.kernel_history()
        dr.kernel_history_clear()
        return [scenes_traced(kernel["ir"].getvalue()) for kernel in kernels if "ir" in kernel]

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        render_fast(stage, Irradiance.even(len(world.panels), 3.0), 0, 2, blur_shots=2)
        found = counts()
        ray = mi.Ray3f(mi.Point3f(0, 0, mi.Float([4000.0, 5000.0])), mi.Vector3f(0, 0, -1))
        dr.eval(stage.still.ray_test(ray) & stage.moving.ray_test(ray))
        assert counts() == [2]  # the fault would be seen
    assert max(found) == 1
    assert found.count(1) >= 3
