"""What cases found, kept: a file of rows for each under the digest of the case and of the code that measured it."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from io import BytesIO
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from testfield.store.objects import Objects

UNDER = "cases"
SECONDS = b"testfield.seconds"
"""What the schema's metadata call the time that a case took."""
AT_ONCE = 32
"""Files asked of object storage at a time: each takes tens of milliseconds to answer."""
LIST_SHARE = 0.05
"""The part of the time that may go into listing what is finished."""
NAME = 32
"""Digits of a key in the name of its file."""


@dataclass(frozen=True)
class Found:
    """The rows of a case, and the time they took (s); not a number where it is not known."""

    rows: pd.DataFrame
    seconds: float


@dataclass
class KeptRows:
    """Rows of finished cases in a place that several machines may see. Travels to other processes."""

    place: Objects
    _names: set[str] = field(default_factory=set, repr=False)
    _listed: float = field(default=-float("inf"), repr=False)
    _pause_s: float = field(default=0.0, repr=False)

    def file(self, key: str) -> str:
        """The name of the file of a case's rows."""
        return f"{UNDER}/{key[:NAME]}.parquet"

    def write(self, key: str, rows: list[dict[str, Any]], seconds: float) -> None:
        """Keep what a case found. Raises as `Objects.write` does."""
        table = pa.Table.from_pandas(pd.DataFrame(rows), preserve_index=False)
        table = table.replace_schema_metadata((table.schema.metadata or {}) | {SECONDS: f"{seconds:.6g}".encode()})
        content = BytesIO()
        # Of one row, dictionaries, statistics and compression only cost time.
        pq.write_table(table, content, use_dictionary=False, write_statistics=False, compression="none")
        self.place.write(self.file(key), content.getvalue())

    def read(self, key: str) -> Found | None:
        """What is kept of a case, or None where there is nothing that can be read."""
        try:
            table = pq.ParquetFile(BytesIO(self.place.read(self.file(key)))).read()
            seconds = float((table.schema.metadata or {}).get(SECONDS, b"nan"))
            return Found(table.to_pandas(), seconds)
        except (OSError, ValueError):
            return None

    def read_all(self, keys: Sequence[str]) -> Iterator[Found | None]:
        """What is kept of each case, in order; only what one listing names is asked for."""
        there = self.list()
        wanted = [key if f"{key[:NAME]}.parquet" in there else None for key in keys]
        if self.place.folder is not None:
            yield from (None if key is None else self.read(key) for key in wanted)
            return
        with ThreadPoolExecutor(AT_ONCE) as threads:
            yield from threads.map(lambda key: None if key is None else self.read(key), wanted)

    def there(self, key: str) -> bool:
        """Whether rows are kept of a case, asked for it alone."""
        return self.place.there(self.file(key))

    def seen(self, key: str) -> bool:
        """Whether rows are kept of a case, as the last listing has it; lists again when that has become cheap."""
        if time.monotonic() - self._listed > self._pause_s:
            self.list()
        return f"{key[:NAME]}.parquet" in self._names

    def list(self) -> set[str]:
        """Names of the files of all finished cases."""
        begun = time.monotonic()
        self._names = self.place.names(UNDER)
        self._listed = time.monotonic()
        self._pause_s = (self._listed - begun) / LIST_SHARE
        return self._names

    def remove(self, key: str) -> None:
        """Take away what is kept of a case."""
        self.place.remove(self.file(key))

    def __getstate__(self) -> dict[str, Any]:
        return {"place": self.place, "_names": set(), "_listed": -float("inf"), "_pause_s": 0.0}


class Reader:
    """Reads rows of cases as they are finished, while others are still at work: a hundred thousand files are not left
    to the end."""

    def __init__(self, kept: KeptRows):
        self.kept = kept
        self._threads = ThreadPoolExecutor(AT_ONCE if kept.place.folder is None else 1)
        self._asked: dict[str, Future[Found | None]] = {}

    def ask(self, key: str) -> None:
        """Begin to read what is kept of a case."""
        self._asked[key] = self._threads.submit(self.kept.read, key)

    def take(self, key: str) -> Found | None:
        """What is kept of a case, or None where there is nothing that can be read."""
        asked = self._asked.pop(key, None)
        return (asked and asked.result()) or self.kept.read(key)

    def __enter__(self) -> "Reader":
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(cancel_futures=True)
