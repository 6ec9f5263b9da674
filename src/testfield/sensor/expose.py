"""Photons, electrons, digital numbers (EMVA 1288 release 4.0, linear model)."""

import math
from dataclasses import dataclass

import numpy as np

from testfield.camera.images import Frame, Radiance, SensorSheet
from testfield.seeds import Plane
from testfield.sensor.patterns import BayerOrder, filter_pattern, gain_pattern, offset_pattern_e
from testfield.sensor.poisson import poisson_quantile

PLANCK_J_S, LIGHT_M_S = 6.62607015e-34, 299792458.0
BLOCK_PX = 32_000
"""Pixels exposed at once: few enough for the processor's cache."""


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

    Every pixel has numbers of its own, by seed, station, row and column: one for electrons and one for the read-out,
    used by inversion. So what changes in one pixel changes no other, and a little more light changes a few pixels by
    one electron. The fixed patterns are the sensor's: they depend on the seed alone and are the same at every station.
    `noise_seed` takes the seed's place for the noise: another exposure by the same sensor.
    """
    values = radiance.values
    drawn = seed if noise_seed is None else noise_seed
    of_electrons, of_readout = (Plane(drawn, f"expose/{radiance.station}/{name}") for name in ("electrons", "read-out"))
    gain = _response(values.shape, sensor, seed)
    offset_e = offset_pattern_e(values.shape, sensor.dsnu_e, seed) if sensor.dsnu_e else None
    height, width = values.shape
    pixels = np.empty(values.shape, np.uint16)
    for rows in _blocks(height, width):
        here = slice(rows.start, rows.stop)
        mean_e = np.maximum(values[here].astype(np.float64), 0)
        mean_e *= sensor.electrons_per_radiance
        if gain is not None:
            mean_e *= gain[here]
        mean_e += sensor.dark_e
        electrons = poisson_quantile(of_electrons.uniforms(rows, width), mean_e)
        np.minimum(electrons, sensor.full_well_e, out=electrons)
        if offset_e is not None:
            # An offset of the read-out, like the read noise: it has no shot noise and takes no room in the well.
            electrons += offset_e[here]
        if sensor.read_noise_e:
            electrons += sensor.read_noise_e * of_readout.normals(rows, width)
        electrons /= sensor.gain_e_per_dn
        electrons += sensor.black_level_dn
        np.rint(electrons, out=electrons)
        pixels[here] = np.clip(electrons, 0, sensor.sheet.largest_dn, out=electrons)
    return Frame(radiance.station, pixels, sensor.sheet)


def _response(shape: tuple[int, ...], sensor: Sensor, seed: int) -> np.ndarray | None:
    """(h, w) what filters and response nonuniformity leave of the light; None where that is all of it."""
    height, width = shape
    filters = filter_pattern((height, width), sensor.bayer, sensor.bayer_response) if sensor.bayer else None
    response = gain_pattern((height, width), sensor.prnu, seed) if sensor.prnu else None
    if filters is None or response is None:
        return response if filters is None else filters
    return filters * response


def _blocks(height: int, width: int) -> list[range]:
    """An image's rows in blocks."""
    step = max(1, BLOCK_PX // width)
    return [range(first, min(first + step, height)) for first in range(0, height, step)]
