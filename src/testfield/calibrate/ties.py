"""What ties images together where there are no boards: points that are known by their numbers in every image."""

from collections import Counter
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.sparse.csgraph import connected_components

from testfield.detect.observations import Observations

LEAST_COMMON = 6
"""Numbers that two images must have in common to be oriented to each other, and an image to be joined to points."""
LEAST_RAYS = 2


@dataclass(frozen=True)
class Ties:
    """m sights of n points in I images.

    `stations` (I) names of the images; `code` (n,) the points' numbers, negative ones of dots without a code; `image`
    and `point` (m,); `xy_px` (m, 2) with `cov_px2` (m, 2, 2); `moments_px2` (m, 2, 2) of the discs' images, NaN where
    the pixels are projections of the centres themselves; `row` (m,) which observation each sight is.
    """

    stations: tuple[str, ...]
    code: np.ndarray
    image: np.ndarray
    point: np.ndarray
    xy_px: np.ndarray
    cov_px2: np.ndarray
    moments_px2: np.ndarray
    row: np.ndarray

    def __len__(self) -> int:
        return len(self.image)

    def take(self, sights: np.ndarray) -> "Ties":
        """Only some sights (an index or a mask), of the same images and points."""
        return replace(self, **{f.name: getattr(self, f.name)[sights] for f in fields(self)[2:]})

    def names(self, points: np.ndarray) -> str:
        """Points as a person calls them."""
        return ", ".join(point_name(int(code)) for code in self.code[points])

    def seen(self) -> np.ndarray:
        """(I, n) which image sees which point."""
        table = np.zeros((len(self.stations), len(self.code)), bool)
        table[self.image, self.point] = True
        return table


def point_name(code: int) -> str:
    """`code 17` or, of a dot without one, `dot 3`."""
    return f"code {code}" if code > 0 else f"dot {-code}"


def coded_ties(observations: Observations, codes: np.ndarray | None = None) -> tuple[Ties, list[str]]:
    """The sights of all coded targets (or only of those with numbers in `codes`), and notes on what was left out: rows
    that are not finite, and numbers that an image shows twice, of which neither can be told to be the right one."""
    rows = observations.measured
    number = np.flatnonzero(observations.status == "measured")
    finite = np.isfinite(rows.xy_px).all(axis=1) & np.isfinite(rows.cov_px2).all(axis=(1, 2))
    chosen = (rows.code > 0) & (True if codes is None else np.isin(rows.code, codes))
    notes = []
    for k in np.flatnonzero(chosen & ~finite):
        notes.append(
            f"observation {number[k]} (station '{rows.stations[rows.station[k]]}', code {rows.code[k]}) is not finite "
            "and is left out"
        )
    chosen &= finite
    count = Counter(zip(rows.station[chosen].tolist(), rows.code[chosen].tolist(), strict=True))
    for (station, code), times in count.items():
        if times > 1:
            notes.append(
                f"code {code} is there {times} times in image '{rows.stations[station]}': none of them is used"
            )
    once = [count[int(s), int(c)] == 1 for s, c in zip(rows.station, rows.code, strict=True)]
    here = np.flatnonzero(chosen & np.array(once, bool))
    code, point = np.unique(rows.code[here], return_inverse=True)
    moments = rows.moments_px2[here] if rows.centre_of_disc else np.full((len(here), 2, 2), np.nan)
    return (
        Ties(
            stations=rows.stations,
            code=code,
            image=rows.station[here],
            point=point,
            xy_px=rows.xy_px[here],
            cov_px2=rows.cov_px2[here],
            moments_px2=moments,
            row=number[here],
        ),
        notes,
    )


def largest_group(ties: Ties) -> tuple[np.ndarray, list[str]]:
    """(I,) images that are joined to each other through common numbers, the largest such group; the others named."""
    table = ties.seen().astype(int)
    common = table @ table.T
    _, group = connected_components(common >= LEAST_COMMON, directed=False)
    sights = np.bincount(group, weights=table.sum(axis=1))
    images = np.bincount(group)
    best = max(range(len(images)), key=lambda g: (images[g], sights[g]))
    notes = []
    for g in np.flatnonzero(np.arange(len(images)) != best):
        names = ", ".join(f"'{ties.stations[i]}'" for i in np.flatnonzero(group == g))
        shared = int(common[np.ix_(group == g, group == best)].max(initial=0))
        verb = "are" if images[g] > 1 else "is"
        notes.append(
            f"image {names} shares at most {shared} coded targets with an image of the others "
            f"({LEAST_COMMON} are needed) and {verb} left out"
            if images[g] == 1
            else f"the group of images {names} shares at most {shared} coded targets with an image of the others "
            f"({LEAST_COMMON} are needed) and is left out"
        )
    return group == best, notes
