"""Arithmetic of lenses and motions on the device."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from testfield.camera.motion import Twist
from testfield.render.variant import mitsuba


@dataclass(frozen=True)
class Rays:
    """Rays in the world: `origin` in mm, `direction` of any length, its derivatives `by_x` and `by_y` in px, the `time`
    in s at which they pass, and the `cosine` of the field angle."""

    origin: Any
    direction: Any
    by_x: Any
    by_y: Any
    time: Any
    cosine: Any


class DeviceMaths:
    """What a lens formula needs beside plain arithmetic, on the device."""

    @staticmethod
    def sqrt(x: Any) -> Any:
        """Square root."""
        import drjit as dr

        return dr.sqrt(x)

    @staticmethod
    def atan2(y: Any, x: Any) -> Any:
        """Angle of (x, y)."""
        import drjit as dr

        return dr.atan2(y, x)


def chebyshev(x: Any, count: int) -> list[Any]:
    """The first `count` Chebyshev polynomials."""
    terms = [0 * x + 1, x]
    while len(terms) < count:
        terms.append(2 * x * terms[-1] - terms[-2])
    return terms[:count]


class DeviceTwist:
    """A steady motion on the device."""

    def __init__(self, twist: Twist):
        mi = mitsuba()
        import drjit as dr

        spin = np.array(twist.angular_velocity_rad_s)
        rate = float(np.linalg.norm(spin))
        self.rate = mi.Float(rate)
        self.axis, self.velocity, self.about = (
            mi.Vector3f(*[mi.Float(float(v)) for v in vector])
            for vector in (spin / (rate or 1.0), twist.velocity_mm_s, twist.about_mm)
        )
        dr.make_opaque(self.rate, self.axis, self.velocity, self.about)

    def turn(self, vector: Any, time: Any) -> Any:
        """A direction as the motion has turned it by a time (Rodrigues)."""
        import drjit as dr

        sine, cosine = dr.sincos(self.rate * time)
        along = self.axis * (dr.dot(self.axis, vector) * (1 - cosine))
        return vector * cosine + dr.cross(self.axis, vector) * sine + along

    def turn_back(self, vector: Any, time: Any) -> Any:
        """What `turn` turned."""
        return self.turn(vector, -time)

    def rest(self, point: Any, time: Any) -> Any:
        """Where a point of the moving body is at time 0."""
        return self.turn_back(point - self.about - self.velocity * time, time) + self.about


def columns(values: np.ndarray) -> list[Any]:
    """The columns of a table (n, k) on the device, to be gathered from."""
    return [mitsuba().Float(np.ascontiguousarray(column, np.float32)) for column in values.T]


def vector_of(table: list[Any], index: Any, active: Any = True) -> Any:
    """A row of a table of three columns, as a vector."""
    import drjit as dr

    return mitsuba().Vector3f(*[dr.gather(mitsuba().Float, column, index, active) for column in table])


def opaque_float(value: float) -> Any:
    """A number that does not become part of the kernel's code."""
    import drjit as dr

    return dr.opaque(mitsuba().Float, float(np.float32(value)))


def opaque(number: int) -> Any:
    """A whole number that does not become part of the kernel's code."""
    import drjit as dr

    return dr.opaque(mitsuba().UInt32, number)
