"""No camera sees the back of a board: what appears so is mirrored, or has x and y exchanged.

This is the one place where that is asked: of boards by the sense in which their images run, of certified points in
space by whether a reflection lays the measured ones upon them where no motion does.
"""

import numpy as np

from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.field import Field

BETTER = 0.2
"""A reflection fits if it leaves less than this part of what the best motion leaves."""
FLAT = 0.02
"""Points thinner than this part of their extent look the same in a mirror and from the other side."""
ADVICE = "exchange x and y (row and column), undo the mirroring of the image, or of the sheet's y axis (up is positive)"


def tells_its_side(field: Field, board: int) -> bool:
    """Whether a board looks another way in a mirror: a symmetric grid of circles or of plain dots does not."""
    pattern, marks = field.boards[board].pattern, field.boards[board].marks
    return bool((marks.code > 0).any()) if pattern is None else pattern.of_kind.shows_front


def from_behind(
    station: np.ndarray, board: np.ndarray, mirrored: np.ndarray, rows: Observations, field: Field
) -> tuple[np.ndarray, list[str]]:
    """(n,) which observations show the back of a board, and a note on each image or board of them.

    `station`, `board`, `mirrored` (E,) are boards in images. Raises `TestfieldError` where all of them are mirrored.
    """
    told = np.array([tells_its_side(field, int(b)) for b in board], bool)
    station, board, mirrored = station[told], board[told], mirrored[told]
    wrong = np.zeros(len(rows), bool)
    notes: list[str] = []
    if not mirrored.any():
        return wrong, notes
    if mirrored.all():
        names = ", ".join(f"'{field.boards[b].name}'" for b in np.unique(board))
        raise TestfieldError(
            f"every image shows the boards ({names}) from their back, as in a mirror", "observations", ADVICE
        )
    boards = [b for b in np.unique(board) if mirrored[board == b].all() and (board == b).sum() > 1]
    for b in boards:
        wrong |= rows.board == b
        notes.append(f"board '{field.boards[b].name}' is seen from its back in every image and is left out: {ADVICE}")
    others = ~np.isin(board, boards)
    for s in np.unique(station[others & mirrored]):
        here = others & (station == s)
        name = rows.stations[s]
        if mirrored[here].all():
            wrong |= rows.station == s
            notes.append(f"image '{name}' shows the boards from their back and is left out: {ADVICE}")
            continue
        for b in board[here & mirrored]:
            wrong |= (rows.station == s) & (rows.board == b)
            notes.append(f"board '{field.boards[b].name}' in image '{name}' is seen from its back and is left out")
    return wrong, notes


def refuse_mirrored_points(here_mm: np.ndarray, certified_mm: np.ndarray) -> None:
    """Raise `TestfieldError` where points (k, 3) are certified (k, 3) as their mirror image; flat ones never are."""
    a, b = here_mm - here_mm.mean(axis=0), certified_mm - certified_mm.mean(axis=0)
    size = np.linalg.svd(b, compute_uv=False)
    if len(a) < 4 or size[2] < FLAT * size[0]:
        return
    u, s, vt = np.linalg.svd(b.T @ a)
    sign = float(np.sign(np.linalg.det(u @ vt)))
    # What is left of b after the best scaled motion, or reflection, of a: sums of squares (Umeyama 1991).
    total, spread = (b**2).sum(), (a**2).sum()
    motion, reflection = (total - (s[0] + s[1] + way * s[2]) ** 2 / spread for way in (sign, -sign))
    if max(reflection, 0.0) < BETTER**2 * motion:
        raise TestfieldError(
            "the certified places are the mirror image of what the images show",
            "the certified points",
            "exchange two of their axes, or x and y of the observations: a right-handed frame is needed",
        )
