"""Photographs that no one described: any image file becomes one grey image, and what was done is said."""

import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from testfield.camera.mosaic import ORDERS, balanced
from testfield.errors import TestfieldError

MOST_MEGAPIXELS = 160
"""Larger images are refused before they are decoded: the largest single exposures have 151."""
LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in the grey image (ITU-R BT.601)."""
FLOAT_TOP_DN = 50000.0
"""What the largest floating-point value becomes: below the end of 16 bits, for nothing says that it is saturated."""
LEAST_MOSAIC, CHEQUERED = 64, 1.08
"""Side in px of images that are asked whether they are mosaics, and by how much one kind of pixels must then be
brighter than another."""
MOST_STEPS = 5000
"""Different values of a floating-point image beyond which they are not taken for a converter's."""
OPENEXR = b"\x76\x2f\x31\x01"


@dataclass(frozen=True)
class Photograph:
    """A grey image of unknown origin: `pixels` (h, w) float32 in 0 to 2**`bits` - 1, `notes` what was done to it;
    `end_dn` the level at which the first of its pixels are full, where that lies below (a balanced mosaic's)."""

    name: str
    pixels: np.ndarray
    bits: int
    notes: tuple[str, ...]
    end_dn: float = float("inf")


def read_photograph(path: Path, bayer: str | None = None) -> Photograph:
    """Read an image file of any kind: colour or grey, 8 to 16 bits or floating point, JPEG, PNG, TIFF, EXR and others.

    `bayer` names the colour filters of a raw mosaic, beginning top left (`ORDERS`). The image is not turned, whatever
    the file says of the camera's attitude: the pixels keep the sensor's order.

    Raises `TestfieldError` where the file is absent, no image, or of more than `MOST_MEGAPIXELS`.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise TestfieldError(f"cannot be read ({error.strerror})", str(path), "give an image file") from error
    if not data:
        raise TestfieldError("an empty file", str(path), "give an image file")
    _check_size(path)
    raw = _read_exr(path) if data[:4] == OPENEXR else _decode(path, data)
    try:
        return photograph_of(path.stem, raw, bayer)
    except ValueError as error:
        raise TestfieldError(str(error), str(path), "give a grey or a colour image") from error


def photograph_of(name: str, raw: np.ndarray, bayer: str | None = None) -> Photograph:
    """A photograph from an array: (h, w) grey, or (h, w, 3 or 4) in OpenCV's order blue, green, red, alpha.

    Raises `ValueError` for anything else.
    """
    if raw.ndim == 3 and raw.shape[2] in (1, 2):
        raw = raw[..., 0]
    if raw.ndim not in (2, 3) or raw.size == 0 or (raw.ndim == 3 and raw.shape[2] not in (3, 4)):
        raise ValueError(f"an array of shape {raw.shape} is no image")
    notes = [f"{raw.shape[1]} x {raw.shape[0]} px, {raw.dtype}"]
    if bayer is not None and raw.ndim == 3:
        raise ValueError("the image has colours already and is no Bayer mosaic")
    if raw.ndim == 3:
        if raw.shape[2] == 4:
            notes.append("transparency dropped")
        colours = raw[..., :3].astype(np.float32)
        grey = colours @ np.array(LUMA[::-1], np.float32)
        notes.append("colours weighted to grey (BT.601)")
        if (
            raw.dtype == np.uint8
            and np.array_equal(raw[..., 0], raw[..., 1])
            and np.array_equal(raw[..., 1], raw[..., 2])
        ):
            notes[-1] = "three equal channels taken as one"
            grey = colours[..., 0]
    else:
        grey = raw.astype(np.float32)
    step = _step(raw)
    if step:
        grey = np.rint(grey / np.float32(step))
        notes.append(f"values are multiples of {step:.6g}: steps of a converter, counted")
    if step:
        shifted = raw.dtype.kind == "u" and np.log2(step).is_integer()  # as cameras store 12 bits in 16
        bits = 8 * raw.dtype.itemsize - int(np.log2(step)) if shifted else _bits_in_use(int(grey.max()), notes)
    elif raw.dtype.kind == "f":
        grey, bits = _scaled(grey, notes), 16
    elif raw.dtype.kind in "ub" and raw.dtype.itemsize <= 2:
        bits = 8 if raw.dtype.itemsize == 1 else _bits_in_use(int(raw.max()), notes)
    else:
        grey, bits = _scaled(grey, notes), 16
    end_dn = float("inf")
    if bayer is not None:
        grey, least_gain = _balance(grey, bayer, notes)
        end_dn = least_gain * ((1 << bits) - 1)
    elif raw.ndim == 2 and min(raw.shape) >= LEAST_MOSAIC:
        gains = balanced(grey)[1]
        if max(gains) > CHEQUERED * min(gains):
            notes.append(f"looks like a Bayer mosaic; if it is one, say which ({', '.join(ORDERS)})")
    return Photograph(name, np.ascontiguousarray(grey, np.float32), bits, tuple(notes), end_dn)


def _step(raw: np.ndarray) -> float:
    """The step of which all values of a grey image are multiples, 0 for none that matters: a converter's numbers stored
    with more bits, or as parts of one. The noise of rounding to it must be known."""
    if raw.ndim != 2 or raw.dtype == np.uint8 or raw.dtype.kind not in "uf":
        return 0.0
    values = np.unique(raw.ravel()[:: max(1, raw.size // 1_000_000)])
    if raw.dtype.kind == "u":
        common = int(np.gcd.reduce(values)) if len(values) > 2 else 1
        return float(common) if common > 1 else 0.0
    if len(values) < MOST_STEPS and len(values) > 16 and np.isfinite(values).all() and values[0] >= 0:
        step = float(np.min(np.diff(values.astype(float))))
        count = values.astype(float) / step
        if count[-1] < 65536 and np.abs(count - np.rint(count)).max() < 0.05:
            return step
    return 0.0


def _check_size(path: Path) -> None:
    """Refuse an enormous image by its header alone, where the header can be read."""
    import warnings

    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                width, height = image.size
    except Image.DecompressionBombError as error:
        pixels = re.search(r"\d+", str(error))
        raise _too_large(path, f"{float(pixels[0]) / 1e6:.0f}" if pixels else "far too many") from error
    except Exception:  # any damage: the decoder that follows has its own say
        return
    if width * height > 1e6 * MOST_MEGAPIXELS:
        raise _too_large(path, f"{width * height / 1e6:.0f}")


def _too_large(path: Path, megapixels: str) -> TestfieldError:
    return TestfieldError(
        f"{megapixels} megapixels; the most is {MOST_MEGAPIXELS}", str(path), "cut the image into parts"
    )


def _decode(path: Path, data: bytes) -> np.ndarray:
    try:
        raw = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        raw = None
    if raw is None or raw.size == 0:
        raise TestfieldError("not a readable image", str(path), "give a PNG, JPEG, TIFF, EXR or the like")
    if raw.shape[0] * raw.shape[1] > 1e6 * MOST_MEGAPIXELS:
        raise _too_large(path, f"{raw.shape[0] * raw.shape[1] / 1e6:.0f}")
    return raw


def _read_exr(path: Path) -> np.ndarray:
    """(h, w) or (h, w, 3) blue, green, red from an EXR's channels."""
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.asarray(channel.pixels, np.float32) for name, channel in file.channels().items()}
    except Exception as error:  # the library's errors are of many kinds
        raise TestfieldError(f"not a readable EXR ({error})", str(path), "give an undamaged image") from error
    last = {name.split(".")[-1].upper(): values for name, values in channels.items()}
    if all(c in last for c in "RGB"):
        return np.stack([last[c] for c in "BGR"], axis=-1)
    for name in ("Y", "G", "R", "Z", *last):
        if name in last:
            return last[name]
    raise TestfieldError("an EXR without channels", str(path), "give an image with Y or R, G, B")


def _bits_in_use(largest: int, notes: list[str]) -> int:
    """Bits of the converter whose numbers a 16-bit file holds, by the largest of them."""
    bits = next(b for b in (8, 10, 12, 14, 16) if largest < 1 << b)
    notes.append(f"largest value {largest}: taken as {bits} bits")
    return bits


def _scaled(grey: np.ndarray, notes: list[str]) -> np.ndarray:
    """Numbers of any range brought to 0 to `FLOAT_TOP_DN`; what is not finite becomes the least or the largest."""
    finite = np.isfinite(grey)
    if not finite.all():
        notes.append(f"{int((~finite).sum())} values that are not finite replaced")
        low, high = (float(grey[finite].min()), float(grey[finite].max())) if finite.any() else (0.0, 0.0)
        grey = np.nan_to_num(grey, nan=low, posinf=high, neginf=low)
    low, high = float(grey.min()), float(grey.max())
    low = min(low, 0.0)
    if high <= low:
        return np.zeros_like(grey)
    notes.append(f"values {low:.4g} to {high:.4g} stretched to 0 to {FLOAT_TOP_DN:.0f}")
    # In double precision: single values may span more than a float32 can subtract.
    return ((grey.astype(np.float64) - low) * (FLOAT_TOP_DN / (float(high) - float(low)))).astype(np.float32)


def _balance(grey: np.ndarray, bayer: str, notes: list[str]) -> tuple[np.ndarray, float]:
    """The mosaic with its four kinds of pixels alike, and the least factor that was needed."""
    if bayer not in ORDERS:
        raise ValueError(f"no Bayer order is called '{bayer}'; choose one of {', '.join(ORDERS)}")
    out, gains = balanced(grey)
    factors = ", ".join(f"{colour} {gain:.3f}" for colour, gain in zip(bayer, gains, strict=True))
    notes.append(f"Bayer mosaic balanced by {factors}, not interpolated")
    return out, float(min(gains))
