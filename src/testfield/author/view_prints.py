"""What is printed on a world's panels, from the same shapes that are printed on paper, for the 3-D page to draw."""

from dataclasses import dataclass

import numpy as np

from testfield.author.drawn_page import boxes
from testfield.author.prints import Print, print_of
from testfield.scene.world import World
from testfield.targets.field import TIME
from testfield.targets.marks import Marks


@dataclass(frozen=True)
class PanelPrints:
    """Shapes in the ink of their `..._panel`, in mm about its middle, x right, y up.

    `dots` (d, 3) x, y and radius; `sectors` (s, 6) x, y, inner and outer radius, first and last angle in radians;
    `boxes` (b, 4) left, bottom, right, top. Each has its panel's number, (d,), (s,), (b,).
    """

    dots: np.ndarray
    dots_panel: np.ndarray
    sectors: np.ndarray
    sectors_panel: np.ndarray
    boxes: np.ndarray
    boxes_panel: np.ndarray


def panel_prints(world: World) -> PanelPrints:
    """All prints of a world."""
    parts = []
    for panel, marks in _by_panel(world):
        loose = world.marks.board[marks] < 0
        parts += [(panel, print_of(world.field.boards[b], world.field)) for b in set(world.marks.board[marks[~loose]])]
        if loose.any():
            parts.append((panel, _cards(world, marks[loose])))
    dots, sectors, cells = [], [], []
    for panel, one in parts:
        dots += [(panel, *row) for row in np.column_stack([one.marks.xy_mm, one.marks.diameter_mm / 2]).tolist()]
        sectors += [(panel, *s.xy_mm, s.inner_mm, s.outer_mm, s.first_rad, s.last_rad) for s in one.sectors]
        if one.cells is not None:
            cells += [(panel, *box) for box in boxes(one.cells.x_mm, one.cells.y_mm, one.cells.black)]
    d, s, b = (np.array(rows, float).reshape(-1, width) for rows, width in ((dots, 4), (sectors, 7), (cells, 5)))
    return PanelPrints(d[:, 1:], d[:, 0].astype(int), s[:, 1:], s[:, 0].astype(int), b[:, 1:], b[:, 0].astype(int))


def _by_panel(world: World) -> list[tuple[int, np.ndarray]]:
    """Panels that carry marks, and the numbers of these."""
    order = np.argsort(world.marks.panel, kind="stable")
    panels, first = np.unique(world.marks.panel[order], return_index=True)
    return list(zip(panels.tolist(), np.split(order, first[1:]), strict=True))


def _cards(world: World, here: np.ndarray) -> Print:
    """What is printed on a card or a sticker: its targets where they are, with the codes that they have at any time."""
    own = world.marks
    marks = Marks(own.xy_mm[here], own.diameter_mm[here], own.code[here] % TIME, world.field.bits)
    return Print("", np.zeros(2), True, marks, radii=own.radii, codes=world.field.codes)
