"""Random numbers of observed marks: each its own, by station, board and mark, whatever else is seen."""

import numpy as np

from testfield.seeds import normals


def normals_of_marks(
    seed: int,
    stations: tuple[str, ...],
    boards: tuple[str, ...],
    station: np.ndarray,
    board: np.ndarray,
    point: np.ndarray,
    code: np.ndarray,
) -> np.ndarray:
    """(n, 2) standard normal deviates of n observations.

    `station`, `board` (n,) index the names, -1 for no board; `point` (n,) is a board's mark. Marks of no board go by
    their `code` (n,); plain dots of no board have no name but their order in the image.
    """
    drawn = np.empty((len(station), 2))
    plain = (board < 0) & (code == 0)
    for s in np.unique(station):
        here = station == s
        for b in np.unique(board[here]):
            named = np.flatnonzero(here & (board == b) & ~plain)
            if len(named):
                number = (point if b >= 0 else code)[named]
                group = f"board/{boards[b]}" if b >= 0 else "loose"
                drawn[named] = normals(seed, f"pixels/{stations[s]}/{group}", int(number.max()) + 1, 2)[number]
        unnamed = np.flatnonzero(here & plain)
        drawn[unnamed] = normals(seed, f"pixels/{stations[s]}/plain", len(unnamed), 2)
    return drawn
