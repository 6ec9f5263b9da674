"""The preview: what will be measured, before anything long starts."""

from pathlib import Path

from testfield.camera.images import Radiance
from testfield.report.plan import ELEVATION, PLAN, draw_field, zoom
from testfield.report.style import figure, shown
from testfield.scene.world import World


def draw_preview(world: World, view: Radiance, station: str, path: Path) -> None:
    """Plan, elevation and a view side by side as PNG."""
    with figure(13, 6.4, 0) as (drawing, _):
        parts = drawing.subplot_mosaic([["elevation", "view"], ["plan", "view"]], width_ratios=(1, 1.25))
        for name, plane in (("elevation", ELEVATION), ("plan", PLAN)):
            axes = parts[name]
            draw_field(axes, world, plane, stations=True)
            zoom(axes, world, plane)
            axes.set_title(f"{world.name}: {name}", loc="left")
        picture = parts["view"]
        picture.imshow(shown(view.values), cmap="gray", vmin=0, vmax=1)
        picture.set_title(f"view from {station}", loc="left")
        picture.set_axis_off()
        drawing.savefig(path, dpi=100, metadata={"Software": None})
