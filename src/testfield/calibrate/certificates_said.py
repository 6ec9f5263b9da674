"""What a reader is told of certificates: records and sentences."""

from collections.abc import Iterable

import numpy as np

from testfield.adjust.snooping import Blunder
from testfield.calibrate.certified import OTHER_UNIT
from testfield.calibrate.misclosure import DIAMETERS, DISTANCE, PLACE, PLACES, Item, Misclosure
from testfield.calibrate.units import unit_of
from testfield.targets.field import ScaleBar


def other_unit(ratio: float) -> bool:
    """Whether a ratio of lengths is that of two units."""
    return abs(np.log(max(ratio, 1e-4))) > np.log(OTHER_UNIT)


def called(item: Item, bars: list[ScaleBar]) -> str:
    """What a reader calls a certified length or place."""
    if item.kind == DISTANCE:
        return f"the distance '{item.name}' ({bars[item.key].length_mm:g} mm)"
    return f"the certified place of {item.name}" if item.kind == PLACE else item.name


def part_of(item: Item, blunder: Blunder, bars: list[ScaleBar]) -> float:
    """The blunder as a part of what is certified."""
    amount = float(np.linalg.norm(blunder.amount))
    return amount / bars[item.key].length_mm if item.kind == DISTANCE else amount


def scale_source(scale_from: str, left: Iterable[ScaleBar]) -> str:
    """What the scale rests on, in words."""
    names = ", ".join(f"'{bar.name}'" for bar in left)
    return {"control points": "the certified places", "distances": names}.get(scale_from, "none of them")


def said_of_certificates(
    item: Item, blunder: Blunder, off: Misclosure, bars: list[ScaleBar], known: dict[int, tuple[np.ndarray, np.ndarray]]
) -> str:
    """What is wrong with a certificate, by how much, and what that looks like."""
    sure = f"{blunder.sigmas:.3g} standard deviations"
    if item.kind == DISTANCE:
        bar, by = bars[item.key], float(blunder.amount[0])
        others = bar.length_mm - by
        ratio = others / bar.length_mm if others > 0 else np.inf
        guess = ""
        if not 1 / OTHER_UNIT < ratio < OTHER_UNIT:
            ratio = max(ratio, 1 / max(ratio, 1e-12))
            guess = f", in another unit or between other codes; {unit_of(ratio, 'length').rstrip('?')}"
        return (
            f"the distance '{bar.name}' ({bar.length_mm:g} mm) is {by:+.4g} mm off what the rest says ({sure}{guess})"
        )
    if item.kind == PLACE:
        xyz, _ = known[item.key]
        seen = xyz - blunder.amount if len(blunder.amount) == 3 else off.here_mm[item.key]
        far = float(np.linalg.norm(xyz - seen))
        other = min((float(np.linalg.norm(seen - v[0])), c) for c, v in known.items() if c != item.key)
        swapped = f", and lies where code {other[1]} is certified: are they exchanged?" if other[0] < 0.05 * far else ""
        return f"code {item.key} is {far:.3g} mm off its certified place ({sure}{swapped})"
    by = float(blunder.amount[0])
    if item.kind == PLACES:
        times = 1 / max(1 - by, 1e-12)
        if not 1 / OTHER_UNIT < times < OTHER_UNIT:
            return f"the certified places are {times:.4g} times as far apart as the rest says ({sure}): in another unit"
        return f"the scale of the certified places is off by {100 * by:+.3g} % ({sure})"
    by = by / 1000
    guess = ": they are in another unit" if other_unit(1 + by) else ""
    wide = off.diameter_mm / max(1 + by, 1e-12)
    return f"the dots are {wide:.4g} mm wide, and certified as {off.diameter_mm:.4g} mm ({sure}{guess})"


def record_of(item: Item, sigmas: float, found: Blunder | None, off: Misclosure, bars: list[ScaleBar]) -> dict:
    """What is kept of a certificate's test."""
    error = None if found is None else float(np.linalg.norm(found.amount))
    if error is not None and item.kind == DIAMETERS:
        error /= 1000  # a part, from thousandths
    return {
        "certificate": item.name,
        "kind": item.kind,
        "sigmas": float(found.sigmas if found else sigmas),
        "off": error,
        "used": found is None,
        "contradicts": [off.items[k].name for k in found.alike] if found else [],
    }
