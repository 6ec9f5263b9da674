"""Tsai's calibration (1987): the radial alignment constraint, then focal length, depth and one radial coefficient."""

import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.calibrate.edges import Edges
from testfield.calibrate.finish import calibrated
from testfield.calibrate.misfit import NO_MISFIT
from testfield.calibrate.rows import usable_rows
from testfield.calibrate.start import Start, starting_network
from testfield.camera.pose import Poses, nearest_rotation
from testfield.detect.observations import Observations
from testfield.errors import TestfieldError
from testfield.registry import register
from testfield.targets.field import Field


@register("calibrators", "tsai")
def tsai(
    observations: Observations,
    field: Field,
    width_px: int,
    height_px: int,
    lens: str = "brown",
    hold: tuple[str, ...] = (),
) -> Calibration:
    """Tsai's camera: the principal point in the image's middle, k1 alone, fx / fy free (his uncertainty scale factor).

    One station is enough where a board is seen obliquely; several and several boards are joined as in `stitched`. The
    radial alignment constraint gives each board's rotation and sideways shift whatever the radial distortion, then
    focal length and depths follow linearly; a bundle of these unknowns is the refinement. What the camera has beside
    them (a principal point elsewhere, decentring) is not in the covariance. Raises as `stitched`, and for a fisheye.
    """
    if lens not in ("brown", "brown_shear"):
        raise TestfieldError(
            f"Tsai's camera has one radial coefficient, and '{lens}' is another lens",
            "measure.lens",
            "measure as 'brown'",
        )
    rows, turned_down, notes = usable_rows(observations, field)
    notes.append(
        "Tsai's camera: principal point held in the image's middle, k1 alone; the covariance takes both as true"
    )
    held = ("k2", "k3", "p1", "p2", *(name for name in hold if name == "k1"))

    def begin(rows: Observations, left_out: frozenset[int]) -> Start:
        return starting_network(
            rows,
            field,
            width_px,
            height_px,
            "brown",
            held,
            fixed=("cx", "cy"),
            guess=by_radial_alignment,
            least_stations=1,
            left_out=left_out,
        )

    return calibrated("tsai", begin, rows, field, turned_down, notes, misfit=NO_MISFIT)


def by_radial_alignment(edges: Edges, rows: Observations, field: Field, middle_px: np.ndarray) -> tuple[float, Poses]:
    """Focal length and camera-from-board poses of planar boards, square pixels assumed."""
    R, sideways, planes, pixels = [], [], [], []
    for e in range(len(edges)):
        plane = field.boards[edges.board[e]].marks.xy_mm[rows.point[edges.rows[e]]]
        pixel = edges.lens.straight(rows.xy_px[edges.rows[e]]) - middle_px
        turn, shift = _aligned(plane, pixel)
        R.append(turn)
        sideways.append(shift)
        planes.append(plane)
        pixels.append(pixel)
    focal, depth = _focal_and_depths(R, sideways, planes, pixels)
    return focal, Poses(np.array(R), np.column_stack([sideways, depth]))


def _aligned(plane_mm: np.ndarray, pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and sideways shift (2,) of a plane whose points (n, 2) are seen at pixels (n, 2) from the middle.

    A radial displacement moves a pixel along its direction, so X / Y = x_camera / y_camera holds for any of them.
    """
    # ty must not vanish: the origin is moved to the point that lies farthest above or below the middle.
    origin = plane_mm[np.argmax(np.abs(pixel[:, 1]))]
    (x, y), (u, v) = (plane_mm - origin).T, pixel.T
    size = max(float(np.abs(plane_mm - origin).max()), 1e-12)
    rows = np.column_stack([v * x / size, v * y / size, v, -u * x / size, -u * y / size])
    a1, a2, a3, a4, a5 = np.linalg.lstsq(rows, u, rcond=None)[0] / [size, size, 1, size, size]
    # Columns of a rotation are unit vectors at right angles; the smaller root belongs to real cosines.
    total, cross = a1**2 + a2**2 + a4**2 + a5**2, (a1 * a5 - a4 * a2) ** 2
    ty2 = 2 / (total + np.sqrt(max(total**2 - 4 * cross, 0)))
    ty = np.sqrt(ty2)
    far = int(np.argmax((pixel**2).sum(axis=1)))
    if (a4 * x[far] + a5 * y[far] + 1) * ty * v[far] < 0:
        ty = -ty
    r11, r12, tx, r21, r22 = (a * ty for a in (a1, a2, a3, a4, a5))
    r13, r23 = np.sqrt(max(1 - r11**2 - r12**2, 0)), np.sqrt(max(1 - r21**2 - r22**2, 0))
    if r11 * r21 + r12 * r22 > 0:
        r23 = -r23
    best = None
    for sign in (1, -1):  # the sign with which the focal length is positive
        top = np.array([[r11, r12, sign * r13], [r21, r22, sign * r23]])
        turn = nearest_rotation(np.vstack([top, np.cross(top[0], top[1])]))
        shift = np.array([tx, ty]) - turn[:2, :2] @ origin
        focal, _ = _focal_and_depths([turn], [shift], [plane_mm], [pixel])
        if best is None or focal > best[0]:
            best = (focal, turn, shift)
    assert best is not None
    return best[1], best[2]


def _focal_and_depths(
    R: list[np.ndarray], sideways: list[np.ndarray], planes: list[np.ndarray], pixels: list[np.ndarray]
) -> tuple[float, np.ndarray]:
    """One focal length, and the depth of each board: f y_camera - v tz = v (r31 x + r32 y), and the same in x."""
    rows, right = [], []
    for e, (turn, shift, plane, pixel) in enumerate(zip(R, sideways, planes, pixels, strict=True)):
        side = plane @ turn[:2, :2].T + shift
        block = np.zeros((2 * len(plane), 1 + len(R)))
        block[:, 0], block[:, 1 + e] = side.ravel(), -pixel.ravel()
        rows.append(block)
        right.append((pixel * (plane @ turn[2, :2])[:, None]).ravel())
    matrix = np.vstack(rows)
    size = np.linalg.norm(matrix, axis=0)
    solution = np.linalg.lstsq(matrix / size, np.concatenate(right), rcond=None)[0] / size
    return float(solution[0]), solution[1:]
