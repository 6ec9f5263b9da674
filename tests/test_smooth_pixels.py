"""Pixels that no edge crosses are seen by one ray: nothing may be lost by it, in any kind of world."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.camera.motion import Motion, Twist
from testfield.camera.optics import Optics
from testfield.camera.pose import Poses, rotation
from testfield.camera.project import project
from testfield.render import edges, fast, outlines
from testfield.render.irradiance import Irradiance
from testfield.render.shots import shots
from testfield.render.stage import build_stage
from testfield.render.vignetting import vignettes
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.world import Dirt, Panels, TrueMesh, World

SCENES = Path(__file__).parents[1] / "scenes"
SAME = 2e-5
"""Of white: what differs by where float32 rounds."""
STEEP = 2e-4
"""Of white, in an image so small that vignetting changes by a thousandth from pixel to pixel: a tenth of that change,
which a pixel that is alike in all its cells leaves out beside an edge."""
LOST = 2e-3
"""Of white: an outline that was forgotten differs by far more."""


def small(world: World, width_px: int = 400) -> World:
    """The world seen by a camera of fewer pixels and the same field of view."""
    scale = width_px / world.interior.width_px
    parameters = world.interior.parameters.copy()
    parameters[:2] *= scale
    parameters[2:4] = (parameters[2:4] + 0.5) * scale - 0.5
    height_px = int(world.interior.height_px * scale)
    return replace(
        world,
        interior=replace(world.interior, width_px=width_px, height_px=height_px, parameters=parameters),
        motion=replace(world.motion, row_s=world.motion.row_s / scale),
    )


def scene(name: str) -> World:
    return small(build_world(load_scene(SCENES / f"{name}.toml")))


def bent(world: World) -> World:
    curvature = np.where(world.panels.of_room, 0.0, 3e-4 * np.resize([1, -1], len(world.panels)))
    axis = np.linspace(0, np.pi, len(world.panels))
    return replace(world, panels=replace(world.panels, curvature_per_mm=curvature, bend_axis_rad=axis))


def rolled(world: World) -> World:
    """One board rolled up to a half cylinder that turns its back within the image."""
    curvature = np.zeros(len(world.panels))
    curvature[0] = np.pi / world.panels.size_mm[0].max()
    axis = np.full(len(world.panels), 0.3)
    return replace(world, panels=replace(world.panels, curvature_per_mm=curvature, bend_axis_rad=axis))


def dirty(world: World) -> World:
    panel = world.marks.panel[::3]
    aside = world.marks.xy_mm[::3] + [0.4, 0.7] * world.marks.diameter_mm[::3, None]
    spots = Dirt(panel, aside, world.marks.diameter_mm[::3] * 0.7, np.linspace(0.02, 0.9, len(panel)))
    return replace(world, dirt=spots)


def with_crossing_walls(world: World) -> World:
    """The wall stands in the room and through the floor, which goes on behind it."""
    rest, wall = world.panels.world_from_panel, world.panels.name.index("wall")
    t_mm = rest.t_mm.copy()
    t_mm[wall] += 400 * rest.R[wall, :, 2] - [0, 0, 200]
    return replace(world, panels=replace(world.panels, world_from_panel=Poses(rest.R, t_mm)))


def with_lamp_in_view(world: World) -> World:
    middle = world.mark_world_mm.mean(axis=0)
    eye = world.camera_from_world.origin_mm[0]
    lamp = world.lights[0]
    z = (eye - middle) / np.linalg.norm(eye - middle)
    x = np.cross([0, 0, 1.0], z) / np.linalg.norm(np.cross([0, 0, 1.0], z))
    pose = Poses(np.column_stack([x, np.cross(z, x), z])[None], (0.3 * eye + 0.7 * middle)[None])
    return replace(world, lights=(replace(lamp, world_from_light=pose, size_mm=(90.0, 40.0)),))


def with_meshes(world: World) -> World:
    """A needle thinner than a pixel before the boards, a block that stands through one, and a plate of one triangle."""
    middle, eye = world.mark_world_mm.mean(axis=0), world.camera_from_world.origin_mm[0]
    block = np.array([[x, y, z] for x in (-60, 60) for y in (-60, 60) for z in (-60, 60)], float)
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4]]
        + [[1, 5, 7], [1, 7, 3]]
    )
    at = world.panels.world_from_panel.t_mm[world.marks.panel[0]]
    needle = (block * [0.012, 5.0, 0.012]) + 0.6 * eye + 0.4 * middle
    plate = middle + 0.3 * (eye - middle) + np.array([[-50, 0, 0], [50, 0, 0], [0, 0, 80.0]])
    return replace(
        world,
        meshes=(
            TrueMesh("needle", needle, faces, 0.9, True),
            TrueMesh("block", at + block, faces, 0.6, True),
            TrueMesh("plate", plate, np.array([[0, 1, 2]]), 0.3, False),
        ),
    )


WORLDS: dict[str, Callable[[], World]] = {
    "dots and rings": lambda: scene("quick"),
    "walls that cut each other": lambda: with_crossing_walls(scene("quick")),
    "squares and tags": lambda: scene("charuco"),
    "sharper than the pixel": lambda: replace(scene("quick"), psf_sigma_px=0.0),
    "diffraction": lambda: replace(scene("quick"), optics=Optics(airy_px=0.9)),
    "bent boards": lambda: bent(scene("quick")),
    "a rolled board": lambda: rolled(scene("quick")),
    "dirt": lambda: dirty(scene("quick")),
    "a lamp in view": lambda: with_lamp_in_view(scene("quick")),
    "meshes": lambda: with_meshes(scene("quick")),
    "a fisheye": lambda: small(fisheye()),
    "defocus": lambda: replace(scene("quick"), optics=Optics(aperture_mm=30.0, focus_mm=1000.0)),
    "a camera in the hand, rows one after the other": lambda: scene("hand_held"),
    "a target that moves before a room at rest": lambda: replace(
        scene("quick"), motion=Motion(target=Twist(velocity_mm_s=(300.0, 0.0, 120.0)), exposure_s=0.02)
    ),
}


def fisheye() -> World:
    whole = load_scene(SCENES / "quick.toml")
    none = dict.fromkeys(("k1", "k2", "k3", "p1", "p2"), 0.0)
    camera = whole.camera.model_copy(update=none | {"lens": "fisheye", "k1": 0.02, "focal_length_mm": 3.0})
    return build_world(whole.model_copy(update={"camera": camera}))


@pytest.mark.parametrize("kind", WORLDS)
def test_one_ray_where_no_edge_is_loses_nothing(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    world = WORLDS[kind]()
    stage, light = build_stage(world), Irradiance.even(len(world.panels), np.pi, world.meshes)
    with_less = fast.render_fast(stage, light, 0, 3, blur_shots=16).values
    found = edges.edge_pixels(world, light.direct, 0, shots(world, 0, 16), 0)
    assert 0.01 < (found > 0).mean() < 0.6
    monkeypatch.setattr(fast, "edge_pixels", lambda *asked: np.maximum(edges.edge_pixels(*asked), edges.EDGE))
    with_all = fast.render_fast(stage, light, 0, 3, blur_shots=16).values
    off = np.abs(with_less - with_all) / np.percentile(with_all, 99)
    # Where an outline meets the middle of a cell, float32 decides on which side of it: a hundredth of a pixel, seldom.
    assert np.quantile(off, 0.999) < (STEEP if vignettes(world) else SAME)
    assert (off > LOST).mean() < 2e-5


@pytest.mark.parametrize(
    ("kind", "forgotten"),
    [
        ("dots and rings", "_circles"),
        ("dots and rings", "_spokes"),
        ("walls that cut each other", "_cuts"),
        ("squares and tags", "_steps"),
        ("a lamp in view", "_borders"),
        ("a rolled board", "_turning"),
        ("meshes", "_edges"),
        ("meshes", "_slices"),
    ],
)
def test_an_outline_that_is_forgotten_is_seen(kind: str, forgotten: str, monkeypatch: pytest.MonkeyPatch) -> None:
    world = small(WORLDS[kind](), 1600)
    light = Irradiance.even(len(world.panels), np.pi, world.meshes)

    def found() -> np.ndarray:
        stations = range(len(world.station_name))
        return np.stack([edges.edge_pixels(world, light.direct, k, np.zeros((1, 3)), 0) for k in stations]) > 0

    whole, function = found(), getattr(outlines, forgotten)

    def nothing(*given: object) -> object:
        made = function(*given)
        if isinstance(made, tuple):
            return tuple(column[:0] for column in made)
        return made[:0]

    monkeypatch.setattr(outlines, forgotten, nothing)
    less = found()
    assert (whole & ~less).sum() > 20 and not (less & ~whole).any()


def test_a_panels_border_is_nearly_as_true_as_a_mark() -> None:
    """A white card at a slant before nothing: its image has the area and the middle of its corners' polygon."""
    world = scene("quick")
    parameters = np.concatenate([world.interior.parameters[:4], np.zeros(len(world.interior.parameters) - 4)])
    eye = world.camera_from_world.inverse()[np.zeros(1, int)]
    leant = eye.after(Poses(rotation(np.array([[3.0, 0.5, 0.2]])), np.array([[20.0, -30.0, 1500.0]])))
    none = np.zeros(0, int)
    marks = replace(world.marks, panel=none, xy_mm=np.zeros((0, 2)), diameter_mm=np.zeros(0), code=none, role=none)
    marks = replace(marks, board=none, point=none, corner=none.astype(bool))
    size, albedo = np.array([[310.0, 170.0]]), np.array([0.5])
    card = replace(
        world,
        psf_sigma_px=0.0,
        marks=marks,
        panels=Panels(("card",), leant, size, albedo, albedo),
        lights=(),
        ambient_radiance=0.0,
        interior=replace(world.interior, parameters=parameters),
    )
    values = fast.render_fast(build_stage(card), Irradiance.even(1, np.pi / 0.5), 0, 3).values.astype(float)
    corners = card.panels.place(np.zeros(4, int), outlines.CORNERS * size)[0]
    x, y = project(card.interior, card.camera_from_world[np.zeros(4, int)], corners).T
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    middle = [((v + np.roll(v, -1)) * cross).sum() / (3 * cross.sum()) for v in (x, y)]
    v, u = np.indices(values.shape)
    assert values.sum() == pytest.approx(abs(cross.sum()) / 2, rel=6e-6)
    assert [(values * w).sum() / values.sum() for w in (u, v)] == pytest.approx(middle, abs=6e-4)


def test_retro_reflecting_marks_show_the_room_behind_the_eye_cell_by_cell() -> None:
    world = scene("retro_flash")
    lit = replace(world, flash=None, point_lights=())
    assert world.retro is not None
    inside = edges.edge_pixels(lit, Irradiance.even(len(lit.panels), np.pi).direct, 0, np.zeros((1, 3)), 0) > 0
    matt = replace(lit, retro=None)
    less = edges.edge_pixels(matt, Irradiance.even(len(lit.panels), np.pi).direct, 0, np.zeros((1, 3)), 0) > 0
    assert (inside & ~less).any() and not (less & ~inside).any()


def test_lights_without_size_throw_shadows_anywhere() -> None:
    world = scene("retro_flash")
    light = Irradiance.even(len(world.panels), np.pi)
    assert edges.edge_pixels(world, light.direct, 0, np.zeros((1, 3)), 0).all()


def test_a_sharp_shadow_is_seen_cell_by_cell_and_a_soft_one_is_not() -> None:
    world = scene("quick")
    even = Irradiance.even(len(world.panels), np.pi).direct
    nodes, panel = 33, int(world.marks.panel[0])
    counts = np.full(len(world.panels), 2)
    counts[panel] = nodes
    step = np.tile(np.where(np.arange(nodes) < nodes // 2, 1.0, 0.2), (nodes, 1))
    slope = np.tile(np.linspace(1.0, 0.2, nodes), (nodes, 1))

    def found(values: np.ndarray) -> np.ndarray:
        tiles = [values if k == panel else np.ones((2, 2)) for k in range(len(world.panels))]
        light = replace(even, nodes=counts, values=np.concatenate([tile.ravel() for tile in tiles]).astype(np.float32))
        return edges.edge_pixels(world, light, 0, np.zeros((1, 3)), 0) > 0

    plain = edges.edge_pixels(world, even, 0, np.zeros((1, 3)), 0) > 0
    assert (found(slope) == plain).all()
    assert (found(step) & ~plain).sum() > 200


@pytest.mark.parametrize("radius_mm", [3.0, 40.0, 400.0])
def test_an_outline_of_any_size_marks_all_pixels_that_it_passes(radius_mm: float) -> None:
    world = small(build_world(load_scene(SCENES / "quick.toml")), 2400)
    size = world.interior.height_px, world.interior.width_px
    middle = world.marks.xy_mm[::29]
    panel, still = world.marks.panel[::29], np.zeros_like(middle)
    circles = outlines.Curves(world.panels, panel, middle, still, np.full(len(panel), radius_mm))
    see = edges._eye(world, world.motion, 0, np.zeros(3))
    followed, passed = np.zeros((2, *size), np.uint8)
    edges._follow(followed, circles, edges.CIRCLE_PIECES, see, world, 0)
    dense = 40_000
    t = np.tile((np.arange(dense) + 0.5) / dense, len(panel))
    edges._mark(passed, see(circles.at(np.repeat(np.arange(len(panel)), dense), t))[0], 0)
    beside = cv2.dilate(followed, np.ones((3, 3), np.uint8))
    assert passed.sum() > 100
    assert not (passed & ~beside & 1).any()
    # And few that it does not.
    assert not (followed & ~cv2.dilate(passed, np.ones((3, 3), np.uint8)) & 1).any()


@pytest.mark.parametrize("margin", [0, 3, 40])
def test_a_pass_takes_what_there_is_room_for_wherever_edges_are(margin: int, monkeypatch: pytest.MonkeyPatch) -> None:
    cells, height, width = 3, 400, 300
    monkeypatch.setattr(fast, "CELLS_A_PASS", 100_000)
    crossed = np.zeros((height + 2 * margin, width + 2 * margin), bool)
    crossed[170:230, ::2] = True
    strips = fast._strips(crossed, cells, margin)
    assert [top for top, _ in strips] == [0, *(bottom for _, bottom in strips[:-1])] and strips[-1][1] == height
    heights = [bottom - top for top, bottom in strips]
    assert margin > 3 or max(heights) > 2 * min(heights[:-1])
    for top, bottom in strips:
        own = crossed[top : bottom + 2 * margin]
        divided = own.size if own.mean() > fast.MOSTLY else np.count_nonzero(own)
        assert bottom - top <= max(2 * margin, 1) or own.size + divided * cells**2 <= 100_000 + own.size
    assert len(fast._strips(crossed & False, cells, 0)) <= 2
