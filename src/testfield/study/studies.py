"""The studies by name."""

from importlib import import_module

from testfield.errors import TestfieldError
from testfield.study.study import Study

STUDIES = ("wls", "grey", "fitting_point", "stitching")


def find_study(name: str) -> Study:
    """The study of that name."""
    if name not in STUDIES:
        raise TestfieldError(f"no study is called '{name}'", "study", f"choose one of {', '.join(STUDIES)}")
    return import_module(f"testfield.study.{name}.page").STUDY
