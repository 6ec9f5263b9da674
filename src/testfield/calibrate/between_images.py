"""Do images agree with each other as well as their points agree within them?

What is wrong in one way all over an image, because a sheet of paper bends from image to image or focus moves, is no
scatter of points: its residuals are alike over much of the image, and count as one error and not as many. So a camera
is less sure than the residuals' size says. What image i (all images taken at one place and time) does to the camera's
unknowns c is known: with residuals r, derivatives A and the covariance C of all unknowns,

    d_i = C_c A_i' r_i,   of covariance   K_i = B_i' B_i - B_i' A_i C A_i' B_i,   B_i = A_i C_c',

where every observation errs by itself, as is claimed; all d_i add up to nothing. The factor

    F = sum d_i' W d_i / sum tr W K_i,   W = C_cc^-1,

is 1 then, and otherwise the ratio of what images do to the camera, to what single observations do: Birge's ratio with
images in the place of observations, the middle of the sandwich estimator over clusters (Liang and Zeger 1986) with the
bias of few clusters taken out (Bell and McCaffrey 2002). Were it by chance it would be about chi-squared over its
degrees of freedom, nu = (sum tr W K_i)^2 / sum tr (W K_i)^2 (Satterthwaite).

The amounts of the lens' smooth field are asked by themselves (`field`): there the factor tells a field, which is the
same in all images, from what is alike within a mark or an image only.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from testfield.adjust.bundle import Adjustment
from testfield.adjust.network import Layout
from testfield.camera.interior import MODE

LEAST_PLACES = 3
"""What is done by two places adds up to nothing, so the one repeats what the other says."""
CHANCE = 0.025
"""Probability with which images that agree are taken for such that do not."""


@dataclass(frozen=True)
class BetweenImages:
    """The factor F, its degrees of freedom `nu`, and the `high` end that it passes by chance in `CHANCE` of cases."""

    factor: float
    nu: float
    high: float

    @property
    def excess(self) -> float:
        """By how much more images scatter than claimed: the factor, 1 where that is by chance."""
        return self.factor if self.factor > max(self.high, 1.0) else 1.0


def between_images(adjustment: Adjustment, field: bool = False) -> BetweenImages | None:
    """How images agree on the camera, or on the smooth `field` of its lens; None where it has no such unknowns or fewer
    than `LEAST_PLACES` are there."""
    network = adjustment.network
    names = [n for c in network.cameras for n in np.array(c.interior.names)[c.unknown].tolist()]
    asked = np.array([k for k, name in enumerate(names) if name.startswith(MODE) is field], int)
    places = np.unique(network.images.station[network.image])
    if not len(asked) or len(places) < LEAST_PLACES:
        return None
    reduced = adjustment.covariance
    to_camera, W = reduced[:, asked], np.linalg.inv(reduced[np.ix_(asked, asked)])
    done = claimed = spread = 0.0
    for place in places:
        moved, K = _of_place(adjustment, int(place), to_camera, Layout.of(network).size)
        WK = W @ K
        done, claimed = done + float(moved @ W @ moved), claimed + float(np.trace(WK))
        spread += float((WK * WK.T).sum())
    if claimed <= 0 or not np.isfinite(done):
        return None
    nu = claimed**2 / spread
    return BetweenImages(done / claimed, nu, float(chdtri(nu, CHANCE) / nu))


def _of_place(adjustment: Adjustment, place: int, to_camera: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """d (p,) and K (p, p) of the images taken at one place."""
    network, equations = adjustment.network, adjustment.equations
    s, d = equations.structure, equations.derivatives
    groups = [g for g in s.groups if network.images.station[g.image] == place]
    points = np.unique(np.concatenate([g.points for g in groups if not g.kept] or [np.zeros(0, int)]))
    number = np.zeros(len(network.point_mm), int)
    number[points] = np.arange(len(points))
    own = np.linalg.inv(equations.point_normal[points])
    # How points follow the reduced unknowns, with the sign turned.
    follow = equations.rows(points, _at(points, own, len(number)), np.arange(size), size)
    p = to_camera.shape[1]
    by_point, v, u = -(follow @ to_camera), np.zeros((size, p)), np.zeros((len(points), 3, p))
    moved, K = np.zeros(p), np.zeros((p, p))
    for g in groups:
        A, D = d.by_unknown[g.here, :, : len(g.columns)], d.by_point[g.here]
        kept = s.kept_at[g.points][:, None] + np.arange(3)
        of_points = to_camera[kept] if g.kept else by_point[number[g.points]]
        B = A @ to_camera[g.columns] + D @ of_points
        moved += np.einsum("kip,ki->p", B, d.residual[g.here])
        K += np.einsum("kip,kiq->pq", B, B)
        v[g.columns] += np.einsum("kic,kip->cp", A, B)
        part = np.swapaxes(D, 1, 2) @ B
        if g.kept:
            v[kept] += part
        else:
            np.add.at(u, number[g.points], part)
    v -= np.einsum("kjc,kjp->cp", follow, u)
    return moved, K - v.T @ adjustment.covariance @ v - np.einsum("kip,kij,kjq->pq", u, own, u)


def _at(rows: np.ndarray, blocks: np.ndarray, n: int) -> np.ndarray:
    whole = np.zeros((n, 3, 3))
    whole[rows] = blocks
    return whole
