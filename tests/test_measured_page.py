"""What the page of a measurement says by photograph and board, of the smooth part, and of what was not used."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hand_made import HandMade

from testfield.calibrate.settled import NOT_CONVERGED
from testfield.detect.observations import MEASURED
from testfield.measure.doubts import doubts_of
from testfield.measure.photographs import Measurement
from testfield.report.measured_figures import outlined, smoothed
from testfield.report.measured_parts import boards_of, reasons, residual_rows, stations_of, unused_of
from testfield.targets.field_file import FieldFile
from testfield.uncertainty.halves import Difference, Halves

RING = {"target": {"kind": "ring14"}}


def measured(by_hand: HandMade) -> Measurement:
    """Residuals at the first measured observations, so that all can be said by hand."""
    o = by_hand.observations
    here = np.flatnonzero(o.status == MEASURED)[:8]
    c = replace(
        by_hand.calibration,
        residual_at_px=o.xy_px[here],
        residual_px=np.tile([0.3, 0.4], (len(here), 1)),
        used=len(here),
        rejected=(),
        board_names=(),
    )
    return Measurement(o, c, by_hand.points, (), "by hand")


def test_each_residual_is_one_of_its_observation_and_is_counted_where_it_belongs(by_hand: HandMade) -> None:
    result = measured(by_hand)
    rows = residual_rows(result)
    assert rows.tolist() == np.flatnonzero(result.observations.status == MEASURED)[:8].tolist()
    stations = stations_of(result, rows)
    assert sum(s["used"] for s in stations) == 8
    assert all(s["rms"] == pytest.approx(0.5) for s in stations if s["used"])
    codes = sorted({int(c) for c in result.observations.code[rows] if c > 0})
    assert codes
    group = {"name": "one", "u": 1.0, "points": [{"code": c, "xyz": [0, 0, 0]} for c in codes]}
    boards = {b["name"]: b for b in boards_of(result, FieldFile.model_validate(RING | {"groups": [group]}), rows)}
    assert boards["one"]["used"] == int((result.observations.code[rows] > 0).sum())
    assert boards["one"]["mean_x"] == pytest.approx(0.3)


def test_nothing_that_was_seen_is_without_a_reason(by_hand: HandMade, tmp_path: Path) -> None:
    result = measured(by_hand)
    for name in result.observations.stations:
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.full((800, 1000), 90, np.uint8))
    rows = residual_rows(result)
    why = reasons(result, rows)
    used = np.zeros(len(why), bool)
    used[rows] = True
    assert ((why == "") == used).all()
    unused = unused_of(result, rows, tmp_path)
    assert sum(one.count for one in unused) == int((~used).sum())
    assert all(one.crops or one.texture for one in unused)
    at = int(rows[0])
    o = result.observations
    turned = {
        "station": o.stations[o.station[at]],
        "x_px": o.xy_px[at, 0],
        "y_px": o.xy_px[at, 1],
        "why": "is elsewhere",
    }
    c = result.calibration
    lost = replace(
        c, residual_at_px=c.residual_at_px[1:], residual_px=c.residual_px[1:], rejected=(turned,), used=c.used - 1
    )
    fewer = replace(result, calibration=lost)
    assert "is elsewhere" in reasons(fewer, residual_rows(fewer))[at]


def test_the_smooth_part_is_found_in_noise_and_noise_alone_is_chance() -> None:
    rng = np.random.default_rng(5)
    xy = rng.uniform(0, 1000, (800, 2))
    noise = 0.05 * rng.standard_normal((800, 2))
    at = np.stack(np.meshgrid([250.0, 500, 750], [250.0, 500, 750]), -1).reshape(-1, 2)
    mean, chance = smoothed(xy, noise, at, 80.0)
    assert (np.linalg.norm(mean, axis=1) < 3 * chance).all()
    bent = noise + 0.1 * np.column_stack([np.sin(xy[:, 1] / 300), np.zeros(800)])
    mean, chance = smoothed(xy, bent, at, 80.0)
    true = 0.1 * np.sin(at[:, 1] / 300)
    assert np.abs(mean[:, 0] - true).max() < 0.02
    assert (np.linalg.norm(mean, axis=1) > 3 * chance)[true > 0.05].all()


def test_the_outline_of_a_square_is_its_area() -> None:
    assert outlined(np.array([[0, 0], [50, 0], [50, 50], [0, 50], [20, 20.0]]), 100, 100)[0] == pytest.approx(0.25)
    assert outlined(np.array([[0, 0], [1, 1], [2, 2.0]]), 100, 100)[0] == 0


def test_what_fails_nothing_may_be_doubtful_and_says_each_reason(by_hand: HandMade) -> None:
    good = replace(measured(by_hand), calibration=replace(measured(by_hand).calibration, sigma0=1.0))
    assert not doubts_of(good)
    scatter = replace(good, calibration=replace(good.calibration, sigma0=8.0))
    halves = replace(good, halves=Halves(3, (Difference("fx", 9.0, 2.0, 4.5, "px"),)))
    few = replace(good, calibration=replace(good.calibration, station_names=good.calibration.station_names[:1]))
    creeping = replace(good, calibration=replace(good.calibration, notes=(f"{NOT_CONVERGED} after 60 steps",)))
    field = replace(good, calibration=replace(good.calibration, misfit={"rms_px": 5.2}))
    unread = replace(good, unread=tuple(f"{k}.jpg" for k in range(len(good.calibration.station_names))))
    assert [len(doubts_of(one)) for one in (scatter, halves, few, creeping, field, unread)] == [1] * 6
    assert not doubts_of(replace(good, calibration=replace(good.calibration, misfit={"rms_px": 0.3})))
    assert "5.2 px" in doubts_of(field)[0] and "--lens" in doubts_of(field)[0]
    assert "8.0" in doubts_of(scatter)[0] and "4.5" in doubts_of(halves)[0]
