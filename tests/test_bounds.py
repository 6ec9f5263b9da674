"""Numbers, texts and nesting beyond all bounds are refused in a sentence before anything is built."""

import time
from pathlib import Path

import pytest
from conftest import IN_FULL

from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.scene.load import parse_scene
from testfield.targets.field_file import load_field_file

QUICK = IN_FULL.read_text(encoding="utf-8")
GRID = '[[check_targets]]\ngenerator = "grid"\nfirst_code = 201\ncounts = [3, 1, 2]'
RANDOM = (
    '[[stations]]\ngenerator = "grid"\ncounts = [1000, 1000, 1000]\nlow_mm = [0, -3000, 0]\nhigh_mm = [1, -2000, 1]\n'
)

CASES = {
    "huge normal": (("normal = [-0.45, -1, 0.3]", "normal = [1e300, 0, 0]"), ["boards[2].normal", "1e+300"]),
    "tiny normal": (("normal = [-0.45, -1, 0.3]", "normal = [1e-300, 0, 0]"), ["boards[2].normal", "1e-06"]),
    "tiny normal of a lamp": (
        ("normal = [-0.1, 0.5, -1]\nradiance", "normal = [0, 1e-300, 0]\nradiance"),
        ["room.lights[0].normal"],
    ),
    "code of 2^63": (("codes = [101, 102]", "codes = [101, 9223372036854775808]"), ["scale_bars[0].codes", "1e+09"]),
    "code of 1e30": (("codes = [101, 102]", f"codes = [101, {10**30}]"), ["scale_bars[0].codes", "1e+30"]),
    "a thousand levels": (("seed = 7", f"seed = 7\nx = {'[' * 1000}{']' * 1000}"), ["levels"]),
    "thirty levels": (("seed = 7", f"seed = 7\nx = {'[' * 30}{']' * 30}"), ["20 levels"]),
    "five thousand digits": (("seed = 7", f"seed = {'7' * 5000}"), ["TOML"]),
    "huge seed": (("seed = 7", f"seed = {2**64}"), ["seed"]),
    "a grid of 1e9": ((GRID, GRID.replace("[3, 1, 2]", "[1000, 1000, 1000]")), ["check_targets[0]", "1000000000"]),
    "1e9 stations": (("[render]", f"{RANDOM}\n[render]"), ["stations", "1000000000"]),
    "a name of 5,000": (('name = "B"', f'name = "{"x" * 5000}"'), ["boards[1].name", "80"]),
    "a text of a million": (('description = "', f'description = "{"x" * 10**6}'), ["description", "10000"]),
    "no rolls": (("[render]", "[[stations]]\nposition_mm = [0, -2000, 500]\nroll_deg = []\n\n[render]"), ["roll_deg"]),
}


@pytest.mark.parametrize("name", CASES)
def test_the_sentence_names_field_and_limit(name: str, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (old, new), words = CASES[name]
    assert old in QUICK
    scene = tmp_path / "bad.toml"
    scene.write_text(QUICK.replace(old, new), encoding="utf-8")
    begun = time.process_time()
    assert main(["validate", str(scene)]) == 2
    assert time.process_time() - begun < 5
    said = capsys.readouterr().err
    for word in words:
        assert word in said, said


def test_pixels_are_counted_together() -> None:
    text = QUICK.replace("width_px = 1280", "width_px = 20000").replace("height_px = 1024", "height_px = 20000")
    with pytest.raises(TestfieldError, match=r"camera\.width_px.*400000000"):
        parse_scene(text, "scene")


@pytest.mark.parametrize("value", ["inf", "nan", "1e300", "-1e12"])
def test_coordinates_of_a_field_file_are_bounded(value: str, tmp_path: Path) -> None:
    path = tmp_path / "field.toml"
    places = "\n".join(f"[[boards.points]]\ncode = {k}\nxyz_mm = [{value}, 0, {k}]" for k in (1, 2, 3))
    path.write_text(f'[target]\nkind = "ring14"\n[[boards]]\n{places}\n')
    with pytest.raises(TestfieldError, match=r"xyz_mm"):
        load_field_file(path)


def test_a_file_that_is_none_is_not_read(capsys: pytest.CaptureFixture) -> None:
    for name in ("/dev/zero", "/proc/self/mem"):
        if Path(name).exists():
            assert main(["validate", name]) == 2
            assert name in capsys.readouterr().err


def test_a_seed_is_set_in_the_document_however_it_is_written() -> None:
    from testfield.chain.run import with_seed

    told = 'description = """\n[x]\nseed = 7\n"""\n'
    bare = "".join(line for line in QUICK.splitlines(keepends=True) if not line.startswith("description"))
    for key in ("seed = 7", "  seed = 7", '"seed" = 7', f"{told}seed = 7"):
        text = bare.replace("seed = 7", key)
        scene = parse_scene(with_seed(text, 8), "scene")
        assert scene.seed == 8
        assert scene.model_copy(update={"seed": 7}) == parse_scene(text, "scene")
