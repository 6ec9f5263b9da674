"""Plan and elevation of a field: boards, bars, targets, stations."""

from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from testfield.camera.project import directions
from testfield.report.style import ACCENT, FAINT, INK, WARM
from testfield.scene.world import BAR, CHECK, World

PLAN, ELEVATION = (0, 1), (0, 2)
CARD_MM = 150.0
"""Smaller panels are cards under single targets and would only hide what is drawn there."""


def draw_field(axes: Any, world: World, plane: tuple[int, int], stations: bool) -> None:
    """Draw a world's panels and targets, and its stations, projected on two of the world's axes, in metres."""
    marks = world.marks
    backs = {name for name in world.panels.name if name.endswith(" (back)")}
    for k, name in enumerate(world.panels.name):
        if name in backs or (not stations and world.panels.size_mm[k].max() < CARD_MM):
            continue
        half = world.panels.size_mm[k] / 2
        corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * half
        R, t = world.panels.world_from_panel.R[k], world.panels.world_from_panel.t_mm[k]
        outline = (corner @ R[:, :2].T + t)[:, plane] / 1000
        room = f"{name} (back)" not in backs
        axes.plot(*outline.T, color=FAINT if room else INK, lw=0.7 if room else 1.0, zorder=1 if room else 3)
    for mesh in world.meshes:
        flat = mesh.vertices_mm[:, plane] / 1000
        if np.linalg.matrix_rank(flat - flat[0], tol=1e-6) == 2:  # a flat mesh may be seen edge-on
            outline = flat[ConvexHull(flat).vertices]
            axes.fill(*outline.T, facecolor="none", edgecolor=FAINT, lw=1.0, zorder=2)
    boards = {sheet.name: t for sheet, t in zip(world.field.boards, world.world_from_board.t_mm, strict=True)}
    for name, t in boards.items():
        axes.annotate(name, t[list(plane)] / 1000, color=INK, weight="bold", ha="center", va="center", zorder=6)
    xyz = world.mark_world_mm[:, plane] / 1000
    for role, color, size in ((CHECK, WARM, 9), (BAR, ACCENT, 12)):
        axes.scatter(*xyz[marks.role == role].T, s=size, color=color, lw=0, zorder=5)
    eyes = world.camera_from_world.origin_mm
    if stations:
        axes.scatter(*(eyes[:, plane] / 1000).T, s=14, marker="s", color=INK, zorder=5)
        rays = directions(world.interior, world.interior.corners_px)
        for R, eye in zip(world.camera_from_world.R, eyes, strict=True):
            ends = eye + 600 * rays @ R
            for a, b in zip(ends, np.roll(ends, -1, axis=0), strict=True):
                axes.fill(*(np.array([eye, a, b])[:, plane] / 1000).T, color=ACCENT, alpha=0.10, lw=0)
    axes.set_aspect("equal")
    axes.set_xlabel(f"{'xyz'[plane[0]]}, m")
    axes.set_ylabel(f"{'xyz'[plane[1]]}, m")


def zoom(axes: Any, world: World, plane: tuple[int, int]) -> None:
    """Show what is measured and where from, not the whole room."""
    everything = np.vstack([world.mark_world_mm, world.camera_from_world.origin_mm])[:, plane] / 1000
    low, high = everything.min(axis=0), everything.max(axis=0)
    pad = 0.06 * (high - low).max()
    axes.set_xlim(low[0] - pad, high[0] + pad)
    axes.set_ylim(low[1] - pad, high[1] + pad)
