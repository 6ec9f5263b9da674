"""Boards that were moved between photographs: their codes are points of their own in every arrangement of them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from testfield.calibrate.similarity import robust_similarity
from testfield.calibrate.ties import coded_ties
from testfield.detect.observations import MEASURED, Observations
from testfield.detect.photograph import Found
from testfield.measure.settings import Arranged, arranged
from testfield.reconstruct.points import Points
from testfield.targets.field import TIME, code_at
from testfield.targets.field_file import DistancePart, FieldFile

MOVED = "on a board that was moved"
"""Status of a dot without a code in another arrangement than the first: no ray can name it."""
LEAST_FIT = 4
FAR = 3.0
"""Distance from where a sheet says, in its stated uncertainty, that is worth a word."""


def in_settings(
    names: tuple[str, ...],
    found: list[Found],
    size_px: tuple[int, int],
    field: FieldFile,
    lens: str,
    hold: tuple[str, ...],
    focal_px: float | None,
) -> tuple[list[Found], FieldFile, tuple[str, ...]]:
    """What was found, codes of moved boards under numbers of their own in each arrangement; the field, with certified
    distances on such boards once for each; and notes. All as it was where nothing was moved."""
    observations = Observations.join([one.observations for one in found], names)
    ties, _ = coded_ties(observations)
    seen = arranged(ties, size_px, lens, hold, focal_px) if len(ties) else None
    if seen is None or not seen.moved:
        return found, field, ()
    notes = [f"boards were moved between the photographs: {said_settings(names, seen)}"]
    moving = set(seen.moving)
    for group in field.groups:
        here = moving & {point.code for point in group.points}
        # A board is rigid: it moved as a whole, or not at all.
        moving = moving | {p.code for p in group.points} if 2 * len(here) > len(group.points) else moving - here
        if here and 2 * len(here) > len(group.points):
            notes.append(f"'{group.name}' was moved: what it measured in each arrangement has points of its own")
    renamed = renumbered(found, seen.setting, moving)
    return renamed, _with_distances(field, renamed, moving), tuple(notes)


def renumbered(found: Sequence[Found], setting: np.ndarray, moving: set[int]) -> list[Found]:
    """What was found, each moving code under that of its arrangement."""
    # An image of which nothing tells the arrangement is one of its own.
    own = np.where(setting >= 0, setting, setting.max() + 1 + np.arange(len(setting)))
    answer = []
    for one, time in zip(found, own, strict=True):
        o = one.observations
        code = np.where(np.isin(o.code, list(moving)), code_at(o.code, int(time)), o.code)
        status = o.status.copy()
        if time > 0:
            status[(status == MEASURED) & (o.code == 0)] = MOVED
        answer.append(replace(one, observations=replace(o, code=code, status=status)))
    return answer


def said_settings(names: Sequence[str], seen: Arranged) -> str:
    """Which photographs show which arrangement, in words."""
    parts = []
    for s in sorted(set(seen.setting.tolist()) - {-1}):
        own = [name for name, k in zip(names, seen.setting, strict=True) if k == s]
        more = f" and {len(own) - 6} more" if len(own) > 6 else ""
        parts.append(f"arrangement {s + 1} in {', '.join(own[:6])}{more}")
    return "; ".join(parts)


def _with_distances(field: FieldFile, found: Sequence[Found], moving: set[int]) -> FieldFile:
    """A distance on a moved board is one in every arrangement that shows both ends. It is certified once: n of a length
    tell the scale no better than one, so each is given sqrt(n) times its uncertainty."""
    shown = {int(c) for one in found for c in one.observations.code}
    distances: list[DistancePart] = []
    for one in field.distances:
        if not set(one.codes) <= moving:
            distances.append(one)
            continue
        times = sorted({c // TIME for c in shown if c % TIME in one.codes})
        times = [t for t in times if {code_at(c, t) for c in one.codes} <= shown] or [0]
        for t in times:
            ends = (code_at(one.codes[0], t), code_at(one.codes[1], t))
            name = f"{one.name}, arrangement {t + 1}" if len(times) > 1 else one.name
            u = one.u_mm * np.sqrt(len(times)) if one.role == "control" else one.u_mm
            distances.append(one.model_copy(update={"name": name, "codes": ends, "u_mm": float(u)}))
    return field.model_copy(update={"distances": tuple(distances)})


def against_groups(points: Points, field: FieldFile) -> list[str]:
    """Sentences on boards whose codes are not where their approximate places say, or were not seen at all."""
    notes = []
    for group in field.groups:
        place = {p.code: np.array(p.xyz) for p in group.points}
        measured = {int(c): xyz for c, xyz in zip(points.code, points.xyz_mm, strict=True) if int(c) in place}
        if missing := sorted(set(place) - set(measured)):
            some = ", ".join(map(str, missing[:12])) + (" ..." if len(missing) > 12 else "")
            notes.append(f"{len(missing)} of {len(place)} codes of '{group.name}' were not measured: {some}")
        if len(measured) < LEAST_FIT:
            continue
        codes = sorted(measured)
        sheet, there = np.array([place[c] for c in codes]), np.array([measured[c] for c in codes])
        scale, R, t = robust_similarity(there, sheet)
        off = np.linalg.norm(scale * there @ R.T + t - sheet, axis=1)
        if far := [f"code {c} by {d:.3g}" for c, d in zip(codes, off, strict=True) if d > FAR * group.u]:
            notes.append(
                f"'{group.name}': {len(far)} of {len(codes)} codes are not where the field file says, in its unit: "
                f"{', '.join(far[:6])}{' ...' if len(far) > 6 else ''}; were they moved?"
            )
    return notes
