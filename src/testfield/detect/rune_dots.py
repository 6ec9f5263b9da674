"""The dots of a RUNE-Tag by name: circles found among dots, their sectors, and the word that they show.

Dots that lie near each other are one cluster. The outer circle is the ellipse on which most of a cluster's outermost
dots lie; of all perspectives in which it is a circle the one is taken in which the other dots lie on the two circles
within. A word is taken where symbols that are wrong count two, those not seen one, and all of them are fewer than what
lies between two words, so that no other tag, and no other turn of this one, could be meant. Where no number is
expected, the nearest of all words is taken on top of that only where chance would not bring any as near.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError, cKDTree

from testfield.seeds import generator
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.rune_code import (
    APART,
    DOT,
    RADII,
    SECTORS,
    chance_of_rune,
    nearest_rune,
    places_of_rune,
    symbols_of,
    word_of_rune,
)

LINKED = 4.5
"""Dots nearer than this many diameters are of one tag: an empty circle leaves 3.2, seen at a slant up to 4.5."""
FEWEST = 18
DRAWS = (100, 200)
"""Ellipses tried through five of the dots on the hull, and of those with the ones that are next outermost."""
CANDIDATES, ALIKE = 5, 0.8
"""Ellipses looked at further, which share fewer than this part of their dots."""
OUTSIDE = (2.0, 0.5)
"""What a dot outside an ellipse counts against one that is on it: other dots may lie around a tag."""
ON_CIRCLE = 0.04
"""How far from its circle a dot may be, in radii of the outer one: circles are 0.167 apart."""
TILTS = (np.linspace(-0.3, 0.3, 21), np.linspace(-0.02, 0.02, 9), np.linspace(-0.003, 0.003, 7))
"""Where the middle may be seen, in half axes of the outer ellipse, coarsely and then finer."""
NEAR, SIZES = 0.3, 1.3
"""How far from where it must be a dot may lie, in its diameters, and by what ratio its diameter may be another."""

CHANCE = 1e-8
"""Words that chance may bring as near as one that nobody expected: some ten ellipses of an image are read, and a wrong
number in a million images is too many."""
ANY = BoardPattern("runetag", 1, 1, 1.0, DOT)
"""A tag whose number and size nobody told: a unit wide."""

Told = Callable[[np.ndarray], tuple[BoardPattern, int] | None]
"""Symbols (43,) to the tag that they show and the sector that is its first, or None."""


def name_rune(xy_px: np.ndarray, diameter_px: np.ndarray, pattern: BoardPattern) -> np.ndarray:
    """(n,) number of the point that each dot (n, 2) px is of the tag, -1 for those that are none."""
    number = np.full(len(xy_px), -1)
    for rows in _clusters(xy_px, diameter_px):
        seen = _seen(xy_px[rows], lambda symbols: _expected(symbols, pattern))
        if seen is None:
            continue
        found = _nearest(seen[0], xy_px[rows], diameter_px[rows], pattern)
        if (found >= 0).sum() > (number >= 0).sum():
            number[:] = -1
            number[rows] = found
    return number


def read_runes(xy_px: np.ndarray, diameter_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which tag each dot (n, 2) px is of, by its number (n,), and which of its points (n,); -1 for those of none. A
    number that is seen twice is told twice."""
    tag, point = np.full(len(xy_px), -1), np.full(len(xy_px), -1)
    for rows in _clusters(xy_px, diameter_px):
        seen = _seen(xy_px[rows], _any)
        if seen is None:
            continue
        H, pattern = seen
        found = _nearest(H, xy_px[rows], diameter_px[rows], pattern)
        mine = rows[found >= 0]
        tag[mine], point[mine] = pattern.first_tag, found[found >= 0]
    return tag, point


def _clusters(xy_px: np.ndarray, diameter_px: np.ndarray) -> list[np.ndarray]:
    """Rows of dots that hang together, largest first."""
    if len(xy_px) < FEWEST:
        return []
    pairs = cKDTree(xy_px).query_pairs(LINKED * float(diameter_px.max()), output_type="ndarray")
    far = np.linalg.norm(xy_px[pairs[:, 0]] - xy_px[pairs[:, 1]], axis=1)
    pairs = pairs[far < LINKED * diameter_px[pairs].max(axis=1)]
    links = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(len(xy_px),) * 2)
    count, label = connected_components(links, directed=False)
    clusters = [np.flatnonzero(label == k) for k in range(count)]
    return sorted((rows for rows in clusters if len(rows) >= FEWEST), key=len, reverse=True)


def _seen(xy_px: np.ndarray, told: Told) -> tuple[np.ndarray, BoardPattern] | None:
    """(3, 3) from a tag's mm to px, and the tag; None where these dots show none."""
    for circle in _outer(xy_px):
        seen = _read(circle, xy_px, told)
        if seen is not None:
            return seen
    return None


def _read(circle: np.ndarray, xy_px: np.ndarray, told: Told) -> tuple[np.ndarray, BoardPattern] | None:
    """The same, by the outer circle from which an affine map (3, 3) comes."""
    upright = _upright(circle, xy_px)
    u = cv2.perspectiveTransform(xy_px[None], np.linalg.inv(upright))[0] * [1, -1]
    radius = np.linalg.norm(u, axis=1)
    on = np.abs(radius[:, None] - RADII).argmin(axis=1)
    good = np.abs(radius - RADII[on]) < ON_CIRCLE
    if good.sum() < FEWEST:
        return None
    turned = np.arctan2(u[:, 1], u[:, 0]) * SECTORS / (2 * np.pi)
    phase = np.angle(np.exp(2j * np.pi * turned[good]).mean()) / (2 * np.pi)
    sector = np.rint(turned - phase).astype(int) % SECTORS
    shown = np.zeros((SECTORS, len(RADII)), int)
    shown[sector[good], on[good]] = 1
    tag = told(symbols_of(shown))
    if tag is None:
        return None
    pattern, first = tag
    at, circles = places_of_rune(pattern.first_tag)
    point = {(s, c): k for k, (s, c) in enumerate(zip(at.tolist(), circles.tolist(), strict=True))}
    named = np.array(
        [point.get(((s - first) % SECTORS, c), -1) for s, c in zip(sector.tolist(), on.tolist(), strict=True)]
    )
    mine = np.flatnonzero(good & (named >= 0))
    H, _ = cv2.findHomography(pattern.points_mm[named[mine]], xy_px[mine], cv2.RANSAC, 2.0)
    return None if H is None else (H, pattern)


def _expected(symbols: np.ndarray, pattern: BoardPattern) -> tuple[BoardPattern, int] | None:
    """The tag that is expected; None where the word is another one."""
    turns = (np.arange(SECTORS)[:, None] + np.arange(SECTORS)) % SECTORS
    read, word = symbols[turns], word_of_rune(pattern.first_tag)
    cost = (read < 0).sum(axis=1) + 2 * ((read >= 0) & (read != word)).sum(axis=1)
    best = int(cost.argmin())
    return (pattern, best) if cost[best] < APART else None


def _any(symbols: np.ndarray) -> tuple[BoardPattern, int] | None:
    """Whichever tag of the reference's table the symbols show."""
    seen = int((symbols >= 0).sum())
    number, first, alike = nearest_rune(symbols)
    far = SECTORS - seen + 2 * (seen - alike)
    if far >= APART or chance_of_rune(seen, alike) > CHANCE:
        return None
    return replace(ANY, first_tag=number), first


def _outer(xy_px: np.ndarray) -> list[np.ndarray]:
    """(3, 3) affine maps from the unit circle to ellipses on which the outermost dots may lie, likeliest first."""
    rng, found = generator(0, "rune_dots"), []
    for hull, draws, outside in zip(_hulls(xy_px), DRAWS, OUTSIDE, strict=False):
        if len(hull) < 6:
            break
        tried = []
        for _ in range(draws):
            circle = _ellipse(hull[rng.choice(len(hull), 5, replace=False)])
            if circle is None:
                continue
            rho = _radii(circle, xy_px)
            on = np.abs(rho - 1) < ON_CIRCLE
            if on.sum() >= 6:
                tried.append((float(outside * (rho > 1 + ON_CIRCLE).sum() - on.sum()), on))
        kept: list[np.ndarray] = []
        for _, on in sorted(tried, key=lambda one: one[0]):
            if len(kept) < CANDIDATES and all((on & other).sum() < ALIKE * on.sum() for other in kept):
                kept.append(on)
        circles = [_ellipse(xy_px[on]) for on in kept]
        found += [circle for circle in circles if circle is not None]
    return found


def _hulls(xy_px: np.ndarray) -> list[np.ndarray]:
    """(m, 2) the dots on the hull of all; those and the ones on the hull of the others."""
    left, found = xy_px, xy_px[:0]
    sets = []
    for _ in DRAWS:
        try:
            hull = ConvexHull(left).vertices
        except (QhullError, ValueError):
            break
        found = np.concatenate([found, left[hull]])
        left = np.delete(left, hull, axis=0)
        sets.append(found)
    return sets


def _ellipse(xy_px: np.ndarray) -> np.ndarray | None:
    (x, y), (a, b), angle = cv2.fitEllipseDirect(xy_px.astype(np.float32))
    if not (np.isfinite([x, y, a, b]).all() and a > 0 and 0 < b < 6 * a and a < 6 * b):
        return None
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([[a / 2 * c, -b / 2 * s, x], [a / 2 * s, b / 2 * c, y], [0, 0, 1]])


def _radii(H: np.ndarray, xy_px: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(cv2.perspectiveTransform(xy_px[None], np.linalg.inv(H))[0], axis=1))


def _tilted(w: np.ndarray) -> np.ndarray:
    """(..., 3, 3) maps of the unit disc to itself that move its centre to w (..., 2), |w| < 1."""
    square = (w**2).sum(axis=-1)[..., None, None]
    grown = 1 / np.sqrt(1 - square)
    inner = np.eye(2) + w[..., :, None] * w[..., None, :] * grown**2 / (1 + grown)
    return np.block([[inner, grown * w[..., :, None]], [grown * w[..., None, :], grown]])


def _upright(circle: np.ndarray, xy_px: np.ndarray) -> np.ndarray:
    """The map of the same outer ellipse under which dots lie on the three circles."""
    u = cv2.perspectiveTransform(xy_px[None], np.linalg.inv(circle))[0]
    u = np.column_stack([u, np.ones(len(u))])
    w = np.zeros(2)
    for steps in TILTS:
        tried = w + np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        back = u @ np.swapaxes(_tilted(-tried), 1, 2)
        radius = np.linalg.norm(back[..., :2], axis=-1) / back[..., 2]
        miss = np.abs(radius[..., None] - RADII).min(axis=-1).clip(max=2 * ON_CIRCLE)
        w = tried[(miss**2).sum(axis=1).argmin()]
    return np.asarray(circle @ _tilted(w))


def _nearest(H: np.ndarray, xy_px: np.ndarray, diameter_px: np.ndarray, pattern: BoardPattern) -> np.ndarray:
    """(n,) point of each dot, from where all of the tag's must be."""
    there = cv2.perspectiveTransform(pattern.points_mm[None], H)[0]
    far, point = cKDTree(there).query(xy_px)
    size = np.sqrt(np.abs(np.linalg.det(H) / (H[2, :2] @ pattern.points_mm.T + H[2, 2]) ** 3)) * pattern.diameters_mm
    alike = np.abs(np.log(diameter_px / size[point])) < np.log(SIZES)
    near = alike & (far < NEAR * diameter_px)
    number = np.where(near, point, -1)
    for k in np.unique(number[number >= 0]):
        rows = np.flatnonzero(number == k)
        number[np.delete(rows, far[rows].argmin())] = -1
    return number
