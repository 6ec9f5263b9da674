"""`testfield completion SHELL`: a script by which the shell completes commands, options and file names."""

import argparse
from pathlib import Path
from typing import Any

SHELLS = ("bash", "zsh", "tcsh")


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "completion",
        help="a script by which the shell completes commands, options and file names",
        description='Prints a script for the shell. In ~/.bashrc: eval "$(testfield completion bash)"',
    )
    p.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    from testfield.cli.main import parser

    top = parser()
    _complete_paths(top, shtab.FILE)
    print(shtab.complete(top, args.shell))
    return 0


def _complete_paths(parser: argparse.ArgumentParser, files: Any) -> None:
    """Whatever is a path is completed with the names of files."""
    for action in parser._actions:
        if action.type is Path:
            action.complete = files  # type: ignore[attr-defined]
        if isinstance(action.choices, dict):
            for inner in action.choices.values():
                _complete_paths(inner, files)
