"""A sensor's sheet from its frames: a known sensor gives back its own figures within what is stated."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.camera.images import Radiance
from testfield.characterise.characterise import CameraSheet, characterise
from testfield.characterise.series import Level, Series
from testfield.characterise.sources import series_of
from testfield.characterise.transfer import saturation_place
from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.scene.exposure import sensor_of
from testfield.scene.load import load_scene
from testfield.sensor.expose import Sensor, expose

SIZE = (120, 160)
TRUE = Sensor(
    pixel_pitch_um=3.45,
    f_number=8.0,
    time_ms=20.0,
    wavelength_nm=550.0,
    quantum_efficiency=0.63,
    full_well_e=9000.0,
    read_noise_e=6.0,
    gain_e_per_dn=2.6,
    black_level_dn=64.0,
    bits=12,
    dark_current_e_per_s=50.0,
    prnu=0.01,
    dsnu_e=4.0,
)
SHARES = np.linspace(0.02, 1.15, 24)
DARK_MS = (20.0, 1000.0, 2000.0, 4000.0)
REFERENCE = Path(__file__).parents[2] / "shared/real/emva1288"


def shoot(folder: Path, sensor: Sensor, seed: int, response: Callable[[np.ndarray], np.ndarray] = np.rint) -> Series:
    """The series of a sensor in `folder`, as the standard asks for: pairs over light, darks over time, two stacks."""
    radiance = sensor.full_well_e / sensor.electrons_per_radiance
    levels, number = [], 0

    def level(share: float, time_ms: float, frames: int) -> None:
        nonlocal number
        images = []
        for _ in range(frames):
            one = dataclasses.replace(sensor, time_ms=time_ms)
            frame = expose(Radiance(f"frame{number}", np.full(SIZE, share * radiance, np.float32)), one, seed)
            images.append(folder / f"{number:03d}.png")
            cv2.imwrite(str(images[-1]), response(frame.pixels_dn).astype(np.uint16))
            number += 1
        photons = share * radiance * sensor.electrons_per_radiance / sensor.quantum_efficiency
        levels.append(Level(tuple(images), time_ms, float(photons)))

    for share in SHARES:
        level(float(share), sensor.time_ms, 2)
    for time_ms in DARK_MS:
        level(0.0, time_ms, 2)
    level(0.5, sensor.time_ms, 16)
    level(0.0, sensor.time_ms, 16)
    return Series(tuple(levels), True, str(folder), sensor.bits, sensor.bayer)


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Path, Series, CameraSheet]]:
    """The true sensor under four seeds."""
    found = []
    for seed in range(4):
        folder = tmp_path_factory.mktemp(f"sensor{seed}")
        series = shoot(folder, TRUE, seed)
        found.append((folder, series, characterise(series)))
    return found


def test_a_rendered_sensor_returns_its_own_sheet_within_stated_uncertainty(
    shot: list[tuple[Path, Series, CameraSheet]],
) -> None:
    true = {
        "gain_e_per_dn": TRUE.gain_e_per_dn,
        "gain_dn_per_e": 1 / TRUE.gain_e_per_dn,
        "read_noise_e": TRUE.read_noise_e,
        "full_well_e": TRUE.full_well_e - TRUE.dark_e,
        "quantum_efficiency": TRUE.quantum_efficiency,
        "dark_current_mean_e_per_s": TRUE.dark_current_e_per_s,
        "dark_current_variance_e_per_s": TRUE.dark_current_e_per_s,
        "prnu_percent": 100 * TRUE.prnu,
        "prnu_pixel_percent": 100 * TRUE.prnu,
        "prnu_white_percent": 100 * TRUE.prnu,
        "dsnu_e": TRUE.dsnu_e,
        "dsnu_pixel_e": TRUE.dsnu_e,
        "dsnu_white_e": TRUE.dsnu_e,
    }
    z = {
        name: np.array([(one.figures[name].value - value) / one.figures[name].u for *_, one in shot])
        for name, value in true.items()
    }
    for name, values in z.items():
        assert np.abs(values).max() < 3.5, (name, values)
        # The mean square of four: between 0.07 and 4.6 in 999 of 1,000 true claims.
        assert 0.05 < (values**2).mean() < 4.6, (name, values)
    for *_, one in shot:
        # DSNU moves the mean of these pixels off the sheet's black level by its share of all pixels.
        black = one.figures["black_level_dn"]
        assert abs(black.value - TRUE.black_level_dn) < 4 * (TRUE.dsnu_e / TRUE.gain_e_per_dn) / np.sqrt(np.prod(SIZE))
        for part in ("row", "column"):
            for name in (f"dsnu_{part}_e", f"prnu_{part}_percent"):
                assert one.figures[name].value < 3.5 * one.figures[name].u
        sat = one.figures["saturation_e"]
        assert abs(sat.value - TRUE.full_well_e) < 3 * sat.u
        assert abs(one.figures["linearity_error_percent"].value) < 0.1


def test_stated_uncertainties_are_small_enough_to_say_something(shot: list[tuple[Path, Series, CameraSheet]]) -> None:
    for *_, one in shot:
        for name in ("gain_e_per_dn", "read_noise_e", "full_well_e", "quantum_efficiency", "prnu_percent", "dsnu_e"):
            assert one.figures[name].u < 0.02 * one.figures[name].value, name


def test_more_read_noise_than_the_sheet_says_is_found(tmp_path: Path) -> None:
    noisy = characterise(shoot(tmp_path, dataclasses.replace(TRUE, read_noise_e=6.6), 0)).figures["read_noise_e"]
    assert abs(noisy.value - TRUE.read_noise_e) > 5 * noisy.u


def test_a_known_nonlinearity_is_the_linearity_error(tmp_path: Path) -> None:
    top = TRUE.full_well_e / TRUE.gain_e_per_dn

    def bent(dn: np.ndarray) -> np.ndarray:
        signal = dn.astype(float) - TRUE.black_level_dn
        return np.rint(TRUE.black_level_dn + signal * (1 - 0.03 * (signal / top) ** 2))

    found = characterise(shoot(tmp_path, TRUE, 0, bent))
    light = SHARES[SHARES <= 0.97] * top
    y = light * (1 - 0.03 * (light / top) ** 2)
    inside = (y >= 0.05 * 0.97 * top) & (y <= 0.95 * 0.97 * top)
    offset, slope = np.polynomial.polynomial.polyfit(light[inside], y[inside], 1, w=1 / y[inside])
    off = 100 * (y / (offset + slope * light) - 1)[inside]
    assert found.figures["linearity_error_percent"].value == pytest.approx(float(np.abs(off).mean()), rel=0.15)
    assert found.figures["linearity_error_min_percent"].value == pytest.approx(float(off.min()), rel=0.25)


def test_each_colour_of_a_mosaic_has_its_own_responsivity(tmp_path: Path) -> None:
    mosaic = dataclasses.replace(TRUE, bayer="GRBG", bayer_response=(0.7, 1.0, 0.5))
    found = characterise(shoot(tmp_path, mosaic, 3))
    assert [one.name for one in found.channels] == ["R", "G1", "G2", "B"]
    for one, response in zip(found.channels, (0.7, 1.0, 1.0, 0.5), strict=True):
        efficiency = one.figures["quantum_efficiency"]
        assert abs(efficiency.value - response * TRUE.quantum_efficiency) < 4 * efficiency.u
        assert abs(one.figures["gain_e_per_dn"].value - TRUE.gain_e_per_dn) < 4 * one.figures["gain_e_per_dn"].u


def test_folder_table_and_descriptor_say_the_same(shot: list[tuple[Path, Series, CameraSheet]], tmp_path: Path) -> None:
    folder, series, sheet = shot[0]
    csv_rows = ["image,time_ms,photons"]
    descriptor, toml = ["# a comment", "v 4.0", f"n 12 {SIZE[1]} {SIZE[0]}"], ["bits = 12"]
    for level in series.levels:
        stack = len(level.images) > 2  # a table of images has no two levels of the same light and time
        csv_rows += [f"{image.name},{level.time_ms},{level.light + (0.001 if stack else 0)}" for image in level.images]
        head = "d" if level.dark else "b"
        descriptor.append(f"{head} {(level.time_ms or 0) * 1e6}" + ("" if level.dark else f" {level.light!r}"))
        descriptor += [f"i .\\{image.name}" for image in level.images]
        names = ", ".join(f'"{image.name}"' for image in level.images)
        toml.append(f"[[levels]]\nimages = [{names}]\ntime_ms = {level.time_ms}\nphotons = {level.light!r}")
    (folder / "frames.txt").write_text("\n".join(descriptor))
    (folder / "frames.toml").write_text("\n".join(toml))
    for name in ("frames.txt", "frames.toml"):
        again = characterise(series_of(folder / name))
        assert again.figures == sheet.figures
    (folder / "frames.csv").write_text("\n".join(csv_rows[: 1 + 2 * (len(SHARES) + len(DARK_MS))]))
    table = characterise(series_of(folder / "frames.csv"))
    assert table.figures["gain_e_per_dn"] == sheet.figures["gain_e_per_dn"]
    for number, level in enumerate(series.levels[: len(SHARES) + len(DARK_MS)]):
        kind = "dark" if level.dark else "flat"
        there = tmp_path / f"{kind}{number:02d}_{level.time_ms:g}ms_{level.light:.4f}photons"
        there.mkdir()
        for image in level.images:
            (there / image.name).symlink_to(image)
    assert characterise(series_of(tmp_path)).figures["gain_e_per_dn"].value == pytest.approx(
        sheet.figures["gain_e_per_dn"].value
    )


def test_a_scene_that_includes_the_sheet_is_exposed_by_that_sensor(
    shot: list[tuple[Path, Series, CameraSheet]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, series, _ = shot[1]
    lines = ["n 12 160 120"]
    for level in series.levels:
        lines.append(
            f"d {(level.time_ms or 0) * 1e6}" if level.dark else f"b {(level.time_ms or 0) * 1e6} {level.light!r}"
        )
        lines += [f"i {image.name}" for image in level.images]
    (folder / "all.txt").write_text("\n".join(lines))
    out = tmp_path / "out"
    assert main(["sensor", str(folder / "all.txt"), "--out", str(out), "--pitch-um", "3.45", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {path.name for path in out.iterdir()} >= {"sensor.json", "sensor.toml", "sensor.html"}
    tiny = Path(__file__).with_name("torture") / "tiny.toml"
    scene = tmp_path / "scene.toml"
    body = tiny.read_text()
    start = body.find("[sensor]")
    if start >= 0:
        end = body.find("\n[", start + 1)
        body = body[:start] + body[end + 1 :]
    scene.write_text('include = ["out/sensor.toml"]\n' + body)
    sensor = sensor_of(load_scene(scene))
    assert sensor.read_noise_e == said["scene"]["sensor"]["read_noise_e"]
    again = tmp_path / "again"
    again.mkdir()
    exposed = dataclasses.replace(sensor, time_ms=20.0, f_number=8.0, pixel_pitch_um=3.45, wavelength_nm=550.0)
    found = characterise(shoot(again, exposed, 9))
    for name in ("gain_e_per_dn", "read_noise_e", "full_well_e", "prnu_white_percent", "dsnu_white_e"):
        first, second = said["figures"][name], found.figures[name]
        assert abs(second.value - first["value"]) < 4 * np.hypot(second.u, first["u"]), name


def test_saturation_is_the_largest_variance_from_the_bright_end() -> None:
    var = np.array([1.0, 2, 3, 9, 4, 5, 6, 7, 8, 2, 0.1, 0.0])
    assert saturation_place(var) == (8, True)
    assert saturation_place(np.arange(8.0)) == (7, False)


def test_what_cannot_be_characterised_is_refused_by_name(tmp_path: Path) -> None:
    assert main(["sensor", str(tmp_path / "absent")]) == 2
    (tmp_path / "dark_1ms").mkdir()
    cv2.imwrite(str(tmp_path / "dark_1ms/a.png"), np.zeros((8, 8), np.uint8))
    with pytest.raises(TestfieldError, match="one frame"):
        series_of(tmp_path)
    cv2.imwrite(str(tmp_path / "dark_1ms/b.png"), np.zeros((8, 8), np.uint8))
    with pytest.raises(TestfieldError, match="needed for the gain"):
        characterise(series_of(tmp_path))
    (tmp_path / "frames.csv").write_text("image,time_ms,photons\nnowhere.png,1,0\n")
    with pytest.raises(TestfieldError, match="nowhere"):
        series_of(tmp_path / "frames.csv")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "expected"),
    # From the standard's reference implementation (emva1288 1.0.2 of PyPI) on the same files.
    [
        (
            "EMVA1288_ReferenceSet_001_CCD_12Bit",
            {
                "gain_dn_per_e": 0.2800626,
                "quantum_efficiency": 0.4524949,
                "read_noise_e": 10.9244,
                "saturation_e": 14007.88,
                "dynamic_range": 1220.95,
                "linearity_error_min_percent": -0.615798,
                "linearity_error_max_percent": 0.480448,
                "dark_current_mean_e_per_s": 28.4791,
                "dark_current_variance_e_per_s": 69.97,
                "dsnu_e": 0.553188,
                "dsnu_row_e": 0.258934,
                "dsnu_column_e": 0.540560,
                "prnu_percent": 0.432705,
                "prnu_row_percent": 0.323273,
                "prnu_column_percent": 0.111330,
                "prnu_pixel_percent": 0.265205,
            },
        ),
        (
            "EMVA1288_ReferenceSet_002_CMOS_08Bit",
            {
                "gain_dn_per_e": 0.02055535,
                "quantum_efficiency": 0.5497553,
                "read_noise_e": 19.25589,
                "saturation_e": 10656.46,
                "dynamic_range": 437.9407,
                "linearity_error_min_percent": -0.896178,
                "linearity_error_max_percent": 0.854259,
                "dsnu_e": 6.438088,
                "dsnu_row_e": 2.296474,
                "dsnu_column_e": 2.633587,
                "dsnu_pixel_e": 5.407348,
                "prnu_percent": 1.417983,
                "prnu_row_percent": 0.188721,
                "prnu_column_percent": 1.237707,
                "prnu_pixel_percent": 0.665689,
            },
        ),
        (
            "EMVA1288_ReferenceSet_003_Simulation_12Bit",
            {
                "gain_dn_per_e": 0.0978588,
                "quantum_efficiency": 0.5036882,
                "read_noise_e": 30.64733,
                "saturation_e": 40961.58,
                "dynamic_range": 1309.138,
                "linearity_error_min_percent": -0.965698,
                "linearity_error_max_percent": 0.381741,
                "dsnu_e": 21.73921,
                "dsnu_pixel_e": 21.75965,
                "prnu_percent": 0.966895,
                "prnu_row_percent": 0.567262,
                "prnu_column_percent": 0.567571,
                "prnu_pixel_percent": 0.539410,
            },
        ),
    ],
)
def test_public_data_sets_give_what_the_standards_reference_implementation_gives(
    name: str, expected: dict[str, float]
) -> None:
    source = REFERENCE / name / "EMVA1288_Data.txt"
    if not source.is_file():
        pytest.skip(f"no {source}: the data sets of github.com/EMVA1288/datasets go there")
    figures = characterise(series_of(source)).figures
    for key, value in expected.items():
        assert figures[key].value == pytest.approx(value, rel=2e-4, abs=0.3 * figures[key].u), key
