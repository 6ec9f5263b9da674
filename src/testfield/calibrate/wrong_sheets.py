"""Sheets that miss the rest more than any observation does: which, and what is said of them."""

import numpy as np

from testfield.adjust.bundle import Adjustment, adjust
from testfield.adjust.reliability import global_test, reliability
from testfield.calibrate.settled import REJECT_SIGMA, Settled, residual_sizes
from testfield.calibrate.sheets import (
    SHAPE,
    Suspect,
    loosened,
    stretch,
    suspect,
)
from testfield.calibrate.start import Start

LEAST_STRETCH = 1e-4
"""Part by which a sheet's spacing must be off to be called so."""


def wrong_sheet(adjustment: Adjustment, labels: list[str], start: Start, names: list[str]) -> Suspect | None:
    """What of the sheets misses the rest by more than any observation does."""
    white = residual_sizes(adjustment, scaled=False)
    typical = max(float(np.median(white)) / 1.1774, 1.0)
    test = global_test(adjustment)
    loose = adjustment
    if test.variance > test.high or white.max(initial=0) > REJECT_SIGMA * typical:
        loose = adjust(loosened(adjustment.network), labels)
    found = suspect(loose, start.boards, names, typical)
    if found is None or (len(start.boards) < 2 and not found.marks):
        return None
    worst = float(reliability(loose).test.max(initial=0)) / typical
    return found if found.value - found.rank > worst**2 - 2 else None


def without_board(adjustment: Adjustment, found: Suspect, start: Start, left: np.ndarray, many: bool) -> Settled:
    """What is said of a board whose sheet is wrong."""
    network, name = adjustment.network, start.boards[found.board]
    said = f"the sheet of board '{name}' does not fit it ({np.sqrt(found.value):.3g} standard deviations)"
    *factors, alike = stretch(network, found.board, start.labels(network))
    shape = " and ".join(
        f"in {axis} {100 * (f - 1):+.2g} %" for axis, f in zip("xy", factors, strict=True) if abs(f - 1) > LEAST_STRETCH
    )
    if shape and alike > SHAPE:
        said += f": its spacing is off {shape}"
    elif many:
        said += ": many of its marks lie elsewhere (are they numbered or placed as on the sheet?)"
    if found.alike is not None:
        said += (
            f"; nothing decides between it and board '{start.boards[found.alike]}', which comes first on the field's "
            "sheet and is believed"
        )
    record = {
        "certificate": start.boards[found.board],
        "kind": "sheet",
        "sigmas": float(np.sqrt(found.value)),
        "off": None,
        "used": False,
        "contradicts": [],
    }
    return Settled(adjustment, [], [], left, (record,), (f"{said}: the board is left out",), found.board)


def said_of(records: list[dict]) -> tuple[dict, ...]:
    """Records of marks and poses that were found wrong."""
    return tuple(
        {
            "certificate": r["name"],
            "kind": "mark" if r["marks"] else "pose",
            "sigmas": r["sigmas"],
            "off": None,
            "used": False,
            "contradicts": [],
        }
        for r in records
    )
