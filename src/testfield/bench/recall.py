"""How many targets in clutter are found and read rightly, and what is taken for one that is none."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from testfield.bench.clutter import ClutteredView, cluttered_view
from testfield.bench.clutter_world import SENSOR
from testfield.camera.images import Frame
from testfield.detect.bright import bright_marks
from testfield.detect.every_dot import measured
from testfield.detect.observations import MEASURED
from testfield.detect.targets import Targets
from testfield.evaluate.check import Check, Limit
from testfield.render.fast import render_fast
from testfield.render.stage import build_stage
from testfield.sensor.expose import expose

CELLS = 2
SMALLEST_PX = 5.0
SAME = 0.35
"""A detection within this part of a target's diameter from its centre is that target's."""

FOUND, READ = 99.5, 99.9
"""Percent that must be found, and of these be read rightly."""
LARGEST_TILT_DEG = 60.0
"""Up to which targets must be found."""
BANDS_DEG = ((0, 20), (20, 40), (40, 60), (60, 70))


@dataclass
class Recall:
    """Counts over views: targets rendered, those in clear sight of at least 8 px and at most 60 degrees, and of these
    found and found with the right code; wrong numbers and false finds anywhere; why clear ones were missed; and by
    bands of tilt, up to 70 degrees, how many were in clear sight and found."""

    views: int = 0
    rendered: int = 0
    clear: int = 0
    found: int = 0
    right: int = 0
    wrong: int = 0
    false: int = 0
    empty_views: int = 0
    false_in_empty_views: int = 0
    missed: Counter = field(default_factory=Counter)
    clear_by_tilt: Counter = field(default_factory=Counter)
    found_by_tilt: Counter = field(default_factory=Counter)

    def figures(self) -> dict[str, Any]:
        """As one JSON object."""
        clear, found = max(self.clear, 1), max(self.found, 1)
        figures = {
            "found_percent": 100 * self.found / clear,
            "decoded_rightly_percent": 100 * self.right / found,
            "missed": dict(self.missed.most_common()),
            "clear_by_tilt": dict(self.clear_by_tilt),
            "found_by_tilt": dict(self.found_by_tilt),
        }
        return vars(self) | figures | {"verdicts": self.verdicts()}

    def verdicts(self) -> list[dict[str, Any]]:
        """What is asked, what was measured, and whether that is enough; nothing is met that was not tried."""
        found, right = 100 * self.found / max(self.clear, 1), 100 * self.right / max(self.found, 1)
        asked = [
            (
                f"found of {self.clear} in clear sight, 8 px or more, to 60 degrees, %",
                found,
                Limit(least=FOUND),
                self.clear,
            ),
            ("of these read rightly, %", right, Limit(least=READ), self.found),
            (f"wrong numbers in {self.rendered} targets", self.wrong, Limit(most=0), self.rendered),
            (
                f"false finds in {self.empty_views} views without targets",
                self.false_in_empty_views,
                Limit(most=0),
                self.empty_views,
            ),
        ]
        return [
            {
                "name": name,
                "measured": value,
                "limit": limit.most if np.isinf(limit.least) else limit.least,
                "met": bool(tried) and Check(name=name, value=value, limit=limit).passed,
            }
            for name, value, limit, tried in asked
        ]


def bench_recall(
    targets: int, empty_views: int, tell: Callable[[str], None] = lambda _: None, seed: int = 1
) -> dict[str, Any]:
    """Render views until `targets` are in them, and `empty_views` of clutter alone, and count what is found."""
    recall = Recall()
    while recall.rendered < targets:
        view = cluttered_view(seed, recall.views)
        count(recall, view, look(view, take(view, seed + recall.views)))
        tell(
            f"{recall.rendered} of {targets} targets: {recall.right} right, {recall.wrong} wrong, {recall.false} false"
        )
    while recall.empty_views < empty_views:
        view = cluttered_view(seed, recall.empty_views, targets=False)
        found = look(view, take(view, seed + recall.empty_views))
        recall.false_in_empty_views += int((found.status == MEASURED).sum())
        recall.empty_views += 1
        tell(f"{recall.empty_views} of {empty_views} views without targets: {recall.false_in_empty_views} false")
    return recall.figures()


def take(view: ClutteredView, seed: int) -> Frame:
    """The view's frame."""
    return expose(render_fast(build_stage(view.world), view.light, 0, CELLS), SENSOR, seed)


def look(view: ClutteredView, frame: Frame) -> Targets:
    """What detection finds in it, told only what kind of targets there are."""
    sheet_field = view.world.field
    image, sheet = bright_marks(frame, sheet_field.white_on_black)
    return measured(image, sheet, sheet_field.bits, sheet_field.radii, SMALLEST_PX)[0]


def count(recall: Recall, view: ClutteredView, found: Targets) -> None:
    """Add one view's counts."""
    good = found.status == MEASURED
    n = len(view.code)
    distance = np.linalg.norm(found.xy_px[:, None] - view.xy_px[None], axis=2)
    distance = np.where(np.isfinite(distance), distance, np.inf)
    near = np.argmin(distance, axis=1) if n else np.zeros(len(good), int)
    here = distance[np.arange(len(near)), near] < SAME * view.diameter_px[near] if n else np.zeros(len(near), bool)
    row = np.full(n, -1)  # of the detection that is this target, a measured one where there are several
    for rows in (np.flatnonzero(here), np.flatnonzero(here & good)):
        row[near[rows]] = rows
    hit = (row >= 0) & good[row] if len(good) else np.zeros(n, bool)
    number = np.where(hit, np.maximum(found.code[row], 0), -1) if len(good) else np.full(n, -1)
    recall.views += 1
    recall.rendered += n
    asked = view.clear & (view.tilt_deg <= LARGEST_TILT_DEG)
    recall.clear += int(asked.sum())
    recall.found += int((asked & hit).sum())
    recall.right += int((asked & (number == view.code)).sum())
    for low, high in BANDS_DEG:
        band = view.clear & (view.tilt_deg > low) & (view.tilt_deg <= high)
        recall.clear_by_tilt[f"{low}-{high}"] += int(band.sum())
        recall.found_by_tilt[f"{low}-{high}"] += int((band & hit).sum())
    for k in np.flatnonzero(asked & ~hit):
        recall.missed[str(found.status[row[k]]) if row[k] >= 0 else "not seen at all"] += 1
    recall.wrong += int((hit & (number > 0) & (number != view.code)).sum())
    recall.wrong += int((good & ~here & (found.code > 0)).sum())
    recall.false += int((good & ~here).sum())
