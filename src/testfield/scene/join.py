"""The truth of several parts of a scene as one world, with the views of all images."""

from dataclasses import fields, replace
from typing import Any

import numpy as np

from testfield.camera.pose import Poses
from testfield.scene.parts import ImagePlan, ScenePart
from testfield.scene.truth import Views
from testfield.scene.world import BAR, Panels, TrueMarks, World
from testfield.targets.field import Field, code_at


def joined_world(parts: tuple[ScenePart, ...], worlds: tuple[World, ...], told: Field) -> World:
    """One world of all images: `interior` and what else belongs to a camera are those of the first part, so whoever
    asks for them asks the parts. Targets that moved are there once for every time, under codes of their own."""
    images, times = order_of(parts), 1 + max(part.time for part in parts)
    first = next(world for part, world in zip(parts, worlds, strict=True) if part.time == 0)
    panels, marks = first.panels, first.marks
    for time in range(1, times):
        world = next(w for part, w in zip(parts, worlds, strict=True) if part.time == time)
        moved = moved_marks(first, world)
        own = np.unique(world.marks.panel[moved])
        place = np.full(len(world.panels), -1)
        place[own] = len(panels) + np.arange(len(own))
        added = _taken(world.marks, moved)
        panels, marks = (
            _panels(panels, world.panels, own),
            _marks(marks, replace(added, panel=place[added.panel], code=code_at(added.code, time))),
        )
    return replace(
        first,
        panels=panels,
        marks=marks,
        station_name=tuple(plan.name for plan in images),
        camera_from_world=Poses.join([plan.at for plan in images]),
        field=told.at_times(times),
    )


def order_of(parts: tuple[ScenePart, ...]) -> list[ImagePlan]:
    """All images, part by part."""
    return [plan for part in parts for plan in part.images]


def moved_marks(first: World, later: World) -> np.ndarray:
    """Numbers of the marks that lie elsewhere at a later time."""
    off = np.abs(later.mark_world_mm - first.mark_world_mm).max(axis=1)
    return np.flatnonzero((first.marks.role == BAR) & (off > 0))


def joined_views(parts: tuple[ScenePart, ...], worlds: tuple[World, ...], views: tuple[Views, ...]) -> Views:
    """Views of all images by the marks of the joined world; what is elsewhere at an image's time is not seen in it."""
    first = next(world for part, world in zip(parts, worlds, strict=True) if part.time == 0)
    times = 1 + max(part.time for part in parts)
    moved = {0: np.zeros(0, int)}
    for time in range(1, times):
        later = next(w for part, w in zip(parts, worlds, strict=True) if part.time == time)
        moved[time] = moved_marks(first, later)
    begin = len(first.marks) + np.cumsum([0, *(len(moved[t]) for t in range(1, times))])
    total = int(begin[-1])
    whole: dict[str, list[np.ndarray]] = {f.name: [] for f in fields(Views) if f.name != "clean"}
    for part, seen in zip(parts, views, strict=True):
        there = np.arange(len(first.marks))
        if part.time:
            there[moved[part.time]] = begin[part.time - 1] + np.arange(len(moved[part.time]))
        for name, rows in whole.items():
            own = getattr(seen, name)
            wide = np.full((len(own), total, *own.shape[2:]), 0.0 if name == "visible" else np.nan)
            wide[:, there] = own
            rows.append(wide)
    clean_later = [views[0].clean[moved[t]] for t in range(1, times)]
    return Views(
        **{name: np.concatenate(rows) for name, rows in whole.items()},
        clean=np.concatenate([views[0].clean, *clean_later]),
    )


def _taken(marks: TrueMarks, rows: np.ndarray) -> TrueMarks:
    columns: dict[str, Any] = {name: getattr(marks, name)[rows] for name in MARK_COLUMNS}
    return replace(marks, **columns)


def _marks(a: TrueMarks, b: TrueMarks) -> TrueMarks:
    columns: dict[str, Any] = {name: np.concatenate([getattr(a, name), getattr(b, name)]) for name in MARK_COLUMNS}
    return replace(a, **columns)


MARK_COLUMNS = ("panel", "xy_mm", "diameter_mm", "code", "role", "board", "point", "corner")


def _panels(a: Panels, b: Panels, rows: np.ndarray) -> Panels:
    """Panels, and those of others in some rows."""
    columns = ("size_mm", "ground_albedo", "ink_albedo", "curvature_per_mm", "bend_axis_rad", "of_room")
    joined = {name: np.concatenate([getattr(a, name), getattr(b, name)[rows]]) for name in columns}
    ink = None if a.ink is None or b.ink is None else np.concatenate([a.ink, b.ink[rows]])
    return replace(
        a,
        name=(*a.name, *(b.name[k] for k in rows)),
        world_from_panel=Poses.join([a.world_from_panel, b.world_from_panel[rows]]),
        ink=ink,
        **joined,
    )
