"""`make mutants`: every planted defect must turn the test red that it names, and without any all must be green.

Processes are forked from one that has read the large libraries, so a defect costs its test and little more.
"""

import argparse
import contextlib
import io
import os
import shutil
import sys
import tempfile
import time
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(HERE))

from defects import DEFECTS  # noqa: E402
from planting import Defect, plant  # noqa: E402

LIBRARIES = (
    "numpy",
    "scipy.stats",
    "scipy.optimize",
    "scipy.spatial",
    "pandas",
    "cv2",
    "matplotlib",
    "pydantic",
    "pyarrow.parquet",
    "jinja2",
    "pytest",
    "trimesh",
    "skimage.measure",
)
GREEN, RED, BROKEN = 0, 1, (2, 3, 4, 5)
"""How pytest ends: all passed, some failed, and nothing that could be judged."""


def main() -> int:
    """Plant, run, tell. Exit status 1 where a defect stayed green or a test is red by itself."""
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    p.add_argument("--only", default="", help="defects whose name or test has this in it")
    args = p.parse_args()
    chosen = [d for d in DEFECTS if args.only in d.name or args.only in d.test]
    os.environ |= {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    for name in LIBRARIES:
        with contextlib.suppress(ImportError):
            import_module(name)
    start = time.perf_counter()
    with get_context("fork").Pool(args.jobs, maxtasksperchild=1) as pool:
        results, planted = [], pool.imap(_of_defect, chosen)
        clean = pool.apply_async(_run, (None, sorted({d.test for d in chosen})))
        for d, (status, seconds) in zip(chosen, planted, strict=True):
            results.append((d, status))
            said = {GREEN: "GREEN", RED: "red"}.get(status, "BROKEN")
            print(f"{said:<7}{seconds:6.1f} s  {d.name:<64}  {d.test.rpartition('/')[2]}", flush=True)
        clean_status, _ = clean.get()
    survived = [d for d, status in results if status != RED]
    print(
        f"\n{len(results) - len(survived)} of {len(results)} defects turn the test red that they name, in "
        f"{time.perf_counter() - start:.0f} s; without a defect these tests are {'RED' if clean_status else 'green'}"
    )
    return int(bool(survived) or clean_status != GREEN)


def _of_defect(defect: Defect) -> tuple[int, float]:
    return _run(defect, [defect.test])


def _run(defect: Defect | None, tests: list[str]) -> tuple[int, float]:
    """Exit status of pytest on a copy of the source with a defect in it, and how long it took."""
    start = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "src"
        shutil.copytree(ROOT / "src", source, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
        if defect is not None:
            planted = plant(defect, source / "testfield")
            planted.path.write_text(planted.text, encoding="utf-8")
        return _pytest(source, Path(folder) / "pytest", tests), time.perf_counter() - start


def _pytest(source: Path, folder: Path, tests: list[str]) -> int:
    import pytest

    assert "testfield" not in sys.modules
    sys.path.insert(0, str(source))
    os.environ["PYTHONPATH"] = str(source)  # for processes that tests start
    os.chdir(ROOT)
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        status = int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", f"--basetemp={folder}", *tests]))
    import testfield

    assert Path(testfield.__file__).is_relative_to(source), "another source was tested"
    if status in BROKEN:
        print(said.getvalue()[-2000:], file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
