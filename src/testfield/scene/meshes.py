"""Mesh files become bodies in the world, whatever their format and unit."""

import io
from pathlib import Path

import numpy as np

from testfield.errors import TestfieldError
from testfield.scene.bodies import facing_outwards, solid_angles
from testfield.scene.mesh_files import check_mesh_file
from testfield.scene.named_files import named_file
from testfield.scene.room_parts import MeshPart
from testfield.scene.schema import SceneFile
from testfield.scene.step_files import STEP, as_glb, states_unit
from testfield.scene.world import TrueMesh

MM = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "ft": 304.8}
GLTF = (".glb", ".gltf")
COPIES = "meshes_as_run"
"""Folder in a run's folder with copies of the mesh files, named after the meshes."""
OUT_OF_SCALE = 1000.0


def load_meshes(scene: SceneFile) -> tuple[TrueMesh, ...]:
    """All meshes of a scene, placed in the world.

    Raises `TestfieldError` for a file that is missing, cannot be read or holds no faces, and for one whose bounding box
    is more than 1000 times, or less than 1/1000 of, the measuring volume's diagonal.
    """
    volume = float(np.linalg.norm(scene.volume.size_mm))
    return tuple(_load(part, scene.folder, f"meshes[{k}]", volume) for k, part in enumerate(scene.meshes))


def unit_of(part: MeshPart) -> str:
    """The unit of a mesh's coordinates: what the scene says; else metres for glTF, which defines it (2.0, section 3.4),
    and for STEP, which is read as such; mm for formats without a unit."""
    return part.unit or ("m" if Path(part.file).suffix.lower() in (*GLTF, *STEP) else "mm")


def mesh_path(part: MeshPart, folder: Path) -> Path:
    """Where a mesh's file is: as the scene names it or, in a run's folder, the copy made when it was run."""
    return named_file(part.file, copy_name(part), folder)


def copy_name(part: MeshPart) -> str:
    """Name of the copy of a mesh's file in a run's folder."""
    return f"{COPIES}/{part.name}{Path(part.file).suffix}"


def _load(part: MeshPart, folder: Path, where: str, volume_mm: float) -> TrueMesh:
    path = mesh_path(part, folder)
    vertices, faces = _read(path, f"{where}.file")
    if path.suffix.lower() in STEP:
        _step_unit(part, path, where)
    unit = unit_of(part)
    vertices = vertices * MM[unit]
    size = float(np.linalg.norm(vertices.max(axis=0) - vertices.min(axis=0)))
    if not volume_mm / OUT_OF_SCALE <= size <= volume_mm * OUT_OF_SCALE:
        raise TestfieldError(
            f"in '{unit}' the mesh {path} has a bounding box of {size:.4g} mm, and the measuring volume's "
            f"diagonal is {volume_mm:.4g} mm",
            f"{where}.unit",
            "give the unit of the file's coordinates",
        )
    faces, closed = facing_outwards(vertices, faces)
    placed = vertices @ turned(part.rotation_deg).T + np.array(part.position_mm)
    return TrueMesh(part.name, placed, faces, part.albedo, closed)


def _step_unit(part: MeshPart, path: Path, where: str) -> None:
    if not states_unit(path):
        raise TestfieldError(
            f"value '{path}': the STEP file states no unit of length", f"{where}.file", "export it again"
        )
    if part.unit is not None:
        raise TestfieldError(
            f"value '{part.unit}': a STEP file states its unit itself", f"{where}.unit", "leave it out"
        )


def turned(rotation_deg: tuple[float, float, float]) -> np.ndarray:
    """(3, 3) rotation about the world's x axis, then its y axis, then its z axis."""
    x, y, z = np.radians(rotation_deg)
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def _read(path: Path, where: str) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) and faces (f, 3) in the file's unit, in an order that the format has no part in."""
    import trimesh

    if not path.is_file():
        raise TestfieldError(f"value '{path}': no such mesh file", where, "paths are relative to the scene file")
    check_mesh_file(path, where)
    glb = as_glb(path, where) if path.suffix.lower() in STEP else None
    try:
        kind, source = path.suffix[1:].lower(), path if glb is None else io.BytesIO(glb)
        loaded = trimesh.load_mesh(source, file_type=kind if glb is None else "glb", process=False, skip_materials=True)
        vertices, faces = np.asarray(loaded.vertices, float), np.asarray(loaded.faces, int)
    except Exception as error:  # each format's reader fails in ways of its own
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:120]
        if isinstance(error, ImportError):  # a binary file that is cut short is taken for text in an unknown encoding
            reason = "it is damaged or cut short"
        raise TestfieldError(
            f"value '{path}': not a readable mesh ({reason})", where, "give an STL, OBJ, PLY, GLB or STEP file"
        ) from error
    triangles = vertices.shape[1:] == (3,) and faces.shape[1:] == (3,)
    sound = triangles and np.isfinite(vertices).all() and faces.min(initial=0) >= 0
    if len(faces) and not (sound and faces.max() < len(vertices)):
        raise TestfieldError(f"value '{path}': the mesh is damaged (its numbers make no triangles)", where, "mend it")
    # Formats differ in the order of vertices, in whether faces share them, and in the sign of a zero.
    vertices, number = np.unique(vertices.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    faces = number.reshape(-1)[faces.reshape(-1, 3)]
    a, b, c = np.moveaxis(vertices[faces], 1, 0) if len(faces) else np.zeros((3, 0, 3))
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0]
    if len(faces) == 0:
        raise TestfieldError(f"value '{path}': the mesh has no faces", where, "give a mesh of triangles")
    used, faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[used], faces.reshape(-1, 3)
    first = np.argmin(faces, axis=1)
    faces = np.take_along_axis(faces, (first[:, None] + np.arange(3)) % 3, axis=1)
    return vertices, faces[np.lexsort(faces.T[::-1])]


def inside(mesh: TrueMesh, points_mm: np.ndarray) -> np.ndarray:
    """(n,) whether points (n, 3) lie within a closed mesh, by the solid angle it fills; never within an open one."""
    if not mesh.closed:
        return np.zeros(len(points_mm), bool)
    return np.array([abs(solid_angles(mesh.corners_mm, point)) > np.pi for point in points_mm], bool)
