"""Materials and lights: closed forms, and the fast renderer against Mitsuba's path tracer with the same material."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import IN_FULL

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.errors import TestfieldError
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.path import render_path
from testfield.render.stage import build_stage
from testfield.render.view import FAST, FAST_SAMPLED, PATH_SAMPLED, render_view, white_radiance
from testfield.scene.build import build_world
from testfield.scene.check import check_scene
from testfield.scene.check_camera import retro_reflectance
from testfield.scene.load import load_scene, parse_scene
from testfield.scene.room_parts import GradientPart, MapPart
from testfield.scene.sky import sky_of
from testfield.scene.truth import see
from testfield.scene.world import (
    GLOSS,
    LUMINOUS,
    RETRO,
    Dirt,
    Gloss,
    Panels,
    PointLight,
    Retro,
    RingFlash,
    Sky,
    TrueMarks,
    World,
)
from testfield.targets.field import Field

SCENES = Path(__file__).parents[1] / "scenes"
QUICK = IN_FULL.read_text()
D_MM, GROUND, INK, RADIUS_MM = 2000.0, 0.1, 0.6, 60.0
SIZE_PX, FOCAL_PX = 65, 400.0
RETRO_INK = Retro(300.0, float(np.radians(45)), float(np.radians(0.8)))


def world_of(ink: int = 0, tilt_deg: float = 0.0, **more: object) -> World:
    """One dot of 120 mm in the middle of a board two metres before the camera, tilted about its x axis; no light."""
    a = np.radians(tilt_deg)
    R = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    panels = Panels(
        name=("A",),
        world_from_panel=Poses(R[None], np.zeros((1, 3))),
        size_mm=np.array([[900.0, 900.0]]),
        ground_albedo=np.array([GROUND]),
        ink_albedo=np.array([INK]),
        ink=np.array([ink]),
    )
    zero = np.zeros(1, int)
    marks = TrueMarks(
        panel=zero,
        xy_mm=np.zeros((1, 2)),
        diameter_mm=np.array([2 * RADIUS_MM]),
        code=zero,
        role=zero,
        board=zero,
        point=zero,
    )
    middle = (SIZE_PX - 1) / 2
    camera = Interior(SIZE_PX, SIZE_PX, np.array([FOCAL_PX, FOCAL_PX, middle, middle, 0, 0, 0, 0, 0]))
    pose = Poses(np.diag([1.0, -1, -1])[None], np.array([[0, 0, D_MM]]))
    plain = World(
        name="one dot",
        seed=1,
        field_diagonal_mm=1.0,
        panels=panels,
        marks=marks,
        world_from_board=Poses.identity(1),
        station_name=("s",),
        camera_from_world=pose,
        interior=camera,
        psf_sigma_px=0.0,
        lights=(),
        ambient_radiance=0.0,
        field=Field(14, ()),
    )
    return replace(plain, **more)  # type: ignore[arg-type]


def fast(world: World) -> np.ndarray:
    return render_fast(build_stage(world), Irradiance.even(1, 0.0), 0, 3).values.astype(float)


MIDDLE = (SIZE_PX // 2, SIZE_PX // 2)
BESIDE = (SIZE_PX // 2, 8)


def agree(world: World, samples: int = 256) -> tuple[np.ndarray, np.ndarray]:
    """Means over 5 x 5 blocks: fast minus path in sigmas, and the ratio of the two images' means."""
    stage = build_stage(world)
    runs = np.stack([render_path(stage, 0, samples // 8, 40 + k).values.astype(float) for k in range(8)])
    image = render_view(stage, Irradiance.even(1, 0.0), 0, 8, 0.002, 2048, 3)[0].values.astype(float)

    def blocks(a: np.ndarray) -> np.ndarray:
        return a.reshape(*a.shape[:-2], 13, 5, 13, 5).mean(axis=(-3, -1))

    spread = blocks(runs).std(axis=0, ddof=1) / np.sqrt(8)
    difference = blocks(image) - blocks(runs).mean(axis=0)
    floor = 2e-3 * image.max()  # of what a coat's sampling leaves
    return difference / np.hypot(spread, floor), image.mean() / runs.mean()


def test_a_point_light_is_the_inverse_square_law_and_the_cosine() -> None:
    light = PointLight(np.array([500.0, 200.0, 1500.0]), 7.0)
    image = fast(world_of(point_lights=(light,)))
    d2 = (light.position_mm**2).sum() * 1e-6
    irradiance = 7.0 / d2 * 1.5 / np.sqrt(d2)
    assert image[MIDDLE] == pytest.approx(INK * irradiance / np.pi, rel=1e-3)


def test_a_point_lights_shadow_is_as_sharp_as_a_cell_and_where_geometry_puts_it() -> None:
    """A half plane at half the light's height, over x > 50 mm; the light stands over x = 150 mm, so the shadow begins
    at x = -50 mm, which is the middle of pixel 22. The half plane itself hides the board from x = 67 mm on only."""
    plain = world_of(point_lights=(PointLight(np.array([150.0, 0.0, 1000.0]), 5.0),))
    p = plain.panels
    screen = Poses(np.eye(3)[None], np.array([[450.0, 0.0, 500.0]]))
    panels = Panels(
        name=("A", "screen"),
        world_from_panel=Poses.join([p.world_from_panel, screen]),
        size_mm=np.array([[900.0, 900.0], [800.0, 900.0]]),
        ground_albedo=np.array([GROUND, 0.0]),
        ink_albedo=np.array([INK, 0.0]),
    )
    shaded = render_fast(build_stage(replace(plain, panels=panels)), Irradiance.even(2, 0.0), 0, 8).values
    share = shaded[8] / render_fast(build_stage(plain), Irradiance.even(1, 0.0), 0, 8).values[8]
    assert share[:22] == pytest.approx(np.ones(22), abs=1e-3)
    assert share[22] == pytest.approx(0.5, abs=1 / 16)  # eight cells a pixel
    assert (share[23:] == 0).all()


def test_the_flash_on_axis_is_intensity_over_distance_squared() -> None:
    flash = RingFlash(40.0, 16, 12.0, 3.0)
    image = fast(world_of(flash=flash))
    d2 = (D_MM**2 + 40.0**2) * 1e-6
    cosine = D_MM / np.sqrt(D_MM**2 + 40.0**2)
    expected = 12.0 / d2 * cosine ** (3 + 1)
    assert image[MIDDLE] == pytest.approx(INK * expected / np.pi, rel=1e-4)


def test_the_flash_travels_with_the_camera() -> None:
    flash = RingFlash(40.0, 5, 1.0, 1.0)
    R = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])[None]
    pose = Poses(R, np.array([[10.0, 20.0, 30.0]]))
    in_camera = flash.places_mm(pose, 0) @ R[0].T + pose.t_mm[0]
    assert np.allclose(in_camera[:, 2], 0)
    assert np.allclose(np.hypot(in_camera[:, 0], in_camera[:, 1]), 40.0)


@pytest.mark.parametrize("tilt_deg", [0.0, 35.0])
def test_retro_reflected_radiance_is_the_coefficient_times_irradiance_over_the_cosine(tilt_deg: float) -> None:
    flash = RingFlash(28.0, 16, 2.0, 0.0)
    image = fast(world_of(RETRO, tilt_deg, flash=flash, retro=RETRO_INK))
    square_on = 2.0 / ((D_MM**2 + 28.0**2) * 1e-6)
    observation = np.degrees(np.arctan2(28.0, D_MM))
    coefficient = 300.0 * 2 ** -((observation / 0.8) ** 2) * 2 ** -((tilt_deg / 45.0) ** 4)
    cosine = np.cos(np.radians(tilt_deg))
    expected = coefficient * square_on / cosine + INK * square_on * cosine / np.pi
    assert image[MIDDLE] == pytest.approx(expected, rel=5e-3)
    assert image[BESIDE] < 0.01 * image[MIDDLE]


def test_what_retro_reflects_moves_towards_the_viewer_and_the_truth_does_not() -> None:
    flash, shift_mm = RingFlash(28.0, 16, 2.0, 0.0), 20.0
    tilted = world_of(RETRO, 30.0, flash=flash, retro=RETRO_INK)
    moved = replace(tilted, retro=replace(RETRO_INK, shift_mm=shift_mm))
    rows = np.arange(SIZE_PX)

    def centre(image: np.ndarray) -> float:
        image = np.where(image > 0.1 * image.max(), image, 0)
        return float(image.sum(axis=1) @ rows / image.sum())

    # The board's upper edge leans towards the camera: its y axis has this part towards it, and this part across.
    expected = -shift_mm * np.sin(np.radians(30)) * np.cos(np.radians(30)) * FOCAL_PX / D_MM
    assert centre(fast(moved)) - centre(fast(tilted)) == pytest.approx(expected, rel=0.05)
    assert np.array_equal(see(moved).disc_px, see(tilted).disc_px)


def test_luminous_ink_has_its_radiance() -> None:
    image = fast(world_of(LUMINOUS, luminous_radiance=2.5))
    assert image[MIDDLE] == pytest.approx(2.5, rel=1e-5)
    assert image[BESIDE] == 0
    area_px = image.sum() / 2.5
    assert area_px == pytest.approx(np.pi * (RADIUS_MM * FOCAL_PX / D_MM) ** 2, rel=1e-4)


def test_a_coat_adds_its_ggx_reflection_of_a_point_light() -> None:
    gloss = Gloss(0.3, 0.04)
    light = PointLight(np.array([300.0, 0.0, 1900.0]), 5.0)
    world = world_of(GLOSS, gloss=gloss, point_lights=(light,))
    matt = fast(world_of(point_lights=(light,)))
    d = np.linalg.norm(light.position_mm)
    to_light, to_eye = light.position_mm / d, np.array([0.0, 0, 1])
    m = (to_light + to_eye) / np.linalg.norm(to_light + to_eye)
    a2 = 0.3**2
    density = a2 / (np.pi * (m[2] ** 2 * (a2 - 1) + 1) ** 2)
    shadow = 2 / (1 + np.sqrt(1 + a2 * (1 / to_light[2] ** 2 - 1)))
    fresnel = 0.04 + 0.96 * (1 - m @ to_eye) ** 5
    expected = fresnel * density * shadow / 4 * 5.0 / (d / 1000) ** 2
    assert fast(world)[MIDDLE] - matt[MIDDLE] == pytest.approx(expected, rel=2e-3)


CARRIED = {
    "point light": world_of(point_lights=(PointLight(np.array([500.0, 200.0, 1500.0]), 7.0),)),
    "flash on retro-reflecting ink": world_of(
        RETRO, 25.0, flash=RingFlash(28.0, 16, 2.0, 1.0), retro=replace(RETRO_INK, shift_mm=15.0)
    ),
    "retro-reflecting ink in even light": world_of(RETRO, 25.0, ambient_radiance=1.0, retro=RETRO_INK),
    "luminous ink": world_of(LUMINOUS, 25.0, luminous_radiance=2.5),
    "gloss under a flash and a point light": world_of(
        GLOSS,
        10.0,
        flash=RingFlash(28.0, 16, 2.0, 1.0),
        gloss=Gloss(0.3, 0.05),
        psf_sigma_px=0.0,
        point_lights=(PointLight(np.array([300.0, 300.0, 1800.0]), 5.0),),
    ),
}


@pytest.mark.parametrize("name", CARRIED)
def test_fast_is_path(name: str) -> None:
    world = CARRIED[name]
    if world.ambient_radiance:
        stage = build_stage(world)
        light = Irradiance.even(1, np.pi * world.ambient_radiance)
        image = render_fast(stage, light, 0, 8).values.astype(float)
        runs = render_path(stage, 0, 256, 3).values.astype(float)
        assert image.mean() == pytest.approx(runs.mean(), rel=5e-3)
        assert image[MIDDLE] == pytest.approx(runs[28:37, 28:37].mean(), rel=1e-2)
        return
    z, ratio = agree(world)
    assert np.sqrt((z**2).mean()) < 1.6
    assert ratio == pytest.approx(1, abs=5e-3)


def test_gloss_in_even_light_is_sampled_to_its_target_and_is_path() -> None:
    world = world_of(GLOSS, 20.0, ambient_radiance=1.0, gloss=Gloss(0.3, 0.2))
    stage, light = build_stage(world), Irradiance.even(1, np.pi)
    image, making = render_view(stage, light, 0, 3, 0.003, 4096, 3)
    assert making.mode == FAST_SAMPLED
    assert 0 < making.noise <= 0.003
    assert making.over_target == 0
    traced = render_path(stage, 0, 256, 3).values
    assert image.values.mean() == pytest.approx(traced.mean(), rel=3e-3)
    matt = render_fast(stage, light, 0, 3).values
    assert image.values.mean() > 1.1 * matt.mean()


def test_the_stated_noise_is_the_noise() -> None:
    world = world_of(GLOSS, 20.0, point_lights=(), ambient_radiance=0.0, gloss=Gloss(0.3, 0.2))
    up = np.linspace(2, 0, 65)[:, None] * np.ones((1, 8))
    stage = build_stage(replace(world, sky=Sky(up.astype(np.float32))))
    light = Irradiance.even(1, np.pi)
    made = [render_view(stage, light, 0, 2, 0.02, 4096, 1000 * k) for k in range(4)]
    images = np.stack([image.values for image, _ in made]).astype(float)
    white = white_radiance(stage, 0, render_fast(stage, light, 0, 2).values)
    scatter = np.sqrt(images.var(axis=0, ddof=1).mean()) / white
    assert scatter == pytest.approx(made[0][1].noise, rel=0.25)


def test_a_mirror_like_coat_is_path_traced_to_the_target_and_matt_is_fast() -> None:
    smooth = world_of(GLOSS, 20.0, ambient_radiance=1.0, gloss=Gloss(0.03, 0.2))
    _, making = render_view(build_stage(smooth), Irradiance.even(1, np.pi), 0, 2, 0.01, 2048, 3)
    assert making.mode == PATH_SAMPLED
    assert making.noise <= 0.01
    matt = world_of(ambient_radiance=1.0)
    assert render_view(build_stage(matt), Irradiance.even(1, np.pi), 0, 2, 0.01, 64, 3)[1].mode == FAST


@pytest.mark.parametrize("factor", [0.97, 1.03])
def test_a_factor_of_three_hundredths_would_be_seen(factor: float) -> None:
    """The comparison of fast and path must fail for a flash that is a little brighter in one of them."""
    world = CARRIED["flash on retro-reflecting ink"]
    assert world.retro is not None
    other = replace(world, retro=replace(world.retro, coefficient=factor * world.retro.coefficient))
    image = fast(other)
    traced = render_path(build_stage(world), 0, 256, 3).values.astype(float)
    assert abs(image.mean() / traced.mean() - 1) > 0.02


def test_a_gradient_leads_from_zenith_by_the_horizon_to_the_ground(tmp_path: Path) -> None:
    sky = sky_of(GradientPart(kind="gradient", zenith_w_m2_sr=3, horizon_w_m2_sr=1, ground_w_m2_sr=0.5), "x")
    assert sky.radiance[0, 0] == 3
    assert sky.radiance[len(sky.radiance) // 2, 0] == pytest.approx(1)
    assert sky.radiance[-1, 0] == 0.5
    # A camera without a board before it looks straight at it: down the world's -z, at the ground.
    image = fast(replace(world_of(sky=sky), panels=replace(world_of().panels, size_mm=np.array([[130.0, 130.0]]))))
    assert image[0, 0] == pytest.approx(0.5, rel=2e-2)


def test_a_map_shows_its_middle_along_y_and_turns_counter_clockwise(tmp_path: Path) -> None:
    import cv2

    picture = np.zeros((33, 64), np.uint8)
    picture[:, 28:36] = 255
    cv2.imwrite(str(tmp_path / "sky.png"), picture)
    base = world_of()
    look = np.array([[[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]])  # along +y
    for azimuth, bright in ((0.0, True), (90.0, False)):
        sky = sky_of(MapPart(kind="map", file=str(tmp_path / "sky.png"), azimuth_deg=azimuth, scale_w_m2_sr=2), "x")
        image = fast(replace(base, sky=sky, camera_from_world=Poses(look, np.array([[0.0, 0, -3000]]))))
        assert image[MIDDLE] == pytest.approx(2.0 if bright else 0.0, abs=1e-3)


def test_an_environment_that_is_no_picture_is_named(tmp_path: Path) -> None:
    (tmp_path / "sky.png").write_text("no picture")
    for name in ("sky.png", "none.exr"):
        with pytest.raises(TestfieldError, match=f"room.environment.file.*{name}"):
            sky_of(MapPart(kind="map", file=str(tmp_path / name)), "room.environment")


BAD = {
    "point without power": (
        (
            "[[room.lights]]",
            '[[room.lights]]\nkind = "point"\nposition_mm = [0, 0, 1]\nintensity_w_sr = 0\n\n[[room.lights]]',
        ),
        "room.lights.0..intensity_w_sr: value 0",
    ),
    "flash without power": (
        ("psf_sigma_px = 0.6", "psf_sigma_px = 0.6\nflash = { radiant_intensity_w_sr = 0.0 }"),
        "camera.flash.radiant_intensity_w_sr: value 0.0",
    ),
    "environment without power": (
        (
            "ambient_w_m2_sr = 0.6",
            'environment = { kind = "gradient", zenith_w_m2_sr = 0, horizon_w_m2_sr = 0, ground_w_m2_sr = 0 }',
        ),
        "room.environment.*without any radiance",
    ),
    "two environments": (
        (
            "ambient_w_m2_sr = 0.6",
            "ambient_w_m2_sr = 0.6\n"
            'environment = { kind = "gradient", zenith_w_m2_sr = 1, horizon_w_m2_sr = 0, ground_w_m2_sr = 0 }',
        ),
        "ambient_w_m2_sr = 0.6",
    ),
    "black retro ink": (("[render]", '[paint]\nink = "retro"\nwhite_on_black = false\n\n[render]'), "paint.ink"),
    "more light than falls on it": (
        ("[render]", '[paint]\nink = "retro"\nretro = { coefficient_cd_lx_m2 = 900 }\n\n[render]'),
        "coefficient_cd_lx_m2: value 900",
    ),
    "gloss on what moves": (
        ("[render]", '[target_motion]\nvelocity_mm_s = [1, 0, 0]\n\n[paint]\nink = "gloss"\n\n[render]'),
        "paint.ink: glossy ink cannot be rendered together with a target that moves",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_impossible_paint_and_light_are_refused_with_field_and_value(name: str) -> None:
    (old, new), words = BAD[name]
    with pytest.raises(TestfieldError, match=words):
        scene = parse_scene(QUICK.replace(old, new, 1), "bad.toml")
        world = build_world(scene)
        check_scene(scene, world, see(world), "bad.toml")


def test_a_flash_alone_is_light_enough_and_without_one_retro_ink_is_warned_of() -> None:
    room = QUICK[QUICK.index("[[room.lights]]") : QUICK.index("[[boards]]")]
    dark = QUICK.replace(room, "").replace("ambient_w_m2_sr = 0.6", "ambient_w_m2_sr = 0")

    def checked(text: str) -> list[str]:
        scene = parse_scene(text, "s.toml")
        world = build_world(scene)
        return check_scene(scene, world, see(world), "s.toml")

    with pytest.raises(TestfieldError, match="no light"):
        checked(dark)
    checked(dark.replace("psf_sigma_px = 0.6", "psf_sigma_px = 0.6\nflash = { radiant_intensity_w_sr = 1.0 }"))
    assert any("retro" in w for w in checked(QUICK.replace("[render]", '[paint]\nink = "retro"\n\n[render]')))


def test_the_retro_lobe_integrates_to_what_the_check_says() -> None:
    angle = np.linspace(0, np.radians(10), 200001)
    lobe = 300 * 2 ** -((np.degrees(angle) / 0.8) ** 2)
    assert retro_reflectance(300, 0.8) == pytest.approx(np.trapezoid(lobe * 2 * np.pi * np.sin(angle), angle), rel=1e-3)


def test_a_board_can_have_an_ink_of_its_own() -> None:
    world = build_world(parse_scene(QUICK.replace('name = "B"', 'name = "B"\nink = "luminous"'), "s.toml"))
    assert world.panels.ink is not None
    assert [world.panels.name[k] for k in np.flatnonzero(world.panels.ink)] == ["B"]
    assert world.luminous_radiance == 1.0
    assert build_world(load_scene(SCENES / "quick.toml")).panels.ink is None


def test_dirt_covers_retro_reflecting_ink_as_it_covers_any() -> None:
    flash = RingFlash(28.0, 16, 2.0, 0.0)
    clean = world_of(RETRO, flash=flash, retro=RETRO_INK)
    spot = Dirt(np.zeros(1, int), np.zeros((1, 2)), np.array([2 * RADIUS_MM]), np.array([0.3]))
    dirty = replace(clean, dirt=spot)
    assert fast(clean)[MIDDLE] > 10
    square_on = 2.0 / ((D_MM**2 + 28.0**2) * 1e-6)
    assert fast(dirty)[MIDDLE] == pytest.approx(0.3 * square_on / np.pi, rel=5e-3)
