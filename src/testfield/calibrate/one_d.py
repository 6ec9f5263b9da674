"""Calibration with a wand: collinear points that turn about a fixed one (Zhang 2004)."""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.rows import usable_rows
from testfield.camera.interior import Interior, check_held
from testfield.camera.lens import lens_model
from testfield.camera.pose import Poses
from testfield.camera.project import camera_jacobian
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field, Wand

LEAST_IMAGES = 6
EXACT_MM = 1e-6
MOST_STEPS = 100
SETTLED = 1e-9
"""A step, in standard deviations of its unknown, after which nothing moves any more."""
WEAK = 1e-13
AXES = ("tx", "ty", "tz")


@register("calibrators", "one_d")
def one_d(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
) -> Calibration:
    """The camera from the images of a wand, the field sheet's first, that turns about its first target.

    Neither the camera nor that target moves: the stations are images of one camera, whose frame is that of the result,
    so only camera, fixed target (`wand.tx` ...) and the wand's distances are unknowns with a covariance. Zhang's closed
    form gives the start, all pixels with their covariance the estimate; the wand's distances are known as well
    as its sheet says. Raises `TestfieldError` where the sheet lists no wand, for fewer than six images of it, and where
    its directions do not determine the camera.
    """
    if not field.wands:
        raise TestfieldError("the field sheet lists no wand", "field.json, wands", "list its codes and distances")
    wand = field.wands[0]
    if len(wand.codes) < 3 or len(wand.codes) != len(wand.at_mm) or wand.at_mm[0] != 0:
        raise TestfieldError(f"wand '{wand.name}' needs three codes or more, each with its distance, the first at 0",
                             "field.json, wands", "list the fixed target first")  # fmt: skip
    rows, turned_down, notes = usable_rows(observations, field)
    xy, cov, images = _seen(rows, wand)
    if len(images) < LEAST_IMAGES:
        raise TestfieldError(
            f"{len(images)} images show all targets of wand '{wand.name}', and {LEAST_IMAGES} are needed",
            "observations.parquet", "turn the wand to more directions",
        )  # fmt: skip
    fixed_px = np.mean(xy[:, 0], axis=0)
    spread = float(np.linalg.norm(xy[:, 0] - fixed_px, axis=1).max())
    if spread > 20 * np.sqrt(np.trace(cov[:, 0].mean(axis=0))):
        notes.append(f"the wand's first target moves by {spread:.2f} px from image to image: it is taken as fixed")
    interior, free = _camera(width_px, height_px, lens, hold)
    interior, fixed_mm, towards = _closed_form(interior, xy, wand)
    model = _Model(interior, free, fixed_mm, towards, np.array(wand.at_mm), xy, cov, max(wand.u_mm, EXACT_MM))
    model, covariance, chi2 = _estimated(model, wand)

    labels = [name for name, unknown in zip(interior.names, free, strict=True) if unknown]
    labels += [f"wand.{axis}" for axis in AXES] + [f"wand.at{k}" for k in range(1, len(wand.codes))]
    residual = xy - model.predicted()
    freedom = residual.size + len(wand.codes) - 1 - model.size
    names = tuple(rows.stations[s] for s in images)
    notes.append(f"wand '{wand.name}' in {len(images)} images; the frame is the camera's, which did not move")
    keep = len(labels)
    return Calibration(
        "one_d", model.interior, names, Poses.identity(len(names)), (), Poses.identity(0), 1.0,
        covariance[:keep, :keep], tuple(labels), float(np.sqrt(chi2 / freedom)), freedom,
        float(np.sqrt((residual**2).sum(axis=2).mean())), residual.size // 2, tuple(turned_down),
        xy.reshape(-1, 2), residual.reshape(-1, 2), (), tuple(notes),
    )  # fmt: skip


def _seen(rows: Observations, wand: Wand) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Pixels (v, k, 2) and covariances (v, k, 2, 2) of the wand's k targets in the v images that show all of them."""
    place = {(int(s), int(code)): k for k, (s, code) in enumerate(zip(rows.station, rows.code, strict=True)) if code}
    images = [s for s in range(len(rows.stations)) if all((s, code) in place for code in wand.codes)]
    index = np.array([[place[s, code] for code in wand.codes] for s in images], int).reshape(-1, len(wand.codes))
    return rows.xy_px[index], rows.cov_px2[index], images


def _camera(width_px: int, height_px: int, lens: str, hold: tuple[str, ...]) -> tuple[Interior, np.ndarray]:
    middle = [(width_px - 1) / 2, (height_px - 1) / 2]
    interior = Interior(width_px, height_px, np.array([1.0, 1.0, *middle, *lens_model(lens).pinhole]), lens)
    check_held(hold, lens)
    held = np.array([name in hold for name in interior.names])
    return interior.with_parameters(np.where(held, 0.0, interior.parameters)), ~held


def _closed_form(interior: Interior, xy_px: np.ndarray, wand: Wand) -> tuple[Interior, np.ndarray, np.ndarray]:
    """Zhang's solution of a pinhole: camera, fixed point (3,), the wand's unit directions (v, 3).

    With C = A + c (B - A) on the wand, the depth of B follows from that of A by cross products of the three pixels, so
    |B - A| = L is one equation an image, linear in zA^2 times the image of the absolute conic.
    """
    middle, size = interior.parameters[2:4], float(interior.width_px)
    pixel = np.concatenate([(xy_px - middle) / size, np.ones((*xy_px.shape[:2], 1))], axis=2)
    a, b, c = pixel[:, 0].mean(axis=0), pixel[:, 1], pixel[:, -1]
    length, part = wand.at_mm[1], wand.at_mm[1] / wand.at_mm[-1]
    # B = (1 - part) A + part C, hence C = to_a A + to_b B.
    to_a, to_b = 1 - 1 / part, 1 / part
    ac, bc = np.cross(a, c), np.cross(b, c)
    ratio = -to_a * (ac * bc).sum(axis=1) / (to_b * (bc * bc).sum(axis=1))  # zB / zA
    h = ratio[:, None] * b - a
    rows = np.stack(
        [h[:, 0] ** 2, 2 * h[:, 0] * h[:, 1], h[:, 1] ** 2, 2 * h[:, 0] * h[:, 2], 2 * h[:, 1] * h[:, 2], h[:, 2] ** 2],
        axis=1,
    )
    x, _, rank, _ = np.linalg.lstsq(rows, np.full(len(rows), length**2), rcond=1e-10)
    xx, xy, yy, x1, y1, one = x
    conic = np.array([[xx, xy, x1], [xy, yy, y1], [x1, y1, one]])
    values = np.linalg.eigvalsh(conic)
    if rank < 6 or values[0] <= 0:
        raise TestfieldError(
            f"the directions of wand '{wand.name}' do not determine the camera", "observations.parquet",
            "turn it to directions all around the fixed target, not in one plane or on one cone",
        )  # fmt: skip
    # conic = zA^2 K^-T K^-1 with K^-1 upper triangular.
    inverse = np.linalg.cholesky(conic).T
    depth, K = inverse[2, 2], np.linalg.inv(inverse / inverse[2, 2])
    pinhole = [K[0, 0] * size, K[1, 1] * size, K[0, 2] * size + middle[0], K[1, 2] * size + middle[1]]
    rays = pixel @ np.linalg.inv(K).T
    at = depth * rays[:, 0].mean(axis=0)
    ends = depth * ratio[:, None] * rays[:, 1]
    towards = ends - at
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return interior.with_parameters(np.array([*pinhole, *interior.parameters[4:]])), at, towards


class _Model:
    """A wand at present values: camera, fixed point, directions, distances; and what was seen."""

    def __init__(
        self, interior: Interior, free: np.ndarray, fixed_mm: np.ndarray, towards: np.ndarray, at_mm: np.ndarray,
        xy_px: np.ndarray, cov_px2: np.ndarray, u_mm: float,
    ):  # fmt: skip
        self.interior, self.free, self.fixed_mm, self.towards, self.at_mm = interior, free, fixed_mm, towards, at_mm
        self.xy_px, self.u_mm = xy_px, u_mm
        self.whitening = np.linalg.inv(np.linalg.cholesky(cov_px2))
        self.cov_px2 = cov_px2

    @property
    def size(self) -> int:
        """Number of unknowns: camera, fixed point, distances but the first, two turns an image."""
        return int(self.free.sum()) + 3 + len(self.at_mm) - 1 + 2 * len(self.towards)

    @property
    def points_mm(self) -> np.ndarray:
        """(v, k, 3) in the camera's frame."""
        return self.fixed_mm + self.at_mm[None, :, None] * self.towards[:, None, :]

    def predicted(self) -> np.ndarray:
        """(v, k, 2) px."""
        return camera_jacobian(self.interior, self.points_mm.reshape(-1, 3))[0].reshape(self.xy_px.shape)

    def normal_equations(self, known_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Normal matrix, right side, and chi-squared at the present values."""
        v, k = self.xy_px.shape[:2]
        uv, by_interior, by_point = camera_jacobian(self.interior, self.points_mm.reshape(-1, 3))
        by_point = by_point.reshape(v, k, 2, 3)
        p = int(self.free.sum())
        A = np.zeros((v, k, 2, self.size))
        A[..., :p] = by_interior[:, :, self.free].reshape(v, k, 2, p)
        A[..., p : p + 3] = by_point
        for j in range(1, k):
            A[:, j, :, p + 2 + j] = np.einsum("vij,vj->vi", by_point[:, j], self.towards)
        square = self.square()
        first = p + 3 + k - 1
        for i in range(v):
            A[i, :, :, first + 2 * i : first + 2 * i + 2] = self.at_mm[:, None, None] * (by_point[i] @ square[i])
        rows = (self.whitening @ A).reshape(2 * v * k, -1)
        residual = np.einsum("vkij,vkj->vki", self.whitening, self.xy_px - uv.reshape(v, k, 2)).ravel()
        normal, right = rows.T @ rows, rows.T @ residual
        known = np.arange(p + 3, first)
        gap = (known_mm - self.at_mm)[1:]
        normal[known, known] += 1 / self.u_mm**2
        right[known] += gap / self.u_mm**2
        return normal, right, float(residual @ residual + (gap**2).sum() / self.u_mm**2)

    def square(self) -> np.ndarray:
        """(v, 3, 2) two unit vectors at right angles to each direction."""
        return np.swapaxes(np.linalg.svd(self.towards[:, None, :])[2][:, 1:], 1, 2)

    def moved(self, step: np.ndarray) -> "_Model":
        """The model after a step of its unknowns."""
        p, k = int(self.free.sum()), len(self.at_mm)
        values = self.interior.parameters.copy()
        values[self.free] += step[:p]
        at = self.at_mm.copy()
        at[1:] += step[p + 3 : p + 2 + k]
        towards = self.towards + np.einsum("vij,vj->vi", self.square(), step[p + 2 + k :].reshape(-1, 2))
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        return _Model(self.interior.with_parameters(values), self.free, self.fixed_mm + step[p : p + 3], towards, at,
                      self.xy_px, self.cov_px2, self.u_mm)  # fmt: skip


def _estimated(model: _Model, wand: Wand) -> tuple[_Model, np.ndarray, float]:
    """The minimum by Levenberg's way, the covariance of all unknowns there, and chi-squared."""
    known = np.array(wand.at_mm)
    damping = 1e-3
    normal, right, chi2 = model.normal_equations(known)
    for _ in range(MOST_STEPS):
        scale = 1 / np.sqrt(np.diag(normal))
        unit = normal * scale[:, None] * scale
        step = scale * np.linalg.solve(unit + damping * np.eye(len(unit)), scale * right)
        trial = model.moved(step)
        new_normal, new_right, new = trial.normal_equations(known)
        if np.isfinite(new) and new <= chi2 * (1 + 1e-12) + 1e-18:
            small = np.abs(step / scale).max() < SETTLED * max(1.0, np.sqrt(chi2)) and damping < 1e-9
            model, normal, right, chi2 = trial, new_normal, new_right, new
            damping = damping / 30 if damping > 1e-15 else 0.0
            if small:
                break
        elif damping > 1e8:
            break
        else:
            damping = max(30 * damping, 1e-9)
    scale = 1 / np.sqrt(np.diag(normal))
    unit = normal * scale[:, None] * scale
    if np.linalg.eigvalsh(unit)[0] < WEAK:
        raise TestfieldError(f"the images of wand '{wand.name}' do not determine the camera", "observations.parquet",
                             "turn it to more directions, or hold lens parameters (measure.hold)")  # fmt: skip
    return model, scale[:, None] * np.linalg.inv(unit) * scale, chi2
