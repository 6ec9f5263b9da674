"""Panels and marks while a world is put together."""

import numpy as np

from testfield.camera.pose import Poses
from testfield.scene.fields import Ink
from testfield.scene.schema import SceneFile
from testfield.scene.world import (
    INKS,
    MATT,
    Panels,
    Print,
    TrueMarks,
)
from testfield.targets.marks import RingRadii


class Assembly:
    """Panels and marks while a world is put together."""

    def __init__(self, scene: SceneFile):
        paint = scene.paint
        self.black, self.white, self.back = paint.black, paint.white, paint.back
        self.white_on_black = paint.white_on_black
        self.ink, self.retro_matt = paint.ink, paint.retro.matt
        self.panels: list[tuple] = []
        self.marks: list[tuple] = []
        self.prints: list[Print] = []

    def panel(
        self,
        name: str,
        R: np.ndarray,
        t: np.ndarray,
        size: tuple,
        thickness: float,
        made_of: Ink | None = None,
        curvature: float = 0.0,
        axis_rad: float = 0.0,
        black_on_white: bool = False,
    ) -> int:
        """A printed front and its plain back, bent alike; returns the front's index. The rest as in `sticker`."""
        front = self.sticker(name, R, t, size, made_of, curvature, axis_rad, black_on_white)
        behind = np.column_stack([-R[:, 0], R[:, 1], -R[:, 2]])
        # The back is bent about the same axis in space, so it is that much shorter (or longer) across it.
        shrink = 1 - thickness * curvature
        across = np.array([np.sin(axis_rad), np.cos(axis_rad)]) ** 2
        back_size = np.array(size) * (1 + (shrink - 1) * across)
        self.panels.append(
            (
                f"{name} (back)",
                behind,
                t - thickness * R[:, 2],
                back_size,
                self.back,
                self.back,
                -curvature / shrink,
                np.pi - axis_rad,
                MATT,
            )
        )
        return front

    def sticker(
        self,
        name: str,
        R: np.ndarray,
        t: np.ndarray,
        size: tuple,
        made_of: Ink | None = None,
        curvature: float = 0.0,
        axis_rad: float = 0.0,
        black_on_white: bool = False,
    ) -> int:
        """A printed front alone; returns its index. `made_of` is the ink, paint.ink if None.

        `black_on_white`: whatever the scene's paint is.
        """
        white_on_black = self.white_on_black and not black_on_white
        ground, ink = (self.black, self.white) if white_on_black else (self.white, self.black)
        made_of = made_of or self.ink
        ink = self.retro_matt if made_of == "retro" else ink
        self.panels.append((name, R, t, size, ground, ink, curvature, axis_rad, INKS.index(made_of)))
        return len(self.panels) - 1

    def mark(
        self,
        panel: int,
        xy: np.ndarray,
        diameter: float,
        code: int,
        role: int,
        board: int = -1,
        point: int = -1,
        corner: bool = False,
    ) -> None:
        """One mark at its true place on a panel."""
        self.marks.append((panel, xy, diameter, code, role, board, point, corner))


def panels_of(parts: Assembly, carried: int) -> Panels:
    """All panels, the first `carried` of which belong to the target and the rest to the room."""
    name, R, t, size, *rest = zip(*parts.panels, strict=True)
    ground, ink, curvature, axis, made_of = (np.array(column) for column in rest)
    of_room = np.arange(len(name)) >= carried
    poses, kinds = Poses(np.array(R), np.array(t)), made_of if made_of.any() else None
    return Panels(
        name=name,
        world_from_panel=poses,
        size_mm=np.array(size, float),
        ground_albedo=ground,
        ink_albedo=ink,
        curvature_per_mm=curvature,
        bend_axis_rad=axis,
        of_room=of_room,
        ink=kinds,
    )


def marks_of(parts: Assembly, radii: RingRadii) -> TrueMarks:
    """All marks, with the shape that their rings share."""
    panel, xy, diameter, *rest = zip(*parts.marks, strict=True)
    code, role, board, point, corner = (np.array(v, int) for v in rest)
    return TrueMarks(
        panel=np.array(panel),
        xy_mm=np.array(xy, float),
        diameter_mm=np.array(diameter, float),
        code=code,
        role=role,
        board=board,
        point=point,
        radii=radii,
        corner=corner.astype(bool),
    )
