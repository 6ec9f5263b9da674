"""All that is wrong with a scene is said at once, with the lines where it stands."""

import tomllib
from pathlib import Path
from typing import Any

import pytest
from conftest import IN_FULL
from hypothesis import given
from hypothesis import strategies as st

from testfield.cli.main import main
from testfield.errors import Faults, TestfieldError, gather, nearest
from testfield.scene.load import load_scene, parse_scene
from testfield.store.toml_lines import Lines, Location
from testfield.targets.field_file import load_field_file

ROOT = Path(__file__).parents[1]
QUICK = IN_FULL.read_text()

FAULTY = """
name = "faulty"
seed = "seven"

[volume]
size_mm = [1800, 1200]

[camera]
widht_px = 1280
height_px = 10.5
lens = "brwon"

[[stations]]
generator = "spiral"

[[boards]]
name = "A"
size_mm = [
  500,
  -360,
]
"""


def test_faults_of_a_scene_do_not_hide_each_other() -> None:
    text = """
name = "four"
seeed = 3

[camera]
width_px = "wide"

[[meshes]]
name = "tank"
file = "nowhere.stl"

[[boards]]
name = "A"
kind = "crad"
bow_mm = "much"
bowl_mm = 3

[[stations]]
kind = "rwo"
radius_mm = 3

[[boards]]
name = "B"
"""
    assert [place.partition(", ")[2] for place in faults(text)] == [
        "boards[0].kind",
        "stations[0].kind",
        "seeed",
        "boards[0].bowl_mm",
        "camera.width_px",
        "boards[0].bow_mm",
        "boards[1].position_mm",
        "meshes[0].file",
    ]


def leaves(value: Any, at: Location = ()) -> list[Location]:
    """Locations of all values that are neither tables nor lists."""
    if isinstance(value, dict):
        return [leaf for key, inner in value.items() for leaf in leaves(inner, (*at, key))]
    if isinstance(value, list):
        return [leaf for k, inner in enumerate(value) for leaf in leaves(inner, (*at, k))]
    return [at]


def faults(text: str) -> dict[str, TestfieldError]:
    """Faults by `line, place`."""
    with pytest.raises(Faults) as raised:
        parse_scene(text, "s.toml")
    return {fault.where.removeprefix("s.toml:"): fault for fault in raised.value.faults}


def test_every_fault_is_named_once_with_its_line() -> None:
    assert set(faults(FAULTY)) == {
        "3, seed",
        "6, volume.size_mm",
        "9, camera.widht_px",
        "10, camera.height_px",
        "11, camera.lens",
        "13, stations[0]",
        "16, boards[0].position_mm",
        "20, boards[0].size_mm[1]",
    }


def test_a_misspelt_name_or_value_gets_the_nearest_one() -> None:
    found = faults(FAULTY)
    assert found["9, camera.widht_px"].do == nearest("widht_px", ["width_px", "lens"])
    assert found["11, camera.lens"].do == nearest("brwon", ["brown", "fisheye"])
    assert "ring" in found["13, stations[0]"].do


def test_no_fault_speaks_as_the_schema_library_does() -> None:
    said = " ".join(fault.sentence() for fault in faults(FAULTY).values())
    for word in ("Input", "valid", "tuple", "Field required", "string", "extra", "discriminator", "should"):
        assert word not in said


def test_the_command_gives_each_fault_a_line(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    scene = tmp_path / "faulty.toml"
    scene.write_text(FAULTY)
    assert main(["validate", str(scene)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 8 and lines[0].startswith("testfield: ")
    assert all("faulty.toml:" in line for line in lines)


def test_faults_behind_the_schema_are_gathered_too(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    text = QUICK.replace("[render]", '[paint]\nwhite = 0.3\nblack = 0.4\n\n[measure]\ncentroid = "magic"\n\n[render]')
    scene = tmp_path / "dark.toml"
    scene.write_text(text.replace("codes = [101, 102]", "codes = [101, 517]"))
    assert main(["validate", str(scene)]) == 2
    lines = capsys.readouterr().err.splitlines()
    written = scene.read_text().splitlines()
    for word, key in (("measure.centroid", "centroid ="), ("paint.white", "white ="), ("517", "[[scale_bars]]")):
        line = next(line for line in lines if word in line)
        number = int(line.split("dark.toml:")[1].split(",")[0])
        assert written[number - 1].startswith(key), line


@pytest.mark.parametrize("path", sorted((ROOT / "scenes").rglob("*.toml")), ids=lambda path: path.stem)
def test_every_value_of_a_file_has_the_line_on_which_it_stands(path: Path) -> None:
    text = path.read_text()
    lines, written = Lines(text), text.splitlines()
    for leaf in leaves(tomllib.loads(text)):
        key = [part for part in leaf if isinstance(part, str)][-1]
        at = lines.of[leaf]
        assert key in written[at - 1] or written[at - 1].startswith((" ", "[", "]")), (leaf, at)


def test_lines_are_those_of_awkward_toml_too() -> None:
    text = (
        'a.b = "[x]" # [\n\n[[t]]\nx = [1,\n 2, {c = "]", d.e = 1.5}]\n[t."q u".z]\ny = """\n[[t]]\n"""\n'
        "w = 1979-05-27 07:32:00\n[[t]]\nx = '#'\nlast = 'it''s'\n"
    ).replace("'it''s'", '"it\'s"')
    found = Lines(text).of
    wanted = {
        ("a", "b"): 1,
        ("t", 0, "x", 1): 5,
        ("t", 0, "x", 2, "d", "e"): 5,
        ("t", 0, "q u", "z", "y"): 7,
        ("t", 0, "q u", "z", "w"): 10,
        ("t", 1): 11,
        ("t", 1, "x"): 12,
        ("t", 1, "last"): 13,
    }
    assert {leaf: found[leaf] for leaf in wanted} == wanted
    assert set(leaves(tomllib.loads(text))) <= set(found)


@given(st.text(max_size=30), st.integers(0, 5))
def test_texts_of_any_kind_do_not_shift_lines(said: str, before: int) -> None:
    import tomli_w

    text = "\n" * before + tomli_w.dumps({"a": said, "b": [said, said], "c": {"d": said}}) + "end = 1\n"
    assert Lines(text).of[("c", "end")] == text.count("\n")


def test_a_field_file_is_told_in_the_same_way(tmp_path: Path) -> None:
    path = tmp_path / "field.toml"
    path.write_text('[target]\nkind = "ring14"\nradi = "1:2:3"\n\n[[distances]]\ncodes = [1, 2]\nu_mm = -1\n')
    with pytest.raises(Faults) as raised:
        load_field_file(path)
    assert [fault.where.split("toml:")[1] for fault in raised.value.faults] == [
        "3, target.radi",
        "5, distances[0].length_mm",
        "7, distances[0].u_mm",
    ]


def test_gather_returns_what_passes_and_raises_all_that_fails() -> None:
    def wrong(what: str) -> int:
        raise TestfieldError(what)

    assert gather(lambda: 1, lambda: 2) == [1, 2]
    with pytest.raises(Faults) as raised:
        gather(lambda: 1, lambda: wrong("a"), lambda: gather(lambda: wrong("b"), lambda: wrong("c"))[0])
    assert [fault.what for fault in raised.value.faults] == ["a", "b", "c"]
    with pytest.raises(TestfieldError) as single:
        gather(lambda: wrong("alone"))
    assert not isinstance(single.value, Faults)


def test_a_scene_without_faults_is_loaded() -> None:
    assert load_scene(ROOT / "scenes/quick.toml").name == "quick"
