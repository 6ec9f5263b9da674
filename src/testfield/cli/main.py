"""The command `testfield`. Heavy imports happen only after the arguments are parsed."""

import argparse
import os
import sys
from importlib import import_module

from testfield.errors import TestfieldError

COMMANDS = (
    "run", "stage", "detect", "measure", "uncertainty", "accept", "study", "validate", "preview", "certify", "bench",
    "codes", "list", "schema",
)  # fmt: skip


def parser() -> argparse.ArgumentParser:
    """The parser with all commands."""
    top = argparse.ArgumentParser(
        prog="testfield",
        description="A rendered test field for vision metrology: "
        "from a scene file to images, measured and scored against the truth.",
    )
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in COMMANDS:
        import_module(f"testfield.cli.{name}").add(commands)
    return top


def main(arguments: list[str] | None = None) -> int:
    """Run one command; the exit status is 0, 2 for something the user can mend, 130 where interrupted."""
    args = parser().parse_args(arguments)
    try:
        return args.act(args)
    except TestfieldError as error:
        print(f"testfield: {error.sentence()}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\ntestfield: interrupted; the same command continues from here", file=sys.stderr)
        return 130
    except BrokenPipeError:
        # The reader of a pipe has gone; Python would complain once more when it closes standard output.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


if __name__ == "__main__":
    sys.exit(main())
