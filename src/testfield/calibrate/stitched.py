"""Stitched sub-boards: homographies, the graph of images and boards, one bundle (METHODS section 4)."""

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.finish import calibrated
from testfield.calibrate.imaging import imaging_of
from testfield.calibrate.misfit import Misfit
from testfield.calibrate.rows import usable_rows
from testfield.calibrate.start import Start, starting_network
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.camera_sheet import CameraSheet
from testfield.targets.field import Field


@register("calibrators", "stitched")
def stitched(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    empirical: bool = False,
    misfit: Misfit | None = None,
    cameras: tuple[CameraSheet, ...] = (),
    rigs: str = "constrained",
) -> Calibration:
    """Sub-boards of unknown pose joined through their coded targets, in one bundle.

    Where several `cameras` took the images, their sheets give sizes and lenses; those that the field's `rigs` hold keep
    their relative orientation, unless that is "free".

    Calibrates the `lens` model named, its parameters named in `hold` kept at zero, from what detection measured and the
    field's sheet; no starting values are needed. `empirical` widens all covariances where observations scatter more
    than they claim; `misfit` as in `settle.settled`. Raises `TestfieldError` where no board, or too little of them, was
    seen, and where the observations do not determine a parameter.
    """
    rows, turned_down, notes = usable_rows(observations, field)
    imaging = imaging_of(observations, cameras, field.rigs, rigs) if cameras else None

    def begin(rows: Observations, left_out: frozenset[int]) -> Start:
        return starting_network(rows, field, width_px, height_px, lens, hold, left_out=left_out, imaging=imaging)

    return calibrated("stitched", begin, rows, field, turned_down, notes, empirical, misfit)


@register("calibrators", "stitched_given")
def stitched_given(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
) -> Calibration:
    """`stitched` with the boards' poses that the field sheet certifies, each with its uncertainty.

    What stitching costs is the difference to it. Certified boards need no image in common. Raises `TestfieldError`
    where the sheet certifies no pose.
    """
    if not any(sheet.pose is not None for sheet in field.boards[1:]):
        raise TestfieldError(
            "the field sheet certifies the pose of no board",
            "field.json, boards",
            "give each board a pose, in a scene by [certified_poses], or use 'stitched'",
        )
    rows, turned_down, notes = usable_rows(observations, field)

    def begin(rows: Observations, left_out: frozenset[int]) -> Start:
        return starting_network(rows, field, width_px, height_px, lens, hold, given=True, left_out=left_out)

    return calibrated("stitched_given", begin, rows, field, turned_down, notes)
