"""Whether rings are the ones that were read: each is fitted and compared with its image."""

from dataclasses import replace

import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres
from testfield.detect.centre_ring import Fitted, Rings, fit_with_rings
from testfield.detect.ring_shape import seen_shape
from testfield.targets.marks import RingRadii

OTHERS = 8
"""How many of the least doubtful tell how well rings and images usually agree."""
DISAGREE, DISAGREE_SIGMAS, BY_CHANCE, MOST_USUAL = 0.03, 6.5, 4.0, 9.0
"""A ring is not the one that was read where a patch of pixels departs from its model by the first, as a fraction of the
contrast, and by the second in sigmas; by more where a photograph's least doubtful rings depart by more than the
third, as its print and its lens may have it. More than the last is never held to be usual."""
USUAL_PATCH, MOST_USUAL_PATCH, LEAST_RINGS = 3.0, 0.09, 3
"""Sharpening, JPEG and ink leave all rings of a photograph patches that no noise explains. So a ring of it must depart
by the first times what its least doubtful rings do, of which more than the second is never held to be usual; fewer than
the third tell nothing. A segment that is hidden or wrong departs by half of the contrast and more."""


def compared(
    image: np.ndarray, sheet: SensorSheet, rough: Centres, rings: Rings, doubt: np.ndarray, photograph: bool
) -> tuple[Fitted, np.ndarray, RingRadii]:
    """The fits of n rings as read in an image (h, w) of bright marks, with the `doubt` (n,) of `decode`; which (n,)
    disagree with their images; and the rings' shape.

    In a photograph most cannot be wrong: where most disagree or all depart they are of another shape than one was told,
    and if they agree on one, that is taken.
    """
    fitted = fit_with_rings(image, sheet, rough, rings, photograph)
    disagree = _disagree(fitted, doubt, photograph)
    if photograph and (disagree.sum() > len(doubt) / 2 or _usual_patch(fitted, doubt) > MOST_USUAL_PATCH):
        seen = seen_shape(image, rough.xy_px, rough.moments_px2, rough.contrast_dn, rough.background_dn)
        if seen is not None and seen != rings.radii:
            again = fit_with_rings(image, sheet, rough, replace(rings, radii=seen), photograph)
            if _usual_patch(again, doubt) < _usual_patch(fitted, doubt):
                return again, _disagree(again, doubt, photograph), seen
    return fitted, disagree, rings.radii


def _disagree(fitted: Fitted, doubt: np.ndarray, photograph: bool) -> np.ndarray:
    """(n,) which rings are not as the image has them: where something dark hides segments, another number is read."""
    sigmas, usual = fitted.patch_sigmas, 0.0
    if photograph and len(doubt):
        usual = min(float(np.median(sigmas[np.argsort(doubt)[:OTHERS]])), MOST_USUAL)
    least = DISAGREE
    if photograph and len(doubt) >= LEAST_RINGS:
        least = max(DISAGREE, USUAL_PATCH * min(_usual_patch(fitted, doubt), MOST_USUAL_PATCH))
    beyond_chance = np.sqrt(max(usual**2 - BY_CHANCE**2, 0))
    return (fitted.patch > least) & (sigmas > DISAGREE_SIGMAS + 5 * beyond_chance)


def _usual_patch(fitted: Fitted, doubt: np.ndarray) -> float:
    """By how much the least doubtful rings depart, as a part of the contrast; 0 where there are none."""
    return float(np.median(fitted.patch[np.argsort(doubt)[:OTHERS]])) if len(doubt) else 0.0
