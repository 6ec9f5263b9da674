"""The page on algorithms of one's own: each of its examples runs, and the three ways lead into one comparison."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import TINY
from several_cameras import stereo

import testfield
from testfield.camera.images import Frame
from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.detect.observations import Observations
from testfield.evaluate.execute import FAILURE
from testfield.measure.pipeline import detect, measure
from testfield.measure.recipe import Recipe
from testfield.measure.skeletons import SKELETONS
from testfield.score.points import score_points
from testfield.score.several import score_cameras

PAGE = (Path(testfield.__file__).parent / "OWN_ALGORITHMS.md").read_text(encoding="utf-8")
COMPILER = shutil.which("g++") or shutil.which("c++")


def blocks(kind: str) -> list[str]:
    """The page's examples of a kind, in order."""
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, re.S)


pytestmark = pytest.mark.usefixtures("forget_ones_own")


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with every example of the page as a file, compiled where that is asked for."""
    folder = tmp_path_factory.mktemp("own")
    brightest, calibrator, reconstructor = blocks("python")
    python, program, by_program, points_by_program, environment, elsewhere = blocks("toml")
    (folder / "brightest.py").write_text(brightest)
    (folder / "brightest.toml").write_text(python)
    (folder / "dots.cpp").write_text(blocks("cpp")[0])
    (folder / "dots.toml").write_text(program)
    (folder / "corner_dots").write_text(blocks("sh")[0])
    (folder / "corner_dots").chmod(0o755)
    (folder / "corner_dots.toml").write_text(program.replace("dots {", "corner_dots {"))
    (folder / "my_calibrator.py").write_text(calibrator)
    (folder / "my_calibrator.toml").write_text(by_program)
    (folder / "my_reconstructor.py").write_text(reconstructor)
    (folder / "my_reconstructor.toml").write_text(points_by_program)
    (folder / "elsewhere.toml").write_text(elsewhere)
    assert "opencv-python-headless==" in environment
    if COMPILER:
        command = re.search(r"`g\+\+ (-O2 -o dots dots\.cpp)`", PAGE)
        assert command
        subprocess.run([COMPILER, *command[1].split()], cwd=folder, check=True)
    return folder


@pytest.mark.skipif(COMPILER is None, reason="no C++ compiler")
def test_the_three_ways_of_the_page_lead_into_one_comparison(
    work: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(TINY), "--out", str(work / "work"), "--draws", "1", "--jobs", "1"]) == 0
    there = work / "work" / "noise1"
    for image in sorted(there.glob("images/*.8bit.png")):
        # What somebody makes elsewhere: any program, here the one in C++ on the exported image.
        frame = Frame.load(image.with_name(image.name.replace(".8bit", "")))
        from testfield.measure.detector import pgm

        (tmp_path / "one.pgm").write_bytes(pgm(frame))
        subprocess.run([work / "dots", tmp_path / "one.pgm", there / f"{frame.station}.csv"], check=True)
    names = ("brightest", "dots", "corner_dots", "elsewhere", "my_calibrator", "my_reconstructor")
    recipes = [str(work / f"{name}.toml") for name in names]
    words = [str(TINY), "--recipes", *recipes, "--draws", "1", "--out", "compared", "--jobs", "1"]
    command = [sys.executable, "-m", "testfield", "compare", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    rows = pd.read_parquet("compared/results.parquet").set_index("recipe")
    # The brightest pixel is half a pixel off and may be too far off for a calibration, as the noise has it.
    failed = rows[FAILURE].dropna().drop("brightest", errors="ignore") if FAILURE in rows else pd.Series()
    assert failed.empty, failed.tolist()
    rms = rows["detection.centre_rms_px"]
    assert rms["brightest"] > 0.3
    assert rms["dots"] < 0.1 and rms["elsewhere"] == pytest.approx(rms["dots"], rel=1e-9)
    assert rms["corner_dots"] == pytest.approx(rms["dots"], rel=0.01)
    assert rows["points.anees"][["dots", "elsewhere", "corner_dots"]].notna().all()  # from residuals
    assert rows["detection.centre_anees"][["brightest", "dots"]].isna().all()  # none stated
    assert rows["calibration.method"]["my_calibrator"] == "my_calibrator.py"
    assert rows["points.method"]["my_reconstructor"] == "my_reconstructor.py"
    assert rows["points.measured"]["my_reconstructor"] == 2 and rows["points.rmse_mm"]["my_reconstructor"] < 0.2


def test_the_page_s_programs_calibrate_and_reconstruct_several_cameras(work: Path, tmp_path: Path) -> None:
    truth, seen = stereo(5)
    text = (work / "my_calibrator.toml").read_text() + (work / "my_reconstructor.toml").read_text()
    (work / "both.toml").write_text(text)
    found = measure(seen, truth.told, Recipe.load(work / "both.toml"))
    card = score_cameras(truth.cameras, found.calibration)
    assert set(card["cameras"]) == {"left", "right"} and card["corner_error_px"] < 1
    assert found.calibration.reprojection_rms_px < 0.1
    points = score_points(truth.world, found.calibration, found.points)
    assert len(points.code) >= 12 and np.abs(points.fitted_mm).max() < 0.5


def test_an_export_is_what_the_run_has(tiny: Run, tmp_path: Path) -> None:
    from testfield.chain.export import export_run

    export_run(tiny, tmp_path)
    seen = Observations.load(tiny.folder / "observations.parquet", tiny.field)
    told = Observations.load(tmp_path / "observations.csv", tiny.field)
    assert np.array_equal(told.xy_px, seen.xy_px) and told.stations == seen.stations
    views = pd.read_csv(tmp_path / "truth/views.csv")
    assert len(views) == len(pd.read_parquet(tiny.folder / "truth/views.parquet"))
    for name in tiny.stations:
        a, b = (
            Frame.load(folder, name) for folder in (tiny.folder / f"frames/{name}.png", tmp_path / f"images/{name}.png")
        )
        assert np.array_equal(a.pixels_dn, b.pixels_dn) and a.sheet == b.sheet


@pytest.mark.parametrize("kind", SKELETONS)
def test_a_skeleton_runs_as_it_is(kind: str, tiny: Run, tmp_path: Path) -> None:
    assert main(["new", "algorithm", f"own_{kind}", "--kind", kind, "--out", str(tmp_path)]) == 0
    recipe = Recipe.load(tmp_path / f"own_{kind}.toml")
    if kind in ("calibrator", "reconstructor"):
        seen = Observations.load(tiny.folder / "observations.parquet", tiny.field)
        found = measure(seen, tiny.field, recipe)
        assert f"own_{kind}" in (found.calibration.method, found.points.method)
        return
    name = tiny.stations[0]
    frame = Frame.load(tiny.folder / f"frames/{name}.png", name)
    own, found = detect(frame, tiny.field, Recipe()).measured, detect(frame, tiny.field, recipe).measured
    named = (found.board >= 0) | (found.code > 0)
    assert named.sum() > 0.8 * ((own.board >= 0) | (own.code > 0)).sum()


def test_a_skeleton_takes_no_name_that_is_taken_and_writes_over_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    for words, said in (
        (["1st"], "no name"),
        (["star", "--kind", "centroid"], "there already"),
        (["mine"], ""),
        (["mine"], "mine.py"),
    ):
        status = main(["new", "algorithm", *words, "--out", str(tmp_path)])
        assert status == (2 if said else 0) and said in capsys.readouterr().err
