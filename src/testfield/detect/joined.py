"""Targets that were measured in several looks at one image, made one."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from testfield.detect.observations import diameters
from testfield.detect.targets import Targets

ROWS = ("xy_px", "cov_px2", "moments_px2", "chi2", "misfit", "code", "affine", "status", "background_dn", "contrast_dn")


def take(targets: Targets, rows: np.ndarray) -> Targets:
    """The rows of an index or a mask."""
    columns: dict[str, Any] = {name: getattr(targets, name)[rows] for name in ROWS}
    return replace(targets, **columns)


def put_beside(targets: Targets, new: Targets, same: float) -> Targets:
    """The `targets` and the `new` ones, which take the place of those nearer than the part `same` of their diameter."""
    if not len(new.code):
        return targets
    gap, of = cKDTree(new.xy_px).query(np.nan_to_num(targets.xy_px, nan=-1e9))
    stays = take(targets, gap > same * diameters(new.moments_px2)[of])
    columns: dict[str, Any] = {n: np.concatenate([getattr(stays, n), getattr(new, n)]) for n in ROWS}
    return replace(targets, **columns)
