"""First coefficients of a lens model, from the radial terms of homographies."""

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.lens import distort
from testfield.camera.rough_lens import RoughLens

STEEPEST = 4.0
"""Tangent of the angle to which a model is fitted: 76 degrees; beyond, polynomials of the tangent fail."""
NODES = 50


def lens_start(interior: Interior, free: np.ndarray, rough: RoughLens) -> Interior:
    """The camera with those radial coefficients that are `free` (n,) fitted to a rough lens; all others, and all where
    that is a pinhole, stay as they are."""
    model = interior.lens
    radial = [k for k, name in enumerate(interior.names) if free[k] and name in model.radial_terms]
    if not rough.bends or not radial:
        return interior
    r = (np.arange(NODES) + 1) / NODES
    depth = rough.depth(r**2)
    image, tangent = r * rough.radius_px / interior.fx, r * rough.radius_px / interior.fx / depth
    # Only what lies before the first ray that is too steep.
    good = np.cumprod((depth > 0) & (tangent < STEEPEST)).astype(bool)
    image, plain = image[good], np.column_stack([tangent[good], np.zeros(good.sum())])
    if len(plain) <= len(radial):
        return interior
    rest = interior.parameters.copy()
    rest[radial] = 0.0
    missing = image - distort(model, plain, rest[4:])[:, 0]
    by = model.by_coefficients(plain, rest[4:])[:, 0, np.array(radial) - 4]
    # Errors count in the image, and a coefficient that hardly moves anything stays small.
    size = np.linalg.norm(by, axis=0)
    rest[radial] = np.linalg.lstsq(by / size, missing, rcond=1e-4)[0] / size
    return interior.with_parameters(rest)
