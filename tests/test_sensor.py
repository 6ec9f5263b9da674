import numpy as np
import pytest

from testfield.camera.images import Frame, Radiance
from testfield.sensor.expose import Sensor, expose

SENSOR = Sensor(3.45, 8.0, 24.0, 550.0, 0.63, 10400.0, 2.3, 2.6, 64.0, 12)


def flat(value: float) -> Radiance:
    return Radiance("s", np.full((400, 500), value, np.float32))


def test_electrons_follow_from_the_aperture_the_pixel_and_the_photon_energy() -> None:
    # pi/(4 N^2) * A * t * QE * lambda / (h c), worked out by hand
    expected = np.pi / 256 * (3.45e-6) ** 2 * 0.024 * 0.63 / (6.62607015e-34 * 299792458 / 550e-9)
    assert SENSOR.electrons_per_radiance == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("radiance", [0.0, 0.05, 0.4, 1.0])
def test_mean_and_variance_are_those_of_the_data_sheet(radiance: float) -> None:
    pixels = expose(flat(radiance), SENSOR, 5).pixels_dn.astype(float)
    mean = radiance * SENSOR.electrons_per_radiance / 2.6 + 64
    variance = SENSOR.sheet.variance_dn2(np.array(mean))
    n = pixels.size
    assert abs(pixels.mean() - mean) < 5 * np.sqrt(variance / n) + 1e-3
    assert pixels.var() == pytest.approx(float(variance), rel=5 * np.sqrt(2 / n))


def test_a_full_well_stops_at_its_level_and_twelve_bits_at_theirs() -> None:
    full = expose(flat(10.0), SENSOR, 5).pixels_dn
    assert full.mean() == pytest.approx(10400 / 2.6 + 64, abs=0.2)
    deep = Sensor(3.45, 8.0, 24.0, 550.0, 0.63, 1e6, 2.3, 2.6, 64.0, 12)
    assert (expose(flat(10.0), deep, 5).pixels_dn == 4095).all()


def test_noise_belongs_to_seed_and_station() -> None:
    a = expose(flat(0.5), SENSOR, 5).pixels_dn
    assert np.array_equal(a, expose(flat(0.5), SENSOR, 5).pixels_dn)
    assert not np.array_equal(a, expose(flat(0.5), SENSOR, 6).pixels_dn)
    assert not np.array_equal(a, expose(Radiance("t", flat(0.5).values), SENSOR, 5).pixels_dn)


def test_images_survive_their_files(tmp_path) -> None:  # type: ignore[no-untyped-def]
    frame = expose(flat(0.5), SENSOR, 5)
    frame.save(tmp_path / "f.png")
    again = Frame.load(tmp_path / "f.png")
    assert np.array_equal(again.pixels_dn, frame.pixels_dn)
    assert again.sheet == frame.sheet
    picture = Radiance("s", np.random.default_rng(0).random((20, 30)).astype(np.float32))
    picture.save(tmp_path / "r.exr")
    assert np.array_equal(Radiance.load(tmp_path / "r.exr").values, picture.values)
    assert Radiance.load(tmp_path / "r.exr").station == "s"
