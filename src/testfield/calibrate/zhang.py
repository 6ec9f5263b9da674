"""One planar board alone (Zhang 2000)."""

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.finish import calibrated
from testfield.calibrate.rows import best_board, on_one_board, usable_rows
from testfield.calibrate.start import Start, starting_network
from testfield.detect.observations import Observations
from testfield.registry import register
from testfield.targets.field import Field


@register("calibrators", "zhang")
def zhang(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
    board: str | None = None,
) -> Calibration:
    """One planar board: the one called `board`, or that of which most marks were observed.

    Its homographies give the start and a bundle of that board the estimate; all other boards and bars are ignored. The
    frame is that of the board. Raises as `stitched`.
    """
    rows, turned_down, notes = usable_rows(observations, field)
    alone, sheet = on_one_board(rows, field, best_board(rows, field, board))
    notes.append(f"only board '{sheet.boards[0].name}' is used")

    def begin(rows: Observations, left_out: frozenset[int]) -> Start:
        return starting_network(rows, sheet, width_px, height_px, lens, hold, left_out=left_out)

    return calibrated("zhang", begin, alone, sheet, turned_down, notes)
