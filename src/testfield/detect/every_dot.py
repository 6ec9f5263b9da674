"""All dots of a photograph: as they are found one by one, then what needs another look."""

import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.dense_dots import measure_dense
from testfield.detect.detect import measure_targets
from testfield.detect.interlace import combed, even_lines, in_all_lines
from testfield.detect.knobs import AUTO_LINES, DEFAULT, EVEN_LINES, Knobs
from testfield.detect.shade import measure_shaded
from testfield.detect.targets import Targets
from testfield.targets.code_table import CodeTable
from testfield.targets.marks import RingRadii

REACH = 2.2
"""How many radii around a dot without a ring the light counts."""


def measured(
    image_dn: np.ndarray,
    sheet: SensorSheet,
    bits: int | None,
    radii: RingRadii,
    smallest_px: float,
    codes: CodeTable | None = None,
    knobs: Knobs = DEFAULT,
) -> tuple[Targets, list[str]]:
    """Targets in an image (h, w) float32 of bright marks whose sensor's `sheet` is estimated, and notes on how they
    were measured; `bits` None: plain dots. Other arguments as of `measure_targets`."""
    notes: list[str] = []
    jagged = combed(image_dn) if knobs.lines == AUTO_LINES else None
    halved = jagged is not None or knobs.lines == EVEN_LINES
    if jagged is not None:
        notes.append(
            f"interlaced, the odd lines shifted by {jagged.shift_px:.1f} px: the even lines alone are measured"
        )
    image = even_lines(image_dn) if halved else image_dn
    least, most = (px / np.sqrt(2) if halved else px for px in (smallest_px, knobs.largest_px))

    def look(seen: np.ndarray, places: tuple[np.ndarray, np.ndarray] | None = None) -> Targets:
        return measure_targets(
            seen,
            sheet,
            "ellipse_model",
            least,
            bits,
            radii,
            most,
            by_contour=True,
            codes=codes,
            unclear=knobs.unclear,
            finder=None if places is None else lambda *_: places,
        )

    targets = look(image)
    if knobs.dense and bits is None:  # a ring needs room
        targets = measure_dense(image, sheet, targets, look)
    if knobs.shade:
        targets = measure_shaded(image, sheet, targets, REACH if bits is None else radii.outer + 0.5, look)
    return (in_all_lines(targets) if halved else targets), notes
