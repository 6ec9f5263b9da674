"""The world: every surface, mark, light and station, true to the last digit. Only the truth's side may see it."""

from dataclasses import dataclass

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.targets.field import Field
from testfield.targets.marks import RING_OUTER

BOARD, BAR, CHECK = 0, 1, 2
"""What a mark serves: a board's layout, an end of a scale bar, a check target."""
ROLES = ("board", "bar", "check")
MATT, GLOSS, RETRO, LUMINOUS = 0, 1, 2, 3
"""What the marks on a panel are made of; GLOSS is a coat on ink and ground."""
SMOOTHEST = 0.1
"""Width of a coat below which light that it throws on other panels has edges, which the fast renderer cannot carry."""
INKS = ("matt", "gloss", "retro", "luminous")


@dataclass(frozen=True)
class Panels:
    """Flat rectangles, the surfaces of the world: fronts and backs of boards, cards, floor, walls.

    `world_from_panel` (n) poses; the panel's frame has its origin in the middle, x right, y up, z out of the side
    that is seen. `size_mm` (n, 2); `ground_albedo`, `ink_albedo` (n,) diffuse reflectance beside and on the marks;
    `ink` (n,) of MATT, GLOSS, RETRO, LUMINOUS, all matt where it is None.
    """

    name: tuple[str, ...]
    world_from_panel: Poses
    size_mm: np.ndarray
    ground_albedo: np.ndarray
    ink_albedo: np.ndarray
    ink: np.ndarray | None = None

    def carry(self, ink: int) -> np.ndarray:
        """(n,) bool: which panels carry this ink."""
        return np.zeros(len(self), bool) if self.ink is None else self.ink == ink

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
    the declared measuring volume. `point_lights`; `sky` in the place of `ambient_radiance`; `flash` of the camera;
    `retro`, `gloss` and `luminous_radiance` say what the panels' inks of these kinds are like.
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
    point_lights: tuple[PointLight, ...] = ()
    sky: Sky | None = None
    flash: RingFlash | None = None
    retro: Retro | None = None
    gloss: Gloss | None = None
    luminous_radiance: float = 0.0

    @property
    def mark_world_mm(self) -> np.ndarray:
        """(n, 3) true positions of all marks in the world."""
        xyz = np.column_stack([self.marks.xy_mm, np.zeros(len(self.marks))])
        return self.panels.world_from_panel[self.marks.panel].apply(xyz)

    @property
    def mark_normal(self) -> np.ndarray:
        """(n, 3) unit normals of the surfaces under the marks, in the world."""
        return self.panels.world_from_panel.R[self.marks.panel][:, :, 2]
