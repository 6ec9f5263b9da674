"""What is to be compared: a comparison's file, factors, and what bad input gets."""

import shutil
from pathlib import Path

import pytest

from testfield.cli.compare import asked_for
from testfield.cli.main import main, parser
from testfield.errors import TestfieldError
from testfield.evaluate.compared import Until
from testfield.evaluate.comparison import Comparison, Factor, recipes_of
from testfield.evaluate.comparison_cases import cases_of, noise_of
from testfield.evaluate.execute import run_name, run_of
from testfield.evaluate.keys import case_key
from testfield.evaluate.known_rows import BROKEN, TRUTH

ROOT = Path(__file__).parents[1]
TINY = ROOT / "tests/torture/tiny.toml"
TWO = recipes_of({"centroids": ["forward_model", "star"]}, "test")
FILE = """
scenes = ["sub/tiny.toml"]
recipes = ["own.toml"]
centroids = ["star"]
draws = 3
matters_um = 4
until = "detect"
[[factor]]
field = "camera.f_number"
title = "aperture"
values = [4, 8.0]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "sub").mkdir()
    shutil.copyfile(TINY, tmp_path / "sub/tiny.toml")
    (tmp_path / "own.toml").write_text('name = "mine"\ncentroid = "grey_centroid"\n')
    (tmp_path / "comparison.toml").write_text(FILE)
    return tmp_path


def test_a_file_says_what_options_say_and_options_go_beyond_it(folder: Path) -> None:
    found = Comparison.load(folder / "comparison.toml")
    assert found.scenes == (folder / "sub/tiny.toml",)
    assert [(one.name, one.centroid.name) for one in found.recipes] == [("mine", "grey_centroid"), ("star", "star")]
    assert found.factors == (Factor("camera.f_number", (4, 8.0), "aperture"),)
    assert (found.draws, found.until, found.matters["um"], found.matters["px"]) == (3, Until.DETECT, 4, 0.001)
    words = ["compare", str(folder / "comparison.toml"), "--draws", "2", "--effect-px", "0.5", "--until", "calibrate"]
    words += ["--centroids", "template", "--factor", "exposure.time_ms=0.3,0.6"]
    asked = asked_for(parser().parse_args(words))
    assert (asked.draws, asked.until, asked.matters["um"], asked.matters["px"]) == (2, Until.CALIBRATE, 4, 0.5)
    assert [one.name for one in asked.recipes] == ["mine", "star", "template"]
    assert [one.field for one in asked.factors] == ["camera.f_number", "exposure.time_ms"]


def test_algorithms_of_several_stages_are_combined() -> None:
    found = recipes_of({"centroids": ["star", "template"], "calibrators": ["stitched", "zhang"]}, "test")
    assert [one.name for one in found] == [
        *("star + stitched", "star + zhang"),
        *("template + stitched", "template + zhang"),
    ]
    assert {one.reconstructor.name for one in found} == {"gls"}


def test_every_recipe_meets_every_value_of_every_factor(folder: Path) -> None:
    factors = (Factor("camera.f_number", (4, 8)), Factor("boards.0.position_mm", ([0, 0, 400], [0, 50, 400]), "place"))
    cases = cases_of(Comparison((TINY,), TWO, 2, factors))
    own = [case for case in cases if case.recipe is not None]
    assert len(own) == 2 * 2 * 2 * 2 and len(cases) == len(own) + 2
    met = {(case.labels["factor"], case.labels["level"], case.labels["draw"], case.labels["recipe"]) for case in own}
    assert len(met) == len(own)
    for case in own:
        assert case.scene is not None
        if case.labels["factor"] == "place":
            assert case.scene["boards"][0]["position_mm"] == [0, 50 * case.labels["level"], 400]
        else:
            assert case.scene["camera"]["f_number"] == (4, 8)[case.labels["level"]]
    assert {case.labels["recipe"] for case in cases if case.recipe is None} == {TRUTH, BROKEN}


def test_a_scene_without_the_factor_is_left_out_of_it(folder: Path) -> None:
    two = folder / "two.toml"
    two.write_text(
        TINY.read_text().replace('name = "tiny"', 'name = "two"')
        + "\n[[check_targets]]\ncode = 213\nposition_mm = [0, 0, 50]\n"
    )
    cases = cases_of(Comparison((TINY, two), TWO, 1, (Factor("check_targets.2.diameter_mm", (14.0, 20.0)),)))
    assert {case.labels["scene"] for case in cases} == {"two"}


def test_meshes_come_along_and_what_is_in_them_counts(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "scenes/meshes", tmp_path / "meshes")
    scene = Path(shutil.copy(ROOT / "scenes/on_a_hull.toml", tmp_path))
    comparison = Comparison((scene,), TWO, 1)
    case, before = cases_of(comparison)[0], [(run_name(one), case_key(one)) for one in cases_of(comparison)]
    run = run_of(case, tmp_path / "out")
    assert [mesh.name for mesh in run.world.meshes] == ["hull"]
    assert run.folder.parent == tmp_path / "out/runs" and (run.folder / "field.json").is_file()
    elsewhere = tmp_path / "elsewhere"
    shutil.copytree(tmp_path / "meshes", elsewhere / "meshes")
    moved = Comparison((Path(shutil.copy(scene, elsewhere)),), TWO, 1)
    assert [(run_name(one), case_key(one)) for one in cases_of(moved)] == before
    mesh = elsewhere / "meshes/hull.stl"
    mesh.write_bytes(mesh.read_bytes()[:-1] + b"\x01")
    after = [(run_name(one), case_key(one)) for one in cases_of(moved)]
    assert all(old[0] != new[0] and old[1] != new[1] for old, new in zip(before, after, strict=True))
    mesh.unlink()
    with pytest.raises(TestfieldError, match=r"hull\.stl"):
        run_name(cases_of(moved)[0])


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ((TINY, "--centroids", "forward_model"), ["--recipes"]),
        ((TINY, "--centroids", "forward_model,gray_centroid"), ["grey_centroid"]),
        ((TINY, "--calibrators", "stitched,stiched"), ["stitched"]),
        ((TINY, "--reconstructors", "gls,ordinary"), ["ordinary"]),
        ((TINY, "--centroids", "forward_model,forward_model"), ["forward_model"]),
        ((TINY, TINY, "--centroids", "forward_model,star"), ["tiny.toml"]),
        ((TINY, "--centroids", "forward_model,star", "--draws", 0), ["--draws", "0"]),
        ((TINY, "--centroids", "forward_model,star", "--effect-px", 0), ["--effect-px"]),
        ((TINY, "--centroids", "forward_model,star", "--effect-um", "nan"), ["--effect-um"]),
        (("no_such_scene", "--centroids", "forward_model,star"), ["no_such_scene"]),
        ((TINY, "--recipes", "no_such_recipe.toml", "--centroids", "star"), ["no_such_recipe.toml"]),
        ((TINY, "--centroids", "star,template", "--factor", "camera.f_numbr=4,8"), ["f_numbr", "'f_number'", "4"]),
        ((TINY, "--centroids", "star,template", "--factor", "boards.7.bend_mm=4,8"), ["boards.7.bend_mm", "4"]),
        ((TINY, "--centroids", "star,template", "--factor", "camera.f_number=4,-8"), ["camera.f_number", "-8"]),
        ((TINY, "--centroids", "star,template", "--factor", "camera.f_number"), ["--factor", "camera.f_number"]),
        ((TINY, "--centroids", "star,template", "--factor", "camera.f_number="), ["camera.f_number"]),
        ((TINY, "--centroids", "star,template", "--factor", "camera.f_number=4,,8"), ["--factor", "camera.f_number"]),
    ],
)
def test_what_cannot_be_compared_is_said_in_one_sentence_before_anything_is_rendered(
    words: tuple, named: list[str], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main(["compare", *map(str, words), "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1 and all(word in said for word in named)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("was", "becomes", "named"),
    [
        ("draws = 3", "draws = 0", [":5", "draws", "0"]),
        ("draws = 3", "drawn = 3", [":5", "drawn", "'draws'"]),
        ("matters_um = 4", "matters_um = -1", ["matters_um", "-1"]),
        ('until = "detect"', 'until = "never"', ["until", "never"]),
        ('recipes = ["own.toml"]', 'recipes = ["other.toml"]', ["other.toml"]),
        ('centroids = ["star"]', 'centroids = ["stars"]', ["comparison.toml", "'stars'", "'star'"]),
        ('scenes = ["sub/tiny.toml"]', 'scenes = ["sub/none.toml"]', ["none.toml"]),
        ('scenes = ["sub/tiny.toml"]', "scenes = []", ["scenes"]),
        ("values = [4, 8.0]", "values = []", ["factor[0].values"]),
        ('field = "camera.f_number"', 'field = "camera.fnumber"', ["comparison.toml", "camera.fnumber", "4"]),
        ("values = [4, 8.0]", 'values = [4, "eight"]', ["comparison.toml", "camera.f_number", "eight"]),
    ],
)
def test_a_wrong_file_is_named_with_its_field_and_value(
    was: str, becomes: str, named: list[str], folder: Path, capsys: pytest.CaptureFixture
) -> None:
    path = folder / "comparison.toml"
    path.write_text(FILE.replace(was, becomes))
    assert main(["compare", str(path), "--out", str(folder / "out")]) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1 and all(word in said for word in named), said
    assert not (folder / "out").exists()


def test_a_recipe_with_an_unknown_option_is_named(folder: Path, capsys: pytest.CaptureFixture) -> None:
    (folder / "own.toml").write_text('centroid = { name = "grey_centroid", treshold = 3 }\n')
    assert main(["compare", str(folder / "comparison.toml"), "--out", str(folder / "out")]) == 2
    said = capsys.readouterr().err
    assert "own.toml" in said and "treshold" in said and len(said.strip().splitlines()) == 1


def test_scenes_with_stations_of_the_same_names_meet_noise_of_their_own() -> None:
    """Pooled over scenes, draws count as independent; changes of one scene and all recipes share theirs."""
    seeds = {noise_of(scene, draw) for scene in ("near", "far", "dim") for draw in range(1, 50)}
    assert len(seeds) == 3 * 49
    assert all(0 <= seed < 2**31 for seed in seeds)
    assert noise_of("near", 7) == noise_of("near", 7)
