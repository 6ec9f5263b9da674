"""What a field file certifies, and certified distances as they were measured."""

from dataclasses import dataclass

import numpy as np

from testfield.calibrate.certified import Certified
from testfield.reconstruct.points import Points
from testfield.targets.field import ScaleBar
from testfield.targets.field_file import FieldFile


@dataclass(frozen=True)
class Length:
    """A certified distance as measured, with standard uncertainties; `en` of a check distance and of one that was found
    wrong, None of one that made the scale."""

    name: str
    role: str
    codes: tuple[int, int]
    certified_mm: float
    u_certified_mm: float
    measured_mm: float
    u_measured_mm: float
    en: float | None


def certified_of(field: FieldFile) -> Certified:
    """What a field file certifies."""
    bars = tuple(ScaleBar(d.name, d.role, d.codes, d.length_mm, d.u_mm) for d in field.distances)
    known = {}
    for board in field.boards:
        for place in board.points:
            u = board.u_mm if place.u_mm is None else place.u_mm
            known[place.code] = (np.array(place.xyz_mm), np.broadcast_to(np.asarray(u, float), 3).copy())
    diameter = dict(field.target.diameters_mm)
    if field.target.diameter_mm is not None:
        diameter[0] = field.target.diameter_mm
    return Certified(bars, known, diameter)


def lengths_of(
    certified: Certified, points: Points, unused: set[str], scale_from: str
) -> tuple[tuple[Length, ...], list[str]]:
    """Certified distances as measured, and a sentence for each check distance that cannot be compared."""
    have, answer, said = {int(c) for c in points.code}, [], []
    for bar in certified.bars:
        if not set(bar.codes) <= have:
            if bar.role == "check":
                said.append(f"the check distance '{bar.name}' cannot be compared: an end of it was not measured")
            continue
        a, b = points.rows(list(bar.codes))
        length, u = points.distance(int(a), int(b))
        if bar.role == "check" and scale_from == "nothing":
            said.append(f"the check distance '{bar.name}' cannot be compared: the scale is arbitrary")
        apart = (bar.role == "check" or bar.name in unused) and scale_from != "nothing"
        en = (length - bar.length_mm) / (2 * np.hypot(u, max(bar.u_length_mm, 1e-9))) if apart else None
        answer.append(
            Length(
                bar.name,
                bar.role,
                bar.codes,
                bar.length_mm,
                bar.u_length_mm,
                length,
                u,
                None if en is None else float(en),
            )
        )
    return tuple(answer), said
