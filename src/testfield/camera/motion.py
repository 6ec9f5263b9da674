"""What moves while the shutter is open, and when each row of the image is exposed."""

from dataclasses import dataclass

import numpy as np

from testfield.camera.pose import Poses, rotation

Vector = tuple[float, float, float]
STILL: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Twist:
    """A steady motion: `velocity_mm_s` of the point `about_mm`, and `angular_velocity_rad_s` about it."""

    velocity_mm_s: Vector = STILL
    angular_velocity_rad_s: Vector = STILL
    about_mm: Vector = STILL

    @property
    def moves(self) -> bool:
        """Whether it moves anything."""
        return any(self.velocity_mm_s) or any(self.angular_velocity_rad_s)

    def pose(self, time_s: np.ndarray) -> Poses:
        """Where the body is at times (n,), as motions from where it is at time 0."""
        R = rotation(time_s[:, None] * np.array(self.angular_velocity_rad_s))
        about = np.array(self.about_mm)
        return Poses(R, about - R @ about + time_s[:, None] * np.array(self.velocity_mm_s))


@dataclass(frozen=True)
class Motion:
    """`camera` moves in the camera's own frame, `target` (all that carries marks) in the world's; time 0 is the middle
    of the middle row's exposure, which lasts `exposure_s`; each row begins `row_s` after the one above it (0: a global
    shutter).
    """

    camera: Twist = Twist()
    target: Twist = Twist()
    exposure_s: float = 0.0
    row_s: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether anything moves."""
        return self.camera.moves or self.target.moves

    def camera_from_rest(self, camera_from_world: Poses, time_s: np.ndarray) -> Poses:
        """Poses (n,) at times (n,) of cameras (n,) relative to where the target rests at time 0."""
        return self.camera.pose(time_s).inverse().after(camera_from_world).after(self.target.pose(time_s))


UNMOVED = Motion()
