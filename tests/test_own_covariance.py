"""A covariance is optional: an algorithm that states none is scored, and one that states too little is scored badly."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import SCENES

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.camera_file import read_camera_file
from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.evaluate.compared_columns import _nees
from testfield.measure.pipeline import Measured, measure
from testfield.measure.recipe import Algorithm, Recipe
from testfield.measure.stated import taken_calibration, taken_points
from testfield.reconstruct.gls import gls
from testfield.reconstruct.points import Points
from testfield.registry import _registered, register
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
from testfield.scene.truth import Views, see
from testfield.scene.world import World
from testfield.score.scorecard import load_scorecard, plain, score_measured
from testfield.simulate.observations import draw_observations
from testfield.store.sheets import covariance

NOTHING: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "zeros": np.zeros_like,
    "NaN": lambda covariance: np.full_like(covariance, np.nan),
}


@pytest.fixture(scope="module")
def drawn() -> tuple[World, Views, Observations]:
    scene = load_scene(SCENES / "quick.toml")
    world = build_world(scene)
    views = see(world)
    return world, views, draw_observations(scene, world, views, 5)


@pytest.fixture(scope="module")
def whole(drawn: tuple[World, Views, Observations]) -> Measured:
    """What is measured where everything is stated."""
    return measure(drawn[2], drawn[0].field, Recipe())


def scored(drawn: tuple[World, Views, Observations], seen: Observations, recipe: Recipe) -> tuple[Measured, dict]:
    world, views, _ = drawn
    found = measure(seen, world.field, recipe)
    return found, plain(score_measured(world, views, seen, found.calibration, found.points))


def test_observations_without_a_covariance_calibrate_as_well_and_have_no_nees(drawn: tuple, whole: Measured) -> None:
    world, views, seen = drawn
    stated = plain(score_measured(world, views, seen, whole.calibration, whole.points))
    nothing = np.zeros_like(seen.cov_px2)
    nothing[::2] = np.nan
    found, card = scored(drawn, replace(seen, cov_px2=nothing), Recipe())
    assert card["detection"]["centre_anees"] is None
    assert card["detection"]["centre_rms_px"] == stated["detection"]["centre_rms_px"]
    assert card["points"]["rmse_mm"] < 2 * stated["points"]["rmse_mm"]
    # The calibrator states a covariance from residuals, and that is judged.
    assert 0.2 < card["points"]["anees"] < 5 and 0.8 < found.calibration.sigma0 < 1.25


def test_of_observations_that_state_one_in_part_the_stated_are_judged(drawn: tuple) -> None:
    cov = drawn[2].cov_px2.copy()
    cov[::2] = 0
    _, card = scored(drawn, replace(drawn[2], cov_px2=cov), Recipe())
    assert 0.5 < card["detection"]["centre_anees"] < 2


def test_a_detector_that_is_too_sure_gets_a_bad_score(drawn: tuple) -> None:
    rng = np.random.default_rng(2)
    seen = replace(
        drawn[2],
        xy_px=drawn[2].xy_px + rng.normal(0, 0.17, drawn[2].xy_px.shape),
        cov_px2=np.broadcast_to(0.01**2 * np.eye(2), drawn[2].cov_px2.shape).copy(),
    )
    _, card = scored(drawn, seen, Recipe())
    assert card["detection"]["centre_anees"] == pytest.approx(17**2, rel=0.15)
    assert card["points"]["anees"] > 20


def silent_calibrator(known: Calibration, change: Callable[[Calibration], Calibration]) -> Recipe:
    @register("calibrators", "silent")
    def silent(observations: Observations, field: object, width_px: int, height_px: int, **options: object) -> object:
        return change(known)

    return Recipe(calibrator=Algorithm("silent"))


@pytest.fixture(autouse=True)
def forget() -> object:
    yield
    for kind in ("calibrators", "reconstructors"):
        _registered[kind].pop("silent", None)


SILENT: dict[str, Callable[[Calibration], Calibration]] = {
    "zeros": lambda c: replace(c, covariance=np.zeros_like(c.covariance)),
    "NaN": lambda c: replace(c, covariance=np.full_like(c.covariance, np.nan)),
    "no labels": lambda c: replace(c, covariance=np.zeros((0, 0)), labels=()),
    "interior alone": lambda c: replace(c, covariance=c.covariance[:4, :4], labels=c.labels[:4]),
}


@pytest.mark.parametrize("reconstructor", ["gls", "ml", "bundle", "midpoint", "opencv"])
@pytest.mark.parametrize("name", SILENT)
def test_a_calibrator_without_a_covariance_is_scored(
    name: str, reconstructor: str, drawn: tuple, whole: Measured
) -> None:
    recipe = replace(silent_calibrator(whole.calibration, SILENT[name]), reconstructor=Algorithm(reconstructor))
    found, card = scored(drawn, drawn[2], recipe)
    assert card["points"]["anees"] is None and card["points"]["rmse_mm"] < 0.5
    assert (card["calibration"]["interior_anees"] is None) == (name != "interior alone")
    assert card["calibration"]["corner_error_px"] < 0.1
    assert not found.points.states_u


@pytest.mark.parametrize("name", NOTHING)
def test_points_without_a_covariance_are_scored_kept_and_read(
    name: str, drawn: tuple, whole: Measured, tmp_path: Path
) -> None:
    @register("reconstructors", "silent")
    def silent(observations: Observations, calibration: Calibration, field: object) -> Points:
        found = gls(observations, calibration, field)  # type: ignore[arg-type]
        return replace(found, cov_xyz_mm2=NOTHING[name](found.cov_xyz_mm2))

    recipe = replace(silent_calibrator(whole.calibration, lambda c: c), reconstructor=Algorithm("silent"))
    found, card = scored(drawn, drawn[2], recipe)
    assert card["points"]["anees"] is None and card["points"]["mean_u_mm"] is None
    assert card["points"]["rmse_mm"] < 0.5
    found.points.save(tmp_path / "points.parquet")
    again = Points.load(tmp_path / "points.parquet")
    assert np.array_equal(again.xyz_mm, found.points.xyz_mm) and not again.states_u


def test_files_may_leave_covariances_out(drawn: tuple, whole: Measured, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    world, _, seen = drawn
    seen.save(tmp_path / "o.parquet")
    table = pq.read_table(tmp_path / "o.parquet")
    left = [name for name in table.column_names if not name.startswith(("cov_", "moment_", "chi2"))]
    pq.write_table(table.select(left), tmp_path / "o.parquet")
    again = Observations.load(tmp_path / "o.parquet", world.field)
    assert not again.states_u.any() and np.array_equal(again.xy_px, seen.xy_px)
    whole.calibration.save(tmp_path / "c.json")
    told = json.loads((tmp_path / "c.json").read_text())
    del told["labels"], told["covariance"]
    (tmp_path / "c.json").write_text(json.dumps(told))
    assert Calibration.load(tmp_path / "c.json").labels == ()


def test_observations_are_taken_as_csv_and_a_bad_line_is_named(drawn: tuple, tmp_path: Path) -> None:
    world, _, seen = drawn
    seen.save(tmp_path / "o.parquet")
    table = pd.read_parquet(tmp_path / "o.parquet")
    table.to_csv(tmp_path / "o.csv", index=False)
    again = Observations.load(tmp_path / "o.csv", world.field)
    assert np.allclose(again.xy_px, seen.xy_px) and np.allclose(again.cov_px2, seen.cov_px2)
    table = table.astype({"y_px": object})
    for value, said in (("a few", "line 9, y_px = 'a few'"), ("", "line 9, y_px is empty")):
        table.loc[7, "y_px"] = value
        table.to_csv(tmp_path / "o.csv", index=False)
        with pytest.raises(TestfieldError, match=said):
            Observations.load(tmp_path / "o.csv", world.field)
    table.drop(columns=["code", "point"]).to_csv(tmp_path / "o.csv", index=False)
    with pytest.raises(TestfieldError, match="no columns code, point"):
        Observations.load(tmp_path / "o.csv", world.field)


def test_a_run_goes_on_with_observations_in_csv_that_state_nothing(
    tiny: Run, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    folder = shutil.copytree(tiny.folder, tmp_path / "tiny")
    table = pd.read_parquet(folder / "observations.parquet")
    table = table[table.status == "measured"]
    table = table[["station", "x_px", "y_px", "code", "board", "point", "status"]]
    table.to_csv(folder / "observations.csv", index=False)
    (folder / "observations.parquet").unlink()
    for stage in ("calibrate", "reconstruct", "score", "report"):
        assert main([stage, str(folder)]) == 0, capsys.readouterr().err
    card = load_scorecard(folder / "scorecard.json")
    assert card["detection"]["centre_anees"] is None and card["points"]["anees"] is not None  # from residuals
    assert card["detection"]["found"] == load_scorecard(tiny.folder / "scorecard.json")["detection"]["found"]
    # A calibration of which nothing is stated: all figures but those of claims, and sentences where claims are asked.
    told = json.loads((folder / "calibration.json").read_text())
    (folder / "calibration.json").write_text(json.dumps(told | {"labels": [], "covariance": []}))
    for stage in ("reconstruct", "score", "report"):
        assert main([stage, str(folder)]) == 0, capsys.readouterr().err
    card = load_scorecard(folder / "scorecard.json")
    assert card["points"]["anees"] is None and card["points"]["rmse_mm"] < 1
    assert "nan" not in (folder / "report.html").read_text().lower().split("<body")[1].split("data:")[0]
    for command in (["accept", str(folder), "--a-mm", "1"], ["uncertainty", str(folder)]):
        capsys.readouterr()
        assert main(command) == 2
        assert "no covariance" in capsys.readouterr().err


def test_a_camera_that_states_a_singular_covariance_is_judged_by_its_rank(drawn: tuple, whole: Measured) -> None:
    world, views, seen = drawn
    s, true = 0.25, world.interior
    off = 3 * np.sqrt(s) * np.isin(true.names, ("fx", "fy"))  # both lengths three standard uncertainties too large
    stated = replace(
        whole.calibration,
        interior=replace(true, parameters=true.parameters + off),
        labels=("fx", "fy"),
        covariance=np.full((2, 2), s),
    )
    card = plain(score_measured(world, views, seen, stated, whole.points))
    assert card["calibration"]["interior_anees"] == pytest.approx(9)
    assert card["calibration"]["imaging_anees"] == pytest.approx(9, rel=0.01)


def test_a_point_that_states_a_singular_covariance_is_in_no_figure_of_three_degrees_of_freedom() -> None:
    error = np.array([1.0, 1.0, 2.0])
    assert _nees(error, np.diag([1.0, 1.0, 4.0])) == pytest.approx(3)
    for none in (np.ones((3, 3)), np.full((3, 3), np.nan)):
        assert np.isnan(_nees(error, none))


INDEFINITE = np.array([[1.0, 2.0], [2.0, 1.0]])


def test_a_covariance_with_a_negative_eigenvalue_is_refused_by_file_and_field(
    drawn: tuple[World, Views, Observations], whole: Measured, tmp_path: Path
) -> None:
    known = replace(whole.calibration, labels=("fx", "fy"), covariance=INDEFINITE)
    known.save(tmp_path / "calibration.json")
    (tmp_path / "camera.json").write_text(
        json.dumps(
            {"interior": known.interior.to_json(), "labels": ["fx", "fy"], "covariance": INDEFINITE.tolist()},
        )
    )
    for name, read in (
        ("calibration.json", Calibration.load),
        ("camera.json", lambda path: read_camera_file(path, drawn[0].field)),
    ):
        with pytest.raises(TestfieldError, match=rf"{name}.*covariance is no covariance.*semidefinite"):
            read(tmp_path / name)
    with pytest.raises(TestfieldError, match=r"covariance of 'mine'.*semidefinite"):
        taken_calibration(known, "mine")
    bad = whole.points.cov_xyz_mm2.copy()
    bad[0, 1] = bad[1, 0] = 2 * np.sqrt(bad[0, 0] * bad[1, 1])
    with pytest.raises(TestfieldError, match=r"'mine'.*semidefinite"):
        taken_points(replace(whole.points, cov_xyz_mm2=bad), "mine")


def test_a_covariance_of_rounded_numbers_is_taken(whole: Measured) -> None:
    for stated in (whole.calibration.covariance, whole.points.cov_xyz_mm2, np.full((2, 2), 0.1) * [[1, -1], [-1, 1]]):
        rounded = np.vectorize(lambda value: float(f"{value:.9g}"))(stated)
        assert np.array_equal(covariance(rounded, "covariance", len(rounded)), rounded)
