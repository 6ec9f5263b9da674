"""Observations that a program of somebody's own, or files made elsewhere, give of one frame."""

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from testfield.camera.images import Frame
from testfield.detect.centres_file import read_centres
from testfield.detect.named import named, needs_names
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.aside import aside
from testfield.measure.outside import Program, Results
from testfield.measure.programs import result_of
from testfield.targets.field import Field


def by_program(frame: Frame, field: Field, program: Program) -> Observations:
    """What a program writes of a frame into its CSV file (OWN_ALGORITHMS.md).

    Raises `TestfieldError` where it fails, or writes what cannot be.
    """
    with TemporaryDirectory(prefix="testfield-") as folder:
        work = Path(folder)
        files = {name: work / file for name, file in FILES.items()}
        frame.save(files["image"])
        if "{image8}" in program.command:
            files["image8"].write_bytes(cv2.imencode(".png", eight_bits(frame))[1].tobytes())
        if "{pgm}" in program.command:
            files["pgm"].write_bytes(pgm(frame))
        field.save(files["sheet"])
        about = f"station {frame.station}"
        result = result_of(program, files, work, about, "csv")
        try:
            return with_names(read_centres(result, frame.station, field, size_of(frame)), frame, field)
        except TestfieldError as error:
            where = f"{program.name}, {about}, {result.name}"
            raise TestfieldError(error.what, where, error.do) from error


FILES = {"image": "image.png", "image8": "image8.png", "pgm": "image.pgm", "sheet": "field.json", "csv": "centres.csv"}
"""The names of a program's files in a folder of its own."""


def eight_bits(frame: Frame) -> np.ndarray:
    """(h, w) uint8: black to the level at which pixels are full, as most image libraries take it."""
    black, full = frame.sheet.black_level_dn, frame.sheet.saturation_dn
    # As floats: a sheet's black level may be a whole number, and 16 bits do not hold 255 times a pixel.
    return np.clip(np.rint(255.0 * (frame.pixels_dn.astype(float) - black) / max(full - black, 1.0)), 0, 255).astype(
        np.uint8
    )


def pgm(frame: Frame) -> bytes:
    """A binary PGM file of 16 bits, high byte first: what a program can read without any library."""
    width, height = size_of(frame)
    return f"P5\n{width} {height}\n65535\n".encode() + frame.pixels_dn.astype(">u2").tobytes()


def with_names(seen: Observations, frame: Frame, field: Field) -> Observations:
    """The same, under this project's own names where whoever measured gave none; naming is not whose time is told."""
    if not needs_names(seen):
        return seen
    with aside():
        return named(seen, frame, field, SMALLEST_PX)


SMALLEST_PX = 5.0
"""Marks of less are not named."""


def size_of(frame: Frame) -> tuple[int, int]:
    """Width and height in px."""
    height, width = frame.pixels_dn.shape
    return width, height


def from_files(frame: Frame, field: Field, results: Results) -> Observations:
    """What lies in a folder of this frame: STATION.csv or STATION.parquet. Raises `TestfieldError` where nothing
    does."""
    for suffix in (".csv", ".parquet"):
        path = results.folder / f"{frame.station}{suffix}"
        if path.is_file():
            return with_names(read_centres(path, frame.station, field, size_of(frame)), frame, field)
    raise TestfieldError(
        f"there is no {frame.station}.csv", str(results.folder), "put the observations of every station there"
    )
