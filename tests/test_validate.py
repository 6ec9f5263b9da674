"""`testfield validate` takes recipes and comparisons: every fault has a sentence, and nothing is rendered or run."""

import json
from pathlib import Path

import pytest
from conftest import TINY

from testfield.cli.main import main

pytestmark = pytest.mark.usefixtures("forget_ones_own")

OWN = '''
from testfield import register


@register("centroids", "exchanged")
def exchanged(image_dn, xy_px, sheet, moments_px2):
    """Takes its arguments in another order."""
'''
RECIPES = {
    'load = ["a.py", "b.py"]': ("a.py", "b.py"),
    'centriod = "star"\nsmallest_diameter_px = 1': ("recipe.toml:1, centriod", "recipe.toml:2, smallest_diameter_px"),
    'centroid = { name = "star", gain = 3 }\ncalibrator = "stiched"\nreconstructor = "glss"': (
        "centroid.gain",
        "'stitched'",
        "'gls'",
    ),
    '[detector]\ncommand = "nowhere {csv}"\n[calibrator]\ncommand = "sh {jsn}"\n[reconstructor]\nfolder = "none"': (
        "detector.command",
        "'json'",
        "reconstructor.folder",
    ),
    '[reconstructor]\ncommand = "python nowhere.py {csv}"': ("reconstructor.command.*nowhere.py",),
    'load = "own.py"\ncentroid = "exchanged"': ("own.py, exchanged.*'xy_px' where it is given 'sheet'",),
}
COMPARISONS = {
    'scenes = ["SCENE", "nowhere.toml"]\nrecipes = ["none.toml"]\ncentroids = ["star", "stra"]': (
        "nowhere.toml",
        "none.toml",
        "'star'",
    ),
    'scenes = ["SCENE"]\ncentroids = ["star", "template"]\ndraws = 0\nuntil = "never"': (":3, draws", ":4, until"),
    'scenes = ["SCENE"]\ncentroids = ["star", "template"]\n[[factor]]\nfield = "camera.f"\nvalues = [1]': ("camera.f",),
    'scenes = ["SCENE"]\ncentroids = ["star", "template"]\n[[factor]]\nfield = "camera.f_number"\nvalues = [4, -1]': (
        "camera.f_number.*-1",
    ),
}


def test_a_field_file_is_taken_for_one_and_every_fault_is_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = tmp_path / "field.toml"
    path.write_text('[target]\nkind = "ring14"\n[[distances]]\ncodes = [3, 9]\nlength_mm = 700\n')
    assert main(["validate", str(path), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["valid"], said["target"], said["distances"]) == (True, "ring14", 1)
    path.write_text('[target]\nkidn = "ring14"\n[[distances]]\ncodes = [3, 3]\nlength_mm = -700\n')
    assert main(["validate", str(path)]) == 2
    told = capsys.readouterr().err
    assert "field.toml:2, target.kidn" in told
    assert "field.toml:5, distances[0].length_mm" in told
    for text, words in (("ring15", "15 bits"), ('ring14"\ncodes = "nowhere.csv', "nowhere.csv")):
        path.write_text(f'[target]\nkind = "{text}"\n')
        assert main(["validate", str(path)]) == 2
        assert words in capsys.readouterr().err


def test_boards_are_listed_with_the_names_that_a_scene_takes(capsys: pytest.CaptureFixture) -> None:
    from testfield.errors import TestfieldError
    from testfield.scene.load import parse_scene

    assert main(["list", "boards", "--json"]) == 0
    listed = json.loads(capsys.readouterr().out)["boards"]
    assert '"aruco" or "apriltag"' in listed["tags"]["what"]
    for name in ("charuco", "circles", "hexcircles", "tags"):
        with pytest.raises(TestfieldError) as refused:
            parse_scene(f'name = "s"\n[[boards]]\nname = "A"\npattern = {{ kind = "{name}" }}\n', "s.toml")
        unknown = f"no kind is called '{name}'" in str([str(one) for one in getattr(refused.value, "faults", ())])
        assert unknown == (f'"{name}"' not in listed[name]["what"])


def test_marks_and_bars_that_cannot_serve_are_named(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    import testfield as tf

    scene = tf.Scene.load("quick").set("scale_bars.control bar.position_mm", [0, -12000, 960])
    path = scene.save(tmp_path / "bar.toml")
    assert main(["validate", str(path), "--json"]) == 0
    told = [said for said in json.loads(capsys.readouterr().out)["warnings"] if "control bar" in said]
    assert len(told) == 2
    assert all("101" in said and "102" in said for said in told)
    planned = scene.plan()["warnings"]
    assert any("'control bar'" in said for said in planned)
    assert not any("rests on one control bar" in said for said in planned)


@pytest.mark.parametrize("text", [*RECIPES, *COMPARISONS], ids=range(len(RECIPES) + len(COMPARISONS)))
def test_every_fault_of_a_recipe_or_comparison_has_a_sentence(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    import re

    (tmp_path / "own.py").write_text(OWN)
    path = tmp_path / ("recipe.toml" if text in RECIPES else "comparison.toml")
    path.write_text(text.replace("SCENE", str(TINY)))
    before = set(tmp_path.rglob("*"))
    assert main(["validate", str(path)]) == 2
    lines, wanted = capsys.readouterr().err.strip().splitlines(), (RECIPES | COMPARISONS)[text]
    assert len(lines) == len(wanted) and all(re.search(word, line) for word, line in zip(wanted, lines, strict=True))
    assert {path for path in tmp_path.rglob("*") if "__pycache__" not in str(path)} == before


def test_what_is_sound_is_said_to_be_and_what_it_holds(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "own.py").write_text("open('started', 'w')")
    (tmp_path / "own.toml").write_text('[detector]\ncommand = "python own.py {csv}"\n')
    assert main(["validate", str(tmp_path / "own.toml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["valid"] and found["parts"] == {
        "calibrator": "stitched",
        "reconstructor": "gls",
        "detector": "program own.py",
    }
    factor = '[[factor]]\nfield = "camera.f_number"\nvalues = [4, 8]\n'
    (tmp_path / "both.toml").write_text(
        f'scenes = ["{TINY}"]\nrecipes = ["own.toml"]\ncentroids = ["star"]\ndraws = 3\n{factor}'
    )
    assert main(["validate", str(tmp_path / "both.toml"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["recipes"] == ["own", "star"] and found["cases"] == 2 * 2 * 3 + 2
    assert not list(tmp_path.rglob("started")) and not Path("started").exists()


def test_a_scene_with_a_recipe_s_fields_is_a_scene(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "s.toml").write_text('[detector]\ncommand = "touch started"\n' + TINY.read_text())
    assert main(["validate", str(tmp_path / "s.toml")]) == 2
    assert "detector" in capsys.readouterr().err
