"""Points that a program of somebody's own, or a file made elsewhere, gives of observations and a calibration."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.outside import Program, Results
from testfield.measure.programs import result_of, said_of
from testfield.reconstruct.points import Points
from testfield.targets.field import Field

FILES = {
    "observations": "observations.csv",
    "calibration": "calibration.json",
    "sheet": "field.json",
    "csv": "points.csv",
}
"""The names of a program's files in a folder of its own."""


def points_by_program(observations: Observations, calibration: Calibration, field: Field, program: Program) -> Points:
    """What a program makes of observations, calibration and field sheet (OWN_ALGORITHMS.md).

    Raises `TestfieldError` where it fails, or writes what cannot be.
    """
    with TemporaryDirectory(prefix="testfield-") as folder:
        work = Path(folder)
        files = {name: work / file for name, file in FILES.items()}
        measured = observations.measured
        measured.save_csv(files["observations"])
        calibration.save(files["calibration"])
        field.save(files["sheet"])
        result = result_of(program, files, work, "reconstruction", "csv")
        with said_of(program, result):
            # A point takes an observation at least, and the joint covariance grows with the square of their number.
            return replace(Points.load(result, most=len(measured)), method=program.name)


def points_from_files(results: Results) -> Points:
    """What lies in a folder: points.csv or points.parquet. Raises `TestfieldError` where neither does."""
    for name in ("points.parquet", "points.csv"):
        path = results.folder / name
        if path.is_file():
            return Points.load(path)
    raise TestfieldError("there is no points.csv", str(results.folder), "put the points there")
