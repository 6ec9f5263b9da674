"""What no lens model follows: a smooth field of displacements over the image, found from the residuals.

The field is a Gaussian process of the pixel, the same in all images, each axis with Matern's covariance of order 5/2,
standard deviation s and length l. These and the variance factor of what is white are those of the largest restricted
likelihood (Patterson and Thompson 1971): restricted, because residuals are what an adjustment has left of the field.
Where the likelihood does not rise significantly above that of white residuals alone there is no field, and nothing
changes. Otherwise the field's amounts become unknowns of the bundle, with the process as their prior, so that the field
is corrected and what is left of it is in every covariance.

The field has no shift, no change of scale of an axis and no turn (the first Chebyshev coefficients, as those of a
scene's `residual_field`): principal point, focal lengths and stations stand for them.

With N the normal matrix of the adjustment and Phi the whitened field functions, S = Phi' Q Phi and t = Phi' Q y, where
Q takes away what all other unknowns explain, are the Schur complement of N extended by Phi. With L L' the prior
covariance of the functions' amounts for s = 1, and a = s^2 / sigma^2, minus twice the log likelihood is

    f log sigma^2 + log |I + a L' S L|,   sigma^2 = (chi^2 - a t' L (I + a L' S L)^-1 L' t) / f.

Residuals that are alike within a mark or an image, and differ between them, are neither white nor a field of the lens.
Where images contradict each other on the field by a factor F (`between_images.py`), observations tell 1 / F as much of
it: the first term, the only one that they make rise, counts 1 / F (quasi-likelihood, McCullagh 1983), and a is
s^2 / (F sigma^2).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.optimize import minimize_scalar

from testfield.adjust.bundle import chi2_of, undamped
from testfield.adjust.datum import open_motions
from testfield.adjust.factor import Factor
from testfield.adjust.groups import Structure
from testfield.adjust.linear import linearise, whitening_of
from testfield.adjust.network import Camera, Layout, Network
from testfield.adjust.normal import NormalEquations
from testfield.camera.interior import MODE, Interior
from testfield.camera.smooth_field import mean_squares

DEGREE = 12
"""Chebyshev products of lower total degree than this carry the field: enough for the shortest length."""
LENGTHS = (0.12, 0.24, 0.48, 0.96)
"""Lengths that are tried, as parts of the image's diagonal."""
SIGNIFICANT = 10.0
"""Least rise of twice the log likelihood; by chance, without a field, it is reached in 1 case of 1,000."""
ROUNDING = 1e-12
"""Chi-squared a degree of freedom of residuals that are roundings, a millionth of what is claimed; it may come out
negative."""
UNSEEN = 1e-3
"""A field of a smaller part of what a typical observation claims is none: rounding has patterns too."""
NEGLIGIBLE = 3e-4
"""A mode of the field with a smaller part of its standard deviation is left out."""
LEAST_FREEDOM = 60
"""Degrees of freedom from which the residuals of an adjustment are asked."""
STEPS = 4
GRID = 24
"""Places a side on which the process is written in Chebyshev products."""


@dataclass(frozen=True)
class LensMisfit:
    """A field that residuals show: standard deviation `s_px` in each axis, `length_px`, `variance` of what is white
    beside it, in units of what observations claim, and the `rise` of twice the log likelihood. `modes_px`
    (q, 2, d, d): fields whose amounts have standard deviations of the root of `between`, the factor by which images
    contradict each other: known to 0 +- 1 beside observations that err as they scatter, they are weighted as if these
    erred so much more."""

    s_px: float
    length_px: float
    variance: float
    rise: float
    modes_px: np.ndarray
    between: float = 1.0

    @property
    def rms_px(self) -> float:
        """The displacement that is expected, root mean square over the image, without its lowest modes."""
        return float(np.sqrt(self.between * mean_squares(self.modes_px).sum()))

    @property
    def note(self) -> str:
        """What a reader is told."""
        return (
            f"the lens model does not follow the images: a smooth field of {self.rms_px:.2g} px, alike over about "
            f"{self.length_px:.0f} px, is found from the residuals and corrected; what is left of it is in all "
            "uncertainties"
        )

    @property
    def card(self) -> dict:
        """The figures under their stable keys."""
        return {
            "s_px": self.s_px,
            "rms_px": self.rms_px,
            "length_px": self.length_px,
            "variance": self.variance,
            "rise": self.rise,
            "modes": len(self.modes_px),
        } | ({"field_between": self.between} if self.between > 1 else {})


def lens_misfit(network: Network, labels: list[str], freedom: int, between: float = 1.0) -> LensMisfit | None:
    """The field that the residuals show which the lens model alone leaves; None where they show none.

    `network` adjusted, with a field or without, `labels` of its unknowns, `freedom` of the adjustment without a field.
    Several cameras, whose fields would differ, and small networks are not asked. `between`: by which factor images
    contradict each other on the field.
    """
    if len(network.cameras) != 1 or freedom < LEAST_FREEDOM:
        return None
    seen = _seen(without_lens_misfit(network), labels)
    if seen.chi2 < ROUNDING * freedom:
        return None
    size = (network.interior.width_px, network.interior.height_px)
    found = [(*_most_likely(seen, prior_root(*size, part), freedom, between), part) for part in LENGTHS]
    rise, ratio, variance, part = max(found)
    s = float(np.sqrt(ratio * between * variance))
    claimed = float(np.sqrt(np.median(np.trace(network.cov_px2, axis1=1, axis2=2)) / 2))
    if rise < SIGNIFICANT or s < UNSEEN * claimed:
        return None
    modes = s / np.sqrt(between) * np.tensordot(prior_root(*size, part).T, _functions(), 1)
    return LensMisfit(s, part * float(np.hypot(*size)), variance, rise, modes, between)


def with_lens_misfit(network: Network, misfit: LensMisfit, name: Callable[[Network], list[str]]) -> Network:
    """An adjusted network with the field's amounts among its camera's unknowns, known to be 0 +- 1, at its new minimum
    but for second-order terms; `name` gives the names of a network's unknowns."""
    wide = _with_modes(network, misfit.modes_px, 1.0)
    return undamped(wide, name(wide), STEPS)


def without_lens_misfit(network: Network) -> Network:
    """The network with the lens models alone."""
    cameras = []
    for camera in network.cameras:
        interior = camera.interior.without_modes
        p = len(interior.parameters)
        cameras.append(Camera(interior, camera.u[:p], camera.known[:p], camera.u_aspect))
    return replace(network, cameras=tuple(cameras))


def _with_modes(network: Network, modes_px: np.ndarray, u: float) -> Network:
    camera, q = without_lens_misfit(network).cameras[0], len(modes_px)
    widened = Camera(
        camera.interior.with_modes(modes_px),
        np.concatenate([camera.u, np.full(q, u)]),
        np.concatenate([camera.known, np.zeros(q)]),
        camera.u_aspect,
    )
    return replace(network, cameras=(widened,))


@dataclass(frozen=True)
class _Seen:
    """What residuals tell of all Chebyshev products: S (q, q) and t (q,) of the module's docstring, and chi^2 at the
    minimum without them."""

    S: np.ndarray
    t: np.ndarray
    chi2: float


def _seen(network: Network, labels: list[str]) -> _Seen:
    functions = _functions()
    wide, q = _with_modes(network, functions, np.inf), len(functions)
    structure = Structure.of(wide)
    whitening = whitening_of(wide.cov_px2)
    equations = NormalEquations(wide, structure, linearise(wide, structure, whitening))
    normal, right, own_inverse = equations.reduced(0.0)
    end = int(Layout.of(wide).camera[1])
    own = np.arange(end - q, end)
    rest = np.delete(np.arange(len(normal)), own)
    across = normal[np.ix_(rest, own)]
    plain = [label for label in labels if not label.startswith(MODE)]
    factor = Factor(normal[np.ix_(rest, rest)], plain, open_motions(wide)[0][rest])
    solved = factor.solve(np.column_stack([across, right[rest]]))
    S = normal[np.ix_(own, own)] - across.T @ solved[:, :-1]
    # From the present values, which may be those with a field, to the minimum without.
    left = right[rest] @ solved[:, -1]
    left += np.einsum("ni,nij,nj->", equations.point_right, own_inverse, equations.point_right)
    return _Seen(0.5 * (S + S.T), right[own] - across.T @ solved[:, -1], chi2_of(network) - float(left))


def _most_likely(seen: _Seen, root: np.ndarray, freedom: int, between: float = 1.0) -> tuple[float, float, float]:
    """The rise of twice the log likelihood above no field, the ratio a and sigma^2 where it is largest."""
    values, vectors = np.linalg.eigh(root.T @ seen.S @ root)
    values = np.maximum(values, 0)
    squares = (vectors.T @ (root.T @ seen.t)) ** 2

    def variance(log_ratio: float) -> float:
        ratio = np.exp(log_ratio)
        left = seen.chi2 - float((ratio * squares / (1 + ratio * values)).sum())
        return max(left, 1e-12 * seen.chi2) / freedom

    def minus_rise(log_ratio: float) -> float:
        less = freedom * np.log(variance(log_ratio) * freedom / seen.chi2)
        return float(less / between + np.log1p(np.exp(log_ratio) * values).sum())

    first = -np.log(max(values.max(initial=0), 1e-300))
    tried = first + np.arange(-4.0, 20.0)
    best = tried[int(np.argmin([minus_rise(v) for v in tried]))]
    found = minimize_scalar(minus_rise, bounds=(best - 1, best + 1), method="bounded")
    return -float(found.fun), float(np.exp(found.x)), variance(found.x)


@cache
def _functions() -> np.ndarray:
    """(q, 2, d, d) all Chebyshev products below the total degree, those of x before those of y."""
    rows, columns = np.nonzero(np.add.outer(np.arange(DEGREE), np.arange(DEGREE)) < DEGREE)
    functions = np.zeros((2, len(rows), 2, DEGREE, DEGREE))
    for axis in (0, 1):
        functions[axis, np.arange(len(rows)), axis, rows, columns] = 1
    return functions.reshape(-1, 2, DEGREE, DEGREE)


def _no_field(size_px: np.ndarray) -> np.ndarray:
    """(q, 5) amounts, orthonormal, of what is no field: shifts in x and y, scales in x and y, a turn."""
    functions = _functions()

    def amounts(*parts: tuple[int, int, int, float]) -> np.ndarray:
        return np.sum([value * functions[:, axis, row, column] for axis, row, column, value in parts], axis=0)

    turn = (0, 1, 0, -size_px[1]), (1, 0, 1, size_px[0])
    each = [((0, 0, 0, 1.0),), ((1, 0, 0, 1.0),), ((0, 0, 1, 1.0),), ((1, 1, 0, 1.0),), turn]
    columns = np.column_stack([amounts(*parts) for parts in each])
    return columns / np.linalg.norm(columns, axis=0)


@cache
def prior_root(width_px: int, height_px: int, part: float) -> np.ndarray:
    """(q, r) root of the covariance of the functions' amounts, largest modes first, for a field of unit variance in
    each axis whose length is this part of the image's diagonal."""
    size = np.array([width_px, height_px])
    at = (np.arange(GRID) + 0.5) / GRID
    place = np.stack(np.meshgrid(at, at), -1).reshape(-1, 2) * size
    values = Interior(width_px, height_px, np.zeros(4)).with_modes(_functions()).by_modes(place - 0.5)
    one_axis = values[:, 0, : values.shape[2] // 2]
    fit = np.linalg.pinv(one_axis)
    distance = np.linalg.norm(place[:, None] - place, axis=2) / (part * np.hypot(*size))
    covariance = np.kron(np.eye(2), fit @ matern(distance) @ fit.T)
    no_field = _no_field(size)
    keep = np.eye(len(covariance)) - no_field @ no_field.T
    covariance = keep @ covariance @ keep.T
    # Modes by their size over the image.
    flat = values.reshape(-1, len(covariance))
    weight = np.linalg.cholesky(flat.T @ flat / len(place))
    spread, axes = np.linalg.eigh(weight.T @ covariance @ weight)
    large = np.flatnonzero(spread > NEGLIGIBLE**2)[::-1]
    return np.linalg.solve(weight.T, axes[:, large]) * np.sqrt(spread[large])


def matern(distance: np.ndarray) -> np.ndarray:
    """Matern's correlation of order 5/2 at distances in units of its length (Rasmussen and Williams 2006, eq. 4.17)."""
    d = np.sqrt(5) * distance
    return (1 + d + d**2 / 3) * np.exp(-d)
