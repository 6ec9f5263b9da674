"""What a measurement in photographs says by photograph, by board and of everything that was seen and not used."""

import base64
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from testfield.calibrate.ties import LEAST_RAYS
from testfield.detect.observations import MEASURED, TEXTURE, Observations
from testfield.measure.photographs import Measurement
from testfield.report.measured_figures import outlined
from testfield.targets.field import TIME
from testfield.targets.field_file import FieldFile

SAME_PX = 1e-3
"""Distance within which a residual belongs to an observation."""
CROP_PX, CROP_SHOWN_PX = 56, 112
MOST_CROPS = 6
"""Crops shown of one reason."""
PLAIN_CAUSES = (*TEXTURE, "ring cut by the image's edge")


@dataclass(frozen=True)
class Unused:
    """A reason why something was not used: how many, in which photographs mostly, and `crops` of some."""

    why: str
    count: int
    images: int
    texture: bool
    crops: tuple[dict[str, Any], ...]


def residual_rows(result: Measurement) -> np.ndarray:
    """(m,) the observation of each residual of the calibration, -1 where none is there."""
    c, o = result.calibration, result.observations
    if not len(c.residual_at_px) or not len(o):
        return np.full(len(c.residual_at_px), -1)
    finite = np.flatnonzero(np.isfinite(o.xy_px).all(axis=1))
    away, near = cKDTree(o.xy_px[finite]).query(c.residual_at_px)
    return np.where(away < SAME_PX, finite[np.minimum(near, len(finite) - 1)], -1)


def stations_of(result: Measurement, rows: np.ndarray) -> list[dict[str, Any]]:
    """A photograph each: whether it joined, where its camera stood, its targets that are points, what it saw, used and
    lost, its residuals, and the part of the image within the outline of what was used."""
    c, o = result.calibration, result.observations
    size2 = (c.residual_px**2).sum(axis=1)
    station = np.where(rows >= 0, o.station[np.maximum(rows, 0)], -1)
    lost = Counter(r.get("station", "") for r in c.rejected)
    place = {name: k for k, name in enumerate(c.station_names)}
    answer = []
    for s, name in enumerate(o.stations):
        own = station == s
        k = place.get(name)
        camera = c.interiors[int(c.camera_of_image[k])] if k is not None else c.interior
        answer.append(
            {
                "name": name,
                "joined": k is not None,
                "xyz": c.stations.origin_mm[k] if k is not None else None,
                "targets": int(((o.station == s) & (o.point >= 0)).sum()),
                "measured": int(((o.station == s) & (o.status == MEASURED)).sum()),
                "used": int(own.sum()),
                "rejected": lost[name],
                "rms": float(np.sqrt(size2[own].mean())) if own.any() else None,
                "worst": float(np.sqrt(size2[own].max())) if own.any() else None,
                "covered": 100 * outlined(c.residual_at_px[own], camera.width_px, camera.height_px)[0],
            }
        )
    return answer


def boards_of(result: Measurement, field: FieldFile, rows: np.ndarray) -> list[dict[str, Any]]:
    """A board each: one that calibrates, or one whose codes the field file groups."""
    c, o = result.calibration, result.observations
    size2 = (c.residual_px**2).sum(axis=1)
    there = np.maximum(rows, 0)
    answer = []
    if c.board_names:
        parts = [(name, (rows >= 0) & (o.board[there] == b), o.board == b) for b, name in enumerate(_sheets(result))]
    else:
        code = np.where(o.code > 0, o.code % TIME, 0)
        listed = [(group.name, [p.code for p in group.points]) for group in field.groups]
        parts = [(name, (rows >= 0) & np.isin(code[there], own), np.isin(code, own)) for name, own in listed]
        if parts:
            rest = ~np.any([seen for _, _, seen in parts], axis=0)
            parts.append(("in no board, coded", (rows >= 0) & (rest & (code > 0))[there], rest & (code > 0)))
            parts.append(("dots without a code", (rows >= 0) & (code == 0)[there], code == 0))
    for name, used, seen in parts:
        if not seen.any():
            continue
        images = np.unique(o.station[there[used]])
        marks = o.point[there[used]]
        answer.append(
            {
                "name": name,
                "images": len(images),
                "points": len(np.unique(marks[marks >= 0])),
                "seen": int((seen & (o.status == MEASURED)).sum()),
                "used": int(used.sum()),
                "rms": float(np.sqrt(size2[used].mean())) if used.any() else None,
                "mean_x": float(c.residual_px[used, 0].mean()) if used.any() else None,
                "mean_y": float(c.residual_px[used, 1].mean()) if used.any() else None,
            }
        )
    return answer


def _sheets(result: Measurement) -> list[str]:
    """Names of the boards by their numbers in the observations."""
    names = list(result.calibration.board_names)
    more = int(result.observations.board.max(initial=-1)) + 1 - len(names)
    return names + [f"board {k + 1}" for k in range(len(names), len(names) + more)]


def unused_of(result: Measurement, rows: np.ndarray, folder: Path) -> list[Unused]:
    """Everything that was seen and not used, by reason, the most frequent first, texture last."""
    o = result.observations
    why = reasons(result, rows)
    answer = []
    for reason, count in Counter(w for w in why if w).most_common():
        mine = np.flatnonzero(why == reason)
        texture = reason in PLAIN_CAUSES
        # The largest first, for they are what a person would have used.
        size = np.nan_to_num(o.diameter_px[mine])
        first = mine[np.argsort(-size, kind="stable")][:MOST_CROPS]
        crops = [] if texture else [_crop(o, int(k), result, folder) for k in first]
        images = len(np.unique(o.station[mine]))
        answer.append(Unused(reason, count, images, texture, tuple(crop for crop in crops if crop)))
    return sorted(answer, key=lambda one: (one.texture, -one.count))


def reasons(result: Measurement, rows: np.ndarray) -> np.ndarray:
    """(n,) why each observation was not used, empty where it was."""
    c, o = result.calibration, result.observations
    why = np.where(o.status == MEASURED, "", o.status.astype(str)).astype(object)
    used = np.zeros(len(o), bool)
    used[rows[rows >= 0]] = True
    joined = np.isin(np.array(o.stations, object)[o.station], c.station_names) if len(o) else np.zeros(0, bool)
    left = (o.status == MEASURED) & ~used
    seen = Counter(zip(o.station[left | used].tolist(), o.code[left | used].tolist(), strict=True))
    images = Counter(code for _, code in seen)
    for k in np.flatnonzero(left):
        code = int(o.code[k])
        if not joined[k]:
            why[k] = "its photograph could not be joined"
        elif c.board_names:
            why[k] = (
                "in no place of the board" if o.board[k] < 0 or o.point[k] < 0 else "left out with its image's board"
            )
        elif code == 0:
            why[k] = "a dot whose ray meets no others"
        elif seen[int(o.station[k]), code] > 1:
            why[k] = "its number is there twice in the photograph"
        elif images[code] < LEAST_RAYS:
            why[k] = "its number is in one photograph only"
        else:
            why[k] = "fewer than two rays of it were left"
    places = {name: s for s, name in enumerate(o.stations)}
    for r in c.rejected:
        own = np.flatnonzero((o.station == places.get(r.get("station", ""), -1)) & ~used)
        if len(own):
            away = np.linalg.norm(o.xy_px[own] - [r["x_px"], r["y_px"]], axis=1)
            if np.nanmin(away, initial=np.inf) < 1:
                why[own[int(np.nanargmin(away))]] = (
                    f"turned down by the adjustment: {r.get('why', 'contradicts others')}"
                )
    return why


def _crop(o: Observations, k: int, result: Measurement, folder: Path) -> dict[str, Any] | None:
    """A cut of the picture of what was found about an observation, and what to write under it."""
    name = o.stations[o.station[k]]
    picture = _picture(str(folder / f"{name}.png"))
    if picture is None or not np.isfinite(o.xy_px[k]).all():
        return None
    c = result.calibration
    place = list(c.station_names).index(name) if name in c.station_names else 0
    width = c.interiors[int(c.camera_of_image[place])].width_px if len(c.station_names) else c.interior.width_px
    scale = max(1, round(picture.shape[1] / width))
    half = scale * max(CROP_PX // 2, int(1.6 * np.nan_to_num(o.diameter_px[k])))
    x, y = (round(float(v)) for v in scale * (o.xy_px[k] + 0.5))
    cut = cv2.copyMakeBorder(
        picture[max(y - half, 0) : max(y + half, 0), max(x - half, 0) : max(x + half, 0)],
        max(half - y, 0),
        max(y + half - picture.shape[0], 0),
        max(half - x, 0),
        max(x + half - picture.shape[1], 0),
        cv2.BORDER_CONSTANT,
        value=(246, 246, 246),
    )
    if min(cut.shape[:2]) < 4:
        return None
    small = cv2.resize(cut, (2 * CROP_SHOWN_PX,) * 2, interpolation=cv2.INTER_AREA if half > CROP_SHOWN_PX else 1)
    content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].tobytes()
    return {
        "picture": f"data:image/jpeg;base64,{base64.b64encode(content).decode()}",
        "name": name,
        "code": int(o.code[k]) % TIME if o.code[k] > 0 else 0,
        "x": float(o.xy_px[k, 0]),
        "y": float(o.xy_px[k, 1]),
    }


@lru_cache(maxsize=4)
def _picture(path: str) -> np.ndarray | None:
    return cv2.imread(path) if Path(path).is_file() else None
