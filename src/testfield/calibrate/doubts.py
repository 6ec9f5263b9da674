"""Why a network may not know what is asked of it: reasons that its geometry alone gives, each naming its parameters."""

from dataclasses import replace

import cv2
import numpy as np

from testfield.adjust.network import Network

FACE_ON_DEG = 10.0
"""Tilt of boards against the image plane below which depth and focal length look alike."""
PARALLEL_DEG = 10.0
"""Angle between the boards' normals in the camera's frame below which all views are of one orientation."""
LEAST_ROLL_DEG = 30.0
LEAST_COVERED = 0.5
"""Part of the image within the outermost observations."""


def geometric_doubts(
    network: Network, station_names: tuple[str, ...], board_names: tuple[str, ...], camera_names: tuple[str, ...] = ()
) -> list[str]:
    """Sentences on weak geometry of a network of boards at its present values, of each of several cameras."""
    if len(network.cameras) > 1:
        board = network.point_board[network.point]
        pairs = np.unique(np.column_stack([network.image, board])[board >= 0], axis=0)
        return [
            *(
                f"camera '{name}': {note}"
                for k, name in enumerate(camera_names)
                for note in _doubts_of_views(_by_one(network, k))
            ),
            *_hanging(pairs, station_names, board_names),
        ]
    return _doubts_of_views(network, station_names, board_names)


def _by_one(network: Network, camera: int) -> Network:
    """What one of several cameras saw."""
    alone = replace(
        network,
        cameras=(network.cameras[camera],),
        images=replace(network.images, camera=np.zeros_like(network.images.camera)),
    )
    return alone.take(network.camera == camera)


def _doubts_of_views(
    network: Network, station_names: tuple[str, ...] = (), board_names: tuple[str, ...] = ()
) -> list[str]:
    board = network.point_board[network.point]
    pairs = np.unique(np.column_stack([network.image, board])[board >= 0], axis=0)
    if not len(pairs):
        return []
    R = network.camera_from_datum().R[pairs[:, 0]] @ network.boards.R[pairs[:, 1]]
    return [
        *_orientations(R[:, :, 2], network),
        *_roll(R, pairs[:, 1], network),
        *_covered(network),
        *_hanging(pairs, station_names, board_names),
    ]


def _orientations(normal: np.ndarray, network: Network) -> list[str]:
    """Views that are all face on, or all of one orientation."""
    unknown = _unknown(network, ("fx", "fy"))
    tilt = np.degrees(np.arccos(np.clip(np.abs(normal[:, 2]), 0, 1)))
    if tilt.max() < FACE_ON_DEG:
        return (
            [
                f"all views see the boards face on (tilted by {tilt.max():.1f} degrees at most): "
                f"{unknown or 'the focal length'} and the stations' distances (tz) look alike"
            ]
            if unknown
            else []
        )
    cosine = np.clip(np.abs(normal @ normal.T), 0, 1)
    spread = np.degrees(np.arccos(cosine.min()))
    if spread < PARALLEL_DEG and (unknown := _unknown(network, ("fx", "fy", "cx", "cy"))):
        return [
            f"all views are parallel (boards' normals within {spread:.1f} degrees as the camera sees them): "
            f"{unknown} are hardly told from poses"
        ]
    return []


def _roll(R: np.ndarray, board: np.ndarray, network: Network) -> list[str]:
    """No turn about the optical axis."""
    unknown = _unknown(network, ("cx", "cy", "p1", "p2", "shear"))
    if not unknown or len(R) < 2:
        return []
    angle = np.degrees(np.arctan2(R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1]))
    most = 0.0
    for b in np.unique(board):
        here = np.sort(angle[board == b])
        gaps = np.diff(np.append(here, here[0] + 360))
        most = max(most, 360 - float(gaps.max())) if len(here) > 1 else most
    if most >= LEAST_ROLL_DEG:
        return []
    return [
        f"the camera was never turned about its axis (roll within {most:.1f} degrees): "
        f"{unknown} lean on the tilts alone"
    ]


def _covered(network: Network) -> list[str]:
    """Image area that no observation reaches."""
    camera = network.interior
    hull = cv2.convexHull(network.xy_px.astype(np.float32))
    part = float(cv2.contourArea(hull)) / (camera.width_px * camera.height_px)
    if part >= LEAST_COVERED:
        return []
    return [
        f"the observations cover {100 * part:.0f} % of the image: beyond them the lens "
        f"({_unknown(network, camera.lens.coefficients) or 'held'}) is extrapolated"
    ]


def _hanging(pairs: np.ndarray, station_names: tuple[str, ...], board_names: tuple[str, ...]) -> list[str]:
    """Boards that one image alone joins to the others."""
    notes = []
    for b in range(1, len(board_names)):
        images = pairs[pairs[:, 1] == b, 0]
        if len(images) == 1 and len(station_names) > 1:
            notes.append(
                f"board '{board_names[b]}' hangs on one image, '{station_names[images[0]]}', and on its errors"
            )
    return notes


def _unknown(network: Network, wanted: tuple[str, ...]) -> str:
    camera = network.cameras[0]
    free = [name for name, unknown in zip(camera.interior.names, camera.unknown, strict=True) if unknown]
    return ", ".join(name for name in free if name in wanted)
