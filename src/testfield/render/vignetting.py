"""How much light reaches a place of the image."""

from typing import Any

from testfield.render.device_maths import Rays
from testfield.render.variant import mitsuba
from testfield.scene.world import World


def vignettes(world: World) -> bool:
    """Whether the image is darker towards its edges."""
    return world.optics.natural_vignetting or any(world.optics.vignetting)


class Vignetting:
    """Part of the light that reaches a pixel, by where it is."""

    def __init__(self, world: World):
        mi = mitsuba()
        import drjit as dr

        width, height = world.interior.width_px, world.interior.height_px
        self.natural = world.optics.natural_vignetting
        self.numbers = [mi.Float(v) for v in ((width - 1) / 2, (height - 1) / 2, 4 / (width**2 + height**2))]
        self.coefficients = [mi.Float(v) for v in world.optics.vignetting]
        dr.make_opaque(self.numbers, self.coefficients)

    def at(self, x_px: Any, y_px: Any, rays: Rays) -> Any:
        """Factor in [0, 1]."""
        import drjit as dr

        middle_x, middle_y, scale = self.numbers
        r2 = ((x_px - middle_x) ** 2 + (y_px - middle_y) ** 2) * scale
        v1, v2, v3 = self.coefficients
        factor = dr.clip(1 + r2 * (v1 + r2 * (v2 + r2 * v3)), 0, 1)
        return factor * dr.square(dr.square(dr.maximum(rays.cosine, 0))) if self.natural else factor
