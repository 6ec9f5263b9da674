"""A rough radial lens, as homographies need one."""

from dataclasses import dataclass

import numpy as np

FARTHEST = 1.2
"""Part of the outermost observation's radius to which the radial terms mean anything."""
TERMS = 3
NEWTON_STEPS = 6


@dataclass(frozen=True)
class RoughLens:
    """A lens by its radial terms: `terms` (3,) of r / `radius_px` about `middle_px` (2,)."""

    middle_px: np.ndarray
    radius_px: float
    terms: np.ndarray

    @staticmethod
    def pinhole(middle_px: np.ndarray, radius_px: float) -> "RoughLens":
        """A lens without distortion."""
        return RoughLens(np.asarray(middle_px, float), radius_px or 1.0, np.zeros(TERMS))

    @property
    def bends(self) -> bool:
        """Whether it is more than a pinhole."""
        return bool(self.terms.any())

    def depth(self, r2: np.ndarray) -> np.ndarray:
        """Third component of the rays whose other two are x and y, by the squared radius."""
        a, b, c = self.terms
        return np.asarray(1 + r2 * (a + r2 * (b + r2 * c)))

    def rays(self, xy_px: np.ndarray) -> np.ndarray:
        """(n, 3) of pixels (n, 2)."""
        side = (xy_px - self.middle_px) / self.radius_px
        return np.concatenate([side, self.depth((side**2).sum(axis=-1, keepdims=True))], axis=-1)

    def straight(self, xy_px: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) as a lens without distortion would show them."""
        ray = self.rays(xy_px)
        return np.asarray(self.middle_px + self.radius_px * ray[:, :2] / ray[:, 2:])

    def pixels(self, ray: np.ndarray) -> np.ndarray:
        """(..., 2) of rays (..., 3), NaN where no pixel near the image has such a ray."""
        side, z = np.linalg.norm(ray[..., :2], axis=-1), ray[..., 2]
        with np.errstate(all="ignore"):
            if not self.bends:
                r = np.where(z > 0, side / z, np.nan)
            else:
                # The first term alone has a closed form.
                r = 2 * side / (z + np.sqrt(np.maximum(z**2 - 4 * self.terms[0] * side**2, 0)))
                r = np.where(np.isfinite(r) & (r >= 0), np.minimum(r, FARTHEST), FARTHEST)
                a, b, c = self.terms
                for _ in range(NEWTON_STEPS if self.terms[1:].any() else 0):
                    s = r * r
                    slope = z - side * r * (2 * a + s * (4 * b + s * 6 * c))
                    r = np.clip(r - (r * z - side * self.depth(s)) / slope, 0, FARTHEST)
                off = np.abs(r * z - side * self.depth(r * r))
                r = np.where(off < 1e-6 * (np.abs(z) + side), r, np.nan)
            scale = self.radius_px * np.where(side > 0, r / side, 1 / z)
            return np.asarray(self.middle_px + scale[..., None] * ray[..., :2])
