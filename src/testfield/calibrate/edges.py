"""Every board in every image that shows enough of it: the edges of the graph of images and boards."""

from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np

from testfield.calibrate.homography import plane_homography
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.targets.field import Field

LEAST_MARKS = 8
LEAST_SPREAD_PX2 = 25.0
"""Marks of less spread in an image lie on a line."""
GROSS_PX = 25.0
"""A mark farther than this from its board's homography is misread: no lens bends one board so much."""


@dataclass(frozen=True)
class Edges:
    """E boards in images: `station`, `board`, `weight` (E,), `homography` (E, 3, 3), and which observations, `rows`."""

    station: np.ndarray
    board: np.ndarray
    weight: np.ndarray
    homography: np.ndarray
    rows: tuple[np.ndarray, ...]

    def __len__(self) -> int:
        return len(self.station)

    @property
    def marks(self) -> np.ndarray:
        """(E,) numbers of marks."""
        return np.array([len(rows) for rows in self.rows], int)

    def take(self, chosen: np.ndarray) -> "Edges":
        """The edges of a mask."""
        return Edges(
            self.station[chosen], self.board[chosen], self.weight[chosen], self.homography[chosen],
            tuple(self.rows[k] for k in np.flatnonzero(chosen)),
        )  # fmt: skip


def board_edges(rows: Observations, field: Field) -> tuple[Edges, np.ndarray]:
    """The edges, and which observations (n,) are misread.

    Raises `TestfieldError` where no image shows enough of any board.
    """
    found: list[tuple] = []
    gross = np.zeros(len(rows), bool)
    for s in range(len(rows.stations)):
        for b, sheet in enumerate(field.boards):
            here = np.flatnonzero((rows.station == s) & (rows.board == b))
            if len(here) < LEAST_MARKS:
                continue
            plane, image = sheet.marks.xy_mm[rows.point[here]], rows.xy_px[here]
            _, inside = cv2.findHomography(plane, image, cv2.RANSAC, GROSS_PX)
            keep = np.zeros(len(here), bool) if inside is None else inside.ravel().astype(bool)
            gross[here[~keep]] = True
            spread = np.sqrt(max(np.linalg.det(np.cov(image[keep].T)), 0)) if keep.sum() >= LEAST_MARKS else 0.0
            if spread < LEAST_SPREAD_PX2:
                continue
            found.append((s, b, keep.sum() * spread, plane_homography(plane[keep], image[keep]), here[keep]))
    if not found:
        why = Counter(rows.status.astype(str)) if len(rows) else Counter({"no blob was measured": 0})
        seen = ", ".join(f"{n} {status}" for status, n in why.most_common(4))
        raise TestfieldError(
            f"no image shows {LEAST_MARKS} identified marks of a board ({seen})", "observations.parquet",
            "look at the frames: are the targets sharp, bright and large enough?",
        )  # fmt: skip
    station, board, weight, homography, members = zip(*found, strict=True)
    return Edges(np.array(station), np.array(board), np.array(weight), np.array(homography), tuple(members)), gross
