"""Finished runs, each made once for all tests that look at one, in whatever process."""

import fcntl
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from hand_made import HandMade, hand_made

from testfield import registry
from testfield.chain.run import Run, begin, resume
from testfield.chain.stages import STAGES, run_stage

SCENES = Path(__file__).parents[1] / "scenes"
collect_ignore = ["example_package"]  # a package of its own, which test_pytest_plugin.py installs and runs
IN_FULL = Path(__file__).parent / "written_out/quick.toml"
"""scenes/quick.toml with nothing declared once, for tests that change a line of it."""
TINY = Path(__file__).parent / "torture/tiny.toml"


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The finished run of scenes/quick.toml. Read it, do not change it."""
    return finished(SCENES / "quick.toml", tmp_path_factory, 2)


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The finished run of four small images of one board, for what is true of any run. Read it, do not change it."""
    return finished(TINY, tmp_path_factory, 1)


def finished(scene: Path, factory: pytest.TempPathFactory, jobs: int) -> Run:
    """The run of a scene, made by the first process that asks for it; each process has a copy of its own."""
    own = factory.mktemp("runs") / scene.stem
    base = factory.getbasetemp()
    made = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / f"made-{scene.stem}"
    with made.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.with_suffix(".done").exists():
            run, _ = begin(scene, made, None, jobs)
            for name in STAGES:
                run_stage(run, name)
            made.with_suffix(".done").touch()
    shutil.copytree(made, own)
    return resume(own, jobs)


@pytest.fixture(scope="session")
def by_hand() -> HandMade:
    """A field whose errors are known by hand. Read it, do not change it."""
    return hand_made()


@pytest.fixture
def forget_ones_own() -> Iterator[None]:
    """What a test registers or loads of its own is gone after it, and nothing loaded before is told to workers."""
    before = os.environ.pop(registry.LOADED, None)
    yield
    for entered in registry._registered.values():
        for name in [name for name, own in entered.items() if not own.__module__.startswith("testfield.")]:
            del entered[name]
    os.environ.pop(registry.LOADED, None)
    if before is not None:
        os.environ[registry.LOADED] = before
