"""What `testfield detect` wrote of photographs, to be measured from without them."""

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from testfield.detect.observations import Observations
from testfield.detect.photograph import Found
from testfield.detect.target_spec import TargetSpec
from testfield.errors import TestfieldError
from testfield.measure.patterns import Pattern, board_pattern
from testfield.store.sheets import read_json

BESIDE = "detection.json"
"""What lies beside the table: the sizes of the images, and what was looked for."""
MEASURED = "measurement.json"
"""The same beside a table that `testfield measure` wrote."""
MOST_SIDE_PX = 1_000_000
"""No image is wider or higher."""


@dataclass(frozen=True)
class Observed:
    """Images by name: what was `found` in each, and each one's size (width, height) in px."""

    names: tuple[str, ...]
    found: list[Found]
    sizes: list[tuple[int, int]]


def read_observed(
    path: Path, target: TargetSpec, patterns: tuple[Pattern, ...], size_px: tuple[int, int] | None = None
) -> Observed:
    """Observations as `testfield detect` wrote them: the folder, or its `observations.parquet`; or anybody's table of
    that form (CSV, too), with the images' `size_px`.

    Raises `TestfieldError` for a table that cannot be, where nobody says how large the images are, and where several
    boards are declared and the table does not say which observation belongs to which.
    """
    table = path / "observations.parquet" if path.is_dir() else path
    o = Observations.load(table)
    sizes = _sizes(table, o.stations, size_px)
    if patterns and (o.board < 0).all():
        if len(patterns) > 1:
            raise TestfieldError(
                f"the table names no boards, and {len(patterns)} are declared",
                str(table),
                "measure from the photographs, or from one board's table",
            )
        o = replace(o, board=np.where(o.point >= 0, 0, -1))
    place = np.full((len(o), 2), -1)
    for b, pattern in enumerate(patterns):
        here = (o.board == b) & (o.point >= 0)
        place[here] = _place(pattern.target, o.point[here], table)
    if not patterns and target.kind == "circles":
        here = o.point >= 0
        place[here] = _place(target, o.point[here], table)
    return Observed(
        o.stations,
        [Found(o.take(o.station == k), place[o.station == k], ()) for k in range(len(o.stations))],
        sizes,
    )


def _place(target: TargetSpec, point: np.ndarray, table: Path) -> np.ndarray:
    """(n, 2) column and row of points of a board, -1 on a board of tags."""
    if target.kind in ("tags", "aprilgrid", "squares"):
        return np.full((len(point), 2), -1)
    shown = board_pattern(target)
    if target.kind == "runetag":
        return np.column_stack([point, np.zeros_like(point)])
    columns = shown.columns - int(shown.has_corners)
    if point.max(initial=0) >= len(shown.points_mm):
        raise TestfieldError(
            f"point {int(point.max())}: the board has {len(shown.points_mm)} points, numbered from 0 row by row",
            str(table),
            "name the board that was looked for, with its columns and rows",
        )
    return np.column_stack([point % columns, point // columns])


def _sizes(table: Path, stations: tuple[str, ...], size_px: tuple[int, int] | None) -> list[tuple[int, int]]:
    if size_px is not None:
        return [size_px] * len(stations)
    beside = table.parent / BESIDE
    told = _told(beside) if beside.is_file() else _told_of_cameras(table.parent / MEASURED, stations)
    if missing := [name for name in stations if name not in told]:
        raise TestfieldError(
            f"nobody says how large image '{missing[0]}' is",
            str(beside if beside.is_file() else table),
            "give --size-px WIDTHxHEIGHT, or the folder that `testfield detect` or `testfield measure` wrote",
        )
    return [told[name] for name in stations]


def _told(path: Path) -> dict[str, tuple[int, int]]:
    """Sizes by the images' names, of those that the file tells."""
    answer: dict[str, tuple[int, int]] = {}
    content: Any = read_json(path)
    images = content.get("images", []) if isinstance(content, dict) else []
    for image in images if isinstance(images, list) else []:
        size = image.get("size_px") if isinstance(image, dict) else None
        if isinstance(size, list) and len(size) == 2 and all(isinstance(v, int) and 0 < v < 1e6 for v in size):
            answer[str(image.get("image"))] = (size[0], size[1])
    return answer


def _told_of_cameras(path: Path, stations: tuple[str, ...]) -> dict[str, tuple[int, int]]:
    """The size that all cameras of a measurement share, for each image; empty where they differ or no file tells."""
    content: Any = read_json(path) if path.is_file() else {}
    if not isinstance(content, dict):
        return {}
    cameras = content.get("cameras")
    each = list(cameras.values()) if isinstance(cameras, dict) else [content]
    interiors = [one.get("interior") if isinstance(one, dict) else None for one in each]
    sizes = [
        (one.get("width_px"), one.get("height_px")) if isinstance(one, dict) else (None, None) for one in interiors
    ]
    told = [
        (w, h)
        for w, h in sizes
        if isinstance(w, int) and isinstance(h, int) and 0 < w < MOST_SIDE_PX and 0 < h < MOST_SIDE_PX
    ]
    if len(told) < len(sizes) or len(set(told)) != 1:
        return {}
    return dict.fromkeys(stations, told[0])


def parse_size(text: str, where: str) -> tuple[int, int]:
    """Width and height of an image, as 640x480. Raises `TestfieldError` for anything else."""
    size = re.fullmatch(r"(\d{1,6})x(\d{1,6})", text.strip())
    if not size or not int(size[1]) or not int(size[2]):
        raise TestfieldError(f"'{text}' is no size", where, "give width and height in px, as 640x480")
    return int(size[1]), int(size[2])
