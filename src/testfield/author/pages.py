"""Prints on sheets of paper: one a page, or parts of one that are glued together."""

from dataclasses import dataclass, replace

import numpy as np

from testfield.author.prints import Print
from testfield.errors import TestfieldError
from testfield.targets.field import NominalBoard
from testfield.targets.marks import Marks

PAPERS_MM = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
    "Letter": (215.9, 279.4),
    "Tabloid": (279.4, 431.8),
}
"""ISO 216 and ANSI Y14.1, upright."""
OVERLAP_MM = 10.0
"""Of the strip on which a neighbour is glued, where nobody says otherwise."""
CAPTION_MM = 14.0
"""Of every page's lower margin, for the ruler and what the page is."""
CLEAR_MM = 5.0
"""From a cut to the ground that marks need, where there is room: pages that were glued badly leave strips of bare paper
between them, and what is bright beside a mark draws its centre."""
ROUNDING_MM = 1e-6
"""By so much a print may be larger than its room."""
LEAST_CODES = 3
"""Coded targets on a part that is a board of its own: two on one line would leave its dots to chance."""


@dataclass(frozen=True)
class Page:
    """A sheet of paper of `paper_mm` (2,) with a `print` in its place; `shift_mm` (2,) leads from the print's middle
    to the paper's. `number` of `count`; `glue` tells at which of its left and lower sides a strip of `overlap_mm` is
    left on which the neighbour is glued; `of` is the whole board's name."""

    paper_mm: np.ndarray
    print: Print
    shift_mm: np.ndarray
    number: int = 1
    count: int = 1
    glue: tuple[bool, bool] = (False, False)
    overlap_mm: float = 0.0
    of: str = ""


def paper(name: str) -> np.ndarray:
    """(2,) width and height in mm of a paper, upright. Raises `TestfieldError` for one that is not known."""
    known = {key.lower(): size for key, size in PAPERS_MM.items()}
    if name.lower() not in known:
        raise TestfieldError(f"no paper is called '{name}'", "--paper", f"choose one of {', '.join(PAPERS_MM)}")
    return np.array(known[name.lower()])


def one_page(one: Print, paper_mm: np.ndarray, margin_mm: float) -> Page:
    """A print in the middle of a page, upright or across. Raises `TestfieldError` where it is larger."""
    held_by = upright_or_across(one.size_mm, paper_mm, margin_mm)
    if held_by is not None:
        return Page(held_by, one, np.array([0.0, CAPTION_MM / 2]), of=one.name)
    width, height = one.size_mm
    room = usable(paper_mm, margin_mm)
    raise TestfieldError(
        f"board '{one.name}' is {width:.4g} x {height:.4g} mm, and the page has room for {room[0]:.4g} x {room[1]:.4g}",
        "--paper",
        _advice(one, margin_mm, OVERLAP_MM),
    )


def _advice(one: Print, margin_mm: float, overlap_mm: float) -> str:
    """Which papers hold a print, whole or, where that can be, in parts."""
    tiled_on = None
    for name, size in PAPERS_MM.items() if ring_coded(one) else ():
        for paper_mm in (np.array(size), np.array(size)[::-1]):
            pages = _tiles(one, paper_mm, margin_mm, overlap_mm)
            if isinstance(pages, list) and len(pages) > 1:
                tiled_on = tiled_on or name
    whole = f"take {_fitting(one.size_mm, margin_mm)}"
    return f"{whole}, or --tile it over pages of {tiled_on}" if tiled_on else whole


def ring_coded(one: Print) -> bool:
    """Whether a print is a board of dots and ring codes, whose parts are boards too."""
    return one.board is not None and one.board.pattern is None


def usable(paper_mm: np.ndarray, margin_mm: float) -> np.ndarray:
    """(2,) room for print on a paper between its margins and above its caption."""
    return np.asarray(paper_mm - 2 * margin_mm - [0, CAPTION_MM])


def upright_or_across(size_mm: np.ndarray, paper_mm: np.ndarray, margin_mm: float) -> np.ndarray | None:
    """The paper (2,) as it holds a print of that size, upright if it does; None where it does not."""
    ways = (paper_mm, paper_mm[::-1])
    return next((way for way in ways if np.all(size_mm <= usable(way, margin_mm) + ROUNDING_MM)), None)


def _fitting(size_mm: np.ndarray, margin_mm: float) -> str:
    for name, paper_mm in PAPERS_MM.items():
        if upright_or_across(size_mm, np.array(paper_mm), margin_mm) is not None:
            return name
    return "a plotter's PDF, SVG or DXF with --paper board"


def own_page(one: Print, margin_mm: float) -> Page:
    """A page that is made for its print: for plotters and for those who print on boards."""
    size = one.size_mm + 2 * margin_mm + [0, CAPTION_MM]
    return Page(size, one, np.array([0.0, CAPTION_MM / 2]), of=one.name)


def tiled(one: Print, paper_mm: np.ndarray, margin_mm: float, overlap_mm: float) -> list[Page]:
    """A print over as many pages as it takes, row by row from the top left; each is a board of its own.

    Cuts keep clear of all marks. Raises `TestfieldError` where that cannot be, where a part would have too few coded
    targets to be known, and for boards of squares, tags or circles in a grid, which are known as wholes only.
    """
    if not ring_coded(one):
        kind = one.board.pattern.kind if one.board is not None and one.board.pattern is not None else "card"
        raise TestfieldError(
            f"board '{one.name}' is a {kind}, which is found as a whole and cannot be put together from parts",
            "--tile",
            f"take {_fitting(one.size_mm, margin_mm)}, or a board of ring codes",
        )
    choices = [_tiles(one, size, margin_mm, overlap_mm) for size in (paper_mm, paper_mm[::-1])]
    found = [choice for choice in choices if not isinstance(choice, TestfieldError)]
    if not found:
        error = next(choice for choice in choices if isinstance(choice, TestfieldError))
        raise TestfieldError(error.what, error.where, _advice(one, margin_mm, overlap_mm))
    return min(found, key=len)


def _tiles(one: Print, paper_mm: np.ndarray, margin_mm: float, overlap_mm: float) -> list[Page] | TestfieldError:
    room = usable(paper_mm, margin_mm) - overlap_mm
    try:
        x, y = (_cuts(one, axis, float(room[axis])) for axis in (0, 1))
    except TestfieldError as error:
        return error
    pages: list[Page] = []
    count = (len(x) - 1) * (len(y) - 1)
    for row in range(len(y) - 2, -1, -1):
        for column in range(len(x) - 1):
            low, high = np.array([x[column], y[row]]), np.array([x[column + 1], y[row + 1]])
            part = _part(one, low, high, f"{one.name} {len(pages) + 1}")
            codes = int((part.marks.code > 0).sum())
            if codes < LEAST_CODES:
                return TestfieldError(
                    f"page {len(pages) + 1} of board '{one.name}' would have {codes} coded targets, and it takes "
                    f"{LEAST_CODES} to know a page by them",
                    "--paper",
                    "give the board more coded targets, spread over all of it",
                )
            glue = (column > 0, row > 0)
            # The strip for glue lies beyond the print, on the left and below: the print moves to the right and up.
            shift = np.array([overlap_mm / 2 * glue[0], CAPTION_MM / 2 + overlap_mm / 2 * glue[1]])
            pages.append(Page(paper_mm, part, shift, len(pages) + 1, count, glue, overlap_mm, one.name))
    return pages


def _cuts(one: Print, axis: int, room_mm: float) -> np.ndarray:
    """Where the print is cut across an axis, its ends included: as few parts as fit, about equal, clear of marks."""
    half = float(one.size_mm[axis]) / 2
    low, high = (one.marks.xy_mm[:, axis] + sign * one.reach_mm for sign in (-1, 1))
    for parts in range(int(np.ceil(2 * half / room_mm - 1e-9)), 2 * int(np.ceil(2 * half / room_mm)) + 2):
        cuts = [-half]
        for k in range(1, parts):
            last = cuts[-1] + room_mm
            wanted = min(-half + 2 * half * k / parts, last)
            tried = np.array([min(_kept_off(wanted, a, b), last) for a, b in _lanes(low, high, half) if a < last])
            tried = tried[tried > cuts[-1]]
            if not len(tried):
                break
            cuts.append(float(tried[np.abs(tried - wanted).argmin()]))
        if len(cuts) == parts and half - cuts[-1] <= room_mm + 1e-9:
            return np.array([*cuts, half])
    raise TestfieldError(
        f"no cut {'across' if axis else 'down'} board '{one.name}' passes between its marks within {room_mm:.4g} mm",
        "--paper",
        "take larger paper, or leave lanes between the marks",
    )


def _lanes(low: np.ndarray, high: np.ndarray, half: float) -> list[tuple[float, float]]:
    """The intervals within -half and half that lie between all of those from `low` to `high`."""
    lanes, begin = [], -half
    for k in np.argsort(low):
        if low[k] > begin + 1e-9:
            lanes.append((begin, float(low[k])))
        begin = max(begin, float(high[k]))
    return lanes + [(begin, half)] if begin < half - 1e-9 else lanes


def _kept_off(wanted: float, low: float, high: float) -> float:
    """The place of a lane next to a wanted one, `CLEAR_MM` off its ends or, in a narrow one, in its middle."""
    clear = min(CLEAR_MM, (high - low) / 2)
    return float(np.clip(wanted, low + clear, high - clear))


def _part(one: Print, low: np.ndarray, high: np.ndarray, name: str) -> Print:
    """What lies between two corners, about its own middle."""
    middle = (low + high) / 2
    own = np.all((one.marks.xy_mm > low) & (one.marks.xy_mm < high), axis=1)
    marks = Marks(one.marks.xy_mm[own] - middle, one.marks.diameter_mm[own], one.marks.code[own], one.marks.bits)
    assert one.board is not None
    board = NominalBoard(name, marks, one.board.u_xy_mm, one.board.u_z_mm)
    return replace(one, name=name, size_mm=high - low, marks=marks, board=board)
