"""The points of a starting network: marks of boards, and ends of control bars."""

from dataclasses import dataclass

import numpy as np

from testfield.adjust.network import (
    Distances,
)
from testfield.detect.observations import Observations
from testfield.targets.field import Field


@dataclass(frozen=True)
class _BoardPoints:
    """All marks of some boards: where each board's begin, local coordinates, uncertainties, owners, radii."""

    first: np.ndarray
    local: np.ndarray
    u: np.ndarray
    owner: np.ndarray
    radius: np.ndarray


def board_points(field: Field, boards: np.ndarray, larger: dict[int, float]) -> _BoardPoints:
    """The marks of boards, by their numbers; radii of boards that show larger dots than their sheets say are theirs."""
    sheets = [field.boards[b] for b in boards]
    sizes = [len(sheet.marks) for sheet in sheets]
    radius = [
        np.zeros(len(s.marks)) if s.has_corners else s.marks.diameter_mm / 2 * larger.get(int(b), 1.0)
        for b, s in zip(boards, sheets, strict=True)
    ]
    return _BoardPoints(
        np.concatenate([[0], np.cumsum(sizes)]),
        np.vstack([np.column_stack([s.marks.xy_mm, np.zeros(len(s.marks))]) for s in sheets]),
        np.vstack([np.tile([s.u_xy_mm, s.u_xy_mm, s.u_z_mm], (len(s.marks), 1)) for s in sheets]),
        np.repeat(np.arange(len(sheets)), sizes),
        np.concatenate(radius),
    )


@dataclass(frozen=True)
class _Bars:
    """Control bars: observations of each end by its point number, names, the distances, radii of the ends."""

    seen: dict[int, np.ndarray]
    names: tuple[str, ...]
    distances: Distances
    radius: np.ndarray


def control_bars(rows: Observations, field: Field, usable: np.ndarray, first: int, notes: list[str]) -> _Bars:
    """The control bars whose ends are seen twice; notes on the others are added."""
    seen: dict[int, np.ndarray] = {}
    ends, names, lengths, u_lengths, radius = [], [], [], [], []
    for bar in field.scale_bars:
        if bar.role != "control":
            continue
        here = [np.flatnonzero(usable & (rows.code == code) & (rows.board < 0)) for code in bar.codes]
        if min(len(v) for v in here) < 2:
            said = " and ".join(
                f"code {code} in {len(v)} image{'' if len(v) == 1 else 's'}"
                for code, v in zip(bar.codes, here, strict=True)
            )
            notes.append(f"control bar '{bar.name}' is not seen twice at both ends ({said}) and is left out")
            continue
        numbers = [first + len(seen), first + len(seen) + 1]
        seen |= dict(zip(numbers, here, strict=True))
        ends.append(numbers)
        names.append(bar.name)
        lengths.append(bar.length_mm)
        u_lengths.append(bar.u_length_mm)
        radius += [field.loose[code] / 2 for code in bar.codes]
    if not ends:
        notes.append("no control bar: the scale is that of the boards' sheets")
    distances = Distances(np.array(ends, int).reshape(-1, 2), np.array(lengths, float), np.array(u_lengths, float))
    return _Bars(seen, tuple(names), distances, np.array(radius, float))
