"""Raw files of photographers' cameras (DNG, NEF, CR3 and others): the sensor's own numbers, by LibRaw through rawpy."""

from pathlib import Path

import numpy as np

from testfield.camera.mosaic import ORDERS
from testfield.errors import TestfieldError

CAMERA_RAW = (".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw")
"""Endings of files that hold a mosaic as its makers wrote it."""


def read_camera_raw(path: Path) -> tuple[np.ndarray, str | None]:
    """(h, w) uint16 numbers of the pixels that see light, as the converter gave them with its black level in them, and
    the order of their colour filters, None of a grey sensor.

    Raises `TestfieldError` where rawpy is not installed, the file is none that LibRaw reads, or its filters are not in
    squares of two by two (Foveon, X-Trans).
    """
    try:
        import rawpy
    except ImportError as error:
        raise TestfieldError(
            "camera raw files are read by rawpy, which is not installed",
            str(path),
            "pip install 'testfield[raw]', or give TIFF or PNG with the sensor's own numbers",
        ) from error
    try:
        with rawpy.imread(str(path)) as raw:
            pixels, colours = np.array(raw.raw_image_visible), np.array(raw.raw_colors_visible)
            letters = raw.color_desc.decode()
    except (rawpy.LibRawError, OSError) as error:
        raise TestfieldError(f"LibRaw cannot read it ({error})", str(path), "give a DNG, or TIFF or PNG") from error
    if pixels.ndim != 2:
        raise TestfieldError("no mosaic: every pixel has three colours already", str(path), "give the raw file")
    if len(np.unique(colours)) == 1:
        return pixels.astype(np.uint16), None
    order = "".join(letters[colours[r, c]] for r in (0, 1) for c in (0, 1))
    height, width = (2 * (n // 2) for n in colours.shape)
    square = np.tile(colours[:2, :2], (height // 2, width // 2))
    if order not in ORDERS or (colours[:height, :width] != square).any():
        raise TestfieldError(
            "its colour filters are not those of Bayer", str(path), "give a camera with a Bayer mosaic"
        )
    return pixels.astype(np.uint16), order
