"""The command `testfield`. Heavy imports happen only after the arguments are parsed."""

import argparse
import os
import sys
import textwrap
from importlib import import_module
from pathlib import Path
from typing import Any

from testfield.cli.once import Command
from testfield.errors import TestfieldError, faults_in
from testfield.registry import load_file
from testfield.store.disk import spoken
from testfield.store.text import speak_in_any_locale
from testfield.version import __version__

MODULES = (
    "run",
    "stage",
    "detect",
    "measure",
    "field",
    "sensor",
    "twin",
    "uncertainty",
    "accept",
    "compare",
    "sweep",
    "regress",
    "export",
    "new",
    "study",
    "validate",
    "preview",
    "view",
    "print",
    "plan",
    "certify",
    "bench",
    "worker",
    "codes",
    "list",
    "schema",
    "completion",
)
"""Modules of this package, each of which enters one command or more."""

GROUPS = {
    "scenes": ("new", "validate", "preview", "view", "plan", "run", "print"),
    "what a run holds": ("accept", "uncertainty"),
    "one stage of a run": ("render", "expose", "detect", "calibrate", "reconstruct", "score", "report"),
    "photographs": ("measure", "field", "twin", "sensor", "codes"),
    "ways to measure": ("compare", "sweep", "regress", "export", "study"),
    "the program itself": ("certify", "bench", "worker"),
    "to look up": ("list", "schema", "completion"),
}
"""Commands in the order in which they are shown."""

DESCRIPTION = (
    "A rendered test field for vision metrology: a scene becomes images, measured and scored against the truth."
)


class Overview(argparse.ArgumentParser):
    """The parser of the command itself, which shows all commands in groups."""

    def __init__(self) -> None:
        super().__init__(prog="testfield", description=DESCRIPTION)
        self.add_argument("--version", action="version", version=f"testfield {__version__}")
        self.commands = Commands(self.add_subparsers(dest="command", metavar="COMMAND", parser_class=Command))

    def format_help(self) -> str:
        """Usage, commands by group, and options."""
        grouped = {name for names in GROUPS.values() for name in names}
        others = tuple(name for name in self.commands.help if name not in grouped)
        lines = [self.format_usage(), DESCRIPTION]
        for group, names in (GROUPS | ({"more": others} if others else {})).items():
            lines += ["", f"{group}:"]
            for name in names:
                what = textwrap.wrap(self.commands.help[name], 94)
                lines += [f"  {name:<13} {what[0]}", *(f"{'':<16}{more}" for more in what[1:])]
        lines += ["", "testfield COMMAND --help shows the options of a command, testfield --version the version.", ""]
        return "\n".join(lines)


class Commands:
    """Where modules enter their commands; remembers what each is for."""

    def __init__(self, action: Any) -> None:
        self.action = action
        self.help: dict[str, str] = {}

    def add_parser(self, name: str, *, help: str, **options: Any) -> argparse.ArgumentParser:
        """A parser for the command of that name."""
        self.help[name] = help
        added: argparse.ArgumentParser = self.action.add_parser(name, help=help, **options)
        return added


def parser() -> Overview:
    """The parser with all commands."""
    top = Overview()
    for name in MODULES:
        import_module(f"testfield.cli.{name}").add(top.commands)
    return top


def main(arguments: list[str] | None = None) -> int:
    """Run one command; the exit status is 0, 1 for a verdict that fails, 2 for something the user can mend, 3 for a
    regression that is not decided, 130 where interrupted. Without a command, all of them are shown."""
    speak_in_any_locale()
    args = argparse.Namespace()
    try:
        load_named(sys.argv[1:] if arguments is None else arguments)
        top = parser()
        args = top.parse_args(arguments)
        if args.command is None:
            top.print_help()
            return 0
        status = args.act(args)
        sys.stdout.flush()
        return status
    except TestfieldError as error:
        return _refused(error)
    except KeyboardInterrupt:
        print("\ntestfield: interrupted; the same command continues from here", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader of a pipe has gone; Python would complain once more when it closes standard output.
        _silence()
        return 0
    except OSError as error:
        folder = getattr(args, "out", None) or getattr(args, "run", None) or ""
        spoken_error = spoken(error)
        if not spoken_error.where:
            spoken_error = TestfieldError(spoken_error.what, str(folder), spoken_error.do)
        return _refused(spoken_error)
    except MemoryError:
        return _refused(TestfieldError("this needs more memory than there is", "", "make it smaller"))


def load_named(arguments: list[str]) -> None:
    """Load the Python files that a command names by `--load`, before its options offer the names they add.

    Raises `TestfieldError` where one cannot be imported.
    """
    early = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    early.add_argument("--load", type=Path, action="append", default=[], nargs="?")
    for path in early.parse_known_args(arguments)[0].load:
        if path is not None:
            load_file(path)


def _refused(error: TestfieldError) -> int:
    try:
        sys.stdout.flush()
    except OSError:
        _silence()
    for k, fault in enumerate(faults_in(error)):
        print(f"{'' if k else 'testfield: '}{' '.join(fault.sentence().split())}", file=sys.stderr)
    return 2


def _silence() -> None:
    """What is left in the buffer of standard output goes nowhere, so that Python does not try again at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
