"""What inks do beside being matt, in formulas that both renderers evaluate on the device.

Directions are in the frame of the surface: x and y along the panel, z its normal; `to_eye` and `to_light` are unit
vectors away from the surface.
"""

from dataclasses import astuple
from typing import Any

import numpy as np

from testfield.render.variant import mitsuba
from testfield.scene.world import MATT, Gloss, Retro, World

LN2 = float(np.log(2))


class Materials:
    """Which panel carries which ink, on the device."""

    def __init__(self, world: World):
        ink = world.panels.ink
        self.special = ink is not None and bool((ink != MATT).any())
        # Plain floats: a NumPy scalar on the left of a product would try to look into a device array.
        self.retro = None if world.retro is None else Retro(*(float(v) for v in astuple(world.retro)))
        self.gloss = None if world.gloss is None else Gloss(*(float(v) for v in astuple(world.gloss)))
        self.luminous_radiance = float(world.luminous_radiance)
        self.ink = mitsuba().UInt32(np.full(len(world.panels), MATT) if ink is None else ink)

    def carries(self, panel: Any, ink: int) -> Any:
        """Whether panels are of this ink."""
        import drjit as dr

        return dr.gather(mitsuba().UInt32, self.ink, panel) == ink


def retro_coefficient(retro: Retro, to_eye: Any, to_light: Any) -> Any:
    """R_A in 1/sr: falls with the light's entrance angle and with the observation angle between light and eye."""
    import drjit as dr

    entrance = dr.acos(dr.clip(to_light.z, 0, 1)) / retro.half_entrance_rad
    # From the chord: a cosine near one has lost the small angle in float32.
    observation = 2 * dr.asin(dr.minimum(dr.norm(to_eye - to_light) / 2, 1)) / retro.half_observation_rad
    return retro.coefficient * dr.exp2(-dr.square(dr.square(entrance)) - dr.square(observation))


def retro_reflectance(retro: Retro, to_eye: Any) -> Any:
    """Part of even light that comes back to the eye: R_A / cos(viewing angle) integrated over the narrow lobe."""
    import drjit as dr

    entrance = dr.acos(dr.clip(to_eye.z, 0, 1)) / retro.half_entrance_rad
    lobe_sr = float(np.pi * retro.half_observation_rad**2 / LN2)
    return retro.coefficient * lobe_sr * dr.exp2(-dr.square(dr.square(entrance))) / dr.maximum(to_eye.z, 1e-3)


def retro_shift_mm(retro: Retro, to_eye: Any) -> tuple[Any, Any]:
    """How far what retro-reflects lies from the print, along the panel's x and y."""
    return retro.shift_mm * to_eye.x, retro.shift_mm * to_eye.y


def coat(gloss: Gloss, to_eye: Any, to_light: Any) -> Any:
    """BRDF of the coat times the cosine at the light, in 1/sr: GGX, Smith's shadowing, Schlick's Fresnel term."""
    import drjit as dr

    a = gloss.alpha
    m = dr.normalize(to_eye + to_light)
    slope = dr.square(m.x / a) + dr.square(m.y / a) + dr.square(m.z)
    density = 1 / (np.pi * a * a * dr.square(slope))
    value = schlick(gloss, dr.dot(to_eye, m)) * density * smith(gloss, to_eye) * smith(gloss, to_light)
    above = (to_eye.z > 0) & (to_light.z > 0)
    return dr.select(above, value / (4 * dr.maximum(to_eye.z, 1e-6)), 0)


def coat_pdf(gloss: Gloss, to_eye: Any, to_light: Any) -> Any:
    """Density of `sample_coat`, in 1/sr."""
    import drjit as dr

    a = gloss.alpha
    m = dr.normalize(to_eye + to_light)
    slope = dr.square(m.x / a) + dr.square(m.y / a) + dr.square(m.z)
    density = 1 / (np.pi * a * a * dr.square(slope))
    above = (to_eye.z > 0) & (to_light.z > 0)
    return dr.select(above, density * smith(gloss, to_eye) / (4 * dr.maximum(to_eye.z, 1e-6)), 0)


def sample_coat(gloss: Gloss, to_eye: Any, sample: Any) -> Any:
    """Directions to the light, distributed as the visible facets reflect."""
    mi = mitsuba()
    import drjit as dr

    facets = mi.MicrofacetDistribution(mi.MicrofacetType.GGX, gloss.alpha, True)
    m, _ = facets.sample(to_eye, sample)
    return 2 * dr.dot(to_eye, m) * m - to_eye


def schlick(gloss: Gloss, cosine: Any) -> Any:
    """Fresnel reflectance at the cosine between a direction and the facet."""
    import drjit as dr

    grazing = dr.clip(1 - cosine, 0, 1)
    return gloss.reflectance + (1 - gloss.reflectance) * grazing * dr.square(dr.square(grazing))


def smith(gloss: Gloss, v: Any) -> Any:
    """Part of the facets that is not hidden from a direction."""
    import drjit as dr

    tan2 = (dr.square(v.x) + dr.square(v.y)) / dr.maximum(dr.square(v.z), 1e-12)
    return 2 / (1 + dr.sqrt(1 + gloss.alpha**2 * tan2))


def sample_retro(retro: Retro, to_eye: Any, sample: Any) -> Any:
    """Directions to the light about the one to the eye, distributed as `retro_pdf` says."""
    mi = mitsuba()
    import drjit as dr

    angle = retro.half_observation_rad * dr.sqrt(-dr.log2(dr.maximum(1 - sample.x, 1e-7)))
    s, c = dr.sincos(2 * dr.pi * sample.y)
    around = mi.Frame3f(to_eye)
    sine = dr.sin(angle)
    return around.to_world(mi.Vector3f(sine * c, sine * s, dr.cos(angle)))


def retro_pdf(retro: Retro, to_eye: Any, to_light: Any) -> Any:
    """Density of `sample_retro`, in 1/sr: a normal law in the observation angle."""
    import drjit as dr

    angle = 2 * dr.asin(dr.minimum(dr.norm(to_eye - to_light) / 2, 1))
    stretch = angle / dr.maximum(dr.sin(angle), 1e-9)
    wide = float(LN2 / (np.pi * retro.half_observation_rad**2))
    lobe = wide * dr.exp2(-dr.square(angle / retro.half_observation_rad)) * dr.select(angle < 1e-4, 1, stretch)
    return dr.select(angle < 1.5, lobe, 0)
