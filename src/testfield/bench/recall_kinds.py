"""Found and wrong of every kind of target over size, tilt, noise and blur, beside the best public detectors of it.

Every detector sees the same pictures, and the same pictures of clutter: a curve counts only beside its false finds.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testfield.bench.drawn_boards import Drawn, View, clutter, draw
from testfield.bench.public_detectors import Reading, of_kind
from testfield.camera.photograph import Photograph
from testfield.detect.observations import MEASURED, READ
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.target_spec import TargetSpec, parse_target
from testfield.measure.patterns import board_pattern
from testfield.targets.board_pattern import CORNERS_A_TAG, BoardPattern

OURS = "testfield"
NEAR_PX, NEAR = 1.5, 0.1
"""A find is a target's within so many pixels, or so much of its width."""


@dataclass(frozen=True)
class Kind:
    """A kind: what is asked for (`word`), what is drawn (`drawn`), the part of a board by which its size is told
    (`unit_mm`), and that `size` in words with its steps in px; the middle one is the base of the other series."""

    name: str
    word: str
    drawn: str
    unit_mm: float
    size: str
    steps_px: tuple[float, ...]


KINDS = (
    Kind("ring codes", "ring14", "", 1.0, "dot", (4, 5, 7, 10, 16)),
    Kind("circles", "circles:7x5", "circles:7x5:20:10", 10.0, "dot", (4, 5, 7, 10, 16)),
    Kind("hexagonal circles", "hexcircles:6x7", "hexcircles:6x7:20:12", 12.0, "dot", (4, 5, 7, 10, 16)),
    Kind("asymmetric circles", "acircles:4x7", "acircles:4x7:14:12", 12.0, "dot", (4, 5, 7, 10, 16)),
    Kind("checkerboard", "checkerboard:7x4", "checkerboard:7x4:20", 20.0, "square", (4, 6, 12, 20, 32)),
    Kind(
        "ChArUco", "charuco:6x5:DICT_4X4_50:30:22", "charuco:6x5:DICT_4X4_50:30:22", 22 / 6, "cell", (1.5, 2, 3, 5, 8)
    ),
    Kind("AprilTag", "apriltag:36h11", "tags:4x3:DICT_APRILTAG_36h11:40:28", 28 / 8, "cell", (1.5, 2, 3, 5, 8)),
    Kind("AprilGrid", "aprilgrid:4x3:54:16.2", "aprilgrid:4x3:54:16.2", 5.4, "cell", (1.5, 2, 3, 5, 8)),
    Kind("CCTag", "cctag:3", "", 66.0, "outer circle", (20, 28, 50, 70, 100)),
)
CCTAGS = BoardPattern("cctag", 3, 2, 90.0, 66.0, first_tag=5, crowns=3)
SERIES: dict[str, tuple[float, ...]] = {
    "size_px": (),
    "tilt_deg": (0, 40, 55, 65, 75),
    "snr": (3, 5, 8, 15, 60),
    "blur_px": (0.4, 1.2, 2, 3, 4),
}
QUICK = {"size_px": (1, 3), "tilt_deg": (2, 3), "snr": (1, 2), "blur_px": (1, 2)}
"""The steps of each series that the quick version looks at."""


def bench_kinds(
    repeats: int, empty: int, quick: bool = False, tell: Callable[[str], None] = lambda _: None, seed: int = 1
) -> list[dict[str, Any]]:
    """A row for each kind, series, step and detector: `there` to be found, `found`, `wrong` (numbers or places that are
    none), of `empty` pictures of clutter the finds as `false`."""
    rows = []
    for kind in KINDS:
        tell(kind.name)
        spec = parse_target(kind.word)
        readers = {OURS: lambda image, spec=spec: ours(image, spec)} | of_kind(kind.word)
        false = {name: 0 for name in readers}
        for k in range(empty):
            image = clutter(View(1.0), seed + k)
            for name, read in readers.items():
                false[name] += len(read(image)[0])
        for factor in SERIES:
            for value, view in _views(kind, factor, quick):
                counts = {name: np.zeros(3, int) for name in readers}
                for k in range(repeats):
                    picture = drawn(kind, view, seed + k)
                    for name, read in readers.items():
                        counts[name] += scored(kind, picture, read(picture.image))
                rows += [
                    {
                        "kind": kind.name,
                        "factor": factor,
                        "value": value,
                        "detector": name,
                        "there": int(count[0]),
                        "found": int(count[1]),
                        "wrong": int(count[2]),
                        "false": false[name],
                        "empty": empty,
                    }
                    for name, count in counts.items()
                ]
    return rows


def _views(kind: Kind, factor: str, quick: bool) -> list[tuple[float, View]]:
    base = View(kind.steps_px[2])
    steps = SERIES[factor] or kind.steps_px
    chosen = [steps[k] for k in QUICK[factor]] if quick else list(steps)
    return [(float(value), replace(base, **{factor: float(value)})) for value in chosen]


def drawn(kind: Kind, view: View, seed: int) -> Drawn:
    """A picture of a kind's board."""
    spec = parse_target(kind.word)
    pattern = CCTAGS if spec.kind == "cctag" else board_pattern(parse_target(kind.drawn)) if kind.drawn else None
    of = parse_target(kind.drawn) if kind.drawn else spec
    return draw(of, pattern, kind.unit_mm, view, seed)


def ours(image: np.ndarray, spec: TargetSpec) -> Reading:
    """What this project finds: numbers (n,) and places (n, 2) px; of tags their middles."""
    found = detect_in_photograph(Photograph("drawn", image.astype(np.float32), 8, ()), spec).observations
    found = found.take(np.isin(found.status.astype(str), (MEASURED, READ)) & np.isfinite(found.xy_px).all(axis=1))
    if spec.kind == "ring":
        found = found.take(found.code > 0)
        return found.code, found.xy_px
    if spec.kind == "cctag":
        return found.code, found.xy_px
    if spec.kind in ("apriltag", "aprilgrid"):
        # Kalibr counts corners along the rows of the whole grid, so a tag's are not one after the other.
        tag = found.code if spec.kind == "apriltag" else tag_of_corner(spec, found.point)
        numbers, count = np.unique(tag, return_counts=True)
        whole = numbers[count >= (CORNERS_A_TAG if spec.kind == "apriltag" else CORNERS_A_TAG - 1)]
        return whole, np.array([found.xy_px[tag == n].mean(axis=0) for n in whole]).reshape(-1, 2)
    found = found.take(found.point >= 0)
    return found.point, found.xy_px


def tag_of_corner(spec: TargetSpec, point: np.ndarray) -> np.ndarray:
    """(n,) which tag of an AprilGrid the corners numbered (n,) belong to."""
    row, column = np.divmod(point, 2 * spec.columns)
    return np.asarray(row // 2 * spec.columns + column // 2)


def scored(kind: Kind, picture: Drawn, reading: Reading) -> np.ndarray:
    """(3,) targets there, found and wrong. A grid that looks alike upside down may be numbered from either end."""
    number, xy = reading
    ends = [picture.number]
    if kind.name in ("circles", "asymmetric circles", "hexagonal circles", "checkerboard"):
        ends.append(picture.number[::-1])
        if kind.name == "checkerboard":  # others count columns from either side, too
            columns = parse_target(kind.word).columns
            mirrored = picture.number.reshape(-1, columns)[:, ::-1].ravel()
            ends += [mirrored, mirrored[::-1]]
    best = 0
    for numbers in ends:
        where = {int(n): k for k, n in enumerate(numbers)}
        hit = set()
        for n, place in zip(number, xy, strict=True):
            k = where.get(int(n))
            if k is not None and np.linalg.norm(place - picture.xy_px[k]) < max(NEAR_PX, NEAR * picture.across_px[k]):
                hit.add(k)
        best = max(best, len(hit))
    return np.array([len(picture.number), best, len(number) - best])


def figures_of(repeats: int, empty: int, quick: bool, tell: Callable[[str], None]) -> dict[str, Any]:
    """All `rows`, as of `bench_kinds`, and where ours are `behind`."""
    rows = bench_kinds(repeats, empty, quick, tell)
    return {"rows": rows, "behind": behind(rows)}


def said(figures: dict[str, Any]) -> list[str]:
    """The same for a person."""
    return [*lines(figures["rows"]), *(f"behind: {one}" for one in figures["behind"])]


def lines(rows: list[dict[str, Any]]) -> list[str]:
    """The curves for a person: a line a kind, series and detector."""
    text = []
    for kind in KINDS:
        mine = [row for row in rows if row["kind"] == kind.name]
        for factor in SERIES:
            here = [row for row in mine if row["factor"] == factor]
            values = list(dict.fromkeys(row["value"] for row in here))
            title = {"size_px": f"{kind.size}, px", "tilt_deg": "tilt, degrees", "snr": "contrast over noise"}
            head = f"{kind.name}: {title.get(factor, 'blur, px')}"
            text.append(f"{head:<44}" + "".join(f"{value:>9g}" for value in values) + "    wrong   false")
            for name in dict.fromkeys(row["detector"] for row in here):
                own = [row for row in here if row["detector"] == name]
                share = "".join(f"{100 * row['found'] / row['there']:>7.0f} %" for row in own)
                wrong = sum(row["wrong"] for row in own)
                text.append(f"  {name:<42}{share}{wrong:>9}{own[0]['false']:>5} in {own[0]['empty']}")
    return text


def behind(rows: list[dict[str, Any]]) -> list[str]:
    """Where a public detector finds more than we at no more wrong and false finds, in words."""
    said = []
    for row in rows:
        if row["detector"] == OURS:
            continue
        mine = next(
            r for r in rows if r["detector"] == OURS and all(r[k] == row[k] for k in ("kind", "factor", "value"))
        )
        no_worse = row["wrong"] <= mine["wrong"] and row["false"] <= mine["false"]
        if row["found"] > mine["found"] and no_worse:
            said.append(
                f"{row['kind']}, {row['factor']} {row['value']:g}: {row['detector']} finds {row['found']}, "
                f"we {mine['found']} of {mine['there']}"
            )
    return said
