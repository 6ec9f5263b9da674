"""The two halves of a data set: a check of stated uncertainty that needs no truth.

Images are split at random, each half is measured by itself, and the two results differ by no more than their
uncertainties say, or these are too small. Both halves are by the same camera of the same field, so an error that is the
same in both cannot show: what remains of the lens' smooth field is taken from the difference's covariance, and an error
of a certified length shifts both halves alike. With C1 and C2 the covariances of the halves, and B1, B2 those between
their results and the field's amounts, which were known to 0 +- 1 before, the difference has the covariance

    C1 + C2 - B1 B2' - B2 B1'

because an amount's deviation from 0 moves each result by -B of it. Where covariances are widened by a factor F, the
amounts were known to 0 +- sqrt(F), and a deviation moves a result by -B / F of it: the products are divided by F.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.camera.interior import MODE
from testfield.camera.pose import cross_matrix, nearest_rotation
from testfield.errors import TestfieldError
from testfield.reconstruct.points import Points
from testfield.seeds import generator
from testfield.statistics.consistency import decorrelated

SPLITS = 3
LEAST_IMAGES = 3
"""Images that a half needs."""
LEAST_POINTS = 6
"""Points in common from which halves' points are compared."""
COMPARED = ("fx", "cx", "cy")
NAMES = {"fx": "focal length", "cx": "principal point in x", "cy": "principal point in y", "points": "points"}
TOO_FAR = 3.3
"""Ratio that chance passes in 1 of 1,000 cases, were all splits one and the same."""

Measured = tuple[Calibration, Points]


@dataclass(frozen=True)
class Difference:
    """How far halves are apart in one quantity, root mean square over the splits: `difference`, its stated standard
    uncertainty `u`, both in px or mm, and their `ratio`, 1 on the whole where stated uncertainties are true."""

    quantity: str
    difference: float
    u: float
    ratio: float
    unit: str

    @property
    def sentence(self) -> tuple[str, str]:
        """Title and value for a reader."""
        digits = 3 if self.unit == "px" else 4
        return (
            f"halves of the images apart, {NAMES[self.quantity]}",
            f"{self.difference:.{digits}f} {self.unit}, {self.ratio:.2f} times what is stated",
        )


@dataclass(frozen=True)
class Halves:
    """What the halves of `splits` random splits say; `note` where they say nothing, less than wished, or that
    what is stated is too small."""

    splits: int
    differences: tuple[Difference, ...]
    note: str = ""


NO_HALVES = Halves(0, ())


def random_halves(images: int, split: int) -> tuple[np.ndarray, np.ndarray]:
    """The images of both halves of a split by its number."""
    order = generator(0, f"halves/{split}").permutation(images)
    return np.sort(order[: images // 2]), np.sort(order[images // 2 :])


def compare_halves(images: int, measure: Callable[[np.ndarray], Measured], between: float = 1.0) -> Halves:
    """Halves measured by a function of their images' numbers, which may raise `TestfieldError` for one too weak; their
    covariances are widened by the factor `between`, because images contradict each other."""
    if images < 2 * LEAST_IMAGES:
        return Halves(
            0, (), f"no check by halves of the images: {2 * LEAST_IMAGES} images are needed, {images} are there"
        )
    found, failed = [], ""
    for split in range(SPLITS):
        try:
            first, second = (measure(half) for half in random_halves(images, split))
        except (TestfieldError, np.linalg.LinAlgError) as error:
            failed = error.what if isinstance(error, TestfieldError) else str(error)
            continue
        found.append(_apart(first, second, between))
    note = f"{SPLITS - len(found)} of {SPLITS} splits of the images had a half too weak ({failed})" if failed else ""
    differences = []
    for quantity, unit in (*((name, "px") for name in COMPARED), ("points", "mm")):
        rows = np.array([one[quantity] for one in found if quantity in one]).reshape(-1, 3)
        if len(rows):
            size = np.sqrt((rows**2).mean(axis=0))
            differences.append(Difference(quantity, float(size[0]), float(size[1]), float(size[2]), unit))
    return Halves(len(found), tuple(differences), "; ".join(said for said in (note, _doubt(differences)) if said))


def _doubt(differences: list[Difference]) -> str:
    far = [d for d in differences if d.ratio > TOO_FAR]
    if not far:
        return ""
    worst = max(far, key=lambda d: d.ratio)
    return (
        f"they are too far apart ({NAMES[worst.quantity]}: {worst.ratio:.1f} times what is stated), so what is stated "
        "is too small: something differs from image to image (a target that bends, focus, motion)"
    )


def _apart(a: Measured, b: Measured, between: float) -> dict[str, tuple[float, float, float]]:
    """By quantity: the difference, its uncertainty and the ratio of the two."""
    answer = {}
    for name in COMPARED:
        if name in a[0].labels and name in b[0].labels:
            difference = getattr(a[0].interior, name) - getattr(b[0].interior, name)
            at_a, at_b = a[0].index([name]), b[0].index([name])
            u = float(np.sqrt(_covariance(a[0], b[0], at_a, at_b, between)[0, 0]))
            answer[name] = (difference, u, abs(difference) / u)
    points = _points_apart(a[1], b[1])
    return answer | ({} if points is None else {"points": points})


def _covariance(a: Calibration, b: Calibration, at_a: np.ndarray, at_b: np.ndarray, between: float) -> np.ndarray:
    """Of the difference of some unknowns, without what the halves share."""
    field_a, field_b = (np.array([k for k, name in enumerate(c.labels) if name.startswith(MODE)], int) for c in (a, b))
    own = a.covariance[np.ix_(at_a, at_a)] + b.covariance[np.ix_(at_b, at_b)]
    if len(field_a) != len(field_b) or not len(field_a):
        return own
    shared = a.covariance[np.ix_(at_a, field_a)] @ b.covariance[np.ix_(at_b, field_b)].T
    return own - (shared + shared.T) / between


def _points_apart(a: Points, b: Points) -> tuple[float, float, float] | None:
    """Root mean square of the coordinates' differences after a fit of seven parameters, what is stated of it, and the
    root of NEES per degree of freedom. The halves' shared field is left in: it moves points by little."""
    codes = [int(c) for c in np.intersect1d(a.code[a.code > 0], b.code[b.code > 0])]
    if len(codes) < LEAST_POINTS:
        return None
    rows_a, rows_b = a.rows(codes), b.rows(codes)
    x, y = a.xyz_mm[rows_a], b.xyz_mm[rows_b]
    p, q = x - x.mean(axis=0), y - y.mean(axis=0)
    R = nearest_rotation(p.T @ q)
    scale = float((p * (q @ R.T)).sum() / (q**2).sum())
    turn = scale * np.kron(np.eye(len(codes)), R)
    covariance = a.covariance_of(rows_a) + turn @ b.covariance_of(rows_b) @ turn.T
    similarity = np.concatenate([np.tile(np.eye(3), (len(p), 1, 1)), -cross_matrix(p), p[:, :, None]], axis=2).reshape(
        -1, 7
    )
    S = np.eye(len(covariance)) - similarity @ np.linalg.pinv(similarity)
    error, covariance = S @ (p - scale * q @ R.T).ravel(), S @ covariance @ S.T
    z = decorrelated(error, covariance)
    freedom = len(error) - 7
    return (
        float(np.sqrt((error**2).sum() / freedom)),
        float(np.sqrt(np.trace(covariance) / freedom)),
        float(np.sqrt((z**2).mean())),
    )
