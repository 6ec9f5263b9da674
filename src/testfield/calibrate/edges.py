"""Every board in every image that shows enough of it: the edges of the graph of images and boards."""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from testfield.calibrate.chirality import from_behind
from testfield.calibrate.rows import rejection
from testfield.camera.plane_image import PlaneImage, fit_plane, rough_lens
from testfield.camera.rough_lens import RoughLens
from testfield.detect.observations import MEASURED, Observations
from testfield.errors import TestfieldError
from testfield.targets.field import Field

LEAST_MARKS = 8
LEAST_TO_FACE = 5
"""Marks that tell on which side of a board the camera is."""
MISREAD = "misread: not where the board's other marks put it"
BACK = "seen from behind: mirrored, or x and y exchanged"
THIN = 0.02
"""Marks whose spread across is less than this part of that along lie on a line."""
ABOVE_NOISE = 10.0
"""Standard deviations of a pixel that marks must spread at least, lest their homography is one of noise."""


@dataclass(frozen=True)
class Edges:
    """E boards in images: `station`, `board`, `weight` (E,), `image` of each board's plane, and which observations,
    `rows`."""

    station: np.ndarray
    board: np.ndarray
    weight: np.ndarray
    image: tuple[PlaneImage, ...]
    rows: tuple[np.ndarray, ...]

    def __len__(self) -> int:
        return len(self.station)

    @property
    def marks(self) -> np.ndarray:
        """(E,) numbers of marks."""
        return np.array([len(rows) for rows in self.rows], int)

    @property
    def homography(self) -> np.ndarray:
        """(E, 3, 3) from the boards' planes to the pixels of a lens without distortion."""
        return np.array([image.homography for image in self.image])

    @property
    def lens(self) -> RoughLens:
        """The lens that all of them share."""
        return self.image[0].lens

    @staticmethod
    def join(parts: list["Edges"]) -> "Edges":
        """All edges in order."""
        if len(parts) == 1:
            return parts[0]
        return Edges(
            np.concatenate([part.station for part in parts]),
            np.concatenate([part.board for part in parts]),
            np.concatenate([part.weight for part in parts]),
            tuple(image for part in parts for image in part.image),
            tuple(rows for part in parts for rows in part.rows),
        )

    def of_rows(self, rows: np.ndarray) -> "Edges":
        """The same where observations are counted as the ones that `rows` are taken from counts them."""
        return replace(self, rows=tuple(rows[own] for own in self.rows))

    def take(self, chosen: np.ndarray) -> "Edges":
        """The edges of a mask."""
        return Edges(
            self.station[chosen],
            self.board[chosen],
            self.weight[chosen],
            tuple(self.image[k] for k in np.flatnonzero(chosen)),
            tuple(self.rows[k] for k in np.flatnonzero(chosen)),
        )


def board_edges(rows: Observations, field: Field, middle_px: np.ndarray) -> tuple[Edges, np.ndarray, list[str]]:
    """The edges, why each observation (n,) is left out ("" where it is not), and notes on these.

    `middle_px` (2,) is the image's middle. A mark is misread that is where neither the plane's image nor its neighbours
    put it (`camera/plane_image.py`). Raises `TestfieldError` where no image shows enough of any board, and where all
    show boards from behind.
    """
    found, why = _seen_boards(rows, field, middle_px, LEAST_MARKS)
    notes = _misread_notes(rows, field, np.flatnonzero(why == MISREAD))
    station, board = (np.array([item[k] for item in found], int) for k in (0, 1))
    behind, said = from_behind(station, board, np.array([item[2].mirrored for item in found], bool), rows, field)
    why[behind], notes = BACK, notes + said
    edges = []
    for s, b, model, here in found:
        spread = _spread_px2(rows.xy_px[here], rows.cov_px2[here])
        if spread and not behind[here].any():
            edges.append((s, b, len(here) * spread, model, here))
    if not edges:
        counted = Counter(rows.status.astype(str)) if len(rows) else Counter({"no blob was measured": 0})
        seen = ", ".join(f"{n} {status}" for status, n in counted.most_common(4))
        raise TestfieldError(
            "; ".join([f"no image shows {LEAST_MARKS} identified marks of a board ({seen})", *notes]),
            "observations.parquet",
            "look at the frames: are the targets sharp, bright and large enough?",
        )
    stations, boards, weight, images, members = zip(*edges, strict=True)
    return Edges(np.array(stations), np.array(boards), np.array(weight), images, members), why, notes


def front_only(observations: Observations, field: Field, middle_px: np.ndarray) -> tuple[Observations, list[str]]:
    """The observations, of which those that show the back of a board are no longer measured, and notes on these. Raises
    as `board_edges` does for boards seen from behind."""
    finite = np.isfinite(observations.xy_px).all(axis=1)
    measured = np.flatnonzero((observations.status == MEASURED) & finite)
    rows = observations.take(measured)
    found, _ = _seen_boards(rows, field, middle_px, LEAST_TO_FACE)
    station, board = (np.array([item[k] for item in found], int) for k in (0, 1))
    behind, notes = from_behind(station, board, np.array([item[2].mirrored for item in found], bool), rows, field)
    status = observations.status.copy()
    status[measured[behind]] = BACK
    return replace(observations, status=status), notes


def left_out(rows: Observations, field: Field, why: np.ndarray) -> list[dict]:
    """Records of the observations that `board_edges` leaves out: `why` (n,)."""
    return [rejection(rows, field, int(k), None, str(why[k])) for k in np.flatnonzero(why != "")]


def _seen_boards(
    rows: Observations, field: Field, middle_px: np.ndarray, least: int
) -> tuple[list[tuple[int, int, PlaneImage, np.ndarray]], np.ndarray]:
    """Station, board, image and good observations of every board with `least` marks in an image; why (n,) others of
    these boards are misread."""
    views = []
    for s in range(len(rows.stations)):
        for b, sheet in enumerate(field.boards):
            here = np.flatnonzero((rows.station == s) & (rows.board == b))
            if len(here) >= least:
                views.append((s, b, here, (sheet.marks.xy_mm[rows.point[here]], rows.xy_px[here])))
    lens = rough_lens([view for *_, view in views], middle_px)
    found, why = [], np.full(len(rows), "", object)
    for s, b, here, view in views:
        model, keep = fit_plane(view, lens)
        why[here[~keep]] = MISREAD
        if model is not None and keep.sum() >= least:
            found.append((s, b, model, here[keep]))
    return found, why


def _misread_notes(rows: Observations, field: Field, bad: np.ndarray) -> list[str]:
    notes = []
    for b in np.unique(rows.board[bad]):
        here = bad[rows.board[bad] == b]
        images = Counter(rows.stations[s] for s in rows.station[here].tolist())
        where = ", ".join(f"'{name}' ({n})" for name, n in images.most_common())
        notes.append(
            f"{len(here)} observation{'s' if len(here) > 1 else ''} of board '{field.boards[b].name}' misread, that is "
            f"not where the board's other marks put {'them' if len(here) > 1 else 'it'}, and left out: image {where}"
        )
    return notes


def _spread_px2(xy_px: np.ndarray, cov_px2: np.ndarray) -> float:
    """Root of the determinant of the pixels' covariance; zero where they lie on a line or within their noise."""
    across, along = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(xy_px.T)), 0))
    noise = float(np.sqrt(np.median(np.trace(cov_px2, axis1=1, axis2=2)) / 2))
    return float(across * along) if across > max(THIN * along, ABOVE_NOISE * noise) else 0.0
