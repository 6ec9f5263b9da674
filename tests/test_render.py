"""The fast renderer against geometry, against Mitsuba's path tracer, and against itself."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testfield.camera.pose import Poses, rotation
from testfield.camera.project import directions, project_camera
from testfield.certify.light import block_means, board_pixels
from testfield.render.camera_plugin import CameraRays
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance, compute_irradiance
from testfield.render.path import render_path
from testfield.render.psf import pixel_weights
from testfield.render.stage import Stage, build_stage
from testfield.render.variant import mitsuba
from testfield.scene.build import build_world
from testfield.scene.camera_parts import ResidualField
from testfield.scene.load import load_scene
from testfield.scene.truth import see
from testfield.scene.world import World

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
TINY = Path(__file__).parent / "torture/tiny.toml"


@pytest.fixture(scope="module")
def world() -> World:
    return build_world(load_scene(QUICK))


@pytest.fixture(scope="module")
def stage(world: World) -> Stage:
    return build_stage(world)


def even_light(world: World) -> Irradiance:
    return Irradiance.even(len(world.panels), np.pi)


LENSES = {
    "brown": {"k1": -0.09, "k2": 0.11, "p1": 3e-4, "p2": -2e-4},
    "rational": {"k1": -0.3, "k2": 0.08, "k4": -0.2, "p1": 3e-4, "s1": 1e-3, "s3": -8e-4},
    "fisheye": {"k1": 0.02, "k2": -0.01},
    "brown with a residual field": {"k1": -0.09, "residual_field": ResidualField(rms_px=0.3)},
}


@pytest.mark.parametrize("lens", LENSES)
def test_centres_of_evenly_lit_dots_are_true_to_0_0002_px_through_every_lens(lens: str) -> None:
    scene = load_scene(QUICK)
    none = dict.fromkeys(("k1", "k2", "k3", "p1", "p2"), 0.0)
    camera = scene.camera.model_copy(update=none | LENSES[lens] | {"lens": lens.split()[0]})
    true_centres(build_world(scene.model_copy(update={"camera": camera})))


def test_dots_at_the_edge_of_a_fisheye_of_190_degrees_are_true(world: World) -> None:
    true_centres(sideways(world, 85), least=30)


def true_centres(world: World, least: int = 80) -> None:
    """What is rendered of evenly lit dots of the first station has its centres of area and its areas where they are."""
    stage = build_stage(world)
    image = render_fast(stage, even_light(world), 0, 3).values.astype(float)
    views, marks = see(world), world.marks
    albedo = world.panels.ground_albedo[0], world.panels.ink_albedo[0]
    errors, areas = [], []
    for k in np.flatnonzero((marks.code == 0) & (views.visible[0] == 1)):
        x, y = np.rint(views.disc_px[0, k]).astype(int)
        h = 12
        ink = (image[y - h : y + h + 1, x - h : x + h + 1] - albedo[0]) / (albedo[1] - albedo[0])
        g = np.arange(-h, h + 1)
        ink[np.hypot(*np.meshgrid(g, g)) > h] = 0  # the neighbours
        area = ink.sum()
        errors.append(np.array([x + (ink.sum(0) @ g) / area, y + (ink.sum(1) @ g) / area]) - views.disc_px[0, k])
        areas.append(area / (np.pi / 4 * views.diameter_px[0, k] ** 2))
    assert len(errors) > least
    assert np.sqrt(np.mean(np.square(errors))) < 0.0002
    assert np.abs(errors).max() < 0.001
    assert abs(np.mean(areas) - 1) < 1e-5


def test_single_precision_moves_no_image_as_a_whole(world: World) -> None:
    """A principal point rounded to single precision alone is off by up to 1e-4 px, a rotation by as much."""
    interior = replace(world.interior, width_px=4096, height_px=3000)
    parameters = interior.parameters.copy()
    parameters[:4] = 3478.0, 3479.04, 2058.8, 1491.8
    interior = replace(interior, parameters=parameters)
    turned = Poses(rotation(np.array([[1.9, -0.4, 0.6]])), np.array([[20.0, -30.0, 3000.0]]))
    placed = replace(world, interior=interior, camera_from_world=turned)
    px = np.random.default_rng(5).integers(0, (4096, 3000), (200_000, 2)).astype(np.float32)
    mi = mitsuba()
    found = CameraRays(placed, 0).at(mi.Float(px[:, 0]), mi.Float(px[:, 1])).direction
    ray = np.array(found, float).T @ turned.R[0].T
    true = directions(interior, px.astype(float))
    error_px = 3478.0 * (ray[:, :2] / ray[:, 2:] - true[:, :2] / true[:, 2:])
    assert np.abs(error_px.mean(axis=0)).max() < 1e-5
    assert np.sqrt((error_px**2).mean()) < 1.5e-4


def sideways(world: World, angle_deg: float) -> World:
    """The same station behind a fisheye that is turned aside, and whose image is the part of a large one in
    which the boards still lie."""
    turn = rotation(np.array([0.0, np.radians(angle_deg), 0.0]))
    old, f = world.camera_from_world, world.interior.fx
    poses = Poses(turn @ old.R, np.einsum("ij,nj->ni", turn, old.t_mm))
    middle = np.array([world.interior.width_px, world.interior.height_px]) / 2 - [f * np.radians(angle_deg), 0]
    interior = replace(world.interior, parameters=np.array([f, f, *middle, 0.01, 0, 0, 0]), model="fisheye")
    return replace(world, camera_from_world=poses, interior=interior)


@pytest.mark.parametrize("angle_deg", [0, 85, 95])
def test_rays_of_a_fisheye_are_those_of_its_projection_beyond_90_degrees_too(world: World, angle_deg: float) -> None:
    mi = mitsuba()
    turned = sideways(world, angle_deg)
    x, y = (v.ravel() for v in np.meshgrid(np.linspace(0, 1279, 17), np.linspace(0, 1023, 13)))
    rays = CameraRays(turned, 0).at(mi.Float(x), mi.Float(y))
    R = turned.camera_from_world.R[0]
    d, by_x, by_y = (np.array(v).T @ R.T for v in (rays.direction, rays.by_x, rays.by_y))
    true = directions(turned.interior, np.column_stack([x, y]))
    assert (true[:, 2].min() < 0) == (angle_deg > 60)
    assert np.allclose(
        d / np.linalg.norm(d, axis=1, keepdims=True), true / np.linalg.norm(true, axis=1)[:, None], atol=4e-7
    )
    for by, step in ((by_x, [1.0, 0]), (by_y, [0, 1.0])):
        moved = project_camera(turned.interior, d + 0.01 * by) - project_camera(turned.interior, d - 0.01 * by)
        assert np.allclose(moved / 0.02, step, atol=1e-3)


def test_a_dot_in_the_very_middle_of_a_cell_is_whole() -> None:
    """A station that looks straight at a mark, an odd image and odd cells: one cell's centre is the mark's centre."""
    scene = load_scene(QUICK)
    board = scene.boards[0]
    target = np.array(board.position_mm) - 1000 * np.array([0, 1.0, 0])
    flat = board.model_copy(
        update={
            "normal": (0.0, -1.0, 0.0),
            "spin_deg": 0.0,
            "extension_zone": board.extension_zone.model_copy(
                update={"columns": 1, "rows": 1, "centre_mm": (0.0, 0.0)}
            ),
        }
    )
    station = scene.stations[0].model_validate(
        {
            "generator": "arc",
            "count": 1,
            "radius_mm": 1000,
            "height_mm": board.position_mm[2],
            "azimuth_deg": [0, 0],
            "look_at_mm": board.position_mm,
        }
    )
    plain = dict.fromkeys(("psf_sigma_px", "k1", "k2", "k3", "p1", "p2"), 0.0)
    size = {"width_px": 641, "height_px": 513, "principal_point_offset_px": (0.0, 0.0)}
    camera = scene.camera.model_copy(update=plain | size)
    changes = {"boards": (flat,), "check_targets": (), "stations": (station,), "camera": camera}
    world = build_world(scene.model_copy(update=changes))
    marks = world.marks
    centred = replace(marks, xy_mm=np.where(marks.code[:, None] == 0, 0.0, marks.xy_mm))
    exact = replace(world, marks=centred)
    assert np.allclose(exact.camera_from_world.origin_mm[0], target)
    image = render_fast(build_stage(exact), even_light(exact), 0, 3).values
    assert image[256, 320] == pytest.approx(scene.paint.white, abs=1e-6)
    assert image[256, 318:323].min() == pytest.approx(scene.paint.white, abs=1e-6)


def test_half_a_pixel_of_convention_would_be_seen(world: World, stage: Stage) -> None:
    """The same test as above, of an image whose pixels are half a pixel elsewhere, must fail it."""
    shifted = replace(world, interior=world.interior.with_parameters(world.interior.parameters + np.eye(9)[2] * 0.5))
    image = render_fast(replace(stage, world=shifted), even_light(world), 0, 3).values.astype(float)
    views, marks = see(world), world.marks
    k = np.flatnonzero((marks.code == 0) & (views.visible[0] == 1))[0]
    x, y = np.rint(views.disc_px[0, k]).astype(int)
    ink = image[y - 9 : y + 10, x - 9 : x + 10] - image[y - 9 : y + 10, x - 9 : x + 10].min()
    error = x + ink.sum(0) @ np.arange(-9, 10) / ink.sum() - views.disc_px[0, k, 0]
    assert error == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("pictures", [5, pytest.param(16, marks=pytest.mark.slow)])
def test_fast_and_path_agree_within_the_noise(world: World, pictures: int) -> None:
    plain = replace(boards_alone(world), psf_sigma_px=0.0)
    stage = build_stage(plain)
    light = compute_irradiance(stage, 60.0, 2048, 5, lambda _: None)
    fast = render_fast(stage, light, 1, 8).values.astype(float)
    runs = np.stack([render_path(stage, 1, 64, 100 + k).values.astype(float) for k in range(pictures)])
    mean, u = runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    boards = board_pixels(plain, 1)
    # Over blocks of 8 x 8 pixels, so that a small systematic difference cannot hide in the noise of single pixels.
    difference, spread = block_means(fast - mean, boards), block_means(u**2, boards)
    z = difference / np.sqrt(spread / 64)
    assert len(z) > 80
    assert np.sqrt((z**2).mean()) < 1.35
    assert abs((fast - mean)[boards].mean()) < 2e-3 * mean[boards].mean()


def boards_alone(world: World) -> World:
    """The second station at a quarter of the size, and of its image the columns with boards in them."""
    first, columns = 104, 120
    parameters = world.interior.parameters * ([0.25] * 4 + [1] * 5) - first * np.eye(9)[2]
    return replace(world, interior=replace(world.interior, width_px=columns, height_px=256, parameters=parameters))


def test_pixel_weights_have_the_width_of_pixel_and_blur() -> None:
    for cells in (2, 3, 8):
        weights, margin = pixel_weights(cells, 0.6)
        x = (np.arange(len(weights)) + 0.5) / cells - 0.5 - margin
        assert weights.sum() == pytest.approx(1)
        # The cells' own area is part of the whole width.
        assert weights @ x**2 + 1 / (12 * cells**2) == pytest.approx(0.6**2 + 1 / 12, rel=2e-3)


def test_same_bytes_with_one_and_two_threads_and_twice_in_a_row(tmp_path: Path) -> None:
    script = (
        "import sys, hashlib; from pathlib import Path\n"
        "from testfield.render.variant import mitsuba; mitsuba()\n"
        "import drjit as dr; dr.set_thread_count(int(sys.argv[1]))\n"
        "from testfield.scene.build import build_world; from testfield.scene.load import load_scene\n"
        "from testfield.render.stage import build_stage; from testfield.render.fast import render_fast\n"
        "from testfield.render.irradiance import compute_irradiance\n"
        f"s = build_stage(build_world(load_scene(Path({str(TINY)!r}))))\n"
        "light = compute_irradiance(s, 200.0, 64, 1, lambda _: None)\n"
        "for _ in range(2):\n"
        "    seen = light.values.tobytes() + render_fast(s, light, 2, 2).values.tobytes()\n"
        "    print(hashlib.sha256(seen).hexdigest())\n"
    )
    made = [
        subprocess.run([sys.executable, "-c", script, threads], check=True, capture_output=True, text=True).stdout
        for threads in ("1", "2")
    ]
    digests = " ".join(made).split()
    assert len(digests) == 4 and len(set(digests)) == 1


def test_an_llvm_that_would_abort_is_never_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from testfield.errors import TestfieldError
    from testfield.render import llvm

    old, new = tmp_path / "libLLVM-15.so", tmp_path / "libLLVM-19.so"
    old.touch(), new.touch()
    monkeypatch.setattr(llvm, "PLACES", (str(tmp_path / "libLLVM*.so*"),))
    monkeypatch.setattr(llvm, "version_of", lambda path: 15 if "15" in path.name else 19)
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(old))
    assert llvm.usable_library() == new
    new.unlink()
    assert llvm.usable_library() is None
    with pytest.raises(TestfieldError, match="apt-get install libllvm19"):
        llvm.require_library()


def test_a_file_that_is_no_library_has_no_version(tmp_path: Path) -> None:
    from testfield.render.llvm import version_of

    fake = tmp_path / "libLLVM-19.so"
    fake.write_bytes(b"not a library")
    assert version_of(fake) == 0
