"""The truth as a calibration, for experiments in which nothing about the cameras is unknown."""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.scene.world import World
from testfield.score.camera import true_in_datum


def exact_calibration(world: World) -> Calibration:
    """The truth in the frame of the first board, with no uncertainty at all."""
    names = tuple(board.name for board in world.field.boards)
    datum, boards = true_in_datum(world, names)
    stations = world.camera_from_world.after(datum[np.zeros(len(world.station_name), int)])
    axes = ("rx", "ry", "rz", "tx", "ty", "tz")
    labels = (*world.interior.names, *(f"station:{s}.{axis}" for s in world.station_name for axis in axes))
    none = np.zeros((len(labels), len(labels)))
    return Calibration(
        method="exact",
        interior=world.interior,
        station_names=world.station_name,
        stations=stations,
        board_names=names,
        boards=boards,
        scale=1.0,
        covariance=none,
        labels=labels,
        sigma0=1.0,
        freedom=0,
        reprojection_rms_px=0.0,
        used=0,
    )
