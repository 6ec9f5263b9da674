"""The pixel equations of dots with their rings: a model's values and derivatives, gathered into normal equations."""

import numpy as np

from testfield.detect.disc import integrate
from testfield.detect.dot_equations import DOT, Equations, dot_pixel
from testfield.detect.normal_equations import CHUNK, add_products
from testfield.store.compiled import compiled

TURNS = 8
"""Entries of the homography's departure from the dot's affine map; the last one of nine is not free."""
BENT = DOT + 1 + TURNS
"""Where the light's curvature begins: contrast, then background that goes with x x, x y, y y, at the outer edge."""
TWISTED = BENT + 6
"""Where the cubic terms of the irradiance begin: x x x, x x y, x y y, y y y, at the outer edge."""
PARAMETERS = TWISTED + 4


def ring_equations(
    values: np.ndarray,
    use: np.ndarray,
    theta: np.ndarray,
    dot: tuple[np.ndarray, np.ndarray, np.ndarray],
    ring: tuple[np.ndarray, np.ndarray],
    start: np.ndarray,
    homography: np.ndarray,
    reach_px: np.ndarray,
    dark_dn: float,
    noise: tuple[float, float, float],
) -> Equations:
    """The equations of n dots with their rings; the first arguments as of `dot_equations`, but `theta` (n, 31).

    `dot` is the dots' outline as there; `ring` the points (n, k, 2) on the rings' outlines with their tangents times
    the nodes' weights. `homography` (n, 3, 3) leads from disc coordinates to px about the window's middle, as `start`
    did without departures; the light bends in units of `reach_px` (n,), and a pixel without light has `dark_dn`.
    """
    at, tangent, by_shape = dot
    model, normal, right = _rings(
        values,
        use,
        theta,
        np.ascontiguousarray(at),
        tangent * (2 * np.pi / at.shape[1]),
        np.ascontiguousarray(by_shape),
        np.ascontiguousarray(ring[0]),
        np.ascontiguousarray(ring[1]),
        start,
        homography,
        np.linalg.inv(homography),
        reach_px,
        dark_dn,
        np.array(noise),
    )
    return Equations(model, normal, right)


@compiled
def _rings(
    values: np.ndarray,
    use: np.ndarray,
    theta: np.ndarray,
    outline: np.ndarray,
    tangent: np.ndarray,
    by_shape: np.ndarray,
    ring: np.ndarray,
    ring_tangent: np.ndarray,
    start: np.ndarray,
    homography: np.ndarray,
    to_plane: np.ndarray,
    reach_px: np.ndarray,
    dark_dn: float,
    noise: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    n, side = values.shape[0], values.shape[1]
    half = side // 2
    model, normal, right = np.zeros((n, side, side)), np.zeros((n, PARAMETERS, PARAMETERS)), np.zeros((n, PARAMETERS))
    dot_seen, ring_seen, first = (
        np.empty((side, side, 7)),
        np.empty((side, side, 4)),
        np.array([-1.0 * half, -1.0 * half]),
    )
    shift = np.zeros((2, ring.shape[1], 2))
    shift[0, :, 0], shift[1, :, 1] = 1, 1
    jacobian, weight, residual = np.zeros((PARAMETERS, CHUNK)), np.zeros(CHUNK), np.zeros(CHUNK)
    for i in range(n):
        t, k, near, far, back = theta[i], 0, start[i], homography[i], to_plane[i]
        integrate(outline[i], tangent[i], by_shape[i], t[5], first, dot_seen)
        integrate(ring[i], ring_tangent[i], shift, t[5], first, ring_seen)
        for r in range(side):
            for c in range(side):
                if use[i, r, c]:
                    dx, dy = c - half - t[0], r - half - t[1]
                    value = dot_pixel(t, dx, dy, dot_seen, r, c, jacobian, k)
                    value += _light_and_ring(t, dx, dy, ring_seen, r, c, reach_px[i], dark_dn, jacobian, k)
                    lit = t[DOT] * (t[6] + t[8] * dx + t[9] * dy)
                    moved = lit * ring_seen[r, c, 2], lit * ring_seen[r, c, 3]
                    _by_turns(c - half, r - half, moved, near, far, back, jacobian, k)
                    model[i, r, c], residual[k] = value, values[i, r, c] - value
                    weight[k] = 1 / (noise[0] + max(noise[1] * (value - noise[2]), 0.0))
                    k += 1
                    if k == CHUNK:
                        add_products(jacobian, weight, residual, normal[i], right[i])
                        k = 0
        add_products(jacobian, weight, residual, normal[i], right[i])
    return model, normal, right


@compiled
def _light_and_ring(
    t: np.ndarray,
    dx: float,
    dy: float,
    seen: np.ndarray,
    r: int,
    c: int,
    reach_px: float,
    dark_dn: float,
    jacobian: np.ndarray,
    k: int,
) -> float:
    """What the ring and the light's curvature add to a pixel, from what is `seen` (h, w, 4) of the ring, and to its
    derivatives, in which those of the dot alone stand already."""
    ring, disc, share, spread = seen[r, c, 0], jacobian[6, k], t[DOT], t[5] * t[5] + 1 / 12
    lit_x, lit_y = dx * ring - spread * seen[r, c, 2], dy * ring - spread * seen[r, c, 3]
    # Far less of the light is bent than sloping: here the blur's width does not matter.
    u, v = dx / reach_px, dy / reach_px
    uu, uv, vv = u * u, u * v, v * v
    bend = t[BENT] * uu + t[BENT + 1] * uv + t[BENT + 2] * vv
    ground = t[BENT + 3] * uu + t[BENT + 4] * uv + t[BENT + 5] * vv
    twist = (t[TWISTED] * u + t[TWISTED + 1] * v) * uu + (t[TWISTED + 2] * u + t[TWISTED + 3] * v) * vv
    whole = (t[6] + bend) * ring + t[8] * lit_x + t[9] * lit_y
    covered = disc + share * ring
    light = t[6] * covered + t[7] - dark_dn
    jacobian[0, k] -= share * t[8] * ring
    jacobian[1, k] -= share * t[9] * ring
    jacobian[5, k] += share * (t[6] + t[8] * dx + t[9] * dy) * seen[r, c, 1]
    jacobian[6, k] = covered
    jacobian[8, k] += share * lit_x
    jacobian[9, k] += share * lit_y
    jacobian[DOT, k] = whole
    jacobian[BENT, k], jacobian[BENT + 1, k], jacobian[BENT + 2, k] = uu * covered, uv * covered, vv * covered
    jacobian[BENT + 3, k], jacobian[BENT + 4, k], jacobian[BENT + 5, k] = uu, uv, vv
    jacobian[TWISTED, k], jacobian[TWISTED + 1, k] = u * uu * light, v * uu * light
    jacobian[TWISTED + 2, k], jacobian[TWISTED + 3, k] = u * vv * light, v * vv * light
    return ground + bend * disc + share * whole + twist * light


@compiled
def _by_turns(
    x: float,
    y: float,
    moved: tuple[float, float],
    start: np.ndarray,
    homography: np.ndarray,
    to_plane: np.ndarray,
    jacobian: np.ndarray,
    k: int,
) -> None:
    """Derivatives by the homography's entries of a pixel at (x, y) that changes so much when the ring's image is
    `moved` along x and y: whatever moves an outline a little moves its blurred image likewise."""
    if moved[0] == 0 and moved[1] == 0:
        for j in range(TURNS):
            jacobian[DOT + 1 + j, k] = 0
        return
    third = to_plane[2, 0] * x + to_plane[2, 1] * y + to_plane[2, 2]
    u = (to_plane[0, 0] * x + to_plane[0, 1] * y + to_plane[0, 2]) / third
    v = (to_plane[1, 0] * x + to_plane[1, 1] * y + to_plane[1, 2]) / third
    depth = homography[2, 0] * u + homography[2, 1] * v + homography[2, 2]
    for i in range(3):
        by = moved[0] * (start[0, i] - x * start[2, i]) + moved[1] * (start[1, i] - y * start[2, i])
        by /= depth
        at = DOT + 1 + 3 * i
        jacobian[at, k], jacobian[at + 1, k] = by * u, by * v
        if i < 2:
            jacobian[at + 2, k] = by
