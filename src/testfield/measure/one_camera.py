"""Whether photographs that are said to be of one camera can be, by their files' headers, before any detection."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from testfield.camera.exif import Exif
from testfield.errors import TestfieldError

UNLIKE = 1.25
"""Ratio of focal lengths that no rounding of the 35 mm equivalent explains."""
TURNED = (
    "some are upright and others across: where one camera took them, turn them back as its sensor had them "
    "(without loss, all one way); else "
)
NAMED = 12
"""Names of photographs in a group beyond which only their number is told."""


@dataclass(frozen=True)
class Header:
    """A photograph's `name`, its `camera` (an empty name where there is one alone) and what its file's header tells."""

    name: str
    camera: str
    exif: Exif


def check_one_camera(headers: Sequence[Header]) -> None:
    """Raise `TestfieldError` that lists the photographs where those of one camera differ in size, in what EXIF calls
    the camera, or in focal length: another camera took some, or it was zoomed, and no single calibration fits."""
    for camera in dict.fromkeys(header.camera for header in headers):
        own = [header for header in headers if header.camera == camera]
        groups: list[list[Header]] = []
        for header in own:
            # What tells more comes first, so that a silent file joins whichever group it fits.
            group = next((g for g in groups if all(header.exif.like(one.exif) for one in g)), None)
            if group is None:
                groups.append([header])
            else:
                group.append(header)
        if len(groups) < 2:
            continue
        groups.sort(key=len, reverse=True)
        said = "; ".join(f"{_names(group)}: {_widest(group).said}" for group in groups)
        whose = f" of camera '{camera}'" if camera else ""
        sizes = {header.exif.size_px for header in own}
        turned = "" if all((h, w) not in sizes or w == h for w, h in sizes) else TURNED
        raise TestfieldError(
            f"the photographs{whose} are by {len(groups)} cameras, or zoomed or cropped in between: {said}",
            do=f"{turned}give each camera a folder of its own and --by-folder, or [[cameras]] in the field file; "
            "a zoom lens is another camera at every focal length; leave out what does not belong",
        )


def focal_of(headers: Sequence[Header]) -> float | None:
    """The focal length in px that EXIF gives: the median of the photographs' 35 mm equivalents; None without any."""
    focals = [focal for header in headers if (focal := header.exif.focal_px)]
    return float(np.median(focals)) if focals else None


def unlike_exif(focal_px: float, told_px: float | None) -> list[str]:
    """A note where a focal length is far from what EXIF tells."""
    if told_px is None or abs(np.log(focal_px / told_px)) < np.log(UNLIKE):
        return []
    return [
        f"the focal length is {focal_px:.0f} px, and by EXIF's 35 mm equivalent {told_px:.0f} px: were the images "
        "cropped or reduced unevenly, or does the adapted lens not tell its focal length?"
    ]


def _widest(group: list[Header]) -> Exif:
    return max((header.exif for header in group), key=lambda exif: len(exif.said))


def _names(group: list[Header]) -> str:
    names = [header.name for header in group]
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"{', '.join(names[:NAMED])}{more} ({len(names)})"
