"""Random numbers belong to their places: what is added, hidden or moved elsewhere changes none of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.schema import SceneFile
from testfield.scene.station_parts import StationRandom
from testfield.scene.target_parts import CheckRandom
from testfield.scene.truth import see
from testfield.scene.world import World
from testfield.seeds import Plane, _digest, normals
from testfield.simulate.observations import draw_observations

SCENES = Path(__file__).parents[1] / "scenes"


@pytest.fixture(scope="module")
def quick_scene() -> SceneFile:
    return load_scene(SCENES / "quick.toml")


def philox(counter: tuple[int, ...], key: tuple[int, int]) -> list[int]:
    """Philox4x64-10 of Salmon et al. (2011), written from the paper."""
    low, (c0, c1, c2, c3), (k0, k1) = (1 << 64) - 1, counter, key
    for _ in range(10):
        p0, p1 = 0xD2E7470EE14C6C93 * c0, 0xCA5A826395121157 * c2
        c0, c1, c2, c3 = (p1 >> 64) ^ c1 ^ k0, p1 & low, (p0 >> 64) ^ c3 ^ k1, p0 & low
        k0, k1 = (k0 + 0x9E3779B97F4A7C15) & low, (k1 + 0xBB67AE8584CAA73B) & low
    return [c0, c1, c2, c3]


def test_numbers_are_those_of_the_papers_generator() -> None:
    assert philox((0, 0, 0, 0), (0, 0))[0] == 0x16554D9ECA36314C  # the authors' known answer
    digest = _digest(3, "pinned")
    key = (int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little"))
    words = [word for block in (1, 2) for word in philox((block, 7, 0, 0), key)]
    expected = [((word >> 12) + 0.5) * 2.0**-52 for word in words]
    assert Plane(3, "pinned").uniforms(range(7, 8), 8)[0].tolist() == expected


def test_a_number_depends_on_its_row_and_column_alone() -> None:
    whole = Plane(3, "noise").uniforms(range(50), 33)
    assert np.array_equal(Plane(3, "noise").uniforms(range(50), 20), whole[:, :20])
    plane = Plane(3, "noise")
    for row in (31, 4, 30):
        assert np.array_equal(plane.uniforms(range(row, row + 2), 9), whole[row : row + 2, :9])
    assert np.array_equal(normals(3, "noise", 5, 2), normals(3, "noise", 9, 2)[:5])
    others = [Plane(4, "noise").uniforms(range(50), 33), Plane(3, "other").uniforms(range(50), 33)]
    assert not any(np.isclose(whole, other, rtol=0, atol=1e-9).any() for other in others)


def test_numbers_are_uniform_and_neighbours_know_nothing_of_each_other() -> None:
    u = Plane(1, "flat").uniforms(range(600), 500)
    counts = np.histogram(u, 100, (0, 1))[0] - u.size / 100
    assert (counts**2).sum() / (u.size / 100) < 99 + 5 * np.sqrt(2 * 99)
    z = Plane(1, "flat").normals(range(600), 500)
    for a, b in ((z[1:], z[:-1]), (z[:, 1:], z[:, :-1])):
        assert abs((a * b).mean()) < 5 / np.sqrt(a.size)


def marks_of(world: World) -> dict[tuple[str, int, int], tuple[float, float]]:
    """Where each mark is printed, by its board or card and its number."""
    marks = world.marks
    return {
        (world.panels.name[panel], int(point), int(code)): (float(xy[0]), float(xy[1]))
        for panel, point, code, xy in zip(marks.panel, marks.point, marks.code, marks.xy_mm, strict=True)
    }


def test_one_board_less_leaves_every_other_mark_where_it_was(quick_scene: SceneFile) -> None:
    boards = quick_scene.boards
    assert len(boards) > 1
    before = marks_of(build_world(quick_scene))
    gone = boards[0].name
    kept = tuple(part for part in quick_scene.check_targets if getattr(part, "board", None) != gone)
    after = marks_of(build_world(quick_scene.model_copy(update={"boards": boards[1:], "check_targets": kept})))
    assert after and all(before[key] == place for key, place in after.items())


def test_a_column_more_leaves_the_dots_misprints_as_they_were(quick_scene: SceneFile) -> None:
    def misprints(scene: SceneFile) -> np.ndarray:
        zone, world = scene.boards[0].extension_zone, build_world(scene)
        on = world.marks.board == 0
        off = world.marks.xy_mm[on] - world.field.boards[0].marks.xy_mm
        return off[-zone.rows * zone.columns :].reshape(zone.rows, zone.columns, 2)

    board = quick_scene.boards[0]
    # Without a common scale error, the misprint is all there is.
    plain = quick_scene.model_copy(update={"u_print_scale_ppm": 0.0})
    wide = board.extension_zone.model_copy(update={"columns": board.extension_zone.columns + 1})
    other = board.model_copy(update={"extension_zone": wide})
    one = misprints(plain)
    two = misprints(plain.model_copy(update={"boards": (other, *plain.boards[1:])}))
    assert np.abs(one).max() > 0 and np.allclose(one, two[:, :-1], rtol=0, atol=1e-12)


def test_random_targets_keep_their_places_when_more_come_or_a_board_moves_in_another_corner(
    quick_scene: SceneFile,
) -> None:
    part = CheckRandom(
        generator="random",
        first_code=200,
        count=12,
        low_mm=(3000, 3000, 0),
        high_mm=(5000, 5000, 2000),
        spacing_mm=150,
        seed=4,
    )
    stations = (
        *quick_scene.stations,
        StationRandom(
            generator="random", count=3, low_mm=(-200, -3000, 900), high_mm=(200, -2500, 1100), look_at_mm=(0, 0, 1000)
        ),
    )
    scene = quick_scene.model_copy(update={"check_targets": (part,), "stations": stations})
    more = part.model_copy(update={"count": 20})
    board = scene.boards[0].model_copy(update={"position_mm": (2900.0, 2900.0, 500.0)})
    changed = scene.model_copy(
        update={
            "check_targets": (part.model_copy(update={"first_code": 300, "count": 1}), more),
            "boards": (board, *scene.boards[1:]),
            "stations": stations[1:] if len(quick_scene.stations) > 1 else stations,
        }
    )
    one, two = build_world(scene), build_world(changed)
    place = [dict(zip(w.panels.name, w.panels.world_from_panel.t_mm.tolist(), strict=True)) for w in (one, two)]
    moved = [k for k in range(12) if place[0][f"check {200 + k}"] != place[1][f"check {200 + k}"]]
    assert len(moved) <= 2  # whom the other one, or the board, would touch
    assert np.array_equal(one.camera_from_world.t_mm[-3:], two.camera_from_world.t_mm[-3:])


def test_a_mark_that_is_hidden_changes_no_other_drawn_pixel(quick_scene: SceneFile) -> None:
    world = build_world(quick_scene)
    views = see(world)
    whole = draw_observations(quick_scene, world, views, 5)
    visible = views.visible.copy()
    visible[0, np.flatnonzero(visible[0] == 1)[3]] = 0
    less = draw_observations(quick_scene, world, replace(views, visible=visible), 5)
    assert len(less) in (len(whole) - 1, len(whole))
    rows = [
        {
            (int(s), int(b), int(p), int(c)): tuple(xy)
            for s, b, p, c, xy in zip(o.station, o.board, o.point, o.code, o.xy_px.tolist(), strict=True)
        }
        for o in (whole, less)
    ]
    assert all(rows[0][key] == xy for key, xy in rows[1].items())
