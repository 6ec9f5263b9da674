"""Every key of every file is listed in FORMATS.md, every file says its format, and files without one are read."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pyarrow.parquet as pq
import pytest

import testfield
from testfield.chain.run import Run
from testfield.cli.main import main
from testfield.detect.observations import Observations
from testfield.store.ledger import Ledger
from testfield.store.sheets import FORMAT
from testfield.store.stamp import stamp
from testfield.version import __version__

PAGE = (Path(testfield.__file__).parent / "FORMATS.md").read_text(encoding="utf-8")
TABLES = ("truth/marks", "truth/views", "observations", "points")
FOR_PEOPLE = ("run.json", "scorecard.json")


def listed(file: str) -> set[str]:
    """The keys or columns that the page lists for a file."""
    section = PAGE.split(f"\n## {file}\n")[1].split("\n## ")[0]
    rows = [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]
    return {name for row in rows for name in re.findall(r"`([^`]+)`", row)}


def leaves(value: Any, at: tuple[str, ...] = ()) -> Iterator[str]:
    """Dotted keys of all that is no table; entries of a list have the list's own key."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from leaves(inner, (*at, key))
    elif isinstance(value, list) and any(isinstance(inner, dict) for inner in value):
        for inner in value:
            yield from leaves(inner, at)
    else:
        yield ".".join(at)


def unlisted(value: Any, file: str) -> set[str]:
    """Keys of a JSON file that the page does not list; `*` stands for any name, also one with dots."""
    patterns = [re.escape(name).replace(r"\*", ".+") for name in listed(file)]
    empty = {name.split(".*")[0] for name in listed(file)} | {name.rsplit(".", 1)[0] for name in listed(file)}
    known = re.compile("|".join(f"(?:{pattern})" for pattern in patterns))
    return {key for key in set(leaves(value)) if not known.fullmatch(key) and key not in empty}


@pytest.mark.parametrize(
    "file",
    ["run.json", "scorecard.json", "calibration.json", "field.json", "frames/STATION.json", "truth/camera.json"],
)
def test_every_key_that_a_run_writes_is_listed(tiny: Run, file: str) -> None:
    written = json.loads((tiny.folder / file.replace("STATION", tiny.stations[0])).read_text())
    assert written["format"] == FORMAT
    assert unlisted(written, file) == set()
    if file in FOR_PEOPLE:
        assert written["program"] == f"testfield {__version__}" and written["made"].endswith("+00:00")


@pytest.mark.parametrize("table", TABLES)
def test_every_column_is_listed(tiny: Run, table: str) -> None:
    schema = pq.read_schema(tiny.folder / f"{table}.parquet")
    assert set(schema.names) == listed(f"{table}.parquet")
    assert schema.metadata[b"format"].decode() == str(FORMAT)


def test_seeds_and_versions_are_said(tiny: Run) -> None:
    card = json.loads((tiny.folder / "scorecard.json").read_text())
    notes = json.loads((tiny.folder / "run.json").read_text())["notes"]
    assert card["seed"] == notes["seed"] == tiny.scene.seed
    assert notes["versions"]["testfield"] == __version__ and notes["begun"] <= card["made"]


def test_what_is_the_same_every_time_carries_no_date(tiny: Run) -> None:
    year = json.loads((tiny.folder / "scorecard.json").read_text())["made"][:10].encode()
    for pattern in ("scene.toml", "field.json", "radiance/*", "frames/*", "truth/*", "*.parquet", "calibration.json"):
        for path in tiny.folder.glob(pattern):
            assert year not in path.read_bytes(), path


def test_radiance_says_its_format(tiny: Run) -> None:
    with OpenEXR.File(str(tiny.folder / f"radiance/{tiny.stations[0]}.exr")) as file:
        assert file.header()["format"] == str(FORMAT)
    with np.load(tiny.folder / "radiance/light.npz") as data:
        assert data["format"] == FORMAT


def test_photographs_are_listed_too(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((300, 400), 128, np.uint8))
    assert main(["detect", str(tmp_path / "grey.png"), "--target", "ring14", "--out", str(tmp_path / "found")]) == 0
    written = json.loads((tmp_path / "found/detection.json").read_text())
    assert written["program"] == f"testfield {__version__}" and written["images"][0]["image"] == "grey"
    assert unlisted(written, "detection.json") == set()


def test_a_stamp_names_the_seeds_that_there_are() -> None:
    said = stamp(seed=3, noise_seed=4)
    assert list(said) == ["format", "program", "made", "seed", "noise_seed"] and "seed" not in stamp()


def test_files_without_a_format_are_read(tiny: Run, tmp_path: Path) -> None:
    book = json.loads((tiny.folder / "run.json").read_text())
    old = {key: value for key, value in book.items() if key in ("notes", "files", "coming")}
    (tmp_path / "run.json").write_text(json.dumps(old))
    ledger = Ledger(tmp_path)
    assert not ledger.damaged and ledger.files.keys() == book["files"].keys()
    table = pq.read_table(tiny.folder / "observations.parquet")
    notes = {key: value for key, value in table.schema.metadata.items() if key != b"format"}
    pq.write_table(table.replace_schema_metadata(notes), tmp_path / "observations.parquet")
    ours = Observations.load(tiny.folder / "observations.parquet")
    assert np.array_equal(Observations.load(tmp_path / "observations.parquet").xy_px, ours.xy_px)


def test_every_key_of_a_plan_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    scenes = Path(__file__).parents[1] / "scenes"
    for asked in (["quick.toml", "--next", "1", "--exposures"], ["vdi2634.toml"]):
        assert main(["plan", str(scenes / asked[0]), *asked[1:], "--json"]) == 0
        assert not unlisted(json.loads(capsys.readouterr().out), "plan --json")
