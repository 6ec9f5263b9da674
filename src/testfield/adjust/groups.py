"""What does not change from one linearisation to the next: observations in groups that share the unknowns they depend
on, and by point."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from testfield.adjust.chunks import Chunk, chunks_of
from testfield.adjust.network import Layout, Network


@dataclass(frozen=True)
class Group:
    """k observations in one image on one board or none: `here`, their places in the structure's order, that of their
    `points` (k,), each of which occurs once; `columns` (p,) of the reduced unknowns that all of them depend on; `kept`
    whether their points are among the reduced unknowns too."""

    camera: int
    image: int
    board: int
    here: slice
    points: np.ndarray
    columns: np.ndarray
    kept: bool


@dataclass(frozen=True)
class Structure:
    """The layout; the groups; `order` (m,) of the observations, group by group, with their `image` (m,), `point` (m,)
    and `group` (m,); `columns` (g, w) and `count` (g,) of all groups together; `kept_at` (n,) where the unknowns of
    kept points begin, -1 for all others; `first` (n + 1,) and `ray`: point p has the observations
    `ray[first[p]]` to `ray[first[p + 1] - 1]`, in the structure's order; none where it is kept."""

    layout: Layout
    groups: tuple[Group, ...]
    order: np.ndarray
    image: np.ndarray
    point: np.ndarray
    group: np.ndarray
    columns: np.ndarray
    count: np.ndarray
    kept_at: np.ndarray
    first: np.ndarray
    ray: np.ndarray

    @staticmethod
    def of(network: Network) -> "Structure":
        """The structure of a network."""
        layout = Layout.of(network)
        n, m = len(network.point_mm), len(network.point)
        kept_at = np.full(n, -1)
        kept_at[network.kept_points] = layout.kept + 3 * np.arange(len(network.kept_points))
        image, point = np.asarray(network.image, np.int64), np.asarray(network.point, np.int64)
        kept = kept_at[point] >= 0
        board = np.asarray(network.point_board, np.int64)[point]
        key = np.zeros(m, np.int64)
        keys = (network.images.camera[image], image, board, kept.astype(np.int64), _repeat(image, point))
        for part in keys:
            low = int(part.min(initial=0))
            key = key * (int(part.max(initial=0)) - low + 1) + (part - low)
        order = np.lexsort((point, key))
        edges = np.flatnonzero(np.diff(key[order])) + 1
        bounds = np.concatenate([[0], edges, [m]]) if m else np.zeros(1, int)
        groups = []
        for start, stop in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
            here, row = slice(start, stop), order[start]
            i, b = int(image[row]), int(board[row])
            columns = _columns(network, layout, i, b)
            camera = int(network.images.camera[i])
            groups.append(Group(camera, i, b, here, point[order[here]], columns, bool(kept[row])))
        count = np.array([len(g.columns) for g in groups], np.int64)
        together = np.zeros((len(groups), int(count.max(initial=0))), np.int64)
        for k, g in enumerate(groups):
            together[k, : count[k]] = g.columns
        apart = np.flatnonzero(~kept[order])
        by_point = point[order][apart]
        return Structure(
            layout=layout,
            groups=tuple(groups),
            order=order,
            image=image[order],
            point=point[order],
            group=np.repeat(np.arange(len(groups)), np.diff(bounds)),
            columns=together,
            count=count,
            kept_at=kept_at,
            first=np.concatenate([[0], np.cumsum(np.bincount(by_point, minlength=n))]),
            ray=apart[np.argsort(by_point, kind="stable")],
        )

    @property
    def width(self) -> int:
        """The most reduced unknowns on which an observation depends, its own point apart."""
        return self.columns.shape[1]

    @cached_property
    def chunks(self) -> tuple[Chunk, ...]:
        """Points that are eliminated together."""
        return chunks_of(self.first, self.ray, self.group, self.columns, self.count, self.layout.size)

    def alone(self, point: int) -> Chunk:
        """One point as a chunk."""
        groups = np.unique(self.group[self.ray[self.first[point] : self.first[point + 1]]])
        columns = np.unique(np.concatenate([self.groups[g].columns for g in groups]))
        return Chunk(np.array([point]), columns, True)

    def observations(self, points: np.ndarray) -> np.ndarray:
        """(k,) those of points that are not kept, in the structure's order, point by point."""
        return np.concatenate([np.zeros(0, np.int64), *(self.ray[self.first[p] : self.first[p + 1]] for p in points)])


def _repeat(image: np.ndarray, point: np.ndarray) -> np.ndarray:
    """(m,) how often each observation's point occurs before it in its image."""
    key = image * (int(point.max(initial=0)) + 1) + point
    order = np.argsort(key, kind="stable")
    same = np.zeros(len(order), bool)
    same[1:] = np.diff(key[order]) == 0
    if not same.any():
        return np.zeros(len(order), np.int64)
    first = np.maximum.accumulate(np.where(same, 0, np.arange(len(order))))
    count = np.empty(len(order), np.int64)
    count[order] = np.arange(len(order)) - first
    return count


def _columns(network: Network, layout: Layout, image: int, board: int) -> np.ndarray:
    """The reduced unknowns that all observations of one image on one board share, in the order of `chain`."""
    images, k = network.images, int(network.images.camera[image])
    parts = [
        np.arange(layout.camera[k], layout.camera[k + 1]),
        layout.station + 6 * images.station[image] + np.arange(6),
    ]
    if images.member[image]:
        parts.append(layout.member + 6 * (images.member[image] - 1) + np.arange(6))
    if board >= 0:
        parts.append(np.arange(layout.board[board], layout.board[board + 1]))
        parts += [np.array([layout.scale])] if network.scale_free else []
    return np.concatenate(parts)
