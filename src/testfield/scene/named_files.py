"""Files that a scene names, and the copies of them in a run's folder."""

from pathlib import Path


def named_file(file: str, copy: str, folder: Path) -> Path:
    """Where a file is: as the scene in `folder` names it or, in a run's folder, the copy made when it was run."""
    named = folder / file
    return named if named.exists() or not (folder / copy).is_file() else folder / copy
