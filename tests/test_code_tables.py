"""A maker's own table of ring codes: checked, kept in the field sheet, rendered, printed and read."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import IN_FULL
from test_ring_shapes import drawn

from testfield.author.prints import card_of
from testfield.bench.dots import Case, render_dots
from testfield.camera.photograph import photograph_of
from testfield.cli.main import main
from testfield.detect.bright import bright_marks
from testfield.detect.detect import measure_targets
from testfield.detect.observations import MEASURED
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.errors import TestfieldError
from testfield.scene.build import build_world
from testfield.scene.check_marks import codes_exist_and_differ
from testfield.scene.load import load_scene
from testfield.sensor.expose import expose
from testfield.targets.code_table import CodeTable, load_code_table, table_path
from testfield.targets.field import Field
from testfield.targets.marks import RADII
from testfield.targets.ring_code import code_words, smallest_rotation

SCENES = Path(__file__).parents[1] / "scenes"


def written(folder: Path, text: str, name: str = "own.csv") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", ["metashape12", "metashape14"])
def test_shipped_tables_are_sound_and_say_their_source(name: str) -> None:
    table = load_code_table(table_path(name))
    words = np.array(table.words, np.uint32)
    assert "http" in table.source
    assert table.numbers == tuple(range(1, len(words) + 1))
    # What their maker's rule has in common with Schneider's: even parity, and words in their smallest rotation.
    assert (np.bitwise_count(words) % 2 == 0).all()
    assert (smallest_rotation(words, table.bits) == words).all()


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("number,word\n1,000111\n2,001110\n", "own.csv:3"),
        ("number,word\n1,000111\n1,001011\n", "twice"),
        ("number,word\n1,000111\n2,0010111\n", "own.csv:3"),
        ("number,word\n0,000111\n", "own.csv:2"),
        ("number,word\n1,000000\n2,001011\n", "all 0"),
        ("number,word\n1,7\n", "bits"),
        ("# bits: 6\nnumber,word\n1,7\n2,64\n", "own.csv:4"),
        ("number,word\n1,x\n2,y\n", "bits"),
        ("code,word\n1,000111\n", "number"),
        ("number,word,start\n1,000111,6\n", "start 6"),
        ("# direction: left\nnumber,word\n1,000111\n", "direction"),
        ("number,word\n", "no codes"),
        ("", "no codes"),
        ("number,word\n1\n", "own.csv:2"),
    ],
)
def test_what_is_no_table_is_refused_with_its_place(tmp_path: Path, text: str, word: str) -> None:
    with pytest.raises(TestfieldError) as error:
        load_code_table(written(tmp_path, text))
    assert word in error.value.sentence()


def test_a_word_may_be_written_in_any_way(tmp_path: Path) -> None:
    binary = load_code_table(written(tmp_path, "number;word\n7;00010111\n9;00011101\n", "a.csv"))
    decimal = load_code_table(written(tmp_path, "# bits: 8\nnumber,word\n9,29\n7,23\n", "b.csv"))
    toml = "bits = 8\n[[codes]]\nnumber = 7\nword = 23\n[[codes]]\nnumber = 9\nword = 29\n"
    assert binary.numbers == decimal.numbers == load_code_table(written(tmp_path, toml, "c.toml")).numbers == (7, 9)
    assert binary.words == decimal.words == load_code_table(tmp_path / "c.toml").words == (23, 29)


def test_who_counts_otherwise_has_the_same_rings(tmp_path: Path) -> None:
    """Segments clockwise from the first: 0 0 0 1 0 1 1 1; from the third counter-clockwise 0 0 0 1 1 1 0 1."""
    usual = load_code_table(written(tmp_path, "number,word\n7,00010111\n", "a.csv"))
    other = load_code_table(
        written(tmp_path, "# direction: counterclockwise\nnumber,word,start\n7,00011101,2\n", "b.csv")
    )
    assert usual.words == other.words


def test_mirrored_readings_are_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = written(tmp_path, "number,word\n7,00010111\n9,00011101\n8,00001111\n")
    assert load_code_table(path).mirrored == ((7, 9), (8, 8))
    assert main(["codes", "--table", str(path)]) == 0
    assert "7  00010111       9" in capsys.readouterr().out
    assert main(["codes", "--table", "metashape12", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["count"] == 161


def test_numbers_are_found_in_any_rotation_and_no_others() -> None:
    table = CodeTable(8, (30, 20), (0b01110001, 0b00101011))
    words = np.array([0b00010111, 0b10101100, 0b00000011], np.uint32)
    assert table.number_of_word(words).tolist() == [30, 20, 0]
    assert table.word_of_number(np.array([20, 30])).tolist() == [0b00101011, 0b01110001]
    with pytest.raises(ValueError, match="no number 7"):
        table.word_of_number(np.array([7]))


OWN = [int(word) for word in code_words(14)[[444, 3, 50, 120, 300, 400, 500, 30, 222]]]


def table_text(turn: int) -> str:
    """Nine words of `drawn` under other numbers, written as they are after a turn."""
    rows = [f"{100 + 7 * k},{((w << turn) | (w >> (14 - turn))) & 0x3FFF:014b}" for k, w in enumerate(OWN)]
    return "number,word\n" + "\n".join(rows) + "\n"


def test_a_photograph_is_read_by_the_table_that_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    import cv2

    path = written(tmp_path, table_text(5))
    cv2.imwrite(str(tmp_path / "it.png"), drawn((2.0, 3.0)))
    out = ["--out", str(tmp_path / "out")]
    assert main(["detect", str(tmp_path / "it.png"), "--target", "ring14", "--codes", str(path), *out]) == 0
    assert "9 numbers read" in capsys.readouterr().out
    assert main(["detect", str(tmp_path / "it.png"), "--target", "ring12", "--codes", str(path), *out]) == 2
    assert "ring14" in capsys.readouterr().err
    found = detect_in_photograph(
        photograph_of("it", drawn((2.0, 3.0))), parse_target("ring14"), codes=load_code_table(path)
    )
    assert found.numbers.tolist() == [100 + 7 * k for k in range(9)]


def scene_with(folder: Path, table: str) -> Path:
    text = IN_FULL.read_text()
    return written(
        folder, text.replace("seed = 7", f'seed = 7\ncode_table = "{table}"\ncode_radii = "1:2.25:3.5"'), "s.toml"
    )


def test_a_scene_may_name_a_table_and_its_sheet_holds_it(tmp_path: Path) -> None:
    field = build_world(load_scene(scene_with(tmp_path, "metashape14"))).field
    field.save(tmp_path / "field.json")
    assert Field.load(tmp_path / "field.json").codes == field.codes == load_code_table(table_path("metashape14"))
    assert field.radii.inner == 2.25
    card, usual = card_of(1, 10, field), card_of(1, 10, Field(14, ()))
    assert len(card.sectors) != len(usual.sectors) or card.sectors != usual.sectors


def test_a_scene_with_a_table_of_other_numbers_is_refused(tmp_path: Path) -> None:
    written(tmp_path, table_text(0))
    with pytest.raises(TestfieldError, match="does not exist"):
        scene = load_scene(scene_with(tmp_path, "own.csv"))
        codes_exist_and_differ(scene, build_world(scene), "s.toml")


def test_rendered_rings_of_a_table_are_read_with_their_turn(tmp_path: Path) -> None:
    """Two tables have the same rings, in one of them five segments on: what is printed turns, and what is read too."""
    turns = []
    for turn in (0, 5):
        codes = load_code_table(written(tmp_path, table_text(turn)))
        dots = render_dots(Case(diameter_px=14, tilt_deg=0, coded=True, codes=codes), 3, 3)
        image, sheet = bright_marks(expose(dots.radiance, dots.sensor, 5), True)
        found = measure_targets(image, sheet, "forward_model", 5.0, 14, RADII["1:2:3"], codes=codes)
        mine = np.flatnonzero((found.status == MEASURED) & (found.code > 0))
        away = np.linalg.norm(dots.xy_px[:, None] - found.xy_px[mine][None], axis=2)
        nearest = mine[away.argmin(axis=1)]
        assert found.code[nearest].tolist() == dots.world.marks.code.tolist()
        turns.append(np.arctan2(found.affine[nearest, 1, 0], found.affine[nearest, 0, 0]))
    # The board is the same, so its x is: words are printed where they begin.
    assert np.abs(np.angle(np.exp(1j * (turns[1] - turns[0])))).max() < 0.05
