"""A Mitsuba material of everything a panel can be: matt print, retro-reflecting ink, a glossy coat.

It is the same print and the same formulas as the fast renderer's, so that both see one material.
"""

from functools import lru_cache
from typing import Any

from testfield.render.materials import (
    Materials,
    coat,
    coat_pdf,
    retro_coefficient,
    retro_pdf,
    retro_shift_mm,
    sample_coat,
    sample_retro,
)
from testfield.render.variant import mitsuba
from testfield.scene.world import GLOSS, LUMINOUS, RETRO


@lru_cache
def paint_class() -> type:
    """The plugin class, registered once."""
    mi = mitsuba()
    import drjit as dr

    class Paint(mi.BSDF):  # type: ignore[name-defined]
        def __init__(self, props: Any):
            super().__init__(props)
            flags = mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
            glossy = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components = [flags, glossy]
            self.m_flags = flags | glossy
            self.texture: Any = None
            self.materials: Materials | None = None

        def _special(self, si: Any) -> tuple[Any, Any]:
            """Retro-reflecting part of what lies at a hit, and whether it is coated."""
            materials, panel = self.materials, self.texture.panel(si)
            assert materials is not None
            ink = mi.Float(0)
            if materials.retro:
                at = self.texture.on_surface(si)
                shifted = self.texture.coverage(at, retro_shift_mm(materials.retro, si.wi), 1)
                ink = dr.select(materials.carries(panel, RETRO), shifted, 0)
            coated = materials.carries(panel, GLOSS) if materials.gloss else mi.Bool(False)
            return ink, coated

        def _value(self, si: Any, wo: Any, ink: Any, coated: Any) -> Any:
            materials = self.materials
            assert materials is not None
            value = self.texture.eval_1(si) * wo.z / dr.pi
            if materials.retro:
                value += ink * retro_coefficient(materials.retro, si.wi, wo) / si.wi.z
            if materials.gloss:
                value += dr.select(coated, coat(materials.gloss, si.wi, wo), 0)
            return value

        def _density(self, si: Any, wo: Any, ink: Any, coated: Any) -> Any:
            materials = self.materials
            assert materials is not None
            matt = wo.z / dr.pi
            density = mi.Float(matt)
            if materials.retro:
                density = dr.select(ink > 0, (matt + retro_pdf(materials.retro, si.wi, wo)) / 2, density)
            if materials.gloss:
                density = dr.select(coated, (matt + coat_pdf(materials.gloss, si.wi, wo)) / 2, density)
            return density

        def sample(self, ctx, si, sample1, sample2, active=True):  # type: ignore[no-untyped-def]
            materials = self.materials
            assert materials is not None
            active = active & (si.wi.z > 0)
            ink, coated = self._special(si)
            lobe = sample1 < 0.5
            wo = mi.warp.square_to_cosine_hemisphere(sample2)
            if materials.retro:
                wo = dr.select(lobe & (ink > 0), sample_retro(materials.retro, si.wi, sample2), wo)
            if materials.gloss:
                wo = dr.select(lobe & coated, sample_coat(materials.gloss, si.wi, sample2), wo)
            bs = mi.BSDFSample3f(wo)
            bs.pdf = self._density(si, wo, ink, coated)
            bs.eta = 1.0
            bs.sampled_type = mi.UInt32(+mi.BSDFFlags.DiffuseReflection)
            bs.sampled_component = mi.UInt32(0)
            active &= (wo.z > 0) & (bs.pdf > 0)
            value = dr.select(active, self._value(si, wo, ink, coated) / bs.pdf, 0)
            bs.pdf = dr.select(active, bs.pdf, 0)
            return bs, mi.Color1f(value)

        def eval(self, ctx, si, wo, active=True):  # type: ignore[no-untyped-def]
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx, si, wo, active=True):  # type: ignore[no-untyped-def]
            return self.eval_pdf(ctx, si, wo, active)[1]

        def eval_pdf(self, ctx, si, wo, active=True):  # type: ignore[no-untyped-def]
            ink, coated = self._special(si)
            above = active & (si.wi.z > 0) & (wo.z > 0)
            value = dr.select(above, self._value(si, wo, ink, coated), 0)
            return mi.Color1f(value), dr.select(above, self._density(si, wo, ink, coated), 0)

        def to_string(self):  # type: ignore[no-untyped-def]
            return "Paint[]"

    mi.register_bsdf("testfield_paint", Paint)
    return Paint


@lru_cache
def luminous_texture_class() -> type:
    """Radiance of luminous panels: the print's coverage times the ink's radiance. Registered once."""
    mi = mitsuba()
    import drjit as dr

    class LuminousTexture(mi.Texture):  # type: ignore[name-defined]
        def __init__(self, props: Any):
            super().__init__(props)
            self.texture: Any = None
            self.materials: Materials | None = None

        def eval_1(self, si, active=True):  # type: ignore[no-untyped-def]
            materials = self.materials
            assert materials is not None
            ink = self.texture.coverage(si, (0.0, 0.0), 1)
            shining = active & materials.carries(self.texture.panel(si), LUMINOUS)
            return dr.select(shining, ink * materials.luminous_radiance, 0)

        def eval(self, si, active=True):  # type: ignore[no-untyped-def]
            return mi.Color1f(self.eval_1(si, active))

        def sample_position(self, sample, active=True):  # type: ignore[no-untyped-def]
            return sample, mi.Float(1)

        def pdf_position(self, pos, active=True):  # type: ignore[no-untyped-def]
            return mi.Float(1)

        def mean(self):  # type: ignore[no-untyped-def]
            return mi.Float(0.5)

        def is_spatially_varying(self):  # type: ignore[no-untyped-def]
            return True

        def to_string(self):  # type: ignore[no-untyped-def]
            return "LuminousTexture[]"

    mi.register_texture("testfield_luminous", LuminousTexture)
    return LuminousTexture
