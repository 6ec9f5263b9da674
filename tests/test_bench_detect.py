"""The centring benchmark: its bound is the physical one, its verdicts see a bias, and a stopped run goes on."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from testfield.bench import detect
from testfield.bench.bound import closed_form_px, cramer_rao, mean_pixels
from testfield.bench.centring import BEST, KNOWN, Task, circles_grid, estimators, measure
from testfield.bench.detect import QUICK, bench_detect, in_range, plan, run, verdicts
from testfield.bench.detect_page import write_page
from testfield.bench.dots import GROUND, INK, Case, render_dots
from testfield.bench.scatter import figures, systematic
from testfield.detect.centre import Centres
from testfield.sensor.expose import expose

SMALL = [("diameter", Task(Case(diameter_px=d, blur_px=0.5), 4, 0, 0)) for d in (6.0, 7.0)]
SIGMA_PX = 0.01


def made_up_runs(bias_px: float, claim: float = 1.0, noise: float = 1.0, exposures: int = 64) -> list[Centres]:
    """Runs over 64 dots at the origin with scatter `SIGMA_PX`; each dot's bias points its own way."""
    random = np.random.default_rng(4)
    angle = random.uniform(0, 2 * np.pi, 64)
    bias = bias_px * np.sqrt(2) * np.column_stack([np.cos(angle), np.sin(angle)])  # rms a coordinate
    runs = []
    for _ in range(exposures):
        found = Centres.empty(64)
        found.xy_px[:] = bias + noise * SIGMA_PX * random.standard_normal((64, 2))
        found.cov_px2[:] = claim * SIGMA_PX**2 * np.eye(2)
        found.ok[:] = True
        runs.append(found)
    return runs


def judged(runs: list[Centres]) -> dict[str, bool]:
    """Which verdicts on dots are met by an estimator with these runs."""
    bound = np.repeat(SIGMA_PX**2 * np.eye(2)[None], 64, axis=0)
    row = {"case": vars(Case()), "estimators": {BEST: figures(runs, np.zeros((64, 2)), bound)}}
    return {v["name"]: v["met"] for v in verdicts({"tilt": [row]}) if v["of"] == "dots"}


def test_the_bound_is_the_information_in_rendered_pixels() -> None:
    """Derivatives by shifting the rendered dots share nothing with the bound's contour integrals."""
    case, step = Case(8.0, 0.0, 100.0, 0.7, 0.0, (0.2, 0.1)), 0.05
    dots = render_dots(case, 1)
    scale, sheet = dots.sensor.electrons_per_radiance, dots.sensor.sheet

    def image(dx: float, dy: float) -> np.ndarray:
        moved = render_dots(replace(case, phase=(0.2 + dx, 0.1 + dy)), 1).radiance.values.astype(float)
        return moved * scale / sheet.gain_e_per_dn + sheet.black_level_dn

    mean = image(0, 0)
    by = [(image(*d) - image(*(-d))) / (2 * step) for d in step * np.eye(2)]
    variance, slope = sheet.variance_dn2(mean), 1 / sheet.gain_e_per_dn
    weight = 1 / variance + 0.5 * (slope / variance) ** 2
    fisher = np.array([[(a * b * weight).sum() for a in by] for b in by]) / len(dots.xy_px)
    bound = cramer_rao(dots)[0].mean(axis=0)
    assert np.allclose(np.diag(bound), np.diag(np.linalg.inv(fisher)), rtol=0.01)
    ours, _, first = mean_pixels(dots)
    x, y = first[0].astype(int)
    window = mean[y : y + ours.shape[1], x : x + ours.shape[2]]
    assert np.abs(ours[0] - window).max() < 3e-4 * np.ptp(window)


def test_the_bound_of_a_circle_under_white_noise_is_the_closed_form() -> None:
    dots = render_dots(Case(16.0, 0.0, 100.0, 0.8), 1, cells=1)
    contrast_e = (INK - GROUND) * dots.sensor.electrons_per_radiance
    white = replace(dots, case=replace(dots.case, snr=5.0), sensor=replace(dots.sensor, read_noise_e=contrast_e / 5))
    sigma = np.sqrt(np.einsum("nii->ni", cramer_rao(white)[0]).mean())
    assert sigma == pytest.approx(closed_form_px(white), rel=0.02)


def test_a_gradient_that_nobody_knows_costs_information_and_a_ring_costs_none() -> None:
    dots = render_dots(Case(8.0), 1, cells=1)
    even, uneven = cramer_rao(dots)
    assert (np.linalg.eigvalsh(uneven - even)[:, 1] > 0.2 * even[:, 0, 0]).all()
    coded = render_dots(Case(8.0, coded=True), 1, cells=1)
    assert (coded.world.marks.code > 0).all()
    assert len(set(coded.world.marks.code)) == len(coded.world.marks)
    assert np.einsum("nii->", cramer_rao(coded)[0]) == pytest.approx(np.einsum("nii->", even), rel=0.02)


def test_an_estimator_at_the_bound_meets_every_verdict() -> None:
    assert all(judged(made_up_runs(0.0)).values())


@pytest.mark.parametrize(
    ("runs", "missed"),
    [
        ({"bias_px": 0.15 * SIGMA_PX}, "greatest bias of the single dots, in sigma"),
        ({"bias_px": 0.0, "claim": 0.8}, "the same, greatest case"),
        ({"bias_px": 0.0, "claim": 1.25}, "the same, least case"),
        ({"bias_px": 0.0, "noise": 1.1}, "least efficiency"),
    ],
)
def test_an_estimator_that_is_off_misses_its_verdict(runs: dict[str, float], missed: str) -> None:
    assert not judged(made_up_runs(**runs))[missed]


def test_a_bias_that_all_dots_share_is_seen() -> None:
    runs = made_up_runs(0.0)
    for found in runs:
        found.xy_px[:, 0] += 0.15 * SIGMA_PX
    met = judged(runs)
    assert not met["greatest bias of all dots together, in sigma"]
    assert not met["greatest bias of the single dots, in sigma"]


def test_lost_dots_are_counted_and_an_estimator_that_measures_nothing_meets_nothing() -> None:
    runs = made_up_runs(0.0)
    for found in runs[:10]:
        found.ok[3] = False
    assert figures(runs, np.zeros((64, 2)), np.repeat(np.eye(2)[None], 64, 0))["not_measured"] == 10
    assert not judged(runs)["largest part of dots not measured"]
    for found in runs:
        found.ok[:] = False
    assert not any(judged(runs).values())


@pytest.mark.parametrize("true", [0.0, 0.05, 0.2])
def test_the_band_of_a_systematic_part_holds_it(true: float) -> None:
    random = np.random.default_rng(7)
    held, without = 0, []
    for _ in range(200):
        means = true + 0.1 * random.standard_normal(40)
        _, estimate, (low, high) = systematic(means, 0.01)
        assert low <= estimate <= high
        held += low <= true <= high
        without.append(estimate)
    assert held >= 183  # of 190 expected
    assert np.sqrt(np.mean(np.square(without))) == pytest.approx(true, abs=0.045)


@pytest.mark.slow
def test_a_run_that_was_stopped_goes_on_and_gives_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(detect, "plan", lambda quick: SMALL)
    monkeypatch.setattr("testfield.store.stamp.now", lambda: "at another time")
    told: list[str] = []
    whole = write_page(bench_detect(True, tmp_path / "whole", told.append), tmp_path / "whole")
    assert [line.startswith(f"case {k} of 2") for k, line in enumerate(told, 1)] == [True, True]

    def stopped(task: Task) -> dict:
        if task == SMALL[1][1]:
            raise KeyboardInterrupt
        return measure(task)

    monkeypatch.setattr(detect, "measure", stopped)
    with pytest.raises(KeyboardInterrupt):
        run(SMALL, tmp_path / "twice", told.append)
    measured: list[Task] = []
    monkeypatch.setattr(detect, "measure", lambda task: measured.append(task) or measure(task))
    again = write_page(bench_detect(True, tmp_path / "twice", told.append), tmp_path / "twice")
    assert measured == [SMALL[1][1]]
    for name in ("detect.json", "detect.html", "detect_diameter.svg"):
        assert (whole.parent / name).read_bytes() == (again.parent / name).read_bytes()


def test_what_is_damaged_or_made_by_other_code_is_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured: list[Task] = []

    def made_up(task: Task) -> dict:
        measured.append(task)
        return {"case": vars(task.case), "estimators": {}}

    monkeypatch.setattr(detect, "measure", made_up)
    run(SMALL, tmp_path, str)
    run(SMALL, tmp_path, str)
    assert measured == [task for _, task in SMALL]
    kept = tmp_path / detect.KEPT / detect.file_name(SMALL[0][1])
    kept.write_bytes(kept.read_bytes()[:-1] + b" ")
    run(SMALL, tmp_path, str)
    assert measured[2:] == [SMALL[0][1]]
    monkeypatch.setattr(detect, "code_digest", lambda *_: "another estimator")
    run(SMALL, tmp_path, str)
    assert len(measured) == 5


def test_the_forward_model_is_judged_as_it_is_called_plainly() -> None:
    """The lens given to it is another row."""
    dots = render_dots(Case(), 1, cells=1)
    assert not hasattr(estimators(dots)[BEST], "keywords")
    assert estimators(dots)[KNOWN].keywords["interior"] is dots.world.interior  # type: ignore[attr-defined]


def test_the_full_plan_covers_the_required_range() -> None:
    cases = [task.case for _, task in plan(False)]
    assert {factor for factor, _ in plan(True)} == {*QUICK, "corners"}
    required = [case for case in cases if in_range(vars(case))]
    for field, low, high in (("diameter_px", 6, 40), ("snr", 20, 200), ("tilt_deg", 0, 60)):
        values = [getattr(case, field) for case in required]
        assert (min(values), max(values)) == (low, high)
    # Chance alone, of 128 coordinates a case, stays well under the limit of the bias: 3 sigma of it.
    for _, task in plan(False):
        assert np.sqrt(3 * np.sqrt(2 / 128) / task.exposures) < 0.8 * detect.MOST_BIAS


def test_opencv_is_not_asked_for_a_grid_among_many_blobs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its search took 15 s an image where noise or rings made hundreds, and found nothing."""
    dots = render_dots(Case(8.0, coded=True), 1, cells=1)
    image = expose(dots.radiance, dots.sensor, 1).pixels_dn.astype(np.float32)

    def search(*_: object, **__: object) -> None:
        raise AssertionError("the search was begun")

    monkeypatch.setattr(cv2, "findCirclesGrid", search)
    assert not circles_grid(image, dots.sensor.sheet, dots.xy_px, dots.moments_px2).ok.any()
