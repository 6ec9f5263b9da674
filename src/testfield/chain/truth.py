"""The truth of a run, camera by camera and of all together."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.scene.build import build_world
from testfield.scene.check import check_parts
from testfield.scene.join import joined_views, joined_world, order_of
from testfield.scene.parts import ScenePart, parts_of, told_field
from testfield.scene.schema import SceneFile
from testfield.scene.truth import Views, see
from testfield.scene.world import World
from testfield.targets.field import Field


@dataclass(frozen=True)
class Truth:
    """`parts` of a scene, each of one camera at one time, and the `worlds` that they see."""

    scene: SceneFile
    parts: tuple[ScenePart, ...]
    worlds: tuple[World, ...]

    @staticmethod
    def of(scene: SceneFile, source: str) -> "Truth":
        """The truth of a scene, called `source` in messages."""
        try:
            parts = parts_of(scene)
            return Truth(scene, parts, tuple(build_world(part.scene) for part in parts))
        except TestfieldError as error:
            raise TestfieldError(error.what, f"{source}, {error.where}", error.do) from error

    @property
    def several(self) -> bool:
        """Whether there are several cameras or times."""
        return bool(self.parts[0].images)

    @cached_property
    def told(self) -> Field:
        """What the measuring side is told."""
        return told_field(self.scene, self.worlds[0].field) if self.several else self.worlds[0].field

    @cached_property
    def world(self) -> World:
        """The world with all images; `interior` and its like are the first camera's."""
        return joined_world(self.parts, self.worlds, self.told) if self.several else self.worlds[0]

    @cached_property
    def views_of_parts(self) -> tuple[Views, ...]:
        """What is truly seen in the images of each part."""
        return tuple(see(world) for world in self.worlds)

    @cached_property
    def views(self) -> Views:
        """What is truly seen in all images, by the marks of `world`."""
        if not self.several:
            return self.views_of_parts[0]
        return joined_views(self.parts, self.worlds, self.views_of_parts)

    @property
    def cameras(self) -> dict[str, World]:
        """By name, the world as each camera sees it at the first time."""
        found: dict[str, World] = {}
        for part, world in zip(self.parts, self.worlds, strict=True):
            found.setdefault(part.camera, world)
        return found

    @property
    def largest_px(self) -> tuple[int, int]:
        """Width and height that no image exceeds."""
        cameras = [part.scene.camera for part in self.parts]
        return max(one.width_px for one in cameras), max(one.height_px for one in cameras)

    def images(self) -> Iterator[tuple[ScenePart, World, int, str]]:
        """Every image: its part and world, its number and its name there."""
        for part, world in zip(self.parts, self.worlds, strict=True):
            for k, name in enumerate(world.station_name):
                yield part, world, k, name

    def by_cameras(self, observations: Observations) -> Observations:
        """Observations of all images, with their cameras, places and times where there are several."""
        if not self.several:
            return observations
        plans = order_of(self.parts)
        times = tuple(plan.time for plan in plans)
        return observations.by(
            tuple(plan.camera for plan in plans), tuple(plan.place for plan in plans), times if any(times) else ()
        )

    def check(self, source: str) -> list[str]:
        """Warnings. Raises `TestfieldError` for what makes the scene impossible."""
        parts = list(zip(self.parts, self.worlds, self.views_of_parts, strict=True))
        return check_parts(self.scene, parts, self.world, self.views, source)
