"""Sweeps: which cases they have, that their number is known before anything starts, and what they write."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import IN_FULL, SCENES

from testfield.cli.main import main
from testfield.errors import TestfieldError, faults_in
from testfield.evaluate import execute as executing
from testfield.evaluate.case import scene_table
from testfield.evaluate.sweep import Sweep
from testfield.evaluate.sweep_design import Design, Levels, combinations, count_of
from testfield.scene.load import load_scene

QUICK = IN_FULL.read_text()


def with_vary(folder: Path, vary: str) -> Path:
    path = folder / "quick.toml"
    path.write_text(f"{QUICK}\n{vary}\n")
    return path


def test_a_grid_is_every_value_with_every_other(tmp_path: Path) -> None:
    vary = '[vary.fields]\n"camera.focal_length_mm" = [8, 10]\n"boards.B.bow_mm" = { low = 0, high = 2, levels = 3 }'
    path = with_vary(tmp_path, f"[vary]\ndraws = 2\n{vary}")
    sweep = Sweep.load(path)
    cases = sweep.cases()
    assert sweep.size[0] == len(cases) == 12
    assert {(one.labels["camera.focal_length_mm"], one.labels["boards.B.bow_mm"]) for one in cases} == {
        (f, b) for f in (8, 10) for b in (0.0, 1.0, 2.0)
    }
    last = cases[-1]
    assert last.scene is not None
    assert (last.scene["camera"]["focal_length_mm"], last.scene["boards"][1]["bow_mm"], last.noise_seed) == (10, 2.0, 2)
    assert "vary" not in scene_table(path)
    assert load_scene(path).camera.focal_length_mm == 8.0


def test_one_factor_at_a_time_changes_one_field_only() -> None:
    fields = {"a": Levels((1, 2)), "b": Levels((), 1, 100, 3, log=True)}
    assert combinations(Design.ONE, fields, 0, 1) == [{"a": 1}, {"a": 2}, {"b": 1.0}, {"b": 10.0}, {"b": 100.0}]


@pytest.mark.parametrize("design", [Design.LATIN, Design.SOBOL])
def test_samples_spread_evenly_over_every_field(design: Design) -> None:
    fields = {"a": Levels((), 10, 26), "b": Levels(("x", "y", "z", "w")), "c": Levels((), 1, 4, whole=True)}
    found = combinations(design, fields, 16, 1)
    assert sorted(int(one["a"] - 10) for one in found) == list(range(16))
    assert all([one["b"] for one in found].count(value) == 4 for value in "xyzw")
    assert all(isinstance(one["c"], int) and 1 <= one["c"] <= 4 for one in found)
    assert found == combinations(design, fields, 16, 1)
    assert found != combinations(design, fields, 16, 2)


def test_the_number_of_a_million_cases_is_said_without_making_them() -> None:
    fields = {f"f{k}": Levels((), 0, 1, 100) for k in range(3)}
    assert count_of(Design.GRID, fields, 0)[0] == 1_000_000
    with pytest.raises(TestfieldError, match="1,000,000 cases"):
        combinations(Design.GRID, fields, 0, 1)


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ('"camera.focal_lenght_mm" = [1]', ("vary.fields camera.focal_lenght_mm=1", "did you mean 'focal_length_mm'")),
        ('"boards.D.bow_mm" = [1]', ("no entry 'D'",)),
        ('"camera.focal_length_mm" = { low = 8, high = 5000 }', ("camera.focal_length_mm=5000", "less than 2000")),
        ('"camera.k1" = { low = 2, high = 1 }', ("quick.toml:", "not below")),
        ('"camera.k1" = { low = 0, high = 1, log = true }', ("logarithm",)),
        ('"camera.k1" = []', ("varies nothing",)),
        ('"camera.k1" = { low = 0, high = 1, levels = 20000 }', ("20,000 cases", "10,000 are allowed")),
    ],
)
def test_what_cannot_be_varied_is_refused_by_file_and_field(vary: str, words: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(TestfieldError) as refused:
        Sweep.load(with_vary(tmp_path, f"[vary.fields]\n{vary}"))
    said = " ".join(fault.sentence() for fault in faults_in(refused.value))
    assert all(word in said for word in words), said


def test_draws_of_noise_count_among_the_cases(tmp_path: Path) -> None:
    vary = '[vary]\ndraws = 5001\n[vary.fields]\n"camera.focal_length_mm" = [8, 10]'
    with pytest.raises(TestfieldError, match="10,002 cases"):
        Sweep.load(with_vary(tmp_path, vary))


def test_designs_that_do_not_exist_and_uneven_sobol_samples_are_refused(tmp_path: Path) -> None:
    fields = '[vary.fields]\n"camera.k1" = [0, 1]'
    with pytest.raises(TestfieldError, match="give 16 or 32"):
        Sweep.load(with_vary(tmp_path, f'[vary]\ndesign = "sobol"\nsamples = 20\n{fields}'))
    with pytest.raises(TestfieldError, match=r"vary\.design"):
        Sweep.load(with_vary(tmp_path, f'[vary]\ndesign = "grids"\n{fields}'))
    with pytest.raises(TestfieldError, match="nothing is varied"):
        Sweep.load(SCENES / "quick.toml")


def test_a_file_of_its_own_names_the_scene(tmp_path: Path) -> None:
    path = tmp_path / "sweep.toml"
    path.write_text('scene = "quick"\n[vary.fields]\n"exposure.time_ms" = [4, 8]\n')
    assert [case.labels["exposure.time_ms"] for case in Sweep.load(path).cases()] == [4, 8]
    path.write_text('scene = "quik"\n[vary.fields]\n"exposure.time_ms" = [4, 8]\n')
    with pytest.raises(TestfieldError, match="did you mean 'quick'"):
        Sweep.load(path)


def test_validate_checks_what_is_varied(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = with_vary(tmp_path, '[vary.fields]\n"camera.k3" = [0.0, 0.01]')
    assert main(["validate", str(path)]) == 0
    path.write_text(path.read_text().replace("camera.k3", "camera.k33"))
    assert main(["validate", str(path)]) == 2
    sweep = tmp_path / "sweep.toml"
    sweep.write_text('scene = "quick"\n[vary.fields]\n"exposure.time_ms" = [4, 8]\n')
    capsys.readouterr()
    assert main(["validate", str(sweep)]) == 0
    assert "2 cases" in capsys.readouterr().out


def test_a_sweep_writes_its_table_and_a_page_that_needs_no_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    path = with_vary(tmp_path, '[vary.fields]\n"camera.k1" = [-0.1, 0.0]\n"measure.centroid" = ["star", "dual_conic"]')

    def measured(case: Any, folder: Path) -> list[dict[str, Any]]:
        return [{"points.rmse_mm": 0.01 - case.scene["camera"]["k1"], "lengths.check_error_mm": np.nan}]

    monkeypatch.setattr(executing, "do_case", measured)
    out = tmp_path / "out"
    assert main(["sweep", str(path), "--cases"]) == 0
    assert not out.exists()
    assert "4 cases" in capsys.readouterr().err
    assert main(["sweep", str(path), "--out", str(out), "--jobs", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cases"] == 4
    table = pd.read_csv(out / "sweep.csv")
    assert table["points.rmse_mm"].tolist() == pytest.approx([0.11, 0.11, 0.01, 0.01])
    for suffix, head in (("svg", b"<?xml"), ("pdf", b"%PDF")):
        drawn = list((out / "figures").glob(f"*.{suffix}"))
        assert len(drawn) == 2 and all(path.read_bytes().startswith(head) for path in drawn)  # one over each field
    page = (out / "sweep.html").read_text()
    assert "camera.k1" in page
    assert not re.search(r"<(script|link)[^>]*(src|href)=", page)
