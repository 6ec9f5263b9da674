"""What a perfect renderer would put into every pixel of one target's window, in float64.

The outlines of dot and ring are followed through the whole lens; a pixel's value is the area that they enclose in it.
Nothing here is taken from `render` or from `camera`: two roads to one figure must not share a bridge.
"""

from dataclasses import dataclass

import numpy as np

KNOTS = 8192
"""Arcs to a full circle. A pixel is then wrong by about 1e-8; `tests/test_certify_geometry.py` holds it to 1e-7."""


@dataclass(frozen=True)
class Window:
    """Part of an image: `values` (rows, columns), of which the first is pixel (`left_px`, `top_px`)."""

    left_px: int
    top_px: int
    values: np.ndarray

    def of(self, image: np.ndarray) -> np.ndarray:
        """The same part of a whole image, float64."""
        rows, columns = self.values.shape
        return image[self.top_px : self.top_px + rows, self.left_px : self.left_px + columns].astype(float)


@dataclass(frozen=True)
class Sheet:
    """A sheet rolled about a line of its own plane, with a target printed at `xy_mm`.

    `radius_mm` of the roll, negative where its middle stands back from the viewer; `axis_rad` of the line, from x.
    """

    xy_mm: np.ndarray
    radius_mm: float
    axis_rad: float

    def lift(self, xy_mm: np.ndarray) -> np.ndarray:
        """(n, 3) places of points (n, 2) of the flat print, in the frame of the sheet's middle."""
        turn = np.exp(-1j * self.axis_rad)
        flat = ((xy_mm + self.xy_mm) @ [1, 1j]) * turn  # real part along the line, imaginary part across it
        rolled = self.radius_mm * np.exp(1j * flat.imag / self.radius_mm)  # from the line above the middle
        back = (flat.real + 1j * rolled.imag) / turn
        return np.column_stack([back.real, back.imag, rolled.real - self.radius_mm])


def ink_in_pixels(
    parameters: np.ndarray,
    R: np.ndarray,
    t_mm: np.ndarray,
    radius_mm: float,
    word: int,
    bits: int,
    margin_px: int = 2,
    knots: int = KNOTS,
    sheet: "Sheet | None" = None,
) -> Window:
    """Fraction of each pixel that is ink, in the target's bounding box widened by `margin_px`.

    `parameters` (9,) fx fy cx cy k1 k2 k3 p1 p2; `R` (3, 3) and `t_mm` (3,) lead from the target's frame (x right,
    y up, z out of the front) to the camera's; `word` of the ring, 0 for a dot alone; `knots` to a full circle. With a
    bent `sheet` that carries the target, `R` and `t_mm` lead from the frame of the sheet's middle.
    """
    lift = sheet.lift if sheet else lambda xy: np.column_stack([xy, np.zeros(len(xy))])
    places = (lift(xy) @ R.T + t_mm for xy in outline(radius_mm, word, bits, knots))
    return _filled([through_lens(parameters, place) for place in places], margin_px)


def cells_in_pixels(
    parameters: np.ndarray,
    R: np.ndarray,
    t_mm: np.ndarray,
    x_mm: np.ndarray,
    y_mm: np.ndarray,
    black: np.ndarray,
    margin_px: int = 2,
    pieces: int = 128,
) -> Window:
    """The same for a print of rectangular cells: `black` (r, c) between lines `x_mm` (c + 1,) and `y_mm` (r + 1,).

    Each cell's outline is followed by itself; what two of them share is followed both ways and adds nothing. `pieces`
    to each side.
    """
    along = np.linspace(0, 1, 2 * pieces + 1)
    up, down = along, along[::-1]
    none, full = np.zeros_like(along), np.ones_like(along)
    sides = [np.column_stack(side) for side in ((up, none), (full, up), (down, full), (none, down))]
    row, column = np.nonzero(black)
    low = np.column_stack([x_mm[column], y_mm[row]])
    size = np.column_stack([x_mm[column + 1], y_mm[row + 1]]) - low
    curves = np.concatenate([low[:, None] + size[:, None] * side for side in sides])
    parts = (curves[:, :-2:2], curves[:, 1::2], curves[:, 2::2])
    places = (np.column_stack([p.reshape(-1, 2), np.zeros(p.size // 2)]) @ R.T + t_mm for p in parts)
    return _filled([through_lens(parameters, place) for place in places], margin_px)


def _filled(pieces_px: list[np.ndarray], margin_px: int) -> Window:
    """The window of outlines whose pieces have these three: starts, middles and ends (m, 2)."""
    start, middle, end = pieces_px
    low = np.floor(start.min(axis=0) + 0.5).astype(int) - margin_px
    columns, rows = np.floor(start.max(axis=0) + 0.5).astype(int) + margin_px + 1 - low
    corner = low - 0.5
    values = _enclosed(start - corner, middle - corner, end - corner, rows, columns)
    return Window(int(low[0]), int(low[1]), values)


def through_lens(parameters: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    """(n, 3) points in the camera's frame to (n, 2) pixels by Brown's formula (METHODS section 1.1)."""
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = parameters
    x, y = xyz[:, 0] / xyz[:, 2], xyz[:, 1] / xyz[:, 2]
    s = x**2 + y**2
    bulge = 1 + k1 * s + k2 * s**2 + k3 * s**3
    u = x * bulge + 2 * p1 * x * y + p2 * (3 * x**2 + y**2)
    v = y * bulge + 2 * p2 * x * y + p1 * (x**2 + 3 * y**2)
    return np.column_stack([fx * u + cx, fy * v + cy])


def outline(radius_mm: float, word: int, bits: int, knots: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Starts, middles and ends (m, 2) of short pieces of all edges, counter-clockwise about the ink, in mm.

    The ring (METHODS section 8) has its edges at 2 and 3 radii; its first segment begins at +x and the word is read
    clockwise. Neighbouring segments of ink have no edge between them.
    """

    def arc(radius: float, first: float, last: float) -> np.ndarray:  # at angles given in full turns
        pieces = max(16, int(np.ceil(abs(last - first) * knots)))
        angle = 2 * np.pi * np.linspace(first, last, 2 * pieces + 1)
        return radius_mm * radius * np.column_stack([np.cos(angle), np.sin(angle)])

    def spoke(turn: float, first: float, last: float) -> np.ndarray:
        angle = 2 * np.pi * turn
        along = np.linspace(first, last, 2 * max(16, knots // 6) + 1)  # as dense as the arcs at the dot's edge
        return radius_mm * along[:, None] * [np.cos(angle), np.sin(angle)]

    curves = [arc(1, 0, 1)]
    ink = [bool(word >> (bits - 1 - k) & 1) for k in range(bits)]
    for k in range(bits):
        if ink[k] and not ink[k - 1]:
            length = next(n for n in range(1, bits) if not ink[(k + n) % bits])
            begin, end = -k / bits, -(k + length) / bits
            curves += [arc(3, end, begin), spoke(begin, 3, 2), arc(2, begin, end), spoke(end, 2, 3)]
    return (
        np.concatenate([curve[:-2:2] for curve in curves]),
        np.concatenate([curve[1::2] for curve in curves]),
        np.concatenate([curve[2::2] for curve in curves]),
    )


def _enclosed(start: np.ndarray, middle: np.ndarray, end: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """(rows, columns) area enclosed in each pixel; pixel (i, j) is the square from (j, i) to (j + 1, i + 1).

    By Green's theorem: an edge that runs down by dy in a pixel adds dy times what lies to its right, in this pixel and
    in all to the right of it. Chords are cut exactly where they meet the pixels' borders. Between a chord and its arc
    lie 4/3 of the triangle over the arc's middle (Archimedes, Quadrature of the Parabola), given whole to the pixel of
    that middle; what is given to the wrong neighbour so is less than 1e-8 of a pixel for marks of 100 px.
    """
    step = end - start
    if np.abs(step).max() >= 1:
        raise ValueError("an edge's piece spans a pixel; more knots are needed")
    # Pieces are shorter than a pixel, so each meets at most one border in x and one in y.
    with np.errstate(divide="ignore", invalid="ignore"):
        border = np.maximum(np.floor(start), np.floor(end))
        cut = np.where(np.floor(start) == np.floor(end), 0.0, (border - start) / step)
    cut = np.sort(cut, axis=1)
    parts = np.column_stack([np.zeros(len(cut)), cut, np.ones(len(cut))])
    at = (parts[:, 1:] + parts[:, :-1]) / 2
    x = start[:, :1] + at * step[:, :1]
    y = start[:, 1:] + at * step[:, 1:]
    down = np.diff(parts, axis=1) * step[:, 1:]

    beside = np.zeros((rows, columns + 1))
    beyond = np.zeros((rows, columns + 1))
    row, column = np.floor(y).astype(int), np.floor(x).astype(int)
    np.add.at(beside, (row, column), down * (column + 1 - x))
    np.add.at(beyond, (row, column + 1), down)
    bow = middle - start
    sliver = (step[:, 0] * bow[:, 1] - step[:, 1] * bow[:, 0]) * (2 / 3)
    row, column = np.floor(middle[:, 1]).astype(int), np.floor(middle[:, 0]).astype(int)
    np.add.at(beside, (row, column), sliver)
    return (beside + np.cumsum(beyond, axis=1))[:, :-1]
