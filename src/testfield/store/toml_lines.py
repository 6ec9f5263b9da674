"""On which line of a TOML text each value stands, so that a complaint can name it. The reader of TOML does not say."""

import re
import tomllib
from collections.abc import Iterator

Location = tuple[str | int, ...]
"""Keys and numbers in lists that lead to a value: ("boards", 2, "size_mm")."""

TOKEN = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}'
    r"|'''.*?'{3,5}"
    r'|"(?:\\.|[^"\\\n])*"'
    r"|'[^'\n]*'"
    r"|\#[^\n]*|[\[\]{}=,.\n]|[^\s\[\]{}=,.\#\"']+",
    re.S,
)
"""Texts of four kinds, comments, marks, ends of lines, and bare words."""
PLACE = re.compile(r"[A-Za-z_][\w-]*|(?<=\[)\d+(?=\])")


class Lines:
    """Lines of all values of a text that is valid TOML, counted from 1."""

    def __init__(self, text: str):
        self.of: dict[Location, int] = {}
        self._entries: dict[Location, int] = {}  # how many each list of tables has so far
        self._tokens = list(_tokens(text))
        self._next = 0
        self._read()

    def at(self, location: Location) -> int | None:
        """The line of a value or, where it is absent, of the table or list in which it would stand."""
        for length in range(len(location), 0, -1):
            if location[:length] in self.of:
                return self.of[location[:length]]
        return None

    def of_place(self, place: str) -> int | None:
        """The line of a place as messages write it: `boards[2].size_mm`."""
        return self.at(location_of(place))

    def _read(self) -> None:
        table: Location = ()
        while self._next < len(self._tokens):
            token, line = self._take()
            if token == "[":
                table = self._header(line)
            elif token != "\n":
                self._next -= 1
                self._pair(table)

    def _take(self) -> tuple[str, int]:
        self._next += 1
        return self._tokens[self._next - 1]

    def _peek(self) -> str:
        return self._tokens[self._next][0] if self._next < len(self._tokens) else "\n"

    def _header(self, line: int) -> Location:
        listed = self._peek() == "["
        if listed:
            self._take()
        *above, name = self._key("]")
        if listed:
            self._take()
        table: Location = ()
        for part in above:
            table = self._last((*table, part))
        table = (*table, name)
        self.of.setdefault(table, line)
        if listed:
            count = self._entries.get(table, 0)
            self._entries[table] = count + 1
            table = (*table, count)
            self.of[table] = line
        return table

    def _last(self, table: Location) -> Location:
        """The last entry of a list of tables, or the table itself."""
        count = self._entries.get(table, 0)
        return (*table, count - 1) if count else table

    def _pair(self, table: Location) -> None:
        line = self._tokens[self._next][1]
        for part in self._key("="):
            table = (*table, part)
            self.of.setdefault(table, line)
        self._value(table)

    def _key(self, end: str) -> list[str]:
        parts = []
        while (token := self._take()[0]) != end:
            if token[0] in "\"'":
                parts.append(str(tomllib.loads(f"key = {token}")["key"]))
            elif token != ".":
                parts.append(token)
        return parts

    def _value(self, place: Location) -> None:
        token, line = self._take()
        self.of[place] = line
        if token == "[":
            self._list(place)
        elif token == "{":
            self._inline_table(place)
        else:
            while self._peek() not in ("\n", ",", "]", "}"):
                self._take()  # the rest of a number with a point, of a date with spaces

    def _list(self, place: Location) -> None:
        count = 0
        while (token := self._peek()) != "]":
            if token in ("\n", ","):
                self._take()
            else:
                self._value((*place, count))
                count += 1
        self._take()

    def _inline_table(self, place: Location) -> None:
        while (token := self._peek()) != "}":
            if token in ("\n", ","):
                self._take()
            else:
                self._pair(place)
        self._take()


def location_of(place: str) -> Location:
    """The location of a place as messages write it: `boards[2].size_mm`, with more words behind it or without."""
    words = place.split(" ", 1)[0].rstrip(",")
    return tuple(int(key) if key.isdigit() else key for key in PLACE.findall(words))


def _tokens(text: str) -> Iterator[tuple[str, int]]:
    line, end = 1, 0
    for match in TOKEN.finditer(text):
        line += text.count("\n", end, match.start())
        token = match.group()
        if token[0] != "#":
            yield token, line
        line += token.count("\n")
        end = match.end()
