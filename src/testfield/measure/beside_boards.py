"""Coded targets beside boards that calibrate: the boards give cameras and stations, the codes are points met by rays.

Their covariance holds what the calibration leaves unknown, which all points share. Where nobody told a ring code's
diameter its dots' images tell it, as the plane's eccentricity of a circle's centre must be known to second order only.
"""

from dataclasses import replace

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import MEASURED, READ, Observations
from testfield.detect.target_spec import TargetSpec
from testfield.measure.single_tags import KINDS as SINGLE_TAGS
from testfield.measure.single_tags import corner_codes
from testfield.reconstruct.gls import gls
from testfield.reconstruct.points import Points
from testfield.reconstruct.sights import rays_of, sights_of
from testfield.targets.field import Field
from testfield.targets.field_file import FieldFile

KINDS = ("ring", "cctag", *SINGLE_TAGS)
"""Kinds of targets that have numbers of their own, whatever lies around them."""


def numbered(o: Observations, coded: np.ndarray, target: TargetSpec) -> Observations:
    """Observations of which `coded` (n,) are targets with numbers, not points of boards, whose numbers stand in `code`
    alone; of single tags each corner has its own, and takes part as it was read where no model fits."""
    code, status = o.code, o.status
    if target.kind in SINGLE_TAGS:
        corner = coded & (o.point >= 0)
        code = np.where(corner, corner_codes(o.code, np.where(coded, o.point, -1)), o.code)
        known = np.isfinite(o.xy_px).all(axis=1) & np.isfinite(o.cov_px2).all(axis=(1, 2))
        status = np.where(corner & known & (o.status == READ), MEASURED, o.status).astype(object)
    return replace(
        o,
        code=np.where(coded, code, 0),
        status=status,
        board=np.where(coded, -1, o.board),
        point=np.where(coded, -1, o.point),
    )


def points_beside(observations: Observations, calibration: Calibration, sheet: Field, field: FieldFile) -> Points:
    """The coded targets that two calibrated stations or more have measured, in the frame of the boards."""
    told = field.target.diameters_mm
    codes = sorted({int(c) for c in observations.measured.code[observations.measured.board < 0] if c > 0})
    loose = {code: told.get(code, field.target.diameter_mm or np.nan) for code in codes}
    sheet = replace(sheet, loose=loose)
    first = gls(observations, calibration, sheet)
    if not observations.centre_of_disc or np.isfinite(list(loose.values())).all() or not len(first):
        return first
    sights = sights_of(observations, calibration, sheet)
    row = {int(code): k for k, code in enumerate(first.code)}
    sights = sights.take(np.isin(sights.code, first.code))
    rays = rays_of(sights, calibration, first.xyz_mm[[row[int(code)] for code in sights.code]])
    # The longer axis of a circle's image is that across the slant: as long as if it were seen squarely.
    finite = np.where(np.isfinite(sights.moments_px2).all(axis=(2, 3), keepdims=True), sights.moments_px2, 0.0)
    half_px = 2 * np.sqrt(np.maximum(np.linalg.eigvalsh(finite)[..., 1], 0))
    focal = np.array([interior.fx for interior in calibration.interiors])[calibration.camera_of_image[sights.station]]
    radius = np.where(sights.there & (half_px > 0), half_px * rays.depth_mm / focal, np.nan)
    seen = np.isfinite(radius).any(axis=1)
    diameter = {int(c): 2 * float(np.nanmedian(r)) for c, r in zip(sights.code[seen], radius[seen], strict=True)}
    known = {c: d if np.isfinite(d) else diameter.get(c, np.nan) for c, d in loose.items()}
    return gls(observations, calibration, replace(sheet, loose=known))
