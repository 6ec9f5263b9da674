"""Every figure of one kind of pixels, with its standard uncertainty."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testfield.characterise.curve import Curve, curve_of
from testfield.characterise.figures import Figure, Line, straight
from testfield.characterise.series import Level, Stack
from testfield.characterise.spatial import PARTS, Spatial, root, spatial_of, without_uneven_light
from testfield.characterise.transfer import Transfer, transfer_of
from testfield.errors import TestfieldError

QUANTISATION_DN2, LEAST_DARK_DN2 = 1 / 12, 0.24
"""Variance of rounding to whole numbers, and the least dark variance from which EMVA 1288 lets noise be computed."""
LEAST_TIMES = LEAST_LEVELS = 3
STACK_RATIO = 4
"""A level of more than so many times the usual number of frames is a stack for nonuniformity."""
MOST_ZEROS = 0.005
"""Share of zeros in darks from which their noise is cut off."""


@dataclass(frozen=True)
class ChannelSheet:
    """The figures of one kind of pixels by name, the curves they come from, the images of the two stacks that tell
    nonuniformity (mean in DN, freed of uneven light), and what a reader should be warned of."""

    name: str
    figures: dict[str, Figure]
    lit: Curve
    dark: Curve
    transfer: Transfer
    dark_mean: Line | None
    dark_var: Line | None
    dark_image_dn: np.ndarray
    lit_image_dn: np.ndarray
    stack_frames: tuple[int, int]
    largest_dn: int
    notes: tuple[str, ...]


def sheet_of(
    name: str, levels: Sequence[Level], stacks: Sequence[Stack], photons: bool, largest_dn: int, source: str
) -> ChannelSheet:
    """The sheet of the pixels in `stacks`, one for each level; `largest_dn` of the converter.

    Raises `TestfieldError` where there are too few levels for the gain.
    """
    is_dark = np.array([level.dark for level in levels])
    darks, brights = np.flatnonzero(is_dark).tolist(), np.flatnonzero(~is_dark).tolist()
    if len(brights) < LEAST_LEVELS:
        raise TestfieldError(
            f"{len(brights)} lit level(s), and {LEAST_LEVELS} below 70 % of saturation are needed for the gain",
            source,
            "give pairs at more levels of light (the standard asks for 50, equally spaced)",
        )
    counts = np.array([stack.count for stack in stacks])
    below, above = (_temporal_levels(chosen, counts) for chosen in (darks, brights))
    dark = curve_of([levels[k] for k in below], [stacks[k] for k in below], 0.0)
    zero = float(dark.mean_dn[0])
    lit = curve_of([levels[k] for k in above], [stacks[k] for k in above], zero)
    transfer = transfer_of(lit, dark, source)
    notes: list[str] = []
    mean_line, var_line = _over_time(dark)
    figures, K = _temporal(lit, dark, transfer, mean_line, var_line, photons, largest_dn, notes)
    # The stack of most frames tells of nonuniformity; among equals, that nearest to half of saturation.
    half = 0.5 * transfer.signal_dn[transfer.saturation]
    best = min(brights, key=lambda k: (-stacks[k].count, abs(stacks[k].mean_dn.mean() - zero - half)))
    time = levels[best].time_ms
    under = min(darks, key=lambda k: (-stacks[k].count, abs((levels[k].time_ms or 0) - (time or 0))))
    images = _nonuniformity(figures, stacks[best], stacks[under], K)
    frames = (stacks[best].count, stacks[under].count)
    if min(frames) < 16:
        notes.append(f"nonuniformity is from {min(frames)} frames; the standard asks for 16 or more, better 100 to 400")
    if max(stacks[k].zero_share for k in darks) > MOST_ZEROS:
        notes.append("darks are cut off at 0: raise the camera's black level; dark noise and DSNU are too small")
    return ChannelSheet(
        name, figures, lit, dark, transfer, mean_line, var_line, *images, frames, largest_dn, tuple(notes)
    )


def _temporal_levels(chosen: list[int], counts: np.ndarray) -> list[int]:
    """Levels of the photon transfer: without stacks of many frames, which were taken for nonuniformity alone, perhaps
    on another day."""
    most = STACK_RATIO * np.median(counts[chosen])
    return [k for k in chosen if counts[k] <= most] or chosen


def _over_time(dark: Curve) -> tuple[Line | None, Line | None]:
    """Mean and variance of darks over the exposure time in s; None with fewer than three times."""
    times = np.unique(dark.time_ms[np.isfinite(dark.time_ms)])
    if len(times) < LEAST_TIMES:
        return None, None
    s = dark.time_ms / 1000
    return straight(s, dark.mean_dn, dark.u_mean_dn), straight(s, dark.var_dn2, dark.u_var_dn2)


def _temporal(
    lit: Curve,
    dark: Curve,
    t: Transfer,
    mean_line: Line | None,
    var_line: Line | None,
    photons: bool,
    largest_dn: int,
    notes: list[str],
) -> tuple[dict[str, Figure], float]:
    K, rel_K = t.gain.slope, t.gain.u_slope / t.gain.slope
    figures = {
        "gain_dn_per_e": Figure(K, t.gain.u_slope, "DN/e-"),
        "gain_e_per_dn": Figure(1 / K, rel_K / K, "e-/DN"),
    }
    black = (mean_line.offset, mean_line.u_offset) if mean_line else (dark.mean_dn[0], dark.u_mean_dn[0])
    s2, u_s2 = (var_line.offset, var_line.u_offset) if var_line else (dark.var_dn2[0], dark.u_var_dn2[0])
    if s2 < LEAST_DARK_DN2:
        notes.append(f"dark noise is below what {s2:.3f} DN² of quantised numbers show; the standard's bound is taken")
        s2, u_s2 = LEAST_DARK_DN2, LEAST_DARK_DN2 / 2
    dark_dn = float(np.sqrt(s2))
    read = float(np.sqrt(s2 - QUANTISATION_DN2)) / K
    u_read = float(np.hypot(u_s2 / (2 * K * np.sqrt(s2 - QUANTISATION_DN2)), rel_K * read))
    figures |= {
        "black_level_dn": Figure(float(black[0]), float(black[1]), "DN"),
        "dark_noise_dn": Figure(dark_dn, u_s2 / (2 * dark_dn), "DN"),
        "read_noise_e": Figure(read, u_read, "e-"),
    }
    sat = t.saturation_dn / K
    u_sat = float(np.hypot(t.u_saturation_dn / K, rel_K * sat))
    if not t.saturated:
        notes.append("saturation was not reached: its capacity is at least what is stated, and the range is too")
    least = dark_dn / K + 0.5
    u_least = float(np.hypot(u_s2 / (2 * dark_dn) / K, rel_K * dark_dn / K))
    figures["saturation_e"] = Figure(sat, u_sat, "e-")
    well, u_well = sat, u_sat
    if t.plateau_dn is not None:
        well, u_well = t.plateau_dn / K, float(np.hypot(t.u_plateau_dn / K, rel_K * t.plateau_dn / K))
        if t.plateau_dn + black[0] > largest_dn - 1:
            notes.append("the converter ends before the pixel is full: the full well is at least what is stated")
    dr = sat / least
    u_dr = dr * float(np.hypot(u_sat / sat, u_least / least))
    figures |= {
        "full_well_e": Figure(well, u_well, "e-"),
        "least_signal_e": Figure(least, u_least, "e-"),
        "dynamic_range": Figure(dr, u_dr, ""),
        "dynamic_range_db": Figure(20 * float(np.log10(dr)), 20 / float(np.log(10)) * u_dr / dr, "dB"),
        "snr_max": Figure(float(np.sqrt(sat)), u_sat / (2 * float(np.sqrt(sat))), ""),
        "snr_max_db": Figure(10 * float(np.log10(sat)), 10 / float(np.log(10)) * u_sat / sat, "dB"),
    }
    if t.response and photons:
        R, rel_R = t.response.slope, t.response.u_slope / t.response.slope
        rel = float(np.hypot(rel_R, rel_K))
        figures |= {
            "responsivity_dn_per_photon": Figure(R, rel_R * R, "DN/photon"),
            "quantum_efficiency": Figure(R / K, rel * R / K, ""),
            "least_signal_photons": Figure(
                least * K / R, least * K / R * float(np.hypot(u_least / least, rel)), "photons"
            ),
            "saturation_photons": Figure(t.saturation_dn / R, t.u_saturation_dn / R, "photons"),
        }
    elif t.response:
        figures["responsivity_dn_per_light"] = Figure(t.response.slope, t.response.u_slope, "DN/unit")
    if t.linearity:
        off = t.linearity.deviation_percent[np.isfinite(t.linearity.deviation_percent)]
        noise = 100 * float(np.median((lit.u_mean_dn / np.maximum(t.signal_dn, 1e-9))[t.fitted]))
        figures |= {
            "linearity_error_percent": Figure(float(np.abs(off).mean()), noise, "%"),
            "linearity_error_min_percent": Figure(float(off.min()), noise, "%"),
            "linearity_error_max_percent": Figure(float(off.max()), noise, "%"),
        }
    else:
        notes.append("too few levels of known light between 5 and 95 % of saturation for a linearity error")
    if mean_line and var_line:
        for name, line, scale in (("mean", mean_line, 1 / K), ("variance", var_line, 1 / K**2)):
            power = 1 if name == "mean" else 2
            value = line.slope * scale
            u = float(np.hypot(line.u_slope * scale, power * rel_K * value))
            figures[f"dark_current_{name}_e_per_s"] = Figure(value, u, "e-/s")
    else:
        notes.append(f"no dark current: it takes darks of {LEAST_TIMES} exposure times, and these are of fewer")
    return figures, K


def _nonuniformity(figures: dict[str, Figure], lit: Stack, dark: Stack, K: float) -> tuple[np.ndarray, np.ndarray]:
    """Enter DSNU and PRNU, in all parts; returns the two images freed of what changes slowly."""

    def of(image: np.ndarray, stack: Stack) -> Spatial:
        return spatial_of(image, float(stack.variance_dn2.mean()), stack.count)

    rel_K = figures["gain_dn_per_e"].u / K
    below, above = of(dark.mean_dn, dark), of(lit.mean_dn, lit)
    signal = above.mean_dn - below.mean_dn
    for k, part in enumerate(PARTS):
        tail = "" if part == "total" else f"_{part}"
        dsnu, u_dsnu = root(below.s2_dn2[k], below.u_s2_dn2[k])
        figures[f"dsnu{tail}_e"] = Figure(dsnu / K, float(np.hypot(u_dsnu / K, rel_K * dsnu / K)), "e-")
        prnu, u_prnu = root(above.s2_dn2[k] - below.s2_dn2[k], float(np.hypot(above.u_s2_dn2[k], below.u_s2_dn2[k])))
        figures[f"prnu{tail}_percent"] = Figure(100 * prnu / signal, 100 * u_prnu / signal, "%")
    images = []
    for stack in (dark, lit):
        image, share = without_uneven_light(stack.mean_dn)
        images.append(image / np.sqrt(share))
    white = [of(image, stack) for image, stack in zip(images, (dark, lit), strict=True)]
    dsnu, u_dsnu = root(white[0].s2_dn2[3], white[0].u_s2_dn2[3])
    figures["dsnu_white_e"] = Figure(dsnu / K, float(np.hypot(u_dsnu / K, rel_K * dsnu / K)), "e-")
    prnu, u_prnu = root(white[1].s2_dn2[3] - white[0].s2_dn2[3], float(np.hypot(*(w.u_s2_dn2[3] for w in white))))
    figures["prnu_white_percent"] = Figure(100 * prnu / signal, 100 * u_prnu / signal, "%")
    return images[0], images[1]
