"""The study on the flexible stitched board: the plan of its cases.

Two kinds of evidence stand side by side. *Rendered*: images with real noise, detected and measured. *Drawn*: pixels
drawn from the truth at the physical bound, no images, so that hundreds of worlds cost little; what detection does wrong
is missing there. In both, every world draws print errors, the boards' common scale and the control bar anew.
"""

from itertools import product
from typing import Any

from testfield.evaluate.case import Case
from testfield_studies.stitching import scenes
from testfield_studies.stitching.experiment import NO_BAR

WORK = "testfield_studies.stitching.experiment"
WINDOWS = (0.35, 0.5, 0.65, 0.8, 1.0)
"""Middle parts of the image, by side, to which observations are confined."""
CHAIN, LONG_CHAIN, PER_CASE = 8, 16, 10
QUICK = 6
"""Drawn worlds of the quick setting: the fewest whose extremes make a 95 % interval of the median."""
PRINT_MM = 0.01
"""Print errors of the boards; a chain's are drawn without them too, for the growth law knows none."""
Row = dict[str, Any]


def cases(quick: bool) -> list[Case]:
    """All cases, the longest first; the quick setting has fewer counts, windows, worlds and renders."""
    return [*_chains(quick), *_counts(quick), *_opponents(quick), *_faults(quick)]


def _counts(quick: bool) -> list[Case]:
    """How many boards, how placed, and how much of the image they cover."""
    found = []
    plan = (
        {"planned": (1, 3, 12), "flat": (3,), "random": (3,)}
        if quick
        else {"planned": (1, 2, 3, 4, 6, 9, 12), "flat": (3, 6, 12), "random": (3, 6, 12)}
    )
    rendered = (
        [("planned", 3), ("planned", 12)]
        if quick
        else [*(("planned", n) for n in (1, 3, 6, 12)), *product(("flat", "random"), (3, 12))]
    )
    for placement, counts in plan.items():
        for count in counts:
            labels = {"experiment": "count", "target": placement, "boards": count, "level": 0.0}
            methods = ["stitched", *_told(placement, count, quick)]
            for seed in range(1, 2 if quick else 3) if (placement, count) in rendered else ():
                more = ["zhang", NO_BAR] if count > 1 else [NO_BAR]
                options = {
                    "methods": [*methods, *more],
                    "windows": _windows(placement, count, () if quick else WINDOWS),
                }
                found.append(_rendered(labels, seed, scenes.field(placement, count, seed), options))
            found += _drawn(labels, QUICK if quick else 20, methods, ("field", placement, count))
    labels = {"experiment": "coverage", "target": "planned", "boards": 12, "level": 0.0}
    windows = (0.5, 0.8, 1.0) if quick else WINDOWS
    return found + _drawn(labels, 4 if quick else 10, [], ("field", "planned", 12), windows=windows)


def _told(placement: str, count: int, quick: bool) -> list[str]:
    """The method that is compared with stitching: one board alone, or all poses given."""
    if count == 1:
        return ["zhang"]
    return ["stitched_given"] if placement == "planned" and (count == 12 or not quick) else []


def _windows(placement: str, count: int, windows: tuple[float, ...]) -> tuple[float, ...]:
    return windows if (placement, count) == ("planned", 12) else ()


def _opponents(quick: bool) -> list[Case]:
    """An ideal full-size board, ChArUco of the same area, and one small board close by."""
    found = []
    worlds, drawn = range(1, 2 if quick else 3), QUICK if quick else 20
    for count in (3, 12) if quick else (3, 6, 12):
        labels = {"experiment": "count", "target": "full-size", "boards": count, "level": 0.0}
        found += _drawn(labels, drawn, ["stitched"], ("full", count))
        for seed in worlds if count == 3 or not quick else ():
            if not quick:
                found.append(_rendered(labels, seed, scenes.full(count, seed), {"methods": ["stitched"]}))
            table, methods = scenes.charuco(count, seed), ["opencv", "stitched", NO_BAR]
            found.append(_rendered(labels | {"target": "charuco"}, seed, table, {"methods": methods}))
    for board, method in (("sub-board", "zhang"), ("charuco", "opencv"))[: 1 if quick else 2]:
        labels = {"experiment": "count", "target": f"{board}, close", "boards": 1, "level": 0.0}
        found += [_rendered(labels, seed, scenes.close(board, seed), {"methods": [method]}) for seed in worlds]
        found += _drawn(labels, drawn, [method], ("close", board)) if board == "sub-board" else []
    return found


def _faults(quick: bool) -> list[Case]:
    """Bent boards and boards with scale errors of their own; six planned boards."""
    found = []
    bows, scales = ((1.0,), (200.0,)) if quick else ((0.1, 0.3, 1.0, 3.0), (50.0, 200.0, 800.0))
    for fault, levels in (("bent", bows), ("scale", scales)):
        for level in levels:
            labels = {"experiment": fault, "target": "planned", "boards": 6, "level": level}
            value = {"bow_mm" if fault == "bent" else "scale_ppm": level}
            for seed in range(1, 3) if level in (1.0, 200.0) and not quick else ():
                table = scenes.field("planned", 6, seed, **value)
                found.append(_rendered(labels, seed, table, {"methods": ["stitched"]}))
            found += _drawn(labels, 4 if quick else 20, ["stitched"], ("field", "planned", 6), value)
    for level in bows:
        labels = {"experiment": "bent", "target": "full-size", "boards": 6, "level": level}
        found += _drawn(labels, 4 if quick else 20, ["stitched"], ("full", 6), {"bow_mm": level})
    return found


def _chains(quick: bool) -> list[Case]:
    """Rows of boards, without and with wide views."""
    found = []
    views = (0, 4) if quick else (0, 1, 2, 4)
    for seed in range(1, 2 if quick else 5):
        labels = {"experiment": "chain", "target": "chain", "boards": CHAIN, "level": PRINT_MM}
        table = scenes.chain(CHAIN, 4, seed)
        found.append(_rendered(labels, seed, table, {"wide": views}, "measure_chain", 1.8))
    plan = [(CHAIN, QUICK)] if quick else [(CHAIN, 100), (LONG_CHAIN, 40)]
    for (count, worlds), sigma in product(plan, (PRINT_MM, 0.0)):
        wide = views if count == CHAIN else (0, 1, 4)
        for first in range(0, worlds, PER_CASE):
            labels = {"experiment": "chain", "target": "chain", "boards": count, "level": sigma}
            options = {"seeds": list(range(1001 + first, 1001 + min(first + PER_CASE, worlds))), "wide": wide}
            found.append(_case(labels, "draw_chain", options, 0.015 * count * len(options["seeds"])))
    return found


def _rendered(
    labels: Row, seed: int, table: scenes.Table, options: Row, work: str = "measure_field", weight: float = 1.0
) -> Case:
    return Case(labels | {"evidence": "rendered", "world": seed}, f"{WORK}:{work}", table, options, weight)


def _drawn(
    labels: Row,
    worlds: int,
    methods: list[str],
    scene: tuple,
    values: Row | None = None,
    windows: tuple[float, ...] = (),
) -> list[Case]:
    found = []
    for first in range(0, worlds, PER_CASE):
        seeds = list(range(1001 + first, 1001 + min(first + PER_CASE, worlds)))
        options = {"scene": scene, "values": values or {}, "methods": methods, "seeds": seeds, "windows": windows}
        work = 0.005 * labels["boards"] * len(seeds) * (len(methods) + 2 * len(windows))
        found.append(_case(labels, "draw_field", options, work))
    return found


def _case(labels: Row, work: str, options: Row, weight: float) -> Case:
    name = {"evidence": "drawn", "first_world": options["seeds"][0]}
    return Case(labels | name, f"{WORK}:{work}", None, options, weight)
