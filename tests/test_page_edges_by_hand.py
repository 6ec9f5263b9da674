"""What pages draw and show where there is much, little or nothing to show: by hand, at the bounds."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hand_made import HandMade

from testfield.detect.observations import MEASURED
from testfield.measure.photographs import Measurement
from testfield.report import figures, page
from testfield.report.measured import PICTURE_WIDTH, _figures, point_plan
from testfield.report.page import MOST_BYTES, _other_pictures
from testfield.uncertainty.halves import Halves


def test_pictures_of_the_other_stations_stop_before_the_page_is_too_large(
    by_hand: HandMade, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As many bytes as there may be hold two pictures and no third; the wider, the fewer there are."""
    asked: list[tuple[str, int]] = []
    size = {"b": MOST_BYTES - 10, "c": 10, "d": 1}

    def picture(folder: Path, name: str, observations: Any, width_px: int) -> str:
        asked.append((name, width_px))
        return "x" * size.get(name, 0)

    monkeypatch.setattr(page, "_picture", picture)
    (tmp_path / "frames").mkdir()
    for name in "abcd":
        (tmp_path / f"frames/{name}.png").touch()
    stations = replace(by_hand.observations, stations=tuple("abcde"))
    assert list(_other_pictures(tmp_path, "a", stations)) == ["b", "c"]
    assert asked == [("b", 1240), ("c", 1240), ("d", 1240)]
    for count, width_px in (
        (12, 1240),
        (13, 900),
        (30, 900),
        (31, 640),
        (80, 640),
        (81, 480),
        (1000, 480),
        (1001, 480),
    ):
        asked.clear()
        names = [f"s{k}" for k in range(count)]
        monkeypatch.setattr(Path, "is_file", lambda path: True)
        _other_pictures(tmp_path, "a", replace(stations, stations=("a", *names)))
        assert asked == [(name, width_px) for name in names]


def test_pages_show_images_at_1240_pixels() -> None:
    assert PICTURE_WIDTH == figures.PICTURE_WIDTH == 1240


def test_what_the_halves_of_a_measurement_say_is_one_of_its_figures(by_hand: HandMade) -> None:
    said = Measurement(by_hand.observations, by_hand.calibration, by_hand.points, (), "by hand", Halves(4, (), "no"))
    rows = dict(_figures(said))
    assert rows["halves of the images"] == "no"
    assert rows["targets measured; used"] == "17; 321" and rows["images joined, of those given"] == "2 of 2"
    assert rows["scatter over claim (sigma0)"] == "1.05" and rows["focal length"] == "1001.00 px"
    assert rows["points: coded; uncoded"] == "13; 0"
    quiet = Measurement(by_hand.observations, by_hand.calibration, by_hand.points, (), "by hand", Halves(4, ()))
    assert "halves of the images" not in dict(_figures(quiet))


@pytest.mark.parametrize(("part", "factor"), [(0.999, 2.0), (1.001, 5.0)])
def test_ellipses_are_enlarged_by_the_next_round_number(
    by_hand: HandMade, monkeypatch: pytest.MonkeyPatch, part: float, factor: float
) -> None:
    """Two points 1000 mm apart, whose ellipses of 95 % would be 6 mm wide when enlarged twice or a little more."""
    kept: list[Any] = []
    monkeypatch.setattr("testfield.report.measured.svg_of", lambda drawing: kept.append(drawing) or b"")
    u = 6.0 / (2.4477 * 2 * part)
    two = replace(
        by_hand.points,
        code=np.array([21, -1]),
        xyz_mm=np.array([[0.0, 10, 20], [1000, 20, 50]]),
        cov_xyz_mm2=np.diag([0.0, u**2, u**2, u**2, u**2, 9 * u**2]),
        rays=np.array([2, 2]),
        residual_rms_px=np.zeros(2),
        rejected=np.zeros(2, int),
    )
    o = replace(by_hand.observations, point=np.where(by_hand.observations.status == MEASURED, 0, -1))
    point_plan(Measurement(o, by_hand.calibration, two, (), "by hand"))
    for axes, across in zip(kept[0].axes, ("along z", "along y"), strict=True):
        assert axes.get_title("left") == f"{across}; ellipses of 95 %, {factor:g} times enlarged"
        assert axes.get_xlim() == pytest.approx((-60, 1060))
    assert kept[0].axes[0].get_xlabel() == "x, mm" and kept[0].axes[0].get_ylabel() == "y, mm"
    assert kept[0].axes[1].get_ylabel() == "z, mm"


def test_a_single_certain_point_is_drawn_too(by_hand: HandMade, monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[Any] = []
    monkeypatch.setattr("testfield.report.measured.svg_of", lambda drawing: kept.append(drawing) or b"")
    one = replace(
        by_hand.points,
        code=np.array([21]),
        xyz_mm=np.array([[1.0, 2, 3]]),
        cov_xyz_mm2=np.zeros((3, 3)),
        rays=np.array([2]),
        residual_rms_px=np.zeros(1),
        rejected=np.zeros(1, int),
    )
    point_plan(Measurement(by_hand.observations, by_hand.calibration, one, (), "by hand"))
    (low, high) = kept[0].axes[0].get_xlim()
    assert low < 1 < high and high - low < 1e-6
    # 0.006 * 1e-9 mm over 2.4477 * 1e-12 mm is 2.45.
    assert kept[0].axes[0].get_title("left").endswith(" 5 times enlarged")


def test_a_calibration_without_three_residuals_in_a_cell_draws_no_arrow(
    by_hand: HandMade, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[Any] = []
    monkeypatch.setattr(figures, "svg_of", lambda drawing: kept.append(drawing) or b"")
    many = replace(by_hand.calibration, residual_at_px=np.full((3, 2), 100.0), residual_px=np.array([[0.3, 0.0]] * 3))
    drawn: Callable[[Any], int] = lambda axes: sum(type(part).__name__ == "Quiver" for part in axes.collections)  # noqa: E731
    for calibration, arrows in ((by_hand.calibration, 0), (many, 1)):
        figures.residual_map(calibration)
        assert drawn(kept.pop().axes[0]) == arrows
