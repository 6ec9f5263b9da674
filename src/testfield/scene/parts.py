"""A scene of several cameras and times as one scene of one camera for each of them, which all else can do.

What the cameras and times share, down to every drawn print error, is the same in all parts, for it is drawn by name.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testfield.camera.pose import Poses, rotation, rotation_vector
from testfield.errors import TestfieldError, nearest
from testfield.scene import generators
from testfield.scene.camera_parts import CameraPart, RigPart
from testfield.scene.schema import SceneFile
from testfield.scene.station_parts import StationPose
from testfield.seeds import normals, seed_of
from testfield.targets.camera_sheet import DEFAULT_CAMERA, CameraSheet, RelativePose, RigSheet
from testfield.targets.field import Field


@dataclass(frozen=True)
class ImagePlan:
    """An image to be taken: by which `camera`, from which `place`, at which `time`; its pose `at`."""

    name: str
    camera: str
    place: str
    time: int
    at: Poses


@dataclass(frozen=True)
class ScenePart:
    """What one camera sees at one time: a scene of that camera alone, its images, the seed of its sensor's patterns."""

    camera: str
    time: int
    scene: SceneFile
    images: tuple[ImagePlan, ...]
    sensor_seed: int


def parts_of(scene: SceneFile) -> tuple[ScenePart, ...]:
    """The parts of a scene, by camera and then by time.

    A scene of one camera whose bars stay where they are is its own only part. Raises `TestfieldError`, naming the
    field, for names that do not fit together.
    """
    times = times_of(scene)
    if not scene.cameras and times == 1:
        _no_rigs(scene)
        return (ScenePart(DEFAULT_CAMERA, 0, scene, (), scene.seed),)
    plans, found = image_plans(scene), []
    for name in names_of(scene):
        for time in range(times):
            own = tuple(plan for plan in plans if (plan.camera, plan.time) == (name, time))
            if own:
                seed = scene.seed if not scene.cameras else seed_of(scene.seed, f"camera/{name}")
                found.append(ScenePart(name, time, _alone(scene, name, time, own), own, seed))
    return tuple(found)


def names_of(scene: SceneFile) -> tuple[str, ...]:
    """Names of the cameras."""
    return tuple(camera.name for camera in scene.cameras) or (DEFAULT_CAMERA,)


def times_of(scene: SceneFile) -> int:
    """How often every camera takes an image."""
    return 1 + max((len(bar.moves) for bar in scene.scale_bars), default=0)


def image_plans(scene: SceneFile) -> list[ImagePlan]:
    """All images: station by station, camera by camera, time by time."""
    _names_fit(scene)
    times, rigs = times_of(scene), {rig.name: rig for rig in scene.rigs}
    places, R, t = generators.stations(scene.stations, scene.seed)
    owners = [part for part in scene.stations for _ in range(_count(part))]
    plans = []
    for k, (place, owner) in enumerate(zip(places, owners, strict=True)):
        at = Poses(R[k : k + 1], t[k : k + 1])
        if owner.rig:
            members = member_poses(rigs[owner.rig])
            held = [(one.camera, members[m : m + 1].after(at)) for m, one in enumerate(rigs[owner.rig].cameras)]
        else:
            held = [(owner.camera or names_of(scene)[0], at)]
        for camera, pose in held:
            name = f"{place}-{camera}" if owner.rig else place
            for time in range(times):
                timed = f"{name}-t{time:02d}" if times > 1 else name
                plans.append(ImagePlan(timed, camera, place, time, pose))
    return plans


def member_poses(rig: RigPart) -> Poses:
    """Camera-from-rig poses of a rig's cameras."""
    R = np.swapaxes(rotation(np.radians([one.rotation_deg for one in rig.cameras])), 1, 2)
    centre = np.array([one.position_mm for one in rig.cameras], float)
    return Poses(R, -np.einsum("nij,nj->ni", R, centre))


def relative_poses(rig: RigPart) -> Poses:
    """The true poses of a rig's cameras relative to its first one."""
    members = member_poses(rig)
    first = members[np.zeros(len(members), int)]
    return members.after(first.inverse())


def camera_sheets(scene: SceneFile) -> tuple[tuple[CameraSheet, ...], tuple[RigSheet, ...]]:
    """What the field sheet says of cameras and rigs; stated poses differ from the true ones by drawn errors."""
    cameras: list[tuple[str, CameraPart]] = [(camera.name, camera) for camera in scene.cameras]
    cameras = cameras or [(DEFAULT_CAMERA, scene.camera)]
    sheets = tuple(CameraSheet(name, one.width_px, one.height_px, one.lens) for name, one in cameras)
    return sheets, tuple(_rig_sheet(rig, scene.seed) for rig in scene.rigs)


def _rig_sheet(rig: RigPart, seed: int) -> RigSheet:
    true = relative_poses(rig)
    stated: list[RelativePose | None] = []
    for k, member in enumerate(rig.cameras):
        if k == 0 or member.u_position_mm is None or member.u_rotation_deg is None:
            stated.append(None)
            continue
        off = normals(seed, f"rig/{rig.name}/{member.camera}", 6)[:, 0]
        u_turn = float(np.radians(member.u_rotation_deg))
        R = rotation(u_turn * off[None, :3])[0] @ true.R[k]
        t = true.t_mm[k] + member.u_position_mm * off[3:]
        stated.append(RelativePose(_triple(rotation_vector(R[None])[0]), _triple(t), u_turn, member.u_position_mm))
    return RigSheet(rig.name, tuple(one.camera for one in rig.cameras), tuple(stated))


def told_field(scene: SceneFile, field: Field) -> Field:
    """The field sheet of a scene with several cameras, of the one that its parts share."""
    cameras, rigs = camera_sheets(scene)
    bars = tuple(
        replace(bar, moved=bool(part.moves)) for bar, part in zip(field.scale_bars, scene.scale_bars, strict=True)
    )
    return replace(field, cameras=cameras, rigs=rigs, scale_bars=bars)


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _alone(scene: SceneFile, name: str, time: int, images: tuple[ImagePlan, ...]) -> SceneFile:
    """The scene with one camera, its own images, and bars where they lie at a time."""
    changed: dict[str, Any] = {"cameras": (), "rigs": (), "stations": tuple(_station(plan) for plan in images)}
    for camera in scene.cameras:
        if camera.name == name:
            own = {field: getattr(camera, field) for field in CameraPart.model_fields}
            changed |= {"camera": CameraPart.model_construct(**own)}
            changed |= {"sensor": camera.sensor} if camera.sensor else {}
            changed |= {"exposure": camera.exposure} if camera.exposure else {}
    bars = []
    for bar in scene.scale_bars:
        move = bar.moves[time - 1] if 0 < time <= len(bar.moves) else None
        place = {} if move is None else {key: getattr(move, key) for key in ("position_mm", "direction", "normal")}
        bars.append(bar.model_copy(update=place | {"moves": ()}))
    return scene.model_copy(update=changed | {"scale_bars": tuple(bars)}).in_folder(scene.folder)


def _station(plan: ImagePlan) -> StationPose:
    x, y, z = np.degrees(rotation_vector(plan.at.R)[0]).tolist()
    a, b, c = plan.at.origin_mm[0].tolist()
    return StationPose(generator="pose", name=plan.name, position_mm=(a, b, c), rotation_deg=(x, y, z))


def _count(part: Any) -> int:
    from testfield.scene.sizes import stations_of

    return stations_of(part)


def _no_rigs(scene: SceneFile) -> None:
    if scene.rigs:
        raise TestfieldError("a rig holds cameras, and the scene has no [[cameras]]", "rigs", "declare them by name")
    for k, part in enumerate(scene.stations):
        if part.rig or part.camera not in (None, DEFAULT_CAMERA):
            raise TestfieldError(
                f"value '{part.rig or part.camera}': the scene has no [[cameras]]",
                f"stations[{k}]",
                "declare cameras by name, or leave it out",
            )


def _names_fit(scene: SceneFile) -> None:
    """Refuse names that occur twice or belong to nothing."""
    if not scene.cameras:
        _no_rigs(scene)
        return
    if scene.camera != type(scene.camera)() and "camera" in scene.model_fields_set:
        raise TestfieldError("there are [camera] and [[cameras]]", "camera", "keep one of them")
    known, rigs = names_of(scene), [rig.name for rig in scene.rigs]
    for label, names in (("cameras", known), ("rigs", rigs)):
        for k, name in enumerate(names):
            if name in names[:k]:
                raise TestfieldError(f"'{name}' occurs twice", f"{label}[{k}].name", "rename one")
    held: dict[str, str] = {}
    for k, rig in enumerate(scene.rigs):
        for m, one in enumerate(rig.cameras):
            where = f"rigs[{k}].cameras[{m}].camera"
            if one.camera not in known:
                raise TestfieldError(f"no camera is called '{one.camera}'", where, nearest(one.camera, known))
            if one.camera in held:
                raise TestfieldError(
                    f"camera '{one.camera}' is already held by rig '{held[one.camera]}'", where, "name another"
                )
            held[one.camera] = rig.name
    for k, part in enumerate(scene.stations):
        if (part.camera is None) == (part.rig is None):
            raise TestfieldError(
                "a station of a scene with several cameras needs either `camera` or `rig`",
                f"stations[{k}]",
                f"name one of {', '.join((*known, *rigs))}",
            )
        if part.camera and part.camera not in known:
            raise TestfieldError(
                f"no camera is called '{part.camera}'", f"stations[{k}].camera", nearest(part.camera, known)
            )
        if part.camera in held:
            raise TestfieldError(
                f"camera '{part.camera}' is held by rig '{held[part.camera]}'", f"stations[{k}].camera", "name the rig"
            )
        if part.rig and part.rig not in rigs:
            raise TestfieldError(f"no rig is called '{part.rig}'", f"stations[{k}].rig", nearest(part.rig, rigs))
