"""The quick scene's run, made once for all tests that look at a finished run."""

from pathlib import Path

import pytest
from hand_made import HandMade, hand_made

from testfield.chain.run import Run, begin
from testfield.chain.stages import STAGES, run_stage

SCENES = Path(__file__).parents[1] / "scenes"


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The finished run of scenes/quick.toml. Read it, do not change it."""
    run, _ = begin(SCENES / "quick.toml", tmp_path_factory.mktemp("runs") / "quick", None, 2)
    for name in STAGES:
        run_stage(run, name)
    return run


@pytest.fixture(scope="session")
def by_hand() -> HandMade:
    """A field whose errors are known by hand. Read it, do not change it."""
    return hand_made()
