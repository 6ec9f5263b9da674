"""The outline drawing of every image: where its marks come to lie, as ellipses, before anything is rendered."""

from dataclasses import dataclass

import numpy as np

from testfield.camera.circle import plane_axes
from testfield.camera.interior import Interior
from testfield.camera.project import camera_jacobian, project_camera
from testfield.plan.job import Job

MOST_ROWS = 320_000
"""Marks drawn in all images together; each takes about 8 bytes of a page of 5 MB."""
RIM = 6
"""Points along each side of a board's outline, which a lens bends."""


@dataclass(frozen=True)
class Drawings:
    """What image k shows is in the rows `first[k]` to `first[k + 1]` of `mark` (r,), and what is drawn of it in those
    from `drawn_first[k]` on of `drawn` (d,), which are rows: `xy_px` (d, 2), half-axes `axes_px` (d, 2), longer first,
    and `angle_rad` (d,) of the longer one, from x to y. `outline_px` (o, 4 RIM, 2) of board `outline_board` (o,) in
    image `outline_image` (o,)."""

    first: np.ndarray
    mark: np.ndarray
    drawn_first: np.ndarray
    drawn: np.ndarray
    xy_px: np.ndarray
    axes_px: np.ndarray
    angle_rad: np.ndarray
    outline_image: np.ndarray
    outline_board: np.ndarray
    outline_px: np.ndarray


def drawings_of(job: Job, interiors: tuple[Interior, ...]) -> tuple[Drawings, list[str]]:
    """The drawings of all images, and a note where there are too many marks for all of them."""
    rows, world, notes = job.expected, job.world, []
    order = np.lexsort((rows.mark, rows.station))
    station, mark = rows.station[order], rows.mark[order]
    images = np.arange(len(job.images) + 1)
    step = int(np.ceil(len(order) / MOST_ROWS)) if len(order) else 1
    drawn = np.arange(0, len(order), step)
    if step > 1:
        notes.append(
            f"the stations' drawings show one in {step} of {len(order):,} observations; counts and colours hold all"
        )
    axes, angle = _ellipses(job, interiors, station[drawn], mark[drawn])
    board = world.marks.board[mark]
    pairs = np.unique(np.column_stack([station, board])[board >= 0], axis=0).reshape(-1, 2)
    outline = np.array([_outline(job, interiors[s], s, b) for s, b in pairs]).reshape(-1, 4 * RIM, 2)
    whole = np.isfinite(outline).all(axis=(1, 2))
    return Drawings(
        first=np.searchsorted(station, images),
        mark=mark,
        drawn_first=np.searchsorted(station[drawn], images),
        drawn=drawn,
        xy_px=rows.xy_px[order][drawn],
        axes_px=axes,
        angle_rad=angle,
        outline_image=pairs[whole, 0],
        outline_board=pairs[whole, 1],
        outline_px=outline[whole],
    ), notes


def _ellipses(
    job: Job, interiors: tuple[Interior, ...], station: np.ndarray, mark: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Half-axes (d, 2) and angles (d,) of the affine images of marks in stations."""
    world, poses = job.world, job.poses
    centre, normal = world.mark_world_mm, world.mark_normal
    axes = np.stack(plane_axes(normal), axis=-1) * world.marks.diameter_mm[:, None, None] / 2
    spread = np.zeros((len(mark), 2, 2))
    for s in np.unique(station):
        here = np.flatnonzero(station == s)
        R, m = poses.R[s], mark[here]
        by_place = camera_jacobian(interiors[s], centre[m] @ R.T + poses.t_mm[s])[2]
        spread[here] = by_place @ R @ axes[m]
    values, vectors = np.linalg.eigh(spread @ np.swapaxes(spread, 1, 2))
    return np.sqrt(np.maximum(values[:, ::-1], 0)), np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1])


def _outline(job: Job, interior: Interior, station: int, board: int) -> np.ndarray:
    """(4 RIM, 2) the outline of a board in an image, NaN where the lens does not show it."""
    world, poses = job.world, job.poses
    panel = int(world.marks.panel[np.argmax(world.marks.board == board)])
    t = np.arange(RIM) / RIM - 0.5
    low, high = np.full(RIM, -0.5), np.full(RIM, 0.5)
    side = np.concatenate([np.column_stack(s) for s in ((t, low), (high, t), (-t, high), (low, -t))])
    xyz = world.panels.place(np.full(4 * RIM, panel), side * world.panels.size_mm[panel])[0]
    at_camera = xyz @ poses.R[station].T + poses.t_mm[station]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(at_camera[:, 2:] > 0, project_camera(interior, at_camera), np.nan))
