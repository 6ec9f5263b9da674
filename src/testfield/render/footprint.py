"""Parts of a footprint that lie on one side of an edge, or in a corner of two, in closed form.

A footprint is the image of a small square of the sensor on a surface: coordinates on the surface are linear in those of
the square, so an edge is a line in the unit square.
"""

from typing import Any


def half_plane(distance: Any, gradient: tuple[Any, Any]) -> Any:
    """Part of the unit square centred at 0 where `distance + gradient . p > 0`, exactly; a step without gradient."""
    import drjit as dr

    a, b = dr.abs(gradient[0]), dr.abs(gradient[1])
    large, small = dr.maximum(a, b), dr.minimum(a, b)
    reach = (large + small) / 2 - dr.abs(distance)
    straight = reach >= small
    corner = reach * reach / dr.maximum(2 * large * small, 1e-30)
    near = dr.select(straight, 0.5 - dr.abs(distance) / dr.maximum(large, 1e-30), corner)
    outside = dr.select(reach > 0, near, 0)
    return dr.select(distance > 0, 1 - outside, outside)


def quarter_plane(d: Any, g: tuple[Any, Any], e: Any, h: tuple[Any, Any], one: Any, other: Any) -> Any:
    """Part of the unit square centred at 0 where `d + g . p > 0` and `e + h . p > 0`, exactly.

    `one` and `other` are the parts of the two half-planes alone. With the origin where the two lines meet, the lines
    add nothing to Green's integral of the area, so only the four sides of the square count.
    """
    import drjit as dr

    determinant = g[0] * h[1] - g[1] * h[0]
    determinant = dr.select(dr.abs(determinant) > 1e-30, determinant, 1e-30)
    x, y = (g[1] * e - h[1] * d) / determinant, (h[0] * d - g[0] * e) / determinant

    def inside(offset_d: Any, slope_d: Any, offset_e: Any, slope_e: Any) -> Any:
        """Length of a side on which both conditions hold."""
        low, high = -0.5 + 0 * d, 0.5 + 0 * d
        for offset, slope in ((offset_d, slope_d), (offset_e, slope_e)):
            steep = dr.select(dr.abs(slope) > 1e-20, slope, 1e-20)
            root = dr.clip(-offset / steep, -0.5, 0.5)
            low = dr.select(steep > 0, dr.maximum(low, root), low)
            high = dr.select(steep > 0, high, dr.minimum(high, root))
        return dr.maximum(high - low, 0)

    area = 0 * d
    for end in (-0.5, 0.5):
        sign = 2 * end
        area += (0.5 - x * sign) * inside(d + g[0] * end, g[1], e + h[0] * end, h[1])
        area += (0.5 - y * sign) * inside(d + g[1] * end, g[0], e + h[1] * end, h[0])
    crossed = (one > 0) & (one < 1) & (other > 0) & (other < 1)
    return dr.select(crossed, dr.clip(area / 2, 0, 1), one * other)
