"""Crops of worst cases, with what each recipe found drawn in."""

from collections.abc import Mapping, Sequence

import numpy as np

from testfield.evaluate.compare_drawings import Drawing, finished, slug
from testfield.evaluate.worst import Crop
from testfield.report.style import figure, shown

WIDTH_IN = 42 / 25.4
"""Half a column of 85 mm."""
REACH = 0.55
"""The longest error as drawn, over half the crop's width."""


def crop_drawings(crops: Sequence[Crop], colours: Mapping[str, str]) -> list[Drawing]:
    """A figure for each crop: the pixels, a cross at the true centre, an arrow for each recipe that found it."""
    return [_drawn(crop, colours) for crop in crops]


def enlargement(crop: Crop) -> float:
    """By how much errors are drawn longer than they are, so that they are seen: 1, 2 or 5 times a power of ten."""
    longest = max((float(np.hypot(*error)) for error in crop.worst.found.values()), default=0.0)
    if not longest > 0:
        return 1.0
    wanted = REACH * min(crop.pixels_dn.shape) / 2 / longest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted))


def _drawn(crop: Crop, colours: Mapping[str, str]) -> Drawing:
    times, worst = enlargement(crop), crop.worst
    height, width = crop.pixels_dn.shape
    with figure(WIDTH_IN, WIDTH_IN * height / width) as (drawing, axes):
        dark = crop.pixels_dn.astype(float) - crop.pixels_dn.min()
        axes.imshow(shown(dark), cmap="gray", vmin=0, vmax=1, interpolation="nearest")
        x, y = crop.xy_px
        axes.plot(x, y, "+", color="black", markersize=9, markeredgewidth=2.2)
        axes.plot(x, y, "+", color="white", markersize=8, markeredgewidth=0.9)
        for name, error in worst.found.items():
            axes.plot(*np.column_stack([(x, y), (x, y) + times * error]), color=colours[name], linewidth=1.4)
            axes.plot(
                *((x, y) + times * error), "o", color=colours[name], markersize=4, markeredgecolor="white", mew=0.5
            )
        axes.set_xlim(-0.5, width - 0.5)
        axes.set_ylim(height - 0.5, -0.5)
        axes.set_axis_off()
        missed = np.isnan(worst.error_px)
        said = "missed" if missed else f"{worst.error_px:.4f} px"
        without = [name for name in colours if name not in worst.found]
        more = f"; errors {times:g} times enlarged" if worst.found else ""
        more += f"; not found by {', '.join(without)}" if without else ""
        kind = "missed" if missed else "worst"
        title = f"{'a target' if missed else worst.recipe}: {said} ({crop.where}{more})"
        return finished(f"{kind}_{slug(worst.recipe)}", "crops", title, drawing)
