"""What the study on stitched boards says of boards that are not as their sheets tell."""

from testfield.study.stitching.phrases import Known, mm, order, pick, px

CHANCE = 0.05
"""Share of worlds that the global test turns down where nothing is wrong."""


def _clean(f: Known) -> str:
    return f"Six flat boards give check points to {mm(f, 'clean_check_mm')} and corners to {px(f, 'clean')}."


def _bent(f: Known) -> str:
    return (
        f"Six boards bent by 1 mm over 400 mm: corners err by {px(f, 'bent')}, check points by "
        f"{mm(f, 'bent_check_mm')}; {_notices(f, 'bent')}."
    )


def _bent_full(f: Known) -> str:
    told = pick(
        order(f, "bent_corner_px", "bent_full_corner_px"),
        "Of one curvature small boards err less: that is their true advantage.",
        "That small boards of the same curvature err less cannot be told here.",
        "Of one curvature the full-size board errs less.",
    )
    return (
        f"A full-size board of the same curvature, bent by 25 mm: corners {px(f, 'bent_full')}; "
        f"{_notices(f, 'bent_full')}. {told}"
    )


def _scale(f: Known) -> str:
    return (
        f"Six boards with scale errors of their own of 200 ppm: check points {mm(f, 'scale_check_mm')}, corners "
        f"{px(f, 'scale')}; {_notices(f, 'scale')}, and NEES of the check points is {f['scale_check_nees']:.1f}."
    )


def _notices(f: Known, name: str) -> str:
    """Whether the global test turns down more worlds than it would by chance."""
    key = f"{name}_turned_down"
    told = "whether the global test notices cannot be told"
    if f[f"{key}_share_low"] > CHANCE:
        told = "the global test notices"
    elif f[f"{key}_share_high"] < 0.5:
        told = "the global test hardly notices"
    return f"{told} ({f[key]:.0f} of {f[f'{name}_worlds']:.0f} worlds turned down, s0 {_s0(f, name)})"


def _s0(f: Known, name: str) -> str:
    value = f[f"{name}_sigma0"]
    return f"{value:.2f}" if value < 1e4 else "beyond all"


FAULTS = (_clean, _bent, _bent_full, _scale)
