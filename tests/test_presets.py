"""Sensor presets: figures with their source, and the scene's own fields go first."""

import pytest
from conftest import IN_FULL

from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.scene.camera_parts import CameraPart, SensorPart
from testfield.scene.load import parse_scene
from testfield.sensor.presets import ABOUT, OF_THE_CAMERA, presets

QUICK = IN_FULL.read_text()


def test_every_preset_says_where_its_figures_are_from_and_uses_the_scenes_names() -> None:
    assert presets()
    for name, figures in presets().items():
        assert len(figures["source"]) > 40, name
        assert isinstance(figures["verified"], bool)
        chip = set(figures) - set(ABOUT) - set(OF_THE_CAMERA)
        assert chip <= set(SensorPart.model_fields)
        assert set(OF_THE_CAMERA) <= set(CameraPart.model_fields) & set(figures)
        # A well holds about what the converter can say.
        largest_e = ((1 << figures["bits"]) - 1 - figures["black_level_dn"]) * figures["gain_e_per_dn"]
        assert 0.5 < figures["full_well_e"] / largest_e < 2


def test_the_scenes_own_fields_go_before_the_presets() -> None:
    scene = parse_scene(
        QUICK.replace("[exposure]", '[sensor]\npreset = "IMX900-LCG"\nbits = 10\n\n[exposure]'), "q.toml"
    )
    figures = presets()["IMX900-LCG"]
    assert scene.sensor.bits == 10
    assert scene.sensor.full_well_e == figures["full_well_e"]
    assert scene.camera.pixel_pitch_um == 4.8
    assert scene.camera.width_px == 1280
    bare = QUICK.replace("width_px = 1280\nheight_px = 1024\npixel_pitch_um = 4.8\n", "")
    scene = parse_scene(bare.replace("[exposure]", '[sensor]\npreset = "IMX900-LCG"\n\n[exposure]'), "q.toml")
    assert scene.camera.pixel_pitch_um == figures["pixel_pitch_um"]
    assert (scene.camera.width_px, scene.camera.height_px) == (figures["width_px"], figures["height_px"])


def test_an_unknown_preset_is_told_with_those_that_are_known() -> None:
    with pytest.raises(TestfieldError, match=r"sensor\.preset") as error:
        parse_scene(QUICK.replace("[exposure]", '[sensor]\npreset = "IMX0"\n\n[exposure]'), "q.toml")
    assert "IMX900-LCG" in str(error.value)


def test_the_list_shows_the_presets_and_which_are_not_verified(capsys: pytest.CaptureFixture) -> None:
    assert main(["list"]) == 0
    said = capsys.readouterr().out
    assert "IMX900-LCG" in said
    assert "not verified" in said
    assert "EMVA 1288" in said
