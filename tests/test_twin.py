"""The twin of a measured job: rendered and measured as the job was, it scatters as the job did."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from testfield.author.twin_compare import Measured, fitted, residuals_of
from testfield.camera.photograph import read_photograph
from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.measure.job_file import job_of, load_job, save_job
from testfield.measure.seen import seen_in
from testfield.render.views import _finish
from testfield.scene.exposure import sensor_of
from testfield.scene.load import load_scene

FIELD = """name = "tiny"
[target]
kind = "ring14"
[[distances]]
name = "bar"
codes = [101, 102]
length_mm = 500.0
u_mm = 0.006
"""


@pytest.fixture(scope="module")
def job(tiny: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The frames of `tiny` measured as photographs."""
    folder = tmp_path_factory.mktemp("job")
    shutil.copytree(tiny.folder / "frames", folder / "photographs")
    (folder / "field.toml").write_text(FIELD)
    field = ["--field", str(folder / "field.toml"), "--hold", "k3"]
    assert main(["measure", str(folder / "photographs"), *field, "--out", str(folder / "measured")]) == 0
    return folder / "measured"


@pytest.fixture(scope="module")
def twin(job: Path) -> dict:
    """What the twin's comparison says, as JSON."""
    import contextlib
    import io

    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(["twin", str(job), "--measure", "--json", "--jobs", "1"]) == 0
    return dict(json.loads(out.getvalue()))


def test_photographs_show_the_light_the_blur_and_the_noise_of_the_scene(job: Path, tiny: Run) -> None:
    measured = Measured.load(job)
    photographs = [read_photograph(path) for path in sorted((job.parent / "photographs").glob("*.png"))]
    seen = seen_in(photographs, measured.observations)
    sensor = sensor_of(tiny.scene)
    assert seen.white_on_black == tiny.scene.paint.white_on_black
    assert seen.bits == sensor.bits
    assert seen.blur_px == pytest.approx(tiny.scene.camera.psf_sigma_px, abs=0.08)
    # The noise of white: the mean DN's variance by the sheet, and by what the image shows.
    white = max(seen.ink_dn, seen.ground_dn)
    true = float(np.sqrt(sensor.sheet.variance_dn2(np.array(white))))
    found = float(np.sqrt((seen.read_noise_e / seen.gain_e_per_dn) ** 2 + white / seen.gain_e_per_dn + 1 / 12))
    assert found == pytest.approx(true, rel=0.25)


def test_the_twin_of_a_rendered_scene_scatters_as_the_scene_did(twin: dict) -> None:
    rows = {row["title"]: row for row in twin["rows"]}
    implied = rows["standard deviation that residuals imply"]["ratio"]
    assert 1 / 1.5 < implied < 1.5
    assert not any("differs from image to image" in reason for reason in twin["reasons"])
    assert 0 < float(rows["actual error of a coordinate, rms, fitted"]["twin"].split()[0]) < 0.5


def test_the_twin_has_the_measured_camera_and_stations(job: Path, twin: dict) -> None:
    measured, scene = Measured.load(job), load_scene(Path(twin["scene"]))
    inner = measured.calibration.interior
    assert 1000 * scene.camera.focal_length_mm / scene.camera.pixel_pitch_um == pytest.approx(inner.fx)
    again = Measured.load(job / "twin" / "measured")
    assert set(again.calibration.station_names) == set(measured.calibration.station_names)
    u = np.sqrt(again.calibration.covariance[0, 0])
    assert abs(again.calibration.interior.fx - inner.fx) < 5 * u
    codes = set(measured.points.code[measured.points.code > 0].tolist())
    assert set(again.points.code[again.points.code > 0].tolist()) == codes


def test_a_twin_that_was_changed_is_compared_as_it_stands(job: Path, twin: dict, tmp_path: Path) -> None:
    scene = Path(twin["scene"]).read_text()
    start = scene.index("read_noise_e = ")
    line = scene[start : scene.index("\n", start)]
    noisy = tmp_path / "noisy.toml"
    noisy.write_text(scene.replace(line, f"read_noise_e = {8 * float(line.split()[-1]) + 100}"))
    assert main(["twin", str(job), "--scene", str(noisy), "--out", str(tmp_path / "out"), "--jobs", "1"]) == 0
    before, after = (Measured.load(f) for f in (job / "twin" / "measured", tmp_path / "out" / "measured"))
    rms = [float(np.sqrt((residuals_of(one)[1] ** 2).mean())) for one in (before, after)]
    assert rms[1] > 1.5 * rms[0]


def test_a_job_is_kept_as_it_was_asked(tmp_path: Path) -> None:
    job = job_of(
        {"images": [tmp_path / "a"], "field": tmp_path / "f.toml", "hold": "k3", "focal_px": None, "dense": False}
    )
    save_job(job, tmp_path)
    assert load_job(tmp_path / "job.json") == job
    assert job.option("--hold") == "k3"
    assert job.option("--lens") is None
    assert "--no-dense" in job.options


def test_a_folder_without_a_job_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["twin", str(tmp_path)]) == 2
    assert "job.json" in capsys.readouterr().err


def test_points_are_fitted_by_seven_parameters() -> None:
    rng = np.random.default_rng(0)
    target = rng.normal(size=(9, 3)) * 100
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert fitted(2.5 * target @ turn.T + [1, 2, 3], target) == pytest.approx(target, abs=1e-9)
    mirrored = fitted(target * [1, 1, -1], target)
    assert np.abs(mirrored - target).max() > 1


def test_what_rounding_leaves_below_black_is_black() -> None:
    values = np.array([[1.0, -1e-12]], np.float32)
    kept = _finish(lambda radiance: radiance.values, "a", values, [])
    assert kept.min() == 0


def test_a_job_is_asked_again_with_all_that_was_turned_off() -> None:
    asked = {"images": [], "dense": False, "shade": False, "unclear": "none"}
    assert set(job_of(asked).options) == {"--no-dense", "--no-shade", "--unclear", "none"}
    assert not job_of({"images": [], "dense": True, "shade": True}).options
