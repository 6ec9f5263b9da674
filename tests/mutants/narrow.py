"""The test command of `make mutation`: of the tests that judge, those that run what was mutated, the quick ones first.

`narrow.py map` runs every file of tests by itself under coverage and keeps which statements of the source each file
runs, and how long it takes. `narrow.py` finds the statement of `src` that is no longer as in `sound` and hands pytest
the files that run it. A file that does not run a statement cannot see it change, so a narrow choice loses nothing, and
a mutant costs seconds instead of a minute.
"""

import ast
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TESTS = (
    *sorted(str(path) for path in Path("tests").glob("test_*_by_hand.py")),
    *(f"tests/test_{name}.py" for name in ("accept", "consistency", "keys", "mother_board", "seeds")),
)
PYTEST = ("-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-W", "error::RuntimeWarning")
"""A warning of NumPy's is a figure that nobody can believe, so it is red."""
SLOW = ("--deselect", "tests/test_accept.py::test_a_run_without_measuring_lines_is_tested_on_its_check_targets")
KEPT = Path("narrow.json")

Seen = dict[str, tuple[float, dict[str, list[int]]]]
"""Of each file of tests, the seconds that it takes, and the lines it runs of each file of the source."""


def map_tests() -> int:
    """Run all tests on the sound source and keep what each runs. Not 0 where one is red."""
    import coverage

    seen: Seen = {}
    for test in TESTS:
        with tempfile.TemporaryDirectory() as folder:
            data, begin = Path(folder) / "data", time.perf_counter()
            measure = ("-m", "coverage", "run", f"--data-file={data}", "--source=src/testfield", "--concurrency=thread")
            status = subprocess.run([sys.executable, *measure, *PYTEST, *SLOW, test], check=False).returncode
            if status:
                return status
            found = coverage.CoverageData(str(data))
            found.read()
            lines = {
                str(Path(path).relative_to(Path.cwd())): sorted(found.lines(path) or ())
                for path in found.measured_files()
            }
            seen[test] = (time.perf_counter() - begin, lines)
    KEPT.write_text(json.dumps(seen))
    return 0


def mutated() -> tuple[str, range]:
    """The file of the source that is not as it was, and the lines of its statements that hold the change."""
    for path in sorted(Path("src").rglob("*.py")):
        sound = ("sound" / path).read_text(encoding="utf-8")
        now = path.read_text(encoding="utf-8")
        if now != sound:
            before, after = sound.splitlines(), now.splitlines()
            first = next((k for k, (a, b) in enumerate(zip(before, after, strict=False)) if a != b), len(after))
            same = next((k for k, (a, b) in enumerate(zip(before[::-1], after[::-1], strict=False)) if a != b), 0)
            changed = range(first + 1, max(first + 1, len(before) - same) + 1)
            return str(path), statement(ast.parse(sound), changed)
    raise LookupError("no file of src was changed")


def statement(module: ast.Module, changed: range) -> range:
    """The lines of the innermost statement (of a block its head only) around changed lines."""
    around = changed
    for node in ast.walk(module):  # outer ones come first
        if isinstance(node, ast.stmt):
            block = getattr(node, "body", None)
            first = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", ()))])
            last = block[0].lineno - 1 if block else node.end_lineno or node.lineno
            if first <= changed[0] and changed[-1] <= max(first, last):
                around = range(first, max(first, last) + 1)
    return around


def chosen(path: str, lines: range) -> list[str]:
    """The files of tests that run any of these lines, the quick ones first."""
    seen: Seen = json.loads(KEPT.read_text())
    known = [(seconds, test) for test, (seconds, run) in seen.items() if set(run.get(path, ())) & set(lines)]
    return [test for _, test in sorted(known)]


def main() -> int:
    """Test what was mutated: 0 where no test saw it."""
    tests = chosen(*mutated())
    if not tests:
        print("no test runs this")
        return 0
    os.execv(sys.executable, [sys.executable, *PYTEST, *SLOW, *tests])


if __name__ == "__main__":
    sys.exit(map_tests() if sys.argv[1:] == ["map"] else main())
