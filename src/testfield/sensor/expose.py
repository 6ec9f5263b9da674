"""Photons, electrons, digital numbers (EMVA 1288 release 4.0, linear model)."""

from dataclasses import dataclass

import numpy as np

from testfield.camera.images import Frame, Radiance, SensorSheet
from testfield.seeds import generator

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
    def sheet(self) -> SensorSheet:
        """What the data sheet tells the measuring side."""
        return SensorSheet(self.gain_e_per_dn, self.read_noise_e, self.black_level_dn, self.bits, self.full_well_e)


def expose(radiance: Radiance, sensor: Sensor, seed: int) -> Frame:
    """One frame: shot noise, full well, read noise, gain, black level, quantisation.

    The noise is drawn from the generator named `expose/<station>`, so frames can be made in any order.
    """
    rng = generator(seed, f"expose/{radiance.station}")
    mean_e = np.maximum(radiance.values.astype(np.float64), 0) * sensor.electrons_per_radiance
    electrons = np.minimum(rng.poisson(mean_e), sensor.full_well_e).astype(np.float64)
    electrons += sensor.read_noise_e * rng.standard_normal(electrons.shape)
    digital = np.rint(electrons / sensor.gain_e_per_dn + sensor.black_level_dn)
    pixels = np.clip(digital, 0, sensor.sheet.largest_dn).astype(np.uint16)
    return Frame(radiance.station, pixels, sensor.sheet)
