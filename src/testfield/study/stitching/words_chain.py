"""What the study on stitched boards says of errors that grow along a chain."""

from testfield.study.stitching.intervals import LEAST_WORLDS
from testfield.study.stitching.phrases import Known, about, pick, ratio, um
from testfield.study.stitching.plan import CHAIN, LONG_CHAIN, PRINT_MM

OUT, UP = "out of the plane", "upwards"


def _noise(f: Known) -> str:
    return (
        f"Growth by image noise alone (boards printed exactly), after {CHAIN - 1} links, {OUT}: "
        f"{_law(f, 'chain_exact_close_out')}. {UP.capitalize()}: {_law(f, 'chain_exact_close_up')}."
    )


def _independent(f: Known) -> str:
    by = ratio(f, "chain_exact_close_out_turn_lag", 2)
    return pick(
        about(f, "chain_exact_close_out_turn_lag", 0),
        f"Links are not independent, as the law takes them to be: turns of neighbours correlate by {by} {OUT}.",
        f"That links are not independent cannot be told: turns of neighbours correlate by {by} {OUT}.",
        f"Links are not independent, as the law takes them to be: turns of neighbours add up ({by} {OUT}), for all "
        "share one camera.",
    )


def _wide(f: Known) -> str:
    return (
        f"Four wide views bring the errors by image noise to {um(f, 'chain_exact_wide_out')} {OUT}, "
        f"{_divided(f, 'loops_exact_out')}, and {um(f, 'chain_exact_wide_up')} {UP}, {_divided(f, 'loops_exact_up')}."
    )


def _prints(f: Known) -> str:
    return (
        f"Growth with print errors of {PRINT_MM} mm, {OUT}: {_law(f, 'chain_printed_close_out')}. {UP.capitalize()}: "
        f"{_law(f, 'chain_printed_close_up')}."
    )


def _random_walk(f: Known) -> str:
    """A random walk of the links would follow the law; prints that turn back their neighbours stay below it."""
    key = "chain_printed_close_up"
    lag, back = ratio(f, f"{key}_turn_lag", 2), about(f, f"{key}_turn_lag", 0)
    law = against(f, key)
    if law == "too much" and back < 0:
        return (
            "Print errors make no random walk: what turns a board against one neighbour turns it back against the "
            f"next (turns of neighbouring links correlate by {lag}), and the law asks too much."
        )
    if law == "too little" or back > 0:
        return (
            "Print errors add up more than a random walk of the links would (turns of neighbouring links correlate by "
            f"{lag}, and the law asks {law if law != 'which agrees' else 'what is found'})."
        )
    if law == "which agrees" and back == 0 and f[f"{key}_worlds"] >= LEAST_WORLDS:
        return (
            f"Nothing speaks against a random walk of print errors: the law agrees {UP}, and turns of neighbouring "
            f"links correlate by {lag}."
        )
    return (
        f"Whether print errors make a random walk {f[f'{key}_worlds']:.0f} worlds are too few to tell: the law "
        f"{'agrees' if law == 'which agrees' else 'asks too much'}, and turns of neighbouring links correlate by {lag}."
    )


def _prints_wide(f: Known) -> str:
    return (
        f"With print errors four wide views leave {um(f, 'chain_printed_wide_out')} {OUT}, "
        f"{_divided(f, 'loops_printed_out')}, and {um(f, 'chain_printed_wide_up')} {UP}, "
        f"{_divided(f, 'loops_printed_up')}."
    )


def _print_turn(f: Known) -> str:
    return (
        f"A link's turn in the plane by print errors alone is {f['print_turn_mrad']:.4f} mrad; marks' noise over the "
        f"root of their squared distances predicts {f['print_turn_expected_mrad']:.4f} mrad."
    )


def _mother(f: Known) -> str:
    return (
        f"After a fit of six parameters {1e3 * f['chain_printed_close_up_mother_rms_mm']:.1f} µm rms of the chain's "
        f"mother board remain without and {1e3 * f['chain_printed_wide_up_mother_rms_mm']:.1f} µm with four wide "
        f"views, {_divided(f, 'loops_printed_mother')}."
    )


def _long(f: Known) -> str:
    return (
        f"{LONG_CHAIN} boards printed exactly, {OUT}: {_law(f, 'long_exact_close_out')}. With wide views of eight "
        f"boards each {um(f, 'long_exact_wide_out')}. With print errors, {UP}: {_law(f, 'long_printed_close_up')}; "
        f"with wide views {um(f, 'long_printed_wide_up')}."
    )


def _claims(f: Known) -> str:
    return (
        "What the bundle claims along the chain: NEES of board poses per degree of freedom is "
        f"{f['chain_drawn_nees']:.2f} on drawn pixels, 1 being true."
    )


def _claims_rendered(f: Known) -> str:
    worlds = f["chain_rendered_worlds"]
    return (
        f"On rendered images that NEES is {f['chain_rendered_nees']:.2f} ({worlds} world{'s' if worlds > 1 else ''})."
    )


def _law(f: Known, key: str) -> str:
    law_um, shared_um, claimed_um = (1e3 * f[f"{key}_{end}_mm"] for end in ("law", "law_shared", "claimed"))
    return (
        f"{um(f, key)}; the law says {law_um:.0f} µm, {against(f, key)}, with the covariance of a link's shift "
        f"and turn {shared_um:.0f} µm, and the bundle claims {claimed_um:.0f} µm"
    )


def against(f: Known, key: str) -> str:
    """The law against the interval of what was found."""
    if f[f"{key}_law_mm"] > f[f"{key}_high_mm"]:
        return "too much"
    return "too little" if f[f"{key}_law_mm"] < f[f"{key}_low_mm"] else "which agrees"


def _divided(f: Known, name: str) -> str:
    by = ratio(f, name, 2)
    return pick(
        about(f, name, 1),
        f"which is worse (divided by {by})",
        f"no difference that {f[f'{name}_worlds']} worlds tell (divided by {by})",
        f"divided by {by}",
    )


GROWTH = (
    _noise, _independent, _wide, _prints, _random_walk, _prints_wide, _print_turn, _mother, _long, _claims,
    _claims_rendered,
)  # fmt: skip
