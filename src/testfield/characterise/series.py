"""The frames that characterise a camera: levels of light and exposure time, each with two frames or more."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from testfield.camera.mosaic import ORDERS
from testfield.characterise.camera_raw import CAMERA_RAW, read_camera_raw
from testfield.errors import TestfieldError

MOST_MEGAPIXELS = 160


@dataclass(frozen=True)
class Level:
    """Frames that were all taken under one light with one exposure time. `time_ms` None where nobody said; `light` the
    photons a pixel, or in any unit proportional to them, 0 without light."""

    images: tuple[Path, ...]
    time_ms: float | None
    light: float

    @property
    def dark(self) -> bool:
        """Whether no light fell."""
        return self.light == 0


@dataclass(frozen=True)
class Series:
    """All levels; `photons` says that their light is counted in photons a pixel. `bits` of the converter (None: by the
    largest number), `bayer` the colour filters of a mosaic, `shape` (h, w) of frames without a header, `source` as
    messages call it. The rest is what a scene's camera has and no frame shows."""

    levels: tuple[Level, ...]
    photons: bool
    source: str
    bits: int | None = None
    bayer: str | None = None
    shape: tuple[int, int] | None = None
    wavelength_nm: float | None = None
    pixel_pitch_um: float | None = None
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        if self.bayer is not None and self.bayer not in ORDERS:
            raise TestfieldError(f"no Bayer order is called '{self.bayer}'", self.source, f"one of {', '.join(ORDERS)}")
        for level in self.levels:
            if len(level.images) < 2:
                name = level.images[0].name if level.images else "none"
                raise TestfieldError(
                    f"a level of one frame ('{name}'): noise is what two frames of one level differ by",
                    self.source,
                    "give two frames or more of every level",
                )
        if not any(level.dark for level in self.levels):
            raise TestfieldError("no dark frames", self.source, "give two frames without light, or more")


def read_raw(path: Path, shape: tuple[int, int] | None) -> np.ndarray:
    """(h, w) the numbers that a file holds, uint8 or uint16, as they are.

    `.raw` files are bare rows of little-endian 16-bit numbers (8-bit where the file is half as long) of `shape`.
    Raises `TestfieldError` where the file is no such image.
    """
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise TestfieldError(f"cannot be read ({error.strerror})", str(path), "give an image file") from error
    if path.suffix.lower() in CAMERA_RAW:
        return read_camera_raw(path)[0]
    if path.suffix.lower() == ".raw":
        if shape is None or data.size not in (shape[0] * shape[1], 2 * shape[0] * shape[1]):
            raise TestfieldError(f"{data.size} bytes are no image of {shape}", str(path), "state width and height")
        return data.view("<u2" if data.size == 2 * shape[0] * shape[1] else np.uint8).reshape(shape)
    try:
        raw = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    except cv2.error:
        raw = None
    if raw is None:
        raise TestfieldError("not a readable image", str(path), "give a PNG or a TIFF, or .raw with a descriptor")
    if (
        raw.ndim == 3
        and raw.shape[2] >= 3
        and (raw[..., 0] == raw[..., 1]).all()
        and (raw[..., 1] == raw[..., 2]).all()
    ):
        raw = raw[..., 0]
    if raw.ndim != 2 or raw.dtype not in (np.uint8, np.uint16):
        raise TestfieldError(
            f"an image of shape {raw.shape} and type {raw.dtype}",
            str(path),
            "give the sensor's own numbers: one channel of 8 or 16 bits",
        )
    if raw.size > 1e6 * MOST_MEGAPIXELS:
        raise TestfieldError(f"{raw.size / 1e6:.0f} megapixels; the most is {MOST_MEGAPIXELS}", str(path), "cut it")
    return raw


@dataclass(frozen=True)
class Stack:
    """What `count` frames of one level say of each pixel: `mean_dn` (h, w), and their temporal `variance_dn2` (h, w),
    what frames differ by as wholes taken out; `light_noise`, the relative standard deviation of whole frames' means."""

    count: int
    mean_dn: np.ndarray
    variance_dn2: np.ndarray
    frame_mean_dn: np.ndarray
    top_share: float
    zero_share: float
    step: int
    largest: int


def stack_of(level: Level, shape: tuple[int, int] | None, seen: Callable[[Path], None]) -> Stack:
    """Mean and variance of each pixel over a level's frames, read one after the other.

    EMVA 1288 release 4.0, sections 6.6 and 8.2: the variance of frames is freed of the variance of the light from frame
    to frame, which moves all pixels alike. Raises `TestfieldError` where frames are of different sizes.
    """
    first = read_raw(level.images[0], shape)
    total, squares = np.zeros(first.shape), np.zeros(first.shape)
    means, step, zeros, largest, tops = [], 0, 0, 0, 0
    for path in level.images:
        raw = first if path == level.images[0] else read_raw(path, shape)
        seen(path)
        if raw.shape != first.shape:
            raise TestfieldError(
                f"{raw.shape[1]} x {raw.shape[0]} px and not {first.shape[1]} x {first.shape[0]} px as others",
                str(path),
                "give frames of one camera, uncropped",
            )
        if step != 1:
            step = int(np.gcd(step, np.gcd.reduce(raw, axis=None)))
        top = int(raw.max())
        tops = int((raw == top).sum()) + (tops if top == largest else 0) if top >= largest else tops
        largest = max(largest, top)
        zeros += int((raw == 0).sum())
        # Differences to the first frame keep the sums small, so that subtracting their squares loses no digits.
        off = raw.astype(np.float64)
        off -= first
        frame_mean = float(off.mean())
        means.append(float(first.mean(dtype=np.float64)) + frame_mean)
        total += off
        off -= frame_mean
        squares += off * off
    n = len(level.images)
    mean = total / n
    own = mean - mean.mean()
    variance = (squares - n * own * own) / (n - 1)
    return Stack(
        n,
        mean + first,
        np.maximum(variance, 0),
        np.array(means),
        tops / (n * first.size),
        zeros / (n * first.size),
        step,
        largest,
    )


def channels_of(bayer: str | None) -> tuple[tuple[str, tuple[slice, slice]], ...]:
    """Names of a sensor's kinds of pixels, and where they are: all of a grey one's, or R, G1, G2, B of a mosaic."""
    if bayer is None:
        return (("grey", (slice(None), slice(None))),)
    greens: Iterator[str] = iter(("G1", "G2"))
    names = [next(greens) if colour == "G" else colour for colour in bayer]
    places = [(slice(r, None, 2), slice(c, None, 2)) for r in (0, 1) for c in (0, 1)]
    return tuple(
        sorted(zip(names, places, strict=True), key=lambda item: "RGB".index(item[0][0]) * 10 + int(item[0][1:] or 0))
    )
