"""The image of a plane through a lens nobody has calibrated yet: a homography, radial terms, and what is local.

The radial terms are those of the division model (Fitzgibbon, CVPR 2001): a pixel at distance r from the image's middle
lies on the ray (x, y, 1 + a r^2 + b r^4 + c r^6). One term follows any lens from strong pincushion to a fisheye of more
than 180 degrees to a few hundredths of the image, three to a few thousandths; what they leave (a principal point
aside, a bent board) is smooth, and so alike for neighbours. A mark that neither explains to a part of the distance to
its neighbours is another mark.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from testfield.camera.rough_lens import RoughLens
from testfield.store.remembered import remembered

MISPLACED = 0.3
"""Part of the distance to the nearest mark by which a mark may miss its place: an exchanged number is off by all of it,
distortion beyond the radial terms by less, whatever the number of pixels."""
NEIGHBOURS = 16
"""Marks around one that say what the model leaves there: by a polynomial of the highest degree, up to the second, that
their number and places determine."""
STEADY = 0.25
"""Least singular value of a polynomial's terms, the neighbours' coordinates scaled to one, with which it is asked."""
SAMPLES, FOLLOWED, ROUNDS = 48, 2, 3
"""Homographies of four marks that are tried, how many of the best are refined, and how often."""
LEAST = 5
TRIED = (-4.0, -3.0, -2.2, -1.6, -1.2, -0.9, -0.65, -0.45, -0.3, -0.2, -0.1, -0.05, 0.0, 0.05, 0.1, 0.2)
"""First radial terms that are tried, in units of the squared radius of the outermost observation."""
HALVED = 0.5
"""Radial terms are used where they lower the residuals to this part, and so are no fit to noise."""
MOST_VIEWS = 4


@dataclass(frozen=True)
class PlaneImage:
    """Where a plane is seen: `homography` (3, 3) to the pixels of a lens without distortion, and the `lens`."""

    homography: np.ndarray
    lens: RoughLens

    def at(self, plane_mm: np.ndarray) -> np.ndarray:
        """Pixels (n, 2) of points (n, 2) of the plane, NaN where there are none."""
        x, y, z = (np.column_stack([plane_mm, np.ones(len(plane_mm))]) @ self.homography.T).T
        (cx, cy), unit = self.lens.middle_px, self.lens.radius_px
        return self.lens.pixels(np.stack([(x - cx * z) / unit, (y - cy * z) / unit, z], axis=-1))

    def enlarged(self, plane_mm: np.ndarray) -> np.ndarray:
        """(n,) px a mm at points (n, 2): the square root of the areas' ratio."""
        return np.sqrt(np.abs(np.linalg.det(self.maps(plane_mm))))

    def maps(self, plane_mm: np.ndarray) -> np.ndarray:
        """(n, 2, 2) px/mm: the linear maps around points (n, 2)."""
        step = 1e-4 * max(float(np.ptp(plane_mm, axis=0).max()), 1.0)
        columns = [(self.at(plane_mm + step * e) - self.at(plane_mm - step * e)) / (2 * step) for e in np.eye(2)]
        return np.stack(columns, axis=-1)

    @property
    def mirrored(self) -> bool:
        """Whether the plane (x right, y up) shows its back in the image (y down)."""
        return bool(np.linalg.det(self.homography) > 0)


View = tuple[np.ndarray, np.ndarray]
"""Points (n, 2) of a plane in mm and the pixels (n, 2) where they were seen."""


def rough_lens(views: list[View], middle_px: np.ndarray) -> RoughLens:
    """The radial terms of the lens that took all `views`; none where they explain the views hardly better.

    The views that reach farthest out are asked; points that no lens explains count no more than `MISPLACED`.
    """
    far = [float(np.linalg.norm(image - middle_px, axis=1).max()) for _, image in views]
    pinhole = RoughLens.pinhole(middle_px, max(far, default=0.0))
    chosen = [views[k] for k in np.argsort(far)[::-1][:MOST_VIEWS]]
    lenses = [replace(pinhole, terms=np.array([first, 0.0, 0.0])) for first in TRIED]
    tried = [[_fitted(view, lens)[1] for view in chosen] for lens in lenses]
    k = int(np.argmin([sum(_cost(ratio) for ratio in ratios) for ratios in tried]))
    agreed = [view for view, ratio in zip(chosen, tried[k], strict=True) if (ratio < 1).sum() > LEAST]
    masks = [ratio < 1 for ratio in tried[k] if (ratio < 1).sum() > LEAST]
    if not agreed:
        return pinhole
    at_zero = sum(_cost(ratio[ratio_k < 1]) for ratio, ratio_k in zip(tried[TRIED.index(0.0)], tried[k], strict=True))
    lens = lenses[k]
    for _ in range(2):  # with the terms, more marks agree
        lens = _refined(lens, [(plane[good], image[good]) for (plane, image), good in zip(agreed, masks, strict=True)])
        ratios = [_fitted(view, lens)[1] for view in agreed]
        masks = [ratio < 1 for ratio in ratios]
    least = sum(_cost(ratio[good]) for ratio, good in zip(ratios, masks, strict=True))
    return lens if least < HALVED**2 * at_zero else pinhole


@remembered
def _refined(lens: RoughLens, views: list[View]) -> RoughLens:
    """The lens with all its terms fitted to views of which every point is believed."""
    views = [view for view in views if len(view[0]) >= LEAST]
    nearest = [_nearest(plane) for plane, _ in views]

    def misses(terms: np.ndarray) -> np.ndarray:
        parts = []
        for (plane, image), near in zip(views, nearest, strict=True):
            model = _least_squares(plane, image, replace(lens, terms=terms))
            ratio = _off(model, plane, image, near)
            parts.append(np.minimum(ratio, 3.0))
        return np.concatenate(parts)

    if not views:
        return lens
    found = least_squares(misses, lens.terms, loss="soft_l1", f_scale=0.3, x_scale=0.1, max_nfev=15)
    better = (found.fun**2).sum() < (misses(lens.terms) ** 2).sum()
    return replace(lens, terms=found.x) if better else lens


@remembered
def fit_plane(view: View, lens: RoughLens) -> tuple[PlaneImage | None, np.ndarray]:
    """The image of a plane, and which of its points (n,) are where the others say. None, and no point, where the points
    lie on a line or most of them contradict each other."""
    plane, image = view
    nothing = np.zeros(len(plane), bool)
    if len(plane) < LEAST:
        return None, nothing
    model, ratio = _fitted(view, lens)
    if model is None:
        return None, nothing
    good = _grown(model, plane, image, ratio < 1)
    if 2 * good.sum() < len(good):
        return None, nothing
    return _least_squares(plane[good], image[good], lens), good


def as_others_say(view: View, size_px: tuple[int, int]) -> np.ndarray:
    """(n,) which points of one view in an image of `size_px` (width, height) are where the others say, whatever the
    lens."""
    return fit_plane(view, rough_lens([view], (np.array(size_px) - 1) / 2))[1]


def fitted_to(view: View, lens: RoughLens) -> PlaneImage | None:
    """The image of a plane by all points of a view, which must be right; None where they lie on a line."""
    return _least_squares(*view, lens)


@remembered
def _fitted(view: View, lens: RoughLens) -> tuple[PlaneImage | None, np.ndarray]:
    """The model that most points agree with, and (n,) how far each is from its place, in units of what is allowed."""
    plane, image = view
    near = _nearest(plane)
    best = _least_squares(plane, image, lens)
    ratio = _off(best, plane, image, near)
    if best is not None and (ratio < 1).all():
        return best, ratio
    for four in _best_fours(plane, image, lens, near):
        trial = _least_squares(plane[four], image[four], lens)
        for _ in range(ROUNDS):
            found = _off(trial, plane, image, near)
            if _cost(found) < _cost(ratio):
                best, ratio = trial, found
            if (found < 1).sum() < LEAST:
                break
            trial = _least_squares(plane[found < 1], image[found < 1], lens)
    return best, ratio


def _cost(ratio: np.ndarray) -> float:
    """What misses cost that are given in units of what is allowed: no miss more than one beyond it."""
    return float((np.minimum(ratio, 1) ** 2).sum())


def _best_fours(plane: np.ndarray, image: np.ndarray, lens: RoughLens, near: np.ndarray) -> np.ndarray:
    """(k, 4) of many samples of four marks those whose homographies most other marks agree with."""
    four = np.random.default_rng(0).random((SAMPLES, len(plane))).argsort(axis=1)[:, :4]
    scaled = _Scaled.of(plane, image, lens)
    at = lens.pixels(np.einsum("tij,nj->tni", scaled.solve(four)[0], scaled.plane))
    with np.errstate(all="ignore"):
        gaps = np.linalg.norm(at[:, :, None] - at[:, near], axis=-1)
        ratio = np.linalg.norm(at - image, axis=-1) / (MISPLACED * gaps.min(axis=-1))
    cost = (np.nan_to_num(ratio, nan=1.0, posinf=1.0).clip(0, 1) ** 2).sum(axis=1)
    return np.asarray(four[np.argsort(cost, kind="stable")[:FOLLOWED]])


def _nearest(plane: np.ndarray) -> np.ndarray:
    """(n, k) the marks nearest to each on the sheet."""
    count = min(5, len(plane))
    return np.asarray(cKDTree(plane).query(plane, k=count)[1]).reshape(len(plane), count)[:, 1:]


def _off(model: PlaneImage | None, plane: np.ndarray, image: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(n,) distances from the predicted places, in units of what is allowed; infinity where nothing is predicted."""
    if model is None:
        return np.full(len(plane), np.inf)
    at = model.at(plane)
    with np.errstate(all="ignore"):
        ratio = np.linalg.norm(at - image, axis=1) / _allowed(at, near)
    return np.where(np.isfinite(ratio), ratio, np.inf)


def _allowed(at: np.ndarray, near: np.ndarray) -> np.ndarray:
    gaps = np.linalg.norm(at[:, None] - at[near], axis=2)
    return MISPLACED * np.asarray(np.nanmin(np.where(np.isfinite(gaps), gaps, np.inf), axis=1))


def _grown(model: PlaneImage, plane: np.ndarray, image: np.ndarray, good: np.ndarray) -> np.ndarray:
    """(n,) the marks that agree, with those that agree with their neighbours, step by step outwards."""
    good = good.copy()
    at, near = model.at(plane), _nearest(plane)
    if good.sum() < 3:
        return good
    allowed, residual = _allowed(at, near), image - at
    asked = np.zeros_like(good)
    while (left := ~good & ~asked & np.isfinite(at).all(axis=1)).any():
        known, ask = np.flatnonzero(good), np.flatnonzero(left)
        gap, which = cKDTree(plane[known]).query(plane[ask], k=min(NEIGHBOURS, len(known)))
        front = gap[:, 0] <= 1.3 * gap[:, 0].min()
        accepted = []
        for i, around in zip(ask[front], known[which[front]], strict=True):
            expected = carried(plane[around] - plane[i], residual[around])
            if np.linalg.norm(residual[i] - expected) < allowed[i]:
                accepted.append(i)
        # A mark that had to be extrapolated is asked again when more of its neighbours are known.
        asked = np.zeros_like(good) if accepted else asked
        asked[ask[front]] = True
        good[accepted] = True
    return good


def carried(beside: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """What residuals (k, 2) at places (k, 2) beside a mark make of its own."""
    x, y = (beside / (float(np.abs(beside).max()) or 1.0)).T
    one = np.ones_like(x)
    for terms in ([one, x, y, x * x, x * y, y * y], [one, x, y]):
        columns = np.stack(terms, axis=1)
        if len(x) >= 2 * len(terms) and np.linalg.svd(columns, compute_uv=False)[-1] > STEADY:
            return np.asarray(np.linalg.lstsq(columns, residual, rcond=None)[0][0])
    return np.asarray(residual.mean(axis=0))


@dataclass(frozen=True)
class _Scaled:
    """Points `plane` (n, 3) of a plane and `ray` (n, 3), all of order one (Hartley 1997), and what scaled the plane."""

    plane: np.ndarray
    ray: np.ndarray
    centre_mm: np.ndarray
    size_mm: float

    @staticmethod
    def of(plane: np.ndarray, image: np.ndarray, lens: RoughLens) -> "_Scaled":
        centre = plane.mean(axis=0)
        size = float(np.abs(plane - centre).max()) or 1.0
        ray = lens.rays(image)
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        return _Scaled(np.column_stack([(plane - centre) / size, np.ones(len(plane))]), ray, centre, size)

    def solve(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Homographies (..., 3, 3) from the plane to rays by the direct linear transformation of the points `chosen`
        (..., k), that see them in front, and whether each (...,) is determined."""
        a, ray = self.plane[chosen], self.ray[chosen]
        x, y, z = (ray[..., [k]] for k in range(3))
        zero = np.zeros_like(a)
        rows = [[zero, -z * a, y * a], [z * a, zero, -x * a], [-y * a, x * a, zero]]
        A = np.concatenate([np.concatenate(row, axis=-1) for row in rows], axis=-2)
        values, vectors = np.linalg.eigh(np.swapaxes(A, -1, -2) @ A)
        H = vectors[..., 0].reshape(*vectors.shape[:-2], 3, 3)
        before = np.einsum("...ij,...kj,...ki->...", H, a, ray)
        return H * np.where(before < 0, -1, 1)[..., None, None], values[..., 1] > 1e-12 * values[..., -1]


def _least_squares(plane: np.ndarray, image: np.ndarray, lens: RoughLens) -> PlaneImage | None:
    if len(plane) < 4:
        return None
    scaled = _Scaled.of(plane, image, lens)
    H, determined = scaled.solve(np.arange(len(plane)))
    if not determined:
        return None
    (cx, cy), size = scaled.centre_mm, scaled.size_mm
    (mx, my), unit = lens.middle_px, lens.radius_px
    to_plane = np.array([[1 / size, 0, -cx / size], [0, 1 / size, -cy / size], [0, 0, 1]])
    return PlaneImage(np.array([[unit, 0, mx], [0, unit, my], [0, 0, 1]]) @ H @ to_plane, lens)
