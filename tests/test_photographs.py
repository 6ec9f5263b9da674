"""Real photographs of which nothing is known but what they show; and files that are hardly photographs."""

import csv
import json
import struct
import time
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.camera.photograph import photograph_of, read_photograph
from testfield.cli.main import main
from testfield.detect.circle_grid import order_grid
from testfield.detect.noise import estimate_sheet
from testfield.detect.photograph import ON_WHITE, detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.errors import TestfieldError

REAL = Path(__file__).parents[1] / "../shared/real"
real = pytest.mark.skipif(not REAL.is_dir(), reason="the real photographs (../shared/real) are not here")


@real
@pytest.mark.parametrize(
    "name",
    [
        "plate_0005",
        pytest.param("plate_0007", marks=pytest.mark.slow),
        pytest.param("plate_0019", marks=pytest.mark.slow),
    ],
)
def test_ring_codes_of_a_real_plate_are_read(name: str) -> None:
    plate = REAL / "ring14_plate"
    listed = set(json.loads((plate / "ids.json").read_text())[f"{name}.png"])
    found = detect_in_photograph(read_photograph(plate / f"{name}.png"), parse_target("ring14"))
    read = set(found.observations.code.tolist()) - {0}
    assert len(read & listed) >= 0.95 * len(listed)
    assert read <= set(range(2, 75))
    assert found.notes[0] == "white on black"


@real
@pytest.mark.parametrize(
    "change",
    [
        pytest.param("half the light", marks=pytest.mark.slow),
        "saturated",
        "smaller",
        pytest.param("JPEG", marks=pytest.mark.slow),
        "inverted",
    ],
)
def test_a_real_plate_is_read_under_other_circumstances(change: str) -> None:
    plate = REAL / "ring14_plate"
    listed = set(json.loads((plate / "ids.json").read_text())["plate_0005.png"])
    image = cv2.imread(str(plate / "plate_0005.png"), cv2.IMREAD_UNCHANGED)[:700]
    image = {
        "half the light": lambda: image // 2,
        "saturated": lambda: np.clip(image.astype(int) * 4, 0, 255).astype(np.uint8),
        "smaller": lambda: cv2.resize(image, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA),
        "JPEG": lambda: cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 80])[1], -1),
        "inverted": lambda: 255 - image,
    }[change]()
    found = detect_in_photograph(photograph_of("plate", image), parse_target("ring14"))
    read = set(found.observations.code.tolist()) - {0}
    whole = detect_in_photograph(
        photograph_of("plate", cv2.imread(str(plate / "plate_0005.png"), -1)[:700]), parse_target("ring14")
    )
    there = set(whole.observations.code.tolist()) & listed
    assert len(there) > 20
    assert len(read & there) >= 0.9 * len(there)
    assert read <= set(range(2, 75))


@real
def test_all_circles_of_a_real_grid_are_found_and_calibrate_no_worse_than_opencv() -> None:
    plane = np.array([[25.0 * column, 25.0 * row, 0] for row in range(8) for column in range(10)], np.float32)
    views = []
    for path in sorted((REAL / "circle_grid").glob("*.jpg")):
        found = detect_in_photograph(read_photograph(path), parse_target("circles:10x8"))
        assert found.notes[0] == ON_WHITE
        here = found.place[:, 0] >= 0
        assert here.sum() == 80, path
        order = np.argsort(found.observations.point[here])
        views.append(found.observations.xy_px[here][order].astype(np.float32))
    none = np.zeros((0, 0))
    rms = cv2.calibrateCamera([plane] * len(views), views, (640, 480), none, none, flags=cv2.CALIB_FIX_K3)[0]
    assert len(views) == 6
    assert rms <= 0.47549


@real
def test_the_command_draws_and_writes_what_it_finds(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    picture = REAL / "circle_grid/image00003.jpg"
    assert main(["detect", str(picture), "--target", "circles:10x8", "--out", str(tmp_path), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["images"][0]["grid"] == [10, 8]
    assert (tmp_path / "image00003.png").read_bytes()[:4] == b"\x89PNG"
    rows = list(csv.DictReader((tmp_path / "observations.csv").open()))
    assert sum(int(row["column"]) >= 0 for row in rows) == 80
    assert all(float(row["cov_xx_px2"]) > 0 for row in rows if row["status"] == "measured")


def _dots(dtype: str = "uint8") -> np.ndarray:
    """Five by four white dots of 16 px diameter on black, 0 to 1."""
    y, x = np.mgrid[0:260, 0:320]
    image = np.zeros((260, 320))
    for row in range(4):
        for column in range(5):
            r = np.hypot(x - 40 - 60 * column - 0.3, y - 40 - 60 * row + 0.2)
            image += np.clip(8.5 - r, 0, 1)
    noise = np.random.default_rng(3).normal(0, 0.004, image.shape)
    return np.clip(0.08 + 0.8 * image + noise, 0, 1)


KINDS = {
    "colour": (lambda i: np.rint(i[..., None] * [255, 255, 200]).astype(np.uint8), ".png"),
    "with transparency": (lambda i: np.stack([np.rint(255 * i).astype(np.uint8)] * 4, -1), ".png"),
    "10 bits in 16": (lambda i: np.rint(1023 * i).astype(np.uint16), ".png"),
    "16 bits": (lambda i: np.rint(65535 * i).astype(np.uint16), ".tif"),
    "floating point": (lambda i: i.astype(np.float32), ".tif"),
    "JPEG": (lambda i: np.rint(255 * i).astype(np.uint8), ".jpg"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_image_gives_the_same_dots(kind: str, tmp_path: Path) -> None:
    make, suffix = KINDS[kind]
    path = tmp_path / f"dots{suffix}"
    assert cv2.imwrite(str(path), make(_dots()))
    photograph = read_photograph(path)
    found = detect_in_photograph(photograph, parse_target("circles:5x4"))
    assert (found.place[:, 0] >= 0).sum() == 20
    here = found.observations.take(found.place[:, 0] >= 0)
    expected = np.column_stack([40.3 + 60 * (here.point % 5), 39.8 + 60 * (here.point // 5)])
    assert np.abs(here.xy_px - expected).max() < 0.08
    assert photograph.notes


def test_an_exr_and_a_bayer_mosaic_are_read(tmp_path: Path) -> None:
    from testfield.camera.images import Radiance

    Radiance("s", _dots().astype(np.float32)).save(tmp_path / "dots.exr")
    found = detect_in_photograph(read_photograph(tmp_path / "dots.exr"), parse_target("circles:5x4"))
    assert (found.place[:, 0] >= 0).sum() == 20

    mosaic = _dots()
    mosaic[::2, ::2] *= 0.6
    mosaic[1::2, 1::2] *= 0.45
    cv2.imwrite(str(tmp_path / "raw.png"), np.rint(4095 * mosaic).astype(np.uint16))
    raw = read_photograph(tmp_path / "raw.png", "RGGB")
    assert "Bayer" in " ".join(raw.notes)
    found = detect_in_photograph(raw, parse_target("circles:5x4"))
    here = found.observations.take(found.place[:, 0] >= 0)
    assert len(here) == 20
    expected = np.column_stack([40.3 + 60 * (here.point % 5), 39.8 + 60 * (here.point // 5)])
    assert np.abs(here.xy_px - expected).max() < 0.08


def test_the_noise_of_an_unknown_sensor_is_estimated() -> None:
    rng = np.random.default_rng(5)
    level = np.kron(rng.uniform(20, 3500, (12, 16)), np.ones((40, 40)))
    image = np.rint(rng.normal(level, np.sqrt(9 + 0.4 * level))).astype(np.float32)
    sheet = estimate_sheet(np.clip(image, 0, 4095), 12)
    for mean in (100.0, 1000.0, 3000.0):
        assert 0.8 < sheet.variance_dn2(np.array(mean)) / (9 + 0.4 * mean) < 1.3


def test_what_is_no_image_is_said_so(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "text.png").write_text("no image at all")
    (tmp_path / "empty.png").write_bytes(b"")
    for name, word in (("text.png", "not a readable image"), ("empty.png", "empty"), ("none.png", "cannot be read")):
        assert main(["detect", str(tmp_path / name), "--target", "ring14", "--out", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert word in said
        assert name in said
    assert main(["detect", str(tmp_path / "text.png")]) == 2
    assert "--target" in capsys.readouterr().err
    assert main(["detect", str(tmp_path / "text.png"), "--target", "ring15"]) == 2
    assert "8, 10, 12, 14, 16, 20" in capsys.readouterr().err


def test_an_enormous_image_is_refused_by_its_header(tmp_path: Path) -> None:
    path = tmp_path / "huge.png"
    small = cv2.imencode(".png", np.zeros((2, 2), np.uint8))[1].tobytes()
    header = b"IHDR" + struct.pack(">IIBBBBB", 10000, 20000, 8, 0, 0, 0, 0)
    path.write_bytes(small[:12] + header + struct.pack(">I", zlib.crc32(header)) + small[33:])
    start = time.perf_counter()
    with pytest.raises(TestfieldError, match="200 megapixels"):
        read_photograph(path)
    assert time.perf_counter() - start < 5


@pytest.mark.parametrize("target", ["ring14", "circles:5x4", "aruco:DICT_4X4_50", "charuco:5x4:DICT_4X4_50:30:20"])
@pytest.mark.parametrize("image", ["1 x 1", "1 x 500", "black", "white", "noise", "chequered"])
def test_nothing_to_see_gives_an_empty_result(image: str, target: str) -> None:
    pixels = {
        "1 x 1": np.full((1, 1), 7, np.uint8),
        "1 x 500": np.arange(500, dtype=np.uint16)[None],
        "black": np.zeros((200, 300), np.uint8),
        "white": np.full((200, 300), 255, np.uint8),
        "noise": np.random.default_rng(1).integers(0, 256, (200, 300)).astype(np.uint8),
        "chequered": (np.indices((200, 300)).sum(axis=0) % 2 * 255).astype(np.uint8),
    }[image]
    found = detect_in_photograph(photograph_of(image, pixels), parse_target(target))
    assert (found.observations.code <= 0).all()
    assert not (found.observations.status == "measured").any()


def test_damaged_files_and_random_arrays_never_crash(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    target = parse_target("ring14")
    path = tmp_path / "damaged"
    deadline = time.perf_counter() + 15
    image = np.rint(255 * _dots()).astype(np.uint8)
    for suffix in (".png", ".jpg", ".tif", ".bmp"):
        sound = bytearray(cv2.imencode(suffix, image)[1].tobytes())
        for k in range(12):
            data = sound.copy()
            for at in rng.integers(0, len(data), 1 + 3 * k):
                data[at] = rng.integers(256)
            if k % 3 == 0:
                data = data[: rng.integers(1, len(data))]
            path.write_bytes(bytes(data))
            try:
                photograph = read_photograph(path)
            except TestfieldError:
                continue
            if photograph.pixels.size < 1_000_000 and time.perf_counter() < deadline:
                detect_in_photograph(photograph, target)
    for k in range(30):
        shape = tuple(int(s) for s in rng.integers(1, 90, 2))
        kind = k % 5
        if kind == 0:
            pixels = rng.integers(0, 65536, shape).astype(np.uint16)
        elif kind == 1:
            pixels = (10.0 ** rng.uniform(-40, 38, shape)).astype(np.float32)
        elif kind == 2:
            pixels = rng.choice([np.nan, np.inf, -np.inf, 0, 1], shape).astype(np.float32)
        elif kind == 3:
            pixels = rng.integers(0, 2, (*shape, 4)).astype(np.uint8) * 255
        else:
            pixels = cv2.GaussianBlur(rng.normal(0, 1, shape), (0, 0), 3).astype(np.float32)
        detect_in_photograph(photograph_of("random", pixels), target)
    assert time.perf_counter() < deadline + 15


def test_a_converters_numbers_are_counted_however_they_are_stored() -> None:
    rng = np.random.default_rng(5)
    eight = rng.integers(3, 250, (80, 90)).astype(np.uint8)
    for stored in (eight.astype(np.uint16) * 257, (eight / 255).astype(np.float32), eight / 255.0):
        photograph = photograph_of("p", stored)
        assert np.array_equal(photograph.pixels, eight.astype(np.float32))
        assert photograph.bits == 8
        assert any("multiples" in note for note in photograph.notes)
    shifted = photograph_of("p", eight.astype(np.uint16) * 16)
    assert shifted.bits == 12
    assert np.array_equal(photograph_of("p", eight.astype(np.uint16)).pixels, eight)  # nothing to count


def test_a_mosaic_that_nobody_declared_is_noticed() -> None:
    rng = np.random.default_rng(6)
    grey = rng.uniform(900, 1000, (80, 90)).astype(np.uint16)
    assert not any("mosaic" in note for note in photograph_of("p", grey).notes)
    grey[::2, ::2] = grey[::2, ::2] // 2
    assert any("mosaic" in note for note in photograph_of("p", grey).notes)


def test_a_grid_within_a_larger_grid_is_not_named() -> None:
    xy = np.stack(np.meshgrid(np.arange(10) * 30.0, np.arange(8) * 30.0), -1).reshape(-1, 2) + 40
    diameter = np.full(80, 14.0)
    assert (order_grid(xy, diameter, 10, 8) >= 0).all()
    assert (order_grid(xy, diameter, 9, 8) < 0).all()
    assert (order_grid(xy, diameter, 10, 7) < 0).all()
