"""Sameness: the same scene and seed give the same bytes, whatever runs them."""

import hashlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from testfield.certify.verdict import Verdict

_RENDER = """
import hashlib, sys
from pathlib import Path
from testfield.store.pool import end_with_parent
end_with_parent()
from testfield.render.variant import mitsuba
mitsuba()
import drjit as dr
dr.set_thread_count(int(sys.argv[2]))
from testfield.render.fast import render_fast
from testfield.render.irradiance import compute_irradiance
from testfield.render.stage import build_stage
from testfield.scene.build import build_world
from testfield.scene.load import load_scene
stage = build_stage(build_world(load_scene(Path(sys.argv[1]))))
light = compute_irradiance(stage, 120.0, 256, 1, lambda _: None)
print(hashlib.sha256(light.values.tobytes() + render_fast(stage, light, 0, 2).values.tobytes()).hexdigest())
"""

_RUN = """
import sys
from testfield.store.pool import end_with_parent
end_with_parent()
from testfield.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def certify_sameness(scene: Path, quick: bool) -> list[Verdict]:
    """Bytes of a render with one thread, with two, and twice; and of a whole run, undisturbed and resumed."""
    made = {_render(scene, threads) for threads in ("1", "2", "2")}
    threads = Verdict(
        "sameness",
        "different renders with 1 and 2 threads and twice",
        len(made) - 1,
        0,
        "renders",
        "SHA-256 of light and view",
    )
    return [threads] if quick else [threads, _resumed(scene)]


def _render(scene: Path, threads: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", _RENDER, str(scene), threads], check=True, capture_output=True, text=True
    )
    return done.stdout


def _resumed(scene: Path) -> Verdict:
    """A run whose frames and two views were lost must make the same bytes again."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        command = [sys.executable, "-c", _RUN, "run", str(scene), "--out", str(folder)]
        subprocess.run(command, check=True, capture_output=True)
        before = _digests(folder)
        for path in [*sorted(folder.glob("radiance/*.exr"))[:2], *folder.glob("frames/*.png")]:
            path.unlink()
        subprocess.run(command, check=True, capture_output=True)
        after = _digests(folder)
    changed = sum(before[name] != after.get(name) for name in before)
    return Verdict(
        "sameness", "files that differ in a resumed run", changed, 0, "files", f"{len(before)} files of a whole run"
    )


def _digests(folder: Path) -> dict[str, str]:
    """Digests of a run's files. Times differ from run to run: the ledger and the report are nothing but a record of
    them beside the rest, and the scorecard is taken without them."""
    digests = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.name not in ("run.json", "report.html"):
            content = path.read_bytes()
            if path.name == "scorecard.json":
                card = json.loads(content)
                del card["time_s"], card["made"]
                content = json.dumps(card).encode()
            digests[str(path.relative_to(folder))] = hashlib.sha256(content).hexdigest()
    return digests
