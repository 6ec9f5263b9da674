import json
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.cli.once import Command
from testfield.evaluate.case import Case
from testfield.study.finding import Finding, Quantity, above
from testfield.study.study import Results, Study, Table

SCENES = Path(__file__).parents[1] / "scenes"


def test_help_takes_under_half_a_second_of_the_processors_time() -> None:
    times = []
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "testfield", "--help"], check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    assert 0 < min(times) < 0.5


def test_the_schema_is_the_one_that_lies_beside_the_scenes(capsys: pytest.CaptureFixture) -> None:
    assert main(["schema"]) == 0
    printed = capsys.readouterr().out
    assert printed == (SCENES / "scene.schema.json").read_text(), (
        "renew it: testfield schema > scenes/scene.schema.json"
    )


def test_every_field_of_a_scene_has_a_description() -> None:
    from testfield.scene.load import scene_schema

    schema = scene_schema()
    for name, part in {**schema["$defs"], "SceneFile": schema}.items():
        for field, what in part["properties"].items():
            assert "description" in what or "$ref" in what or field == "generator", f"{name}.{field}"


def test_list_shows_every_algorithm_with_a_sentence(capsys: pytest.CaptureFixture) -> None:
    assert main(["list"]) == 0
    printed = capsys.readouterr().out
    for name in ("centroids", "ellipse_model", "grey_centroid", "calibrators", "stitched", "reconstructors", "gls"):
        assert name in printed


def test_an_algorithm_of_ones_own_is_found_by_name() -> None:
    from testfield.registry import find, names, register

    @register("centroids", "mine")
    def mine() -> None:
        """Mine."""

    assert find("centroids", "mine") is mine
    assert "mine" in names("centroids")


def test_json_prints_one_object(quick: Run, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    folder = shutil.copytree(quick.folder, tmp_path / "run")
    assert main(["run", str(SCENES / "quick.toml"), "--out", str(folder), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scene"] == "quick"


def test_each_stage_alone_says_that_all_is_up_to_date(quick: Run, capsys: pytest.CaptureFixture) -> None:
    for stage in ("render", "expose", "detect", "calibrate", "reconstruct", "score", "report"):
        assert main([stage, str(quick.folder)]) == 0
        assert "up to date" in capsys.readouterr().out


def test_preview_draws_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    picture = tmp_path / "preview.png"
    assert main(["preview", str(SCENES / "quick.toml"), "--out", str(picture)]) == 0
    drawn = cv2.imread(str(picture))
    assert drawn.shape[0] > 300 and drawn.shape[1] > 600
    ink = (drawn.min(axis=2) < 128).mean(axis=0)
    # Lines and labels, in every fifth of the width and nowhere all over it.
    assert all(0.001 < part.mean() < 0.5 for part in np.array_split(ink, 5))


@pytest.mark.parametrize("scene", sorted(SCENES.glob("*.toml")), ids=lambda p: p.stem)
def test_every_scene_that_is_shipped_is_valid(scene: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["validate", str(scene)]) == 0
    assert "valid" in capsys.readouterr().out


def test_codes_lists_counts_a_table_and_sets(capsys: pytest.CaptureFixture) -> None:
    assert main(["codes"]) == 0
    counts = [line.split()[::2] for line in capsys.readouterr().out.splitlines()[:6]]
    assert [row[:2] for row in counts] == [
        ["8", "13"],
        ["10", "42"],
        ["12", "147"],
        ["14", "516"],
        ["16", "1861"],
        ["20", "24793"],
    ]
    assert main(["codes", "--bits", "14"]) == 0
    table = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert table[3][:2] == ["3", "00000010001011"] and table[13][:2] == ["13", "00000010110001"] and len(table) == 517
    # Read the other way round, number 3 (1000 1011) is the one that shows 1101 0001.
    assert table[3][2] == next(row[0] for row in table[1:] if row[1] == "00000011010001")
    assert main(["codes", "--bits", "12", "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["bits"], answer["count"], answer["words"][0]) == (12, 147, "000001000001")
    assert main(["codes", "--bits", "14", "--choose", "6", "--json"]) == 0
    chosen = json.loads(capsys.readouterr().out)
    words = [f"{int(number)}" for number in chosen["numbers"]]
    assert len(set(words)) == 6 and chosen["least_distance"] >= 2
    assert main(["codes", "--bits", "13"]) == 2 and "13" in capsys.readouterr().err
    assert main(["codes", "--bits", "8", "--choose", "500"]) == 2 and "--choose" in capsys.readouterr().err


def _square(case: Case, run: Run | None) -> list[dict]:
    return [{"square": case.labels["n"] ** 2}]


def test_a_study_is_done_and_told_through_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    def read(table: pd.DataFrame) -> Results:
        quantities = {"largest": Quantity(table["square"].max())}
        return Results([Finding("grow", "Do squares grow?", quantities, above("largest", 0.5))], [Table("All", table)])

    conclusion = tmp_path / "conclusion.md"
    conclusion.write_text("<!-- grow: holds -->\nUp to {largest}.\n")
    study = Study(
        name="squares",
        title="Squares",
        claim="They grow.",
        rests_on=("grow",),
        cases=lambda quick: [Case({"n": n}, f"{__name__}:_square") for n in range(2 if quick else 4)],
        read=read,
        conclusion=conclusion,
    )
    monkeypatch.setattr("testfield.study.studies.find_study", {"squares": study}.__getitem__)
    for more, largest in ((["--quick"], 1), ([], 9)):
        assert main(["study", "squares", "--out", str(tmp_path), "--jobs", "1", "--json", *more]) == 0
        found = json.loads(capsys.readouterr().out)
        assert (found["verdict"], found["failed"]) == ("holds", 0)
        assert found["findings"][0]["quantities"]["largest"]["value"] == largest
    assert main(["study", "squares", "--out", str(tmp_path), "--so-far"]) == 0
    said = capsys.readouterr().out
    assert "Do squares grow?" in said and "Up to 9." in said and str(tmp_path / "report.html") in said
    monkeypatch.undo()
    assert main(["study", "no-such", "--out", str(tmp_path)]) == 2
    assert "no-such" in capsys.readouterr().err


def test_bench_prints_what_was_counted(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    from testfield.bench.recall import Recall

    asked: list[tuple] = []
    counted = Recall(3, 900, 800, 796, 795, 1, 2, 5, 0)
    counted.missed["disturbed"] = 4
    counted.clear_by_tilt["0-20"], counted.found_by_tilt["0-20"] = 400, 399

    def bench_recall(*arguments: object) -> dict:
        asked.append(arguments[:2])
        return counted.figures()

    monkeypatch.setattr("testfield.bench.recall.bench_recall", bench_recall)
    assert main(["bench", "recall", "--quick"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert asked == [(1000, 5)]
    figures = [line.rsplit(" (asked", 1)[0].rsplit(" ", 1)[1] for line in lines[:4]]
    assert figures == ["99.5", "99.87", "1", "0"]
    assert [line.split()[0] for line in lines[:4]] == ["met", "missed", "missed", "met"]
    assert any(line.endswith(": 2") for line in lines) and any("399 found of 400" in line for line in lines)
    assert any(line.split()[2:] == ["4", "disturbed"] for line in lines)
    assert main(["bench", "recall", "--targets", "7", "--empty", "2", "--json"]) == 0
    assert asked[-1] == (7, 2) and json.loads(capsys.readouterr().out)["found_percent"] == 99.5
    assert main(["bench", "claims", "--trials", "1"]) == 2
    assert "--trials" in capsys.readouterr().err


def test_claims_are_printed_as_they_are_summed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture, tmp_path: Path
) -> None:
    group = {"nees": 1.25, "nees_band_95": [0.9, 1.1], "coverage_95": 0.935, "regions": 400}
    figures = {
        "camera": group,
        "boards": group | {"nees": 0.5},
        "check_points": group,
        "rmse_mm": 0.012,
        "mean_u_mm": 0.01,
        "rmse_over_u": 1.2,
        "sigma0": 1.0125,
    }
    monkeypatch.setattr("testfield.bench.claims.over_worlds", lambda *_: figures)
    assert main(["bench", "claims", "--scene", str(SCENES / "quick.toml"), "--out", str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    for line, shown in zip(
        lines, ("1.250 (band 0.900 to 1.100)", "0.500 (band", "93.5 % of 400", "= 1.200"), strict=True
    ):
        assert shown in line
    assert "0.01200 mm over claimed u 0.01000 mm" in lines[3] and "1.0125" in lines[3]


def test_pages_are_utf_8_in_a_locale_that_is_not(tiny: Run, tmp_path: Path) -> None:
    folder = shutil.copytree(tiny.folder, tmp_path / "tiny")
    (folder / "report.html").unlink()
    around = {**os.environ, "LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-m", "testfield", "report", str(folder)]
    done = subprocess.run(command, env=around, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not (folder / "report.html").read_bytes().decode("utf-8").isascii()


@pytest.mark.parametrize(
    "words",
    [
        ["measure", "x", "--hold", "k3", "--hold", "p1"],
        ["run", "quick", "--out", "k3", "--out", "p1"],
        ["bench", "plan", "--scenes", "k3", "--scenes", "p1"],
    ],
)
def test_an_option_given_twice_is_refused_with_both_its_values(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    said = capsys.readouterr().err
    assert words[-2] in said
    assert "k3" in said
    assert "p1" in said


def test_an_option_given_its_default_and_then_another_value_is_refused_and_every_command_begins_anew() -> None:
    parser = Command(prog="one")
    parser.add_argument("--jobs", type=int, default=1)
    assert [parser.parse_args(["--jobs", word]).jobs for word in ("1", "2")] == [1, 2]
    with pytest.raises(SystemExit):
        parser.parse_args(["--jobs", "1", "--jobs", "2"])
