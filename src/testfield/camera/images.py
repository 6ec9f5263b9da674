"""The two images a camera gives: radiance before the sensor, and the digital frame after it."""

import errno
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from pydantic import Field

from testfield.errors import TestfieldError, speaking
from testfield.store.sheets import FORMAT, Sheet, Size, checked, read_json
from testfield.store.text import write_text


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

    def noise_line(self) -> tuple[float, float, float]:
        """A pixel's variance as a line of its mean: in DN squared what it has without light, by how much it grows a DN
        of the mean, and the mean in DN from which on it grows. It is read noise, shot noise and quantisation; of a
        balanced mosaic that of its four kinds on the average."""
        squares, gain = sum(g * g for g in self.balance) / len(self.balance), sum(self.balance) / len(self.balance)
        dark = squares * (self.read_noise_e**2 / self.gain_e_per_dn**2 + 1 / 12)
        return dark, gain / self.gain_e_per_dn, self.black_level_dn

    def variance_dn2(self, mean_dn: np.ndarray) -> np.ndarray:
        """Variance of a pixel of given mean, as of `noise_line`, in DN squared."""
        dark, slope, zero_dn = self.noise_line()
        return dark + np.maximum(slope * (mean_dn - zero_dn), 0)


@dataclass(frozen=True)
class InvertedSheet(SensorSheet):
    """The sheet of an image whose values were turned upside down, so that dark marks are bright."""

    def noise_line(self) -> tuple[float, float, float]:
        """The line of a pixel whose inverted value has the given mean: it falls."""
        dark, slope, zero_dn = super().noise_line()
        return dark, -slope, self.largest_dn - zero_dn


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
        write_text(
            path.with_suffix(".json"),
            json.dumps({"format": FORMAT, "station": self.station, **asdict(self.sheet)}, indent=1),
        )

    @staticmethod
    def load(path: Path, station: str | None = None) -> "Frame":
        """Read what `save` wrote. Raises `TestfieldError` where the file is no readable image, its sheet none of a
        sensor, or of another `station` than is asked for."""
        data = np.frombuffer(path.read_bytes(), np.uint8)
        try:
            pixels = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
        except cv2.error:  # of an image that says it is larger than any
            pixels = None
        if pixels is None:
            raise TestfieldError("not a readable image", str(path), "expose again, or replace the file")
        if pixels.ndim != 2 or pixels.dtype.kind != "u":
            raise TestfieldError(
                f"an image of shape {pixels.shape} and type {pixels.dtype}", str(path), "give one grey channel"
            )
        name, sheet = load_sheet(path.with_suffix(".json"))
        if station not in (None, name):
            raise TestfieldError(
                f"this sheet is of station '{name}' and not of '{station}'",
                str(path.with_suffix(".json")),
                "give each frame its own",
            )
        return Frame(name, pixels, sheet)


Factor = Annotated[float, Field(ge=1e-6, le=1e6)]


class _SheetFile(Sheet):
    station: str
    gain_e_per_dn: Factor
    read_noise_e: Annotated[float, Field(ge=0, le=1e6)]
    black_level_dn: Size
    bits: Annotated[int, Field(ge=1, le=16)]
    full_well_e: Annotated[float, Field(gt=0)] = float("inf")
    bayer: Literal["RGGB", "BGGR", "GRBG", "GBRG"] | None = None
    balance: tuple[Factor, ...] = (1.0,)


@speaking("sensor sheet")
def load_sheet(path: Path) -> tuple[str, SensorSheet]:
    """A frame's station and sensor sheet. Raises `TestfieldError` where the file is none."""
    file = checked(_SheetFile, read_json(path))
    if len(file.balance) not in (1, 4):
        raise ValueError(f"balance: {len(file.balance)} factors instead of 1, or 4 of a mosaic")
    if file.black_level_dn >= 2**file.bits - 1:
        raise ValueError(f"black_level_dn: {file.black_level_dn} is not below the largest number of {file.bits} bits")
    return file.station, SensorSheet(**file.model_dump(exclude={"station"}))


@dataclass(frozen=True)
class Radiance:
    """Radiance in W / (m^2 sr) averaged over each pixel: `values` (h, w) float32, from the `station` named.

    Raises `TestfieldError` where a value is no finite number: later stages could not tell.
    """

    station: str
    values: np.ndarray

    def __post_init__(self) -> None:
        wrong = ~np.isfinite(self.values)
        if wrong.any():
            row, column = np.argwhere(wrong)[0]
            raise TestfieldError(
                f"the radiance of {wrong.sum()} pixels is no finite number, the first at x = {column}, y = {row}",
                f"station {self.station}",
                "report this, with the scene",
            )

    def save(self, path: Path) -> None:
        """Write a one-channel float32 EXR, which every reader of EXR can read.

        Without compression: ZIPS takes nine times the processor's time to save a twentieth of the size.
        """
        import OpenEXR

        header = {
            "compression": OpenEXR.NO_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            "station": self.station,
            "format": str(FORMAT),
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
        """Read what `save` wrote. Raises `TestfieldError` where the file is no readable EXR of finite radiance."""
        import OpenEXR

        try:
            with OpenEXR.File(str(path)) as file:
                station, values = file.header()["station"], np.array(file.channels()["Y"].pixels)
        except (RuntimeError, ValueError, LookupError, TypeError, OSError, MemoryError) as error:
            reason = " ".join(str(error).split())[:200]
            raise TestfieldError(f"not a readable radiance image ({reason})", str(path), "render again") from error
        if values.ndim != 2 or values.dtype.kind != "f" or not isinstance(station, str):
            raise TestfieldError(f"radiance of shape {values.shape}, type {values.dtype}", str(path), "render again")
        if (values < 0).any():
            raise TestfieldError("radiance below zero", str(path), "render again")
        try:
            return Radiance(station, values.astype(np.float32))
        except TestfieldError as error:
            raise TestfieldError(f"{error.where}: {error.what}", str(path), "render again") from None
