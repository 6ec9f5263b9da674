"""A board that was printed over several pages and glued together by hand: where its pages really came to lie."""

from dataclasses import replace

import numpy as np

from testfield.author.pages import Page, paper, tiled
from testfield.author.prints import print_of
from testfield.camera.pose import Poses
from testfield.scene.world import BOARD, MATT, World
from testfield.targets.field import NominalBoard

PAPER_MM = 0.1
"""Thickness of office paper: where two pages meet, one lies on the other's strip for glue."""
BARE_PAPER = 0.8
"""Reflectance of what shows between two pages."""


def pages_of_board(world: World, board: int, name: str = "A4") -> list[Page]:
    """The pages of a world's board, as `testfield print --tile` makes them."""
    sheet = world.field.boards[board]
    width, height = world.panels.size_mm[world.panels.name.index(sheet.name)]
    return tiled(print_of(sheet, world.field, (width, height)), paper(name), 5.0, 10.0)


def glued(
    world: World, board: int, pages: list[Page], shift_mm: np.ndarray, turn_deg: np.ndarray
) -> tuple[World, World]:
    """The world with a flat board made of pages, each glued `shift_mm` (pages, 2) and turned `turn_deg` (pages,) from
    where it belongs. Twice: as the tiled print's sheet knows it, every page a board, and as one rigid board."""
    whole, panels, marks = world.field.boards[board], world.panels, world.marks
    front = panels.name.index(whole.name)
    R, t = panels.world_from_panel.R[front], panels.world_from_panel.t_mm[front]
    own = np.flatnonzero((marks.role == BOARD) & (marks.board == board))
    panel, xy, index, point = (values.copy() for values in (marks.panel, marks.xy_mm, marks.board, marks.point))
    index[marks.board > board] += len(pages) - 1
    boards: list[NominalBoard] = []
    page_R, page_t = [], []
    middles = np.array([_middle(page, whole) for page in pages])
    # Neighbours lie at different heights.
    columns, rows = (np.unique(np.round(middles[:, axis], 3), return_inverse=True)[1] for axis in (0, 1))
    for k, page in enumerate(pages):
        sheet = page.print.board
        assert sheet is not None
        boards.append(sheet)
        away = np.linalg.norm(whole.marks.xy_mm[marks.point[own], None] - middles[k] - sheet.marks.xy_mm, axis=2)
        on = own[away.min(axis=1) < 1e-6]
        assert len(on) == len(sheet.marks)
        panel[on], xy[on] = len(panels) + k, marks.xy_mm[on] - middles[k]
        index[on], point[on] = board + k, away.argmin(axis=1)[away.min(axis=1) < 1e-6]
        a = np.radians(turn_deg[k])
        page_R.append(R @ np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]]))
        height_mm = PAPER_MM * (1 + (columns[k] + rows[k]) % 2)
        page_t.append(t + R @ [*(middles[k] + shift_mm[k]), height_mm])
    added = Poses(np.array(page_R), np.array(page_t))
    assert np.all(panels.curvature_per_mm == 0)
    n = len(pages)
    ground = np.concatenate([panels.ground_albedo, np.repeat(panels.ground_albedo[front], n)])
    ground[front] = BARE_PAPER
    ink = None if panels.ink is None else np.concatenate([panels.ink, np.full(n, MATT)])
    there = replace(
        panels,
        name=(*panels.name, *(page.print.name for page in pages)),
        world_from_panel=_joined(panels.world_from_panel, added),
        size_mm=np.concatenate([panels.size_mm, [page.print.size_mm for page in pages]]),
        ground_albedo=ground,
        ink_albedo=np.concatenate([panels.ink_albedo, np.repeat(panels.ink_albedo[front], n)]),
        curvature_per_mm=np.zeros(len(panels) + n),
        bend_axis_rad=np.zeros(len(panels) + n),
        of_room=np.concatenate([panels.of_room, np.zeros(n, bool)]),
        ink=ink,
    )
    as_one = replace(world, panels=there, marks=replace(marks, panel=panel, xy_mm=xy))
    before, after = (world.world_from_board[part] for part in (slice(0, board), slice(board + 1, None)))
    sheets = world.field.boards
    by_page = replace(
        as_one,
        marks=replace(as_one.marks, board=index, point=point),
        world_from_board=_joined(before, added, after),
        field=replace(world.field, boards=(*sheets[:board], *boards, *sheets[board + 1 :])),
    )
    return by_page, as_one


def _middle(page: Page, whole: NominalBoard) -> np.ndarray:
    """(2,) where a page's middle belongs on the whole board."""
    marks = page.print.marks
    k = int(np.flatnonzero(marks.code > 0)[0])
    return np.asarray(whole.marks.xy_mm[whole.marks.code == marks.code[k]][0] - marks.xy_mm[k])


def _joined(*parts: Poses) -> Poses:
    return Poses(np.concatenate([p.R for p in parts]), np.concatenate([p.t_mm for p in parts]))
