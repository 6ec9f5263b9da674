"""Every board in every image that shows enough of it: the edges of the graph of images and boards."""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from testfield.calibrate.rows import rejection
from testfield.camera.plane_image import PlaneImage, RoughLens, fit_plane, rough_lens
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.field import Field

LEAST_MARKS = 8
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

    def take(self, chosen: np.ndarray) -> "Edges":
        """The edges of a mask."""
        return Edges(
            self.station[chosen],
            self.board[chosen],
            self.weight[chosen],
            tuple(self.image[k] for k in np.flatnonzero(chosen)),
            tuple(self.rows[k] for k in np.flatnonzero(chosen)),
        )


def board_edges(rows: Observations, field: Field, middle_px: np.ndarray) -> tuple[Edges, np.ndarray]:
    """The edges, and which observations (n,) are misread; `middle_px` (2,) is the image's middle.

    A mark is misread that is where neither the plane's image nor its neighbours put it (`camera/plane_image.py`).
    Raises `TestfieldError` where no image shows enough of any board.
    """
    views = []
    for s in range(len(rows.stations)):
        for b, sheet in enumerate(field.boards):
            here = np.flatnonzero((rows.station == s) & (rows.board == b))
            if len(here) >= LEAST_MARKS:
                views.append((s, b, here, (sheet.marks.xy_mm[rows.point[here]], rows.xy_px[here])))
    lens = rough_lens([view for *_, view in views], middle_px)
    found: list[tuple] = []
    gross = np.zeros(len(rows), bool)
    for s, b, here, view in views:
        model, keep = fit_plane(view, lens)
        gross[here[~keep]] = True
        spread = _spread_px2(view[1][keep], rows.cov_px2[here[keep]]) if keep.sum() >= LEAST_MARKS else 0.0
        if model is not None and spread:
            found.append((s, b, keep.sum() * spread, model, here[keep]))
    if not found:
        why = Counter(rows.status.astype(str)) if len(rows) else Counter({"no blob was measured": 0})
        seen = ", ".join(f"{n} {status}" for status, n in why.most_common(4))
        misread = f", {int(gross.sum())} of them not where the others of their board are" if gross.any() else ""
        raise TestfieldError(
            f"no image shows {LEAST_MARKS} identified marks of a board ({seen}{misread})",
            "observations.parquet",
            "look at the frames: are the targets sharp, bright and large enough?",
        )
    station, board, weight, images, members = zip(*found, strict=True)
    return Edges(np.array(station), np.array(board), np.array(weight), images, members), gross


def misread(rows: Observations, field: Field, gross: np.ndarray) -> tuple[list[dict], list[str]]:
    """Records of the observations of an index that `board_edges` calls misread, and a note on each board's."""
    records = [rejection(rows, field, int(k), None, "misread: not where the board's other marks put it") for k in gross]
    notes = []
    for b in np.unique(rows.board[gross]):
        here = gross[rows.board[gross] == b]
        images = Counter(rows.stations[s] for s in rows.station[here].tolist())
        where = ", ".join(f"'{name}' ({n})" for name, n in images.most_common())
        notes.append(
            f"{len(here)} observation{'s' if len(here) > 1 else ''} of board '{field.boards[b].name}' misread, that is "
            f"not where the board's other marks put {'them' if len(here) > 1 else 'it'}, and left out: image {where}"
        )
    return records, notes


def _spread_px2(xy_px: np.ndarray, cov_px2: np.ndarray) -> float:
    """Root of the determinant of the pixels' covariance; zero where they lie on a line or within their noise."""
    across, along = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(xy_px.T)), 0))
    noise = float(np.sqrt(np.median(np.trace(cov_px2, axis1=1, axis2=2)) / 2))
    return float(across * along) if across > max(THIN * along, ABOVE_NOISE * noise) else 0.0
