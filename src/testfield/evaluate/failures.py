"""Why a recipe gave no figures, by kind: failures are results, counted and never dropped."""

import subprocess
from enum import Enum
from typing import Any

import numpy as np

from testfield.errors import TestfieldError

FAILURE, KIND, STAGE = "failure", "failure_kind", "failure_stage"
"""Columns: the sentence that says why a case gave no figures, its kind, and the stage at which it came."""


class Kind(Enum):
    """What kind of failure."""

    REFUSED = "refused"
    TIMED_OUT = "timed out"
    NOT_CONVERGED = "not converged"
    CRASHED = "crashed"


def kind_of(error: Exception) -> Kind:
    """The kind of an error. One that speaks was refused, unless it says itself what it is (`kind`, as a word of
    `Kind`) or was caused by the end of a time limit; all others crashed."""
    if any(isinstance(one, (TimeoutError, subprocess.TimeoutExpired)) for one in (error, error.__cause__)):
        return Kind.TIMED_OUT
    said = getattr(error, "kind", None)
    if said in {kind.value for kind in Kind}:
        return Kind(said)
    return Kind.REFUSED if isinstance(error, TestfieldError) else Kind.CRASHED


def failure_columns(error: Exception, stage: str) -> dict[str, Any]:
    """The columns of a row whose recipe failed at a stage."""
    if isinstance(error, TestfieldError):
        said = error.sentence()
    elif isinstance(error, np.linalg.LinAlgError):
        said = f"linear algebra gave up: {error}"
    else:
        said = f"{type(error).__name__}: {error}"
    return {FAILURE: " ".join(said.split()), KIND: kind_of(error).value, STAGE: stage}
