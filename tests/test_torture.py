"""The quick part of `make torture`: a few mutated inputs for every reader, and one run that is killed."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from testfield.chain.run import Run

TORTURE = Path(__file__).parent / "torture"


def tortured(folder: Path, inputs: int, kills: int) -> None:
    pytest.importorskip("hypothesis")
    count = ["--inputs", str(inputs), "--kills", str(kills), "--pairs", "0", "--cluster", "0"]
    command = [sys.executable, str(TORTURE / "run.py"), *count, "--scene", str(TORTURE / "tiny.toml")]
    done = subprocess.run([*command, "--out", str(folder)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_few_mutated_inputs_for_every_reader_end_as_they_should(tiny: Run, tmp_path: Path) -> None:
    shutil.copytree(tiny.folder, tmp_path / "finished")
    tortured(tmp_path, 24, 0)


@pytest.mark.slow  # `test_run` has a kill of its own; this is that of `make torture`
def test_a_kill_ends_as_it_should(tmp_path: Path) -> None:
    tortured(tmp_path, 0, 1)
