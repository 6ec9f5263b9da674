"""A camera's sheet from its frames: one for each kind of pixels, and the sensor that a scene can use."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from testfield.characterise.figures import Figure
from testfield.characterise.series import Series, Stack, channels_of, stack_of
from testfield.characterise.sheet import ChannelSheet, sheet_of

BITS = (8, 10, 12, 14, 16)
OF_CAPACITY = (
    "saturation_e",
    "full_well_e",
    "dynamic_range",
    "dynamic_range_db",
    "snr_max",
    "snr_max_db",
)
"""Figures that only pixels tell which were full."""


@dataclass(frozen=True)
class CameraSheet:
    """What was found of a camera: a sheet for each kind of its pixels, `bits`, size in px (width, height)."""

    series: Series
    bits: int
    size_px: tuple[int, int]
    channels: tuple[ChannelSheet, ...]
    notes: tuple[str, ...]

    @property
    def figures(self) -> dict[str, Figure]:
        """Figures of the whole sensor: of a mosaic the mean over its kinds of pixels."""
        first = self.channels[0].figures
        if len(self.channels) == 1:
            return first
        shared = [name for name in first if all(name in one.figures for one in self.channels)]
        # Where some kinds of pixels were full, the others' capacity is but a bound, and not the sensor's.
        full = [one for one in self.channels if one.transfer.saturated] or list(self.channels)
        return {
            name: _mean([one.figures[name] for one in (full if name in OF_CAPACITY else self.channels)])
            for name in shared
        }


def characterise(series: Series, seen: Callable[[Path], None] = lambda path: None) -> CameraSheet:
    """Read all frames, level by level, and compute all figures; `seen` is told of each image that was read.

    Raises `TestfieldError` where frames cannot be read or are too few.
    """
    stacks = [stack_of(level, series.shape, seen) for level in series.levels]
    step = int(np.gcd.reduce([stack.step for stack in stacks])) or 1
    notes = list(series.notes)
    if step > 1:
        notes.append(f"all numbers are multiples of {step}: the converter's own were shifted, and are counted")
        stacks = [_divided(stack, step) for stack in stacks]
    largest = max(stack.largest for stack in stacks)
    bits = series.bits
    if bits is None:
        bits = next(b for b in BITS if largest < 1 << b)
        notes.append(f"the largest number is {largest}: taken as {bits} bits")
    elif largest >= 1 << bits:
        notes.append(f"numbers reach {largest}, beyond {bits} bits")
    shape = stacks[0].mean_dn.shape
    channels = tuple(
        sheet_of(name, series.levels, [_part(s, where) for s in stacks], series.photons, (1 << bits) - 1, series.source)
        for name, where in channels_of(series.bayer)
    )
    own = [f"{one.name + ': ' if series.bayer else ''}{note}" for one in channels for note in one.notes]
    return CameraSheet(series, bits, (shape[1], shape[0]), channels, (*notes, *dict.fromkeys(own)))


def _part(stack: Stack, where: tuple[slice, slice]) -> Stack:
    mean = stack.mean_dn[where]
    shift = mean.mean() - stack.mean_dn.mean()
    return replace(
        stack, mean_dn=mean, variance_dn2=stack.variance_dn2[where], frame_mean_dn=stack.frame_mean_dn + shift
    )


def _divided(stack: Stack, step: int) -> Stack:
    return replace(
        stack,
        mean_dn=stack.mean_dn / step,
        variance_dn2=stack.variance_dn2 / step**2,
        frame_mean_dn=stack.frame_mean_dn / step,
        largest=stack.largest // step,
    )


def _mean(figures: list[Figure]) -> Figure:
    values = np.array([one.value for one in figures])
    return Figure(
        float(values.mean()), float(np.sqrt(sum(one.u**2 for one in figures))) / len(figures), figures[0].unit
    )


def scene_tables(sheet: CameraSheet) -> dict[str, dict[str, Any]]:
    """`sensor` and `camera` as a scene file has them, of what was measured alone.

    A scene's PRNU and DSNU are white, so they are the parts of single pixels, freed of uneven light.
    """
    f = sheet.figures
    sensor: dict[str, Any] = {
        "bits": sheet.bits,
        "full_well_e": _digits(f["full_well_e"]),
        "read_noise_e": _digits(f["read_noise_e"]),
        "gain_e_per_dn": _digits(f["gain_e_per_dn"]),
        "black_level_dn": _digits(f["black_level_dn"]),
        "prnu": _digits(Figure(f["prnu_white_percent"].value / 100, f["prnu_white_percent"].u / 100, "")),
        "dsnu_e": _digits(f["dsnu_white_e"]),
    }
    if "dark_current_mean_e_per_s" in f:
        sensor["dark_current_e_per_s"] = max(_digits(f["dark_current_mean_e_per_s"]), 0.0)
    if "quantum_efficiency" in f and 0 < f["quantum_efficiency"].value <= 1:
        sensor["quantum_efficiency"] = _digits(f["quantum_efficiency"])
    if sheet.series.wavelength_nm:
        sensor["wavelength_nm"] = sheet.series.wavelength_nm
    if sheet.series.bayer:
        sensor["bayer"] = sheet.series.bayer
        each: dict[str, list[float]] = {colour: [] for colour in "RGB"}
        for one in sheet.channels:
            if one.transfer.response:
                each[one.name[0]].append(one.transfer.response.slope / one.transfer.gain.slope)
        if all(each.values()):
            green = float(np.mean(each["G"]))
            sensor["bayer_response"] = [round(float(np.mean(each[c])) / green, 5) for c in "RGB"]
    camera: dict[str, Any] = {"width_px": sheet.size_px[0], "height_px": sheet.size_px[1]}
    if sheet.series.pixel_pitch_um:
        camera["pixel_pitch_um"] = sheet.series.pixel_pitch_um
    return {"sensor": sensor, "camera": camera}


def _digits(figure: Figure) -> float:
    """The value with two digits more than its uncertainty has."""
    u = figure.u if np.isfinite(figure.u) and figure.u > 0 else abs(figure.value) * 1e-6
    places = int(np.clip(2 - np.floor(np.log10(max(u, 1e-12))), 0, 12))
    return round(float(figure.value), places)
