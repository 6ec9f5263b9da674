"""Grids of squares that do not touch: every dark quadrangle, put in the order of a grid by its middle."""

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from testfield.detect.circle_grid import UNPLACED, counted
from testfield.detect.tag_sides import straightened
from testfield.detect.touching_tags import DARKER, quadrangles
from testfield.targets.board_pattern import CORNERS_A_TAG, SIDES

LEAST_SIDE_PX = 5.0
"""Smaller squares have no straight part between their blurred corners."""
SAME = 0.6
"""Two quadrangles are one where their middles are nearer than this part of the larger one's side."""
FEWEST = 4
"""Squares that make a grid."""
LOOKED_AT, MISS = 4, 0.25
"""Of so many squares near where one has its neighbour one may be it; how far off it may be, in spacings."""
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Column and row of the neighbour beside each side, clockwise from the one ahead."""
BESIDE, BESIDE_PX = 0.08, 1.5
"""How far within and beyond a side black and white are looked at: parts of the side, and px at least."""
ALONG = np.linspace(0.15, 0.85, 16)
"""Where along a side that is."""
PARTS, ROUNDS = 4, 3
"""Sides are looked for within such a part of a square's side, and so often: what is dark against its neighbourhood ends
where the neighbourhood's size lets it."""


def read_lone_squares(
    image: np.ndarray, columns: int, rows: int, pitch_over_side: float
) -> tuple[np.ndarray, np.ndarray]:
    """Column and row (n, 2) of each square of a grid in an image (h, w) uint8, from its top left, and its corners
    (n, 4, 2) px, clockwise from the top left as the grid counts; none where there is no such grid."""
    quads = _squares(image, quadrangles(image, LEAST_SIDE_PX))
    place = _places(quads, pitch_over_side, columns, rows)
    on = place[:, 0] >= 0
    place, quads = place[on], quads[on]
    for _ in range(ROUNDS):
        quads = straightened(image, quads, PARTS)
    return place, _from_top_left(place, quads)


def _places(quads: np.ndarray, pitch_over_side: float, columns: int, rows: int) -> np.ndarray:
    """(n, 2) column and row of each quadrangle, -1 for those in no grid. Where a square's neighbours are follows from
    its own sides, so lenses that bend the grid do no harm."""
    n = len(quads)
    best = np.full((n, 2), -1)
    if n < FEWEST:
        return best
    middle = quads.mean(axis=1)
    next_to, its_side = _neighbours(middle, quads, pitch_over_side)
    tried = np.zeros(n, bool)
    for seed in range(n):
        if tried[seed]:
            continue
        place = _follow(seed, next_to, its_side)
        inside = place[:, 0] > UNPLACED
        tried |= inside
        found = counted(place, inside, middle, columns, rows)
        if (found[:, 0] >= 0).sum() > (best[:, 0] >= 0).sum():
            best = found
    return best


def _neighbours(middle: np.ndarray, quads: np.ndarray, pitch_over_side: float) -> tuple[np.ndarray, np.ndarray]:
    """(n, 4) which square lies beside each side of each, -1 for none, and beside which of its sides that one lies: from
    middle to middle it is as far as the spacings of both, told by their own sides, are on average."""
    n = len(quads)
    side = np.roll(quads, -1, axis=1) - quads
    ahead = pitch_over_side * (side - np.roll(side, 2, axis=1)) / 2  # of each square along x, down, back, up
    other = cKDTree(middle).query(middle[:, None] + ahead, k=min(LOOKED_AT, n))[1]
    step = (ahead[:, :, None, None] - ahead[other]) / 2
    off = np.linalg.norm((middle[other] - middle[:, None, None])[:, :, :, None] - step, axis=-1)
    off /= np.maximum(np.linalg.norm(step, axis=-1), 1e-9)
    off[other == np.arange(n)[:, None, None]] = np.inf
    best = off.reshape(n, len(STEPS), -1).argmin(axis=2)
    found = np.take_along_axis(other, best[..., None] // len(STEPS), axis=2)[..., 0]
    good = off.reshape(n, len(STEPS), -1).min(axis=2) < MISS
    return np.where(good, found, -1), np.where(good, best % len(STEPS), -1)


def _follow(seed: int, next_to: np.ndarray, its_side: np.ndarray) -> np.ndarray:
    """(n, 2) places in steps from the seed, `UNPLACED` for squares that were not reached; two are neighbours where each
    has the other beside one of its sides."""
    place = np.full((len(next_to), 2), UNPLACED)
    place[seed] = 0
    turned = {seed: 0}
    queue = [seed]
    taken = {(0, 0)}
    while queue:
        k = queue.pop(0)
        for d, other in enumerate(next_to[k]):
            back = its_side[k, d]
            way = (d + turned[k]) % len(STEPS)
            there = (int(place[k, 0]) + STEPS[way][0], int(place[k, 1]) + STEPS[way][1])
            if other < 0 or other in turned or next_to[other, back] != k or there in taken:
                continue
            turned[int(other)] = (way + 2 - int(back)) % len(STEPS)
            place[other] = there
            taken.add(there)
            queue.append(int(other))
    return place


def _areas(quads: np.ndarray) -> np.ndarray:
    x, y = np.moveaxis(quads, -1, 0)
    return np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1)) / 2


def _squares(image: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """Those whose four sides all part black within from white beyond, of several at a place the one that does so best:
    a narrow neighbourhood shows parts of a square."""
    edge = _least_step(image, quads)
    middle, side = quads.mean(axis=1), np.sqrt(_areas(quads))
    kept: list[int] = []
    for k in np.argsort(-edge, kind="stable"):
        if edge[k] < DARKER:
            break
        apart = np.linalg.norm(middle[kept] - middle[k], axis=1)
        if (apart > SAME * np.maximum(side[kept], side[k])).all():
            kept.append(int(k))
    return quads[kept]


def _least_step(image: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """(n,) by how much it is brighter beyond a side than within, of each quadrangle's worst side; of 255."""
    side = np.roll(quads, -1, axis=1) - quads
    length = np.linalg.norm(side, axis=2, keepdims=True)
    outwards = np.stack([side[..., 1], -side[..., 0]], axis=-1) / np.maximum(length, 1e-9)
    beside = np.maximum(BESIDE * length, BESIDE_PX) * outwards
    on = quads[:, :, None] + ALONG[:, None] * side[:, :, None]
    beyond, within = (
        map_coordinates(image, np.moveaxis(on + way * beside[:, :, None], -1, 0)[::-1], float, order=1, mode="nearest")
        for way in (1, -1)
    )
    return np.asarray((beyond - within).mean(axis=2).min(axis=1))


def _from_top_left(place: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """(n, 4, 2) corners, each square's turned so that they begin at the top left as the grid's columns and rows run
    past it: a lens may turn the squares at its border."""
    at = {tuple(where): k for k, where in enumerate(place.tolist())}
    middle = quads.mean(axis=1)
    turned = quads.copy()
    for (column, row), k in at.items():
        steps = []
        for along in ((1, 0), (0, 1)):
            ends = [at.get((column + way * along[0], row + way * along[1]), k) for way in (-1, 1)]
            steps.append(middle[ends[1]] - middle[ends[0]])
        sides = np.array(SIDES * [1, -1], float) @ np.array(steps)  # rows run down
        if not np.any(sides):
            continue
        fits = [float(((np.roll(quads[k], n, axis=0) - middle[k]) * sides).sum()) for n in range(CORNERS_A_TAG)]
        turned[k] = np.roll(quads[k], int(np.argmax(fits)), axis=0)
    return turned
