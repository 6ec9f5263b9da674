"""Bodies from STEP files have their size whatever unit the file is in, and curved faces are followed."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import trimesh

from testfield.errors import TestfieldError
from testfield.scene.load import load_scene
from testfield.scene.mesh_files import check_mesh_file
from testfield.scene.meshes import load_meshes
from testfield.scene.step_files import DEVIATION_MM
from testfield.scene.world import TrueMesh

CASCADIO = "the extra `step` (cascadio) is not installed"
SI = {"mm": "SI_UNIT(.MILLI.,.METRE.)", "cm": "SI_UNIT(.CENTI.,.METRE.)", "m": "SI_UNIT($,.METRE.)"}
NAMELESS = "''"
HEAD = [
    "ISO-10303-21;",
    "HEADER;",
    "FILE_DESCRIPTION(('a body'),'2;1');",
    "FILE_NAME('body','2026-01-01T00:00:00',(''),(''),'','','');",
    "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));",
    "ENDSEC;",
    "DATA;",
]
TINY = Path(__file__).parent / "torture/tiny.toml"


class Part21:
    """Lines of a STEP file's data, each entered under the next number."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def line(self, text: str) -> str:
        self.lines.append(f"#{len(self.lines) + 1} = {text};")
        return f"#{len(self.lines)}"

    def __call__(self, name: str, *values: str | float | list[str]) -> str:
        """An entity without a name of its own."""
        texts = [f"({','.join(v)})" if isinstance(v, list) else v if isinstance(v, str) else f"{v:.9f}" for v in values]
        return self.line(f"{name}({','.join([NAMELESS, *texts])})")

    def point(self, *xyz: float) -> str:
        return self("CARTESIAN_POINT", [f"{v:.9f}" for v in xyz])

    def way(self, *xyz: float) -> str:
        return self("DIRECTION", [f"{v:.9f}" for v in xyz])

    def frame(self, at: str, z: Sequence[float], x: Sequence[float]) -> str:
        return self("AXIS2_PLACEMENT_3D", at, self.way(*z), self.way(*x))


def box(add: Part21, size: Sequence[float]) -> str:
    corner = np.array([[(i >> k) & 1 for k in range(3)] for i in range(8)]) * np.array(size)
    points = [add.point(*xyz) for xyz in corner]
    faces = []
    for quad in ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)):
        bound = add("FACE_OUTER_BOUND", add("POLY_LOOP", [points[i] for i in quad]), ".T.")
        a, b, c = corner[list(quad[:3])]
        x, z = (v / np.linalg.norm(v) for v in (b - a, np.cross(b - a, c - a)))
        faces.append(add("FACE_SURFACE", [bound], add("PLANE", add.frame(points[quad[0]], z, x)), ".T."))
    return add("FACETED_BREP", add("CLOSED_SHELL", faces))


def cylinder(add: Part21, radius: float, height: float) -> str:
    up, right, down = (0, 0, 1), (1, 0, 0), (0, 0, -1)
    ends, rims, corners = [], [], []
    for z in (0.0, height):
        ends.append(add.point(0, 0, z))
        corners.append(add("VERTEX_POINT", add.point(radius, 0, z)))
        circle = add("CIRCLE", add.frame(ends[-1], up, right), radius)
        rims.append(add("EDGE_CURVE", corners[-1], corners[-1], circle, ".T."))
    line = add("LINE", add.point(radius, 0, 0), add("VECTOR", add.way(*up), "1."))
    seam = add("EDGE_CURVE", *corners, line, ".T.")

    def face(surface: str, *edges: tuple[str, str]) -> str:
        loop = add("EDGE_LOOP", [add("ORIENTED_EDGE", "*", "*", edge, way) for edge, way in edges])
        return add("ADVANCED_FACE", [add("FACE_OUTER_BOUND", loop, ".T.")], surface, ".T.")

    around = add("CYLINDRICAL_SURFACE", add.frame(ends[0], up, right), radius)
    faces = [
        face(around, (rims[0], ".T."), (seam, ".T."), (rims[1], ".F."), (seam, ".F.")),
        face(add("PLANE", add.frame(ends[0], down, right)), (rims[0], ".F.")),
        face(add("PLANE", add.frame(ends[1], up, right)), (rims[1], ".T.")),
    ]
    return add("MANIFOLD_SOLID_BREP", add("CLOSED_SHELL", faces))


def step(body: Callable[[Part21], str], unit: str) -> str:
    """A STEP file (AP214) of one body."""
    add = Part21()
    app = add.line("APPLICATION_CONTEXT('core data for automotive mechanical design processes')")
    add.line(f"APPLICATION_PROTOCOL_DEFINITION('international standard','automotive_design',2000,{app})")
    context = add("PRODUCT_CONTEXT", app, "'mechanical'")
    made = add("PRODUCT_DEFINITION_FORMATION", "''", add("PRODUCT", "'body'", "''", [context]))
    part = add.line(f"PRODUCT_DEFINITION_CONTEXT('part definition',{app},'design')")
    shape = add("PRODUCT_DEFINITION_SHAPE", "''", add("PRODUCT_DEFINITION", "''", made, part))
    if unit == "in":
        mm = add.line(f"( LENGTH_UNIT() NAMED_UNIT(*) {SI['mm']} )")
        exponents = add.line("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
        inch = add.line(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),{mm})")
        length = add.line(f"( CONVERSION_BASED_UNIT('INCH',{inch}) LENGTH_UNIT() NAMED_UNIT({exponents}) )")
    else:
        length = add.line(f"( LENGTH_UNIT() NAMED_UNIT(*) {SI[unit]} )")
    plane = add.line("( NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.) )")
    solid = add.line("( NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT() )")
    known = add.line(f"UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-07),{length},'distance_accuracy_value','')")
    space = add.line(
        f"( GEOMETRIC_REPRESENTATION_CONTEXT(3) GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT(({known})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT(({length},{plane},{solid})) REPRESENTATION_CONTEXT('','') )"
    )
    held = add("SHAPE_REPRESENTATION", [add.frame(add.point(0, 0, 0), (0, 0, 1), (1, 0, 0)), body(add)], space)
    add.line(f"SHAPE_DEFINITION_REPRESENTATION({shape},{held})")
    return "\n".join([*HEAD, *add.lines, "ENDSEC;", "END-ISO-10303-21;", ""])


def loaded(folder: Path, text: str, unit: str | None = None, name: str = "body.step") -> TrueMesh:
    """The body of a scene whose mesh is a STEP file."""
    (folder / name).write_text(text)
    part = f'[[meshes]]\nname = "body"\nfile = "{name}"\n' + (f'unit = "{unit}"\n' if unit else "")
    (folder / "scene.toml").write_text(f"{TINY.read_text()}\n{part}")
    (mesh,) = load_meshes(load_scene(folder / "scene.toml"))
    return mesh


@pytest.fixture
def cascade() -> None:
    """Skips where the extra is missing."""
    pytest.importorskip("cascadio", reason=CASCADIO)


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("cm", 10.0), ("m", 1e3), ("in", 25.4)])
@pytest.mark.usefixtures("cascade")
def test_a_body_has_its_size_whatever_unit_its_file_is_in(tmp_path: Path, unit: str, mm: float) -> None:
    size = (300.0, 400.0, 512.0)
    mesh = loaded(tmp_path, step(lambda add: box(add, [v / mm for v in size]), unit))
    assert np.ptp(mesh.vertices_mm, axis=0) == pytest.approx(size, abs=1e-4)
    assert mesh.vertices_mm.min(axis=0) == pytest.approx(0, abs=1e-9)  # no axis changes places
    assert mesh.closed
    assert len(mesh.faces) == 12


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("m", 1e3), ("in", 25.4)])
@pytest.mark.usefixtures("cascade")
def test_a_curved_face_is_followed_as_closely_in_every_unit(tmp_path: Path, unit: str, mm: float) -> None:
    radius, height = 400.0, 300.0
    mesh = loaded(tmp_path, step(lambda add: cylinder(add, radius / mm, height / mm), unit), name="body.STP")
    assert mesh.closed
    away = np.hypot(*mesh.vertices_mm.T[:2])
    assert away[away > 1] == pytest.approx(radius, abs=1e-3)
    side = np.abs(mesh.normals[:, 2]) < 0.5
    middle = mesh.corners_mm[side].mean(axis=1)
    edges = np.concatenate(
        [(mesh.corners_mm[side] + np.roll(mesh.corners_mm[side], 1, axis=1)).reshape(-1, 3) / 2, middle]
    )
    assert radius - np.hypot(*edges.T[:2]).min() < 1.05 * DEVIATION_MM
    body = trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False)
    assert body.volume == pytest.approx(np.pi * radius**2 * height, rel=5e-4)


@pytest.mark.usefixtures("cascade")
def test_what_is_no_sound_step_file_is_refused_in_a_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text = step(lambda add: box(add, (300, 400, 500)), "mm")
    for what, match in (
        (text[: len(text) // 2], "damaged, cut short"),
        (text.replace("FACETED_BREP", "NOTHING"), "no faces"),
        (text.replace("POLY_LOOP", "NO_LOOP"), "no faces"),
        (text.replace("LENGTH_UNIT()", ""), "no unit of length"),
        ("solid a\n", "ISO-10303-21"),
    ):
        with pytest.raises(TestfieldError, match=match) as found:
            loaded(tmp_path, what)
        assert "body.step" in found.value.sentence()
        assert "meshes[0].file" in found.value.sentence()
    with pytest.raises(TestfieldError, match="leave it out"):
        loaded(tmp_path, text, unit="m")
    assert not "".join(capfd.readouterr()), "Open CASCADE speaks to nobody"


def test_without_the_extra_one_sentence_says_how_to_install_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cascadio", None)
    (tmp_path / "body.step").write_text(step(lambda add: box(add, (3, 4, 5)), "mm"))
    with pytest.raises(TestfieldError) as found:
        check_mesh_file(tmp_path / "body.step", "meshes[0].file")
    assert "pip install 'testfield[step]'" in found.value.sentence()
