"""Uncertainty: the figures of the standards, Monte Carlo against closed forms, and claims against errors."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_reconstruction import BENT, around, calibration_of, noisy, seen

from testfield.bench.claims import over_exposures, over_worlds
from testfield.chain.run import Run, begin, resume
from testfield.chain.stages import STAGES, run_stage
from testfield.chain.trials import Trials, reexposed
from testfield.cli.main import main
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.reconstruct.estimate import solve
from testfield.registry import find, known_of, names
from testfield.scene.build import build_world
from testfield.scene.truth import see
from testfield.score.align import aligned_covariance
from testfield.score.points import PointScore, score_points
from testfield.seeds import normals
from testfield.simulate.observations import bound_px2, draw_observations
from testfield.statistics.consistency import nees_band
from testfield.uncertainty import rays
from testfield.uncertainty.certificates import draw_certificates, draw_pixels
from testfield.uncertainty.monte_carlo import adaptive, of_few, tolerance, validate
from testfield.uncertainty.propagation import Lengths, linear
from testfield.uncertainty.rays import RayTrials
from testfield.uncertainty.supplement2 import adaptive_regions, coverage_factor, ellipsoids, regions

SCENES = Path(__file__).parents[1] / "scenes"


# ------------------------------------------------------------------ the standards' own figures
def test_coverage_factors_and_bands_are_the_standards() -> None:
    assert coverage_factor(2) == pytest.approx(2.4477, abs=5e-5)
    assert coverage_factor(3) == pytest.approx(2.7955, abs=5e-5)
    assert nees_band(300) == pytest.approx((0.846, 1.166), abs=5e-4)
    assert nees_band(90) == pytest.approx((0.729, 1.313), abs=5e-4)


@pytest.mark.parametrize(
    ("u", "digits", "delta"),
    [(0.0123, 1, 0.005), (0.0123, 2, 0.0005), (0.35, 2, 0.005), (0.0996, 1, 0.05), (9.96, 2, 0.5), (2.0, 2, 0.05)],
)
def test_the_tolerance_is_half_a_unit_of_the_last_digit(u: float, digits: int, delta: float) -> None:
    assert tolerance(np.array([u]), digits)[0] == pytest.approx(delta)


def four_rectangles(block: int, rng: np.random.Generator) -> np.ndarray:
    """JCGM 101 section 9.2.3: the sum of four rectangular quantities of standard deviation one."""
    return rng.uniform(-np.sqrt(3), np.sqrt(3), (10_000, 1, 4)).sum(axis=2)


def test_the_supplements_example_gives_its_interval_and_verdict() -> None:
    rng = np.random.default_rng(1)
    trials = adaptive(lambda k: four_rectangles(k, rng), np.array([0.01]), 2_000_000)
    assert trials.settled(np.array([0.01])).all()
    assert trials.u[0] == pytest.approx(2.0, abs=0.01)
    assert (trials.low[0], trials.high[0]) == pytest.approx((-3.88, 3.88), abs=0.02)
    judged = validate(np.zeros(1), np.array([2.0]), trials, digits=2)
    assert judged.delta[0] == pytest.approx(0.05)
    assert judged.d_low[0] == pytest.approx(0.04, abs=0.02)
    assert judged.verdict[0] == "yes"


def test_a_wrong_linear_result_is_not_validated() -> None:
    rng = np.random.default_rng(2)
    trials = adaptive(lambda k: rng.standard_normal((10_000, 2)) * [1.0, 1.5], np.array([0.01, 0.01]), 200_000)
    assert list(validate(np.zeros(2), np.array([1.0, 1.0]), trials, 2).verdict) == ["yes", "no"]


def test_the_shortest_interval_of_a_skewed_quantity_is_shorter() -> None:
    def squares(k: int) -> np.ndarray:
        return np.random.default_rng(k).standard_normal((10_000, 1)) ** 2

    symmetric, short = (adaptive(squares, np.array([0.02]), 100_000, shortest=s) for s in (False, True))
    assert short.high - short.low < 0.8 * (symmetric.high - symmetric.low)
    assert short.low[0] < 0.001
    assert short.high[0] == pytest.approx(3.8415, abs=0.05)  # chi-squared, one degree, 95 %


def test_too_few_trials_say_so() -> None:
    rng = np.random.default_rng(3)
    trials = adaptive(lambda k: rng.standard_normal((10_000, 1)), np.array([1e-5]), 30_000)
    assert trials.trials == 30_000
    assert not trials.settled(np.array([1e-5])).any()
    few = of_few(rng.standard_normal((10, 1)), np.ones(1))
    assert few.gaussian
    assert few.s[1, 0] >= 1 / np.sqrt(18)
    assert validate(np.zeros(1), np.ones(1), few).verdict[0] == "open"


def test_regions_of_gaussian_trials_are_the_closed_forms() -> None:
    cov = np.array([[[4.0, 1, 0], [1, 2, 0.5], [0, 0.5, 1]]])
    root = np.linalg.cholesky(cov)

    def block(k: int) -> np.ndarray:
        z = np.random.default_rng(k).standard_normal((10_000, 1, 3))
        return np.einsum("nij,tnj->tni", root, z)

    region, reached, _ = adaptive_regions(block, 200_000, digits=2)
    closed = ellipsoids(np.zeros((1, 3)), cov)
    assert reached
    assert region.k[0] == pytest.approx(2.7955, abs=0.02)
    assert region.axes_mm[0] == pytest.approx(closed.axes_mm[0], rel=0.02)
    assert (closed.box_mm >= region.box_mm).all()  # the box around the ellipsoid holds more than 95 %
    # What is not Gaussian has another k.
    flat = np.random.default_rng(1).uniform(-1, 1, (50_000, 1, 3))
    assert regions(flat).k[0] < 2.6


# ------------------------------------------------------------------ the cheap depth
def network() -> tuple:
    rng = np.random.default_rng(4)
    xyz = rng.uniform(-800, 800, (6, 3))
    stations = around(rng.uniform(3000, 5000, 5), rng)
    rows, field = seen(BENT, stations, xyz, 0.05)
    sigma = np.concatenate([[1, 1, 1, 1, 1e-3, 1e-3, 1e-3, 1e-5, 1e-5], np.tile([1e-4] * 3 + [0.3] * 3, 5)])
    return noisy(rows, 0.05, rng), field, calibration_of(BENT, stations, np.diag(sigma**2))


OWN_METHODS = [name for name in names("reconstructors") if known_of("reconstructors", name, "trials")]


def test_every_method_of_this_package_can_be_drawn_by_rays() -> None:
    assert set(OWN_METHODS) == {"midpoint", "dlt", "dlt_p34", "parametric_wls", "gls", "ml", "bundle"}


@pytest.mark.parametrize("method", OWN_METHODS)
def test_rays_met_again_scatter_as_the_linear_result_says(method: str) -> None:
    rows, field, calibration = network()
    points = find("reconstructors", method)(rows, calibration, field)
    ready = RayTrials.of(rows, calibration, field, method)
    assert np.allclose(ready.xyz_mm, points.xyz_mm, rtol=0, atol=1e-9)
    off = (ready.draw(range(4000), 5) - points.xyz_mm).reshape(4000, -1)
    white = np.linalg.solve(np.linalg.cholesky(points.cov_xyz_mm2), off.T)
    assert (white**2).mean() == pytest.approx(1, abs=0.03)
    assert np.abs(white.mean(axis=1)).max() < 0.08


@pytest.mark.parametrize("method", ["midpoint", "gls", "ml"])
def test_a_trial_is_the_reconstruction_of_its_pixels(method: str) -> None:
    rows, field, calibration = network()
    exact = replace(calibration, covariance=np.zeros_like(calibration.covariance))
    ready = RayTrials.of(rows, exact, field, method)
    drawn = ready.draw(range(1), 6)[0]
    sights = ready.solved.sights
    z = normals(6, "pixels", sights.xy_px.size).reshape(sights.xy_px.shape)
    shaken = replace(sights, xy_px=sights.xy_px + np.einsum("nkij,nkj->nki", np.linalg.cholesky(sights.cov_px2), z))
    again = solve(shaken, exact, known_of("reconstructors", method, "trials").method).xyz_mm
    assert np.abs(again - ready.xyz_mm).max() > 0.01
    assert np.allclose(drawn, again, rtol=0, atol=1e-4)  # weights and lines at the estimate: second order


def test_a_trial_has_its_number_whatever_block_it_is_drawn_in(monkeypatch: pytest.MonkeyPatch) -> None:
    rows, field, calibration = network()
    ready = RayTrials.of(rows, calibration, field, "gls")
    together = ready.draw(range(60), 5)
    assert np.allclose(ready.draw(range(20, 30), 5), together[20:30], rtol=0, atol=1e-9)
    monkeypatch.setattr(rays, "MOST_AT_ONCE", 7 * together.shape[1])
    assert np.allclose(ready.draw(range(60), 5), together, rtol=0, atol=1e-9)


def test_a_calibration_claimed_too_well_is_found_out() -> None:
    rows, field, calibration = network()
    points = find("reconstructors", "gls")(rows, calibration, field)
    result = linear(points, Lengths.between(points, {"bar": (1, 2)}))
    for honest in (True, False):
        worse = replace(calibration, covariance=(1.0 if honest else 4.0) * calibration.covariance)
        ready = RayTrials.of(rows, worse, field, "gls")

        def block(k: int, ready: RayTrials = ready) -> np.ndarray:
            return ready.draw(range(10_000 * k, 10_000 * (k + 1)), 8)

        trials = adaptive(lambda k: result.of(block(k)), np.zeros(len(result.names)), 20_000)
        verdict = validate(result.value_mm, result.u_mm, trials).verdict
        assert (verdict == ("yes" if honest else "no")).mean() > 0.8, verdict


# ------------------------------------------------------------------ certificates
def test_certificates_without_uncertainty_move_nothing(quick: Run) -> None:
    trials = Trials(quick, "calibration")
    certain = replace(
        quick.field,
        u_scale=0.0,
        boards=tuple(replace(b, u_xy_mm=0.0, u_z_mm=0.0) for b in quick.field.boards),
        scale_bars=tuple(replace(b, u_length_mm=0.0) for b in quick.field.scale_bars),
    )
    same, sheet = draw_certificates(trials.observations, trials.calibration, certain, 7)
    assert np.array_equal(same.xy_px, trials.observations.xy_px, equal_nan=True)
    assert sheet == certain
    moved, sheet = draw_certificates(trials.observations, trials.calibration, quick.field, 7)
    on = (moved.board >= 0) & (moved.status == "measured")
    shift = (moved.xy_px - trials.observations.xy_px)[on]
    assert 1e-3 < np.sqrt((shift**2).mean()) < 0.05  # 0.01 mm at 2 m and 1,670 px focal length
    assert sheet.scale_bars[0].length_mm != quick.field.scale_bars[0].length_mm
    measured = trials.observations.measured
    noise = draw_pixels(measured, quick.field, 7).xy_px - measured.xy_px
    assert noise.std() == pytest.approx(np.sqrt(measured.cov_px2[:, 0, 0].mean()), rel=0.1)


# ------------------------------------------------------------------ the command
@pytest.fixture
def copied(quick: Run, tmp_path: Path) -> Path:
    """A copy of the quick run, without its pictures."""
    folder = tmp_path / "quick"
    shutil.copytree(quick.folder, folder, ignore=shutil.ignore_patterns("frames", "radiance", "truth", "*.html"))
    return folder


def test_the_linear_result_of_a_run_is_validated(
    copied: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["uncertainty", str(copied), "--trials", "20000", "--length", "201", "204", "--json"]
    assert main(command) == 0
    statement = json.loads(capsys.readouterr().out)
    check = [q for q in statement["quantities"] if q["check_point"]]
    assert len(check) == 24
    verdicts = [q["validated"] for q in check]
    assert "no" not in verdicts
    assert verdicts.count("yes") > 0.6 * len(check)  # two blocks leave some open
    assert {q["name"] for q in statement["quantities"] if q["kind"] == "length"} >= {"check bar", "201 to 204"}
    assert all(abs(p["k"] - 2.7955) < 0.1 for p in statement["regions"]["points"])

    # Finished blocks are kept: nothing is drawn again.
    monkeypatch.setattr(RayTrials, "draw", None)
    assert main(command[:-1]) == 0
    assert "validated" in capsys.readouterr().out


def test_recalibrated_trials_are_kept_and_are_the_same_again(copied: Path) -> None:
    first = [Trials(resume(copied, 1), "calibration").trial(k) for k in range(2)]
    kept = (copied / "uncertainty/calibration/0000.npy").read_bytes()
    assert np.abs(first[0] - first[1]).max() > 1e-4
    (copied / "uncertainty/calibration/0000.npy").unlink()
    again = Trials(resume(copied, 1), "calibration").trial(0)
    assert np.array_equal(again, first[0])
    assert (copied / "uncertainty/calibration/0000.npy").read_bytes() == kept


@pytest.mark.slow
def test_several_processes_make_the_trials_that_one_makes(copied: Path, capsys: pytest.CaptureFixture) -> None:
    command = ["uncertainty", str(copied), "--depth", "calibration", "--trials", "3", "--json"]
    said, trials = [], copied / "uncertainty"
    for jobs in ("1", "2"):
        assert main([*command, "--jobs", jobs]) == 0
        said.append(capsys.readouterr().out)
        assert len(list(trials.rglob("*.npy"))) == 3 and not list(trials.rglob(".*"))
        shutil.rmtree(trials)
    assert said[0] == said[1]


def test_the_command_speaks_of_what_it_cannot_do(copied: Path, capsys: pytest.CaptureFixture) -> None:
    for more, word in (
        (["--trials", "5"], "too few"),
        (["--length", "201", "999"], "999"),
        (["--depth", "exposure"], "missing"),
    ):
        assert main(["uncertainty", str(copied), *more]) == 2
        assert word in capsys.readouterr().err


def test_a_foreign_method_is_told_to_go_deeper() -> None:
    rows, field, calibration = network()
    with pytest.raises(TestfieldError, match="--depth calibration"):
        RayTrials.of(rows, calibration, field, "opencv")


def test_exposing_again_with_the_runs_own_seed_gives_its_observations(tiny: Run) -> None:
    again = reexposed(tiny, tiny.scene.seed)
    kept = Observations.load(tiny.folder / "observations.parquet")
    assert np.array_equal(again.xy_px, kept.xy_px, equal_nan=True)
    assert np.array_equal(again.code, kept.code)


# ------------------------------------------------------------------ claims against errors
def test_the_bound_of_an_ellipse_is_the_circles_where_it_is_one() -> None:
    moments = np.tile(np.eye(2) * (10 / 4) ** 2, (1, 1, 1))  # a circle of 10 px diameter
    cov = bound_px2(moments, np.array([100.0]), np.hypot(0.7, 1 / np.sqrt(12)))
    assert np.sqrt(cov[0, 0, 0]) == pytest.approx(0.00413, abs=2e-5)  # METHODS section 6.1
    flat = bound_px2(np.diag([1.0, 0.25])[None] * (10 / 4) ** 2, np.array([100.0]), 0.76)
    assert flat[0, 1, 1] < flat[0, 0, 0]  # the long sides tell of y


def test_claims_hold_over_worlds_and_half_claims_do_not(tmp_path: Path) -> None:
    path = SCENES / "quick.toml"
    figures = over_worlds(path.read_text(), path, 6, tmp_path)
    for group in ("camera", "boards", "check_points"):
        low, high = nees_band(6 * figures[group]["degrees_of_freedom"], 0.999)
        assert low < figures[group]["nees"] < high, group
    assert 2 * figures["check_points"]["nees"] > nees_band(6 * 24, 0.999)[1]  # a covariance of half the size is seen
    assert figures["sigma0"] == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("exposures", [1, pytest.param(3, marks=pytest.mark.slow)])
def test_claims_hold_over_new_exposures_of_one_render(quick: Run, exposures: int) -> None:
    figures = over_exposures(quick, exposures)
    for group in ("camera", "boards", "check_points"):
        low, high = nees_band(exposures * figures[group]["degrees_of_freedom"], 0.999)
        assert low < figures[group]["nees"] < high, group


def test_another_workshop_moves_what_was_measured_to_where_its_marks_are(quick: Run) -> None:
    """Truth in, nothing but truth out: pixels of the rendered world become those of the drawn one."""
    from test_truth_in_truth_out import observe

    from testfield.bench.claims import _moved, _true_px

    drawn = build_world(quick.scene, workshop=77)
    observed = observe(quick.world, quick.views, discs=True)
    moved = _moved(observed, quick.world, _true_px(drawn) - _true_px(quick.world))
    wanted = observe(drawn, see(drawn), discs=True)
    assert np.abs(moved.xy_px - observed.xy_px).max() > 1e-4
    assert np.allclose(moved.xy_px, wanted.xy_px, atol=1e-9)


# ------------------------------------------------------------------ one part in a million
SIBLING = SCENES / "one_part_in_a_million_quick.toml"


def obeys_the_law(score: PointScore, diagonal_mm: float) -> float:
    """Root mean square that the covariance of the check points predicts, mm; asserts that their errors are of it."""
    C = aligned_covariance(score.cov_mm2, score.true_mm)
    predicted = np.sqrt(np.trace(C) / len(C))
    rmse = np.sqrt((score.fitted_mm**2).mean())
    # One direction holds two fifths of the variance, so the square is a skew sum of few squares: its 99.9 % interval.
    strengths = np.linalg.eigvalsh(C) / np.trace(C)
    squares = np.random.default_rng(9).standard_normal((100_000, len(C))) ** 2 @ strengths
    least, most = np.quantile(squares, (0.0005, 0.9995))
    assert least < (rmse / predicted) ** 2 < most
    assert diagonal_mm / rmse > 300_000
    low, high = nees_band(score.error_mm.size, 0.999)
    assert low < score.anees < high
    return float(predicted)


def drawn_sibling(run: Run) -> PointScore:
    """What the closed form says before anything is rendered."""
    drawn, camera = draw_observations(run.scene, run.world, run.views, 8), run.scene.camera
    foreseen = find("calibrators", "stitched")(drawn, run.field, camera.width_px, camera.height_px)
    return score_points(run.world, foreseen, find("reconstructors", "bundle")(drawn, foreseen, run.field))


def test_the_small_sibling_obeys_the_law_where_its_pixels_are_drawn(tmp_path: Path) -> None:
    run, _ = begin(SIBLING, tmp_path / "run", None, 2)
    obeys_the_law(drawn_sibling(run), run.world.field_diagonal_mm)


@pytest.mark.slow
def test_the_small_sibling_obeys_the_law_where_it_is_rendered(tmp_path: Path) -> None:
    """What the closed form says before anything is rendered is what comes out of the pictures."""
    from testfield.calibrate.calibration import Calibration
    from testfield.reconstruct.points import Points

    run, _ = begin(SIBLING, tmp_path / "run", None, 2)
    for stage in list(STAGES)[:5]:
        run_stage(run, stage)
    calibration = Calibration.load(run.folder / "calibration.json")
    score = score_points(run.world, calibration, Points.load(run.folder / "points.parquet"))
    predicted = obeys_the_law(score, run.world.field_diagonal_mm)
    expected = drawn_sibling(run)
    foretold = aligned_covariance(expected.cov_mm2, expected.true_mm)
    # Foretold is what the lamps' own light gives: what the room reflects adds contrast, most of all on lone cards.
    assert 0.5 < predicted / np.sqrt(np.trace(foretold) / len(foretold)) < 1.1
