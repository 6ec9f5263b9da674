"""What a recipe takes from outside this program: programs that it starts, and files that were made elsewhere.

Both come from recipes alone, and a recipe is read only where a person names its file: no scene and no run's folder
starts anything. Their digests are part of the recipe, so that a recompiled program is another recipe.
"""

import re
import shlex
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from testfield.errors import TestfieldError, nearest
from testfield.measure.environment import environment_of
from testfield.store.digests import digest, file_digest

TIME_LIMIT_S = 60.0
MOST_TIME_S = 86_400.0
DETECTOR_GETS = ("image", "image8", "pgm", "sheet", "csv")
CALIBRATOR_GETS = ("observations", "sheet", "json")
RECONSTRUCTOR_GETS = ("observations", "calibration", "sheet", "csv")
"""What stands in braces in a command: files that it reads, and last the one that it writes."""


@dataclass(frozen=True)
class Program:
    """A `command` that is run in the recipe's `folder`, without a shell, for `time_limit_s` at most.

    `files` are the program and whatever of the command is a file, each with its digest, and what is installed in its
    environment, each with its version; `packages` are those that the environment was asked for, whose `python` it has:
    none for that of the caller.
    """

    command: str
    folder: Path
    time_limit_s: float = TIME_LIMIT_S
    files: tuple[tuple[str, str], ...] = ()
    packages: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """What the program is called: of an interpreter's script, the script."""
        words = shlex.split(self.command)
        scripts = [word for word in words[1:] if (self.folder / word).is_file()]
        return Path(scripts[0] if is_python(Path(words[0]).name) and scripts else words[0]).name

    @staticmethod
    def of(
        command: str,
        folder: Path,
        where: str,
        gets: tuple[str, ...],
        time_limit_s: float = TIME_LIMIT_S,
        packages: tuple[str, ...] = (),
    ) -> "Program":
        """The program of a command in a recipe; `gets` are the names that it may have in braces, of which the last
        must be there. Raises `TestfieldError` where it cannot be run."""
        try:
            words = shlex.split(command)
        except ValueError as error:
            raise TestfieldError(f"'{command}' is no command ({error})", where, "close the quotation") from error
        if not words:
            raise TestfieldError("the command is empty", where, "name a program")
        for name in re.findall(r"\{(.*?)\}", command):
            if name not in gets:
                raise TestfieldError(f"'{{{name}}}' stands for nothing", where, nearest(name, gets))
        if f"{{{gets[-1]}}}" not in command:
            raise TestfieldError(
                "the command does not say where its result goes", where, f"write {{{gets[-1]}}} for the file it writes"
            )
        if not 0 < time_limit_s <= MOST_TIME_S:
            raise TestfieldError(
                f"value {time_limit_s:g}", where.replace("command", "time_limit_s"), f"give 0 to {MOST_TIME_S:g} s"
            )
        found = program_of(words[0], folder)
        own = packages and is_python(words[0])
        if found is None and not own:
            raise TestfieldError(f"there is no program '{words[0]}'", where, "give its path, or install it")
        script = next((word for word in words[1:] if not word.startswith("-")), "")
        if is_python(words[0]) and script.endswith(".py") and not (folder / script).is_file():
            raise TestfieldError(f"there is no file '{script}'", where, "name a Python file beside the recipe")
        paths = ([] if own or found is None else [found]) + [folder / word for word in words[1:]]
        files = tuple((path.name, file_digest(path)) for path in paths if path.is_file())
        if packages:
            installed = environment_of(packages, f"{where.partition(',')[0]}, environment.packages")
            files += tuple(sorted(installed.items()))
        return Program(command, folder, time_limit_s, files, packages)


@dataclass(frozen=True)
class Results:
    """A `folder` of files that somebody made elsewhere, with a `digest` of all of them."""

    folder: Path
    digest: str

    @staticmethod
    def of(folder: Path, where: str) -> "Results":
        """Raises `TestfieldError` where there is no such folder, or nothing in it."""
        if not folder.is_dir():
            raise TestfieldError(f"there is no folder '{folder}'", where, "name the folder of the files")
        files = sorted(path for path in folder.rglob("*") if path.suffix in (".csv", ".parquet", ".json"))
        if not files:
            raise TestfieldError(f"there is no CSV, Parquet or JSON file in '{folder}'", where, "put the results there")
        return Results(folder, digest([[str(path.relative_to(folder)), file_digest(path)] for path in files]))


def program_of(word: str, folder: Path) -> Path | None:
    """The file of a program: beside the recipe, or wherever the system finds it; `python` is the one that runs this.

    A link is not followed: an environment's interpreter is one, and knows by its own path whose packages it has.
    """
    beside = folder / word
    if beside.is_file():
        return beside.absolute()
    found = sys.executable if is_python(word) else shutil.which(word)
    return Path(found).absolute() if found else None


def is_python(word: str) -> bool:
    """Whether a command begins with a Python interpreter by its bare name."""
    return re.fullmatch(r"python(3(\.\d+)?)?(\.exe)?", word) is not None
