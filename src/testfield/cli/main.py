"""The command `testfield`. Heavy imports happen only after the arguments are parsed."""

import argparse
import os
import sys
from importlib import import_module

from testfield.errors import TestfieldError
from testfield.store.disk import spoken
from testfield.store.text import speak_in_any_locale

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
    """Run one command; the exit status is 0, 1 for a verdict that fails, 2 for something the user can mend, 130 where
    interrupted."""
    speak_in_any_locale()
    args = parser().parse_args(arguments)
    try:
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


def _refused(error: TestfieldError) -> int:
    try:
        sys.stdout.flush()
    except OSError:
        _silence()
    print(f"testfield: {' '.join(error.sentence().split())}", file=sys.stderr)
    return 2


def _silence() -> None:
    """What is left in the buffer of standard output goes nowhere, so that Python does not try again at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


if __name__ == "__main__":
    sys.exit(main())
