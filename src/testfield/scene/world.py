"""The world: every surface, mark, light and station, true to the last digit. Only the truth's side may see it."""

from dataclasses import dataclass, field

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.motion import UNMOVED, Motion
from testfield.camera.optics import PINHOLE, Optics
from testfield.camera.pose import Poses
from testfield.scene import bend
from testfield.scene.sunflower import sunflower
from testfield.targets.board_pattern import Cells, Discs
from testfield.targets.field import Field
from testfield.targets.marks import RADII, USUAL, RingRadii

BOARD, BAR, CHECK = 0, 1, 2
"""What a mark serves: a board's layout, an end of a scale bar, a check target."""
CLEAN_POINTS = 4096
ROLES = ("board", "bar", "check")
MATT, GLOSS, RETRO, LUMINOUS = 0, 1, 2, 3
"""What the marks on a panel are made of; GLOSS is a coat on ink and ground."""
SMOOTHEST = 0.1
"""Width of a coat below which light that it throws on other panels has edges, which the fast renderer cannot carry."""
INKS = ("matt", "gloss", "retro", "luminous")


@dataclass(frozen=True)
class Panels:
    """Rectangles, flat or bent, the surfaces of the world: fronts and backs of boards, cards, floor, walls.

    `world_from_panel` (n) poses; the panel's frame has its origin in the middle, x right, y up, z out of the side
    that is seen. `size_mm` (n, 2); `ground_albedo`, `ink_albedo` (n,) diffuse reflectance beside and on the marks.
    `curvature_per_mm`, `bend_axis_rad` (n,) as in `bend.py`, where absent all panels are flat; x and y of a bent panel
    are those of its flat paper. `of_room` (n,) whether it belongs to the room, which stands still where the target
    moves; where absent none does. `ink` (n,) of MATT, GLOSS, RETRO, LUMINOUS, all matt where it is None.
    """

    name: tuple[str, ...]
    world_from_panel: Poses
    size_mm: np.ndarray
    ground_albedo: np.ndarray
    ink_albedo: np.ndarray
    curvature_per_mm: np.ndarray = None  # type: ignore[assignment]
    bend_axis_rad: np.ndarray = None  # type: ignore[assignment]
    of_room: np.ndarray = None  # type: ignore[assignment]
    ink: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, kind in (("curvature_per_mm", float), ("bend_axis_rad", float), ("of_room", bool)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(len(self.name), kind))

    def carry(self, ink: int) -> np.ndarray:
        """(n,) bool: which panels carry this ink."""
        return np.zeros(len(self), bool) if self.ink is None else self.ink == ink

    def __len__(self) -> int:
        return len(self.name)

    @property
    def bent(self) -> np.ndarray:
        """(n,) which panels are not flat."""
        return self.curvature_per_mm != 0

    def place(self, panel: np.ndarray, xy_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) in the world of paper coordinates (n, 2) on panels (n,), and the surface's frames there.

        Frames (n, 3, 3) have as columns the directions of paper x and paper y and the normal.
        """
        curve = self.curvature_per_mm[panel], self.bend_axis_rad[panel]
        poses = self.world_from_panel[panel]
        return poses.apply(bend.to_space(xy_mm, *curve)), poses.R @ bend.frames(xy_mm, *curve)


@dataclass(frozen=True)
class TrueMarks:
    """All marks where they really are.

    `panel` (n,) index; `xy_mm` (n, 2) on the panel; `diameter_mm`, `code` (0 plain), `role` (n,); `board` (n,) index
    of the board whose layout lists the mark, -1 for loose targets; `point` (n,) its index in that layout, or -1;
    `radii` the shape of every ring; `corner` (n,) which marks are corners of a `Print`, whose diameter is that of the
    circle in which nothing else is printed; where absent none is.
    """

    panel: np.ndarray
    xy_mm: np.ndarray
    diameter_mm: np.ndarray
    code: np.ndarray
    role: np.ndarray
    board: np.ndarray
    point: np.ndarray
    radii: RingRadii = RADII[USUAL]
    corner: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.corner is None:
            object.__setattr__(self, "corner", np.zeros(len(self.panel), bool))

    def __len__(self) -> int:
        return len(self.panel)

    @property
    def printed_radius_mm(self) -> np.ndarray:
        """(n,) radius of the circle that holds everything printed: the dot, or the ring's outer edge."""
        return self.diameter_mm / 2 * np.where(self.code > 0, self.radii.outer, 1.0)


@dataclass(frozen=True)
class Print:
    """Squares and tags on one `panel`: `cells` of its ink, in the panel's frame, and `discs` of tags that are round."""

    panel: int
    cells: Cells
    discs: Discs | None = None


@dataclass(frozen=True)
class Dirt:
    """Round spots over whatever is printed: `panel` (n,), `xy_mm` (n, 2) on it, `radius_mm`, `albedo` (n,)."""

    panel: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    xy_mm: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    radius_mm: np.ndarray = field(default_factory=lambda: np.zeros(0))
    albedo: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __len__(self) -> int:
        return len(self.panel)


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
class PointLight:
    """A light without size: `position_mm` (3,), `intensity_w_sr` alike in all directions."""

    position_mm: np.ndarray
    intensity_w_sr: float


@dataclass(frozen=True)
class Sky:
    """Light from all around: `radiance` (rows, columns) in W/(m^2 sr), equirectangular.

    Rows lead from the zenith to straight below; the middle column looks along `azimuth_rad` from +y, counter-clockwise
    seen from above, and columns go on to its right.
    """

    radiance: np.ndarray
    azimuth_rad: float = 0.0


@dataclass(frozen=True)
class RingFlash:
    """`points` equal point lights on a circle of `radius_mm` around the projection centre, square to the optical axis.

    Together they have `intensity_w_sr` along the axis, and cos^`falloff` of the angle from it elsewhere.
    """

    radius_mm: float
    points: int
    intensity_w_sr: float
    falloff: float

    def places_mm(self, camera_from_world: Poses, station: int) -> np.ndarray:
        """(points, 3) in the world."""
        angle = 2 * np.pi * (np.arange(self.points) + 0.5) / self.points
        ring = self.radius_mm * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(self.points)])
        return ring @ camera_from_world.R[station] + camera_from_world.origin_mm[station]


@dataclass(frozen=True)
class Retro:
    """Retro-reflective ink: R_A = `coefficient` 2^-(entrance / half)^4 2^-(observation / half)^2, in 1/sr.

    What retro-reflects lies `shift_mm` times the sine of the viewing angle from the print, towards the viewer.
    """

    coefficient: float
    half_entrance_rad: float
    half_observation_rad: float
    shift_mm: float = 0.0


@dataclass(frozen=True)
class Gloss:
    """A rough coat: GGX of width `alpha`, `reflectance` at normal incidence with Schlick's law."""

    alpha: float
    reflectance: float


@dataclass(frozen=True)
class World:
    """Everything that exists, in millimetres in the world frame (z up).

    `camera_from_world` (stations) poses, `interior` the true interior orientation, `psf_sigma_px` the optics' blur,
    `ambient_radiance` in W/(m^2 sr) from all around, `field` what the measuring side is told, `field_diagonal_mm` of
    the declared measuring volume, `meshes` bodies of other shapes than panels, `optics` depth of field, diffraction,
    vignetting, `motion` while the shutter is open: the world is as it stands in the middle of the exposure; `dirt`
    the spots on its panels; `prints` squares and tags, one at most on a panel. `point_lights`; `sky` in the place of
    `ambient_radiance`; `flash` of the camera; `retro`, `gloss` and `luminous_radiance` say what the panels' inks of
    these kinds are like.
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
    dirt: Dirt = Dirt()
    point_lights: tuple[PointLight, ...] = ()
    sky: Sky | None = None
    flash: RingFlash | None = None
    retro: Retro | None = None
    gloss: Gloss | None = None
    luminous_radiance: float = 0.0
    prints: tuple[Print, ...] = ()

    @property
    def mark_clean(self) -> np.ndarray:
        """(n,) part of each mark's printed circle that no dirt covers: 1 only where none touches it.

        Counted on a lattice of `CLEAN_POINTS` points, the same for every mark.
        """
        marks, dirt = self.marks, self.dirt
        clean = np.ones(len(marks))
        lattice = sunflower(CLEAN_POINTS)
        for m, reach in enumerate(marks.printed_radius_mm):
            offset = dirt.xy_mm - marks.xy_mm[m]
            near = (dirt.panel == marks.panel[m]) & (np.linalg.norm(offset, axis=1) < reach + dirt.radius_mm)
            if near.any():
                gap = np.linalg.norm(reach * lattice[:, None] - offset[near], axis=-1) - dirt.radius_mm[near]
                clean[m] = min(float((gap > 0).all(axis=1).mean()), 1 - 1 / CLEAN_POINTS)
        return clean

    @property
    def mark_world_mm(self) -> np.ndarray:
        """(n, 3) true positions of all marks in the world."""
        return self.panels.place(self.marks.panel, self.marks.xy_mm)[0]

    @property
    def mark_normal(self) -> np.ndarray:
        """(n, 3) unit normals of the surfaces under the marks, in the world."""
        return self.panels.place(self.marks.panel, self.marks.xy_mm)[1][:, :, 2]
