"""What was found in photographs: a picture a photograph, and tables of all."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from testfield.camera.photograph import Photograph
from testfield.detect.observations import MEASURED, TEXTURE, Observations
from testfield.detect.photograph import Found
from testfield.report.style import shown
from testfield.store.atomic import whole
from testfield.store.stamp import stamp
from testfield.store.text import write_text

FINE, REFUSED = (80, 220, 80), (60, 60, 255)
"""Blue, green, red."""
COLUMNS = (
    "image",
    "x_px",
    "y_px",
    "cov_xx_px2",
    "cov_xy_px2",
    "cov_yy_px2",
    "diameter_px",
    "code",
    "point",
    "column",
    "row",
    "chi2",
    "status",
)


def write_found(
    names: Sequence[str],
    read: Sequence[tuple[str, ...]],
    found: Sequence[Found],
    folder: Path,
    sizes_px: Sequence[tuple[int, int]],
    target: str,
) -> None:
    """`observations.csv`, `observations.parquet` and `detection.json` of all photographs by their `names`, with notes
    on how each was `read`, their sizes (width, height), and the `target` that was looked for."""
    folder.mkdir(parents=True, exist_ok=True)
    with whole(folder / "observations.csv") as path, path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(COLUMNS)
        for name, one in zip(names, found, strict=True):
            table.writerows(_rows(name, one))
    with whole(folder / "observations.parquet") as path:
        Observations.join([one.observations for one in found], tuple(names)).save(path)
    with whole(folder / "detection.json") as path:
        images = [
            _summary(name, notes, one) | {"size_px": list(size)}
            for name, notes, one, size in zip(names, read, found, sizes_px, strict=True)
        ]
        write_text(path, json.dumps(stamp() | {"target": target, "images": images}, indent=1))


def _summary(name: str, read: tuple[str, ...], found: Found) -> dict:
    o = found.observations
    statuses, counts = np.unique(o.status.astype(str), return_counts=True)
    return {
        "image": name,
        "read": read,
        "notes": found.notes,
        "measured": int((o.status == MEASURED).sum()),
        "codes": found.numbers.tolist(),
        "grid": (found.place.max(axis=0) + 1).tolist() if (found.place >= 0).any() else None,
        "passed_over": found.passed_over,
        "statuses": dict(zip(statuses.tolist(), counts.tolist(), strict=True)),
    }


def _rows(name: str, found: Found) -> list[list]:
    o = found.observations
    cov, size = o.cov_px2, o.diameter_px

    def text(value: float, form: str) -> str:
        return format(value, form) if np.isfinite(value) else ""

    return [
        [
            name,
            text(o.xy_px[k, 0], ".4f"),
            text(o.xy_px[k, 1], ".4f"),
            *(text(c, ".4e") for c in (cov[k, 0, 0], cov[k, 0, 1], cov[k, 1, 1])),
            text(size[k], ".2f"),
            int(o.code[k]),
            int(o.point[k]),
            int(found.place[k, 0]),
            int(found.place[k, 1]),
            text(o.chi2[k], ".3g"),
            o.status[k],
        ]
        for k in range(len(o))
    ]


def draw_found(photograph: Photograph, found: Found, path: Path) -> None:
    """The photograph, its darks lifted, with the measured targets' ellipses, numbers, and why others were refused."""
    o = found.observations
    grey = (255 * shown(photograph.pixels)).astype(np.uint8)
    scale = 2 if max(grey.shape) < 2500 else 1
    picture = cv2.cvtColor(
        cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST), cv2.COLOR_GRAY2BGR
    )
    names = _names(found)
    for k in range(len(o)):
        xy = o.xy_px[k]
        if not np.isfinite(xy).all() or (np.abs(xy) > 1e6).any():
            continue
        colour = FINE if o.status[k] == MEASURED else REFUSED
        at = tuple(int(v) for v in np.rint((xy + 0.5) * scale - 0.5))
        if np.isfinite(o.moments_px2[k]).all() and o.status[k] not in TEXTURE:
            values, vectors = np.linalg.eigh(np.maximum(o.moments_px2[k], -1e9))
            axes = tuple(max(1, round(2 * float(np.sqrt(max(v, 0))) * scale)) for v in values[::-1])
            turn = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
            if max(axes) < 10_000:
                cv2.ellipse(picture, at, axes, turn, 0, 360, colour, 1, cv2.LINE_AA)
        else:
            cv2.circle(picture, at, 3 if o.status[k] == MEASURED else 1, colour, 1, cv2.LINE_AA)
        if names[k]:
            cv2.putText(
                picture, names[k], (at[0] + 4, at[1] - 4), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA
            )
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole(path) as part:
        cv2.imwrite(str(part), picture)


def _names(found: Found) -> list[str]:
    o = found.observations
    names = []
    for k in range(len(o)):
        if o.status[k] not in (MEASURED, *TEXTURE):
            names.append(o.status[k] if o.code[k] <= 0 else f"{o.code[k]} {o.status[k]}")
        elif o.status[k] != MEASURED:
            names.append("")
        elif o.code[k] > 0:
            names.append(str(o.code[k]))
        elif found.place[k, 0] >= 0:
            names.append(f"{found.place[k, 0]},{found.place[k, 1]}")
        else:
            names.append("")
    return names
