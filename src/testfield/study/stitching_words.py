"""What the study on stitched boards says, in words made from its key figures."""

import re
from typing import Any

from testfield.study.stitching_plan import CHAIN, LONG_CHAIN, PRINT_MM
from testfield.study.stitching_scenes import PITCH_MM
from testfield.study.stitching_summary import GOOD_PX

Figures = dict[str, Any]


def verdict(f: Figures) -> str:
    """The verdict on the claim."""
    as_full = f["planned_corner_px"] / f["full_corner_px"]
    loops = f["chain_exact_close_out_rms_mm"] / f["chain_exact_wide_out_rms_mm"]
    return (
        f"Holds as a method, not to the letter. {f['most_boards']} stitched boards know the lens at the image's "
        f"corners to {f['planned_corner_px']:.4f} px, {as_full:.1f} times the error of an ideal full-size board with "
        f"as many marks ({f['full_corner_px']:.4f} px). But stitching has an error: it is estimated with everything "
        f"else, and what is left of it grows along a chain to {1e3 * f['chain_printed_close_out_rms_mm']:.0f} µm after "
        f"{CHAIN - 1} links of {PITCH_MM:.0f} mm. Wide views divide what image noise adds by {loops:.1f}; nothing "
        "lessens the print errors of the board that holds the frame. And for the lens alone stitching is not needed: "
        f"one small board shown all over the image from close by reaches {f['close_corner_px']:.4f} px."
    )


def sentences(f: Figures) -> list[str]:
    """The study's questions answered, one at a time; what was not measured is not said."""
    found = [
        *_how_many(f), *_how_placed(f), *_how_much_coverage(f), *_opponents(f), *_cost(f), *_growth(f), *_faults(f)
    ]  # fmt: skip
    return [sentence for sentence in found if not re.search(r"\bnan\b", sentence)]


def _how_many(f: Figures) -> list[str]:
    if f["enough_boards"]:
        enough = (
            f"from {f['enough_boards']} planned boards on it stays below {GOOD_PX} px, where they cover "
            f"{100 * f['enough_coverage']:.0f} % of the image"
        )
    else:
        enough = f"none of the numbers tried stays below {GOOD_PX} px"
    return [
        f"How many: at the worst corner the camera errs by {_px(f, 'one')} with one board in the middle of the field "
        f"and a bar, {_px(f, 'three')} with three and {_px(f, 'planned')} with {f['most_boards']}; {enough}. Check "
        f"points in the volume improve from {f['one_check_mm']:.4f} to {f['planned_check_mm']:.4f} mm."
    ]


def _how_placed(f: Figures) -> list[str]:
    return [
        f"How placed, three boards: planned {_px(f, 'three')}, random {_px(f, 'random_three')}.",
        f"Three boards flat on one wall: {_px(f, 'flat_three')}. With {f['most_boards']}: planned {_px(f, 'planned')}, "
        f"random {_px(f, 'random')}, flat {_px(f, 'flat')}. As long as the stations converge and roll, a board's own "
        "lean counts less than where in the image it is seen.",
    ]


def _how_much_coverage(f: Figures) -> list[str]:
    gain = f["window_middle_px"] / f["window_spread_px"]
    return [
        f"How much coverage: with {f['most_boards']} boards, but only the middle half of the image's sides used, the "
        f"corner errs by {f['window_middle_px']:.3f} px; as many observations from all over the image give "
        f"{f['window_spread_px']:.4f} px, {gain:.0f} times better. The middle 80 % give {f['window_most_px']:.4f} px, "
        f"the whole {f['window_all_px']:.4f} px. It is coverage that decides, more than the number of marks: reach the "
        "corners."
    ]


def _opponents(f: Figures) -> list[str]:
    return [
        f"Against an ideal full-size board with as many marks: it gives {_px(f, 'full_three')} where three sub-boards "
        f"give {_px(f, 'three')}, for it fills the image at once.",
        f"The full-size board with the marks of {f['most_boards']} gives {_px(f, 'full')}, as many stitched boards "
        f"{_px(f, 'planned')}; check points {f['full_check_mm']:.4f} and {f['planned_check_mm']:.4f} mm.",
        "Against one sub-board alone, left in its place: it does not determine the lens at the corners "
        f"({_px(f, 'alone')}); with a control bar, whose ends lie further out, {_px(f, 'one')}.",
        f"Against one sub-board shown all over the image in ten close views: {_px(f, 'close')}, and "
        f"{f['rendered_close_corner_px']:.4f} px on rendered images. Such views calibrate the lens at another distance "
        "than that of the work, and make no frame in the volume.",
        f"Against ChArUco of the area of {f['charuco_boards']} boards, rendered: OpenCV's corners and calibration, "
        f"without the bar, give {f['charuco_opencv_corner_px']:.3f} px, the same corners in this project's bundle with "
        f"it {f['charuco_bundle_corner_px']:.3f} px, stitched boards {f['planned_as_charuco_corner_px']:.4f} px.",
        f"A small ChArUco shown all over the image from close by, with OpenCV: {f['charuco_close_corner_px']:.3f} px.",
    ]


def _cost(f: Figures) -> list[str]:
    return [
        f"What stitching costs: check points in the first board's frame err by {f['stitched_unfitted_mm']:.4f} mm with "
        f"{f['most_boards']} boards of unknown pose, and by {f['given_unfitted_mm']:.4f} mm where all poses are given "
        f"exactly. After a fit of six parameters the mother board's marks are true to {f['planned_mother_mm']:.4f} mm, "
        f"print errors of {PRINT_MM} mm included."
    ]


def _growth(f: Figures) -> list[str]:
    def law(key: str) -> str:
        law_um, shared_um, claimed_um = (1e3 * f[f"{key}_{end}_mm"] for end in ("law", "law_shared", "claimed"))
        return (
            f"{_um(f, key)}; the law says {law_um:.0f} µm, {_against(f, key)}, with the covariance of a link's shift "
            f"and turn {shared_um:.0f} µm, and the bundle claims {claimed_um:.0f} µm"
        )

    out, up = "out of the plane", "upwards"
    return [
        f"Growth by image noise alone (boards printed exactly), after {CHAIN - 1} links, {out}: "
        f"{law('chain_exact_close_out')}. {up.capitalize()}: {law('chain_exact_close_up')}. Links are not quite "
        "independent: a link's shift and turn come from the same marks, and all links share one camera. Four wide "
        f"views bring the errors to {_um(f, 'chain_exact_wide_out')} and {_um(f, 'chain_exact_wide_up')}.",
        f"Growth with print errors of {PRINT_MM} mm, {out}: {law('chain_printed_close_out')}. {up.capitalize()}, where "
        f"prints rule: {law('chain_printed_close_up')}. Print errors make no random walk: what turns a board against "
        "one neighbour turns it back against the next (turns of neighbouring links correlate by "
        f"{f['chain_printed_close_up_turn_lag']:.2f}). Those of the first board remain and turn the whole chain, in "
        f"proportion to the distance, and four wide views leave {_um(f, 'chain_printed_wide_up')}.",
        f"A link's turn in the plane by print errors alone is {f['print_turn_mrad']:.4f} mrad; marks' noise over the "
        f"root of their squared distances predicts {f['print_turn_expected_mrad']:.4f} mrad.",
        f"After a fit of six parameters {1e3 * f['chain_printed_close_up_mother_rms_mm']:.1f} µm rms of the chain's "
        f"mother board remain without and {1e3 * f['chain_printed_wide_up_mother_rms_mm']:.1f} µm with four wide "
        "views: a chain gains more from a frame that all its boards hold than from loops.",
        f"{LONG_CHAIN} boards printed exactly, {out}: {law('long_exact_close_out')}. With wide views of eight boards "
        f"each {_um(f, 'long_exact_wide_out')}. With print errors, {up}: {law('long_printed_close_up')}; with wide "
        f"views {_um(f, 'long_printed_wide_up')}.",
        "What the bundle claims along the chain: NEES of board poses per degree of freedom is "
        f"{f['chain_drawn_nees']:.2f} on drawn pixels and {f['chain_rendered_nees']:.2f} over "
        f"{f['chain_rendered_worlds']} rendered world(s), 1 being true.",
    ]  # fmt: skip


def _faults(f: Figures) -> list[str]:
    told = "the global test notices" if f["scale_passed"] < 0.5 else "the global test hardly notices"
    return [
        f"Six boards bent by 1 mm each: corners err by {f['bent_corner_px']:.2f} px, check points by "
        f"{f['bent_check_mm']:.3f} mm, and s0 of {f['bent_sigma0']:.1f} says that something is wrong. A full-size "
        f"board of the same curvature, bent by 25 mm: corners {f['bent_full_corner_px']:.1f} px, s0 "
        f"{f['bent_full_sigma0']:.0f}. The same stiffness bends a small board less: that is its true advantage.",
        f"Six flat boards give check points to {f['clean_check_mm']:.4f} mm and corners to {f['clean_corner_px']:.4f} "
        "px.",
        f"Six boards with scale errors of their own of 200 ppm: check points {f['scale_check_mm']:.4f} mm, corners "
        f"{f['scale_corner_px']:.3f} px; {told} (s0 {f['scale_sigma0']:.2f}, passed in {100 * f['scale_passed']:.0f} % "
        f"of worlds), and NEES of the check points becomes {f['scale_nees']:.1f}.",
    ]


def _against(f: Figures, key: str) -> str:
    """The law against the interval of what was found."""
    if f[f"{key}_law_mm"] > f[f"{key}_high_mm"]:
        return "too much"
    return "too little" if f[f"{key}_law_mm"] < f[f"{key}_low_mm"] else "which agrees"


def _px(f: Figures, name: str) -> str:
    values = [f[f"{name}_corner_px{end}"] for end in ("", "_low", "_high")]
    if values[0] > 1e4:
        return "beyond all measure"
    digits = 4 if values[0] < 0.1 else 2
    return f"{values[0]:.{digits}f} px [{values[1]:.{digits}f}, {values[2]:.{digits}f}]"


def _um(f: Figures, name: str) -> str:
    rms, low, high = (1e3 * f[f"{name}_{end}_mm"] for end in ("rms", "low", "high"))
    return f"{rms:.0f} µm [{low:.0f}, {high:.0f}]"
