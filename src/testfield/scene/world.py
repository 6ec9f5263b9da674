"""The world: every surface, mark, light and station, true to the last digit. Only the truth's side may see it."""

from dataclasses import dataclass

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.pose import Poses
from testfield.targets.field import Field
from testfield.targets.marks import RADII, USUAL, RingRadii

BOARD, BAR, CHECK = 0, 1, 2
"""What a mark serves: a board's layout, an end of a scale bar, a check target."""
ROLES = ("board", "bar", "check")


@dataclass(frozen=True)
class Panels:
    """Flat rectangles, the surfaces of the world: fronts and backs of boards, cards, floor, walls.

    `world_from_panel` (n) poses; the panel's frame has its origin in the middle, x right, y up, z out of the side
    that is seen. `size_mm` (n, 2); `ground_albedo`, `ink_albedo` (n,) diffuse reflectance beside and on the marks.
    """

    name: tuple[str, ...]
    world_from_panel: Poses
    size_mm: np.ndarray
    ground_albedo: np.ndarray
    ink_albedo: np.ndarray

    def __len__(self) -> int:
        return len(self.name)


@dataclass(frozen=True)
class TrueMarks:
    """All marks where they really are.

    `panel` (n,) index; `xy_mm` (n, 2) on the panel; `diameter_mm`, `code` (0 plain), `role` (n,); `board` (n,) index
    of the board whose layout lists the mark, -1 for loose targets; `point` (n,) its index in that layout, or -1;
    `radii` the shape of every ring.
    """

    panel: np.ndarray
    xy_mm: np.ndarray
    diameter_mm: np.ndarray
    code: np.ndarray
    role: np.ndarray
    board: np.ndarray
    point: np.ndarray
    radii: RingRadii = RADII[USUAL]

    def __len__(self) -> int:
        return len(self.panel)

    @property
    def printed_radius_mm(self) -> np.ndarray:
        """(n,) radius of the circle that holds everything printed: the dot, or the ring's outer edge."""
        return self.diameter_mm / 2 * np.where(self.code > 0, self.radii.outer, 1.0)


@dataclass(frozen=True)
class AreaLight:
    """A rectangular diffuse emitter: `world_from_light` one pose (it shines along +z), radiance in W/(m^2 sr)."""

    world_from_light: Poses
    size_mm: tuple[float, float]
    radiance: float


@dataclass(frozen=True)
class World:
    """Everything that exists, in millimetres in the world frame (z up).

    `camera_from_world` (stations) poses, `interior` the true interior orientation, `psf_sigma_px` the optics' blur,
    `ambient_radiance` in W/(m^2 sr) from all around, `field` what the measuring side is told, `field_diagonal_mm` of
    the declared measuring volume.
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

    @property
    def mark_world_mm(self) -> np.ndarray:
        """(n, 3) true positions of all marks in the world."""
        xyz = np.column_stack([self.marks.xy_mm, np.zeros(len(self.marks))])
        return self.panels.world_from_panel[self.marks.panel].apply(xyz)

    @property
    def mark_normal(self) -> np.ndarray:
        """(n, 3) unit normals of the surfaces under the marks, in the world."""
        return self.panels.world_from_panel.R[self.marks.panel][:, :, 2]
