"""What the levels of one kind of pixels say: means, temporal variances and their uncertainties."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testfield.characterise.series import Level, Stack


@dataclass(frozen=True)
class Curve:
    """Levels of one kind, all arrays (n,): exposure time (NaN unknown), light, mean and temporal variance of a pixel
    over its frames, averaged over pixels, with standard uncertainties; number of frames; the largest number's share."""

    time_ms: np.ndarray
    light: np.ndarray
    mean_dn: np.ndarray
    u_mean_dn: np.ndarray
    var_dn2: np.ndarray
    u_var_dn2: np.ndarray
    frames: np.ndarray
    top_share: np.ndarray

    def __len__(self) -> int:
        return len(self.mean_dn)

    def of(self, chosen: np.ndarray) -> "Curve":
        """Some of the levels, by number or mask."""
        return Curve(**{name: values[chosen] for name, values in vars(self).items()})


def curve_of(levels: Sequence[Level], stacks: Sequence[Stack], dark_dn: float) -> Curve:
    """The levels in the order of their light (of their time in the dark).

    u of a variance comes from how the pixels' variances scatter, u of a mean from temporal noise and from how frames of
    one level differ as wholes: of lit ones in proportion to the light above `dark_dn`, pooled over all levels.
    """
    pixels = stacks[0].mean_dn.size if stacks else 1
    mean = np.array([stack.mean_dn.mean() for stack in stacks])
    n = np.array([stack.count for stack in stacks])
    var = np.array([stack.variance_dn2.mean() for stack in stacks])
    u_var = np.array([stack.variance_dn2.std() / np.sqrt(pixels) for stack in stacks])
    light = np.array([level.light for level in levels])
    of_frames = np.array([stack.frame_mean_dn.var(ddof=1) for stack in stacks]) - var / pixels
    lit = light != 0
    signal = np.where(lit, np.maximum(mean - dark_dn, 1e-9), 1.0)
    shared = np.zeros(len(stacks))
    for kind in (lit, ~lit):
        if kind.any():
            relative = of_frames[kind] / signal[kind] ** 2
            usable = relative if not lit[kind].any() else relative[signal[kind] > 0.05 * signal[kind].max()]
            pooled = float(np.average(usable, weights=n[kind][-len(usable) :] - 1)) if len(usable) else 0.0
            shared[kind] = max(pooled, 0.0) * signal[kind] ** 2
    u_mean = np.sqrt((shared + var / pixels) / n)
    time = np.array([np.nan if level.time_ms is None else level.time_ms for level in levels])
    tops = np.array([stack.top_share for stack in stacks])
    # A dark one by its time; lit ones by light, by mean where light is not known.
    order = np.lexsort((mean, np.nan_to_num(light), np.nan_to_num(time) * ~lit))
    return Curve(time, light, mean, u_mean, var, np.maximum(u_var, 1e-12), n, tops).of(order)


def weights_of_darks(time_ms: np.ndarray, dark_ms: np.ndarray) -> np.ndarray:
    """(n, darks) how much each dark level counts for lit levels of the given times: those of the same time, averaged,
    else the two that are next in time, else all alike."""
    if np.isnan(time_ms).any() or np.isnan(dark_ms).any():
        return np.full((len(time_ms), len(dark_ms)), 1 / len(dark_ms))
    times = np.unique(dark_ms)
    belongs = (dark_ms[None, :] == times[:, None]).astype(float)
    belongs /= belongs.sum(axis=1, keepdims=True)
    between = np.stack([np.interp(time_ms, times, column) for column in np.eye(len(times))], axis=1)
    return between @ belongs
