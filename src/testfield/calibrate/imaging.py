"""Which camera took which image from where: what cameras and rigs mean for the unknowns of an adjustment."""

from dataclasses import dataclass

import numpy as np

from testfield.adjust.network import EXACT_MM, EXACT_RAD, Images, KnownBoards, Network
from testfield.camera.pose import Poses, cross_matrix, nearest_rotation, rotation, rotation_vector
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.camera_sheet import CameraSheet, RelativePose, RigSheet

RIGS = ("constrained", "free")
"""Whether a rig's cameras keep their places in it, or every image has an exterior orientation of its own."""


@dataclass(frozen=True)
class Imaging:
    """`cameras`, and of every image (I,) its `camera` and the place `station` where it, or its rig, stood (numbers of
    `places`), and its `member` of a rig: 0 where its pose is that of the place. `members` (rig, camera) are the others,
    from 1 on; `known` what was stated of them. `images` (I) names."""

    cameras: tuple[CameraSheet, ...]
    camera: np.ndarray
    station: np.ndarray
    member: np.ndarray
    places: tuple[str, ...]
    members: tuple[tuple[str, str], ...] = ()
    known: tuple[RelativePose | None, ...] = ()
    images: tuple[str, ...] = ()

    def numbers(self, names: tuple[str, ...]) -> np.ndarray:
        """Numbers of images by their names."""
        place = {name: k for k, name in enumerate(self.images)}
        return np.array([place[name] for name in names], int)

    def blank(self) -> Poses:
        """A pose for every image, none of them known."""
        return Poses.identity(len(self.camera))

    @property
    def shares_places(self) -> bool:
        """Whether images were taken from the same place."""
        return len(np.unique(self.station)) < len(self.station)

    @property
    def member_names(self) -> tuple[str, ...]:
        """How unknowns of members are named."""
        return tuple(f"{rig}/{camera}" for rig, camera in self.members)


def imaging_of(
    observations: Observations, cameras: tuple[CameraSheet, ...], rigs: tuple[RigSheet, ...], how: str
) -> Imaging:
    """Cameras and places of all images of observations.

    `how` rigs hold their cameras is one of `RIGS`. Raises `TestfieldError` for an image by a camera that the field
    sheet does not list.
    """
    if how not in RIGS:
        raise TestfieldError(f"value '{how}' is none of {', '.join(RIGS)}", "calibrator.rigs", "choose one of them")
    names, images = [one.name for one in cameras], len(observations.stations)
    if not observations.cameras:
        alone = np.zeros(images, int)
        return Imaging(
            cameras[:1], alone, np.arange(images), alone, observations.stations, images=observations.stations
        )
    for image, name in zip(observations.stations, observations.cameras, strict=True):
        if name not in names:
            raise TestfieldError(
                f"image '{image}' is by camera '{name}', which the field sheet does not list",
                "field.json, cameras",
                f"list it beside {', '.join(names)}",
            )
    camera = np.array([names.index(name) for name in observations.cameras], int)
    held = _members(rigs) if how == "constrained" else {}
    order = {key: k for k, key in enumerate((key for key, pose in held.items() if pose[0]), 1)}
    place, member = [], []
    for k, name in enumerate(observations.cameras):
        rig = next((rig for rig, one in held if one == name), None)
        stood = observations.places[k] if observations.places else observations.stations[k]
        # A place of a rig is one for all its cameras; a camera that is alone has places of its own.
        place.append(("rig", rig, stood) if rig else (name, "", stood))
        member.append(order.get((rig, name), 0) if rig else 0)
    unique = list(dict.fromkeys(place))
    station = np.array([unique.index(one) for one in place], int)
    names_of_places = tuple(stood if kind == "rig" else f"{kind}@{stood}" for kind, _, stood in unique)
    told = tuple(held[key][1] for key in order)
    return Imaging(
        cameras, camera, station, np.array(member, int), names_of_places, tuple(order), told, observations.stations
    )


def _members(rigs: tuple[RigSheet, ...]) -> dict[tuple[str, str], tuple[bool, RelativePose | None]]:
    """Of every (rig, camera) whether it is beside the rig's first, and what was stated of its pose."""
    return {(rig.name, camera): (k > 0, rig.poses[k]) for rig in rigs for k, camera in enumerate(rig.cameras)}


def placed_on_rigs(imaging: Imaging, poses: Poses, weight: np.ndarray) -> tuple[Poses, Poses, np.ndarray]:
    """First values: poses of the places (S), of the members (M + 1, the first the identity), and which places have one.

    `poses` (I) camera-from-datum of the images, of those with `weight` (I,) above zero. A place takes its pose from its
    heaviest image; a member from all pairs of images that show it, or from what was stated of it.
    """
    M, S = len(imaging.members) + 1, len(imaging.places)
    members, has_member = Poses.identity(M), np.zeros(M, bool)
    has_member[0] = True
    first = {int(imaging.station[k]): k for k in np.flatnonzero((weight > 0) & (imaging.member == 0))}
    for m in range(1, M):
        pairs = [
            (k, first[int(imaging.station[k])])
            for k in np.flatnonzero((weight > 0) & (imaging.member == m))
            if int(imaging.station[k]) in first
        ]
        stated = imaging.known[m - 1]
        if pairs:
            own, other = (np.array(index) for index in zip(*pairs, strict=True))
            relative = poses[own].after(poses[other].inverse())
            members.R[m], members.t_mm[m] = nearest_rotation(relative.R.mean(axis=0)), np.median(relative.t_mm, axis=0)
            has_member[m] = True
        elif stated is not None:
            members.R[m], members.t_mm[m] = rotation(np.array(stated.turn_rad)), stated.t_mm
            has_member[m] = True
    stations, has = Poses.identity(S), np.zeros(S, bool)
    for k in np.argsort(weight, kind="stable"):
        m, s = int(imaging.member[k]), int(imaging.station[k])
        if weight[k] > 0 and has_member[m]:
            at = members[m : m + 1].inverse().after(poses[k : k + 1])
            stations.R[s], stations.t_mm[s], has[s] = at.R[0], at.t_mm[0], True
    return stations, members, has


def known_members(imaging: Imaging) -> KnownBoards | None:
    """What was stated of members, as a prior; None where nothing was."""
    if not any(imaging.known):
        return None
    poses, u = Poses.identity(len(imaging.known)), np.full((len(imaging.known), 6), np.inf)
    for k, told in enumerate(imaging.known):
        if told is not None:
            poses.R[k], poses.t_mm[k] = rotation(np.array(told.turn_rad)), told.t_mm
            u[k] = [max(told.u_turn_rad, EXACT_RAD)] * 3 + [max(told.u_mm, EXACT_MM)] * 3
    return KnownBoards(poses, u)


def images_of(imaging: Imaging, images: np.ndarray, places: np.ndarray) -> Images:
    """The images in use of a network whose stations are the `places` in use, both given by their numbers."""
    number = np.full(len(imaging.places), -1)
    number[places] = np.arange(len(places))
    return Images(number[imaging.station[images]], imaging.camera[images], imaging.member[images])


def exterior_by_network(network: Network) -> np.ndarray:
    """(6 I, 6 S + 6 M) derivatives of the images' poses by the network's stations and members, in its order: small
    turns after the rotation (rad), then shifts (mm)."""
    images, S = network.images, len(network.stations)
    by = np.zeros((len(images.station), 6, 6 * (S + len(network.members) - 1)))
    for k, (s, m) in enumerate(zip(images.station, images.member, strict=True)):
        R = network.members.R[m]
        by[k, :3, 6 * s : 6 * s + 3] = by[k, 3:, 6 * s + 3 : 6 * s + 6] = R
        if m:
            own = slice(6 * (S + m - 1), 6 * (S + m))
            by[k, :, own] = np.eye(6)
            by[k, 3:, 6 * (S + m - 1) : 6 * (S + m - 1) + 3] = -cross_matrix(R @ network.stations.t_mm[s])
    return by.reshape(6 * len(images.station), -1)


def relative_orientations(imaging: Imaging, network: Network) -> tuple[dict, ...]:
    """The rigs' members as a calibration keeps them."""
    if len(network.members) == 1:
        return ()
    turn = rotation_vector(network.members.R[1:])
    return tuple(
        {
            "rig": rig,
            "camera": camera,
            "turn_rad": tuple(turn[k].tolist()),
            "t_mm": tuple(network.members.t_mm[k + 1].tolist()),
        }
        for k, (rig, camera) in enumerate(imaging.members)
    )
