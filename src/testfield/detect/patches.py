"""What the classic estimators share: a dot's window with its levels, and how noise reaches the centre."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from testfield.camera.images import SensorSheet
from testfield.detect.centre import Centres, half_widths, usable, windows


@dataclass(frozen=True)
class Patch:
    """Windows of n dots: `rows` (n,), `values`, `x`, `y` (n, k) relative to `origin` (n, 2) px, `side` with
    `side`^2 = k, `use` (n, k) the pixels that may be used, `q` (n, k) distance from the rough centre in rough
    half-axes, `black`, `white` (n,) levels beside and on the dot, `noise` (n, k) variance, `whole` (n,) whether the
    window lies in the image."""

    rows: np.ndarray
    values: np.ndarray
    x: np.ndarray
    y: np.ndarray
    origin: np.ndarray
    side: int
    use: np.ndarray
    q: np.ndarray
    black: np.ndarray
    white: np.ndarray
    noise: np.ndarray
    whole: np.ndarray

    @property
    def contrast(self) -> np.ndarray:
        """(n,) white less black."""
        return self.white - self.black

    @property
    def contrast_over_noise(self) -> np.ndarray:
        """(n,) contrast in units of the noise at the edge."""
        middle = ((self.values > (self.black + self.contrast / 4)[:, None]) & self.use).astype(float)
        typical = (self.noise * middle).sum(1) / np.maximum(middle.sum(1), 1)
        return self.contrast / np.sqrt(np.maximum(typical, 1e-12))

    def square(self, flat: np.ndarray) -> np.ndarray:
        """(n, side, side) from (n, k)."""
        return flat.reshape(-1, self.side, self.side)

    def centres(
        self,
        xy: np.ndarray,
        covariance: np.ndarray,
        moments: np.ndarray,
        ok: np.ndarray,
        chi2: np.ndarray | None = None,
    ) -> Centres:
        """The result for this patch, of centres (n, 2) relative to the origin."""
        sane = np.isfinite(xy).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2)) & (self.contrast > 0)
        size = np.sqrt(np.maximum(np.einsum("nii->n", moments), 0))
        sane &= np.hypot(*np.nan_to_num(xy, nan=1e9).T) < size + 1.5
        one = np.ones(len(xy))
        return Centres(
            xy + self.origin,
            covariance,
            moments,
            self.contrast,
            self.black,
            one if chi2 is None else chi2,
            0 * one,
            ok & sane & (np.einsum("nii->n", np.nan_to_num(covariance)) > 0),
        )


def patches(image_dn: np.ndarray, sheet: SensorSheet, xy_px: np.ndarray, moments_px2: np.ndarray) -> Iterator[Patch]:
    """Windows about rough centres (n, 2) with rough moments (n, 2, 2), in batches of one size."""
    shape = np.linalg.inv(4 * moments_px2)
    for rows, values, x, y, inside in windows(image_dn, xy_px, half_widths(moments_px2)):
        dx, dy = x - xy_px[rows, :1], y - xy_px[rows, 1:]
        g = shape[rows]
        q = np.sqrt(g[:, 0, :1] * dx * dx + 2 * g[:, 0, 1:] * dx * dy + g[:, 1, 1:] * dy * dy)
        use = inside & usable(q, dx, dy)
        inner, outer = use & (q < 0.6), use & (q > 1.2)
        black = (values * outer).sum(1) / np.maximum(outer.sum(1), 1)
        white = (values * inner).sum(1) / np.maximum(inner.sum(1), 1)
        origin = np.rint(xy_px[rows])
        yield Patch(
            rows,
            values,
            x - origin[:, :1],
            y - origin[:, 1:],
            origin,
            round(np.sqrt(values.shape[1])),
            use,
            q,
            black,
            white,
            sheet.variance_dn2(values),
            np.all(inside, axis=1),
        )


def smallest_diameter(moments_px2: np.ndarray) -> np.ndarray:
    """(n,) the shorter axis of dots, in px."""
    return 4 * np.sqrt(np.maximum(np.linalg.eigvalsh(moments_px2)[:, 0], 0))


def symmetric(xx: np.ndarray, xy: np.ndarray, yy: np.ndarray) -> np.ndarray:
    """(n, 2, 2) matrices from their parts (n,)."""
    return np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)


def moments_above(values: np.ndarray, x: np.ndarray, y: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """(n, 2, 2) second moments of the pixels (n, k) that are `inside`, each a unit square."""
    area = np.maximum(inside.sum(1), 1)
    cx, cy = (inside * x).sum(1) / area, (inside * y).sum(1) / area
    dx, dy = x - cx[:, None], y - cy[:, None]
    xx, xy, yy = ((inside * v).sum(1) / area for v in (dx * dx, dx * dy, dy * dy))
    return symmetric(xx + 1 / 12, xy, yy + 1 / 12)


def covariance_of(influence_x: np.ndarray, influence_y: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(n, 2, 2) covariance of a centre to which each pixel (n, k) of independent noise variance contributes."""
    return symmetric(
        (noise * influence_x**2).sum(1), (noise * influence_x * influence_y).sum(1), (noise * influence_y**2).sum(1)
    )


def central_differences(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (n, side, side) by x and y; zero at the border."""
    gx, gy = np.zeros_like(values), np.zeros_like(values)
    gx[:, 1:-1, 1:-1] = (values[:, 1:-1, 2:] - values[:, 1:-1, :-2]) / 2
    gy[:, 1:-1, 1:-1] = (values[:, 2:, 1:-1] - values[:, :-2, 1:-1]) / 2
    return gx, gy


def back_to_pixels(by_gx: np.ndarray, by_gy: np.ndarray) -> np.ndarray:
    """What pixels (n, side, side) contribute, from what their central differences do: the adjoint of the above."""
    pixel = np.zeros_like(by_gx)
    pixel[:, 1:-1, 2:] += by_gx[:, 1:-1, 1:-1] / 2
    pixel[:, 1:-1, :-2] -= by_gx[:, 1:-1, 1:-1] / 2
    pixel[:, 2:, 1:-1] += by_gy[:, 1:-1, 1:-1] / 2
    pixel[:, :-2, 1:-1] -= by_gy[:, 1:-1, 1:-1] / 2
    return pixel
