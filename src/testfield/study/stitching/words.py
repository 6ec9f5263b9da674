"""What the study on stitched boards says of fields of boards, in words made from its key figures."""

from testfield.study.stitching.key_figures import GOOD_PX, Figures
from testfield.study.stitching.phrases import Known, about, mm, order, pick, px, ratio, rendered, said
from testfield.study.stitching.plan import PRINT_MM
from testfield.study.stitching.words_chain import GROWTH
from testfield.study.stitching.words_faults import FAULTS


def sentences(figures: Figures) -> list[str]:
    """The study's questions answered, one at a time; what was not measured is not said."""
    return said(figures, (*FIELDS, *GROWTH, *FAULTS))


def _how_many(f: Known) -> str:
    if f["enough_boards"]:
        enough = (
            f"from {f['enough_boards']} planned boards on, where they cover {100 * f['enough_coverage']:.0f} % of the "
            f"image, the upper end of the 95 % interval stays below {GOOD_PX} px"
        )
    else:
        enough = f"with none of the numbers tried does the upper end of the 95 % interval stay below {GOOD_PX} px"
    return (
        f"How many: at the worst corner the camera errs by {px(f, 'one')} with one board in the middle of the field "
        f"and a bar, {px(f, 'three')} with three and {px(f, 'planned')} with {f['most_boards']}; {enough}."
    )


def _check_points(f: Known) -> str:
    change = pick(
        order(f, "planned_check_mm", "one_check_mm"),
        "improve", "cannot be told apart", "become worse",
    )  # fmt: skip
    return (
        f"Check points in the volume, one board and {f['most_boards']}: {mm(f, 'one_check_mm')} and "
        f"{mm(f, 'planned_check_mm')}; they {change}."
    )


def _random_three(f: Known) -> str:
    return (
        f"How placed, three boards: planned {px(f, 'three')}, random {px(f, 'random_three')}; "
        f"{_better(f, 'three', 'random_three', 'planned', 'random')}."
    )


def _flat_three(f: Known) -> str:
    return (
        f"Three boards flat on one wall: {px(f, 'flat_three')}; "
        f"{_better(f, 'three', 'flat_three', 'leaning (planned)', 'flat')}."
    )


def _placed_most(f: Known) -> str:
    return (
        f"With {f['most_boards']}: planned {px(f, 'planned')}, random {px(f, 'random')}, flat {px(f, 'flat')}; "
        f"{_better(f, 'planned', 'random', 'planned', 'random')}, {_better(f, 'planned', 'flat', 'leaning', 'flat')}."
    )


def _lean(f: Known) -> str:
    lean, place = order(f, "planned_corner_px", "flat_corner_px"), _coverage_decides(f)
    if place < 1:
        return ""
    return pick(
        lean,
        "Where the stations converge and roll, a board's own lean still helps, and so does where in the image it is "
        "seen.",
        "As long as the stations converge and roll, nothing can be told of a board's own lean, but of where in the "
        "image it is seen.",
        "As long as the stations converge and roll, a board's own lean does harm.",
    )


def _flat_three_is_flat(f: Known) -> str:
    return _flatness(f, "flat_three", 3)


def _flat_most_is_flat(f: Known) -> str:
    return _flatness(f, "flat", f["most_boards"])


def _flatness(f: Known, name: str, boards: int) -> str:
    return (
        f"Flatness of the mother board, {boards} boards on one wall that no adjustment takes for flat: range about the "
        f"best plane {mm(f, f'{name}_flatness_mm', 3)}, in truth {f[f'{name}_true_flatness_mm']:.3f} mm; the test that "
        f"all lie in one plane is passed in {100 * f[f'{name}_flat_passed']:.0f} % of "
        f"{f[f'{name}_flatness_mm_worlds']:.0f} worlds, 95 % being right."
    )


def _coverage_decides(f: Known) -> int:
    return order(f, "window_middle_corner_px", "window_spread_corner_px")


def _how_much_coverage(f: Known) -> str:
    gain = f["window_middle_corner_px"] / f["window_spread_corner_px"]
    decides = pick(
        _coverage_decides(f),
        "So little does coverage decide that the middle alone is better.",
        "That coverage counts more than the number of marks cannot be told here.",
        f"{gain:.0f} times better: it is coverage that decides, more than the number of marks. Reach the corners.",
    )
    return (
        f"How much coverage: with {f['most_boards']} boards, but only the middle half of the image's sides used, the "
        f"corner errs by {px(f, 'window_middle')}; as many observations from all over the image give "
        f"{px(f, 'window_spread')}. {decides} The middle 80 % give {px(f, 'window_most')}, the whole "
        f"{px(f, 'window_all')}."
    )


def _full_three(f: Known) -> str:
    return (
        "Against an ideal full-size board with as many marks: it "
        f"gives {px(f, 'full_three')} and covers {100 * f['full_three_coverage']:.0f} % of the image, where three "
        f"sub-boards give {px(f, 'three')} and cover {100 * f['three_coverage']:.0f} %; "
        f"{_better(f, 'full_three', 'three', 'the full-size board', 'three sub-boards')}."
    )


def _full_most(f: Known) -> str:
    check = pick(
        order(f, "planned_check_mm", "full_check_mm"),
        "the sub-boards' being better", "which cannot be told apart", "the full-size board's being better",
    )  # fmt: skip
    return (
        f"The full-size board with the marks of {f['most_boards']} gives {px(f, 'full')}, as many stitched boards "
        f"{px(f, 'planned')}; {_better(f, 'full', 'planned', 'the full-size board', 'the stitched boards')}. Check "
        f"points {mm(f, 'full_check_mm')} and {mm(f, 'planned_check_mm')}, {check}."
    )


def _alone(f: Known) -> str:
    return (
        f"Against one sub-board alone, left in its place: {px(f, 'alone')}; with a control bar, whose ends lie further "
        f"out, {px(f, 'one')}; {_better(f, 'one', 'alone', 'with the bar', 'without')}."
    )


def _close(f: Known) -> str:
    return (
        f"Against one sub-board shown all over the image in ten close views: {px(f, 'close')}, and "
        f"{rendered(f, 'rendered_close')} on rendered images. Such views calibrate the lens at another distance than "
        "that of the work, and make no frame in the volume."
    )


def _charuco(f: Known) -> str:
    return (
        f"Against ChArUco of the area of {f['charuco_boards']} boards, rendered, without the bar: OpenCV's corners and "
        f"calibration give {rendered(f, 'charuco_opencv')}, the same corners in this project's bundle "
        f"{rendered(f, 'charuco_no_bar')}, stitched boards {rendered(f, 'no_bar_as_charuco')}."
    )


def _charuco_bar(f: Known) -> str:
    return (
        f"The same with the bar: ChArUco in this project's bundle {rendered(f, 'charuco_bundle')}, "
        f"{f['charuco_boards']} stitched boards {rendered(f, 'planned_as_charuco')}."
    )


def _charuco_close(f: Known) -> str:
    return f"A small ChArUco shown all over the image from close by, with OpenCV: {rendered(f, 'charuco_close')}."


def _cost(f: Known) -> str:
    told = pick(
        about(f, "cost_ratio", 1),
        "less with unknown poses", f"no difference that {f['cost_worlds']} worlds tell", "more with unknown poses",
    )  # fmt: skip
    return (
        f"What stitching costs: check points in the first board's frame err by {f['stitched_unfitted_mm']:.4f} mm with "
        f"{f['most_boards']} boards of unknown pose, and by {f['given_unfitted_mm']:.4f} mm where all poses are given "
        f"exactly: {told} (ratio {ratio(f, 'cost_ratio', 2)})."
    )


def _mother(f: Known) -> str:
    return (
        f"After a fit of six parameters the mother board's marks are true to {mm(f, 'planned_mother_mm')}, print "
        f"errors of {PRINT_MM} mm included."
    )


def _better(f: Known, one: str, other: str, one_name: str, other_name: str) -> str:
    """Which of two fields has the smaller corner error."""
    return pick(
        order(f, f"{one}_corner_px", f"{other}_corner_px"),
        f"{one_name} is better" if not one_name.endswith("boards") else f"{one_name} are better",
        f"{one_name} and {other_name} cannot be told apart",
        f"{other_name} is better" if not other_name.endswith("boards") else f"{other_name} are better",
    )


FIELDS = (
    _how_many, _check_points, _random_three, _flat_three, _placed_most, _how_much_coverage, _lean,
    _flat_three_is_flat, _flat_most_is_flat, _full_three, _full_most, _alone, _close, _charuco,
    _charuco_bar, _charuco_close, _cost, _mother,
)  # fmt: skip
