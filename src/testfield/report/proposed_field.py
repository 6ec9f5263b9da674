"""Pictures of a proposed field: every board with every number, and a photograph with all numbers."""

from pathlib import Path

import cv2
import numpy as np

from testfield.camera.photograph import Photograph
from testfield.detect.observations import MEASURED, Observations
from testfield.measure.proposed_field import Group, Proposal
from testfield.report.style import FAINT, INK, WARM, figure, shown
from testfield.store.atomic import whole
from testfield.targets.field import TIME

COLOURS = ("#14699c", "#c4502a", "#2e8b57", "#8a4fb0", "#b8860b", "#0f8b8d", "#a83262", "#5a6b2f")


def colour_of(number: int) -> str:
    """The colour of the group of that number."""
    return COLOURS[number % len(COLOURS)]


def draw_board(group: Group, number: int, path: Path, scale_ends: tuple[int, int] = (0, 0)) -> None:
    """A board as it is seen from the front, every code with its number; the two ends of the scale are marked."""
    xy = group.xyz[:, :2]
    span = np.maximum(np.ptp(xy, axis=0), 0.15 * max(float(np.ptp(xy, axis=0).max()), 1e-9))
    width = 9.0
    height = float(np.clip(width * span[1] / span[0], 2.0, 12.0))
    with figure(width, height + 0.9) as (drawing, axes):
        axes.scatter(*xy.T, s=26, color=colour_of(number), zorder=4, lw=0)
        ends = [int(np.flatnonzero(group.code == c)[0]) for c in scale_ends if c in group.code]
        if len(ends) == 2:
            axes.plot(*xy[ends].T, color=WARM, lw=1, ls=(0, (5, 4)), zorder=3)
            axes.scatter(*xy[ends].T, s=95, facecolors="none", edgecolors=WARM, zorder=5)
        for code, at in zip(group.code, xy, strict=True):
            axes.annotate(str(code), at, (4, 4), textcoords="offset points", fontsize=8.5, color=INK, zorder=6)
        axes.set_xlim(xy[:, 0].min() - 0.07 * span[0], xy[:, 0].max() + 0.09 * span[0])
        axes.set_ylim(xy[:, 1].min() - 0.07 * span[1], xy[:, 1].max() + 0.09 * span[1])
        axes.set_aspect("equal")
        axes.grid(color=FAINT, lw=0.3, alpha=0.6)
        axes.set_xlabel("x, arbitrary unit")
        axes.set_ylabel("y, arbitrary unit")
        title = f"{group.name}: {len(group.code)} codes, seen from the front"
        if len(ends) == 2:
            title += "; dashed: the distance to measure"
        axes.set_title(title, loc="left")
        with whole(path) as part:
            drawing.savefig(part, format="png", dpi=130, metadata={"Software": None})


def draw_photograph(photograph: Photograph, seen: Observations, proposal: Proposal, path: Path) -> None:
    """A photograph with the number of every code, in its board's colour; grey: a code without a board."""
    grey = (255 * shown(photograph.pixels)).astype(np.uint8)
    factor = max(1, round(2400 / max(grey.shape)))
    picture = cv2.cvtColor(cv2.resize(grey, None, fx=factor, fy=factor), cv2.COLOR_GRAY2BGR)
    board = {int(c): k for k, group in enumerate(proposal.groups) for c in group.code}
    size = max(0.5, max(picture.shape) / 3200)
    for k in np.flatnonzero((seen.status == MEASURED) & (seen.code > 0)):
        code = int(seen.code[k]) % TIME
        name = colour_of(board[code]) if code in board else "#808080"
        colour = tuple(int(name[i : i + 2], 16) for i in (5, 3, 1))
        at = tuple(int(v) for v in np.rint(factor * (seen.xy_px[k] + 0.5)))
        around = max(4, round(factor * float(np.nan_to_num(seen.diameter_px[k], nan=8)) * 0.75))
        cv2.circle(picture, at, around, colour, 2, cv2.LINE_AA)
        place = (at[0] + around + 2, at[1] - around // 2)
        wide, high = cv2.getTextSize(str(code), cv2.FONT_HERSHEY_SIMPLEX, size, 2)[0]
        cv2.rectangle(picture, (place[0] - 2, place[1] + 3), (place[0] + wide + 2, place[1] - high - 3), colour, -1)
        cv2.putText(picture, str(code), place, cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), 2, cv2.LINE_AA)
    with whole(path) as part:
        cv2.imwrite(str(part), picture)
