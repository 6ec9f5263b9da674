"""The chain on small scenes: what it makes, what it keeps, and what it makes again."""

import json
import math
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import IN_FULL

from testfield.chain.belongs import check_truth
from testfield.chain.run import Run, begin, resume
from testfield.chain.stages import STAGES, run_stage
from testfield.errors import TestfieldError
from testfield.score.scorecard import figure
from testfield.statistics.consistency import nees_band

QUICK = Path(__file__).parents[1] / "scenes/quick.toml"
TINY = Path(__file__).parent / "torture/tiny.toml"
KEYS = (
    "detection.expected",
    "detection.found",
    "detection.missed",
    "detection.false",
    "detection.wrong_code",
    "detection.centre_rms_px",
    "detection.centre_bias_px",
    "calibration.reprojection_rms_px",
    "calibration.corner_error_px",
    "points.rmse_mm",
    "points.relative_accuracy",
    "points.anees",
    "lengths.check_error_mm",
    "boards.pose_rms_mm",
    "time_s.render",
    "time_s.detect",
)


NOTHING_WRONG = {"detection.missed", "detection.false", "detection.wrong_code"}


def card_of(run: Run) -> dict:
    return json.loads((run.folder / "scorecard.json").read_text())


@pytest.fixture
def copy(tiny: Run, tmp_path: Path) -> Run:
    """A copy of a finished run that a test may damage."""
    shutil.copytree(tiny.folder, tmp_path / "tiny")
    return resume(tmp_path / "tiny", 1)


def made_again(run: Run) -> list[str]:
    return [name for name in STAGES if run_stage(run, name)]


def test_the_scorecard_has_its_stable_keys(quick: Run) -> None:
    card = card_of(quick)
    for key in KEYS:
        value = figure(card, key)
        assert isinstance(value, (int, float)) and math.isfinite(value), key
        assert value > 0 or key in NOTHING_WRONG or key == "lengths.check_error_mm", key
    detection, points = card["detection"], card["points"]
    assert detection["expected"] == detection["found"] + detection["missed"]
    assert detection["missed"] == sum(detection["missed_reasons"].values())
    bias = math.hypot(detection["centre_bias_x_px"], detection["centre_bias_y_px"])
    assert detection["centre_bias_px"] == pytest.approx(bias) and bias < detection["centre_rms_px"]
    assert points["relative_accuracy"] == pytest.approx(math.hypot(1800, 1200, 800) / points["rmse_mm"])


def test_the_quick_scene_is_measured_as_well_as_its_images_allow(quick: Run) -> None:
    card = card_of(quick)
    # Nothing covers, dirties or blurs these targets: every one that is expected is found, and what is not is named.
    assert card["detection"]["missed_reasons"] == {} and card["detection"]["found_fraction"] == 1
    assert card["detection"]["wrong_code"] == card["detection"]["wrong_dot"] == card["detection"]["false"] == 0
    assert card["detection"]["centre_rms_px"] < 0.008
    assert 0.9 < card["detection"]["centre_anees"] < 1.15
    assert 0.95 < card["calibration"]["sigma0"] < 1.1
    assert card["points"]["relative_accuracy"] > 50_000
    low, high = nees_band(3 * card["points"]["measured"], 0.99)
    assert low < card["points"]["anees"] < high
    assert abs(card["lengths"]["check_error_mm"]) < 0.03


def test_a_run_holds_what_its_description_says(quick: Run) -> None:
    measured = ("observations.parquet", "calibration.json", "points.parquet", "scorecard.json", "report.html")
    truth = ("truth/marks.parquet", "truth/views.parquet", "truth/camera.json")
    for name in ("scene.toml", "run.json", "field.json", *measured, *truth):
        assert (quick.folder / name).stat().st_size > 0, name
    for station in quick.stations:
        assert (quick.folder / f"radiance/{station}.exr").is_file()
        assert (quick.folder / f"frames/{station}.png").is_file()
    assert not list(quick.folder.rglob(".*part*"))


def test_a_second_run_makes_nothing_and_leaves_the_same_bytes(copy: Run) -> None:
    before = {path: path.read_bytes() for path in copy.folder.rglob("*") if path.is_file() and path.name != "run.json"}
    again, _ = begin(copy.folder / "scene.toml", copy.folder, None, 1)
    assert made_again(again) == []
    assert {path: path.read_bytes() for path in before} == before


def test_other_noise_renders_nothing_again(copy: Run) -> None:
    text = (copy.folder / "scene.toml").read_text()
    (copy.folder / "scene.toml").write_text(text.replace("[exposure]", "[sensor]\nread_noise_e = 5\n\n[exposure]"))
    run = resume(copy.folder, 1)
    made = made_again(run)
    assert "render" not in made
    assert made[:2] == ["expose", "detect"]


@pytest.mark.parametrize("damage", ["empty", "truncated", "gone"])
def test_damaged_images_are_made_again_and_nothing_else(copy: Run, damage: str) -> None:
    stations = copy.stations
    before = card_of(copy)
    for name in (f"radiance/{stations[1]}.exr", f"frames/{stations[2]}.png"):
        path = copy.folder / name
        content = path.read_bytes()
        if damage == "gone":
            path.unlink()
        else:
            path.write_bytes(b"" if damage == "empty" else content[: len(content) // 2])
    untouched = (copy.folder / f"radiance/{stations[0]}.exr").stat().st_mtime_ns
    assert made_again(copy)[:2] == ["render", "expose"]
    assert (copy.folder / f"radiance/{stations[0]}.exr").stat().st_mtime_ns == untouched
    after = card_of(copy)
    assert {k: v for k, v in after.items() if k != "time_s"} == {k: v for k, v in before.items() if k != "time_s"}


def test_a_damaged_ledger_only_costs_time(copy: Run) -> None:
    before = (copy.folder / "observations.parquet").read_bytes()
    (copy.folder / "run.json").write_text('{"notes": {')
    run = resume(copy.folder, 2)
    run_stage(run, "expose")
    run_stage(run, "detect")
    assert (copy.folder / "observations.parquet").read_bytes() == before


def _entered(folder: Path) -> list[str]:
    """Radiance images that the ledger of a run in progress knows to be whole."""
    try:
        files = json.loads((folder / "run.json").read_text())["files"]
    except FileNotFoundError:
        return []
    return [name for name in files if name.endswith(".exr")]


def test_a_killed_run_continues_to_the_same_result(tiny: Run, tmp_path: Path) -> None:
    folder = tmp_path / "killed"
    command = [sys.executable, "-m", "testfield", "run", str(TINY), "--out", str(folder), "--jobs", "2"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not _entered(folder):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = {folder / name: (folder / name).stat().st_mtime_ns for name in _entered(folder)}
    assert 1 <= len(done) < len(tiny.stations)
    run, _ = begin(TINY, folder, None, 1)
    for name in STAGES:
        run_stage(run, name)
    for path, when in done.items():
        assert path.stat().st_mtime_ns == when
    for name in ("observations.parquet", "calibration.json", "points.parquet"):
        assert (folder / name).read_bytes() == (tiny.folder / name).read_bytes(), name
    for station in tiny.stations:
        name = f"frames/{station}.png"
        assert (folder / name).read_bytes() == (tiny.folder / name).read_bytes()


def test_a_peers_observations_enter_at_calibrate(copy: Run) -> None:
    from testfield.detect.observations import Observations

    path = copy.folder / "observations.parquet"
    observations = Observations.load(path)
    observations.take(observations.station < 3).save(path)
    assert run_stage(copy, "calibrate")
    assert (
        json.loads((copy.folder / "calibration.json").read_text())["used"]
        < card_of(copy)["calibration"]["observations"]
    )


def test_a_result_of_older_inputs_is_said_to_be_one(copy: Run, capsys: pytest.CaptureFixture) -> None:
    from testfield.cli.main import main
    from testfield.detect.observations import Observations

    path = copy.folder / "observations.parquet"
    Observations.load(path).take(Observations.load(path).station < 3).save(path)
    assert main(["score", str(copy.folder)]) == 0
    assert "calibration.json was made from another observations.parquet" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "stage"),
    [
        ("radiance/station02.exr", "expose"),
        ("frames/station02.png", "detect"),
        ("frames/station02.json", "detect"),
        ("observations.parquet", "calibrate"),
        ("calibration.json", "reconstruct"),
        ("points.parquet", "score"),
        ("field.json", "detect"),
    ],
)
def test_a_stage_alone_names_the_damaged_file(copy: Run, name: str, stage: str, capsys: pytest.CaptureFixture) -> None:
    from testfield.cli.main import main

    path = copy.folder / name
    path.write_bytes(path.read_bytes()[:40])
    alone = ["--jobs", "1"] if path.suffix == ".json" and stage == "detect" else []  # others' words come from a worker
    assert main([stage, str(copy.folder), *alone]) == 2
    assert path.name in capsys.readouterr().err


def test_a_frame_of_another_size_is_refused(copy: Run, capsys: pytest.CaptureFixture) -> None:
    import cv2
    import numpy as np

    from testfield.cli.main import main

    cv2.imwrite(str(copy.folder / "frames/station03.png"), np.zeros((256, 320), np.uint16))
    assert main(["detect", str(copy.folder), "--jobs", "1"]) == 2
    said = capsys.readouterr().err
    assert "320 x 256" in said
    assert "640 x 512" in said


def test_frames_of_ones_own_are_used_and_never_touched(copy: Run, capsys: pytest.CaptureFixture) -> None:
    import cv2

    from testfield.cli.main import main

    folder = copy.folder / "frames"
    pixels = cv2.imread(str(folder / "station01.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(folder / "station01.png"), pixels + 1)
    sheet = json.loads((folder / "station02.json").read_text())
    (folder / "station02.json").write_text(json.dumps(sheet | {"read_noise_e": 3.0}))
    mine = {path: path.read_bytes() for path in folder.iterdir()}
    for command in (["run", str(copy.folder / "scene.toml"), "--out", str(copy.folder)], ["expose", str(copy.folder)]):
        assert main(command) == 2
        assert "station01.png" in capsys.readouterr().err
    assert main(["detect", str(copy.folder), "--jobs", "1"]) == 0
    said = capsys.readouterr()
    assert "done" in said.out and "station01.png" in said.err and "station02.json" in said.err
    assert {path: path.read_bytes() for path in folder.iterdir()} == mine


def test_a_result_that_somebody_changed_is_refused_and_not_touched(copy: Run) -> None:
    path = copy.folder / "calibration.json"
    mine = path.read_text().replace('"notes": []', '"notes": ["mine"]') + "\n"
    path.write_text(mine)
    with pytest.raises(TestfieldError, match=r"calibration\.json"):
        run_stage(copy, "calibrate")
    assert path.read_text() == mine
    path.unlink()
    assert run_stage(copy, "calibrate")


def test_a_scene_edited_in_the_runs_folder_is_not_written_over(copy: Run) -> None:
    path = copy.folder / "scene.toml"
    mine = path.read_text() + "# mine\n"
    path.write_text(mine)
    with pytest.raises(TestfieldError, match=r"scene\.toml"):
        begin(TINY, copy.folder, None, 1)
    assert path.read_text() == mine
    begin(path, copy.folder, None, 1)
    assert path.read_text() == mine


def test_a_frame_that_is_a_link_out_of_the_folder_is_refused(copy: Run, tmp_path: Path) -> None:
    path = copy.folder / "frames/station01.png"
    path.rename(tmp_path / "elsewhere.png")
    path.symlink_to(tmp_path / "elsewhere.png")
    with pytest.raises(TestfieldError, match=r"station01\.png"):
        run_stage(copy, "detect")


@pytest.mark.parametrize("stage", ["score", "report", "accept", "uncertainty"])
def test_a_truth_that_was_never_rendered_is_refused(copy: Run, stage: str, capsys: pytest.CaptureFixture) -> None:
    from testfield.cli.main import main

    path = copy.folder / "scene.toml"
    path.write_text(path.read_text().replace("k1 = -0.05", "k1 = -0.04"))
    assert main([stage, str(copy.folder)]) == 2
    assert "scene.toml" in capsys.readouterr().err


def test_a_radiance_rendered_anew_leaves_the_old_frames_truth_behind(copy: Run) -> None:
    path = copy.folder / "scene.toml"
    path.write_text(path.read_text().replace("k1 = -0.05", "k1 = -0.04"))
    run = resume(copy.folder, 1)
    run.ledger.files = {name: entry for name, entry in run.ledger.files.items() if not name.endswith(".exr")}
    with pytest.raises(TestfieldError, match=r"frames/station01\.png"):
        check_truth(run)


def test_what_changes_nothing_of_the_truth_may_be_edited(copy: Run) -> None:
    path = copy.folder / "scene.toml"
    path.write_text(path.read_text().replace("[exposure]", '[measure]\ncentroid = "grey_centroid"\n\n[exposure]'))
    check_truth(resume(copy.folder, 1))


def test_a_scene_without_checks_or_bars_still_gives_a_report(tmp_path: Path) -> None:
    text = TINY.read_text()
    start, end = text.index("[[scale_bars]]"), text.index("[[stations]]")
    scene = tmp_path / "bare.toml"
    scene.write_text((text[:start] + text[end:]).replace("width_px = 640", "width_px = 641"))
    run, _ = begin(scene, tmp_path / "bare", None, 1)
    for name in STAGES:
        run_stage(run, name)
    assert "No check target was measured" in (run.folder / "report.html").read_text()
    assert any("no control bar" in note for note in run.measuring_notes())


def test_every_file_a_stage_computes_with_is_in_its_key() -> None:
    from testfield.store.code import ROOT, sources

    for module, files in {
        "testfield.render.fast": ("render/pattern.py", "scene/world.py", "camera/interior.py"),
        "testfield.calibrate.stitched": ("adjust/bundle.py", "detect/observations.py", "camera/circle.py"),
        "testfield.sensor.expose": ("seeds.py", "camera/images.py"),
        "testfield.report.page": ("report/page.html", "score/points.py", "reconstruct/points.py"),
    }.items():
        found = sources((module,))
        for name in files:
            assert ROOT / name in found, (module, name)


def test_another_seed_changes_the_noise_and_what_was_drawn(tmp_path: Path) -> None:
    from testfield.chain.run import with_seed
    from testfield.scene.build import build_world
    from testfield.scene.load import parse_scene

    text = IN_FULL.read_text()
    a, b = (build_world(parse_scene(with_seed(text, seed), "x")) for seed in (7, 8))
    assert build_world(parse_scene(text, "x")).seed == 7
    assert not (a.marks.xy_mm == b.marks.xy_mm).all()
    assert (a.marks.xy_mm == build_world(parse_scene(text, "x")).marks.xy_mm).all()


def test_the_report_stands_alone(quick: Run) -> None:
    page = (quick.folder / "report.html").read_text()
    assert page.count("<img") == page.count('src="data:image/')
    assert "http" not in page.replace("http-equiv", "").split("<main>")[0]
    for title in ("Detection", "Calibration", "Lengths", "Check points", "Provenance"):
        assert f"<h2>{title}" in page
