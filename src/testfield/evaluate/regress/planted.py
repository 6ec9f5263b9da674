"""Planted defects: algorithms that wrap the true ones and spoil what they give, as recipes load them.

This file is loaded by a recipe and never imported: it is what somebody's own file is, so no source is patched, and
without options each gives what the true algorithm gives, to the last digit.
"""

from dataclasses import replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.stitched import stitched
from testfield.camera.images import Frame
from testfield.camera.pose import Poses
from testfield.detect.detect import detect
from testfield.detect.observations import MEASURED, Observations
from testfield.measure.recipe import SMALLEST_DIAMETER_PX
from testfield.reconstruct.gls import gls
from testfield.reconstruct.points import Points
from testfield.registry import register
from testfield.seeds import Plane, seed_of
from testfield.store.digests import digest
from testfield.targets.camera_sheet import CameraSheet
from testfield.targets.field import Field


@register("detectors", "planted_detector")
def planted_detector(
    frame: Frame,
    field: Field,
    shift_px: float = 0.0,
    noisier: float = 0.0,
    wrong_code_in: int = 0,
    times: int = 1,
) -> Observations:
    """The true detector, done so many `times`; its centres shifted to the right, or scattering by the part `noisier`
    more than they do; one code in `wrong_code_in` is another one of the field. Stated covariances stay."""
    for _ in range(times):
        found = detect(frame, field, "forward_model", SMALLEST_DIAMETER_PX)
    chance = Plane(seed_of(0, digest(frame.pixels_dn)), f"planted/{frame.station}")
    if shift_px:
        found = replace(found, xy_px=found.xy_px + [shift_px, 0.0])
    if noisier:
        found = _noisier(found, np.sqrt((1 + noisier) ** 2 - 1), chance)
    return _misread(found, field, wrong_code_in, chance) if wrong_code_in else found


def _noisier(found: Observations, part: float, chance: Plane) -> Observations:
    rows = np.flatnonzero((found.status == MEASURED) & np.isfinite(found.cov_px2).all(axis=(1, 2)))
    xy = found.xy_px.copy()
    root = np.linalg.cholesky(found.cov_px2[rows])
    drawn = chance.normals(range(1), 2 * len(rows)).reshape(-1, 2)
    xy[rows] += part * np.einsum("nij,nj->ni", root, drawn)
    return replace(found, xy_px=xy)


def _misread(found: Observations, field: Field, one_in: int, chance: Plane) -> Observations:
    code, point = found.code.copy(), found.point.copy()
    coded = np.flatnonzero((found.status == MEASURED) & (code > 0))
    drawn = chance.uniforms(range(1, 3), len(code))
    loose = np.array(sorted(field.loose))
    for row in coded[drawn[0, coded] < 1 / one_in]:
        b = found.board[row]
        of_board = field.boards[b].marks.code if b >= 0 else loose
        others = np.flatnonzero((of_board > 0) & (of_board != code[row]))
        other = others[int(drawn[1, row] * len(others))]
        code[row], point[row] = of_board[other], other if b >= 0 else point[row]
    return replace(found, code=code, point=point)


@register("calibrators", "planted_calibrator")
def planted_calibrator(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    cameras: tuple[CameraSheet, ...] = (),
    eccentricity: bool = True,
    principal_point_px: float = 0.0,
    datum_mm: float = 0.0,
    unit: float = 1.0,
) -> Calibration:
    """The true calibrator; the centres of discs' images are taken for the images of their centres (`eccentricity`
    false); the first camera's principal point is moved afterwards, or the datum; or control bars are read in a `unit`
    of so many millimetres."""
    if not eccentricity:
        observations = replace(observations, centre_of_disc=False)
    if unit != 1:
        bars = tuple(
            replace(bar, length_mm=unit * bar.length_mm) if bar.role == "control" else bar for bar in field.scale_bars
        )
        field = replace(field, scale_bars=bars)
    found = stitched(observations, field, width_px, height_px, lens, hold, cameras=cameras)
    if principal_point_px:
        moved = found.interior.parameters.copy()
        moved[2] += principal_point_px
        found = replace(found, interior=replace(found.interior, parameters=moved))
    return _in_another_datum(found, np.array([datum_mm, 0.0, 0.0])) if datum_mm else found


def _in_another_datum(found: Calibration, by_mm: np.ndarray) -> Calibration:
    """Everything moved in space together: residuals do not notice."""
    stations = Poses(found.stations.R, found.stations.t_mm - found.stations.R @ by_mm)
    boards = Poses(found.boards.R, found.boards.t_mm + by_mm)
    return replace(found, stations=stations, boards=boards, point_mm=found.point_mm + by_mm)


@register("reconstructors", "planted_reconstructor")
def planted_reconstructor(
    observations: Observations, calibration: Calibration, field: Field, covariance: float = 1.0
) -> Points:
    """The true reconstructor, its stated covariance so many times as large."""
    found = gls(observations, calibration, field)
    return replace(found, cov_xyz_mm2=covariance * found.cov_xyz_mm2)
