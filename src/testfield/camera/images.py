"""The two images a camera gives: radiance before the sensor, and the digital frame after it."""

import errno
import json
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np

from testfield.errors import TestfieldError
from testfield.store.text import read_text, write_text


@dataclass(frozen=True)
class SensorSheet:
    """What a sensor's data sheet tells a measuring person.

    `gain_e_per_dn` electrons a digital number, `read_noise_e` rms, `black_level_dn`, `bits` of the converter,
    `full_well_e` at which a pixel saturates. `bayer` the colour filters of a mosaic (`mosaic.ORDERS`), none for a grey
    sensor; `balance` by which the mosaic's four kinds of pixels were multiplied to be alike.
    """

    gain_e_per_dn: float
    read_noise_e: float
    black_level_dn: float
    bits: int
    full_well_e: float = float("inf")
    bayer: str | None = None
    balance: tuple[float, ...] = (1.0,)

    @property
    def largest_dn(self) -> int:
        """The largest digital number."""
        return (1 << self.bits) - 1

    @property
    def saturation_dn(self) -> float:
        """The level at which a pixel saturates, by its full well or by the converter."""
        top = min(self.largest_dn - self.black_level_dn, self.full_well_e / self.gain_e_per_dn)
        return float(self.black_level_dn + min(self.balance) * top)

    def variance_dn2(self, mean_dn: np.ndarray) -> np.ndarray:
        """Variance of a pixel of given mean: read noise, shot noise and quantisation, in DN squared; of a balanced
        mosaic that of its four kinds on the average."""
        electrons = np.maximum(mean_dn - self.black_level_dn, 0) * self.gain_e_per_dn
        squares, gain = sum(g * g for g in self.balance) / len(self.balance), sum(self.balance) / len(self.balance)
        return (squares * self.read_noise_e**2 + gain * electrons) / self.gain_e_per_dn**2 + squares / 12


@dataclass(frozen=True)
class InvertedSheet(SensorSheet):
    """The sheet of an image whose values were turned upside down, so that dark marks are bright."""

    def variance_dn2(self, mean_dn: np.ndarray) -> np.ndarray:
        """Variance of a pixel whose inverted value has the given mean."""
        return super().variance_dn2(self.largest_dn - mean_dn)


@dataclass(frozen=True)
class Frame:
    """A digital image: `pixels_dn` (h, w) uint16, from the `station` named, by the sensor of `sheet`."""

    station: str
    pixels_dn: np.ndarray
    sheet: SensorSheet

    def save(self, path: Path) -> None:
        """Write a 16-bit PNG, and what the sensor did beside it as JSON."""
        done, data = cv2.imencode(".png", self.pixels_dn, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not done:
            raise TestfieldError("the image could not be encoded as PNG", str(path))
        path.write_bytes(data.tobytes())
        write_text(path.with_suffix(".json"), json.dumps({"station": self.station, **asdict(self.sheet)}, indent=1))

    @staticmethod
    def load(path: Path) -> "Frame":
        """Read what `save` wrote. Raises `TestfieldError` where the file is no readable image."""
        data = np.frombuffer(path.read_bytes(), np.uint8)
        pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
        if pixels is None:
            raise TestfieldError("not a readable image", str(path), "expose again, or replace the file")
        if pixels.ndim != 2 or pixels.dtype.kind != "u":
            raise TestfieldError(
                f"an image of shape {pixels.shape} and type {pixels.dtype}", str(path), "give one grey channel"
            )
        notes = path.with_suffix(".json")
        try:
            sheet = json.loads(read_text(notes))
            station, balance = sheet.pop("station"), tuple(sheet.pop("balance", (1.0,)))
            return Frame(station, pixels, SensorSheet(**sheet, balance=balance))
        except (ValueError, KeyError, TypeError) as error:
            raise TestfieldError(
                f"no readable sensor sheet ({error})", str(notes), "expose again, or replace it"
            ) from error


@dataclass(frozen=True)
class Radiance:
    """Radiance in W / (m^2 sr) averaged over each pixel: `values` (h, w) float32, from the `station` named."""

    station: str
    values: np.ndarray

    def save(self, path: Path) -> None:
        """Write a one-channel float32 EXR."""
        import OpenEXR

        header = {
            "compression": OpenEXR.ZIPS_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            "station": self.station,
        }
        try:
            with OpenEXR.File(header, {"Y": np.ascontiguousarray(self.values, np.float32)}) as file:
                file.write(str(path))
        except RuntimeError as error:
            # The library turns a failed write into its own error and keeps only the message.
            number = errno.ENOSPC if "No space left" in str(error) else errno.EIO
            raise OSError(number, str(error), str(path)) from error

    @staticmethod
    def load(path: Path) -> "Radiance":
        """Read what `save` wrote. Raises `TestfieldError` where the file is no readable EXR."""
        import OpenEXR

        try:
            with OpenEXR.File(str(path)) as file:
                return Radiance(file.header()["station"], np.array(file.channels()["Y"].pixels))
        except (RuntimeError, ValueError, KeyError, OSError) as error:
            raise TestfieldError(f"not a readable radiance image ({error})", str(path), "render again") from error
