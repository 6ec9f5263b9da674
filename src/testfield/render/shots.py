"""An exposure as a few sharp pictures: points of the aperture and moments of time, the same for every pixel."""

import numpy as np

from testfield.scene.blur import blur_circles_px, streaks_px
from testfield.scene.sunflower import sunflower
from testfield.scene.world import World

FEWEST = 8


def shots(world: World, station: int, most: int) -> np.ndarray:
    """(k, 3) x and y on the entrance pupil in mm, and time in s from the middle of a row's exposure.

    As many as the largest blur of any mark needs, `most` at the utmost; one where nothing blurs. The pupil's points are
    a sunflower's, of equal areas; the times are the middles of equal parts, in another order. To each shot belongs the
    opposite one, so that blur moves nothing.
    """
    if not world.optics.aperture_mm and not world.motion.moves:
        return np.zeros((1, 3))
    circle, streak = (
        float(np.nan_to_num(blur(world, station)).max(initial=0)) for blur in (blur_circles_px, streaks_px)
    )
    half = max(1, min(most, int(FEWEST + circle**2 + 2 * streak)) // 2)
    k = np.arange(half)
    pupil = sunflower(half)
    if half > 1:
        # A few points are a little longer one way than the other: make their second moments a disc's, exactly.
        length, way = np.linalg.eigh(pupil.T @ pupil / half)
        pupil = pupil @ (way / np.sqrt(4 * length)) @ way.T
    signed = (k * 0.7548776662466927 + 0.25) % 1 - 0.5
    part = np.sign(signed + 1e-12) * (np.argsort(np.argsort(np.abs(signed))) + 0.5) / (2 * half)
    one = np.column_stack([pupil * world.optics.aperture_mm / 2, part * world.motion.exposure_s])
    return np.concatenate([one, -one])
