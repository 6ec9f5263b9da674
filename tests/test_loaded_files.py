"""Files of a user's own that are loaded by path: each has the modules that lie beside it, and no others."""

import sys
from pathlib import Path

import pytest

from testfield import registry
from testfield.errors import TestfieldError
from testfield.store.code import code_digest

OWN = """
import helper
from testfield import register

@register("centroids", "{name}")
def {name}(image_dn, sheet, xy_px, moments_px2):
    return helper.GAIN
"""
HELPER_WITH_ONE = """
from testfield import register

GAIN = 3

@register("centroids", "{name}")
def {name}(image_dn, sheet, xy_px, moments_px2):
    return GAIN
"""


pytestmark = pytest.mark.usefixtures("forget_ones_own")


def version(folder: Path, name: str, gain: int) -> Path:
    """A file `mine.py` in a folder of its own that registers a centroid, with a module beside it."""
    folder.mkdir()
    (folder / "helper.py").write_text(f"GAIN = {gain}\n")
    (folder / "mine.py").write_text(OWN.format(name=name))
    return folder / "mine.py"


def digest(name: str) -> str:
    code_digest.cache_clear()
    return code_digest(registry.module_of("centroids", name))


def test_each_loaded_file_has_the_modules_beside_it(tmp_path: Path) -> None:
    for name, gain in (("loaded_v1", 1), ("loaded_v2", 2)):
        registry.load_file(version(tmp_path / name, name, gain))
    gains = [registry.find("centroids", name)(None, None, None, None) for name in ("loaded_v1", "loaded_v2")]
    assert gains == [1, 2]
    assert "helper" not in sys.modules


def test_a_module_beside_goes_before_another_of_the_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere/helper.py").write_text("GAIN = 5\n")
    monkeypatch.syspath_prepend(str(tmp_path / "elsewhere"))
    registry.load_file(version(tmp_path / "own", "loaded_beside", 1))
    assert registry.find("centroids", "loaded_beside")(None, None, None, None) == 1


def test_the_digest_follows_the_modules_beside_each_file(tmp_path: Path) -> None:
    names = ("followed_v1", "followed_v2")
    for name, gain in zip(names, (1, 2), strict=True):
        registry.load_file(version(tmp_path / name, name, gain))
    before = [digest(name) for name in names]
    (tmp_path / "followed_v2/helper.py").write_text("GAIN = 4\n")
    after = [digest(name) for name in names]
    assert after[0] == before[0] and after[1] != before[1]


def test_what_a_module_beside_registers_counts_with_what_it_does(tmp_path: Path) -> None:
    path = version(tmp_path / "own", "has_one_beside", 1)
    path.with_name("helper.py").write_text(HELPER_WITH_ONE.format(name="one_beside"))
    registry.load_file(path)
    before = digest("one_beside")
    path.with_name("helper.py").write_text(HELPER_WITH_ONE.format(name="one_beside").replace("3", "4"))
    assert digest("one_beside") != before


def test_two_files_whose_modules_beside_register_one_name_are_refused(tmp_path: Path) -> None:
    for k, name in enumerate(("first_of_two", "second_of_two")):
        path = version(tmp_path / name, name, k)
        path.with_name("helper.py").write_text(HELPER_WITH_ONE.format(name="same_beside"))
    registry.load_file(tmp_path / "first_of_two/mine.py")
    with pytest.raises(TestfieldError, match="'same_beside' is there already"):
        registry.load_file(tmp_path / "second_of_two/mine.py")


def test_packages_beside_are_each_file_s_own_too(tmp_path: Path) -> None:
    for name, gain in (("with_package_v1", 1), ("with_package_v2", 2)):
        path = version(tmp_path / name, name, gain)
        (path.parent / "helpers").mkdir()
        (path.parent / "helpers/__init__.py").write_text("from helpers.gain import GAIN\n")
        (path.parent / "helpers/gain.py").write_text(f"GAIN = {gain}\n")
        path.write_text(path.read_text().replace("helper", "helpers"))
        registry.load_file(path)
        assert registry.find("centroids", name)(None, None, None, None) == gain
        assert not {"helpers", "helpers.gain"} & set(sys.modules)


def test_files_of_one_folder_share_what_a_module_beside_them_registers(tmp_path: Path) -> None:
    path = version(tmp_path / "own", "shares_first", 1)
    path.with_name("helper.py").write_text(HELPER_WITH_ONE.format(name="shared_beside"))
    path.with_name("second.py").write_text(OWN.format(name="shares_second"))
    registry.load_file(path)
    registry.load_file(path.with_name("second.py"))
    assert {"shares_first", "shares_second", "shared_beside"} <= set(registry.names("centroids"))


@pytest.mark.parametrize("deeper", ["elsewhere", "own/.venv/site"])
def test_what_does_not_lie_beside_stays_imported(deeper: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = version(tmp_path / "own", f"loaded_shares_{len(deeper)}", 1)
    (tmp_path / deeper).mkdir(parents=True)
    (tmp_path / deeper / "shared_by_all.py").write_text("")
    monkeypatch.syspath_prepend(str(tmp_path / deeper))
    path.write_text("import shared_by_all\n" + path.read_text())
    registry.load_file(path)
    assert sys.modules.pop("shared_by_all").__file__ == str(tmp_path / deeper / "shared_by_all.py")


def test_the_digest_follows_packages_beside_each_file_with_all_that_is_in_them(tmp_path: Path) -> None:
    path = version(tmp_path / "own", "with_deep_package", 1)
    for name, text in (
        ("helpers/__init__.py", "from .deep.gain import GAIN\n"),
        ("helpers/deep/gain.py", "import beside\nGAIN = beside.GAIN\n"),
        ("beside.py", "GAIN = 1\n"),
        ("others/__init__.py", "GAIN = 7\n"),
    ):
        (path.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (path.parent / name).write_text(text)
    path.write_text(path.read_text().replace("helper", "helpers"))
    registry.load_file(path)
    found = [digest("with_deep_package")]
    for name, text in (
        ("helpers/deep/gain.py", "import beside\nGAIN = 2 * beside.GAIN\n"),
        ("beside.py", "GAIN = 3\n"),
        ("helpers/__init__.py", "from .deep.gain import GAIN\nOFFSET = 1\n"),
    ):
        (path.parent / name).write_text(text)
        found.append(digest("with_deep_package"))
    assert len(set(found)) == 4
    (path.parent / "others/__init__.py").write_text("GAIN = 8\n")  # which it does not import
    assert digest("with_deep_package") == found[-1]
