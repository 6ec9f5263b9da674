"""A calibration that a program of somebody's own, or a file made elsewhere, gives of observations."""

from pathlib import Path
from tempfile import TemporaryDirectory

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.given_camera import read_camera
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.measure.outside import Program, Results
from testfield.measure.programs import result_of, said_of
from testfield.targets.field import Field

FILES = {"observations": "observations.csv", "sheet": "field.json", "json": "camera.json"}
"""The names of a program's files in a folder of its own."""


def calibrated_by_program(observations: Observations, field: Field, program: Program) -> Calibration:
    """What a program makes of observations and field sheet (OWN_ALGORITHMS.md).

    Raises `TestfieldError` where it fails, or writes what cannot be.
    """
    with TemporaryDirectory(prefix="testfield-") as folder:
        work = Path(folder)
        files = {name: work / file for name, file in FILES.items()}
        observations.measured.save_csv(files["observations"])
        field.save(files["sheet"])
        result = result_of(program, files, work, "calibration", "json")
        with said_of(program, result):
            return read_camera(result, observations, field, program.name)


def calibrated_by_files(observations: Observations, field: Field, results: Results) -> Calibration:
    """What lies in a folder: camera.json or calibration.json. Raises `TestfieldError` where neither does."""
    for name in ("camera.json", "calibration.json"):
        if (results.folder / name).is_file():
            return read_camera(results.folder / name, observations, field, results.folder.name)
    raise TestfieldError("there is no camera.json", str(results.folder), "put the calibration there")
