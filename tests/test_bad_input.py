"""Bad input gets a clear sentence that names file, field and value, exit status 2, and no traceback."""

from pathlib import Path

import pytest
from conftest import IN_FULL

from testfield.cli.main import main

SCENES = Path(__file__).parents[1] / "scenes"
QUICK = IN_FULL.read_text()


def complaint(tmp_path: Path, capsys: pytest.CaptureFixture, text: str) -> str:
    scene = tmp_path / "bad.toml"
    scene.write_text(text)
    out = tmp_path / "run"
    assert main(["run", str(scene), "--out", str(out)]) == 2
    said = capsys.readouterr().err.strip()
    assert "bad.toml" in said
    assert "Traceback" not in said
    assert not out.exists()  # nothing is begun before the scene has passed
    return said


CASES = {
    "unknown field": (("width_px = 1280", "widht_px = 1280"), ["camera.widht_px", "unknown field", "width_px"]),
    "wrong unit": (("length_mm = 900.0", "length_m = 0.9"), ["scale_bars[0].length_m", "0.9", "length_mm"]),
    "metres for millimetres": (("length_mm = 900.0", "length_mm = 0.9"), ["scale_bars[0].length_mm", "0.9"]),
    "boards collide": (('name = "B"', 'name = "A"'), ["boards", "'A'"]),
    "code does not exist": (("codes = [101, 102]", "codes = [101, 517]"), ["517", "1 to 516", "control bar"]),
    "code used twice": (("first_code = 11", "first_code = 8"), ["code number 8 is used twice", "A and B"]),
    "camera inside a wall": (
        ("[render]", '[[stations]]\nname = "lost"\nposition_mm = [0, 900, 500]\n\n[render]'),
        ["'wall'", "lost", "(0, 900, 500)"],
    ),
    "station sees nothing": (
        (
            "[render]",
            '[[stations]]\nname = "away"\nposition_mm = [0, -2000, 500]\nlook_at_mm = [0, -4000, 500]\n\n[render]',
        ),
        ["away", "sees no target"],
    ),
    "no light": (("ambient_w_m2_sr = 0.6", "ambient_w_m2_sr = -1"), ["room.ambient_w_m2_sr", "-1"]),
    "missing field": (('role = "control"\n', ""), ["scale_bars[0].role", "required"]),
    "wrong type": (("seed = 7", 'seed = "seven"'), ["seed", '"seven"']),
    "not TOML": (("[camera]", "[camera"), ["TOML"]),
    "mark over the edge": (("size_mm = [500, 360]", "size_mm = [450, 360]"), ["reaches over the edge"]),
    "targets too close": (("pitch_mm = 80", "pitch_mm = 46"), ["too close", "quiet zone"]),
    "unknown board": (('board = "A"', 'board = "Z"'), ["'Z'", "check_targets"]),
    "unknown generator": (('generator = "grid"', 'generator = "spiral"'), ["check_targets[0]", "spiral"]),
    "unknown algorithm": (("[render]", '[measure]\ncentroid = "magic"\n\n[render]'), ["magic", "ellipse_model"]),
    "not a number": (
        ("position_mm = [0, 250, 560]", "position_mm = [nan, 250, 560]"),
        ["boards[0].position_mm", "finite"],
    ),
    "infinite": (("time_ms = 8.0", "time_ms = inf"), ["exposure.time_ms", "finite"]),
    "path with a moving target": (
        ("[render]", '[target_motion]\nvelocity_mm_s = [1, 0, 0]\n\n[render]\nmode = "path"'),
        ["render.mode", "target_motion"],
    ),
    "smeared over the image": (
        ("[render]", "[target_motion]\nvelocity_mm_s = [90000, 0, 0]\n\n[render]"),
        ["exposure.time_ms", "smears"],
    ),
    "rolling shutter without a row's time": (
        ("time_ms = 8.0", 'time_ms = 8.0\nshutter = "rolling"'),
        ["exposure.row_time_us"],
    ),
    "global shutter with a row's time": (
        ("time_ms = 8.0", "time_ms = 8.0\nrow_time_us = 20"),
        ["exposure.row_time_us"],
    ),
    "focused within the lens": (("f_number = 5.6", "f_number = 5.6\nfocus_mm = 7"), ["camera.focus_mm", "7"]),
    "darker than dark": (
        ("f_number = 5.6", "f_number = 5.6\nvignetting = [-1.5, 0, 0]"),
        ["camera.vignetting", "-1.5"],
    ),
    "held coefficient that does not exist": (
        ("[render]", '[measure]\nhold = ["k9"]\n\n[render]'),
        ["measure.hold", "k9"],
    ),
    "calibrating with a board that is not there": (
        ("[render]", '[measure]\ncalibrator = "zhang"\nboard = "Z"\n\n[render]'),
        ["measure.board", "'Z'", "A, B, C"],
    ),
    "one board for a calibrator of all": (
        ("[render]", '[measure]\nboard = "B"\n\n[render]'),
        ["measure.board", "'stitched'", "zhang"],
    ),
    "diffraction finer than cells": (
        ("f_number = 5.6", "f_number = 1.4\ndiffraction = true"),
        ["camera.diffraction", "0.16 px"],
    ),
    "name that leaves the folder": (
        ("[render]", '[[stations]]\nname = "../x"\nposition_mm = [0, -2000, 500]\n\n[render]'),
        ["stations[2].name", "../x"],
    ),
    "scene named by dots": (('name = "quick"', 'name = ".."'), ["name", '".."']),
    "ring without axis": (
        (
            "[render]",
            '[[stations]]\ngenerator = "ring"\ncount = 3\nradius_mm = 100\ncentre_mm = [0, -2000, 600]\n'
            "axis = [0, 0, 0]\n\n[render]",
        ),
        ["stations[2].axis", "length zero"],
    ),
    "box inside out": (("low_mm = [-330, -60, 330]", "low_mm = [430, -60, 330]"), ["check_targets[0]", "low_mm"]),
    "negative size": (("size_mm = [1400, 900]", "size_mm = [-1400, 900]"), ["room.lights[0].size_mm", "-1400"]),
    "no contrast": (("[render]", "[paint]\nwhite = 0.3\nblack = 0.4\n\n[render]"), ["paint.white", "0.3"]),
    "bar named like a board": (('name = "check bar"', 'name = "A"'), ["'A'", "boards[0]"]),
    "far too many": (("columns = 6, rows = 7", "columns = 60000, rows = 7"), ["columns", "60000"]),
    "lens that folds": (("k1 = -0.09", "k1 = -1.5"), ["camera", "k1 = -1.5", "folds"]),
    "coefficient of another lens": (
        ("k1 = -0.09", "k1 = -0.09\nk4 = 0.1"),
        ["camera.k4", "brown", "k1, k2, k3, p1, p2"],
    ),
    "no power": (("radiance_w_m2_sr = 10.0", "radiance_w_m2_sr = 0"), ["room.lights[0].radiance_w_m2_sr", "0"]),
    "lamp that shines away": (
        ("normal = [-0.1, 0.5, -1]\nradiance", "normal = [0.1, -0.5, 1]\nradiance"),
        ["room.lights", "no board receives any light"],
    ),
    "random targets that cannot fit": (
        (
            'generator = "grid"\nfirst_code = 201\ncounts = [3, 1, 2]',
            'generator = "random"\nfirst_code = 201\ncount = 900',
        ),
        ["check_targets[0]", "900", "do not fit"],
    ),
    "random targets in a huge box": (
        (
            'generator = "grid"\nfirst_code = 201\ncounts = [3, 1, 2]\nlow_mm = [-330, -60, 330]',
            'generator = "random"\nfirst_code = 201\ncount = 9\nlow_mm = [-33e7, -60, 330]',
        ),
        ["check_targets[0].high_mm", "3.3e+08"],
    ),
    "zero direction": (("direction = [1, -0.1, 0.05]", "direction = [0, 0, 0]"), ["scale_bars[0].direction"]),
}


@pytest.mark.parametrize("name", CASES)
def test_the_complaint_names_file_field_and_value(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (old, new), words = CASES[name]
    assert old in QUICK
    text = QUICK.replace(old, new)
    if name == "lamp that shines away":
        text = text.replace("ambient_w_m2_sr = 0.6", "ambient_w_m2_sr = 0")
    said = complaint(tmp_path, capsys, text)
    for word in words:
        assert word in said, said


def test_targets_too_small_to_decode_are_a_warning_with_the_pixel_size(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    scene = tmp_path / "small.toml"
    scene.write_text(QUICK.replace("focal_length_mm = 8.0", "focal_length_mm = 4.0"))
    assert main(["validate", str(scene)]) == 0
    said = capsys.readouterr().err
    assert "too small to decode" in said
    assert "px" in said


def test_a_missing_scene_or_run_is_said_so(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["run", str(tmp_path / "none.toml")]) == 2
    assert "no such scene file" in capsys.readouterr().err
    assert main(["detect", str(tmp_path)]) == 2
    assert "no scene.toml here" in capsys.readouterr().err


def test_unusual_files_are_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "binary.toml").write_bytes(bytes(range(256)))
    (tmp_path / "empty.toml").write_bytes(b"")
    (tmp_path / "bom.toml").write_bytes(b"\xef\xbb\xbf" + QUICK.encode())
    for name, words in (("binary.toml", "not a text file"), ("empty.toml", "boards"), (".", "a folder")):
        assert main(["validate", str(tmp_path / name)]) == 2
        assert words in capsys.readouterr().err
    assert main(["validate", str(tmp_path / "bom.toml")]) == 0


def test_jobs_and_seed_have_a_least_value(capsys: pytest.CaptureFixture) -> None:
    for option, value in (("--jobs", "0"), ("--seed", "-1")):
        assert main(["run", str(SCENES / "quick.toml"), option, value]) == 2
        assert option in capsys.readouterr().err


def test_a_board_nobody_sees_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    scene = tmp_path / "away.toml"
    scene.write_text(QUICK.replace("normal = [-0.45, -1, 0.3]", "normal = [0.45, 1, 0.3]"))
    assert main(["validate", str(scene)]) == 0
    said = capsys.readouterr().err
    assert "board 'C' is seen by no station" in said
    assert "faces away" in said
    assert "boards[2].normal" in said


@pytest.mark.parametrize(
    ("time_ms", "words"), [("80.0", ["saturates", "try 9.4 ms"]), ("0.05", ["left in the dark", "times the noise"])]
)
def test_a_wrong_exposure_is_warned_of_with_level_and_advice(
    time_ms: str, words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    scene = tmp_path / "exposed.toml"
    scene.write_text(QUICK.replace("time_ms = 8.0", f"time_ms = {time_ms}"))
    assert main(["validate", str(scene)]) == 0
    said = capsys.readouterr().err
    for word in ["exposure.time_ms", "DN", *words]:
        assert word in said, said


SHIPPED = sorted(path.stem for path in SCENES.glob("*.toml"))


LARGE = ("one_part_in_a_million", "camera_cell")
"""Scenes whose light takes ten seconds each."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in LARGE else []) for name in SHIPPED]
)
def test_the_scenes_that_come_along_are_well_exposed(name: str, capsys: pytest.CaptureFixture) -> None:
    assert main(["validate", str(SCENES / f"{name}.toml")]) == 0
    assert "exposure" not in capsys.readouterr().err


def test_a_full_disk_is_said_so(tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    import errno

    from testfield.targets.field import Field

    def full(self: Field, path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Field, "save", full)
    assert main(["run", str(SCENES / "quick.toml"), "--out", str(tmp_path / "run")]) == 2
    assert "the disk is full" in capsys.readouterr().err
