"""ArUco markers and AprilTags stuck about: each corner a point with a number of its own, each tag a square of a size.

Corner c of tag n, from 1 to 4 clockwise from the top left of its print, is the code 10 n + c. So what holds of codes
holds of corners: distances between them are certified, and places. A size that is told makes the scale by both
diagonals of every tag, whose common error n tags make no smaller, because one printer made them all.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testfield.calibrate.certified import Certified
from testfield.detect.observations import MEASURED, READ
from testfield.detect.photograph import Found
from testfield.detect.target_spec import TargetSpec
from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.targets.field import TIME, ScaleBar

KINDS = ("aruco", "apriltag")
"""Kinds of targets that are tags by themselves."""
NOMINAL_U_SIZE = 0.005
"""Standard uncertainty of a size that nobody certified, as a part of it, as printers are off."""
A_TAG = 10
"""Codes from one tag to the next, so that a person reads the tag in the code."""
OTHER_SIZE = 0.05
"""A tag that is larger or smaller than it should be by more than this part is told of."""


def as_coded(found: Sequence[Found]) -> tuple[list[Found], tuple[str, ...]]:
    """What was found of single tags, each corner under the code of its own, and notes. What was read where no model
    could be fitted takes part, with the uncertainty of such readings.

    Raises `TestfieldError` for a tag whose corners' codes would be too large.
    """
    answer, read, all_of = [], 0, 0
    for one in found:
        o = one.observations
        here = o.point >= 0
        use = here & np.isfinite(o.xy_px).all(axis=1) & np.isfinite(o.cov_px2).all(axis=(1, 2))
        status = np.where(use & (o.status == READ), MEASURED, o.status).astype(object)
        read, all_of = read + int((use & (o.status == READ)).sum()), all_of + int(use.sum())
        code = corner_codes(o.code, o.point)
        answer.append(replace(one, observations=replace(o, code=code, status=status, point=np.full(len(o), -1))))
    if not read:
        return answer, ()
    return answer, (
        f"{read} of {all_of} corners are as they were read, and take part with the uncertainty of such readings",
    )


def corner_codes(tag: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """(n,) codes of the corners (n,), from 0, of tags (n,); 0 where `corner` is negative.

    Raises `TestfieldError` for a tag whose corners' codes would be too large.
    """
    here = corner >= 0
    if (tag[here] >= TIME // A_TAG).any():
        raise TestfieldError(
            f"tag {int(tag[here].max())}: numbers up to {TIME // A_TAG - 1} can be measured",
            "--target",
            "leave such tags out of the images, or name another family",
        )
    return np.where(here, A_TAG * tag + corner + 1, 0)


def sized(certified: Certified, found: Sequence[Found], target: TargetSpec) -> Certified:
    """What is certified, and where the tags' size was told their diagonals; nothing more where somebody certified
    lengths or places, which are better known than a print."""
    if not target.sized or certified.known or any(bar.role == "control" for bar in certified.bars):
        return certified
    codes = {int(c) for one in found for c in one.observations.code}
    ends = [(A_TAG * n + a, A_TAG * n + a + 2) for n in sorted({c // A_TAG for c in codes if c}) for a in (1, 2)]
    ends = [pair for pair in ends if codes.issuperset(pair)]
    length = float(np.sqrt(2) * target.marker_mm)
    u = NOMINAL_U_SIZE * length * np.sqrt(max(len(ends), 1))
    bars = tuple(ScaleBar(f"tag {a // A_TAG}, {a % A_TAG}-{b % A_TAG}", "control", (a, b), length, u) for a, b in ends)
    return replace(certified, bars=(*certified.bars, *bars))


def odd_sizes(points: Points, target: TargetSpec) -> list[str]:
    """A sentence on tags that are larger or smaller than all others, or than their size."""
    row = {int(code): k for k, code in enumerate(points.code)}
    sides: dict[int, float] = {}
    for tag in sorted({code // A_TAG for code in row if code > 0}):
        corners = [A_TAG * tag + c for c in (1, 2, 3, 4)]
        if all(code in row for code in corners):
            xyz = points.xyz_mm[[row[code] for code in corners]]
            diagonals = np.linalg.norm(xyz[:2] - xyz[2:], axis=1)
            sides[tag] = float(diagonals.mean() / np.sqrt(2))
    if len(sides) < 3:
        return []
    size = target.marker_mm if target.sized else float(np.median(list(sides.values())))
    off = {tag % (TIME // A_TAG): side / size - 1 for tag, side in sides.items()}
    odd = [f"{tag} by {part:+.0%}" for tag, part in off.items() if abs(part) > OTHER_SIZE]
    return [f"{len(odd)} of {len(sides)} tags differ in size from {size:.4g}: {', '.join(odd[:8])}"] if odd else []
