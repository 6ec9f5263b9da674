"""Photons, electrons, digital numbers (EMVA 1288 release 4.0, linear model)."""

import math
from dataclasses import dataclass

import numpy as np

from testfield.camera.images import Frame, Radiance, SensorSheet
from testfield.seeds import generator
from testfield.sensor.patterns import BayerOrder, filter_pattern, gain_pattern, offset_pattern_e

PLANCK_J_S, LIGHT_M_S = 6.62607015e-34, 299792458.0


@dataclass(frozen=True)
class Sensor:
    """A sensor and how it is exposed; the fields are those of the scene file's `sensor`, `exposure` and `camera`."""

    pixel_pitch_um: float
    f_number: float
    time_ms: float
    wavelength_nm: float
    quantum_efficiency: float
    full_well_e: float
    read_noise_e: float
    gain_e_per_dn: float
    black_level_dn: float
    bits: int
    dark_current_e_per_s: float = 0.0
    prnu: float = 0.0
    dsnu_e: float = 0.0
    bayer: BayerOrder | None = None
    bayer_response: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def electrons_per_radiance(self) -> float:
        """Mean electrons a pixel gathers for a radiance of one W/(m^2 sr).

        On-axis image irradiance of a lens is pi L / (4 N^2); the photon count follows from the pixel's area, the
        time and the photon energy h c / lambda.
        """
        irradiance = np.pi / (4 * self.f_number**2)
        energy = irradiance * (self.pixel_pitch_um * 1e-6) ** 2 * self.time_ms * 1e-3
        return self.quantum_efficiency * energy * self.wavelength_nm * 1e-9 / (PLANCK_J_S * LIGHT_M_S)

    @property
    def dark_e(self) -> float:
        """Mean electrons that the dark current leaves in a pixel while the shutter is open."""
        return self.dark_current_e_per_s * self.time_ms * 1e-3

    @property
    def sheet(self) -> SensorSheet:
        """What the data sheet tells the measuring side.

        The sheet knows no dark current. Its mean is told as part of the black level, its shot noise (variance equal to
        the mean) as part of the read noise, and the room it takes in the well as a smaller well.
        """
        black_dn, noise_e, well_e = self.black_level_dn, self.read_noise_e, self.full_well_e
        if self.dark_e:  # else the numbers stay as the scene file has them, integers too: frames keep their bytes
            black_dn += self.dark_e / self.gain_e_per_dn
            noise_e = math.sqrt(noise_e**2 + self.dark_e)
            well_e = max(well_e - self.dark_e, 0.0)
        return SensorSheet(self.gain_e_per_dn, noise_e, black_dn, self.bits, well_e, self.bayer)


def expose(radiance: Radiance, sensor: Sensor, seed: int, noise_seed: int | None = None) -> Frame:
    """One frame: colour filters, response, dark current, shot noise, full well, offsets, read noise, digits.

    The noise is drawn from the generator named `expose/<station>`, so frames can be made in any order. The fixed
    patterns are the sensor's: they depend on the seed alone and are the same at every station. What is switched off
    draws nothing. `noise_seed` takes the seed's place for the noise: another exposure by the same sensor.
    """
    rng = generator(seed if noise_seed is None else noise_seed, f"expose/{radiance.station}")
    mean_e = np.maximum(radiance.values.astype(np.float64), 0) * sensor.electrons_per_radiance
    if sensor.bayer:
        mean_e *= filter_pattern(mean_e.shape, sensor.bayer, sensor.bayer_response)
    if sensor.prnu:
        mean_e *= gain_pattern(mean_e.shape, sensor.prnu, seed)
    electrons = np.minimum(rng.poisson(mean_e + sensor.dark_e), sensor.full_well_e).astype(np.float64)
    if sensor.dsnu_e:
        # An offset of the read-out, like the read noise: it has no shot noise and takes no room in the well.
        electrons += offset_pattern_e(electrons.shape, sensor.dsnu_e, seed)
    electrons += sensor.read_noise_e * rng.standard_normal(electrons.shape)
    digital = np.rint(electrons / sensor.gain_e_per_dn + sensor.black_level_dn)
    pixels = np.clip(digital, 0, sensor.sheet.largest_dn).astype(np.uint16)
    return Frame(radiance.station, pixels, sensor.sheet)
