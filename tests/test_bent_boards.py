"""Boards that are bent: the true geometry follows, the renderers follow it, and the nominal does not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import IN_FULL

from testfield.calibrate.stitched import stitched
from testfield.camera.circle import disc_image
from testfield.camera.project import directions
from testfield.certify.light import block_means, board_pixels
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.render.camera_plugin import CameraRays
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance, compute_irradiance
from testfield.render.path import render_path
from testfield.render.stage import build_stage
from testfield.render.variant import mitsuba
from testfield.scene import bend, truth
from testfield.scene.build import build_world
from testfield.scene.load import load_scene, parse_scene
from testfield.scene.schema import SceneFile
from testfield.scene.truth import Views, hidden, see
from testfield.scene.world import World

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
BOWS = ((12.0, 90.0), (-9.0, 0.0), (-30.0, 125.0))
"""Bow in mm and axis in degrees of the quick scene's three boards."""


def with_bows(bows: tuple[tuple[float, float], ...]) -> SceneFile:
    scene = load_scene(QUICK)
    boards = tuple(
        board.model_copy(update={"bow_mm": bow, "bow_axis_deg": axis})
        for board, (bow, axis) in zip(scene.boards, bows, strict=True)
    )
    return scene.model_copy(update={"boards": boards})


@pytest.fixture(scope="module")
def world() -> World:
    return build_world(with_bows(BOWS))


def flattened(world: World) -> World:
    return replace(world, panels=replace(world.panels, curvature_per_mm=None))


SHEET = np.array([[-300.0, 200.0], [0, 0], [17.0, -88.0], [350.0, 250.0], [120.0, 0.0]])


@pytest.mark.parametrize("curvature", [0.0, 1 / 900, -1 / 5000, 1e-9])
def test_a_bent_sheet_keeps_its_lengths_and_its_middle(curvature: float) -> None:
    curve = np.full(len(SHEET), curvature), np.full(len(SHEET), 0.7)
    frame, step = bend.frames(SHEET, *curve), 1e-3
    for axis in (0, 1):
        shift = step * np.eye(2)[axis]
        slope = (bend.to_space(SHEET + shift, *curve) - bend.to_space(SHEET - shift, *curve)) / (2 * step)
        assert np.allclose(slope, frame[:, :, axis], atol=1e-8)
    assert np.allclose(np.swapaxes(frame, 1, 2) @ frame, np.eye(3), atol=1e-14)
    assert np.allclose(np.linalg.det(frame), 1)
    assert np.array_equal(bend.to_space(SHEET, *curve)[1], np.zeros(3))
    there_and_back = bend.to_paper(bend.to_space(SHEET, *curve) + 5 * frame[:, :, 2], *curve)
    assert np.allclose(there_and_back, np.column_stack([SHEET, np.full(len(SHEET), 5.0)]), atol=1e-9)


def test_the_bow_is_the_middle_less_the_edge() -> None:
    for bow in (0.01, 3.0, -40.0, 120.0):
        curvature = bend.curvature_of(bow, 500.0)
        edge = bend.to_space(np.array([[250.0, 40.0]]), np.array([curvature]), np.array([np.pi / 2]))
        assert -edge[0, 2] == pytest.approx(bow, rel=1e-9)


def test_a_ray_meets_the_sheet_where_it_is() -> None:
    eye, axis = np.array([100.0, -300.0, 2500.0]), np.full(len(SHEET), 0.7)
    for curvature in (-1 / 900, 0.0):
        points = bend.to_space(SHEET, np.full(len(SHEET), curvature), axis)
        along = bend.crossings(np.broadcast_to(eye, points.shape), points - eye, curvature, 0.7)
        assert np.abs(along - 1).min(axis=1) == pytest.approx(0, abs=1e-12)


def test_flat_boards_are_exactly_what_they_were() -> None:
    xy = np.random.default_rng(1).uniform(-400, 400, (50, 2))
    none = np.zeros(50)
    axis = np.linspace(0, 7, 50)
    assert np.array_equal(bend.to_space(xy, none, axis), np.column_stack([xy, none]))
    assert np.array_equal(bend.frames(xy, none, axis), np.broadcast_to(np.eye(3), (50, 3, 3)))


def first_moments(world: World, views: Views, image: np.ndarray, station: int) -> np.ndarray:
    """(n, 2) errors of the first moments of all plain dots on boards that a station sees."""
    marks, panels = world.marks, world.panels
    errors = []
    for k in np.flatnonzero((marks.code == 0) & (views.visible[station] == 1)):
        x, y = np.rint(views.disc_px[station, k]).astype(int)
        g = np.arange(-12, 13)
        if not (12 <= x < image.shape[1] - 12 and 12 <= y < image.shape[0] - 12):
            continue
        ground = panels.ground_albedo[marks.panel[k]]
        ink = image[y - 12 : y + 13, x - 12 : x + 13] - ground
        ink[np.hypot(*np.meshgrid(g, g)) > 12] = 0  # the neighbours
        errors.append([x + ink.sum(0) @ g / ink.sum(), y + ink.sum(1) @ g / ink.sum()] - views.disc_px[station, k])
    return np.array(errors)


def test_rendered_dots_are_where_the_bent_truth_says_and_not_where_a_flat_one_would(world: World) -> None:
    image = render_fast(build_stage(world), Irradiance.even(len(world.panels), np.pi), 0, 3).values.astype(float)
    errors = first_moments(world, see(world), image, 0)
    assert len(errors) > 100
    assert np.sqrt(np.mean(errors**2)) < 2e-4
    assert np.abs(errors).max() < 1e-3
    flat = first_moments(world, see(flattened(world)), image, 0)
    assert np.sqrt(np.mean(flat**2)) > 0.3


def test_the_disc_of_the_tangent_plane_would_not_do(world: World) -> None:
    """The contour's own bend shows in the centre of its area."""
    views, n = see(world), len(world.marks)
    tangent = disc_image(
        world.interior,
        world.camera_from_world[np.zeros(n, int)],
        world.mark_world_mm,
        world.mark_normal,
        world.marks.diameter_mm / 2,
    )
    bent = world.panels.bent[world.marks.panel] & (views.visible[0] == 1)
    difference = np.abs(tangent.centroid_px - views.disc_px[0])
    assert difference[bent].max() > 2e-4
    assert difference[~bent & (views.visible[0] == 1)].max() < 1e-9


def test_hits_of_both_renderers_are_on_the_paper_where_float64_says(world: World) -> None:
    mi = mitsuba()
    import drjit as dr

    stage = build_stage(world)
    x, y = (v.ravel() for v in np.meshgrid(np.arange(3.0, 1280, 7), np.arange(2.0, 1024, 7)))
    rays = CameraRays(world, 0).at(mi.Float(x), mi.Float(y))
    ray = mi.Ray3f(rays.origin, dr.normalize(rays.direction))
    hit = stage.scene.ray_intersect(ray)
    panel, bent = stage.texture.panel(hit), stage.texture.bent
    number, valid = np.array(panel), np.array(hit.is_valid())
    # As the path tracer's texture does, from the point on the mesh; then as the fast renderer does.
    start = mi.SurfaceInteraction3f(hit)
    start.t = mi.Float(0)
    traced = bent.refine(start, mi.Ray3f(hit.p, -hit.to_world(hit.wi)), panel, hit.is_valid())
    found = {"path": np.array(traced.uv).T, "mesh": np.array(hit.uv).T}
    found["fast"] = np.array(bent.refine(hit, ray, panel, hit.is_valid()).uv).T

    eye, R_cam = world.camera_from_world.origin_mm[0], world.camera_from_world.R[0]
    sight = directions(world.interior, np.column_stack([x, y])) @ R_cam
    for k in np.flatnonzero(world.panels.bent)[::2]:
        on = valid & (number == k)
        R, t = world.panels.world_from_panel.R[k], world.panels.world_from_panel.t_mm[k]
        curve = world.panels.curvature_per_mm[k], world.panels.bend_axis_rad[k]
        start_mm, slope = np.broadcast_to((eye - t) @ R, (on.sum(), 3)), sight[on] @ R
        along = bend.crossings(start_mm, slope, *curve)
        height = np.abs(start_mm[:, 2:] + along * slope[:, 2:])  # the other crossing is at the cylinder's far side
        nearest = along[np.arange(len(along)), np.argmin(height, axis=1)]
        paper = bend.to_paper(start_mm + nearest[:, None] * slope, *(np.full(on.sum(), v) for v in curve))
        error_mm = {way: (uv[on] - 0.5) * world.panels.size_mm[k] - paper[:, :2] for way, uv in found.items()}
        assert on.sum() > 1000
        for way in ("path", "fast"):
            assert np.sqrt(np.mean(error_mm[way] ** 2)) < 3e-4
            assert np.abs(error_mm[way].mean(axis=0)).max() < 2e-4
        assert np.sqrt(np.mean(error_mm["mesh"] ** 2)) > np.sqrt(np.mean(error_mm["fast"] ** 2))


@pytest.mark.slow
def test_fast_and_path_agree_on_bent_boards(world: World) -> None:
    small = replace(
        world.interior, width_px=320, height_px=256, parameters=world.interior.parameters * ([0.25] * 4 + [1] * 5)
    )
    plain = replace(world, interior=small, psf_sigma_px=0.0)
    stage = build_stage(plain)
    light = compute_irradiance(stage, 60.0, 2048, 5, lambda _: None)
    fast = render_fast(stage, light, 1, 8).values.astype(float)
    runs = np.stack([render_path(stage, 1, 64, 100 + k).values.astype(float) for k in range(16)])
    mean, u = runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    boards = board_pixels(plain, 1)
    z = block_means(fast - mean, boards) / np.sqrt(block_means(u**2, boards) / 64)
    assert len(z) > 80
    assert np.sqrt((z**2).mean()) < 1.4
    assert abs((fast - mean)[boards].mean()) < 2e-3 * mean[boards].mean()


def test_a_bent_board_hides_what_is_behind_it_and_a_hollow_one_its_own(world: World) -> None:
    panels = world.panels
    middle, R = panels.world_from_panel.t_mm[0], panels.world_from_panel.R[0]
    eye = middle + 1500 * R[:, 2]
    # Board A stands 12 mm out in its middle: its edge lies 12 mm behind the plane of the middle.
    edge_xy = panels.size_mm[0] / 2 * [0.999, 0]
    edge = panels.place(np.array([0]), edge_xy[None])[0]
    assert (middle - edge[0]) @ R[:, 2] == pytest.approx(12, rel=0.01)
    before_edge, behind_edge = edge + 1 * R[:, 2], edge - 1 * R[:, 2]
    nobody = np.array([-1])
    assert not hidden(eye, before_edge, world, nobody)[0]
    assert hidden(eye, behind_edge, world, nobody)[0]
    assert not hidden(eye, edge, world, np.array([0]))[0]

    hollow = replace(world, panels=replace(panels, curvature_per_mm=np.where(panels.bent, -1 / 300, 0.0)))
    points, frames = hollow.panels.place(np.array([0, 0]), np.array([[200.0, 0.0], [-200.0, 0.0]]))
    low = points[1] + 800 * (points[1] - points[0]) / 400 + 20 * frames[0, :, 2]
    assert hidden(low, points[:1], hollow, np.array([0]))[0]
    assert not hidden(points[0] + 50 * R[:, 2], points[1:], hollow, np.array([0]))[0]


def observe(world: World) -> Observations:
    """Noise-free centres of all visible discs with the covariance of 0.01 px."""
    views = see(world)
    station, mark = np.nonzero((views.visible == 1) & (views.obliquity_deg < 75))
    n = len(mark)
    poses, normal = world.camera_from_world[station], world.mark_normal[mark]
    image = disc_image(world.interior, poses, world.mark_world_mm[mark], normal, world.marks.diameter_mm[mark] / 2)
    marks = world.marks
    return Observations(
        stations=world.station_name,
        station=station,
        xy_px=views.disc_px[station, mark],
        cov_px2=np.tile(1e-4 * np.eye(2), (n, 1, 1)),
        moments_px2=image.moments_px2,
        code=marks.code[mark],
        board=marks.board[mark],
        point=marks.point[mark],
        chi2=np.ones(n),
        status=np.full(n, MEASURED, object),
        centre_of_disc=True,
    )


def test_a_calibration_told_that_boards_are_flat_finds_that_they_are_not() -> None:
    straight = build_world(load_scene(QUICK))
    bowed = build_world(with_bows(((1.0, 90.0), (0.0, 0.0), (0.0, 0.0))))
    for believed, true in zip(bowed.field.boards, straight.field.boards, strict=True):
        assert np.array_equal(believed.marks.xy_mm, true.marks.xy_mm)
    fits = [stitched(observe(world), world.field, 1280, 1024) for world in (straight, bowed)]
    assert not fits[0].rejected and not fits[0].misfit
    # A board bowed by 1 mm, of three: heights of 0.3 mm on it, of 0 on the others. No mark is to blame for it.
    assert 0.1 < fits[1].misfit["unflat_mm"] < 0.5
    assert len(fits[1].rejected) < 5
    assert not fits[1].test["passed"]


def test_a_bow_of_more_than_a_half_circle_is_refused() -> None:
    text = IN_FULL.read_text().replace("spin_deg = 2\n", "spin_deg = 2\nbow_mm = 200\n")
    with pytest.raises(TestfieldError, match=r"boards\[0\]"):
        parse_scene(text, "bent.toml")


@pytest.mark.parametrize("scene", ["stitched_wall", "vdi2634"])
def test_only_what_cannot_stand_before_a_mark_is_passed_over(scene: str, monkeypatch: pytest.MonkeyPatch) -> None:
    world = build_world(load_scene(Path(__file__).parents[1] / f"scenes/{scene}.toml"))
    poses = world.camera_from_world[:3]
    world = replace(world, camera_from_world=poses)
    asked = see(world).visible
    with monkeypatch.context() as everything:
        everything.setattr(truth, "_towards", lambda ray, at, _: np.ones((len(at), len(ray)), bool))
        assert np.array_equal(see(world).visible, asked)
    # The lamps and boards do hide something here, and nothing must be lost of it.
    with monkeypatch.context() as nothing:
        nothing.setattr(truth, "_towards", lambda ray, at, _: np.zeros((len(at), len(ray)), bool))
        assert not np.array_equal(see(world).visible, asked)
