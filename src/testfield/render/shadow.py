"""The part of a lamp's light that flat surfaces hide, without noise: exact along lines of the lamp.

Seen from a point, a rectangle before a lamp hides of each line on the lamp an interval: where the line of sight crosses
the rectangle's plane and passes within its four sides. Each of these five conditions is linear along the line. What no
interval covers is integrated over the line, and lines are many enough that their sum is the lamp's.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from testfield.camera.pose import Poses
from testfield.render.device_maths import columns, vector_of
from testfield.render.fetch import fetch
from testfield.render.outlines import CORNERS
from testfield.render.variant import mitsuba
from testfield.scene.world import AreaLight

LINES = 64
"""Lines on a lamp; a power of two. The sum of the middles of equal strips errs by their width squared, over the sine of
the angle between the lines and an edge's shadow."""
WAYS = [(float(np.cos(a)), float(np.sin(a))) for a in np.pi * (np.arange(4) / 4 + 1 / 16)]
"""Ways that the lines may run: each point takes the one farthest from the shadows of all edges before the lamp."""
THREADS_A_PASS = 1 << 22
GAUSS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class Rectangles:
    """Flat surfaces: `pose` (k) from their frames to the world, `size_mm` (k, 2)."""

    pose: Poses
    size_mm: np.ndarray

    def __len__(self) -> int:
        return len(self.size_mm)

    def may_hide(self, k: int, light: AreaLight, points_mm: np.ndarray) -> np.ndarray:
        """(n,) whether rectangle k hides some of a lamp from points (n, 3): False only where one of the conditions
        fails all over the lamp."""
        R, middle = self.pose.R[k], self.pose.t_mm[k]
        corners = CORNERS * light.size_mm
        lamp = (light.world_from_light.t_mm[0] + corners @ light.world_from_light.R[0][:, :2].T - middle) @ R
        own = (points_mm - middle) @ R
        side, far = np.sign(own[:, 2:]), np.abs(own[:, 2:])
        beyond = side * lamp[:, 2]
        some = np.any(beyond < 0, axis=1)
        for axis in (0, 1):
            room = self.size_mm[k, axis] / 2 * (far - beyond)
            aside = far * lamp[:, axis] - own[:, axis : axis + 1] * beyond
            some &= np.any(room > aside, axis=1) & np.any(room > -aside, axis=1)
        return some


def visible_part(
    light: AreaLight, rectangles: Rectangles, points_mm: np.ndarray, normals: np.ndarray, hides: np.ndarray
) -> np.ndarray:
    """(n,) part of a lamp's light that reaches points (n, 3) with normals (n, 3); `hides` (n, k) which rectangles are
    asked for at each of them."""
    shades = _Shades(light, rectangles, np.nonzero(hides)[1])
    end = np.cumsum(hides.sum(axis=1))
    begin = np.concatenate([[0], end[:-1]])
    batch = THREADS_A_PASS // LINES
    part = np.empty(len(points_mm))
    for start in range(0, len(points_mm), batch):
        # Every batch has the same size, so that one kernel serves all; the last one wraps round.
        index = (np.arange(batch) + start) % len(points_mm)
        fresh = min(batch, len(points_mm) - start)
        part[start : start + fresh] = shades.part(points_mm[index], normals[index], begin[index], end[index])[:fresh]
    return part


class _Shades:
    """A lamp and the rectangles before it on the device; `asked` the numbers of those that points ask for, of one point
    after the other."""

    def __init__(self, light: AreaLight, rectangles: Rectangles, asked: np.ndarray):
        mi = mitsuba()
        import drjit as dr

        lamp, rest = light.world_from_light, rectangles.pose
        self.along, self.up, self.facing, self.middle = (
            mi.Vector3f(*[mi.Float(float(v)) for v in vector]) for vector in (*lamp.R[0].T, lamp.t_mm[0])
        )
        self.half_u, self.half_v = (mi.Float(float(size) / 2) for size in light.size_mm)
        self.asked = mi.UInt32(asked.astype(np.uint32))
        self.axes = [columns(rest.R[:, :, axis]) for axis in range(3)]
        self.middles, self.halves = columns(rest.t_mm), columns(rectangles.size_mm / 2)
        dr.make_opaque(self.along, self.up, self.facing, self.middle, self.half_u, self.half_v)

    def part(self, points_mm: np.ndarray, normals: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """(n,) visible part at points, each of which asks for its rectangles from `begin` to `end` (n,) in `asked`."""
        mi = mitsuba()
        import drjit as dr

        places, asks = columns(points_mm), [mi.UInt32(v.astype(np.uint32)) for v in (begin, end)]
        way = self._way(mi.Vector3f(*places), *asks)
        dr.eval(way)
        thread = dr.arange(mi.UInt32, len(points_mm) * LINES)
        point, line = thread // LINES, thread % LINES
        position, normal = (vector_of(values, point) for values in (places, columns(normals)))
        first, last = (dr.gather(mi.UInt32, ask, point) for ask in asks)
        cosine, sine = (dr.gather(mi.Float, part, point) for part in way)
        reach = self.half_u * dr.abs(sine) + self.half_v * dr.abs(cosine)
        v = ((mi.Float(line) + 0.5) * (2 / LINES) - 1) * reach
        x, y = -v * sine, v * cosine
        low, high = -2 * (self.half_u + self.half_v), 2 * (self.half_u + self.half_v)
        for at, by, half in ((x, cosine, self.half_u), (y, sine, self.half_v)):
            low, high = _clipped(half - at, -by, *_clipped(half + at, by, low, high))
        on_line, along = self.middle + x * self.along + y * self.up, cosine * self.along + sine * self.up
        seen, whole = self._along_line(position, normal, on_line, along, low, high, first, last)
        dr.eval(seen, whole)
        sums = [fetch(dr.block_sum(values, LINES)).astype(float) for values in (seen, whole)]
        return np.minimum(sums[0] / np.maximum(sums[1], 1e-300), 1)

    def _way(self, position: Any, first: Any, last: Any) -> tuple[Any, Any]:
        """Of `WAYS` the one whose smallest angle with the shadows of the rectangles' edges is largest."""
        mi = mitsuba()
        import drjit as dr

        def ask(k: Any, *least: Any) -> tuple[Any, ...]:
            rectangle = dr.gather(mi.UInt32, self.asked, k)
            middle = vector_of(self.middles, rectangle) - position
            axes = [vector_of(axis, rectangle) for axis in self.axes[:2]]
            halves = [dr.gather(mi.Float, half, rectangle) for half in self.halves]
            for own, other, half in ((axes[0], axes[1], halves[1]), (axes[1], axes[0], halves[0])):
                for side in (-half, half):
                    # The plane of the eye and an edge cuts the lamp's in the edge's shadow.
                    shadow = dr.cross(dr.cross(middle + side * other, own), self.facing)
                    x, y = dr.dot(shadow, self.along), dr.dot(shadow, self.up)
                    length = dr.maximum(dr.sqrt(x * x + y * y), 1e-30)
                    least = tuple(
                        dr.minimum(so_far, dr.abs(x * sine - y * cosine) / length)
                        for so_far, (cosine, sine) in zip(least, WAYS, strict=True)
                    )
            return k + 1, *least

        state = mi.UInt32(first), *(mi.Float(1) for _ in WAYS)
        _, *least = dr.while_loop(state, lambda k, *_: k < last, ask, label="edges")
        best, (cosine, sine) = least[0], (mi.Float(v) for v in WAYS[0])
        for angle, way in zip(least[1:], WAYS[1:], strict=True):
            better = angle > best
            best = dr.select(better, angle, best)
            cosine, sine = dr.select(better, way[0], cosine), dr.select(better, way[1], sine)
        return cosine, sine

    def _along_line(
        self, position: Any, normal: Any, on_line: Any, along: Any, low: Any, high: Any, first: Any, last: Any
    ) -> tuple[Any, Any]:
        """Light from points `on_line` + u `along`, u from `low` to `high`: what is not hidden, and all of it."""
        mi = mitsuba()
        import drjit as dr

        to = on_line - position
        height = dr.dot(-to, self.facing)
        rise, slope = dr.dot(to, normal), dr.dot(along, normal)
        # The lamp sinks behind the point's horizon where rise + slope u turns negative.
        low, high = _clipped(rise, slope, low, high)

        def light_between(a: Any, b: Any) -> Any:
            total = mi.Float(0)
            for at, weight in zip(*GAUSS, strict=True):
                u = (a + b) / 2 + (b - a) / 2 * float(at)
                total += float(weight) / 2 * (rise + slope * u) / dr.square(dr.squared_norm(to + u * along))
            return height * dr.maximum(b - a, 0) * total

        def step(u: Any, total: Any) -> tuple[Any, Any]:
            """From u on to the end of what covers it, or over the gap to what comes next."""

            def ask(k: Any, reach: Any, ahead: Any) -> tuple[Any, Any, Any]:
                rectangle = dr.gather(mi.UInt32, self.asked, k)
                a, b = self._hidden(rectangle, position, on_line, along, low, high)
                covers = (a <= u) & (b > u)
                reach = dr.select(covers, dr.maximum(reach, b), reach)
                ahead = dr.select((a > u) & (b > a), dr.minimum(ahead, a), ahead)
                return k + 1, reach, ahead

            state = mi.UInt32(first), mi.Float(u), mi.Float(high)
            _, reach, ahead = dr.while_loop(state, lambda k, *_: k < last, ask, label="rectangles")
            covered = reach > u
            return dr.select(covered, reach, ahead), total + dr.select(covered, 0, light_between(u, ahead))

        _, seen = dr.while_loop((mi.Float(low), mi.Float(0)), lambda u, _: u < high, step, label="gaps")
        return seen, light_between(low, high)

    def _hidden(self, k: Any, position: Any, on_line: Any, along: Any, low: Any, high: Any) -> tuple[Any, Any]:
        """What rectangle k hides of the line between `low` and `high`; nothing where the second is not larger."""
        mi = mitsuba()
        import drjit as dr

        middle, normal = vector_of(self.middles, k), vector_of(self.axes[2], k)
        own, there = position - middle, on_line - middle
        far = dr.dot(own, normal)
        side, far = dr.sign(far), dr.abs(far)
        beyond, beyond_by = side * dr.dot(there, normal), side * dr.dot(along, normal)
        low, high = _clipped(-beyond, -beyond_by, low, high)
        for axis, half in zip(self.axes[:2], self.halves, strict=True):
            axis, half = vector_of(axis, k), dr.gather(mi.Float, half, k)
            p = dr.dot(own, axis)
            room, room_by = half * (far - beyond), -half * beyond_by
            aside, aside_by = far * dr.dot(there, axis) - p * beyond, far * dr.dot(along, axis) - p * beyond_by
            low, high = _clipped(room - aside, room_by - aside_by, low, high)
            low, high = _clipped(room + aside, room_by + aside_by, low, high)
        return low, high


def _clipped(value: Any, slope: Any, low: Any, high: Any) -> tuple[Any, Any]:
    """The part of [low, high] in which value + slope u is positive; an empty one has high below low."""
    import drjit as dr

    level = dr.abs(slope) < 1e-30
    root = -value / dr.select(level, 1, slope)
    low = dr.select(~level & (slope > 0), dr.maximum(low, root), low)
    high = dr.select(~level & (slope < 0), dr.minimum(high, root), high)
    return low, dr.select(level & (value <= 0), low - 1, high)
