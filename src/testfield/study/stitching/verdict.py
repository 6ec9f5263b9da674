"""The verdict of the study on stitched boards, clause by clause; what was not measured is not said."""

from testfield.study.stitching.key_figures import GOOD_PX, Figures
from testfield.study.stitching.phrases import (
    TELLING_WORLDS,
    Known,
    MissingFigure,
    about,
    apart,
    both_kinds,
    order,
    pick,
    px,
    ratio,
    said,
    um,
)
from testfield.study.stitching.plan import CHAIN
from testfield.study.stitching.scenes import PITCH_MM


def verdict(figures: Figures) -> str:
    """The verdict on the claim."""
    clauses = said(figures, (_head, _as_full, _rendered, _cost, _chain, _wide, _prints, _close))
    return " ".join(clauses) or "Not decided: no case that bears on the claim is finished."


def _head(f: Known) -> str:
    """As a method: is the lens known well? To the letter: has stitching no error?"""
    found = said(f.figures, (_method, _letter))
    return f"{'; '.join(found)}." if f["planned_corner_px"] and found else ""


def _method(f: Known) -> str:
    if f["planned_corner_px_worlds"] < TELLING_WORLDS:
        raise MissingFigure("worlds enough")
    return pick(
        about(f, "planned_corner_px", GOOD_PX),
        "Holds as a method",
        f"Whether it holds as a method (corners within {GOOD_PX} px) cannot be told here",
        f"Does not hold as a method (corners within {GOOD_PX} px)",
    )


def _letter(f: Known) -> str:
    return pick(
        about(f, "cost_ratio", 1),
        "to the letter too, for stitching makes nothing worse",
        "whether to the letter cannot be told, for no error of stitching shows",
        "not to the letter, for stitching has an error",
    )


def _as_full(f: Known) -> str:
    against = pick(
        order(f, "planned_corner_px", "full_corner_px"), "less than", "which cannot be told apart from",
        f"{f['planned_corner_px'] / f['full_corner_px']:.1f} times",
    )  # fmt: skip
    return (
        f"{f['most_boards']} stitched boards know the lens at the image's corners to {px(f, 'planned')} "
        f"({f['planned_corner_px_worlds']:.0f} worlds, drawn pixels), {against} the error of an ideal full-size board "
        f"with as many marks ({px(f, 'full')})."
    )


def _rendered(f: Known) -> str:
    found = said(f.figures, (_rendered_planned, _rendered_full, _rendered_close))
    return f"On rendered images: {'; '.join(found)}." if found else ""


def _rendered_planned(f: Known) -> str:
    return f"{f['rendered_planned_boards']} stitched boards {both_kinds(f, 'planned')}"


def _rendered_full(f: Known) -> str:
    return f"the full-size board with the marks of {f['rendered_full_boards']} {both_kinds(f, 'full')}"


def _rendered_close(f: Known) -> str:
    return f"one small board from close by {both_kinds(f, 'close')}"


def _cost(f: Known) -> str:
    return pick(
        about(f, "cost_ratio", 1),
        f"Boards of unknown pose give better check points than boards of given pose (error ratio {_cost_ratio(f)}).",
        f"That unknown poses cost anything cannot be told from {f['cost_worlds']} worlds (check points in the first "
        f"board's frame, error ratio {_cost_ratio(f)}).",
        f"Stitching's error is estimated with everything else: check points in the first board's frame err "
        f"{_cost_ratio(f)} times as much as with poses given exactly.",
    )


def _cost_ratio(f: Known) -> str:
    return ratio(f, "cost_ratio", 2)


def _chain(f: Known) -> str:
    key = "chain_printed_close_out"
    grown = apart(*(f[f"{key}_{end}_mm"] for end in ("low", "high", "first_low", "first_high")))
    last = f"{um(f, key)} after {CHAIN - 1} links of {PITCH_MM:.0f} mm"
    return pick(
        grown,
        f"Along a chain the error shrinks to {last}.",
        f"Whether it grows along a chain cannot be told from {f[f'{key}_worlds']:.0f} worlds: {last}.",
        f"What is left of it grows along a chain, to {last}.",
    )


def _wide(f: Known) -> str:
    return pick(
        about(f, "loops_exact_out", 1),
        f"Four wide views make what image noise adds worse (they divide it by {ratio(f, 'loops_exact_out')}).",
        "That four wide views lessen what image noise adds cannot be told from "
        f"{f['loops_exact_out_worlds']} worlds (they divide it by {ratio(f, 'loops_exact_out')}).",
        f"Four wide views divide what image noise adds by {ratio(f, 'loops_exact_out')}.",
    )


def _prints(f: Known) -> str:
    by = ratio(f, "loops_printed_up", 2)
    return pick(
        about(f, "loops_printed_up", 1),
        f"Where print errors rule, upwards, they make the last board's place worse (divided by {by}).",
        "That they help where print errors rule, upwards, cannot be told from "
        f"{f['loops_printed_up_worlds']} worlds (divided by {by}).",
        f"Where print errors rule, upwards, they divide the last board's error by {by}.",
    )


def _close(f: Known) -> str:
    one = f"one small board shown all over the image from close by, {px(f, 'close')},"
    return pick(
        order(f, "close_corner_px", "planned_corner_px"),
        f"For the lens alone stitching is not needed: {one} is better than {f['most_boards']} stitched boards.",
        f"For the lens alone {one} cannot be told apart from {f['most_boards']} stitched boards.",
        f"For the lens alone {one} is worse than {f['most_boards']} stitched boards.",
    )
