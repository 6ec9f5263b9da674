import logging
import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest

import testfield.certify.sensor as certificate
from testfield.camera.images import Frame, Radiance
from testfield.certify.sensor import TRUE, certify_sensor, evaluate, flat_series
from testfield.certify.verdict import Verdict
from testfield.sensor.expose import Sensor, expose

NAMES = ["gain", "quantum efficiency", "dark noise", "PRNU", "DSNU"]


def by_name(verdicts: list[Verdict]) -> dict[str, Verdict]:
    return {verdict.name: verdict for verdict in verdicts}


def test_photon_transfer_finds_the_figures_of_the_data_sheet() -> None:
    verdicts = by_name(certify_sensor(quick=True))
    assert list(verdicts)[:5] == NAMES
    assert all(verdict.passed and verdict.part == "sensor" for verdict in verdicts.values()), verdicts


@pytest.mark.parametrize(
    ("broken", "name"),
    [
        ({"gain_e_per_dn": 1.05 * TRUE.gain_e_per_dn}, "gain"),
        ({"quantum_efficiency": 1.05 * TRUE.quantum_efficiency}, "quantum efficiency"),
        ({"f_number": 1.03 * TRUE.f_number}, "quantum efficiency"),
        ({"read_noise_e": 1.05 * TRUE.read_noise_e}, "dark noise"),
        ({"prnu": 1.05 * TRUE.prnu}, "PRNU"),
        ({"dsnu_e": 1.05 * TRUE.dsnu_e}, "DSNU"),
    ],
)
def test_a_sensor_a_few_percent_off_fails_its_own_verdict_only(
    monkeypatch: pytest.MonkeyPatch, broken: dict[str, float], name: str
) -> None:
    def off(radiance: Radiance, sensor: Sensor, seed: int) -> Frame:
        return expose(radiance, replace(sensor, **broken), seed)  # type: ignore[arg-type]

    monkeypatch.setattr(certificate, "expose", off)
    verdicts = by_name(certify_sensor(quick=True))
    assert [key for key in NAMES if not verdicts[key].passed] == [name]


def test_a_sensor_without_patterns_shows_next_to_none() -> None:
    found = evaluate(flat_series(replace(TRUE, prnu=0.0, dsnu_e=0.0), levels=6, repeats=16))
    # What noise leaves is either a small pattern or a negative variance, which is told as not a number.
    assert not found.prnu > 0.1 * TRUE.prnu
    assert not found.dsnu_e > 0.1 * TRUE.dsnu_e


def test_without_its_package_the_cross_check_is_a_note_and_no_verdict(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # An empty module stands for a version that lacks what is called.
    monkeypatch.setitem(sys.modules, "emva1288", ModuleType("emva1288"))
    for name in [name for name in sys.modules if name.startswith("emva1288.")]:
        monkeypatch.delitem(sys.modules, name)
    with caplog.at_level(logging.WARNING):
        assert list(by_name(certify_sensor(quick=True))) == NAMES
    assert "no cross-check with the package emva1288" in caplog.text


def test_the_package_emva1288_finds_the_same_figures_in_the_same_frames() -> None:
    pytest.importorskip("emva1288")
    series = flat_series(TRUE, levels=12, repeats=8)
    theirs = certificate.emva1288_figures(series)
    assert not hasattr(np, "asfarray")  # lent for the call only
    own = evaluate(series)
    for field in ("gain_e_per_dn", "quantum_efficiency", "dark_noise_e", "prnu", "dsnu_e"):
        assert getattr(theirs, field) == pytest.approx(getattr(own, field), rel=1e-6), field
