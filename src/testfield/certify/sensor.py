"""Is the sensor the one of its data sheet? Photon transfer after EMVA 1288 release 4.0 linear, from frames alone."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from scipy import constants

from testfield.camera.images import Radiance
from testfield.certify.verdict import Verdict
from testfield.sensor.expose import Sensor, expose

TRUE = Sensor(
    pixel_pitch_um=3.45,
    f_number=8.0,
    time_ms=24.0,
    wavelength_nm=550.0,
    quantum_efficiency=0.63,
    full_well_e=10400.0,
    read_noise_e=2.3,
    gain_e_per_dn=2.6,
    black_level_dn=64.0,
    bits=12,
    dark_current_e_per_s=5.0,
    prnu=0.005,
    dsnu_e=1.5,
)
"""The sensor under test: the figures of a global-shutter CMOS of 3.45 um."""

SHAPE = (400, 500)
SEED = 1288
QUANTISATION_DN2 = 1 / 12
"""Variance of rounding to whole digital numbers."""
FIT_TO = 0.7
"""Part of saturation up to which lines are fitted (EMVA 1288 release 4.0 linear, sensitivity)."""


@dataclass(frozen=True)
class FlatSeries:
    """Frames of an evenly lit sensor, all in DN, uint16.

    `photons` (n,) a pixel, from dark to beyond saturation; `pairs` (n, 2, h, w) one pair a level; `dark` and `half`
    (m, h, w) repeats without light and at 50 % of saturation; `photons_half` a pixel in the latter.
    """

    photons: np.ndarray
    pairs: np.ndarray
    dark: np.ndarray
    half: np.ndarray
    photons_half: float


@dataclass(frozen=True)
class Figures:
    """What photon transfer says of a sensor; `dark_noise_e` is temporal, `prnu` relative."""

    gain_e_per_dn: float
    quantum_efficiency: float
    dark_noise_e: float
    prnu: float
    dsnu_e: float


def photons_per_radiance(sensor: Sensor) -> float:
    """Mean photons that fall on a pixel for a radiance of one W/(m^2 sr).

    E = pi L / (4 N^2), then A E t lambda / (h c) (EMVA 1288 release 4.0 linear, model). Worked out here once more and
    not taken from the sensor, so that an error there shows as a wrong quantum efficiency.
    """
    photon_j = constants.h * constants.c / (sensor.wavelength_nm * 1e-9)
    irradiance_w_m2 = np.pi / (2 * sensor.f_number) ** 2
    return float(irradiance_w_m2 * (sensor.pixel_pitch_um * 1e-6) ** 2 * (sensor.time_ms / 1e3) / photon_j)


def flat_series(sensor: Sensor, levels: int, repeats: int) -> FlatSeries:
    """Expose the sensor to even light: pairs at `levels` levels and `repeats` frames in the dark and at 50 %."""
    per_radiance = photons_per_radiance(sensor)
    saturation = sensor.full_well_e / sensor.quantum_efficiency
    # A little beyond saturation, so that the fall of the variance shows where it is.
    photons = np.linspace(0, 1.05 * saturation, levels)

    def frames(name: str, level: float, count: int) -> np.ndarray:
        light = np.full(SHAPE, level / per_radiance, np.float32)
        return np.stack([expose(Radiance(f"{name}/{k}", light), sensor, SEED).pixels_dn for k in range(count)])

    pairs = np.stack([frames(f"pair/{k}", level, 2) for k, level in enumerate(photons)])
    half = saturation / 2
    return FlatSeries(photons, pairs, frames("dark", 0, repeats), frames("half", half, repeats), half)


def evaluate(series: FlatSeries) -> Figures:
    """Photon transfer after EMVA 1288 release 4.0 linear; knows the frames and the photons, not the sensor.

    Sensitivity: slopes through the origin of variance against mean (K, DN an electron) and of mean against photons (R),
    dark values subtracted; quantum efficiency R / K; dark noise from the dark pair. Nonuniformity: spatial variance of
    the averaged frames less what the temporal noise leaves there. No high pass: the light is even.
    """
    first, second = series.pairs[:, 0].astype(np.float64), series.pairs[:, 1].astype(np.float64)
    mean_dn = (first + second).mean((1, 2)) / 2
    difference = first - second
    variance_dn2 = ((difference**2).mean((1, 2)) - difference.mean((1, 2)) ** 2) / 2

    signal_dn, shot_dn2 = mean_dn - mean_dn[0], variance_dn2 - variance_dn2[0]
    saturation_dn = signal_dn[np.argmax(variance_dn2)]
    fit = signal_dn <= FIT_TO * saturation_dn
    gain_dn_per_e = _slope(signal_dn[fit], shot_dn2[fit])
    responsivity = _slope(series.photons[fit], signal_dn[fit])

    half_dn, half_dn2 = _spatial(series.half)
    dark_dn, dark_dn2 = _spatial(series.dark)
    return Figures(
        gain_e_per_dn=1 / gain_dn_per_e,
        quantum_efficiency=responsivity / gain_dn_per_e,
        dark_noise_e=_root(variance_dn2[0] - QUANTISATION_DN2) / gain_dn_per_e,
        prnu=_root(half_dn2 - dark_dn2) / (half_dn - dark_dn),
        dsnu_e=_root(dark_dn2) / gain_dn_per_e,
    )


def _slope(x: np.ndarray, y: np.ndarray) -> float:
    """Slope of the line through the origin with the least squares in y."""
    return float(x @ y / (x @ x))


def _root(variance: float) -> float:
    """Square root; not a number where noise made a variance negative, and then no verdict passes."""
    return float(np.sqrt(variance)) if variance >= 0 else float("nan")


def _spatial(frames: np.ndarray) -> tuple[float, float]:
    """Mean and spatial variance (DN, DN squared) of (m, h, w) frames, the averaged temporal noise subtracted."""
    count = len(frames)
    average = frames.mean(0)
    temporal_dn2 = frames.var(0, ddof=1).mean()
    return float(average.mean()), float(average.var(ddof=1) - temporal_dn2 / count)


def emva1288_figures(series: FlatSeries) -> Figures:
    """What the package `emva1288` makes of the same frames.

    Its own reduction of images to sums is used as well. Raises `ImportError` where it is not installed, and
    `AttributeError` where it calls what this NumPy no longer has.
    """
    with _asfarray_again():
        return _emva1288_figures(series)


@contextmanager
def _asfarray_again() -> Iterator[None]:
    """For as long as it lasts NumPy has `asfarray` again, which the package still calls and NumPy 2 no longer has."""
    name = "asfarray"
    if hasattr(np, name):
        yield
        return
    setattr(np, name, lambda a: np.asarray(a, float))
    try:
        yield
    finally:
        delattr(np, name)


def _emva1288_figures(series: FlatSeries) -> Figures:
    from emva1288.process import Data1288, Results1288
    from emva1288.process.routines import get_int_imgs

    def sums(frames: np.ndarray) -> dict:
        whole = get_int_imgs(list(frames))
        return whole | {"sum": whole["sum"].sum(), "pvar": whole["pvar"].sum()}

    height, width = series.dark.shape[1:]
    levels = {float(photons): sums(pair) for photons, pair in zip(series.photons, series.pairs, strict=True)}
    spatial = {0.0: get_int_imgs(list(series.dark)), series.photons_half: get_int_imgs(list(series.half))}
    time_ns = 0.0  # one exposure time for all: it is only a key
    images = {"width": width, "height": height, "temporal": {time_ns: levels}, "spatial": {time_ns: spatial}}
    found = Results1288(Data1288(images, loglevel=logging.WARNING).data, loglevel=logging.WARNING)
    return Figures(1 / found.K, found.QE / 100, found.sigma_d, found.PRNU1288 / 100, found.DSNU1288)


def _against_truth(found: Figures, true: Sensor) -> list[Verdict]:
    dark_noise_e = float(np.sqrt(true.read_noise_e**2 + true.dark_current_e_per_s * true.time_ms / 1e3))
    truth = Figures(true.gain_e_per_dn, true.quantum_efficiency, dark_noise_e, true.prnu, true.dsnu_e)
    pairs = "pairs of flat fields up to 70 % of saturation"
    claims = {
        "gain_e_per_dn": ("gain", 0.01, f"Slope of temporal variance against mean, {pairs}"),
        "quantum_efficiency": ("quantum efficiency", 0.01, f"Responsivity over gain, {pairs}"),
        "dark_noise_e": ("dark noise", 0.01, "Temporal variance of a dark pair without that of quantisation"),
        "prnu": ("PRNU", 0.01, "Spatial variance of averaged frames at 50 % and in the dark"),
        "dsnu_e": ("DSNU", 0.02, "Spatial variance of averaged dark frames"),
    }
    return [
        Verdict("sensor", name, _relative(found, truth, field), limit, "relative", f"{how}, against the true value.")
        for field, (name, limit, how) in claims.items()
    ]


def _cross_check(series: FlatSeries, own: Figures) -> list[Verdict]:
    """Our evaluation against that of `emva1288`; nothing but a note in the log where that package cannot run."""
    try:
        theirs = emva1288_figures(series)
    except (ImportError, AttributeError) as error:
        logging.getLogger(__name__).warning("no cross-check with the package emva1288: %s", error)
        return []
    names = {"gain_e_per_dn": "gain", "quantum_efficiency": "quantum efficiency", "dark_noise_e": "dark noise"}
    how = "The package emva1288 evaluates the same frames; difference from our evaluation."
    return [
        Verdict("sensor", f"{name}, emva1288", _relative(own, theirs, field), 0.01, "relative", how)
        for field, name in names.items()
    ]


def _relative(measured: Figures, true: Figures, field: str) -> float:
    return abs(getattr(measured, field) / getattr(true, field) - 1)


def certify_sensor(quick: bool) -> list[Verdict]:
    """Verdicts on gain, quantum efficiency, dark noise and both nonuniformities of frames made by `expose`.

    `quick` takes fewer levels and repeats. With the optional package `emva1288` there are three more verdicts: its
    evaluation of the same frames against ours.
    """
    series = flat_series(TRUE, levels=12, repeats=16) if quick else flat_series(TRUE, levels=25, repeats=64)
    own = evaluate(series)
    return _against_truth(own, TRUE) + _cross_check(series, own)
