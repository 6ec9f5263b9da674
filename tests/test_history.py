"""A history of checks: what is kept, what a page shows, and what a database gets that cannot be used."""

import sqlite3
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.evaluate.regress import history
from testfield.evaluate.regress.changes import change_points
from testfield.evaluate.regress.check import Checked
from testfield.evaluate.regress.history import append, kept
from testfield.evaluate.regress.history_page import _change, write_history
from testfield.evaluate.regress.suite import Figure, Suite, SuiteScene
from testfield.evaluate.regress.verdict import judged

SUITE = Suite("own", Path("own.toml"), (SuiteScene(Path("a.toml"), "a"),), (Figure("rms", 0.1),), draws=4)


def made(commit: str) -> dict[str, Any]:
    return {
        "made": "2026-01-01T00:00:00+00:00",
        "commit": commit,
        "processor": "p",
        "target": "",
        "versions": {"n": "1"},
    }


def found(level: float) -> Checked:
    base = np.linspace(1, 1.1, 8)
    rows = pd.DataFrame([{"scene": "a", "recipe": "r", "cpu_detect_s": 2.0, "memory_mb": 5.0}])
    return Checked([judged("a", "r", Figure("rms", 0.1), base, level * base, 0.01)], rows, (8,))


def filled(path: Path) -> Path:
    for k in range(12):
        append(path, SUITE, found(1.0 if k < 7 else 1.5), made(f"{k:040x}"))
    return path


def test_every_check_is_kept_with_commit_verdict_time_and_memory(tmp_path: Path) -> None:
    rows = kept(filled(tmp_path / "h.sqlite"), "own")
    assert rows.number.nunique() == 12
    assert set(rows.figure) == {"rms", "cpu_detect_s", "memory_mb"}
    assert rows[rows.figure == "rms"].verdict.tolist() == ["pass"] * 7 + ["worse"] * 5
    assert rows.commit_id.iloc[-1] == f"{11:040x}"
    assert rows[rows.figure == "rms"].value.iloc[0] == pytest.approx(np.linspace(1, 1.1, 8)[:4].mean())


def test_the_page_says_at_which_commit_another_level_begins(tmp_path: Path) -> None:
    path = write_history(filled(tmp_path / "h.sqlite"), tmp_path / "h.html")
    text = path.read_text()
    assert "rms – 1 change" in text and f"{7:040x}"[:10] in text


def test_the_page_has_the_means_of_whole_levels(tmp_path: Path) -> None:
    levels = pd.DataFrame({"value": [1.0] * 3 + [2.0] * 2 + [4.0] * 9, "verdict": "", "made": "", "commit_id": ""})
    row = _change(("a", "r", "rms"), levels, 3, 5, 14)
    assert (row["before"], row["after"], row["change_%"]) == (2.0, 4.0, 100.0)


def test_a_history_that_two_checks_begin_at_once_is_begun_once(tmp_path: Path) -> None:
    path = tmp_path / "h.sqlite"
    first = sqlite3.connect(path, isolation_level=None)
    first.execute("BEGIN IMMEDIATE")
    second = threading.Thread(target=append, args=(path, SUITE, found(1.0), made("b")))
    second.start()
    second.join(0.3)  # it has seen an empty file, and waits
    for statement in history.SCHEMA.split(";")[:-1]:
        first.execute(statement)
    first.execute("COMMIT")
    second.join()
    first.close()
    assert kept(path, "own").commit_id.unique().tolist() == ["b"]


def test_change_points_are_found_where_they_are_and_nowhere_else() -> None:
    noise = np.random.default_rng(2).standard_normal(60)
    level = np.where(np.arange(60) < 23, 0.0, 2.5)
    assert change_points(noise) == []
    assert change_points(np.ones(30)) == []
    found = change_points(noise + level)
    assert len(found) == 1 and abs(found[0] - 23) <= 1
    assert change_points(np.r_[np.full(9, 0.003), np.full(9, 0.0031)]) == [9]
    assert change_points(np.r_[np.full(5, 1.0), np.nan, np.full(5, 2.0)]) == [6]


def test_false_change_points_are_rare() -> None:
    rng = np.random.default_rng(8)
    assert np.mean([bool(change_points(rng.standard_normal(40))) for _ in range(200)]) < 0.2


def test_what_cannot_be_used_is_said_in_one_sentence_and_is_left_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(history, "WAIT_S", 0.1)
    path = filled(tmp_path / "h.sqlite")

    def refused(word: str) -> None:
        with pytest.raises(TestfieldError) as error:
            append(path, SUITE, found(1.0), made("x"))
        assert str(path) in error.value.where and word in error.value.what

    with sqlite3.connect(path) as other:
        other.execute("BEGIN EXCLUSIVE")
        refused("another process")
        other.rollback()
    for version, word in ((0, "older"), (2, "newer")):
        with sqlite3.connect(path) as other:
            other.execute(f"PRAGMA user_version = {version}")
        refused(word)
    with sqlite3.connect(path) as other:
        other.execute("PRAGMA user_version = 1")
    assert kept(path, "own").number.nunique() == 12
    assert main(["regress", "history", "--history", str(tmp_path / "none.sqlite")]) == 2
    path.write_text("no database at all, but long enough to be taken for one by its size" * 30)
    refused("no SQLite database")
    assert main(["regress", "history", "--history", str(path)]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 2


def test_a_full_disk_is_said_and_nothing_of_the_check_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = filled(tmp_path / "h.sqlite")
    connect = sqlite3.connect

    def small(*args: Any, **options: Any) -> sqlite3.Connection:
        db = connect(*args, **options)
        pages = db.execute("PRAGMA page_count").fetchone()[0]
        db.execute(f"PRAGMA max_page_count = {pages}")
        return db

    monkeypatch.setattr(sqlite3, "connect", small)
    many = Checked(found(1.0).findings * 5000, found(1.0).rows, (8,))
    with pytest.raises(TestfieldError, match="no room"):
        append(path, SUITE, many, made("y"))
    monkeypatch.undo()
    assert kept(path, "own").number.nunique() == 12


def test_a_database_of_another_program_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "theirs.sqlite"
    with sqlite3.connect(path) as other:
        other.execute("CREATE TABLE t (a)")
    with pytest.raises(TestfieldError, match="another program"):
        kept(path, "own")
