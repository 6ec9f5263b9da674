"""Frames from what a person says: where a thing is, which way it faces, how it is turned."""

import numpy as np


def unit(vector: np.ndarray) -> np.ndarray:
    """The vector at length one. Raises `ValueError` for a zero vector."""
    length = np.linalg.norm(vector)
    if length == 0:
        raise ValueError("a direction has length zero")
    return vector / length


def facing(normal: np.ndarray, spin_rad: float = 0.0) -> np.ndarray:
    """World-from-panel rotation (3, 3): z along the normal, y as far up as it can be, then turned about z."""
    z = unit(np.asarray(normal, float))
    up = np.array([0, 0, 1.0]) if abs(z[2]) < 0.999 else np.array([0, 1.0, 0])
    x = unit(np.cross(up, z))
    return _turned(np.column_stack([x, np.cross(z, x), z]), spin_rad)


def along(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """World-from-panel rotation: x along the direction, z as near the normal as it can be."""
    x = unit(np.asarray(direction, float))
    z = np.asarray(normal, float) - x * np.dot(normal, x)
    z = unit(z)
    return np.column_stack([x, np.cross(z, x), z])


def camera_looking(position_mm: np.ndarray, at_mm: np.ndarray, roll_rad: float) -> tuple[np.ndarray, np.ndarray]:
    """Camera-from-world rotation and translation: z towards a point, x level, then rolled about z."""
    towards = at_mm - position_mm
    if np.linalg.norm(towards) < 1:
        raise ValueError("the camera stands on the point it looks at")
    z = unit(towards)
    up = np.array([0, 0, 1.0]) if abs(z[2]) < 0.999 else np.array([0, 1.0, 0])
    x = unit(np.cross(z, up))
    R = _turned(np.column_stack([x, np.cross(z, x), z]), roll_rad).T
    return R, -R @ position_mm


def _turned(frame: np.ndarray, angle_rad: float) -> np.ndarray:
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return frame @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
