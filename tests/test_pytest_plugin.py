"""The pytest plugin: another package's tests in a rendered field, one render for all, and baselines of tests."""

import os
import shutil
import subprocess
import sys
import sysconfig
import textwrap
import time
import venv
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from testfield.errors import TestfieldError
from testfield.evaluate.regress.for_tests import FieldRegression, Regressed, name_of
from testfield.store.lock import only_writer

ROOT = Path(__file__).parents[1]
EXAMPLE = Path(__file__).parent / "example_package"
PLUGIN = "testfield.evaluate.pytest_plugin"


def pytest_in(folder: Path, python: str, *words: str, path: str = "", cache: Path) -> subprocess.CompletedProcess:
    """pytest in a package's folder, as its author calls it, with a cache folder of its own."""
    known = {point.value for point in entry_points(group="pytest11")}
    plugin = [] if PLUGIN in known or not path else ["-p", PLUGIN]
    left = {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST", "PYTHONPATH"))}
    environment = left | {"XDG_CACHE_HOME": str(cache)} | ({"PYTHONPATH": path} if path else {})
    command = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *plugin, *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env=environment, timeout=900)


def copied(tmp_path: Path) -> Path:
    return shutil.copytree(EXAMPLE, tmp_path / "package", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))


def test_the_example_passes_in_two_processes_of_which_one_renders(tmp_path: Path) -> None:
    package, path = copied(tmp_path), os.pathsep.join([str(ROOT / "src"), str(tmp_path / "package/src")])
    words = ("-n", "2", "-k", "not draws", "-rA")
    done = pytest_in(package, sys.executable, *words, path=path, cache=tmp_path / "cache")
    assert done.returncode == 0, done.stdout + done.stderr
    runs = list((tmp_path / "cache/testfield/renders").glob("*/runs/*/run.json"))
    assert len(runs) == 1
    images = {path: path.stat().st_mtime_ns for path in runs[0].parent.rglob("*.exr")}
    # What was found to be worse says so, without another render and without a traceback of the plugin's.
    spoilt = package / "src/my_centres/__init__.py"
    spoilt.write_text(spoilt.read_text().replace("centre[::-1] for", "np.add(centre[::-1], 0.2) for"))
    failed = pytest_in(package, sys.executable, "-k", "as_good", path=path, cache=tmp_path / "cache")
    assert failed.returncode == 1 and "worse: rms_px" in failed.stdout and "Traceback" not in failed.stdout
    assert images == {path: path.stat().st_mtime_ns for path in runs[0].parent.rglob("*.exr")} != {}
    assert not list(package.rglob("*.candidate.json"))


@pytest.mark.slow
def test_the_example_is_installed_and_passes_in_an_environment_of_its_own(tmp_path: Path) -> None:
    venv.create(tmp_path / "venv", with_pip=True)
    python = str(tmp_path / "venv/bin/python")
    purelib = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], capture_output=True, text=True
    ).stdout.strip()
    # What both packages stand on is taken from here, not downloaded again.
    Path(purelib, "beside.pth").write_text(sysconfig.get_path("purelib") + "\n")
    shutil.copytree(ROOT / "src", tmp_path / "own/src", ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path / "own")
    package = copied(tmp_path)
    for folder in (tmp_path / "own", package):
        command = [python, "-m", "pip", "install", "--quiet", "--no-deps", "--disable-pip-version-check", str(folder)]
        subprocess.run(command, check=True, capture_output=True)
    done = pytest_in(package, python, "-n", "2", cache=tmp_path / "cache")
    assert done.returncode == 0 and "3 passed" in done.stdout, done.stdout + done.stderr


def test_who_waits_for_a_folder_gets_it_when_it_is_free(tmp_path: Path) -> None:
    script = f"""
        import time
        from pathlib import Path
        from testfield.store.lock import only_writer
        with only_writer(Path({str(tmp_path)!r})):
            print("held", flush=True)
            time.sleep(1.0)
    """
    holder = subprocess.Popen([sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True)
    assert holder.stdout is not None and holder.stdout.readline() == "held\n"
    begun = time.monotonic()
    with pytest.raises(TestfieldError), only_writer(tmp_path):
        pass
    with only_writer(tmp_path, 20.0):
        assert time.monotonic() - begun > 0.5
    holder.wait()


def by_draw(draw: int) -> dict[str, float]:
    return {"rms": 1 + 0.01 * np.random.default_rng(draw).standard_normal()}


def test_a_test_without_a_baseline_stores_a_candidate_and_fails(tmp_path: Path) -> None:
    own = FieldRegression("test_a.py::test_b[1-x]", tmp_path / "field_baselines")
    with pytest.raises(Regressed, match="candidate"):
        own.check({"rms": 1.0})
    own.path.with_suffix(".candidate.json").rename(own.path)
    own.check({"rms": 1.0})
    own.check({"rms": 1.04})
    with pytest.raises(Regressed, match="worse"):
        own.check({"rms": 1.06})


def test_figures_of_draws_are_asked_until_they_are_decided(tmp_path: Path) -> None:
    FieldRegression("t", tmp_path, record=True).check(by_draw, budget=32)
    own = FieldRegression("t", tmp_path)
    asked: list[int] = []

    def worse(draw: int) -> dict[str, float]:
        asked.append(draw)
        return {"rms": by_draw(draw)["rms"] * (1.02 + 0.006 * np.sin(draw))}

    own.check(by_draw, matters={"rms": 0.01})
    with pytest.raises(Regressed, match="worse: rms"):
        own.check(worse, matters={"rms": 0.01})
    assert asked == list(range(1, len(asked) + 1)) and 8 <= len(asked) < 32


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_no_number_is_never_a_pass(tmp_path: Path, value: float) -> None:
    FieldRegression("t", tmp_path, record=True).check({"rms": value})
    with pytest.raises(Regressed, match="not a number"):
        FieldRegression("t", tmp_path).check({"rms": value})


def test_figures_that_only_one_side_has_and_other_numbers_of_draws_fail(tmp_path: Path) -> None:
    FieldRegression("t", tmp_path, record=True).check({"rms": [1.0, 1.1, 1.2]})
    own = FieldRegression("t", tmp_path)
    with pytest.raises(Regressed, match="missing: bias"):
        own.check({"rms": [1.0, 1.1, 1.2], "bias": [0.0, 0.0, 0.0]})
    with pytest.raises(Regressed, match="2 draws"):
        own.check({"rms": [1.0, 1.1]})
    other = FieldRegression("u", tmp_path)
    own.path.rename(other.path)
    with pytest.raises(TestfieldError, match="baseline of 't'"):
        other.check({"rms": [1.0, 1.1, 1.2]})


def test_what_is_said_of_a_figure_that_is_not_there_is_refused(tmp_path: Path) -> None:
    FieldRegression("t", tmp_path, record=True).check({"rms": 1.0})
    own = FieldRegression("t", tmp_path)
    for said in ({"matters": {"rsm": 9.0}}, {"better": {"rsm": "more"}}, {"better": {"rms": "smaller"}}):
        with pytest.raises(TestfieldError, match=r"rsm|smaller"):
            own.check({"rms": 1.0}, **said)  # type: ignore[arg-type]


def test_tests_of_a_file_have_names_of_their_own_whatever_their_parameters_are() -> None:
    names = [name_of(f"tests/a/test_x.py::test_{which}[lens/wide]") for which in ("one", "other")]
    assert names == ["test_x.py::test_one[lens/wide]", "test_x.py::test_other[lens/wide]"]
