"""The certificate as a whole, and what its parts must notice."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testfield.certify import certificate as whole
from testfield.certify.lens import certify_lens
from testfield.certify.light import certify_light
from testfield.certify.sameness import certify_sameness
from testfield.certify.verdict import Verdict
from testfield.cli.main import main
from testfield.render.direct import TOLERANCE, DirectLight, compute_direct, direct_irradiance
from testfield.render.stage import build_stage
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.world import World
from testfield.score.floor import floor_of, renderer_digest

SCENES = Path(__file__).parents[1] / "scenes"
TINY = Path(__file__).parent / "torture/tiny.toml"


@pytest.fixture(scope="module")
def shadowed() -> World:
    return build_world(load_scene(SCENES / "shadowed_board.toml"))


def test_a_figure_that_is_no_number_does_not_pass() -> None:
    assert Verdict("lens", "x", 0.5, 1.0, "px", "").passed
    assert not Verdict("lens", "x", float("nan"), 1.0, "px", "").passed


def test_every_lens_keeps_its_limits() -> None:
    for verdict in certify_lens(True):
        assert verdict.passed, verdict


def test_the_same_scene_gives_the_same_bytes() -> None:
    # The quick scene's bytes are compared in `test_render`; this is the certificate's own comparison.
    for verdict in certify_sameness(TINY, True):
        assert verdict.passed, verdict


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["quick", "shadowed_board"])
def test_fast_light_is_the_path_tracers_light(scene: str) -> None:
    for verdict in certify_light(build_world(load_scene(SCENES / f"{scene}.toml")), True):
        assert verdict.passed, verdict


def test_direct_light_in_full_view_is_lamberts_integral(shadowed: World) -> None:
    """A small lamp far away: radiance x area x cos x cos' / d^2, to the size of the lamp over the distance, squared."""
    lamp = replace(shadowed.lights[0], size_mm=(10.0, 8.0))
    world = replace(shadowed, lights=(lamp,))
    point, normal = np.array([[-400.0, -30.0, 600.0]]), np.array([[0.0, -1.0, 0.0]])
    to = lamp.world_from_light.t_mm[0] - point[0]
    cosines = (-to[1] / np.linalg.norm(to)) * (-(to @ lamp.world_from_light.R[0][:, 2]) / np.linalg.norm(to))
    expected = lamp.radiance * 80 * cosines / (to @ to)
    found = direct_irradiance(world, build_stage(world).scene, point, normal, np.array([0]))
    assert found[0] == pytest.approx(expected, rel=1e-4)


def test_a_shadow_edge_is_where_geometry_puts_it(shadowed: World) -> None:
    """Half of a small lamp's light passes where the line through the lamp's middle grazes the bar's edge."""
    lamp = replace(shadowed.lights[0], size_mm=(10.0, 10.0))
    bar = shadowed.panels.name.index("bar in the light")
    sizes = shadowed.panels.size_mm.copy()
    sizes[bar + 1] = 1.0  # its back would cast a shadow edge of its own
    world = replace(shadowed, lights=(lamp,), panels=replace(shadowed.panels, size_mm=sizes))
    R, t = world.panels.world_from_panel.R[bar], world.panels.world_from_panel.t_mm[bar]
    eye = lamp.world_from_light.t_mm[0]
    board_R, board_t = world.panels.world_from_panel.R[0], world.panels.world_from_panel.t_mm[0]
    edge = t + R @ np.array([0, world.panels.size_mm[bar][1] / 2, 0])
    ray = edge - eye
    foot = eye + ray * (((board_t - eye) @ board_R[:, 2]) / (ray @ board_R[:, 2]))
    across = np.cross(board_R[:, 2], R[:, 0])
    across /= np.linalg.norm(across)
    places = foot + np.linspace(-12, 12, 49)[:, None] * across + 0.02 * board_R[:, 2]
    normals = np.broadcast_to(board_R[:, 2], places.shape)
    light = direct_irradiance(world, build_stage(world).scene, places, normals, np.zeros(49, int))
    share = light / light.max()
    assert share.min() < 0.01
    assert share[24] == pytest.approx(0.5, abs=0.03)


def test_tiles_interpolate_within_their_tolerance(shadowed: World) -> None:
    from testfield.render.direct import _places

    stage = build_stage(shadowed)
    light = compute_direct(shadowed, stage.scene)
    uv = np.random.default_rng(0).uniform(0.02, 0.98, (400, 2))
    points, normals, owner = _places(shadowed, np.zeros(400, int), uv)
    exact = direct_irradiance(shadowed, stage.scene, points, normals, owner)
    found = np.array([_look_up(light, 0, *p) for p in uv])
    assert np.sqrt(np.mean((found - exact) ** 2)) < TOLERANCE * exact.max()
    assert np.abs(found - exact).max() < 8 * TOLERANCE * exact.max()


def _look_up(light: DirectLight, panel: int, u: float, v: float) -> float:
    rows, columns = light.tile_shape[panel]
    first = light.tile_shape[:panel].prod(axis=1).sum()
    column, row = int(u * columns), int(v * rows)
    tile = first + row * columns + column
    n = light.nodes[tile]
    start = (light.nodes[:tile] ** 2).sum()
    grid = light.values[start : start + n * n].reshape(n, n)
    x, y = (u * columns - column) * (n - 1), (v * rows - row) * (n - 1)
    i, j = min(int(x), n - 2), min(int(y), n - 2)
    fx, fy = x - i, y - j
    below = (1 - fx) * grid[j, i] + fx * grid[j, i + 1]
    above = (1 - fx) * grid[j + 1, i] + fx * grid[j + 1, i + 1]
    return float((1 - fy) * below + fy * above)


def test_the_command_writes_the_certificate_and_fails_where_a_verdict_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    good, bad = (
        Verdict("lens", "good", np.float32(0.1), np.float64(1.0), "px", "how"),
        Verdict("lens", "bad", 2.0, 1.0, "px", "how"),
    )
    scene = str(SCENES / "quick.toml")
    for verdicts, status in (([good], 0), ([good, bad], 1)):
        monkeypatch.setattr(whole, "_measure", lambda part, scene, quick, v=verdicts: v if part == "lens" else [])
        assert main(["certify", "--quick", "--scene", scene, "--out", str(tmp_path)]) == status
        written = json.loads((tmp_path / "certificate.json").read_text())
        assert written["passed"] is (status == 0)
        assert "good" in (tmp_path / "certificate.html").read_text()
    assert "FAIL" in capsys.readouterr().out


def test_a_report_states_the_certificate_and_whether_it_is_still_valid(tmp_path: Path) -> None:
    figures = {
        "quick": False,
        "passed": True,
        "made": "2026-01-01T00:00:00+00:00",
        "code": renderer_digest(),
        "verdicts": [vars(Verdict("light", "scatter, rms", 4e-4, 5e-4, "px", "")) | {"passed": True}],
    }
    (tmp_path / "run").mkdir()
    assert floor_of(tmp_path / "run") is None
    (tmp_path / "certificate.json").write_text(json.dumps(figures))
    floor = floor_of(tmp_path / "run")
    assert floor is not None
    assert floor["valid"]
    assert floor["centre_floor_px"] == 4e-4
    (tmp_path / "certificate.json").write_text(json.dumps(figures | {"code": "another renderer"}))
    assert not floor_of(tmp_path / "run")["valid"]  # type: ignore[index]
