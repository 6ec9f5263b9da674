"""A scene as a planning job: what every image may expect to see, and to which cameras and places unknowns belong."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from testfield.adjust.network import Camera
from testfield.calibrate.imaging import Imaging, imaging_of
from testfield.calibrate.looks import one_camera
from testfield.camera.interior import Interior, check_held
from testfield.camera.lens import lens_model
from testfield.camera.pose import Poses
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.scene.build import build_world
from testfield.scene.join import joined_world, moved_marks, order_of
from testfield.scene.parts import ScenePart, parts_of, told_field
from testfield.scene.schema import SceneFile
from testfield.scene.world import World
from testfield.simulate.expected import Expected, Expecting
from testfield.targets.field import Field


@dataclass(frozen=True)
class Job:
    """A scene, called `source` in messages, with its `parts` of one camera each and the `worlds` that they see.

    `told` is what the measuring side is told, `expected` all observations by image and by the marks of `world`.
    """

    scene: SceneFile
    source: str
    parts: tuple[ScenePart, ...]
    worlds: tuple[World, ...]
    told: Field
    world: World
    expecting: tuple[Expecting, ...]
    expected: Expected

    @staticmethod
    def of(scene: SceneFile, source: str) -> "Job":
        """The job of a scene. Raises `TestfieldError` where it is impossible, naming file and field."""
        try:
            parts = parts_of(scene)
            worlds = tuple(build_world(part.scene) for part in parts)
        except TestfieldError as error:
            raise TestfieldError(error.what, f"{source}, {error.where}", error.do) from error
        expecting = tuple(Expecting(part.scene, world) for part, world in zip(parts, worlds, strict=True))
        seen = tuple(one.at(world.camera_from_world) for one, world in zip(expecting, worlds, strict=True))
        if not parts[0].images:
            told = worlds[0].field
            return Job(scene, source, parts, worlds, told, worlds[0], expecting, seen[0])
        told = told_field(scene, worlds[0].field)
        world = joined_world(parts, worlds, told)
        return Job(scene, source, parts, worlds, told, world, expecting, _joined(parts, worlds, seen))

    @property
    def several(self) -> bool:
        """Whether there are several cameras or times."""
        return bool(self.parts[0].images)

    @property
    def field(self) -> Field:
        """What the measuring side is told, every moved bar once for each time."""
        return self.world.field

    @property
    def images(self) -> tuple[str, ...]:
        """Names of the images."""
        return self.world.station_name

    @cached_property
    def imaging(self) -> Imaging:
        """Which camera takes which image from where."""
        if len(self.told.cameras) == 1 and not self.told.rigs:
            camera = self.told.cameras[0]
            alone = one_camera(self.images, camera.width_px, camera.height_px, self.lens_of(camera.lens))
            if not self.several:
                return alone
        sheets = tuple(replace(camera, lens=self.lens_of(camera.lens)) for camera in self.told.cameras)
        how = str(self.scene.measure.calibrator_options.get("rigs", "constrained"))
        return imaging_of(self.observations, sheets, self.told.rigs, how)

    @cached_property
    def cameras(self) -> tuple[Camera, ...]:
        """Interior orientations as unknowns, at the true values of what is calibrated."""
        check_held(self.scene.measure.hold, self.imaging.cameras[0].lens)
        found = []
        for sheet in self.imaging.cameras:
            part = next(k for k, part in enumerate(self.parts) if part.camera == sheet.name or not self.several)
            interior = _of_lens(self.worlds[part].interior, sheet.lens, self.scene.measure.hold)
            found.append(
                Camera.of(interior, np.array([name not in self.scene.measure.hold for name in interior.names]))
            )
        return tuple(found)

    def lens_of(self, own: str) -> str:
        """The lens model that is calibrated."""
        return self.scene.measure.lens or own

    @cached_property
    def observations(self) -> Observations:
        """The expected observations as detection would hand them on, free of noise."""
        rows, marks = self.expected, self.world.marks
        n = len(rows)
        found = Observations(
            stations=self.images,
            station=rows.station,
            xy_px=rows.xy_px,
            cov_px2=rows.cov_px2,
            moments_px2=(rows.diameter_px / 4)[:, None, None] ** 2 * np.eye(2),
            code=marks.code[rows.mark],
            board=marks.board[rows.mark],
            point=marks.point[rows.mark],
            chi2=np.ones(n),
            status=np.full(n, MEASURED, object),
            centre_of_disc=False,
        )
        if not self.several:
            return found
        plans = order_of(self.parts)
        times = tuple(plan.time for plan in plans)
        cameras, places = tuple(plan.camera for plan in plans), tuple(plan.place for plan in plans)
        return found.by(cameras, places, times if any(times) else ())

    @property
    def poses(self) -> Poses:
        """Camera-from-world poses of all images."""
        return self.world.camera_from_world


def _of_lens(true: Interior, lens: str, hold: tuple[str, ...]) -> Interior:
    """The true camera as a lens model sees it: coefficients of the same name are taken over, the others are those of a
    pinhole; what is held is zero."""
    own = dict(zip(true.names, true.parameters.tolist(), strict=True))
    model = lens_model(lens)
    plain = dict(zip(("fx", "fy", "cx", "cy", *model.coefficients), [0, 0, 0, 0, *model.pinhole], strict=True))
    values = [0.0 if name in hold else own.get(name, value) for name, value in plain.items()]
    return Interior(true.width_px, true.height_px, np.array(values, float), lens)


def _joined(parts: tuple[ScenePart, ...], worlds: tuple[World, ...], seen: tuple[Expected, ...]) -> Expected:
    """Expectations of all parts by the images and marks of the joined world: at a later time what has moved is a mark
    of its own."""
    first = next(world for part, world in zip(parts, worlds, strict=True) if part.time == 0)
    later = {part.time: world for part, world in zip(parts, worlds, strict=True) if part.time}
    moved = {time: moved_marks(first, world) for time, world in sorted(later.items())}
    begin = dict(zip(moved, len(first.marks) + np.cumsum([0, *(len(m) for m in moved.values())]), strict=False))
    rows, images = [], 0
    for part, own in zip(parts, seen, strict=True):
        there = np.arange(len(first.marks))
        if part.time:
            there[moved[part.time]] = begin[part.time] + np.arange(len(moved[part.time]))
        rows.append(replace(own, station=own.station + images, mark=there[own.mark]))
        images += len(part.images)
    return Expected.join(rows)
