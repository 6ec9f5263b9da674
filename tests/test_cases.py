"""Small inputs that once failed, each with a script that says what is right; they lie beside the project."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CASES = Path(__file__).parents[2] / "shared" / "cases"
MENDED = (
    "squares_crash",
    "wide_lens_marks_discarded",
    "two_bars_contradict",
    "mirrored_world",
    "fisheye_refused",
    "peer_numbers_traceback",
    "apriltag_corner_numbers",
    "lamp_hides_tags",
    "mesh_body_inside_out",
    "dollar_in_a_name",
    "archive_as_mesh",
    "scenes_traceback",
)
LONG = (
    "own_frame_lost_when_killed",
    "workers_outlive_kill",
    "second_run_breaks_first",
    "disk_errors_traceback",
    "edited_scene_unnoticed",
    "damaged_run_files",
    "latin1_locale",
    "wrong_sheet_unnamed",
    "clean_paper_saturated",
)
"""What these show in minutes, tests named after the claim show in less."""


@pytest.mark.parametrize("name", [*MENDED, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)])
def test_a_case_that_once_failed_gives_the_right_answer(name: str, tmp_path: Path) -> None:
    if not (CASES / name).is_dir():
        pytest.skip(f"{CASES / name} is absent")
    folder = tmp_path / name
    # The answers of earlier runs stay behind, and so does what forbids to write.
    shutil.copytree(CASES / name, folder, ignore=shutil.ignore_patterns("out*", "log.txt"), copy_function=shutil.copy)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o755 if path.is_dir() or path.suffix == ".sh" else 0o644)
    command = tmp_path / "testfield"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m testfield "$@"\n')
    command.chmod(0o755)
    # Where the peers' library is installed, both ways find it.
    around = dict(os.environ, TESTFIELD=str(command), PUPIL="", PYTHONPATH=os.environ.get("PYTHONPATH", ""))
    how = ["bash", "run.sh"] if (folder / "run.sh").exists() else [sys.executable, "run.py"]
    found = subprocess.run(how, cwd=folder, env=around, capture_output=True, text=True, timeout=600)
    assert found.returncode == 0, found.stdout + found.stderr
