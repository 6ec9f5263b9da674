"""Which photograph is by which camera: folders, or a table in the field file."""

from pathlib import Path
from typing import Any

import pytest

from testfield.cli.cameras import owners_of, taken_of
from testfield.errors import TestfieldError
from testfield.targets.field_file import FieldFile

TARGET: dict[str, Any] = {"target": {"kind": "ring14"}}
TWO: dict[str, Any] = {"cameras": [{"name": "port", "folder": "left", "lens": "fisheye"}, {"name": "right"}]}


def folders(place: Path, *names: str) -> list[Path]:
    made = [place / name for name in names]
    for path in made:
        path.mkdir()
    return made


def test_without_a_word_all_folders_are_one_camera(tmp_path: Path) -> None:
    given = folders(tmp_path, "left", "right")
    assert owners_of(given, FieldFile.model_validate(TARGET), "f", "brown", by_folder=False, rig=False) is None


def test_each_folder_is_a_camera_and_a_rig_holds_them(tmp_path: Path) -> None:
    given = folders(tmp_path, "left", "right")
    owners = owners_of(given, FieldFile.model_validate(TARGET), "f", "brown", by_folder=False, rig=True)
    assert owners is not None and owners.rigs[0].cameras == ("left", "right")
    assert owners.name_of("pair1", given[1]) == "pair1-right"
    sizes = [(640, 480), (640, 480), (320, 240), (800, 600), (800, 600)]
    taken = taken_of(owners, [given[0]] * 3 + [given[1]] * 2, ["a", "b", "c", "a", "b"], sizes)
    assert [(one.name, one.size_px) for one in taken.cameras] == [("left", (640, 480)), ("right", (800, 600))]
    assert taken.place == ("a", "b", "c", "a", "b") and taken.camera == ("left",) * 3 + ("right",) * 2


def test_the_table_of_the_field_file_names_folder_and_lens(tmp_path: Path) -> None:
    given = folders(tmp_path, "right", "left")
    field = FieldFile.model_validate(TARGET | TWO | {"rigs": [{"cameras": ["port", "right"]}]})
    owners = owners_of(given, field, "f", "brown", by_folder=False, rig=False)
    assert owners is not None and owners.by_folder == {given[0]: "right", given[1]: "port"}
    assert owners.lens == {"port": "fisheye", "right": "brown"} and owners.rigs[0].cameras == ("port", "right")


@pytest.mark.parametrize(
    ("names", "more", "word"),
    [
        (("left",), {}, "one folder is one camera"),
        (("lefft", "right"), TWO, "did you mean 'left'"),
        (("right",), TWO, "'left' was not given"),
    ],
)
def test_folders_that_do_not_fit_are_refused(names: tuple[str, ...], more: dict, word: str, tmp_path: Path) -> None:
    with pytest.raises(TestfieldError) as refused:
        owners_of(folders(tmp_path, *names), FieldFile.model_validate(TARGET | more), "f", "brown", True, False)
    assert word in refused.value.sentence()


@pytest.mark.parametrize(
    ("more", "word"),
    [
        ({"rigs": [{"cameras": ["port", "starboard"]}]}, "starboard"),
        ({"rigs": [{"cameras": ["port", "right"]}, {"name": "other", "cameras": ["right", "port"]}]}, "held twice"),
        ({"cameras": [{"name": "right"}, {"name": "right"}]}, "two cameras"),
    ],
)
def test_a_field_file_whose_cameras_do_not_fit_is_refused(more: dict, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        FieldFile.model_validate(TARGET | TWO | more)
