"""The preview: what will be measured, before anything long starts."""

from pathlib import Path

import numpy as np

from testfield.camera.images import Radiance
from testfield.report.plan import ELEVATION, PLAN, draw_field, zoom
from testfield.report.style import figure
from testfield.scene.world import World


def draw_preview(world: World, view: Radiance, station: str, path: Path) -> None:
    """Plan, elevation and a view side by side as PNG."""
    with figure(15, 5.2, 3, width_ratios=(1, 1, 1.15)) as (drawing, (plan, elevation, picture)):
        for axes, plane, title in ((plan, PLAN, "plan"), (elevation, ELEVATION, "elevation")):
            draw_field(axes, world, plane, stations=True)
            zoom(axes, world, plane)
            axes.set_title(f"{world.name}: {title}", loc="left")
        picture.imshow(
            (view.values / np.percentile(view.values, 99.7)).clip(0, 1) ** (1 / 2.2),
            cmap="gray",
            vmin=0,
            vmax=1,
        )
        picture.set_title(f"view from {station}", loc="left")
        picture.set_axis_off()
        drawing.savefig(path, dpi=110, metadata={"Software": None})
