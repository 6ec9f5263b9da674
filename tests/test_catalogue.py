"""Boards, cameras and lights of the catalogue: each in a scene by its name, written out in its run's folder."""

import tomllib

import pytest
import tomli_w
from conftest import IN_FULL

from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.scene.build import build_world
from testfield.scene.catalogue import LISTS, catalogue
from testfield.scene.document import read_document
from testfield.scene.load import parse_scene

QUICK = tomllib.loads(IN_FULL.read_text())


def with_board(name: str) -> str:
    zone = {"recognition_zone": {"first_code": 31}} if "recognition_zone" in catalogue("boards")[name]["fields"] else {}
    board = {"name": "D", "kind": name, "position_mm": [0, 5000, 3000]} | zone
    return tomli_w.dumps(QUICK | {"boards": [*QUICK["boards"], board]})


@pytest.mark.parametrize("name", catalogue("boards"))
def test_every_board_of_the_catalogue_is_built(name: str) -> None:
    world = build_world(parse_scene(with_board(name), "scene"))
    board = world.field.boards[-1]
    assert board.name == "D"


@pytest.mark.parametrize("name", catalogue("cameras"))
def test_every_camera_of_the_catalogue_is_a_camera(name: str) -> None:
    fields = catalogue("cameras")[name]["fields"]
    one = QUICK | {"camera": {"kind": name, "focal_length_mm": 8.0}, "sensor": {"read_noise_e": 3.0}}
    scene = parse_scene(tomli_w.dumps(one), "scene")
    assert (scene.camera.width_px, scene.camera.pixel_pitch_um) == (fields["width_px"], fields["pixel_pitch_um"])
    assert (scene.sensor.bits, scene.sensor.read_noise_e) == (fields["sensor"]["bits"], 3.0)
    named = {key: value for key, value in QUICK.items() if key not in ("camera", "stations")}
    stations = [{"camera": "left", "name": "s", "position_mm": [0, -2000, 600], "look_at_mm": [0, 0, 560]}]
    several = named | {"cameras": [{"name": "left", "kind": name}], "stations": stations}
    sensor = parse_scene(tomli_w.dumps(several), "scene").cameras[0].sensor
    assert sensor is not None
    assert sensor.bits == fields["sensor"]["bits"]


@pytest.mark.parametrize("name", catalogue("lights"))
def test_every_light_of_the_catalogue_shines(name: str) -> None:
    room = QUICK["room"] | {"lights": [{"kind": name, "position_mm": [0, -1000, 2600]}]}
    (light,) = parse_scene(tomli_w.dumps(QUICK | {"room": room}), "scene").room.lights
    assert light.kind == catalogue("lights")[name]["fields"]["kind"]


@pytest.mark.parametrize(
    ("entry", "near"),
    [
        ({"boards": [{"kind": "calib.io CharuCo A3 11x9"}]}, "calib.io ChArUco A3 11x8"),
        ({"camera": {"kind": "FLIR BFS-U3-244S8"}}, "FLIR BFS-U3-244S8M"),
        ({"room": {"lights": [{"kind": "LED panel 600x600"}]}}, "LED panel 600x600 3600 lm"),
        ({"room": {"lights": [{"kind": "poin"}]}}, "point"),
        ({"boards": [{"kind": "wall paper"}]}, "testfield list boards"),
    ],
)
def test_an_entry_that_is_not_there_is_answered_by_the_nearest(entry: dict, near: str) -> None:
    with pytest.raises(TestfieldError, match=near.replace(".", r"\.")):
        parse_scene(tomli_w.dumps({"name": "x"} | entry), "scene.toml")


def test_what_a_scene_uses_of_the_catalogue_is_written_out() -> None:
    document = read_document(with_board("calib.io ChArUco A3 11x8"), "scene")
    kinds = tomllib.loads(document.content.decode())["kinds"]
    assert kinds == {"calib.io ChArUco A3 11x8": catalogue("boards")["calib.io ChArUco A3 11x8"]["fields"]}


def test_what_a_scene_declares_comes_before_the_catalogue() -> None:
    name = "OpenCV ChArUco A4 5x7"
    text = with_board(name) + f'[kinds."{name}"]\nsize_mm = [300, 300]\npattern.kind = "charuco"\n'
    text += "pattern.columns = 5\npattern.rows = 7\npattern.square_mm = 30\npattern.marker_mm = 20\n"
    assert parse_scene(text.replace('["kinds"', '["kinds"'), "scene").boards[-1].size_mm == (300, 300)


@pytest.mark.parametrize("kind", LISTS)
def test_the_catalogue_is_listed_with_its_sources(kind: str, capsys: pytest.CaptureFixture) -> None:
    assert main(["list", kind]) == 0
    printed = capsys.readouterr().out
    for name, one in catalogue(kind).items():
        assert name in printed
        assert one["source"] in printed
