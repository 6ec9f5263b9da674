"""Where a camera could stand: places on spheres, a grid or around a mesh, from which enough is seen, sharp, and nothing
is in the way of the camera itself."""

from dataclasses import dataclass

import numpy as np

from testfield.calibrate.edges import LEAST_MARKS
from testfield.camera.pose import Poses
from testfield.errors import TestfieldError
from testfield.plan.job import Job
from testfield.scene.frames import camera_looking
from testfield.scene.sight import first_hits, hidden_by_meshes
from testfield.scene.world import TrueMesh
from testfield.simulate.expected import Expected

KINDS = ("sphere", "grid", "mesh")
ROLLS_DEG = (0.0, 90.0)
"""Every place is offered with the camera level and on its side: turning it is what tells the principal point."""
PLACES = 120
SHELLS = (0.75, 1.0, 1.25)
"""Radii of the spheres, as parts of the distance at which the scene's own stations stand."""
GRID_MARGIN = 0.15
FEELERS = 48
CLEARANCE_MM = 300.0


@dataclass(frozen=True)
class Candidates:
    """c places for a camera: `poses` (c) camera-from-world, `look_at_mm` (c, 3), `roll_deg` (c,), and what each may
    expect to see, `expected`, by the number of the candidate."""

    poses: Poses
    look_at_mm: np.ndarray
    roll_deg: np.ndarray
    expected: Expected

    def __len__(self) -> int:
        return len(self.poses)


def candidates_of(
    job: Job,
    kind: str = "sphere",
    range_mm: float | None = None,
    clearance_mm: float = CLEARANCE_MM,
    mesh: str | None = None,
    places: int = PLACES,
) -> Candidates:
    """Candidates of a job of one camera.

    They look at the middle of what is to be measured from `range_mm` away (absent, as far as the scene's own stations).
    Those stay that see a board well enough to be joined to the others and keep `clearance_mm` to every surface.
    Raises `TestfieldError` where a job has several cameras, the mesh is not there, or no candidate is left.
    """
    if job.several:
        raise TestfieldError(
            "stations are proposed for scenes of one camera whose targets stand still",
            f"{job.source}, stations",
            "plan each camera's scene by itself",
        )
    targets = job.world.mark_world_mm
    middle = (targets.min(axis=0) + targets.max(axis=0)) / 2
    eyes = job.poses.origin_mm
    reach = range_mm or float(np.median(np.linalg.norm(eyes - middle, axis=1)))
    if kind == "mesh":
        at, look = _around_mesh(job, mesh, reach if range_mm else None, places)
    elif kind == "grid":
        at = _grid(eyes, places)
        look = np.broadcast_to(middle, at.shape)
    elif kind == "sphere":
        at = middle + np.concatenate([reach * part * _directions(-(-places // len(SHELLS))) for part in SHELLS])
        look = np.broadcast_to(middle, at.shape)
    else:
        raise TestfieldError(f"value '{kind}' is none of {', '.join(KINDS)}", "--candidates", "choose one of them")
    free = _free(job, at, eyes, clearance_mm)
    found = _looking(job, at[free], look[free])
    if not len(found):
        raise TestfieldError(
            f"none of {len(at)} places from {kind} candidates sees a board, sharp and {clearance_mm:g} mm from all",
            f"{job.source}, stations",
            "give another --range-mm or --clearance-mm, or other --candidates",
        )
    return found


def _directions(count: int) -> np.ndarray:
    """(count, 3) unit vectors evenly over the sphere: a Fibonacci lattice."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    across = np.sqrt(1 - z**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), z])


def _grid(eyes: np.ndarray, places: int) -> np.ndarray:
    """(n, 3) lattice over the box in which the scene's own stations stand, a little larger."""
    low, high = eyes.min(axis=0), eyes.max(axis=0)
    pad = GRID_MARGIN * max(float((high - low).max()), 1.0)
    low, high = low - pad, high + pad
    step = float((np.prod(high - low) / places) ** (1 / 3))
    axes = [np.linspace(low[k], high[k], max(2, int(np.rint((high[k] - low[k]) / step)))) for k in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _around_mesh(job: Job, name: str | None, reach_mm: float | None, places: int) -> tuple[np.ndarray, np.ndarray]:
    """Places off a mesh's outside along its normals, evenly by area, and what they look at."""
    names = [mesh.name for mesh in job.world.meshes]
    if not names or (name and name not in names):
        raise TestfieldError(
            f"no mesh is called '{name}'" if names else "the scene has no mesh to stand around",
            f"{job.source}, meshes",
            f"there {'are' if len(names) > 1 else 'is'} {', '.join(names)}" if names else "choose --candidates sphere",
        )
    mesh = job.world.meshes[names.index(name) if name else 0]
    corners = mesh.corners_mm
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    share = (np.arange(places) + 0.5) / places * area.sum()
    face = np.searchsorted(np.cumsum(area), share)
    on = corners[face].mean(axis=1)
    distance = reach_mm or float(np.median(np.linalg.norm(job.poses.origin_mm[:, None] - on[None], axis=2).min(axis=1)))
    return on + distance * mesh.normals[face], on


def _free(job: Job, at: np.ndarray, eyes: np.ndarray, clearance_mm: float) -> np.ndarray:
    """(n,) which places keep a clearance to every surface and lie outside of closed bodies."""
    obstacles = job.expecting[0].obstacles
    feelers, free = _directions(FEELERS), np.ones(len(at), bool)
    for k, place in enumerate(at):
        free[k] = not hidden_by_meshes(place, place + clearance_mm * feelers, obstacles).any()
    closed = tuple(mesh for mesh in job.world.meshes if mesh.closed)
    for mesh in closed:
        inside = free.copy()
        for number in np.flatnonzero(free):
            inside[number] = _inside(mesh, at[number], feelers)
        free &= ~inside
    return free


def _inside(mesh: TrueMesh, place: np.ndarray, feelers: np.ndarray) -> bool:
    """Whether a place is within a closed mesh: rays from there leave it through the backs of its faces."""
    hit, _ = first_hits(np.tile(place, (len(feelers), 1)), feelers, (mesh,))
    met = hit >= 0
    if met.mean() < 0.9:
        return False
    backs = np.einsum("ni,ni->n", mesh.normals[hit[met]], feelers[met]) > 0
    return bool(backs.mean() > 0.5)


def _looking(job: Job, at: np.ndarray, look: np.ndarray) -> Candidates:
    """Those of the places that see a board well enough, at every roll."""
    R, t, aims, rolls = [], [], [], []
    for place, aim in zip(at, look, strict=True):
        for roll in ROLLS_DEG:
            try:
                turn, shift = camera_looking(place, aim, np.radians(roll))
            except ValueError:  # straight up or down has no level
                continue
            R.append(turn)
            t.append(shift)
            aims.append(aim)
            rolls.append(roll)
    if not R:
        return Candidates(Poses.identity(0), np.zeros((0, 3)), np.zeros(0), job.expected.take(np.zeros(0, int)))
    poses = Poses(np.array(R), np.array(t))
    seen = job.expecting[0].at(poses)
    board = job.world.marks.board[seen.mark]
    marks = np.zeros((len(poses), len(job.field.boards)), int)
    np.add.at(marks, (seen.station[board >= 0], board[board >= 0]), 1)
    keep = np.flatnonzero((marks >= LEAST_MARKS).any(axis=1))
    number = np.full(len(poses), -1)
    number[keep] = np.arange(len(keep))
    rows = seen.take(number[seen.station] >= 0)
    rows = Expected(**(vars(rows) | {"station": number[rows.station]}))
    return Candidates(poses[keep], np.array(aims)[keep], np.array(rolls)[keep], rows)
