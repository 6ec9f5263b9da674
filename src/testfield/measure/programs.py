"""Runs somebody else's program: no shell, a group of its own, a time limit, and a limit on what it writes.

Whatever goes wrong is a `TestfieldError` with the program's own last words, which a comparison counts as a failure.
"""

import contextlib
import shlex
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from testfield.errors import TestfieldError
from testfield.measure.blame import Crashed, TimedOut
from testfield.measure.environment import python_of, variables_of
from testfield.measure.keeper import end, keeper
from testfield.measure.outside import Program, is_python, program_of
from testfield.store.memory import look_at

MOST_BYTES = 256 * 1024 * 1024
"""Of all that a program writes at once."""
LOOK_S = 0.02
WORDS = 300
"""Characters of a program's own words that are repeated."""


def run_program(program: Program, files: Mapping[str, Path], work: Path, about: str) -> None:
    """Run a program, `files` in the place of the names in braces; `work` is a folder of its own for what it says.

    `about` names the image or scene in errors. Raises `TestfieldError` where it cannot be started, does not end within
    its time, ends with another status than 0, or writes beyond all measure. Where this process is itself ended
    meanwhile, even by SIGKILL, the program is too, and `work` is removed.
    """
    words = [_filled(word, files) for word in shlex.split(program.command)]
    words[0] = str(_first(program, words[0]))
    where, said = f"{program.name}, {about}", work / "said.txt"
    with keeper(work) as keep:
        with said.open("wb") as output:
            try:
                process = subprocess.Popen(
                    words,
                    cwd=program.folder,
                    stdin=subprocess.DEVNULL,
                    stdout=output,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                    env=variables_of(program.packages),
                )
            except OSError as error:
                raise TestfieldError(f"it cannot be started ({error.strerror})", where, "make it a program") from error
        try:
            keep(process.pid)
            _wait(process, program.time_limit_s, work, where)
        finally:
            end(process)
    if process.returncode:
        raise Crashed(f"it {_how(process.returncode)}{_own_words(said)}", where, "mend the program")


def result_of(program: Program, files: Mapping[str, Path], work: Path, about: str, wanted: str) -> Path:
    """Run a program, arguments as of `run_program`, and give the file `wanted` of its `files` that it wrote.

    Raises `TestfieldError` as `run_program` does, and where it wrote none.
    """
    run_program(program, files, work, about)
    if not files[wanted].is_file():
        raise TestfieldError("it ended and wrote no result", f"{program.name}, {about}", f"write the file {{{wanted}}}")
    return files[wanted]


@contextlib.contextmanager
def said_of(program: Program, file: Path) -> Iterator[None]:
    """What is wrong within with a `file` of a program's is said of the program: its folder is gone afterwards."""
    try:
        yield
    except TestfieldError as error:
        where = f"{program.name}, {error.where.replace(str(file), file.name)}"
        raise TestfieldError(error.what, where, error.do) from error


def _first(program: Program, word: str) -> Path:
    if program.packages and is_python(word):
        return python_of(program.packages)
    return program_of(word, program.folder) or Path(word)


def _filled(word: str, files: Mapping[str, Path]) -> str:
    for name, path in files.items():
        word = word.replace(f"{{{name}}}", str(path))
    return word


def _wait(process: subprocess.Popen, limit_s: float, work: Path, where: str) -> None:
    end = time.monotonic() + limit_s
    look = LOOK_S
    while process.poll() is None:
        look_at(process.pid)
        if time.monotonic() > end:
            raise TimedOut(
                f"it did not end within {limit_s:g} s{_own_words(work / 'said.txt')}", where, "raise time_limit_s"
            )
        if _bytes_in(work) > MOST_BYTES:
            raise Crashed(f"it writes more than {MOST_BYTES:,} bytes", where, "write results alone")
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(min(look, max(end - time.monotonic(), 0.001)))
        look = min(2 * look, 0.5)


def _bytes_in(work: Path) -> int:
    size = 0
    for path in work.iterdir():
        with contextlib.suppress(FileNotFoundError):  # the program has renamed or removed it since
            size += path.stat().st_size if path.is_file() else 0
    return size


def _how(status: int) -> str:
    if status > 0:
        return f"ended with exit status {status}"
    with contextlib.suppress(ValueError):
        return f"was ended by {signal.Signals(-status).name}"
    return f"was ended by signal {-status}"


def _own_words(said: Path) -> str:
    """The last lines that a program wrote, for a sentence."""
    with said.open("rb") as file:
        file.seek(max(0, said.stat().st_size - 4096))
        lines = [" ".join(line.split()) for line in file.read().decode(errors="replace").splitlines()]
    text = " / ".join(line for line in lines[-4:] if line)
    text = "".join(letter if letter.isprintable() else "?" for letter in text)[-WORDS:]
    return f" and says '{text}'" if text else " and says nothing"
