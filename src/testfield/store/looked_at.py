"""What was found out about sources by reading them, kept by their bytes: each command looks at hundreds of files.

Kept beside Python's own compiled files. Where that cannot be written, or what is there cannot be read, sources are read
again each time.
"""

import hashlib
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from testfield.store.atomic import whole

MOST = 4000
"""So many sources are kept: those of a few versions."""


class LookedAt:
    """What `look` finds in a source, plain data for JSON, kept in `path`; it counts as long as `look` itself, whose
    own source is `by`, stays as it is."""

    def __init__(self, path: Path, by: bytes, look: Callable[[bytes], Any]):
        self.path, self.look = path, look
        self.of = hashlib.sha256(by + repr(sys.version_info[:2]).encode()).hexdigest()
        self.found: dict[str, Any] | None = None
        self.new = False

    def at(self, source: bytes) -> Any:
        """What there is in a source."""
        if self.found is None:
            self.found = self._kept()
        key = hashlib.sha256(source).hexdigest()
        if key not in self.found:
            self.found[key] = self.look(source)
            self.new = True
        return self.found[key]

    def keep(self) -> None:
        """Write what is new."""
        if not self.new or self.found is None:
            return
        self.new = False
        try:
            with whole(self.path) as part:
                part.write_text(json.dumps({"of": self.of, "found": dict(list(self.found.items())[-MOST:])}))
        except OSError:
            pass  # it is found out again next time

    def _kept(self) -> dict[str, Any]:
        try:
            kept = json.loads(self.path.read_bytes())
            return dict(kept["found"]) if kept["of"] == self.of else {}
        except (OSError, ValueError, LookupError, TypeError):
            return {}
