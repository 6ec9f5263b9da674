"""Of the tests that judge, those that run what was mutated, the quick ones first.

`narrow.py` runs every file of tests by itself under coverage and keeps which lines of the source it runs, and how long
that takes. A file that does not run a statement cannot see it change, so a narrow choice loses nothing, and a mutant
costs seconds instead of a minute.
"""

import ast
import json
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

TESTS = (
    *sorted(str(path) for path in Path("tests").glob("test_*_by_hand.py")),
    *(f"tests/test_{name}.py" for name in ("accept", "consistency", "keys", "mother_board", "seeds", "statistics")),
)
SLOW = ("--deselect", "tests/test_accept.py::test_a_run_without_measuring_lines_is_tested_on_its_check_targets")
OPTIONS = (
    *("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"),
    *("-W", "error::RuntimeWarning", "-W", "error::SyntaxWarning"),
    *SLOW,
)
"""A warning of NumPy's is a figure that nobody can believe, so it is red, and so is Python's of `is` beside a literal,
which `make check` would see."""
KEPT = Path("narrow.json")

Seen = dict[str, tuple[float, dict[str, list[int]]]]
"""Of each file of tests, the seconds that it takes, and the lines it runs of each file of the source."""


def main() -> int:
    """Run all tests on the sound source and keep what each runs. Not 0 where one is red."""
    import coverage

    seen: Seen = {}
    for test in TESTS:
        with tempfile.TemporaryDirectory() as folder:
            data, begin = Path(folder) / "data", time.perf_counter()
            measure = ("-m", "coverage", "run", f"--data-file={data}", "--source=src/testfield", "--concurrency=thread")
            status = subprocess.run([sys.executable, *measure, "-m", "pytest", *OPTIONS, test], check=False).returncode
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


def statement(text: str, first: int, last: int) -> range:
    """The lines of the innermost statement (of a block its head only) around a change in source."""
    around = range(first, last + 1)
    for node in ast.walk(ast.parse(text)):  # outer ones come first
        if isinstance(node, ast.stmt):
            block = getattr(node, "body", None)
            begin = min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", ()))])
            end = max(begin, block[0].lineno - 1 if block else node.end_lineno or node.lineno)
            if begin <= first and last <= end:
                around = range(begin, end + 1)
    return around


def chosen(path: str, lines: range) -> list[str]:
    """The files of tests that run any of these lines of a file, the quick ones first."""
    known = [(seconds, test) for test, (seconds, run) in _seen().items() if set(run.get(path, ())) & set(lines)]
    return [test for _, test in sorted(known)]


@cache
def _seen() -> Seen:
    seen: Seen = json.loads(KEPT.read_text())
    return seen


if __name__ == "__main__":
    sys.exit(main())
