"""What the pages of an acceptance and of a measurement draw, read from the figures' own data, on hand-made errors."""

import base64
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hand_made import HandMade

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.certified import Certified
from testfield.detect.observations import MEASURED, Observations
from testfield.measure.certified import lengths_of
from testfield.measure.photographs import Measurement
from testfield.reconstruct.points import Points
from testfield.report import accept, measured
from testfield.report.accept import MOST_DRAWN, envelopes, errors_over_length, plan_of_lengths
from testfield.report.measured import PICTURE_WIDTH, point_plan, write_measurement
from testfield.report.style import ACCENT, FAINT, INK, WARM
from testfield.score.length_test import Limit, MeasuredLengths, smallest_envelope
from testfield.targets.field_file import FieldFile

UM = 1e-3
Draw = Callable[..., list[Any]]


@pytest.fixture
def axes_of(monkeypatch: pytest.MonkeyPatch) -> Draw:
    """Calls a function that draws, and gives back the axes of its figure."""

    def draw(drawn: Callable[..., Any], *values: Any) -> list[Any]:
        kept: list[Any] = []

        def keep(drawing: Any) -> bytes:
            kept.append(drawing)
            return b"<svg/>"

        for module in (accept, measured):
            monkeypatch.setattr(module, "svg_of", keep)
        drawn(*values)
        (drawing,) = kept
        return list(drawing.axes)

    return draw


def lengths(calibrated_mm: list[float], dl_um: list[float], codes: list[tuple[int, int]]) -> MeasuredLengths:
    """Lengths measured with u = 1.5 um, calibrated ones with 2 um: 2.5 um together."""
    L_mm, n = np.array(calibrated_mm), len(calibrated_mm)
    cov = 1.5**2 * UM**2 * np.eye(n)
    return MeasuredLengths(("line",) * n, np.array(codes), L_mm, np.full(n, 2 * UM), L_mm + UM * np.array(dl_um), cov)


FOUR = lengths([500, 1000, 1500, 2000], [-1, 4, 3, 8], [(21, 22), (23, 24), (25, 26), (21, 25)])
"""Mean length 1250 mm and error 3.5 um; 1,250,000 mm^2 about it, and 6500 um mm: 5.2 ppm."""


def xy(line: Any) -> np.ndarray:
    return np.column_stack([line.get_xdata(), line.get_ydata()]).astype(float)


# ------------------------------------------------------------------ the page of an acceptance
def test_errors_are_drawn_with_limit_slope_and_band(axes_of: Draw) -> None:
    (axes,) = axes_of(errors_over_length, FOUR, Limit(0.004, 3, 0.009))
    bars = axes.containers[0]
    assert xy(bars.lines[0]) == pytest.approx(np.array([[500, -1], [1000, 4], [1500, 3], [2000, 8]]), abs=1e-6)
    sticks = np.array(bars.lines[2][0].get_segments())
    assert sticks[:, 1, 1] - sticks[:, 0, 1] == pytest.approx(np.full(4, 2 * 2 * 2.5), rel=1e-6)
    assert axes.get_xlim() == pytest.approx((0, 2080))
    upper, lower, slope = (xy(line) for line in axes.lines if len(line.get_xdata()) == 200)
    for side, line in ((1, upper), (-1, lower)):
        assert line[[0, -1]] == pytest.approx(np.array([[0, side * 4], [2080, side * 9]]))  # 4 + 6.24 is beyond B
        assert side * np.interp(1000, *line.T) == pytest.approx(7.0)
    assert slope[[0, -1]] == pytest.approx(np.array([[0, 3.5 - 6.5], [2080, 3.5 + 5.2 * 0.83]]), rel=1e-6)
    half = 1.95996398454 * 2.5 / 1_250_000**0.5  # um in a millimetre, about the mean length
    band = axes.collections[-1].get_paths()[0].vertices
    for x, reach in ((0, 1250), (2080, 830)):
        middle = 3.5 + 5.2e-3 * (x - 1250)
        ends = band[np.abs(band[:, 0] - x) < 1e-6, 1]
        assert (ends.min(), ends.max()) == pytest.approx((middle - half * reach, middle + half * reach), rel=1e-6)


def test_without_a_limit_or_a_slope_none_is_drawn(axes_of: Draw) -> None:
    (axes,) = axes_of(errors_over_length, FOUR, None)
    assert len([line for line in axes.lines if len(line.get_xdata()) == 200]) == 1
    two = lengths([500, 1000], [1, 2], [(21, 22), (23, 24)])
    (axes,) = axes_of(errors_over_length, two, Limit(0.004))
    assert len([line for line in axes.lines if len(line.get_xdata()) == 200]) == 2


def test_the_envelope_falls_from_the_largest_error_to_nothing(axes_of: Draw) -> None:
    """8 um at 2 m and 4 um at 1 m: A is 8 um without K, and 0 with 4 ppm, where 1 um at half a metre needs 2 ppm."""
    (axes,) = axes_of(envelopes, FOUR, smallest_envelope(FOUR))
    line = xy(axes.lines[0])
    assert line[[0, -1]] == pytest.approx(np.array([[0, 8], [4, 0]]), abs=1e-6)
    assert np.interp(1.0, *line.T) == pytest.approx(6.0)
    dot = axes.collections[-1].get_offsets()[0]
    assert np.interp(dot[0], *line.T) == pytest.approx(dot[1], abs=0.03)
    assert axes.get_xlim() == pytest.approx((0, 4)) and axes.get_ylim() == pytest.approx((0, 8.4))


def test_every_test_length_is_drawn_between_its_targets_the_worst_thickest(by_hand: HandMade, axes_of: Draw) -> None:
    """The datum lies turned in the world: its (x, y, z) is (100 - y, 200 + x, 300 + z) there, in metres as drawn."""
    elevation, plan = axes_of(plan_of_lengths, by_hand.world, FOUR)
    assert (elevation.get_title("left"), plan.get_title("left")) == ("elevation", "plan")
    in_elevation = {
        (21, 22): [[0.1, 0.3]] * 2,
        (23, 24): [[-0.5, 0.3], [0.7, 0.3]],
        (25, 26): [[0.1, 0.8], [0.1, -0.2]],
        (21, 25): [[0.1, 0.3], [0.1, 0.8]],
    }
    in_plan = {
        (21, 22): [[0.1, 1.2], [0.1, -0.8]],
        (23, 24): [[-0.5, 0.2], [0.7, 0.2]],
        (25, 26): [[0.1, 0.2]] * 2,
        (21, 25): [[0.1, 1.2], [0.1, 0.2]],
    }
    by_size = [(21, 22), (25, 26), (23, 24), (21, 25)]  # 1, 3, 4 and 8 um
    widths = [0.8 + 1.6 * part for part in (1 / 8, 3 / 8, 4 / 8, 1)]
    for axes, places in ((elevation, in_elevation), (plan, in_plan)):
        lines = [line for line in axes.lines if line.get_zorder() == 4]
        assert [line.get_linewidth() for line in lines] == pytest.approx(widths, rel=1e-6)
        for line, codes in zip(lines, by_size, strict=True):
            assert xy(line) == pytest.approx(np.array(places[codes]), abs=1e-9), codes
        assert len({line.get_color() for line in lines}) == 4
    marks = by_hand.world.mark_world_mm / 1000
    for axes, plane in ((elevation, (0, 2)), (plan, (0, 1))):
        for limits, k in ((axes.get_xlim(), plane[0]), (axes.get_ylim(), plane[1])):
            assert limits == pytest.approx((marks[:, k].min() - 0.3, marks[:, k].max() + 0.3))


def test_of_many_lengths_only_the_worst_are_drawn(by_hand: HandMade, axes_of: Draw) -> None:
    n = MOST_DRAWN + 20
    many = lengths([1000.0 + k for k in range(n)], [k + 1 for k in range(n)], [(21, 22)] * n)
    for axes in axes_of(plan_of_lengths, by_hand.world, many):
        drawn = [line.get_linewidth() for line in axes.lines if line.get_zorder() == 4]
        assert drawn == pytest.approx([0.8 + 1.6 * (k + 1) / n for k in range(20, n)])
    (axes,) = axes_of(errors_over_length, many, None)
    assert len(axes.containers[0].lines[0].get_xdata()) == n


# ------------------------------------------------------------------ the page of a measurement
def result_of(by_hand: HandMade, points: Points) -> Measurement:
    o = by_hand.observations
    o = replace(o, point=np.where(o.status == MEASURED, 0, -1))
    found, _ = lengths_of(Certified(by_hand.world.field.scale_bars, {}, {}), points, set(), "distances")
    return Measurement(o, by_hand.calibration, points, found, "by hand")


def test_every_point_is_drawn_within_the_plan_with_its_ellipse(by_hand: HandMade, axes_of: Draw) -> None:
    """Spans of 2000.002, 1299.994 and 6500.023 mm, a margin of 0.06 of the largest; one of them has no code."""
    points = replace(by_hand.points, code=np.where(by_hand.points.code == 37, -1, by_hand.points.code))
    at = points.xyz_mm
    for axes, plane in zip(axes_of(point_plan, result_of(by_hand, points)), ((0, 1), (0, 2)), strict=True):
        coded, uncoded = (np.array(dots.get_offsets()) for dots in axes.collections)
        assert coded == pytest.approx(at[points.code > 0][:, plane]) and len(coded) == 12
        assert uncoded == pytest.approx(at[points.code < 0][:, plane]) and len(uncoded) == 1
        margin = 0.06 * np.ptp(at[:, 2])
        for limits, k in ((axes.get_xlim(), plane[0]), (axes.get_ylim(), plane[1])):
            assert limits == pytest.approx((at[:, k].min() - margin, at[:, k].max() + margin))
        rings = [xy(line) for line in axes.lines]
        assert len(rings) == 13
        factor = float(axes.get_title("left").rpartition(", ")[2].split()[0])
        for k, ring in enumerate(rings):
            half = 2.4477 * factor * np.sqrt(np.diag(points.cov_xyz_mm2)[[3 * k + axis for axis in plane]])
            off = ring - at[k, list(plane)]
            # The ring is a polygon of some sides, which may miss the very end of an axis by a little.
            assert np.abs(off).max(axis=0) == pytest.approx(half, rel=1e-2)


@pytest.mark.parametrize(("width", "shown"), [(2 * PICTURE_WIDTH, PICTURE_WIDTH), (600, 600)])
def test_a_photograph_on_the_page_is_made_smaller_but_never_larger(tmp_path: Path, width: int, shown: int) -> None:
    path = tmp_path / "photograph.png"
    cv2.imwrite(str(path), np.full((width // 2, width), 90, np.uint8))
    kind, _, content = measured._picture(path).partition(";base64,")
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_UNCHANGED)
    assert kind == "data:image/jpeg" and picture.shape[:2] == (shown // 2, shown)


def test_a_measurement_writes_what_it_measured(by_hand: HandMade, tmp_path: Path) -> None:
    result = result_of(by_hand, by_hand.points)
    folder = tmp_path / "new/measured"
    folder.mkdir(parents=True)
    for name in result.observations.stations:
        cv2.imwrite(str(folder / f"{name}.png"), np.full((800, 1000), 90, np.uint8))
    summary = write_measurement(result, FieldFile.model_validate({"target": {"kind": "ring14"}}), folder, ("left.jpg",))
    o = Observations.load(folder / "observations.parquet")
    assert o.xy_px == pytest.approx(result.observations.xy_px) and o.code.tolist() == result.observations.code.tolist()
    c = Calibration.load(folder / "calibration.json")
    assert c.interior.parameters == pytest.approx(result.calibration.interior.parameters)
    assert c.covariance == pytest.approx(result.calibration.covariance)
    p = Points.load(folder / "points.parquet")
    assert p.code.tolist() == by_hand.points.code.tolist() and p.xyz_mm == pytest.approx(by_hand.points.xyz_mm)
    assert p.cov_xyz_mm2 == pytest.approx(by_hand.points.cov_xyz_mm2)
    written = json.loads((folder / "measurement.json").read_text(encoding="utf-8"))
    assert written == json.loads(json.dumps(summary))
    assert sorted(path.name for path in folder.iterdir()) == [
        "calibration.json",
        "left.png",
        "measurement.json",
        "observations.parquet",
        "points.csv",
        "points.parquet",
        "report.html",
        "right.png",
    ]
    expected = {
        "images": ["left", "right"],
        "joined": ["left", "right"],
        "datum": "by hand",
        "reprojection_rms_px": 0.123,
        "sigma0": 1.05,
        "points": 13,
        "uncoded": 0,
        "failures": [],
        "passed": True,
        "notes": ["a note"],
        "lens_misfit": None,
    }
    assert {key: written[key] for key in expected} == expected
    assert [written["interior"][name] for name in ("fx", "fy", "cx", "cy")] == [1001.0, 1001.0, 499.8, 399.5]
    assert [row["sigmas"] for row in written["rejected"]] == [7.8, 9.8]
    failed = replace(result, calibration=replace(result.calibration, failures=("it fails",)))
    again = write_measurement(failed, FieldFile.model_validate({"target": {"kind": "ring14"}}), folder, ("left.jpg",))
    assert not again["passed"] and again["failures"] == ["it fails"]
    assert again["figures"][-1][1].startswith("NOT passed: 1 ")
    lines = (folder / "points.csv").read_text(encoding="utf-8").splitlines()
    assert lines[0] == "point,x_mm,y_mm,z_mm,u_x_mm,u_y_mm,u_z_mm,rays,residual_rms_px" and len(lines) == 14
    assert lines[2] == "code 21,1000.01100,0.02000,-0.02000,0.00300,0.00300,0.00400,2,0.0000"


def test_figures_look_as_the_others_do(by_hand: HandMade, axes_of: Draw) -> None:
    """Sizes in inches; widths and sizes of lines and dots in points, and how much shines through."""
    (axes,) = axes_of(errors_over_length, FOUR, Limit(0.004, 3, 0.009))
    assert axes.figure.get_size_inches().tolist() == [6.1, 3.9]
    dots, _, (sticks,) = axes.containers[0].lines
    assert (dots.get_markersize(), dots.get_markeredgewidth(), dots.get_alpha()) == (3.2, 0, 1.0)
    assert dots.get_linestyle() == "None" and sticks.get_linewidths() == [0.8]
    zero, *limits, slope = [line for line in axes.lines if line is not dots]
    looks = [(line.get_color(), line.get_linewidth()) for line in (zero, *limits, slope)]
    assert looks == [(FAINT, 0.8), (WARM, 1.4), (WARM, 1.4), (ACCENT, 1)]
    assert zero.get_ydata() == [0, 0]
    band = axes.collections[-1]
    assert (band.get_alpha(), band.get_linewidths().tolist()) == (0.12, [0])
    n = MOST_DRAWN
    for count, alpha in ((n, 1.0), (n + 1, 0.35)):
        many = lengths([1000.0 + k for k in range(count)], [1.0] * count, [(21, 22)] * count)
        (axes,) = axes_of(errors_over_length, many, None)
        assert axes.containers[0].lines[0].get_alpha() == alpha
    (axes,) = axes_of(envelopes, FOUR, smallest_envelope(FOUR))
    assert axes.figure.get_size_inches().tolist() == [6.1, 3.9]
    (line,), (fill, dot) = axes.lines, axes.collections
    assert (line.get_color(), line.get_linewidth(), len(line.get_xdata())) == (ACCENT, 1.4, 300)
    assert (fill.get_alpha(), dot.get_sizes().tolist(), dot.get_zorder(), dot.get_clip_on()) == (0.08, [24], 5, False)
    assert axes_of(plan_of_lengths, by_hand.world, FOUR)[0].figure.get_size_inches().tolist() == [11.6, 4.6]
    (axes, _) = axes_of(point_plan, result_of(by_hand, by_hand.points))
    assert axes.figure.get_size_inches().tolist() == [6.1, 7.4]
    dots, ring = axes.collections[0], axes.lines[0]
    assert (dots.get_sizes().tolist(), dots.get_linewidths().tolist(), dots.get_zorder()) == ([7], [0], 5)
    assert (ring.get_color(), ring.get_linewidth(), ring.get_alpha()) == (INK, 0.5, 0.6)
    assert axes.get_legend().get_frame().get_alpha() == 0.9 and axes.get_aspect() == 1


def test_errors_of_nothing_have_an_axis_all_the_same(by_hand: HandMade, axes_of: Draw) -> None:
    """A field measured without any error: no limit of an axis is 0 to 0, and the lines are drawn as of no size."""
    none = lengths([500, 1000], [0, 0], [(21, 22), (23, 24)])
    (axes,) = axes_of(envelopes, none, smallest_envelope(none))
    assert axes.get_xlim() == (0, 1e-9)
    assert axes.get_ylim() == pytest.approx((0, 1.05e-6), rel=1e-9, abs=0)
    for axes in axes_of(plan_of_lengths, by_hand.world, none):
        assert [line.get_linewidth() for line in axes.lines if line.get_zorder() == 4] == [0.8, 0.8]
    half = lengths([500, 1000], [0.2, 0.1], [(21, 22), (23, 24)])
    (axes,) = axes_of(envelopes, half, smallest_envelope(half))
    assert axes.get_xlim() == pytest.approx((0, 0.4)) and axes.get_ylim() == pytest.approx((0, 0.21))
