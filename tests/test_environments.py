"""A recipe's environment: made once, kept under what it is made of, and named with pip's own words where it fails."""

import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest
from conftest import TINY

from testfield.cli.main import main
from testfield.errors import TestfieldError
from testfield.measure.environment import SHEET, environment_of, folder_of, python_of
from testfield.measure.outside import Program
from testfield.measure.programs import run_program
from testfield.measure.recipe import Recipe

DETECTOR = "import owndots, sys\nprint('x_px,y_px,code', f'{owndots.X},3,1', sep='\\n', file=open(sys.argv[1], 'w'))\n"


@pytest.fixture(autouse=True)
def offline(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of its own, and no index to ask."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PIP_NO_INDEX", "1")


@pytest.fixture
def wheel(tmp_path: Path) -> Callable[[str], Path]:
    """Makes the wheel of a package `owndots` whose X is its version."""

    def made(version: str) -> Path:
        path = tmp_path / f"owndots-{version}-py3-none-any.whl"
        about = f"owndots-{version}.dist-info"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("owndots.py", f"X = {version}\n")
            archive.writestr(f"{about}/METADATA", f"Metadata-Version: 2.1\nName: owndots\nVersion: {version}\n")
            archive.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
            archive.writestr(f"{about}/RECORD", "")
        return path

    return made


@pytest.mark.slow
def test_each_release_has_its_own_python_and_is_made_once(
    wheel: Callable[[str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "detect.py").write_text(DETECTOR)
    (tmp_path / "owndots.py").write_text("X = 99\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))  # of the caller, and none of the environment's business
    recipes = {}
    for version in ("1.5", "2.5"):
        packages = (str(wheel(version)),)
        path = tmp_path / f"v{version}.toml"
        path.write_text(
            f"environment = {{ packages = [{str(packages[0])!r}] }}\n"
            '[detector]\ncommand = "python -P detect.py {csv}"\n'
        )
        recipes[version] = Recipe.load(path)
        program = recipes[version].detector
        assert isinstance(program, Program) and ("owndots", version) in program.files
        work = tmp_path / f"work{version}"
        work.mkdir()
        run_program(program, {"csv": work / "out.csv"}, work, "here")
        assert (work / "out.csv").read_text() == f"x_px,y_px,code\n{version},3,1\n"
    assert recipes["1.5"] != recipes["2.5"]
    assert capsys.readouterr().err.count("environment: ") == 2
    made = python_of(packages).stat().st_ino, (folder_of(packages) / SHEET).stat().st_mtime_ns
    assert Recipe.load(tmp_path / "v2.5.toml") == recipes["2.5"]
    assert made == (python_of(packages).stat().st_ino, (folder_of(packages) / SHEET).stat().st_mtime_ns)
    assert not capsys.readouterr().err
    assert python_of(packages) != Path(sys.executable)


def test_one_that_cannot_be_installed_is_said_with_pip_s_own_words(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "d.py").write_text("")
    (tmp_path / "a.toml").write_text(
        'environment = { packages = ["no-such-package-here==9"] }\n[detector]\ncommand = "python d.py {csv}"\n'
    )
    kept = tmp_path / "out" / "cases"
    kept.mkdir(parents=True)
    (kept / "finished.parquet").write_bytes(b"kept")
    words = ["compare", str(TINY), "--recipes", "a.toml", "--centroids", "forward_model", "--out", "out"]
    assert main(words) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("environment: ")]
    assert len(said) == 1 and "a.toml, environment.packages" in said[0]
    assert "no-such-package-here==9" in said[0] and "No matching distribution" in said[0]
    assert (kept / "finished.parquet").read_bytes() == b"kept"
    assert not folder_of(("no-such-package-here==9",)).exists()


@pytest.mark.parametrize("package", ["", "-r everything.txt", "--index-url=http://x"])
def test_what_is_no_package_is_refused(package: str) -> None:
    with pytest.raises(TestfieldError, match="is no package"):
        environment_of((package,))


@pytest.mark.slow
def test_one_that_was_left_half_made_is_made_again(wheel: Callable[[str], Path]) -> None:
    packages = (str(wheel("3.5")),)
    half = folder_of(packages)
    (half / "bin").mkdir(parents=True)
    (half / "bin" / "python").write_text("not yet")
    assert environment_of(packages) == {"owndots": "3.5"}
