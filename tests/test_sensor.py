import math
from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.stats import chi2, norm, poisson

from testfield.camera.images import Frame, Radiance
from testfield.errors import TestfieldError
from testfield.scene.camera_parts import SensorPart
from testfield.seeds import Plane
from testfield.sensor.expose import Sensor, expose
from testfield.sensor.patterns import gain_pattern

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


def test_a_frame_is_the_inverse_of_both_distributions_at_its_pixels_own_numbers() -> None:
    """The linear model with everything else off, with SciPy's Poisson distribution."""
    light = flat(0.5).values
    rows, columns = range(light.shape[0]), light.shape[1]
    u = Plane(5, "expose/s/electrons").uniforms(rows, columns)
    electrons = np.minimum(poisson.ppf(u, light.astype(float) * SENSOR.electrons_per_radiance), 10400.0)
    electrons = electrons + 2.3 * norm.ppf(Plane(5, "expose/s/read-out").uniforms(rows, columns))
    plain = np.clip(np.rint(electrons / 2.6 + 64), 0, 4095).astype(np.uint16)
    assert np.array_equal(expose(flat(0.5), SENSOR, 5).pixels_dn, plain)


def test_a_scene_sensor_keeps_its_numbers_as_written() -> None:
    as_in_a_scene = Sensor(pixel_pitch_um=3.45, f_number=8.0, time_ms=24.0, **SensorPart().model_dump())
    assert as_in_a_scene == SENSOR
    # The file beside a frame holds these numbers as text: 64 must not become 64.0.
    assert isinstance(as_in_a_scene.sheet.black_level_dn, int)


def uneven() -> np.ndarray:
    """From the dark to the full well, with steps."""
    return (np.indices((400, 500)).sum(axis=0) % 90 / 90).astype(np.float32) ** 2


def test_a_pixel_that_changes_changes_no_other() -> None:
    light = uneven()
    before = expose(Radiance("s", light), SENSOR, 5).pixels_dn
    light[17, 23] *= 3
    after = expose(Radiance("s", light), SENSOR, 5).pixels_dn
    assert np.argwhere(before != after).tolist() == [[17, 23]]


def test_a_crop_of_the_sensor_keeps_its_pixels() -> None:
    sensor = replace(SENSOR, prnu=0.01, dsnu_e=2.0, dark_current_e_per_s=50.0)
    whole = expose(Radiance("s", uneven()), sensor, 5).pixels_dn
    assert np.array_equal(expose(Radiance("s", uneven()[:130, :211]), sensor, 5).pixels_dn, whole[:130, :211])


def test_a_ten_millionth_more_light_changes_few_pixels_by_one_electron() -> None:
    counting = replace(SENSOR, read_noise_e=0.0, gain_e_per_dn=1.0, bits=16)
    light = uneven()
    for sensor in (SENSOR, counting):
        one, more = (
            expose(Radiance("s", (light * factor).astype(np.float32)), sensor, 5).pixels_dn.astype(int)
            for factor in (np.float64(1), np.float64(1 + 1e-7))
        )
        assert 0 < np.count_nonzero(more != one) < light.size / 1000
        assert set(np.unique(more - one)) <= {0, 1}


def test_seed_noise_seed_and_station_each_give_noise_of_their_own() -> None:
    sensor = replace(SENSOR, prnu=0.02)
    light = flat(0.4).values
    images = [
        expose(Radiance(station, light), replace(sensor, prnu=0.0), seed, noise).pixels_dn
        for station, seed, noise in (("s", 5, None), ("t", 5, None), ("s", 6, None), ("s", 5, 7))
    ]
    together = np.corrcoef([image.ravel().astype(float) for image in images])
    assert np.abs(together - np.eye(4)).max() < 5 / np.sqrt(light.size)
    # The fixed pattern goes with the seed, whatever the noise's seed is.
    a, b, c = (
        np.mean([expose(Radiance(f"{k}", light), sensor, seed, noise).pixels_dn for k in range(8)], axis=0).ravel()
        for seed, noise in ((5, None), (5, 7), (6, 7))
    )
    assert np.cov(a, b)[0, 1] > 20 * abs(np.cov(a, c)[0, 1])


def fit_chi2(counts: np.ndarray, chance: np.ndarray) -> float:
    """Probability of a worse chi-square of counts 0, 1, ..., of bins merged so that ten or more are expected."""
    expected = chance * counts.sum()
    kept = np.flatnonzero(expected >= 10)
    first, last = kept[0], kept[-1]
    observed, foreseen = (
        np.array([v[: first + 1].sum(), *v[first + 1 : last], v[last:].sum()]) for v in (counts, expected)
    )
    return float(chi2.sf(((observed - foreseen) ** 2 / foreseen).sum(), len(observed) - 1))


@pytest.mark.parametrize("mean_e", [0.5, 1.0, 2.0, 5.0, 10.0, 20.0])
def test_few_electrons_are_poisson_and_no_gaussian(mean_e: float) -> None:
    counting = replace(SENSOR, read_noise_e=0.0, gain_e_per_dn=1.0, black_level_dn=0.0, bits=16)
    radiance = Radiance("s", np.full((400, 500), mean_e / counting.electrons_per_radiance, np.float32))
    k = np.arange(100)
    counts = np.bincount(expose(radiance, counting, 5).pixels_dn.ravel(), minlength=len(k))
    mean_e = float(radiance.values[0, 0]) * counting.electrons_per_radiance
    assert fit_chi2(counts, poisson.pmf(k, mean_e)) > 1e-3
    # A Gaussian of the same mean and variance, rounded to whole electrons, is refused, and so is the frame as one.
    edges = norm.cdf(np.concatenate([[-np.inf], k[:-1] + 0.5, [np.inf]]), mean_e, np.sqrt(mean_e))
    assert fit_chi2(counts, np.diff(edges)) < 1e-9
    z = norm.ppf(Plane(5, "expose/s/electrons").uniforms(range(400), 500))
    rounded = np.clip(np.rint(mean_e + np.sqrt(mean_e) * z), 0, 99).astype(int)
    assert fit_chi2(np.bincount(rounded.ravel(), minlength=len(k)), poisson.pmf(k, mean_e)) < 1e-9


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_light_that_is_no_number_stops_the_exposure_with_its_place(wrong: float) -> None:
    light = flat(0.5).values.copy()
    light[3, 7] = wrong
    with pytest.raises(TestfieldError, match=r"x = 7, y = 3"):
        expose(Radiance("left", light), SENSOR, 5)


def test_the_sheet_tells_mean_and_variance_of_the_dark_current() -> None:
    sensor = replace(SENSOR, dark_current_e_per_s=5000.0)
    for radiance in (0.0, 0.4):
        pixels = expose(flat(radiance), sensor, 5).pixels_dn.astype(float)
        mean = (radiance * sensor.electrons_per_radiance + 120) / 2.6 + 64
        variance = (radiance * sensor.electrons_per_radiance + 120 + 2.3**2) / 2.6**2 + 1 / 12
        assert abs(pixels.mean() - mean) < 5 * np.sqrt(variance / pixels.size) + 1e-3
        assert pixels.var() == pytest.approx(variance, rel=5 * np.sqrt(2 / pixels.size))
        assert float(sensor.sheet.variance_dn2(np.array(mean))) == pytest.approx(variance, rel=1e-12)


def test_dark_current_grows_with_time() -> None:
    sensor = replace(SENSOR, dark_current_e_per_s=5000.0, time_ms=48.0)
    assert expose(flat(0), sensor, 5).pixels_dn.mean() == pytest.approx(64 + 240 / 2.6, abs=0.1)


def test_light_and_dark_current_fill_one_well() -> None:
    sensor = replace(SENSOR, dark_current_e_per_s=1e5)
    full = expose(flat(10.0), sensor, 5).pixels_dn
    assert full.mean() == pytest.approx(10400 / 2.6 + 64, abs=0.2)
    assert sensor.sheet.saturation_dn == pytest.approx(SENSOR.sheet.saturation_dn, rel=1e-12)


def mean_of(stations: int, radiance: float, sensor: Sensor, first: int = 0) -> np.ndarray:
    light = flat(radiance).values
    names = [f"s{k}" for k in range(first, first + stations)]
    return np.mean([expose(Radiance(name, light), sensor, 5).pixels_dn for name in names], axis=0)


@pytest.mark.parametrize(
    ("change", "radiance", "sigma_e"),
    [({"prnu": 0.02}, 0.4, 0.02 * 0.4 * SENSOR.electrons_per_radiance), ({"dsnu_e": 5.0}, 0.0, 5.0)],
)
def test_a_fixed_pattern_is_the_same_at_every_station(
    change: dict[str, float], radiance: float, sigma_e: float
) -> None:
    sensor = replace(SENSOR, **change)  # type: ignore[arg-type]
    one, two = mean_of(4, radiance, sensor), mean_of(4, radiance, sensor, first=4)
    # Only what the two averages share survives in their covariance.
    shared = np.cov(one.ravel(), two.ravel())[0, 1]
    assert np.sqrt(shared) * 2.6 == pytest.approx(sigma_e, rel=0.02)
    plain = np.cov(mean_of(4, radiance, SENSOR).ravel(), mean_of(4, radiance, SENSOR, first=4).ravel())[0, 1]
    assert abs(plain) < 0.02 * shared


def test_prnu_needs_light_and_dsnu_does_not() -> None:
    dark = expose(flat(0), SENSOR, 5).pixels_dn
    assert np.array_equal(expose(flat(0), replace(SENSOR, prnu=0.1), 5).pixels_dn, dark)
    assert expose(flat(0), replace(SENSOR, dsnu_e=5.0), 5).pixels_dn.var() > 3 * dark.var()


def test_a_fixed_pattern_belongs_to_the_seed_and_no_gain_is_negative() -> None:
    wild = gain_pattern((400, 500), 0.9, 5)
    assert wild.min() == 0
    assert np.array_equal(wild, gain_pattern((400, 500), 0.9, 5))
    assert not np.array_equal(wild, gain_pattern((400, 500), 0.9, 6))


@pytest.mark.parametrize("order", ["RGGB", "BGGR", "GRBG", "GBRG"])
def test_each_pixel_sees_through_its_own_filter(order: str) -> None:
    response = dict(zip("RGB", (0.5, 1.0, 0.25), strict=True))
    sensor = replace(SENSOR, bayer=order, bayer_response=tuple(response.values()))  # type: ignore[arg-type]
    pixels = expose(flat(0.4), sensor, 5).pixels_dn.astype(float)
    for k, colour in enumerate(order):
        mean = response[colour] * 0.4 * SENSOR.electrons_per_radiance / 2.6 + 64
        assert pixels[k // 2 :: 2, k % 2 :: 2].mean() == pytest.approx(mean, abs=0.5), colour


def test_filters_that_pass_everything_change_nothing() -> None:
    assert np.array_equal(
        expose(flat(0.4), replace(SENSOR, bayer="RGGB"), 5).pixels_dn, expose(flat(0.4), SENSOR, 5).pixels_dn
    )


@pytest.mark.parametrize(
    "wrong",
    [{"prnu": -0.1}, {"dsnu_e": -1}, {"dark_current_e_per_s": -1}, {"bayer": "RGBG"}, {"bayer_response": (1, 0, 1)}],
)
def test_a_scene_refuses_a_sensor_that_cannot_be(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        SensorPart.model_validate(wrong)


@pytest.mark.parametrize("mean_e", [0.3, 1.0, 4.0])
def test_few_photons_come_as_poisson_counts_and_not_as_normal_ones(mean_e: float) -> None:
    """Counts of a sensor that shows each electron, against e^-m m^k / k! by chi-squared; a normal law would fail."""
    each = Sensor(3.45, 8.0, 24.0, 550.0, 0.63, 1e6, 0.0, 1.0, 10, 16)
    radiance = Radiance("s", np.full((200, 200), mean_e / each.electrons_per_radiance, np.float32))
    counts = np.bincount(expose(radiance, each, 3).pixels_dn.ravel() - 10, minlength=30)
    k = np.arange(12)
    expected = 40_000 * math.exp(-mean_e) * np.array([mean_e**n / math.factorial(n) for n in k])
    shown = expected > 5
    chi2 = float(((counts[:12] - expected)[shown] ** 2 / expected[shown]).sum())
    freedom = int(shown.sum()) - 1
    assert chi2 < freedom + 5 * math.sqrt(2 * freedom)
    # The pixels of a normal law of the same mean and variance, rounded and cut off at nothing.
    law = np.clip(np.rint(np.random.default_rng(1).normal(mean_e, mean_e**0.5, 40_000)), 0, 29).astype(int)
    normal = float(((np.bincount(law, minlength=30)[:12] - expected)[shown] ** 2 / expected[shown]).sum())
    assert normal > freedom + 50 * math.sqrt(2 * freedom)
