"""Dots of a grid of known size, and those that their places in it tell where their pixels do not.

A blob that blur has left without an edge, or one of forty whose shape noise makes look like a pentagon's, is no dot by
itself. Where the blobs fill every place of the grid that was asked for, no more and no less, most of them measured or
too blurred to tell, it is one: shape was asked after only to know that.
"""

import cv2
import numpy as np

from testfield.camera.plane_image import as_others_say
from testfield.detect.circle_grid import order_grid
from testfield.detect.hexagonal_grid import order_hexagonal
from testfield.detect.observations import MEASURED, READ, diameters
from testfield.detect.rune_dots import name_rune, read_runes
from testfield.detect.target_spec import TargetSpec
from testfield.detect.targets import Targets
from testfield.targets.kinds.hexcircles import row_shifts

BLURRED, UNFITTED = "too blurred to tell its shape", "no ellipse fits"
"""What speaks neither for nor against a dot."""
UNLIKE = ("a polygon", "a ring or a spot", "not an ellipse")
"""What speaks against it."""
LEAST_MEASURED, MOST_UNLIKE = 0.25, 0.1
"""Parts of the grid that must be measured without its help, and that may look unlike a dot."""
CERTAIN_CHI2 = 2.0
"""Chi-squared up to which a dot's pixels are as the model has them: then its centre is right, too."""
FARTHEST = 6.0
"""A dot may lie off the plane's image by so many times what is usual in the grid, with its lens and its noise."""
READ_PX = 0.25
"""Standard deviation of the rough centres of blobs that no ellipse fits."""


def grid_places(targets: Targets, target: TargetSpec, size_px: tuple[int, int]) -> np.ndarray:
    """(n, 2) column and row of the targets in a grid, -1 for none, in an image of a width and height; changes
    `targets.status` of those that their places tell."""
    good = targets.status == MEASURED
    if target.kind == "runetag":
        return _in_tag(targets, target, good)
    place = _ordered(targets, target, good)
    whole = target.columns * target.rows
    status = targets.status.astype(str)
    doubtful = np.isin(status, (BLURRED, UNFITTED, *UNLIKE)) & np.isfinite(targets.xy_px).all(axis=1)
    if not whole or (place[:, 0] >= 0).sum() == whole or not doubtful.any():
        return place
    with_doubtful = _ordered(targets, target, good | doubtful)
    inside = with_doubtful[:, 0] >= 0
    unlike = inside & np.isin(status, UNLIKE)
    if (
        inside.sum() < whole
        or (inside & good).sum() < LEAST_MEASURED * whole
        or unlike.sum() > max(MOST_UNLIKE * whole, 1)
    ):
        return place
    inside[inside] = good[inside] | _there(_on_board(with_doubtful[inside], target), targets.xy_px[inside], size_px)
    fits = (
        inside & (status != UNFITTED) & (targets.chi2 <= CERTAIN_CHI2) & np.isfinite(targets.cov_px2).all(axis=(1, 2))
    )
    targets.status[fits] = MEASURED
    rough = inside & (status == UNFITTED)
    targets.status[rough], targets.cov_px2[rough] = READ, READ_PX**2 * np.eye(2)
    return with_doubtful


def _there(board: np.ndarray, xy_px: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """(n,) which dots lie where the others say: a fit that ran away to a noise beside its dot does not."""
    there = as_others_say((board, xy_px), size_px)
    H, _ = cv2.findHomography(board, xy_px, cv2.LMEDS)
    if H is None:
        return there
    off = np.linalg.norm(cv2.perspectiveTransform(board[None], H)[0] - xy_px, axis=1)
    return np.asarray(there & (off < FARTHEST * np.median(off)))


def _on_board(place: np.ndarray, target: TargetSpec) -> np.ndarray:
    """(n, 2) where places (n, 2) lie on the print, in spacings."""
    if target.kind != "hexcircles":
        return place.astype(float)
    shift = row_shifts(target.rows)
    return np.column_stack([place[:, 0] + (shift[place[:, 1]] - shift[0]) / 2, np.sqrt(0.75) * place[:, 1]])


def _ordered(targets: Targets, target: TargetSpec, among: np.ndarray) -> np.ndarray:
    place = np.full((len(among), 2), -1)
    order = order_hexagonal if target.kind == "hexcircles" else order_grid
    diameter = diameters(targets.moments_px2[among])
    place[among] = order(targets.xy_px[among], diameter, target.columns, target.rows)
    return place


def _in_tag(targets: Targets, target: TargetSpec, good: np.ndarray) -> np.ndarray:
    """Dots of a RUNE-Tag as if they stood in one row."""
    place = np.full((len(good), 2), -1)
    diameter = diameters(targets.moments_px2[good])
    number = name_rune(targets.xy_px[good], diameter, target.pattern())
    place[good] = np.column_stack([number, np.minimum(number, 0)])
    return place


def runes(targets: Targets) -> np.ndarray:
    """(n,) which point of a RUNE-Tag each dot is, -1 for none; `targets.code` gets the tags' numbers."""
    good, point = targets.status == MEASURED, np.full(len(targets.code), -1)
    diameter = diameters(targets.moments_px2[good])
    targets.code[good], point[good] = read_runes(targets.xy_px[good], diameter)
    return point
