"""Bodies from mesh files: what they hide, what they shade, what they carry, and what a bad one is told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import IN_FULL

from testfield.camera.images import Radiance
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.camera.project import project
from testfield.certify.light import block_means
from testfield.chain.run import begin, resume
from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance, compute_irradiance
from testfield.render.mesh_light import _interpolation_error, node_weights
from testfield.render.path import render_path
from testfield.render.stage import build_stage
from testfield.scene.bodies import facing_outwards
from testfield.scene.build import build_world
from testfield.scene.load import load_scene, parse_scene
from testfield.scene.meshes import inside, turned
from testfield.scene.stickers import LIFT_MM, nearest, stickers
from testfield.scene.target_parts import CheckOnMesh
from testfield.scene.truth import see
from testfield.scene.world import BOARD, AreaLight, Panels, PointLight, TrueMarks, TrueMesh, World
from testfield.targets.field import Field

SCENES = Path(__file__).parents[1] / "scenes"
QUICK = IN_FULL.read_text()
FORMATS = ("stl", "obj", "ply", "glb")


def ball(radius_mm: float, centre_mm: tuple, name: str = "ball") -> TrueMesh:
    shape = trimesh.creation.icosphere(subdivisions=3, radius=radius_mm)
    return TrueMesh(name, np.array(shape.vertices) + centre_mm, np.array(shape.faces), 0.5, True)


def board_world(meshes: tuple[TrueMesh, ...], lights: tuple[AreaLight, ...] = (), ambient: float = 1.0) -> World:
    """A board of 5 x 4 dots of 40 mm, 100 mm apart, in the plane z = 0, seen square from 2 m before it."""
    x, y = np.meshgrid(np.arange(-2, 3) * 100.0, np.arange(-1.5, 2) * 100.0)
    xy = np.column_stack([x.ravel(), y.ravel()])
    n = len(xy)
    zero = np.zeros(n, int)
    panels = Panels(
        name=("A",),
        world_from_panel=Poses.identity(1),
        size_mm=np.array([[600.0, 480.0]]),
        ground_albedo=np.array([0.1]),
        ink_albedo=np.array([0.8]),
    )
    marks = TrueMarks(
        panel=zero, xy_mm=xy, diameter_mm=np.full(n, 40.0), code=zero, role=zero + BOARD, board=zero, point=np.arange(n)
    )
    camera = Interior(320, 256, np.array([960.0, 960.0, 160.0, 128.0, -0.05, 0.02, 0, 0, 0]))
    pose = Poses(np.diag([1.0, -1, -1])[None], np.array([[0, 0, 2000.0]]))
    return World(
        name="meshes",
        seed=1,
        field_diagonal_mm=1000.0,
        panels=panels,
        marks=marks,
        world_from_board=Poses.identity(1),
        station_name=("s",),
        camera_from_world=pose,
        interior=camera,
        psf_sigma_px=0.0,
        lights=lights,
        ambient_radiance=ambient,
        field=Field(14, ()),
        meshes=meshes,
    )


def half_hidden() -> World:
    """Some dots behind, some partly behind a ball that floats half-way."""
    return board_world((ball(90, (35, 20, 1000)),))


def visible_ink(world: World) -> np.ndarray:
    """(marks,) the ink that a picture shows of each dot, as a part of what it shows without any mesh."""

    def ink(some: World) -> np.ndarray:
        black = tuple(replace(mesh, albedo=0.0) for mesh in some.meshes)
        some = replace(some, meshes=black, panels=replace(some.panels, ground_albedo=np.zeros(1)))
        light = Irradiance.even(1, np.pi, black)
        image = render_fast(build_stage(some), light, 0, 8).values.astype(float)
        centre = see(replace(some, meshes=())).centre_px[0]
        y, x = np.mgrid[: image.shape[0], : image.shape[1]]
        near = np.hypot(x[None] - centre[:, 0, None, None], y[None] - centre[:, 1, None, None]) < 16
        return (near * image).sum(axis=(1, 2))

    return ink(world) / ink(replace(world, meshes=()))


def test_the_truth_says_how_much_of_a_dot_the_picture_shows() -> None:
    world = half_hidden()
    visible, shown = see(world).visible[0], visible_ink(world)
    part = (visible > 0) & (visible < 1)
    assert part.sum() >= 4
    assert (visible == 0).sum() >= 1
    assert np.abs(visible - shown).max() < 0.01


def test_a_mesh_that_truth_forgot_would_be_seen() -> None:
    world = half_hidden()
    assert np.abs(see(replace(world, meshes=())).visible[0] - visible_ink(world)).max() > 0.5


def test_the_true_ellipse_is_the_image_of_the_disc() -> None:
    """Of a tilted board far away: the semi-axes' ratio is the cosine of the obliquity, square to the tilt's axis."""
    world = board_world(())
    tilt = np.radians(50)
    about_y = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    far = replace(
        world,
        panels=replace(world.panels, world_from_panel=Poses(about_y[None], np.zeros((1, 3)))),
        camera_from_world=Poses(world.camera_from_world.R, np.array([[0, 0, 60000.0]])),
        interior=Interior(320, 256, np.array([30000.0, 30000.0, 160.0, 128.0, 0, 0, 0, 0, 0])),
    )
    views = see(far)
    assert np.allclose(views.semi_axes_px[0, :, 1] / views.semi_axes_px[0, :, 0], np.cos(tilt), rtol=1e-2)
    assert np.allclose(views.semi_axes_px[0, :, 0], 30000 / 60000 * 20, rtol=1e-2)
    assert np.allclose(np.abs(views.angle_deg[0]), 90, atol=0.5)
    assert np.allclose(views.obliquity_deg[0], 50, atol=0.5)
    assert np.allclose(2 * np.sqrt(views.semi_axes_px[0].prod(axis=1)), views.diameter_px[0], rtol=1e-6)


def with_mesh(tmp_path: Path, file: str, more: str = "", **fields: object) -> Path:
    lines = {"name": '"body"', "file": f'"{file}"', "position_mm": "[0, 100, 300]"} | fields
    scene = tmp_path / "body.toml"
    entry = "".join(f"{key} = {value}\n" for key, value in lines.items())
    scene.write_text(QUICK.replace("[render]", f"[[meshes]]\n{entry}\n{more}\n[render]"))
    return scene


def lump() -> trimesh.Trimesh:
    """A shape without symmetry whose coordinates every format can hold exactly."""
    shape = trimesh.creation.icosphere(subdivisions=2, radius=60)
    return trimesh.Trimesh(np.round(shape.vertices * [1, 0.5, 0.7] * 32) / 32 + [5, 0, 0], shape.faces)


def test_every_format_gives_the_same_world(tmp_path: Path) -> None:
    found = []
    for suffix in FORMATS:
        lump().export(tmp_path / f"lump.{suffix}")
        scene = load_scene(with_mesh(tmp_path, f"lump.{suffix}", rotation_deg="[10, 20, 30]", unit='"mm"'))
        found.append(build_world(scene).meshes[0])
    for mesh in found:
        assert mesh.closed
        assert len(mesh.faces) == 320
        assert (mesh.vertices_mm == found[0].vertices_mm).all()
        assert (mesh.faces == found[0].faces).all()


def test_units_and_turns_put_a_mesh_where_they_say(tmp_path: Path) -> None:
    lump().export(tmp_path / "lump.stl")
    mm = build_world(load_scene(with_mesh(tmp_path, "lump.stl"))).meshes[0]
    inch = build_world(load_scene(with_mesh(tmp_path, "lump.stl", unit='"in"'))).meshes[0]
    at = np.array([0, 100, 300])
    assert np.allclose((inch.vertices_mm - at) / 25.4, mm.vertices_mm - at)
    assert np.allclose(turned((90, 0, 0)) @ [0, 1, 0], [0, 0, 1])
    assert np.allclose(turned((0, 90, 0)) @ [0, 0, 1], [1, 0, 0])
    assert np.allclose(turned((90, 0, 90)) @ [0, 0, 1], [1, 0, 0])  # about x first: z goes to -y, and then to x


def test_a_mesh_inside_out_is_turned_and_an_open_one_is_seen_from_both_sides(tmp_path: Path) -> None:
    shape = lump()
    shape.invert()
    shape.export(tmp_path / "inverted.stl")
    mesh = build_world(load_scene(with_mesh(tmp_path, "inverted.stl"))).meshes[0]
    centre, _ = mesh.sphere
    assert (((mesh.corners_mm.mean(axis=1) - centre) * mesh.normals).sum(axis=1) > 0).all()
    sheet = TrueMesh(
        "sheet", np.array([[-90.0, -90, 900], [90, -90, 900], [0, 90, 900]]), np.array([[0, 1, 2]]), 0.5, False
    )
    for faces in (sheet.faces, sheet.faces[:, ::-1]):
        world = board_world((replace(sheet, faces=faces),))
        image = render_fast(build_stage(world), Irradiance.even(1, np.pi, world.meshes), 0, 2).values
        assert image[128, 160] == pytest.approx(0.5, rel=1e-5)


def test_a_glb_without_a_unit_is_in_metres_and_others_in_mm(tmp_path: Path) -> None:
    metres, mm = lump(), lump()
    metres.apply_scale(1e-3)
    metres.export(tmp_path / "lump.glb")
    mm.export(tmp_path / "lump.stl")
    found = [build_world(load_scene(with_mesh(tmp_path, f"lump.{suffix}"))).meshes[0] for suffix in ("glb", "stl")]
    assert np.allclose(found[0].vertices_mm, found[1].vertices_mm, atol=1e-4)


def bodies(*shapes: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray, bool]:
    """Signed volumes of all bodies after they were turned, one by one; the faces' middles; whether all are closed."""
    joined = trimesh.util.concatenate(shapes)
    vertices, number = np.unique(joined.vertices.round(9), axis=0, return_inverse=True)
    faces, closed = facing_outwards(vertices, number.reshape(-1)[joined.faces])
    part = np.repeat(np.arange(len(shapes)), [len(shape.faces) for shape in shapes])
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return np.bincount(part, weights=np.einsum("ni,ni->n", a, np.cross(b, c)) / 6), part, closed


def box(at: tuple, size: float, inverted: bool = False) -> trimesh.Trimesh:
    shape = trimesh.creation.box([size] * 3)
    shape.apply_translation(at)
    if inverted:
        shape.invert()
    return shape


@pytest.mark.parametrize("inverted", [(False, True), (True, False), (True, True), (False, False)])
def test_every_body_faces_outwards_however_it_was_wound(inverted: tuple) -> None:
    volume, _, closed = bodies(box((0, 0, 0), 10, inverted[0]), box((500, 3, 0), 20, inverted[1]))
    assert closed
    assert volume == pytest.approx([1000, 8000])
    # Bodies that touch along an edge, or of which one is wound at random.
    volume, _, closed = bodies(box((0, 0, 0), 10, inverted[0]), box((10, 10, 0), 10, inverted[1]))
    assert closed
    assert volume == pytest.approx([1000, 1000])
    mixed = box((0, 0, 0), 10)
    mixed.faces[3:7] = mixed.faces[3:7, ::-1]
    volume, _, closed = bodies(mixed, box((50, 0, 0), 10, inverted[1]))
    assert closed
    assert volume == pytest.approx([1000, 1000])


@pytest.mark.parametrize("inverted", [True, False])
def test_a_body_within_another_is_a_cavity_and_one_within_that_is_solid(inverted: bool) -> None:
    volume, _, closed = bodies(box((0, 0, 0), 30, inverted), box((1, 0, 0), 20, inverted), box((2, 0, 0), 10, inverted))
    assert closed
    assert volume == pytest.approx([27000, -8000, 1000])
    volume, _, _ = bodies(box((0, 0, 0), 30), box((10, 0, 0), 20, inverted))  # they cross: no cavity
    assert volume == pytest.approx([27000, 8000])


def test_one_open_body_leaves_the_others_outwards() -> None:
    open_box = box((100, 0, 0), 10)
    open_box.faces = open_box.faces[:-1]
    volume, _, closed = bodies(box((0, 0, 0), 10, True), open_box)
    assert not closed
    assert volume[0] == pytest.approx(1000)


def test_points_inside_a_closed_mesh_are_known() -> None:
    mesh = ball(50, (10, 0, 0))
    points = np.array([[10.0, 0, 0], [10, 48, 0], [10, 52, 0], [200, 0, 0]])
    assert inside(mesh, points).tolist() == [True, True, False, False]
    assert not inside(replace(mesh, closed=False), points).any()


def test_stickers_touch_the_surface_apart_from_each_other_and_face_where_they_should(tmp_path: Path) -> None:
    scene = load_scene(SCENES / "on_a_hull.toml")
    world = build_world(scene)
    hull = world.meshes[0]
    check = np.flatnonzero(world.marks.role == 2)
    assert len(check) == 12
    at, normal = world.mark_world_mm[check], world.mark_normal[check]
    touch, under = nearest(hull, at)
    gap = np.linalg.norm(at - touch, axis=1)
    assert gap.min() > LIFT_MM - 1e-6
    assert gap.max() < 2.5  # of a surface that bends inwards here and there, and is made of flat faces
    assert np.degrees(np.arccos((under * normal).sum(axis=1).clip(-1, 1))).max() < 10
    distance = np.linalg.norm(at[:, None] - at[None], axis=-1) + 1e9 * np.eye(12)
    assert distance.min() > 50
    facing = np.array([0, -1, 0.2]) / np.hypot(1, 0.2)
    assert (normal[3:] @ facing >= np.cos(np.radians(50)) - 1e-9).all()
    again = build_world(scene)
    assert (again.mark_world_mm == world.mark_world_mm).all()
    # Each is seen whole from somewhere, so the mesh does not hide what sticks on it.
    assert ((see(world).visible == 1).any(axis=0))[check].all()


def tank(facets: int) -> TrueMesh:
    """A closed cylinder about z, of radius 160 and height 600 mm, with an edge at x = 0 in front."""
    turn = 2 * np.pi * np.arange(facets) / facets
    rim = np.column_stack([160 * np.sin(turn), -160 * np.cos(turn), np.zeros(facets)])
    ends = np.array([[0, 0, -300.0], [0, 0, 300]])
    i, j = np.arange(facets), (np.arange(facets) + 1) % facets
    low, high = np.full(facets, 2 * facets), np.full(facets, 2 * facets + 1)
    corners = [(i, j, facets + j), (i, facets + j, facets + i), (low, j, i), (high, facets + i, facets + j)]
    faces = np.vstack([np.column_stack(three) for three in corners])
    return TrueMesh("tank", np.vstack([rim + ends[0], rim + ends[1], ends]), faces, 0.5, True)


def on_tank(facets: int, *points_mm: tuple[float, float, float]) -> list:
    part = CheckOnMesh(generator="on_mesh", mesh="tank", first_code=1, diameter_mm=10, points_mm=points_mm)
    return stickers((part,), 1, (tank(facets),), 2.5)


def test_a_sticker_lies_evenly_across_an_edge_of_a_curved_surface_and_never_over_a_rim() -> None:
    for facets in (16, 24, 32, 96):
        for x in (0.0, 0.1, 3.0, 10.0):
            _, at, normal, _ = on_tank(facets, (x, -160.0, 0.0))[0]
            assert np.degrees(np.arccos(-normal[1])) <= 180 / facets + 1e-6
            assert np.linalg.norm(at - (x, -160, 0)) < 3
    _, at, normal, _ = on_tank(24, (0.0, -160.0, 0.0))[0]
    assert normal == pytest.approx([0, -1, 0], abs=1e-6)
    assert at == pytest.approx([0, -160 - LIFT_MM, 0], abs=1e-3)
    for z in (300.0, 295.0, 310.0):
        with pytest.raises(TestfieldError, match="not under all of it"):
            on_tank(24, (0.0, -160.0, z))


def test_a_point_far_from_its_mesh_is_refused_with_its_distance() -> None:
    assert len(on_tank(24, (0.0, -185.0, 0.0))) == 1
    with pytest.raises(TestfieldError, match=r"points_mm\[1\].* 8700 mm away"):
        on_tank(24, (0.0, -160.0, 0.0), (0.0, 0.0, 9000.0))


def test_nodes_of_a_face_interpolate_linear_light_exactly() -> None:
    for n in (2, 4, 8):
        linear = [node_weights(m) @ [3.0, -1.0, 7.0] for m in (n // 2, n)]
        assert _interpolation_error(*linear) < 1e-12
        bent = [node_weights(m)[:, 1] ** 2 for m in (n // 2, n)]
        assert _interpolation_error(*bent) == pytest.approx(1 / n**2)


def shadow_world() -> World:
    """A ball between a small lamp and a board, and aside of the camera's view of most of it."""
    lamp = AreaLight(Poses(np.diag([-1.0, 1, -1])[None], np.array([[400.0, 300.0, 1500.0]])), (120.0, 120.0), 400.0)
    return board_world((ball(70, (150, 100, 260)),), (lamp,), 0.2)


@pytest.mark.slow
def test_fast_and_path_agree_on_a_ball_and_its_shadow_within_the_noise() -> None:
    world = shadow_world()
    stage = build_stage(world)
    light = compute_irradiance(stage, 40.0, 2048, 5, lambda _: None)
    fast = render_fast(stage, light, 0, 4).values.astype(float)
    runs = np.stack([render_path(stage, 0, 32, 100 + k).values.astype(float) for k in range(12)])
    mean, u = runs.mean(axis=0), runs.std(axis=0, ddof=1) / np.sqrt(len(runs))
    pixel = pixel_of(world, world.meshes[0])
    board = np.zeros(mean.shape, bool)
    board[20:-20, 25:-25] = True
    on_ball = ring(pixel, mean.shape, 0.0, 0.85)
    # The board with the shadow on it, and the ball's own shade, in units of the path tracer's noise.
    off = board & ~ring(pixel, mean.shape, 0.0, 1.15)
    z = block_means(fast - mean, off) / np.sqrt(block_means(u**2, off) / 64)
    assert len(z) > 300
    assert np.sqrt((z**2).mean()) < 1.35
    assert block_means(fast, off).min() < 0.5 * np.median(block_means(fast, off))  # there is a shadow
    z = block_means(fast - mean, on_ball) / np.sqrt(block_means(u**2, on_ball) / 64)
    assert len(z) > 10
    assert np.sqrt((z**2).mean()) < 1.6
    # Light that knew nothing of the ball would not pass.
    bare = compute_irradiance(build_stage(replace(world, meshes=())), 40.0, 256, 5, lambda _: None)
    blind = render_fast(stage, replace(bare, meshes=light.meshes), 0, 4).values.astype(float)
    z = block_means(blind - mean, off) / np.sqrt(block_means(u**2, off) / 64)
    assert np.sqrt((z**2).mean()) > 5


def pixel_of(world: World, mesh: TrueMesh) -> tuple[np.ndarray, float]:
    """Middle and radius in px of the image of a ball."""
    pose = world.camera_from_world[np.zeros(len(mesh.vertices_mm), int)]
    px = project(world.interior, pose, mesh.vertices_mm)
    centre = (px.min(axis=0) + px.max(axis=0)) / 2
    return centre, float(np.linalg.norm(px - centre, axis=1).max())


def ring(pixel: tuple[np.ndarray, float], shape: tuple, low: float, high: float) -> np.ndarray:
    """Pixels from `low` to `high` radii of a ball's image."""
    (x, y), radius = pixel
    rows, columns = np.mgrid[: shape[0], : shape[1]]
    distance = np.hypot(columns - x, rows - y) / radius
    return (distance >= low) & (distance < high)


def test_light_on_meshes_survives_saving(tmp_path: Path) -> None:
    light = Irradiance.even(1, 2.0, (ball(50, (0, 0, 0)),))
    light.save(tmp_path / "light.npz")
    again = Irradiance.load(tmp_path / "light.npz")
    assert (again.meshes.values == light.meshes.values).all()
    assert (again.meshes.cells == light.meshes.cells).all()


def test_a_runs_folder_keeps_its_meshes(tmp_path: Path) -> None:
    lump().export(tmp_path / "lump.stl")
    run, _ = begin(with_mesh(tmp_path, "lump.stl"), tmp_path / "out", None, 1)
    (tmp_path / "lump.stl").unlink()
    again = resume(tmp_path / "out", 1)
    assert (again.world.meshes[0].vertices_mm == run.world.meshes[0].vertices_mm).all()


def sheet_without_faces(path: Path) -> None:
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
        "end_header\n0 0 0\n"
    )


ON_MESH = '[[check_targets]]\ngenerator = "on_mesh"\nfirst_code = 301\n'
BAD = {
    "missing": ("none.stl", {}, "", ["meshes[0].file", "none.stl", "no such mesh file"]),
    "unreadable": ("bad.glb", {}, "", ["meshes[0].file", "bad.glb", "not a readable mesh"]),
    "not an STL": ("bad.stl", {}, "", ["meshes[0].file", "bad.stl", "no faces"]),
    "unknown format": ("bad.xyz9", {}, "", ["meshes[0].file", "bad.xyz9", "STL"]),
    "empty": ("empty.ply", {}, "", ["meshes[0].file", "empty.ply", "no faces"]),
    "too large": ("lump.stl", {"unit": '"m"', "position_mm": "[0, 0, 0]"}, "", ["meshes[0].unit", "'m'", "lump.stl"]),
    "too small": ("lump.stl", {"unit": '"um"'}, "", ["meshes[0].unit", "'um'", "lump.stl"]),
    "camera inside": (
        "lump.stl",
        {"unit": '"cm"', "position_mm": "[0, -2150, 650]", "name": '"body"'},
        "",
        ["inside the mesh 'body'", "station"],
    ),
    "no such mesh": ("lump.stl", {}, ON_MESH + 'mesh = "boat"\ncount = 1\n', ["check_targets[3].mesh", "'boat'"]),
    "no room": (
        "lump.stl",
        {},
        ON_MESH + 'mesh = "body"\ncount = 50\n',
        ["check_targets[3].count", "of 50 targets", "spacing_mm"],
    ),
    "overlap": (
        "lump.stl",
        {},
        ON_MESH + 'mesh = "body"\ndiameter_mm = 6\npoints_mm = [[0, 60, 300], [3, 60, 300]]\n',
        ["check_targets[3].points_mm", "target 2"],
    ),
    "points and count": (
        "lump.stl",
        {},
        ON_MESH + 'mesh = "body"\ncount = 1\npoints_mm = [[0, 60, 300]]\n',
        ["check_targets[3]", "either points_mm or count"],
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_mesh_is_told_with_file_field_and_value(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    file, fields, more, words = BAD[name]
    for bad in ("bad.stl", "bad.glb", "bad.xyz9"):
        (tmp_path / bad).write_bytes(b"nothing that a mesh could be")
    sheet_without_faces(tmp_path / "empty.ply")
    lump().export(tmp_path / "lump.stl")
    if name == "too large":
        trimesh.creation.icosphere(radius=2000).export(tmp_path / "lump.stl")
    if name == "camera inside":
        fields = fields | {"position_mm": f"[{station_one()}]"}
    scene = with_mesh(tmp_path, file, more, **fields)
    assert main(["run", str(scene), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    for word in ("body.toml", *words):
        assert word in said, said
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()


def station_one() -> str:
    eye = build_world(parse_scene(QUICK, "quick")).camera_from_world.origin_mm[0]
    return ", ".join(str(v) for v in eye)


def test_pictures_without_a_mesh_know_nothing_of_meshes() -> None:
    """A mesh behind the camera changes no byte of an evenly lit picture."""
    bare, behind = board_world(()), board_world((ball(50, (0, 0, 4000)),))
    images = [
        render_fast(build_stage(world), Irradiance.even(1, np.pi, world.meshes), 0, 3) for world in (bare, behind)
    ]
    assert all(isinstance(image, Radiance) for image in images)
    assert images[0].values.tobytes() == images[1].values.tobytes()


def test_a_bent_board_leaves_the_shade_of_a_mesh_alone() -> None:
    """Whatever is no panel must not be taken for the first one, whose surface is a cylinder here."""
    flat = replace(
        board_world((ball(150.0, (0.0, 350.0, 300.0)),), ambient=0.0),
        point_lights=(PointLight(np.array([300.0, 900.0, 1500.0]), 3.0),),
    )
    n = len(flat.panels)
    curve = np.where(np.arange(n) == 0, 2e-4, 0.0)
    bent = replace(flat, panels=replace(flat.panels, curvature_per_mm=curve, bend_axis_rad=np.full(n, np.pi / 2)))
    light = Irradiance.even(n, 0.0, flat.meshes)
    images = [render_fast(build_stage(world), light, 0, 2).values for world in (flat, bent)]
    top = project(flat.interior, flat.camera_from_world, np.array([[0.0, 350.0, 450.0]]))[0]
    x, y = np.rint(top).astype(int)
    shade = [image[y - 8 : y + 9, x - 8 : x + 9] for image in images]
    assert shade[0].min() > 0
    assert np.abs(shade[1] - shade[0]).max() < 2e-3 * shade[0].max()
