"""Dots that are hard to find, drawn by the forward model: small, dense, interlaced, at a wide border, half in shade.

Each series is a few pictures of many dots whose pixel values are exact integrals (`detect/disc.py`), so their truth is
known to the last digit and a curve costs seconds.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.photograph import Photograph
from testfield.camera.project import project_camera
from testfield.detect.disc import disc_in_pixels, outline_points
from testfield.detect.observations import MEASURED
from testfield.detect.photograph import ON_BLACK, Found, detect_in_photograph
from testfield.detect.target_spec import TargetSpec
from testfield.seeds import generator

BITS, WHITE_DN, BLACK_DN = 12, 2400.0, 160.0
SAME = 0.35
"""A detection within this part of a dot's diameter from its centre is that dot's."""
SHADE_EDGE_PX = 1.5
"""Standard deviation of a shadow's edge."""


@dataclass(frozen=True)
class Picture:
    """What one picture shows.

    `outline_px` (n, k, 2) of the dots at equal steps of a parameter; `blur_px` of the optics; `snr` contrast over a
    pixel's noise; `shift_px` of every second line to the right; `shade` the light's level in a shadow whose straight
    edge crosses the dots' middles, 1 for none.
    """

    width: int
    height: int
    outline_px: np.ndarray
    blur_px: float = 0.7
    snr: float = 20.0
    shift_px: float = 0.0
    shade: float = 1.0
    seed: int = 0

    @property
    def xy_px(self) -> np.ndarray:
        """(n, 2) centres of the dots' areas, in the exposure of the even lines."""
        x, y = np.moveaxis(self.outline_px, -1, 0)
        x1, y1 = np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)
        cross = x * y1 - x1 * y
        area = cross.sum(axis=1)
        at = [((a + b) * cross).sum(axis=1) / (3 * area) for a, b in ((x, x1), (y, y1))]
        return np.column_stack(at)

    @property
    def diameter_px(self) -> np.ndarray:
        """(n,) of the circles of the same area."""
        x, y = np.moveaxis(self.outline_px, -1, 0)
        area = (x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1) / 2
        return np.asarray(np.sqrt(4 * np.abs(area) / np.pi))


def draw(picture: Picture) -> Photograph:
    """The picture as a photograph, with the noise of its signal-to-noise ratio."""
    covered = [
        _coverage(replace(picture, outline_px=picture.outline_px - [shift, 0]))
        for shift in dict.fromkeys((0.0, -picture.shift_px))
    ]
    share = covered[0]
    if len(covered) > 1:
        share = share.copy()
        share[1::2] = covered[1][1::2]
    level = BLACK_DN + (WHITE_DN - BLACK_DN) * share
    level *= _light(picture)
    noise = (WHITE_DN - BLACK_DN) / picture.snr
    level += generator(picture.seed, "bench/hard_dots").normal(0, noise, level.shape)
    pixels = np.clip(np.rint(level), 0, (1 << BITS) - 1).astype(np.float32)
    return Photograph("hard", pixels, BITS, ())


def _coverage(picture: Picture) -> np.ndarray:
    """(h, w) which part of each pixel the dots cover, blurred."""
    share = np.zeros((picture.height, picture.width))
    outline = picture.outline_px
    k = outline.shape[1]
    tangent = np.fft.ifft(np.fft.fft(outline, axis=1) * (1j * np.fft.fftfreq(k, 1 / k))[None, :, None], axis=1).real
    felt = 5 * np.hypot(picture.blur_px, 0.3) + 1
    for at, along in zip(outline, tangent, strict=True):
        low = np.floor(at.min(axis=0) - felt).astype(int).clip(0)
        high = np.ceil(at.max(axis=0) + felt).astype(int) + 1
        x, y = np.arange(low[0], min(high[0], picture.width)), np.arange(low[1], min(high[1], picture.height))
        if not (len(x) and len(y)):
            continue
        none = np.zeros((1, 0, k, 2))
        disc = disc_in_pixels(at[None], along[None], none, np.array([picture.blur_px]), x[None], y[None])
        share[y[0] : y[-1] + 1, x[0] : x[-1] + 1] += disc.value[0]
    return share


def _light(picture: Picture) -> np.ndarray:
    """(h, w) the light's level: 1, or as `shade` says beyond each dot's own shadow's edge."""
    light = np.ones((picture.height, picture.width))
    if picture.shade == 1:
        return light
    from scipy.special import ndtr

    # One shadow for each column of dots: stripes of light and shade, whose edges cross the dots.
    x = np.unique(np.rint(picture.xy_px[:, 0]))
    columns = np.arange(picture.width)
    sign = 1.0
    dark = np.zeros(picture.width)
    for edge in x:
        dark += sign * ndtr((columns - edge) / SHADE_EDGE_PX)
        sign = -sign
    return light - (1 - picture.shade) * dark[None, :]


def circles(centre_px: np.ndarray, diameter_px: float, blur_px: float, ratio: float = 1.0) -> np.ndarray:
    """(n, k, 2) outlines of ellipses of this area's diameter and ratio of axes."""
    k = 2 * outline_points(diameter_px, blur_px)
    angle = 2 * np.pi * np.arange(k) / k
    shape = np.column_stack([np.cos(angle) * ratio**-0.5, np.sin(angle) * ratio**0.5]) * diameter_px / 2
    return np.asarray(centre_px[:, None] + shape)


def square_grid(columns: int, rows: int, pitch_px: float, seed: int) -> tuple[np.ndarray, int, int]:
    """Centres (n, 2) anywhere within their pixel, and the picture's width and height."""
    at = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2) + 0.5
    xy = np.rint(at * pitch_px) + generator(seed, "bench/hard_dots/grid").uniform(-0.5, 0.5, at.shape)
    return xy, int(columns * pitch_px), int(rows * pitch_px)


def small(diameter_px: float, snr: float, blur_px: float = 0.7, seed: int = 0) -> Picture:
    """100 dots that stand alone."""
    xy, width, height = square_grid(10, 10, 4 * diameter_px + 8, seed)
    return Picture(width, height, circles(xy, diameter_px, blur_px, 0.94), blur_px, snr, seed=seed)


def hexagonal(gap: float, diameter_px: float, blur_px: float = 0.7, snr: float = 50, seed: int = 0) -> Picture:
    """336 dots in a hexagonal grid, with a gap of so many diameters between neighbours."""
    pitch = (1 + gap) * diameter_px
    column, row = np.meshgrid(np.arange(21), np.arange(16))
    xy = np.stack([column + row % 2 / 2, row * np.sqrt(0.75)], -1).reshape(-1, 2) * pitch + 1.5 * pitch
    return Picture(int(23.5 * pitch), int(16.5 * pitch), circles(xy, diameter_px, blur_px), blur_px, snr, seed=seed)


def interlaced(shift_px: float, diameter_px: float, blur_px: float = 0.7, snr: float = 50, seed: int = 0) -> Picture:
    """100 dots of which every second line is shifted."""
    xy, width, height = square_grid(10, 10, 2 * diameter_px + 6, seed)
    return Picture(width, height, circles(xy, diameter_px, blur_px), blur_px, snr, shift_px, seed=seed)


def shaded(shade: float, diameter_px: float, blur_px: float = 0.7, snr: float = 50, seed: int = 0) -> Picture:
    """100 dots through whose middles a shadow's edge runs."""
    xy, width, height = square_grid(10, 10, 2.5 * diameter_px + 6, seed)
    return Picture(width, height, circles(xy, diameter_px, blur_px), blur_px, snr, shade=shade, seed=seed)


def at_border(angle_deg: float, diameter_px: float, blur_px: float = 0.7, snr: float = 50, seed: int = 0) -> Picture:
    """Up to 60 dots of a flat board before a fisheye lens, at so many degrees from its axis, on a ring about it."""
    focal = 300.0
    radius = focal * np.radians(angle_deg)
    side = 2 * int(radius + 3 * diameter_px + 10)
    middle = (side - 1) / 2
    interior = Interior(side, side, np.array([focal, focal, middle, middle, 0, 0, 0, 0.0]), "fisheye")
    away = np.radians(angle_deg)
    # A board square to the axis one unit away: a circle there, wide as its image would be in the middle, and more.
    size = diameter_px / focal / 2 / np.sqrt(np.cos(away) ** 2 * np.sin(away) / max(away, 1e-9) * np.cos(away))
    long_px = 2 * size * radius / np.tan(away)
    count = int(min(60, 2 * np.pi * radius / (1.4 * long_px)))
    towards = 2 * np.pi * np.arange(count) / count
    k = 2 * outline_points(long_px, blur_px)
    around = 2 * np.pi * np.arange(k) / k
    centre = np.tan(away) * np.column_stack([np.cos(towards), np.sin(towards)])
    board = centre[:, None] + size * np.column_stack([np.cos(around), np.sin(around)])
    rays = np.concatenate([board, np.ones((*board.shape[:2], 1))], axis=-1)
    return Picture(
        side, side, project_camera(interior, rays.reshape(-1, 3)).reshape(board.shape), blur_px, snr, seed=seed
    )


def found_of(picture: Picture, look: Callable[[Photograph], Found]) -> dict[str, Any]:
    """How many of the dots are measured and how far off (rms, px), how many finds are none, and why others are not."""
    found = look(draw(picture)).observations
    # All lines of an interlaced picture show the mean of two exposures, the even ones the first of them.
    exposures = [picture.xy_px + [shift, 0] for shift in (0.0, picture.shift_px / 2)]
    distance = np.min([np.linalg.norm(found.xy_px[:, None] - xy, axis=2) for xy in exposures], axis=0)
    distance = np.where(np.isfinite(distance), distance, np.inf)
    measured = found.status == MEASURED
    of = distance.argmin(axis=1) if len(distance) else np.zeros(0, int)
    here = distance.min(axis=1, initial=np.inf) < SAME * picture.diameter_px[of] if len(distance) else np.zeros(0, bool)
    hit = np.unique(of[here & measured])
    error = distance[here & measured].min(axis=1, initial=np.inf)
    why: dict[str, int] = {}
    for k in np.setdiff1d(np.arange(len(picture.outline_px)), hit):
        rows = np.flatnonzero(here & (of == k))
        name = str(found.status[rows[0]]) if len(rows) else "not seen at all"
        why[name] = why.get(name, 0) + 1
    sigma = np.sqrt(np.einsum("nii->n", found.cov_px2[here & measured]) / 2)
    return {
        "dots": len(picture.outline_px),
        "found": len(hit),
        "false": int((measured & ~here).sum()),
        "error_px": float(np.sqrt(np.mean(error**2) / 2)) if len(error) else None,
        "stated_px": float(np.sqrt(np.mean(sigma**2))) if len(error) else None,
        "missed": why,
    }


def series() -> dict[str, list[tuple[str, Picture]]]:
    """The pictures of each curve with what varies in words."""
    small_ones = [(f"{d:g} px, SNR {snr:g}", small(d, snr)) for snr in (10, 20, 50) for d in (5, 5.5, 6, 7, 8)]
    dense = [(f"gap {g:g}, {d:g} px", hexagonal(g, d)) for g in (0.1, 0.15, 0.25, 0.5) for d in (8, 12, 20)]
    jagged = [(f"shift {s:g} px, {d:g} px", interlaced(s, d)) for s in (0.5, 1, 2, 3) for d in (10, 16, 24)]
    shade = [(f"light {s:g}, {d:g} px", shaded(s, d)) for s in (0.7, 0.5, 0.3, 0.2) for d in (10, 20, 40)]
    border = [(f"{a:g} degrees, {d:g} px", at_border(a, d)) for a in (40, 60, 70, 75) for d in (10, 20)]
    return {
        "small dots": small_ones,
        "hexagonal grids, gap in diameters": dense,
        "every second line shifted": jagged,
        "a shadow's edge across each dot": shade,
        "a flat board at a fisheye's border": border,
    }


def look(photograph: Photograph) -> Found:
    """What detection finds in a picture of this bench, told only that the dots are bright."""
    return detect_in_photograph(photograph, TargetSpec("circles"), polarity=ON_BLACK)


def bench_hard(tell: Callable[[str], None] = lambda _: None) -> dict[str, list[dict[str, Any]]]:
    """Every curve: a row a picture, as `found_of` has it, and its `name`."""
    curves: dict[str, list[dict[str, Any]]] = {}
    for title, pictures in series().items():
        tell(title)
        curves[title] = [{"name": name} | found_of(picture, look) for name, picture in pictures]
    return curves


def lines(curves: dict[str, list[dict[str, Any]]]) -> list[str]:
    """The curves for a person."""
    text = []
    for title, rows in curves.items():
        text.append(f"{title:<40}{'found':>12}{'false':>7}{'error px':>10}{'stated':>8}  not found")
        for row in rows:
            numbers = "".join(
                f"{row[k]:>{w}.3f}" if row[k] else " " * w for k, w in (("error_px", 10), ("stated_px", 8))
            )
            why = ", ".join(f"{count} {name}" for name, count in row["missed"].items())
            text.append(f"  {row['name']:<38}{row['found']:>6} of {row['dots']:>3}{row['false']:>6} {numbers}  {why}")
    return text
