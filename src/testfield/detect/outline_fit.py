"""Blurred and unevenly lit ellipses fitted to blobs, and what their pixels then say of the outline: one blob after the
other in compiled functions.

Two things keep it short. A pixel that no edge reaches tells of the light alone, whose equations are in three numbers: 1
and its place; only those beside the outline have all of them. And an outline that is still moving is integrated in
`COARSE` steps: what counts is the last, fine one, in which the ellipse is free again, so that what coarse steps leave
of it is squared.
"""

import math

import numpy as np

from testfield.detect.centre import RING_BEGINS, RING_CLEARANCE_PX, WINDOW
from testfield.detect.disc import integrate
from testfield.detect.normal_equations import CHUNK, add_products, by_cholesky
from testfield.store.compiled import compiled

ELLIPSE = 12
"""Parameters of a blurred and unevenly lit ellipse: centre, three of its half-axes' matrix, blur, contrast, background,
and the gradients of the last two."""
FIRST_CORNERS, WAVES = 3, 4
"""The first of the outline's harmonics, and how many there are: each has a cosine and a sine."""
ASKED = ELLIPSE + 2 * WAVES + 1
"""The last parameter is the level of a disc in the middle, of `HOLE` radii."""
HOLE = 0.5
LEAST_POINTS = 48
"""Of an outline, however sharp and small it is: harmonics need them."""
FINE, FINELY_FELT = 1.5, 4.0
"""Distance of an outline's points, and how far they are felt, in units of the blur: pixels are right to 1e-4 of the
contrast, a hundredth of their noise."""
COARSE, COARSELY_FELT = 2.0, 3.5
"""The same while the outline moves: pixels are right to 4e-3 of the contrast."""
ROUNDS, NEAR_PX = 12, 0.03
"""Steps, and the step in px after which the outline lies still. Convergence is quadratic: of the next step a tenth of
that is left, and of the last, fine one a thousandth."""
FIRST_BLUR_PX, LEAST_BLUR_PX, MOST_BLUR_PX = 0.6, 0.25, 6.0
NOT_TOLD = 1e-9
"""Eigenvalues, as parts of the largest, of what is not told at all."""
CX, CY, AXX, AXY, AYY, BLUR, CONTRAST, BACKGROUND, CONTRAST_X, CONTRAST_Y, BACKGROUND_X, BACKGROUND_Y = range(12)


@compiled
def fit_outlines(
    image: np.ndarray, xy: np.ndarray, axes: np.ndarray, half: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of n bright blobs: `theta` (n, 12), relative to the whole pixels that they lie on, normal matrices (n, 21, 21)
    and right sides (n, 21) about it, and whether an ellipse was found (n,).

    `xy` (n, 2) are places in an image (h, w), `axes` (n, 2, 2) map the unit circle onto the outlines, windows reach
    `half` (n,) px, and `noise` (3,) is the line of a pixel's variance (`SensorSheet.noise_line`).
    """
    n = len(xy)
    theta, normal, right = np.zeros((n, ELLIPSE)), np.zeros((n, ASKED, ASKED)), np.zeros((n, ASKED))
    good = np.zeros(n, np.bool_)
    small, score = np.zeros((1, ELLIPSE, ELLIPSE)), np.zeros(ELLIPSE)
    for i in range(n):
        t = theta[i]
        place, values = _begin(image, xy[i], axes[i], half[i], t)
        good[i] = _sound(t, half[i])
        for _ in range(ROUNDS):
            if not good[i]:
                break
            small[:], score[:] = 0, 0
            _equations(place, values, half[i], t, noise, False, small[0], score)
            step = _inverse(small) @ score
            longest = np.abs(step[: BLUR + 1]).max()
            before = t[BLUR]
            t += min(1.0, 0.5 / max(longest, 1e-12)) * step
            t[BLUR] = min(max(t[BLUR], LEAST_BLUR_PX), MOST_BLUR_PX)
            good[i] = _sound(t, half[i])
            # A blur that has come to its end moves no more, whatever its step.
            if max(np.abs(step[:BLUR]).max(), abs(t[BLUR] - before)) < NEAR_PX:
                break
        if good[i]:
            _equations(place, values, half[i], t, noise, True, normal[i], right[i])
    return theta, normal, right, good


@compiled
def _begin(
    image: np.ndarray, xy: np.ndarray, axes: np.ndarray, half: int, t: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places (k, 2) and values (k,) of the pixels that no ring can reach; and the parameters to begin with."""
    x0, y0 = int(np.rint(xy[0])), int(np.rint(xy[1]))
    side = 2 * half + 1
    place, values = np.empty((side * side, 2), np.int64), np.empty(side * side)
    t[CX], t[CY], t[BLUR] = xy[0] - x0, xy[1] - y0, FIRST_BLUR_PX
    t[AXX], t[AXY], t[AYY] = axes[0, 0], axes[0, 1], axes[1, 1]
    free = axes[0, 0] * axes[1, 1] - axes[0, 1] * axes[1, 0]
    k, inner, outer, within, around = 0, 0.0, 0.0, 0, 0
    for r in range(max(-half, -y0), min(half, len(image) - 1 - y0) + 1):
        for c in range(max(-half, -x0), min(half, image.shape[1] - 1 - x0) + 1):
            dx, dy = c - t[CX], r - t[CY]
            u, v = (axes[1, 1] * dx - axes[0, 1] * dy) / free, (axes[0, 0] * dy - axes[1, 0] * dx) / free
            q = math.sqrt(u * u + v * v)
            px_per_q = math.sqrt(dx * dx + dy * dy) / max(q, 1e-9)
            if q <= WINDOW and (q <= 1.1 or (RING_BEGINS - q) * px_per_q >= RING_CLEARANCE_PX):
                value = float(image[y0 + r, x0 + c])
                place[k, 0], place[k, 1], values[k] = c, r, value
                k += 1
                if q < 0.6:
                    inner += value
                    within += 1
                elif q > 1.2:
                    outer += value
                    around += 1
    t[BACKGROUND] = outer / max(around, 1)
    t[CONTRAST] = inner / max(within, 1) - t[BACKGROUND]
    return place[:k], values[:k]


@compiled
def _sound(t: np.ndarray, half: int) -> bool:
    """Whether parameters are those of an ellipse in its window."""
    side = 2 * half + 1
    mean = (t[AXX] + t[AYY]) / 2
    apart = math.sqrt(((t[AXX] - t[AYY]) / 2) ** 2 + t[AXY] ** 2)
    return bool(
        np.isfinite(t).all()
        and mean - apart > 0.2
        and mean + apart < side
        and max(abs(t[CX]), abs(t[CY])) < side / 2
        and t[CONTRAST] > 0
    )


@compiled
def _outline(t: np.ndarray, points: int, harmonics: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (k, 2) on the outline, their tangents times the step between them, and derivatives (s, k, 2) by centre,
    half-axes and, where asked, by cosine and sine of each harmonic, in parts of the radius."""
    at, tangent = np.empty((points, 2)), np.empty((points, 2))
    by = np.zeros((5 + (2 * WAVES if harmonics else 0), points, 2))
    step = 2 * math.pi / points
    for k in range(points):
        c, s = math.cos(step * k), math.sin(step * k)
        x, y = t[AXX] * c + t[AXY] * s, t[AXY] * c + t[AYY] * s
        at[k, 0], at[k, 1] = t[CX] + x, t[CY] + y
        tangent[k, 0], tangent[k, 1] = (t[AXY] * c - t[AXX] * s) * step, (t[AYY] * c - t[AXY] * s) * step
        by[0, k, 0] = by[1, k, 1] = 1.0
        by[2, k, 0] = by[3, k, 1] = c
        by[3, k, 0] = by[4, k, 1] = s
        if harmonics:
            a, b = c * c - s * s, 2 * s * c
            for w in range(WAVES):  # of one corner more by the sum of angles
                a, b = a * c - b * s, b * c + a * s
                by[5 + 2 * w, k, 0], by[5 + 2 * w, k, 1] = a * x, a * y
                by[6 + 2 * w, k, 0], by[6 + 2 * w, k, 1] = b * x, b * y
    return at, tangent, by


@compiled
def _largest(t: np.ndarray) -> float:
    """The larger half-axis."""
    return float((t[AXX] + t[AYY]) / 2 + math.sqrt(((t[AXX] - t[AYY]) / 2) ** 2 + t[AXY] ** 2))


@compiled
def _points(t: np.ndarray, spacing: float, least: int) -> int:
    """How many points the outline needs: an even number."""
    return 2 * math.ceil(max(math.pi * _largest(t) / (spacing * t[BLUR]), least / 2))


@compiled
def _equations(
    place: np.ndarray,
    values: np.ndarray,
    half: int,
    t: np.ndarray,
    noise: np.ndarray,
    harmonics: bool,
    normal: np.ndarray,
    right: np.ndarray,
) -> None:
    """Into a normal matrix (p, p) and right side (p,): the pixels weighted at the model's own value."""
    p, felt = len(right), FINELY_FELT if harmonics else COARSELY_FELT
    points = _points(t, FINE if harmonics else COARSE, LEAST_POINTS if harmonics else LEAST_POINTS // 2)
    at, tangent, by = _outline(t, points, harmonics)
    # Beyond this none of the outline is felt.
    reach = min(half, math.ceil(_largest(t) + max(abs(t[CX]), abs(t[CY])) + felt * t[BLUR] + 0.5))
    side, first = 2 * reach + 1, np.array([-float(reach), -float(reach)])
    seen, within = np.empty((side, side, 2 + len(by))), np.zeros((side, side, 2))
    integrate(at, tangent, by, t[BLUR], first, seen, felt)
    if harmonics:
        inner = np.empty((points // 2, 2))  # an outline of half the size has half the points
        for k in range(points // 2):
            inner[k, 0], inner[k, 1] = t[CX] + HOLE * (at[2 * k, 0] - t[CX]), t[CY] + HOLE * (at[2 * k, 1] - t[CY])
        integrate(inner, 2 * HOLE * tangent[::2], by[:0], t[BLUR], first, within, felt)
    jacobian, weight, residual = np.zeros((p, CHUNK)), np.zeros(CHUNK), np.zeros(CHUNK)
    # Pixels on the ground and within the dot, which no edge reaches: sums of `PRODUCTS`.
    flat = np.zeros((2, len(PRODUCTS)))
    ground = np.zeros(2 + len(by))
    k = 0
    for pixel in range(len(values)):
        c, r = place[pixel, 0], place[pixel, 1]
        dx, dy = c - t[CX], r - t[CY]
        beside = max(abs(c), abs(r)) <= reach
        here = seen[r + reach, c + reach] if beside else ground
        disc, hole = here[0], within[r + reach, c + reach, 0] if beside else 0.0
        lit = t[CONTRAST] + t[CONTRAST_X] * dx + t[CONTRAST_Y] * dy
        value = t[BACKGROUND] + t[BACKGROUND_X] * dx + t[BACKGROUND_Y] * dy + lit * disc
        off = values[pixel] - value
        share = 1 / (noise[0] + max(noise[1] * (value - noise[2]), 0.0))
        if here[1] == 0 and here[2] == 0 and here[3] == 0:
            _add_products(flat[1 if disc > 0.5 else 0], share, dx, dy, hole, off)
            continue
        jacobian[0, k] = lit * here[2] - t[CONTRAST_X] * disc - t[BACKGROUND_X]
        jacobian[1, k] = lit * here[3] - t[CONTRAST_Y] * disc - t[BACKGROUND_Y]
        for j in range(2, 5):
            jacobian[j, k] = lit * here[2 + j]
        jacobian[5, k] = lit * here[1]
        jacobian[6, k], jacobian[7, k] = disc, 1.0
        jacobian[8, k], jacobian[9, k] = disc * dx, disc * dy
        jacobian[10, k], jacobian[11, k] = dx, dy
        for j in range(5, len(by)):
            jacobian[ELLIPSE - 5 + j, k] = lit * here[2 + j]
        if harmonics:
            jacobian[p - 1, k] = hole
        residual[k], weight[k] = off, share
        k += 1
        if k == CHUNK:
            add_products(jacobian, weight, residual, normal, right)
            k = 0
    add_products(jacobian, weight, residual, normal, right)
    for inside in range(2):
        _add_flat(flat[inside], float(inside), t, normal, right)


PRODUCTS = np.array(
    [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2], [0, 4], [1, 4], [2, 4], [0, 3], [1, 3], [2, 3], [3, 3], [3, 4]]
)
"""Of 1, x, y, the hole and what is off: which are multiplied by which; the last ones only where there is a hole."""


@compiled
def _add_products(to: np.ndarray, share: float, x: float, y: float, hole: float, off: float) -> None:
    to[0] += share
    to[1] += share * x
    to[2] += share * y
    to[3] += share * x * x
    to[4] += share * x * y
    to[5] += share * y * y
    to[6] += share * off
    to[7] += share * x * off
    to[8] += share * y * off
    if hole != 0:
        to[9] += share * hole
        to[10] += share * hole * x
        to[11] += share * hole * y
        to[12] += share * hole * hole
        to[13] += share * hole * off


@compiled
def _add_flat(sums: np.ndarray, disc: float, t: np.ndarray, normal: np.ndarray, right: np.ndarray) -> None:
    """Add pixels that no edge reaches: all of their derivatives are sums of 1, x, y and the hole's level."""
    p, part = len(right), np.zeros((4, 5))
    for k in range(len(PRODUCTS)):
        a, b = PRODUCTS[k]
        part[a, b] = sums[k]
        if b < 4:
            part[b, a] = sums[k]
    turn = np.zeros((p, 4))
    turn[0, 0], turn[1, 0] = -t[CONTRAST_X] * disc - t[BACKGROUND_X], -t[CONTRAST_Y] * disc - t[BACKGROUND_Y]
    turn[6, 0], turn[7, 0] = disc, 1.0
    turn[8, 1] = turn[9, 2] = disc
    turn[10, 1] = turn[11, 2] = 1.0
    if p > ELLIPSE:
        turn[p - 1, 3] = 1.0
    normal += turn @ np.ascontiguousarray(part[:, :4]) @ turn.T
    right += turn @ np.ascontiguousarray(part[:, 4])


@compiled
def _inverse(normal: np.ndarray) -> np.ndarray:
    """Inverse of a normal matrix (1, p, p), whatever its parameters' units; what the pixels do not tell stays as it
    is."""
    found, whole = by_cholesky(normal)
    if whole[0]:
        return found[0]
    p = normal.shape[1]
    unit, scale = np.empty((p, p)), np.empty(p)
    for a in range(p):
        scale[a] = 1 / math.sqrt(max(normal[0, a, a], 1e-300))
    for a in range(p):
        for b in range(p):
            entry = normal[0, a, b] * scale[a] * scale[b]
            unit[a, b] = entry if np.isfinite(entry) else 0.0
    size, vector = np.linalg.eigh(unit)
    least = NOT_TOLD * np.abs(size).max()
    for a in range(p):
        size[a] = 1 / size[a] if abs(size[a]) > least else 0.0
    for a in range(p):
        for b in range(p):
            unit[a, b] = scale[a] * scale[b] * (vector[a] * size * vector[b]).sum()
    return unit
