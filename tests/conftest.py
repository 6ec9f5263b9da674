"""Finished runs, each made once for all tests that look at one."""

from pathlib import Path

import pytest
from hand_made import HandMade, hand_made

from testfield.chain.run import Run, begin
from testfield.chain.stages import STAGES, run_stage

SCENES = Path(__file__).parents[1] / "scenes"
TINY = Path(__file__).parent / "torture/tiny.toml"


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The finished run of scenes/quick.toml. Read it, do not change it."""
    run, _ = begin(SCENES / "quick.toml", tmp_path_factory.mktemp("runs") / "quick", None, 2)
    for name in STAGES:
        run_stage(run, name)
    return run


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The finished run of four small images of one board, for what is true of any run. Read it, do not change it."""
    run, _ = begin(TINY, tmp_path_factory.mktemp("runs") / "tiny", None, 1)
    for name in STAGES:
        run_stage(run, name)
    return run


@pytest.fixture(scope="session")
def by_hand() -> HandMade:
    """A field whose errors are known by hand. Read it, do not change it."""
    return hand_made()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that look at the quick scene's run are done by one process, so that it is made once."""
    for item in items:
        if "quick" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group("quick"))
