"""The preview: what will be measured, before anything long starts."""

import io
from pathlib import Path

from testfield.camera.images import Radiance
from testfield.report.plan import ELEVATION, PLAN, draw_field, zoom
from testfield.report.style import figure, shown
from testfield.scene.world import World

SMALL_PX = (440, 220)
"""Width and height of a gallery's picture."""
COLOURS = 32
"""As many as a picture of 15 kB holds."""


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


def draw_small(world: World, view: Radiance, path: Path) -> None:
    """Plan and a view side by side without words, small enough for a gallery."""
    from PIL import Image

    width, height = SMALL_PX
    with figure(width / 100, height / 100, 0) as (drawing, _):
        plan, picture = drawing.subplots(1, 2, width_ratios=(1, 1.15))
        draw_field(plan, world, PLAN, stations=True)
        zoom(plan, world, PLAN)
        for text in plan.texts:
            text.set_visible(False)
        plan.set_axis_off()
        # A mean of pixels, or a thin ring would come and go between those that are shown.
        picture.imshow(shown(view.values), cmap="gray", vmin=0, vmax=1, interpolation="antialiased")
        picture.set_axis_off()
        drawing.get_layout_engine().set(w_pad=0.01, h_pad=0.01, wspace=0.02)
        buffer = io.BytesIO()
        drawing.savefig(buffer, format="png", dpi=100)
    image = Image.open(buffer).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    with path.open("wb") as file:
        image.save(file, format="PNG", optimize=True)
