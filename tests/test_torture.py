"""The quick part of `make torture`: a few mutated inputs for every reader, and one run that is killed."""

import subprocess
import sys
from pathlib import Path

import pytest

TORTURE = Path(__file__).parent / "torture"


def test_a_few_mutated_inputs_and_a_kill_end_as_they_should(tmp_path: Path) -> None:
    pytest.importorskip("hypothesis")
    command = [sys.executable, str(TORTURE / "run.py"), "--inputs", "48", "--kills", "1", "--pairs", "0"]
    scene = ["--scene", str(TORTURE / "tiny.toml"), "--out", str(tmp_path)]
    done = subprocess.run([*command, *scene], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
