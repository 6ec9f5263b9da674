"""Where things are kept that can be made again and belong to no folder of anybody's."""

import os
from pathlib import Path


def users_cache() -> Path:
    """The program's folder in the user's cache: `XDG_CACHE_HOME`, on Windows `LOCALAPPDATA`, else ~/.cache."""
    base = os.environ.get("XDG_CACHE_HOME") or (os.environ.get("LOCALAPPDATA") if os.name == "nt" else None)
    return Path(base or Path.home() / ".cache") / "testfield"
