"""The world: every surface, mark, light and station, true to the last digit. Only the truth's side may see it."""

from dataclasses import dataclass, field

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.motion import UNMOVED, Motion
from testfield.camera.optics import PINHOLE, Optics
from testfield.camera.pose import Poses
from testfield.targets.field import Field
from testfield.targets.marks import RING_OUTER

BOARD, BAR, CHECK = 0, 1, 2
"""What a mark serves: a board's layout, an end of a scale bar, a check target."""
ROLES = ("board", "bar", "check")


@dataclass(frozen=True)
class Panels:
    """Flat rectangles, the surfaces of the world: fronts and backs of boards, cards, floor, walls.

    `world_from_panel` (n) poses; the panel's frame has its origin in the middle, x right, y up, z out of the side
    that is seen. `size_mm` (n, 2); `ground_albedo`, `ink_albedo` (n,) diffuse reflectance beside and on the marks;
    `of_room` (n,) whether it belongs to the room, which stands still where the target moves; absent for none.
    """

    name: tuple[str, ...]
    world_from_panel: Poses
    size_mm: np.ndarray
    ground_albedo: np.ndarray
    ink_albedo: np.ndarray
    of_room: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True)
class TrueMarks:
    """All marks where they really are.

    `panel` (n,) index; `xy_mm` (n, 2) on the panel; `diameter_mm`, `code` (0 plain), `role` (n,); `board` (n,) index
    of the board whose layout lists the mark, -1 for loose targets; `point` (n,) its index in that layout, or -1.
    """

    panel: np.ndarray
    xy_mm: np.ndarray
    diameter_mm: np.ndarray
    code: np.ndarray
    role: np.ndarray
    board: np.ndarray
    point: np.ndarray

    def __len__(self) -> int:
        return len(self.panel)

    @property
    def printed_radius_mm(self) -> np.ndarray:
        """(n,) radius of the circle that holds everything printed: the dot, or the ring's outer edge."""
        return self.diameter_mm / 2 * np.where(self.code > 0, RING_OUTER, 1.0)


@dataclass(frozen=True)
class AreaLight:
    """A rectangular diffuse emitter: `world_from_light` one pose (it shines along +z), radiance in W/(m^2 sr)."""

    world_from_light: Poses
    size_mm: tuple[float, float]
    radiance: float


@dataclass(frozen=True, eq=False)
class TrueMesh:
    """A matt body of triangles, flat each, in the world.

    `vertices_mm` (v, 3); `faces` (f, 3) indices of vertices, counter-clockwise seen from outside; `albedo` diffuse
    reflectance; `closed` whether it bounds a volume: of other meshes both sides are seen.
    """

    name: str
    vertices_mm: np.ndarray
    faces: np.ndarray
    albedo: float
    closed: bool

    @property
    def corners_mm(self) -> np.ndarray:
        """(f, 3, 3) the corners of every face."""
        return self.vertices_mm[self.faces]

    @property
    def normals(self) -> np.ndarray:
        """(f, 3) unit normals of the faces."""
        a, b, c = np.moveaxis(self.corners_mm, 1, 0)
        normal = np.cross(b - a, c - a)
        return normal / np.linalg.norm(normal, axis=1, keepdims=True)

    @property
    def sphere(self) -> tuple[np.ndarray, float]:
        """A sphere around it: centre (3,) and radius, in mm."""
        centre = (self.vertices_mm.min(axis=0) + self.vertices_mm.max(axis=0)) / 2
        return centre, float(np.linalg.norm(self.vertices_mm - centre, axis=1).max())


@dataclass(frozen=True)
class World:
    """Everything that exists, in millimetres in the world frame (z up).

    `camera_from_world` (stations) poses, `interior` the true interior orientation, `psf_sigma_px` the optics' blur,
    `ambient_radiance` in W/(m^2 sr) from all around, `field` what the measuring side is told, `field_diagonal_mm` of
    the declared measuring volume, `meshes` bodies of other shapes than panels, `optics` depth of field, diffraction,
    vignetting, `motion` while the shutter is open: the world is as it stands in the middle of the exposure.
    """

    name: str
    seed: int
    field_diagonal_mm: float
    panels: Panels
    marks: TrueMarks
    world_from_board: Poses
    station_name: tuple[str, ...]
    camera_from_world: Poses
    interior: Interior
    psf_sigma_px: float
    lights: tuple[AreaLight, ...]
    ambient_radiance: float
    field: Field
    meshes: tuple[TrueMesh, ...] = ()
    optics: Optics = PINHOLE
    motion: Motion = UNMOVED

    @property
    def mark_world_mm(self) -> np.ndarray:
        """(n, 3) true positions of all marks in the world."""
        xyz = np.column_stack([self.marks.xy_mm, np.zeros(len(self.marks))])
        return self.panels.world_from_panel[self.marks.panel].apply(xyz)

    @property
    def mark_normal(self) -> np.ndarray:
        """(n, 3) unit normals of the surfaces under the marks, in the world."""
        return self.panels.world_from_panel.R[self.marks.panel][:, :, 2]
