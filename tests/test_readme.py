"""What the README says can be done, can be done."""

import re
import shlex
import tomllib
from pathlib import Path

import pytest

import testfield as tf
from testfield.cli.main import main, parser

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = [
    ROOT / "README.md",
    *(ROOT / f"src/testfield/{name}.md" for name in ("FIGURES", "FORMATS", "METHODS", "OWN_ALGORITHMS", "README")),
]


def block(kind: str) -> str:
    """The code in the page of a kind."""
    found: list[str] = re.findall(rf"```{kind}\n(.*?)```", PAGE, re.S)
    assert len(found) == 1
    return found[0]


def test_the_page_is_short() -> None:
    assert len(PAGE.split()) <= 1200


def test_the_scene_is_of_ten_lines_and_valid(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    scene = tmp_path / "first.toml"
    scene.write_text(block("toml"))
    assert len([line for line in block("toml").splitlines() if line]) <= 10
    assert main(["validate", str(scene)]) == 0


@pytest.mark.slow
def test_the_scene_runs(tmp_path: Path) -> None:
    (tmp_path / "first.toml").write_text(block("toml"))
    result = tf.run(tmp_path / "first.toml", tmp_path / "first")
    assert result.score.passed and result.score["detection.found_fraction"] > 0.99


def test_the_python_uses_names_that_there_are() -> None:
    code = block("python")
    compile(code, "README.md", "exec")
    assert set(re.findall(r"\btf\.(\w+)", PAGE)) <= set(tf.__all__)


def test_commands_and_their_options_exist() -> None:
    top = parser()
    lines = re.findall(r"^    testfield (.+)$", PAGE, re.M)
    for line in lines:
        name, *rest = shlex.split(line.split("   ")[0])
        for one in name.split("|"):
            assert one in top.commands.help, line
            said = top.commands.action.choices[one].format_help()
            assert all(word in said for word in rest if word.startswith("--")), line
    assert len(lines) > 10


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)", page.read_text(encoding="utf-8")):
        assert target.startswith("http") or (page.parent / target).exists(), target


def test_scenes_that_pages_name_exist() -> None:
    for page in PAGES[:2]:
        for name in re.findall(r"scenes/([\w/]+\.toml)", page.read_text(encoding="utf-8")):
            assert (ROOT / "scenes" / name).exists(), name
            tomllib.loads((ROOT / "scenes" / name).read_text())
