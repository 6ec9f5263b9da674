"""The one function that does all studies' cases."""

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from testfield.chain.run import Run
from testfield.errors import TestfieldError
from testfield.study.cases import Case
from testfield.study.run_cases import run_cases
from testfield.study.study import Findings, Plot, Study, Table, run_study

DONE: list[Any] = []


def count(case: Case, run: Run | None) -> list[dict[str, Any]]:
    DONE.append(case.labels["n"])
    if case.labels["n"] in case.options.get("killed", ()):
        raise KeyboardInterrupt
    if case.labels["n"] in case.options.get("hopeless", ()):
        raise TestfieldError("nothing was seen", "here", "look")
    return [{"square": case.labels["n"] ** 2, "row": k} for k in range(2)]


def _cases(numbers: range, **options: Any) -> list[Case]:
    return [Case({"n": n}, f"{__name__}:count", options=options) for n in numbers]


def test_what_is_finished_so_far_can_be_read_while_the_rest_is_not(tmp_path: Path) -> None:
    run_cases(_cases(range(2)), tmp_path)
    DONE.clear()
    assert run_cases(_cases(range(4)), tmp_path, so_far=True)["n"].unique().tolist() == [0, 1] and not DONE
    study = Study("squares", "Squares", "They grow.", lambda quick: _cases(range(4)), lambda table: Findings("So.", []))
    run_study(study, tmp_path, False, 1, so_far=True)
    assert "2 of 4 cases are done" in (tmp_path / "report.html").read_text()
    with pytest.raises(TestfieldError, match="no case is finished"):
        run_study(study, tmp_path / "empty", False, 1, so_far=True)


def test_a_study_of_which_all_cases_fail_says_why_the_first_did(tmp_path: Path) -> None:
    def read(table: pd.DataFrame) -> Findings:
        raise AssertionError("there is nothing to read")

    study = Study("squares", "Squares", "They grow.", lambda quick: _cases(range(2), hopeless=[0, 1]), read)
    with pytest.raises(TestfieldError, match=r"all cases failed.*here: nothing was seen; look"):
        run_study(study, tmp_path, False, 1)
    assert not (tmp_path / "findings.json").exists()


def test_a_case_is_done_again_when_an_algorithm_that_is_found_by_name_has_changed(monkeypatch) -> None:
    case = Case({}, "testfield_studies.stitching.experiment:measure_field")
    before, asked = run_cases_module.case_key(case), []
    monkeypatch.setattr(run_cases_module, "code_digest", lambda *modules, **_: asked.extend(modules) or "other")
    assert run_cases_module.case_key(case) != before
    assert {"testfield.detect.centre_forward", "testfield.reconstruct.gls", "testfield.calibrate.dlt"} <= set(asked)


def test_rewording_a_page_throws_no_case_away() -> None:
    used = sources(("testfield_studies.stitching.experiment",), ("testfield.report", "testfield.certify"))
    assert not {"report", "certify"} & {path.parent.name for path in used}
    assert {"render", "detect", "calibrate"} <= {path.parent.name for path in used}


def test_a_damaged_file_of_a_case_is_made_again(tmp_path: Path) -> None:
    cases = _cases(range(2))
    whole = run_cases(cases, tmp_path)
    damaged = run_cases_module._file(tmp_path, run_cases_module.case_key(cases[1]))
    damaged.write_bytes(damaged.read_bytes()[:60])
    DONE.clear()
    pd.testing.assert_frame_equal(run_cases(cases, tmp_path), whole)
    assert DONE == [1]


def singular(case: Case, run: Run | None) -> list[dict[str, Any]]:
    return [{"inverse": float(np.linalg.inv(np.zeros((2, 2)))[0, 0])}]


def test_a_singular_matrix_is_one_cases_failure_and_not_the_studys_end(tmp_path: Path) -> None:
    table = run_cases([*_cases(range(1)), Case({"n": 9}, f"{__name__}:singular")], tmp_path)
    assert table["square"].iloc[0] == 0 and "Singular" in table["failure"].iloc[-1]


def one_second(case: Case, run: Run | None) -> list[dict[str, Any]]:
    sleep(1)
    return [{}]


def in_two_long_groups(folder: Path) -> None:
    """What the interrupted process does: two processes, 30 cases of a second each."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have its background jobs ignore it
    cases = [Case({"n": n}, f"{__name__}:one_second") for n in range(60)]
    keys = [run_cases_module.case_key(case) for case in cases]
    list(run_cases_module._done([list(range(30)), list(range(30, 60))], cases, keys, folder, 2))


def test_an_interrupt_ends_a_study_after_the_cases_at_hand(tmp_path: Path) -> None:
    command = f"from {__name__} import *; in_two_long_groups(Path({str(tmp_path)!r}))"
    there = os.environ | {"PYTHONPATH": str(Path(__file__).parent)}
    study = subprocess.Popen([sys.executable, "-c", command], env=there, stderr=subprocess.DEVNULL)
    end = monotonic() + 60
    while not list(tmp_path.glob("cases/*.parquet")) and monotonic() < end:
        sleep(0.1)
    study.send_signal(signal.SIGINT)
    try:
        study.wait(timeout=30)
    finally:
        study.kill()
    kept = list(tmp_path.glob("cases/*.parquet"))
    assert study.returncode != 0 and 1 <= len(kept) <= 8
    assert all(pd.read_parquet(path) is not None for path in kept)


def test_two_processes_find_what_one_finds(tmp_path: Path) -> None:
    one, two = run_cases(_cases(range(4)), tmp_path / "one"), run_cases(_cases(range(4)), tmp_path / "two", jobs=2)
    pd.testing.assert_frame_equal(one, two)


def wait_for_file(case: Case, run: Run | None) -> list[dict[str, Any]]:
    """Whether the file that the case waits for was there within ten seconds."""
    awaited = case.options.get("awaited")
    end = monotonic() + 10
    while awaited and not Path(awaited).is_file() and monotonic() < end:
        sleep(0.05)
    return [{"in_time": not awaited or Path(awaited).is_file()}]


def test_progress_is_told_case_by_case_while_a_process_still_works_on_the_next(tmp_path: Path) -> None:
    sign = tmp_path / "the first was told"
    options: list[dict[str, Any]] = [{}, {"awaited": str(sign)}, {}]
    cases = [Case({"n": n}, f"{__name__}:wait_for_file", options=o) for n, o in enumerate(options)]
    keys = [run_cases_module.case_key(case) for case in cases]
    told = []
    for k, reason in run_cases_module._done([[0, 1], [2]], cases, keys, tmp_path, 2):
        told.append(k)
        assert reason is None
        if k == 0:
            sign.touch()
    assert sorted(told) == [0, 1, 2]
    assert pd.read_parquet(run_cases_module._file(tmp_path, keys[1]))["in_time"].all()


def test_cases_of_one_scene_share_its_renders(tmp_path: Path) -> None:
    scene = changed(scene_table(Path("scenes/quick.toml")), {"camera.width_px": 320, "camera.height_px": 240})
    scene["stations"] = scene["stations"][:1]
    scene = changed(scene, {"stations.0.count": 2, "sensor.read_noise_e": 7.0, "measure.smallest_diameter_px": 3})
    table = run_cases([Case({"n": n}, f"{__name__}:stations", scene) for n in range(2)], tmp_path)
    assert table["made"].tolist() == [True, False] and set(table["read_noise_e"]) == {7.0}


def test_a_change_that_names_no_place_is_refused() -> None:
    scene = {"boards": [{"name": "A"}], "seed": 3}
    assert changed(scene, {"boards.0.bend": 2, "sensor.gain": 1})["boards"][0] == {"name": "A", "bend": 2}
    assert scene == {"boards": [{"name": "A"}], "seed": 3}
    for path in ("boards.1.bend", "seed.x", "boards.first.bend"):
        with pytest.raises(TestfieldError, match="no such place"):
            changed(scene, {path: 1})


def test_a_study_writes_its_page_its_figures_and_their_data(tmp_path: Path) -> None:
    def read(table: pd.DataFrame) -> Findings:
        data = table[["n", "square"]]
        plot = Plot("squares", "Squares", "As they grow.", data, lambda axes, d: axes.plot(d["n"], d["square"]))
        return Findings(
            "It holds.",
            ["Squares grow."],
            [Table("All", data)],
            [plot],
            {"largest": data["square"].max(), "none": float("nan")},
        )

    study = Study("squares", "Squares", "They grow.", lambda quick: _cases(range(2 if quick else 3)), read)
    run_study(study, tmp_path, True, 1)
    page = (tmp_path / "report.html").read_text()
    assert "It holds." in page and "<svg" in page and "testfield study squares --quick" in page
    assert pd.read_csv(tmp_path / "squares.csv")["square"].tolist() == [0, 0, 1, 1]
    assert json.loads((tmp_path / "findings.json").read_text())["figures"] == {"largest": 1, "none": None}
