"""What each camera's images alone tell before any are joined: boards in images, a first lens, a first focal length."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testfield.adjust.network import Camera, Images
from testfield.calibrate.edges import Edges, board_edges
from testfield.calibrate.homography import focal_length, image_middle, plane_pose
from testfield.calibrate.imaging import Imaging, images_of, placed_on_rigs
from testfield.calibrate.lens_start import lens_start
from testfield.camera.interior import Interior, check_held
from testfield.camera.lens import lens_model
from testfield.camera.pose import Poses
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.camera_sheet import DEFAULT_CAMERA, CameraSheet
from testfield.targets.field import Field

Guess = Callable[[Edges, Observations, Field, np.ndarray], tuple[float, Poses]]
"""A first focal length in px and camera-from-board poses (E) of edges, the principal point given in px (2,)."""


def from_homographies(edges: Edges, rows: Observations, field: Field, middle_px: np.ndarray) -> tuple[float, Poses]:
    """The guess of Zhang (2000) with the principal point known: two constraints on the focal length a homography."""
    focal = focal_length(edges.homography, middle_px)
    poses = [plane_pose(h, focal, middle_px) for h in edges.homography]
    return focal, Poses(np.array([R for R, _ in poses]), np.array([t for _, t in poses]))


@dataclass(frozen=True)
class Look:
    """What a camera's own images tell: a pinhole of the focal length that they guess, which of its parameters are
    `free`, its `edges` and their `camera_from_board` poses."""

    number: int
    pinhole: Interior
    free: np.ndarray
    edges: Edges
    camera_from_board: Poses

    def camera(self, edges: Edges, imaging: Imaging) -> Camera:
        """The camera as an unknown, its first lens that of those edges that are left, or of its own."""
        own = np.flatnonzero(imaging.camera[edges.station] == self.number)
        lens = edges.image[own[0]].lens if len(own) else self.edges.lens
        return Camera.of(lens_start(self.pinhole, self.free, lens), self.free)


def looks_of(
    rows: Observations,
    field: Field,
    imaging: Imaging,
    hold: tuple[str, ...],
    fixed: tuple[str, ...],
    guess: Guess,
    left_out: frozenset[int],
) -> tuple[list[Look], np.ndarray, list[str]]:
    """What every camera's images tell, why each observation (n,) is left out ("" where it is not), and notes.

    Raises `TestfieldError` where a camera's images show too little of any board.
    """
    looks: list[Look] = []
    notes: list[str] = []
    why = np.full(len(rows), "", object)
    for k, sheet in enumerate(imaging.cameras):
        pinhole, free = _first_camera(sheet.width_px, sheet.height_px, sheet.lens, hold, fixed)
        middle = pinhole.parameters[2:4]
        here = np.flatnonzero(imaging.camera[rows.station] == k)
        own = rows.take(here) if len(imaging.cameras) > 1 else rows
        try:
            edges, said, told = board_edges(own, field, middle)
        except TestfieldError as error:
            if len(imaging.cameras) == 1:
                raise
            raise TestfieldError(f"camera '{sheet.name}': {error.what}", error.where, error.do) from error
        why[here], notes = said, notes + told
        edges = edges.take(~np.isin(edges.board, sorted(left_out)))
        focal, camera_from_board = guess(edges, own, field, middle)
        pinhole = pinhole.with_parameters(np.array([focal, focal, *pinhole.parameters[2:]]))
        looks.append(Look(k, pinhole, free, edges.of_rows(here), camera_from_board))
    return looks, why, notes


def joined(looks: list[Look]) -> Poses:
    """Camera-from-board poses of all edges in order."""
    return looks[0].camera_from_board if len(looks) == 1 else Poses.join([look.camera_from_board for look in looks])


def one_camera(images: tuple[str, ...], width_px: int, height_px: int, lens: str) -> Imaging:
    """Images that one camera took, each from a place of its own."""
    alone = np.zeros(len(images), int)
    return Imaging(
        (CameraSheet(DEFAULT_CAMERA, width_px, height_px, lens),), alone, np.arange(len(images)), alone, images
    )


@dataclass(frozen=True)
class Standing:
    """`images` in use (numbers), `poses` (I) of all images, those in use being right; and the network's `stations`,
    their `names`, rig `members` and `network_images`."""

    images: np.ndarray
    poses: Poses
    stations: Poses
    names: tuple[str, ...]
    members: Poses
    network_images: Images


def standing_of(imaging: Imaging, poses: Poses, edges: Edges, placed: np.ndarray) -> Standing:
    """Where cameras and rigs stood, of the camera-from-datum `poses` (I) of those images that are `placed`."""
    images = len(imaging.camera)
    if len(np.unique(imaging.station)) == images and not imaging.members:
        names = tuple(imaging.places[imaging.station[k]] for k in placed)
        where = Images(np.arange(len(placed)), imaging.camera[placed], np.zeros(len(placed), int))
        return Standing(placed, poses, poses[placed], names, Poses.identity(1), where)
    weight = np.where(np.isin(np.arange(images), placed), np.bincount(edges.station, edges.weight, images), 0.0)
    stations, members, has = placed_on_rigs(imaging, poses, weight)
    shown = {int(m) for m in np.unique(imaging.member[weight > 0])}
    use = np.flatnonzero(has[imaging.station] & np.isin(imaging.member, [0, *shown]))
    places = np.unique(imaging.station[use])
    at = members[imaging.member].after(stations[imaging.station])
    return Standing(
        use, at, stations[places], tuple(imaging.places[p] for p in places), members, images_of(imaging, use, places)
    )


def _first_camera(
    width_px: int, height_px: int, lens: str, hold: tuple[str, ...], fixed: tuple[str, ...]
) -> tuple[Interior, np.ndarray]:
    """A pinhole in the middle of the image, focal length 1, and which of its parameters are unknown."""
    interior = Interior(
        width_px, height_px, np.array([1.0, 1.0, *image_middle(width_px, height_px), *lens_model(lens).pinhole]), lens
    )
    check_held(hold, lens)
    zero = np.array([name in hold for name in interior.names])
    interior = interior.with_parameters(np.where(zero, 0.0, interior.parameters))
    return interior, ~zero & np.array([name not in fixed for name in interior.names])
