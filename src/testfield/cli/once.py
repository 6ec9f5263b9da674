"""Parsers of commands that refuse an option given twice, where Python's own let the last one win in silence."""

import argparse
from collections.abc import Sequence
from typing import Any


class Command(argparse.ArgumentParser):
    """A parser of one command; those of its tools are alike."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.register("action", None, _Once)
        self.register("action", "store", _Once)
        self.given: set[str] = set()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As of `ArgumentParser`; nothing has been given before."""
        self.given = set()
        return super().parse_known_args(args, namespace)


class _Once(argparse._StoreAction):
    """Keeps a value, and refuses another."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Keep `values`. Ends the program with status 2 where the option had some before."""
        if option_string is not None and isinstance(parser, Command):
            if self.dest in parser.given:
                before = getattr(namespace, self.dest)
                parser.error(f"{option_string} is given twice, {_said(before)} and {_said(values)}: give it once")
            parser.given.add(self.dest)
        super().__call__(parser, namespace, values, option_string)


def _said(value: Any) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else f"'{value}'"
