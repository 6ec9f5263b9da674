"""A maker's own table of ring codes: which number has which word, as a value and as a file (CSV or TOML)."""

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from testfield.errors import TestfieldError
from testfield.store.text import decoded
from testfield.store.toml import parse_toml, read_toml
from testfield.targets.ring_code import BITS, number_of_word, smallest_rotation, word_of_number

FEWEST_BITS, MOST_BITS = 6, 24
LARGEST_NUMBER = 99_999
CLOCKWISE, COUNTERCLOCKWISE = "clockwise", "counterclockwise"
SHIPPED = Path(__file__).parent / "tables"
SEE = "see scenes/README.md, code tables"


@dataclass(frozen=True)
class CodeTable:
    """n codes of `bits` segments: their numbers, ascending, and their `words` as printed: the bits of the segments
    clockwise from the first, most significant first. `name` and `source` say whose they are."""

    bits: int
    numbers: tuple[int, ...]
    words: tuple[int, ...]
    name: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        for fault in faults_in_codes(self.bits, self.numbers, self.words):
            raise ValueError(fault[1])
        order = np.argsort(self.numbers)
        object.__setattr__(self, "numbers", tuple(int(self.numbers[k]) for k in order))
        object.__setattr__(self, "words", tuple(int(self.words[k]) for k in order))

    @cached_property
    def _by_rotation(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest rotations, ascending, and the rows that have them."""
        smallest = smallest_rotation(np.array(self.words, np.uint32), self.bits)
        order = np.argsort(smallest)
        return smallest[order], order

    @cached_property
    def half_tells(self) -> bool:
        """Whether every word has two opposite segments that are bright, so that half of a ring shows that it is one."""
        half = self.bits // 2
        return self.bits % 2 == 0 and all(word & (word >> half) & ((1 << half) - 1) for word in self.words)

    def word_of_number(self, numbers: np.ndarray) -> np.ndarray:
        """Words as printed (uint32) of numbers in any shape. Raises `ValueError` where a number does not exist."""
        numbers, known = np.asarray(numbers, int), np.array(self.numbers)
        row = np.minimum(np.searchsorted(known, numbers), len(known) - 1)
        if np.any(known[row] != numbers):
            raise ValueError(f"{self.title} has no number {numbers[known[row] != numbers].ravel()[0]}")
        return np.array(self.words, np.uint32)[row]

    def number_of_word(self, words: np.ndarray) -> np.ndarray:
        """Numbers of words in any rotation; 0 where a word is none of the table's."""
        table, rows = self._by_rotation
        smallest = smallest_rotation(words, self.bits)
        index = np.minimum(np.searchsorted(table, smallest), len(table) - 1)
        return np.where(table[index] == smallest, np.array(self.numbers)[rows[index]], 0)

    @property
    def title(self) -> str:
        """What messages call it."""
        return f"the code table '{self.name}'" if self.name else "the code table"

    @cached_property
    def mirrored(self) -> tuple[tuple[int, int], ...]:
        """Pairs of numbers (a, b), a <= b, of which each read the wrong way round is the other."""
        words = np.array(self.words, np.uint32)
        back = np.array([int(f"{word:0{self.bits}b}"[::-1], 2) for word in words.tolist()], np.uint32)
        pairs = zip(self.numbers, self.number_of_word(back).tolist(), strict=True)
        return tuple((a, b) for a, b in pairs if b and a <= b)

    def sheet(self) -> dict[str, Any]:
        """As a table of JSON, from which `of_sheet` makes the same."""
        words = [f"{word:0{self.bits}b}" for word in self.words]
        return {"name": self.name, "source": self.source, "number": list(self.numbers), "word": words}


def of_sheet(sheet: dict[str, Any]) -> CodeTable:
    """What `sheet` wrote. Raises `ValueError`."""
    words = sheet["word"]
    if not words or any(not re.fullmatch("[01]+", word) or len(word) != len(words[0]) for word in words):
        raise ValueError("the words of the code table are not all of one length, in 0 and 1")
    if len(words) != len(sheet["number"]):
        raise ValueError(f"the code table has {len(sheet['number'])} numbers and {len(words)} words")
    values = tuple(int(word, 2) for word in words)
    return CodeTable(len(words[0]), tuple(sheet["number"]), values, sheet["name"], sheet["source"])


def words_of(numbers: np.ndarray, bits: int, codes: CodeTable | None) -> np.ndarray:
    """Words as printed of numbers in a table, or in that of so many bits where there is none."""
    return word_of_number(numbers, bits) if codes is None else codes.word_of_number(numbers)


def numbers_of(words: np.ndarray, bits: int, codes: CodeTable | None) -> np.ndarray:
    """Numbers of words in any rotation; 0 where a word is none of the table's."""
    return number_of_word(words, bits) if codes is None else codes.number_of_word(words)


def faults_in_codes(bits: int, numbers: Sequence[int], words: Sequence[int]) -> list[tuple[int, str]]:
    """Rows of a table that cannot be, and why."""
    if not FEWEST_BITS <= bits <= MOST_BITS:
        return [(0, f"words have {bits} bits, and {FEWEST_BITS} to {MOST_BITS} can be read")]
    found: list[tuple[int, str]] = []
    owner: dict[int, int] = {}
    seen: set[int] = set()
    for row, (number, word) in enumerate(zip(numbers, words, strict=True)):
        if not 1 <= number <= LARGEST_NUMBER:
            found.append((row, f"number {number}: codes are numbered 1 to {LARGEST_NUMBER}; 0 is a dot without a code"))
        if number in seen:
            found.append((row, f"number {number} is there twice"))
        seen.add(number)
        if not 0 <= word < 1 << bits:
            found.append((row, f"word {word} of number {number} has more than {bits} bits"))
            continue
        if word in (0, (1 << bits) - 1):
            found.append((row, f"the word of number {number} is all {word & 1}: its ring has no segment that ends"))
            continue
        smallest = int(smallest_rotation(np.array([word], np.uint32), bits)[0])
        if smallest in owner:
            found.append((row, f"the words of numbers {owner[smallest]} and {number} are one ring, turned"))
        owner.setdefault(smallest, number)
    return found if len(words) else [(0, "no codes are listed")]


def table_path(file: str, folder: Path = Path()) -> Path:
    """The file of a table that a person names: relative to a folder, or one that is shipped, by its name."""
    shipped = SHIPPED / f"{file}.csv"
    return (
        shipped if not (folder / file).exists() and re.fullmatch(r"\w+", file) and shipped.is_file() else folder / file
    )


def load_code_table(path: Path) -> CodeTable:
    """Read a table (.csv with number, word and perhaps start and direction; .toml alike).

    Raises `TestfieldError` that names file, line or entry, and what is wrong.
    """
    content = read_toml(path, "code table")
    if path.suffix.lower() == ".toml":
        head, rows = _of_toml(parse_toml(content, str(path)), str(path))
    else:
        head, rows = _of_csv(decoded(content), str(path))
    if not rows:
        raise TestfieldError("no codes are listed", str(path), f"give a number and a word for each; {SEE}")
    bits, binary = _bits(head, rows, str(path))
    numbers, words = [], []
    for where, row in rows:
        number, word = _whole(row.get("number"), "number", where), str(row.get("word", "")).strip()
        if binary and not (re.fullmatch("[01]+", word) and len(word) == bits):
            raise TestfieldError(f"word {word} is not {bits} digits 0 and 1", where, "as the others are")
        value = int(word, 2) if binary else _whole(word, "word", where)
        if not 0 <= value < 1 << bits:
            raise TestfieldError(f"word {word} has more than {bits} bits", where, "mend it, or bits")
        start = _whole(row.get("start") or head.get("start") or 0, "start", where)
        if not 0 <= start < bits:
            raise TestfieldError(f"start {start}: segments are counted 0 to {bits - 1}", where, "mend it")
        direction = str(row.get("direction") or head.get("direction") or CLOCKWISE).strip()
        if direction not in (CLOCKWISE, COUNTERCLOCKWISE):
            raise TestfieldError(f"direction {direction}", where, f"write {CLOCKWISE} or {COUNTERCLOCKWISE}")
        numbers.append(number)
        words.append(_printed(value, bits, start, direction))
    if faults := faults_in_codes(bits, numbers, words):
        row_of, why = faults[0]
        more = f" ({len(faults) - 1} more of the kind)" if len(faults) > 1 else ""
        raise TestfieldError(why + more, rows[row_of][0], "mend the table")
    return CodeTable(
        bits, tuple(numbers), tuple(words), str(head.get("name") or path.stem), str(head.get("source", ""))
    )


def codes_for(named: str | None, bits: int, where: str, folder: Path = Path()) -> CodeTable | None:
    """The table that a person names at a place for rings of so many bits, `bits` 0 for targets that are none.

    Raises `TestfieldError` where it is for other rings, or where none is named and there is none for so many bits."""
    if named is None:
        if bits and bits not in BITS:
            own = ", ".join(map(str, BITS))
            raise TestfieldError(
                f"rings of {bits} bits have no table of their own, as those of {own} have", where, f"name one; {SEE}"
            )
        return None
    table = load_code_table(table_path(named, folder))
    if table.bits != bits:
        raise TestfieldError(f"the words of {table.title} have {table.bits} bits", where, f"write ring{table.bits}")
    return table


def _printed(word: int, bits: int, start: int, direction: str) -> int:
    """The bits of the segments clockwise from the first, of a word whose first bit is in segment `start`."""
    sense, printed = 1 if direction == CLOCKWISE else -1, 0
    for k in range(bits):
        if word >> (bits - 1 - k) & 1:
            printed |= 1 << (bits - 1 - (start + sense * k) % bits)
    return printed


Rows = list[tuple[str, dict[str, Any]]]


def _of_csv(text: str, where: str) -> tuple[dict[str, Any], Rows]:
    """What the comments before the head of columns say (`# bits: 12`), and each line with where it stands."""
    head: dict[str, Any] = {}
    lines = []
    for k, line in enumerate(text.splitlines(), 1):
        if said := re.match(r"#\s*(name|source|bits|start|direction)\s*[:=]\s*(.*)", line):
            head[said[1]] = said[2].strip()
        elif line.strip() and not line.startswith("#"):
            lines.append((k, line))
    if not lines:
        return head, []
    mark = next((one for one in ";\t," if one in lines[0][1]), ",")
    columns, *values = csv.reader([line for _, line in lines], delimiter=mark)
    columns = [column.strip().lower() for column in columns]
    if missing := {"number", "word"} - set(columns):
        raise TestfieldError(
            f"no column is called {' or '.join(sorted(missing))}", f"{where}:{lines[0][0]}", f"name it; {SEE}"
        )
    rows: Rows = []
    for (k, _), value in zip(lines[1:], values, strict=True):
        if len(value) != len(columns):
            raise TestfieldError(f"{len(value)} values in {len(columns)} columns", f"{where}:{k}", "mend the line")
        rows.append((f"{where}:{k}", dict(zip(columns, (one.strip() for one in value), strict=True))))
    return head, rows


def _of_toml(data: dict[str, Any], where: str) -> tuple[dict[str, Any], Rows]:
    codes = data.get("codes")
    if not isinstance(codes, list) or not all(isinstance(code, dict) for code in codes):
        raise TestfieldError("no [[codes]] are listed", where, f"give number and word for each; {SEE}")
    return data, [(f"{where}, codes[{k}]", code) for k, code in enumerate(codes)]


def _bits(head: dict[str, Any], rows: Rows, where: str) -> tuple[int, bool]:
    """How many bits words have, and whether they are written in 0 and 1: decimal ones need to be told."""
    words = [str(row.get("word", "")).strip() for _, row in rows]
    told = _whole(head["bits"], "bits", where) if "bits" in head else None
    if told is not None and not FEWEST_BITS <= told <= MOST_BITS:
        raise TestfieldError(f"bits {told}", where, f"{FEWEST_BITS} to {MOST_BITS} can be read")
    lengths = Counter(len(word) for word in words if re.fullmatch("[01]+", word))
    binary = sum(bool(re.fullmatch("[01]{6,}", word)) for word in words) > len(words) / 2
    if not binary and told is None:
        raise TestfieldError("words are decimal, and nothing says of how many bits", where, "add `# bits: 12`")
    return (lengths.most_common(1)[0][0] if told is None else told), binary


def _whole(value: Any, what: str, where: str) -> int:
    try:
        if isinstance(value, bool | float):
            raise ValueError
        return int(value)
    except (TypeError, ValueError):
        raise TestfieldError(f"{what} {value} is no whole number", where, "mend it") from None
