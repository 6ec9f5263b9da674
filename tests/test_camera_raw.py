"""Raw files of photographers' cameras, and times of EMVA descriptors in another unit."""

import struct
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.characterise.camera_raw import read_camera_raw
from testfield.characterise.sources import series_of
from testfield.errors import TestfieldError


def write_dng(path: Path, pixels: np.ndarray, pattern: bytes = b"\x01\x00\x02\x01") -> None:
    """An uncompressed DNG 1.4 of one strip (Adobe's specification); `pattern` 0 red, 1 green, 2 blue."""
    h, w = pixels.shape
    one = struct.pack("<9i", *[v for k in range(9) for v in (int(k % 4 == 0),)])
    matrix = b"".join(struct.pack("<ii", v, 1) for v in struct.unpack("<9i", one))
    long, short, byte, text, signed = 4, 3, 1, 2, 10
    entries = [
        (254, long, 1, struct.pack("<I", 0)),
        (256, long, 1, struct.pack("<I", w)),
        (257, long, 1, struct.pack("<I", h)),
        (258, short, 1, struct.pack("<H", 16)),
        (259, short, 1, struct.pack("<H", 1)),
        (262, short, 1, struct.pack("<H", 32803)),
        (271, text, 5, b"Self\0"),
        (272, text, 5, b"Made\0"),
        (273, long, 1, None),
        (277, short, 1, struct.pack("<H", 1)),
        (278, long, 1, struct.pack("<I", h)),
        (279, long, 1, struct.pack("<I", 2 * h * w)),
        (33421, short, 2, struct.pack("<HH", 2, 2)),
        (33422, byte, 4, pattern),
        (50706, byte, 4, bytes([1, 4, 0, 0])),
        (50708, text, 10, b"Self Made\0"),
        (50717, long, 1, struct.pack("<I", 4095)),
        (50721, signed, 9, matrix),
    ]
    tail, table, after = b"", b"", 8 + 2 + 12 * len(entries) + 4
    longer = sum(len(v) + len(v) % 2 for *_, v in entries if v is not None and len(v) > 4)
    for tag, kind, count, value in entries:
        value = struct.pack("<I", after + longer) if value is None else value
        if len(value) > 4:
            place = struct.pack("<I", after + len(tail))
            tail += value + b"\0" * (len(value) % 2)
        else:
            place = value.ljust(4, b"\0")
        table += struct.pack("<HHI", tag, kind, count) + place
    head = b"II*\0" + struct.pack("<I", 8) + struct.pack("<H", len(entries))
    path.write_bytes(head + table + struct.pack("<I", 0) + tail + pixels.astype("<u2").tobytes())


def test_a_dng_gives_the_numbers_and_the_filters_that_were_written(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 4096, (64, 96)).astype(np.uint16)
    for pattern, order in ((b"\x01\x00\x02\x01", "GRBG"), (b"\x00\x01\x01\x02", "RGGB")):
        write_dng(tmp_path / "a.dng", pixels, pattern)
        read, bayer = read_camera_raw(tmp_path / "a.dng")
        assert bayer == order
        assert (read == pixels).all()


def test_a_folder_of_dngs_is_a_mosaic_without_being_told(tmp_path: Path) -> None:
    pixels = np.full((64, 96), 300, np.uint16)
    for name in ("dark_1ms_a", "dark_1ms_b", "flat_1ms_a", "flat_1ms_b"):
        write_dng(tmp_path / f"{name}.dng", pixels)
    series = series_of(tmp_path)
    assert series.bayer == "GRBG"
    assert len(series.levels) == 2


def test_without_rawpy_the_file_and_the_package_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rawpy", None)
    with pytest.raises(TestfieldError, match="rawpy") as caught:
        read_camera_raw(tmp_path / "a.nef")
    assert "a.nef" in str(caught.value)


@pytest.mark.parametrize(("unit", "per_ms", "doubtful"), [(None, 1e-6, True), ("us", 1e-3, False), ("ms", 1.0, False)])
def test_times_of_a_descriptor_are_nanoseconds_unless_told(
    tmp_path: Path, unit: str | None, per_ms: float, doubtful: bool
) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((4, 4), 9, np.uint8))
    lines = "n 8 4 4\nd 0\ni a.png\ni a.png\nb 3960.00 18.25\ni a.png\ni a.png\n"
    (tmp_path / "data.txt").write_text(lines)
    series = series_of(tmp_path / "data.txt", unit)
    assert series.levels[1].time_ms == pytest.approx(3960 * per_ms)
    assert bool(series.notes) == doubtful


def test_the_full_well_of_a_mosaic_is_that_of_pixels_that_were_full(tmp_path: Path) -> None:
    from testfield.characterise.characterise import characterise

    rng, well, response = np.random.default_rng(1), 3000.0, np.tile([[1.0, 0.4], [0.4, 1.0]], (24, 32))
    for k in range(14):
        for name in "ab":
            light = rng.poisson(300.0 * (k + 1) * response)
            seen = np.minimum(light, well) + rng.normal(0, 4, light.shape) + 100
            write_dng(tmp_path / f"flat_{k + 1}ms_{name}.dng", np.rint(seen).astype(np.uint16))
            write_dng(
                tmp_path / f"dark_{k + 1}ms_{name}.dng", np.rint(rng.normal(100, 4, light.shape)).astype(np.uint16)
            )
    sheet = characterise(series_of(tmp_path))
    assert sheet.figures["full_well_e"].value == pytest.approx(well, rel=0.05)
