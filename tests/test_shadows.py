"""What flat panels hide of a lamp is known in closed form: against arithmetic by hand, and against dense rays."""

from pathlib import Path

import numpy as np
import pytest

from testfield.camera.pose import Poses, rotation
from testfield.render import direct
from testfield.render.irradiance import _on_panels
from testfield.render.shadow import Rectangles, visible_part
from testfield.render.stage import build_stage
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.world import AreaLight

SCENES = Path(__file__).parents[1] / "scenes"
DOWN = np.diag([1.0, -1.0, -1.0])
LAMP = AreaLight(Poses(DOWN[None], np.array([[0.0, 0.0, 2000.0]])), (400.0, 200.0), 5.0)


def below(*rectangles: tuple[float, float, float, float]) -> np.ndarray:
    """Visible part from the origin, looking up, with rectangles (x, width, y, depth) half way to the lamp."""
    middles = np.array([[x, y, 1000.0] for x, _, y, _ in rectangles]).reshape(-1, 3)
    sizes = np.array([[width, depth] for _, width, _, depth in rectangles]).reshape(-1, 2)
    shades = Rectangles(Poses(np.tile(np.eye(3), (len(sizes), 1, 1)), middles), sizes)
    up, here = np.array([[0.0, 0.0, 1.0]]), np.zeros((1, 3))
    hides = np.column_stack([shades.may_hide(k, LAMP, here) for k in range(len(shades))])
    return float(visible_part(LAMP, shades, here, up, hides)[0]) if len(shades) else 1.0


def test_half_of_a_lamp_behind_a_straight_edge_is_half_its_light() -> None:
    assert below((-150, 300, 0, 400)) == pytest.approx(0.5, abs=3e-4)
    assert below((0, 300, 100, 200)) == pytest.approx(0.5, abs=3e-4)


def test_a_window_in_the_middle_hides_its_own_part() -> None:
    # Half as far and half as wide: the shadow on the lamp is 100 of 400 mm wide, and 60 of 200 mm deep.
    u, v = np.meshgrid((np.arange(800) + 0.5) / 2 - 200, (np.arange(400) + 0.5) / 2 - 100)
    weight = 1 / (u**2 + v**2 + 2000**2) ** 2
    hidden = (np.abs(u - 40) < 50) & (np.abs(v) < 30)
    part = 1 - (weight * hidden).sum() / weight.sum()
    assert below((20, 50, 0, 30)) == pytest.approx(part, abs=3e-4)


def test_what_two_rectangles_hide_counts_once() -> None:
    one = below((-150, 300, 0, 400))
    assert below((-150, 300, 0, 400), (-150, 300, 0, 400)) == one
    assert below((-150, 300, 0, 400), (-120, 300, 0, 400)) == pytest.approx(below((-120, 300, 0, 400)), abs=1e-6)
    assert below((-150, 300, 0, 400), (150, 300, 0, 400)) < 1e-6
    apart = below((-20, 8, 0, 400)) + below((20, 8, 0, 400)) - 1
    for pair in ((-20, 20), (20, -20)):
        assert below(*((x, 8, 0, 400) for x in pair)) == pytest.approx(apart, abs=5e-4)


def test_what_lies_behind_the_lamp_or_the_point_hides_nothing() -> None:
    beyond = Rectangles(Poses(np.eye(3)[None], np.array([[0, 0, 2100.0]])), np.array([[4000.0, 4000.0]]))
    behind = Rectangles(Poses(np.eye(3)[None], np.array([[0, 0, -100.0]])), np.array([[4000.0, 4000.0]]))
    here = np.zeros((1, 3))
    for shade in (beyond, behind):
        assert not shade.may_hide(0, LAMP, here)[0]
        assert visible_part(LAMP, shade, here, np.array([[0, 0, 1.0]]), np.ones((1, 1), bool))[0] == 1


def test_a_rectangle_on_edge_hides_nothing_and_one_that_is_tilted_hides_what_rays_say() -> None:
    random = np.random.default_rng(5)
    here, up = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    u, v = np.meshgrid(((np.arange(1000) + 0.5) / 1000 - 0.5) * 400, ((np.arange(500) + 0.5) / 500 - 0.5) * 200)
    places = np.stack([u, -v, np.full_like(u, 2000.0)], axis=-1)
    weight = 1 / (places**2).sum(axis=-1) ** 2
    for _ in range(20):
        R = rotation(random.uniform(-1.2, 1.2, (1, 3)))
        middle, size = random.uniform([-60, -40, 300], [60, 40, 1700]), random.uniform(20, 160, 2)
        shade = Rectangles(Poses(R, middle[None]), size[None])
        at = (middle @ R[0, :, 2]) / (places @ R[0, :, 2])
        on = (at[..., None] * places - middle) @ R[0]
        hidden = (at > 0) & (at < 1) & (np.abs(on[..., 0]) < size[0] / 2) & (np.abs(on[..., 1]) < size[1] / 2)
        part = 1 - (weight * hidden).sum() / weight.sum()
        assert visible_part(LAMP, shade, here, up, np.ones((1, 1), bool))[0] == pytest.approx(part, abs=5e-4)
        assert shade.may_hide(0, LAMP, here)[0] or part == 1


@pytest.mark.parametrize("name", ["quick", "shadowed_board"])
def test_shadows_of_a_scene_are_those_of_dense_rays(name: str) -> None:
    world = build_world(load_scene(SCENES / f"{name}.toml"))
    stage = build_stage(world)
    places = _on_panels(world, np.full((len(world.panels), 2), 4))
    own = np.repeat(np.arange(len(world.panels)), 16)
    closed = direct.direct_irradiance(world, stage.scene, places.points, places.normals, own)
    counted = np.zeros(len(own))
    for light in world.lights:
        full = direct._unhidden(light, places.points, places.normals)
        lit = np.flatnonzero(full > 0)
        full[lit] *= direct._visible_part(light, stage.scene, places.points[lit], places.normals[lit], 121393)
        counted += full
    partly = (closed > 0.01 * closed.max()) & (counted < closed.max())
    assert partly.sum() > 20
    assert np.abs(closed - counted).max() < 3e-4 * counted.max()
