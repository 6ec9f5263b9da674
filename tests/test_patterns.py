"""Boards that calibrate a camera by their print: drawn by the camera's model, measured by the command."""

import json
import sys
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.similarity import robust_similarity
from testfield.camera.exif import read_exif
from testfield.camera.interior import Interior
from testfield.camera.pose import rotation
from testfield.camera.project import directions
from testfield.cli.main import main
from testfield.detect.photo_corners import as_printed
from testfield.detect.target_spec import parse_target
from testfield.measure.observed import read_observed
from testfield.measure.patterns import board_pattern
from testfield.reconstruct.points import Points
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.ring_code import word_of_number

WIDTH, HEIGHT = 400, 320
TRUE = Interior(WIDTH, HEIGHT, np.array([420.0, 418.0, 203.1, 155.4, -0.12, 0.0, 0.0, 0.0, 0.0]))
KINDS = (
    "checkerboard:8x5:25",
    "charuco:7x5:DICT_4X4_50:30:22",
    "tags:4x3:DICT_4X4_50:50:36:3",
    "aprilgrid:3x2:60:18",
    "circles:8x6:25:14",
    "acircles:4x9:22:18",
    "hexcircles:6x7:26:15",
    "runetag:3505:160",
)
TILTS = [(0.15, -0.12), (0.6, 0.1), (-0.55, 0.2), (0.1, 0.6), (-0.1, -0.6), (0.45, -0.45), (-0.4, -0.4)]
TURNS = [-0.15, 0.2, -0.3, 0.4, -0.2, 0.1, 0.25]
BLACK_DN, WHITE_DN, NOISE_DN, BLUR_PX, FINE = 30.0, 200.0, 4.0, 0.7, 4


def pose(pattern: BoardPattern, image: int) -> tuple[np.ndarray, np.ndarray]:
    """Camera-from-board pose of an image: the board fills most of it, tilted, its top up but for a small turn."""
    (tilt, pan), turn = TILTS[image], TURNS[image]
    front = np.diag([1.0, -1.0, -1.0])  # the board's y points up and its z to the viewer
    R = rotation(np.array([0.0, 0.0, turn])) @ rotation(np.array([tilt, pan, 0.0])) @ front
    far = 1.45 * float((2 * pattern.half_mm / [WIDTH, HEIGHT]).max()) * 420
    shift = np.array([0.03, -0.02]) * far * np.array([np.cos(2.3 * image), np.sin(2.3 * image)])
    return R, np.array([*shift, far])


def black_at(pattern: BoardPattern, xy_mm: np.ndarray) -> np.ndarray:
    """(...) whether places (..., 2) of the board are black."""
    if pattern.has_corners:
        return pattern.cells.at(xy_mm)
    if pattern.kind == "runetag":
        dots = zip(pattern.points_mm, pattern.diameters_mm, strict=True)
        return np.any([((xy_mm - middle) ** 2).sum(axis=-1) < (size / 2) ** 2 for middle, size in dots], axis=0)
    # Distances of dots in a row, of every other row's shift, and of rows, in spacings.
    wide, half, down = {"circles": (1, 0, 1), "acircles": (2, 1, 1), "hexcircles": (1, 0.5, 0.75**0.5)}[pattern.kind]
    x, y = ((xy_mm - pattern.points_mm[0]) * [1, -1] / pattern.pitch_mm).transpose(2, 0, 1)
    row = np.rint(y / down).clip(0, pattern.rows - 1)  # dots are smaller than their rows are apart
    shift = half * (row % 2)
    column = np.rint((x - shift) / wide).clip(0, pattern.columns - 1)
    return np.asarray(
        (x - shift - wide * column) ** 2 + (y - down * row) ** 2 < (pattern.mark_mm / pattern.pitch_mm / 2) ** 2
    )


@cache
def rays_of_pixels() -> np.ndarray:
    """(FINE h, FINE w, 3) directions of the places that a pixel's mean is made of."""
    x, y = ((np.arange(n * FINE) + 0.5) / FINE - 0.5 for n in (WIDTH, HEIGHT))
    return directions(TRUE, np.stack(np.meshgrid(x, y), axis=-1))


@cache
def drawn(kind: str, image: int) -> np.ndarray:
    """(h, w) uint8 of a board as the camera sees it: each pixel the mean of rays through it, blurred, with noise."""
    pattern = board_pattern(parse_target(kind))
    R, t = pose(pattern, image)
    rays = rays_of_pixels()
    # X = R' (s d - t) with the board's z = 0.
    depth = (R.T @ t)[2] / (rays @ R[:, 2])
    place = (rays * depth[..., None] - t) @ R
    level = np.where(black_at(pattern, place[..., :2]), BLACK_DN, WHITE_DN)
    fine = cv2.GaussianBlur(level, (0, 0), BLUR_PX * FINE)
    mean = cv2.resize(fine, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng([11, image, *kind.encode()]).normal(0, NOISE_DN, mean.shape)
    return np.clip(np.rint(mean + noise), 0, 255).astype(np.uint8)


def photographed(kind: str, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for image in range(len(TILTS)):
        cv2.imwrite(str(folder / f"view{image}.png"), drawn(kind, image))
    return folder


def off(folder: Path) -> tuple[float, np.ndarray]:
    """The squared error of the camera's focal lengths and principal point over their covariance (4 degrees of freedom),
    and the standard uncertainties."""
    calibration = Calibration.load(folder / "calibration.json")
    own = calibration.index(["fx", "fy", "cx", "cy"])
    cov = calibration.covariance[np.ix_(own, own)]
    error = calibration.interior.parameters[:4] - TRUE.parameters[:4]
    return float(error @ np.linalg.solve(cov, error)), np.sqrt(np.diag(cov))


SLOW = ("tags", "aprilgrid", "circles", "acircles", "hexcircles", "runetag")
"""Kinds of which the parts are tested elsewhere, too."""


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.slow] if kind.startswith(SLOW) else []) for kind in KINDS]
)
def test_every_kind_of_board_returns_the_camera_within_its_uncertainty(kind: str, tmp_path: Path) -> None:
    images, field = photographed(kind, tmp_path / "images"), tmp_path / "field.toml"
    field.write_text(f'[[patterns]]\nkind = "{kind}"\nname = "plate"\nu_mm = 0.001\nu_flat_mm = 0.001\n')
    out = tmp_path / "out"
    assert (
        main(["measure", str(images), "--field", str(field), "--hold", "k2,k3,p1,p2", "--out", str(out), "--jobs", "1"])
        == 0
    )
    misfit, u = off(out)
    assert misfit < 18.5  # one in a thousand
    assert u.max() < 1.0
    answer = json.loads((out / "measurement.json").read_text())
    assert len(answer["joined"]) == len(TILTS) and answer["passed"]
    assert answer["sigma0"] < 1.6


def test_what_detect_wrote_measures_as_the_images_do(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    kind = "checkerboard:8x5:25"
    images, seen = photographed(kind, tmp_path / "images"), tmp_path / "seen"
    assert main(["detect", str(images), "--target", kind, "--out", str(seen)]) == 0
    for source in (seen, seen / "observations.parquet"):
        out = tmp_path / source.name
        measuring = ["measure", "--jobs", "1", "--observations", str(source), "--target", kind, "--hold", "k2,k3,p1,p2"]
        assert main([*measuring, "--out", str(out)]) == 0
        assert off(out)[0] < 18.5
    (seen / "detection.json").unlink()
    # A measurement tells its images' size, too.
    assert set(read_observed(seen, parse_target(kind), ()).sizes) == {(WIDTH, HEIGHT)}
    (seen / "measurement.json").unlink()
    capsys.readouterr()
    assert main([*measuring, "--out", str(tmp_path / "again")]) == 2
    assert "how large" in capsys.readouterr().err
    assert main([*measuring, "--size-px", f"{WIDTH}x{HEIGHT}", "--out", str(tmp_path / "again")]) == 0


def with_exif(path: Path, model: str, focal_mm: float, film_mm: int, size: tuple[int, int] = (64, 48)) -> None:
    """An image without content whose header tells a camera."""
    image, exif = Image.new("L", size, 90), Image.Exif()
    exif[0x010F], exif[0x0110] = "Maker", model
    exif.get_ifd(0x8769).update({0x920A: focal_mm, 0xA405: film_mm})
    image.save(path, exif=exif)


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (("One", 24.0, 36), ("24 mm", "18 mm")),  # zoomed
        (("Two", 18.0, 27), ("Maker One", "Maker Two")),
        (("One", 18.0, 27, (48, 64)), ("64 x 48", "48 x 64", "turn them back")),
    ],
)
def test_another_camera_or_zoom_is_an_error_that_lists_the_frames(
    other: tuple, words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    images = tmp_path / "images"
    images.mkdir()
    for k in range(3):
        with_exif(images / f"a{k}.jpg", "One", 18.0, 27)
    with_exif(images / "odd.jpg", *other)
    assert main(["measure", str(images), "--target", "checkerboard:9x6:25", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert all(word in said for word in (*words, "a0.jpg, a1.jpg, a2.jpg (3)", "odd.jpg (1)", "--by-folder"))


def test_exif_gives_the_focal_length_by_the_diagonal(tmp_path: Path) -> None:
    with_exif(tmp_path / "a.jpg", "One", 18.0, 36, (600, 400))
    exif = read_exif(tmp_path / "a.jpg")
    assert exif is not None and exif.focal_mm == 18
    assert exif.focal_px == pytest.approx(600.0)  # film of 36 x 24 mm, as wide as it is long
    (tmp_path / "b.jpg").write_bytes(b"no image")
    assert read_exif(tmp_path / "b.jpg") is None


@pytest.mark.parametrize("size", [(6, 4), (5, 5), (4, 7)])
def test_a_grid_is_counted_as_it_is_printed_however_it_was_read(size: tuple[int, int]) -> None:
    columns, rows = size
    spec = parse_target(f"checkerboard:{columns}x{rows}")
    printed = np.arange(columns * rows).reshape(rows, columns)
    own = np.arange(columns * rows)
    known = np.random.default_rng(3).random(len(own)) < 0.4
    for way in (printed, printed[::-1, ::-1], printed[:, ::-1], printed[::-1]):
        read = np.empty(columns * rows, int)
        read[way.ravel()] = np.arange(columns * rows)
        assert np.array_equal(as_printed(read, own, known, spec, False), own)
    unlike = np.random.default_rng(4).permutation(columns * rows)
    assert np.array_equal(as_printed(unlike, own, known, spec, False), unlike)


@pytest.mark.slow  # a free network of 48 corners, and of both halves of the photographs
def test_single_tags_of_a_told_size_are_measured_corner_by_corner(tmp_path: Path) -> None:
    """The tags' layout is told to nobody; their places come back, in mm as the size tells it."""
    images = photographed("tags:4x3:DICT_4X4_50:50:36:3", tmp_path / "images")
    out = tmp_path / "out"
    told = ["--target", "aruco:DICT_4X4_50:36", "--hold", "k2,k3,p1,p2", "--jobs", "1"]
    assert main(["measure", str(images), *told, "--out", str(out)]) == 0
    assert off(out)[0] < 18.5  # one in a thousand
    points = Points.load(out / "points.parquet")
    assert points.code.tolist() == [10 * tag + corner for tag in range(3, 15) for corner in (1, 2, 3, 4)]
    true = np.column_stack([board_pattern(parse_target("tags:4x3:DICT_4X4_50:50:36:3")).points_mm, np.zeros(48)])
    scale, R, t = robust_similarity(points.xyz_mm, true)
    # Noise of 4 DN in 170 leaves about 0.04 px, that is 0.02 mm, of each coordinate in each of seven images.
    assert np.sqrt(((scale * points.xyz_mm @ R.T + t - true) ** 2).mean()) < 0.03
    assert abs(scale - 1) < 3e-4


CODES = {k + 11: np.array([x, y]) for k, (x, y) in enumerate((x, y) for y in (98.0, -98.0) for x in (-80.0, 0.0, 80.0))}
"""Places in mm of ring codes of 9 mm beside a checkerboard."""


def codes_at(xy_mm: np.ndarray) -> np.ndarray:
    """(...) whether places (..., 2) are ink of one of `CODES`."""
    ink = np.zeros(xy_mm.shape[:-1], bool)
    for code, middle in CODES.items():
        x, y = np.moveaxis(xy_mm - middle, -1, 0)
        radius, turn = np.hypot(x, y) / 4.5, np.arctan2(y, x) % (2 * np.pi)
        bit = (int(word_of_number(np.array([code]), 14)[0]) >> (turn * 14 / (2 * np.pi)).astype(int)) & 1
        ink |= (radius < 1) | ((radius > 2) & (radius < 3) & (bit == 1))
    return ink


@pytest.mark.slow
def test_ring_codes_beside_a_checkerboard_are_points_in_its_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    kind, board_alone = "checkerboard:8x5:25", black_at
    monkeypatch.setattr(
        sys.modules[__name__], "black_at", lambda pattern, xy: board_alone(pattern, xy) | codes_at(np.asarray(xy))
    )
    drawn.cache_clear()
    images, field, out = photographed(kind, tmp_path / "images"), tmp_path / "field.toml", tmp_path / "out"
    drawn.cache_clear()
    told = f'[target]\nkind = "ring14"\n[[patterns]]\nkind = "{kind}"\nu_mm = 0.001\nu_flat_mm = 0.001\n'
    across = float(np.linalg.norm(CODES[11] - CODES[16]))
    bar = f'[[distances]]\nname = "diagonal"\ncodes = [11, 16]\nlength_mm = {across}\nu_mm = 0.001\nrole = "check"\n'
    field.write_text(told + bar)
    words = ["measure", str(images), "--hold", "k2,k3,p1,p2", "--out", str(out), "--jobs", "1", "--field", str(field)]
    assert main(words) == 0
    assert off(out)[0] < 18.5  # one in a thousand
    points = Points.load(out / "points.parquet")
    assert points.code.tolist() == sorted(CODES)
    error = (points.xyz_mm - [[*CODES[int(code)], 0] for code in points.code]).ravel()
    chi2 = float(error @ np.linalg.solve(points.cov_xyz_mm2, error))
    assert chi2 < 42.3 and np.sqrt(np.diag(points.cov_xyz_mm2)).max() < 0.1  # one in a thousand, of 18
    (length,) = json.loads((out / "measurement.json").read_text())["lengths"]
    assert abs(length["en"]) < 1
    field.write_text(told + bar.replace("check", "control"))
    capsys.readouterr()
    assert main(words) == 2
    assert "role" in capsys.readouterr().err
