"""The studies by name, found through Python entry points.

A user adds one in their own package: name its `Study` in the entry-point group `testfield.studies`.
"""

from importlib.metadata import entry_points

from testfield.errors import TestfieldError
from testfield.study.study import Study

GROUP = "testfield.studies"


def study_names() -> list[str]:
    """The names of all studies that are installed."""
    return sorted({point.name for point in entry_points(group=GROUP)})


def find_study(name: str) -> Study:
    """The study of that name. Raises `TestfieldError` where none is installed under it."""
    for point in entry_points(group=GROUP):
        if point.name == name:
            return point.load()
    raise TestfieldError(f"no study is called '{name}'", "study", f"choose one of {', '.join(study_names())}")
