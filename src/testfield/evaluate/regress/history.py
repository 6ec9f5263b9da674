"""Every check, kept in an SQLite database: what each figure was at which commit, on which machine, with which versions.

SQLite, not DuckDB: a check adds a hundred rows, several commands may append at once, and the file must still be read
in ten years. It comes with Python.
"""

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.errors import TestfieldError
from testfield.evaluate.regress.check import Checked
from testfield.evaluate.regress.suite import OF_THE_MACHINE, Suite
from testfield.evaluate.regress.verdict import status_of

VERSION = 1
APPLICATION = 0x74666C64
"""The number by which SQLite's header names the program: "tfld"."""
WAIT_S = 10.0
"""How long another process that writes is waited for."""
SCHEMA = f"""
CREATE TABLE IF NOT EXISTS checks (
    id INTEGER PRIMARY KEY, made TEXT NOT NULL, suite TEXT NOT NULL, commit_id TEXT NOT NULL, processor TEXT NOT NULL,
    target TEXT NOT NULL, versions TEXT NOT NULL, status INTEGER NOT NULL
);
CREATE TABLE IF NOT EXISTS figures (
    check_id INTEGER NOT NULL REFERENCES checks(id), scene TEXT NOT NULL, recipe TEXT NOT NULL, figure TEXT NOT NULL,
    value REAL, base REAL, low REAL, high REAL, draws INTEGER NOT NULL, verdict TEXT NOT NULL
);
CREATE INDEX IF NOT EXISTS of_check ON figures(check_id);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {VERSION};
"""
COLUMNS = "made, commit_id, processor, status, scene, recipe, figure, value, base, low, high, draws, verdict"


def append(path: Path, suite: Suite, found: Checked, made: dict[str, Any]) -> int:
    """Add a check to the database, which is made where there is none; the number of checks of this suite in it.

    All of it is added or nothing. Raises `TestfieldError` where the database is locked, full, of another version, or
    cannot be written.
    """
    rows = [_row(one, suite.draws) for one in found.findings] + _times(found, {one.name for one in found.findings})
    path.parent.mkdir(parents=True, exist_ok=True)
    with _opened(path, create=True) as db, db:
        of_check = [made["made"], suite.name, made["commit"], made["processor"], made["target"]]
        of_check += [json.dumps(made["versions"]), status_of(found.findings)]
        number = db.execute(
            "INSERT INTO checks (made, suite, commit_id, processor, target, versions, status) VALUES (?,?,?,?,?,?,?)",
            of_check,
        ).lastrowid
        db.executemany("INSERT INTO figures VALUES (?,?,?,?,?,?,?,?,?,?)", [(number, *row) for row in rows])
        return int(db.execute("SELECT count(*) FROM checks WHERE suite = ?", [suite.name]).fetchone()[0])


def suites_in(path: Path) -> list[str]:
    """Names of the suites of which checks are kept. Raises as `append`, and where there is no database."""
    with _opened(path) as db:
        return [row[0] for row in db.execute("SELECT suite FROM checks GROUP BY suite ORDER BY max(id)")]


def kept(path: Path, suite: str) -> pd.DataFrame:
    """All figures of all checks of a suite, in the order of the checks: `number` of the check, and `COLUMNS`."""
    with _opened(path) as db:
        cursor = db.execute(
            f"SELECT checks.id, {COLUMNS} FROM figures JOIN checks ON checks.id = check_id WHERE suite = ? "
            "ORDER BY checks.id, figures.rowid",
            [suite],
        )
        return pd.DataFrame(cursor.fetchall(), columns=["number", *COLUMNS.split(", ")])


def _row(finding: Any, draws: int) -> tuple:
    """A figure's mean over the draws of the first look, which every check has, so that means can be compared."""
    numbers = [_mean(finding.now[:draws]), _mean(finding.base[:draws]), finding.difference.low, finding.difference.high]
    plain = [float(number) if np.isfinite(number) else None for number in numbers]
    return (*finding.name, *plain, finding.difference.draws, finding.verdict.value)


def _times(found: Checked, there: set[tuple[str, str, str]]) -> list[tuple]:
    """Times and memory, also where the suite does not ask for them."""
    keys = [key for key in found.rows if str(key).startswith(OF_THE_MACHINE)]
    rows = []
    for (scene, recipe), own in found.rows.groupby(["scene", "recipe"], sort=False):
        for key in keys:
            values = pd.to_numeric(own[key], errors="coerce").dropna().to_numpy(float)
            if len(values) and (scene, recipe, key) not in there:
                rows.append((scene, recipe, key, float(np.median(values)), None, None, None, len(values), ""))
    return rows


def _mean(values: np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


@contextmanager
def _opened(path: Path, create: bool = False) -> Iterator[sqlite3.Connection]:
    """The database, whose errors speak; made where it is missing and may be."""
    if not create and not path.is_file():
        raise TestfieldError("there is no history", str(path), "`testfield regress check` begins one")
    try:
        with closing(sqlite3.connect(path, timeout=WAIT_S)) as db:
            _begin(db, path)
            yield db
    except sqlite3.Error as error:
        raise _spoken(error, path) from error


def _begin(db: sqlite3.Connection, path: Path) -> None:
    if not db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        # Another process may make them first, while this one waits for its turn.
        db.executescript(f"BEGIN IMMEDIATE; {SCHEMA} COMMIT;")
    application, version = (db.execute(f"PRAGMA {what}").fetchone()[0] for what in ("application_id", "user_version"))
    if application != APPLICATION:
        raise TestfieldError("this is a database of another program", str(path), "name another file with --history")
    if version != VERSION:
        age = "an older" if version < VERSION else "a newer"
        raise TestfieldError(
            f"this history is of {age} version, {version}; this program keeps version {VERSION}",
            str(path),
            "keep it for the program that wrote it, and name another file with --history",
        )


def _spoken(error: sqlite3.Error, path: Path) -> TestfieldError:
    said = str(error)
    for part, what, do in (
        ("locked", f"another process has held the history for {WAIT_S:g} s", "end it, and give the command again"),
        ("full", "there is no room left to write the history", "make room, and give the command again"),
        ("readonly", "the history cannot be written to", "make it writable, or name another file with --history"),
        ("not a database", "this is no SQLite database", "move it away, or name another file with --history"),
        ("unable to open", "the history cannot be opened", "check the path"),
    ):
        if part in said:
            return TestfieldError(what, str(path), do)
    return TestfieldError(f"the history is damaged ({said})", str(path), "move it away; the next check begins another")
