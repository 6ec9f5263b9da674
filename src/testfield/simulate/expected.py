"""Observations that are to be expected, before any image and without noise: which station sees which mark, how large,
and with which covariance at best.

The same physics as `observations.py`, made for networks of thousands of targets and hundreds of stations: everything
that can hide something stands in one search tree, and a dot's image is its plane's affine image (to first order in its
size; second order moves only its centre, which no covariance depends on).
"""

from copy import copy
from dataclasses import dataclass, fields

import numpy as np
from scipy.stats import norm

from testfield.camera.circle import plane_axes
from testfield.camera.optics import blur_circle_px
from testfield.camera.pose import Poses
from testfield.camera.project import camera_jacobian, project, project_camera
from testfield.detect.corner_model import HALF_PX
from testfield.scene.exposure import sensor_of
from testfield.scene.schema import SceneFile
from testfield.scene.sight import hidden_by_meshes
from testfield.scene.truth import EDGE_MARGIN_PX
from testfield.scene.world import TrueMesh, World
from testfield.simulate.light import white_and_contrast
from testfield.simulate.observations import OBLIQUE_DEG, bound_px2

RIM = 6
"""Points of a print's rim that must be seen, beside its middle."""
STRIPS = 24
"""Facets along each side of a bent panel that stands in a line of sight."""
LARGEST_BLUR = 0.5
"""Blur circles wider than this part of a dot leave nothing to be found."""
CHUNK = 20_000
RIM_OF_MOVED = 48
EDGE_NODES = 7
CODED = 0.92
"""A coded dot's light is fitted with it and its ring, up to cubic terms; its centre is then worth this part of the
contrast over noise that it would be worth if the light were known, as it is from the neighbours of dots without a code
(8 to 14 % less on rendered boards, 5 to 8 % on cards)."""
CORNER = 0.90
"""The same of a corner, whose light is fitted with it (7 to 11 % less in the rendered scene `charuco`)."""


@dataclass(frozen=True)
class Expected:
    """m observations of marks `mark` (m,) in stations `station` (m,): `xy_px` (m, 2) the marks' projections, `cov_px2`
    (m, 2, 2) their least covariance, `diameter_px` and `obliquity_deg` (m,)."""

    station: np.ndarray
    mark: np.ndarray
    xy_px: np.ndarray
    cov_px2: np.ndarray
    diameter_px: np.ndarray
    obliquity_deg: np.ndarray

    def __len__(self) -> int:
        return len(self.station)

    def take(self, rows: np.ndarray) -> "Expected":
        """The rows of an index or a mask."""
        return Expected(**{name: values[rows] for name, values in vars(self).items()})

    @staticmethod
    def join(parts: list["Expected"]) -> "Expected":
        """All rows in order."""
        return Expected(**{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Expected)})


class Expecting:
    """What marks of a world a camera anywhere may expect to measure; `obstacles` are what can stand in its sight."""

    def __init__(self, scene: SceneFile, world: World):
        self.world = world
        self.least_px = scene.measure.smallest_diameter_px
        self.centre_mm, self.normal = world.mark_world_mm, world.mark_normal
        first, second = plane_axes(self.normal)
        R = world.panels.world_from_panel.R[world.marks.panel]
        self.corner, self.coded = world.marks.corner, world.marks.code > 0
        # Of a corner the two edges that meet in it count, and they run along the board's axes.
        corner = self.corner[:, None]
        first, second = np.where(corner, R[:, :, 0], first), np.where(corner, R[:, :, 1], second)
        self.axes = np.stack([first, second], axis=-1)
        self.radius_mm = world.marks.diameter_mm / 2
        self.printed = world.marks.printed_radius_mm / self.radius_mm
        self.clean = world.mark_clean == 1 if len(world.dirt) else np.ones(len(world.marks), bool)
        panels, of_panel = _panels_as_mesh(world)
        self.obstacles = (panels, *world.meshes)
        sensor = sensor_of(scene)
        white, contrast = white_and_contrast(world, panels, of_panel)
        dn, most = sensor.electrons_per_radiance / sensor.gain_e_per_dn, sensor.sheet.saturation_dn
        self.sheet, self.black_dn = sensor.sheet, sensor.sheet.black_level_dn
        self.dark_dn = np.minimum(dn * (white - contrast), most - self.black_dn)
        self.contrast_dn = np.maximum(np.minimum(dn * white, most - self.black_dn) - self.dark_dn, 1e-6)

    def elsewhere(self, centre_mm: np.ndarray, normal: np.ndarray, diameter_mm: float) -> "Expecting":
        """The same of coded targets (n, 3) that are not there, in the median light; their numbers stand for marks."""
        other, n = copy(self), len(centre_mm)
        other.centre_mm, other.normal = centre_mm, normal
        other.axes = np.stack(plane_axes(normal), axis=-1)
        other.radius_mm = np.full(n, diameter_mm / 2)
        other.printed = np.full(n, self.world.marks.radii.outer)
        other.corner, other.clean = np.zeros(n, bool), np.ones(n, bool)
        other.coded = np.ones(n, bool)
        other.contrast_dn = np.full(n, np.median(self.contrast_dn))
        other.dark_dn = np.full(n, np.median(self.dark_dn))
        return other

    def at(self, poses: Poses) -> Expected:
        """Observations of all marks in full view from camera-from-world poses (S), as if each were a station."""
        parts = [self._from(poses[k : k + 1], k) for k in range(len(poses))]
        return Expected.join(parts)

    def _from(self, pose: Poses, station: int) -> Expected:
        world, interior = self.world, self.world.interior
        eye, R = pose.origin_mm[0], pose.R[0]
        sight = eye - self.centre_mm
        distance = np.linalg.norm(sight, axis=1)
        cosine = np.einsum("mi,mi->m", sight, self.normal) / distance
        mark = np.flatnonzero((cosine > np.cos(np.radians(OBLIQUE_DEG))) & self.clean)
        at_camera = self.centre_mm[mark] @ R.T + pose.t_mm[0]
        with np.errstate(invalid="ignore", divide="ignore"):
            uv = project_camera(interior, at_camera)
            limit = np.array([interior.width_px, interior.height_px]) - 1 - EDGE_MARGIN_PX
            within = np.all((uv >= EDGE_MARGIN_PX) & (uv <= limit), axis=1)
        mark, at_camera, uv = mark[within], at_camera[within], uv[within]
        by_place = camera_jacobian(interior, at_camera)[2] @ R
        spread = by_place @ (self.axes[mark] * self.radius_mm[mark, None, None])
        reach = np.linalg.norm(spread, axis=2) * self.printed[mark, None]
        diameter = 2 * np.sqrt(np.abs(np.linalg.det(spread)))
        blur = blur_circle_px(world.optics, interior.fx, at_camera[:, 2])
        good = np.all((uv - reach >= EDGE_MARGIN_PX) & (uv + reach <= limit), axis=1)
        good &= (diameter >= self.least_px) & (blur < LARGEST_BLUR * diameter)
        mark, uv, spread, diameter, blur = mark[good], uv[good], spread[good], diameter[good], blur[good]
        at_camera = at_camera[good]
        seen = ~self._hidden(eye, mark)
        mark, uv, spread, diameter, blur = mark[seen], uv[seen], spread[seen], diameter[seen], blur[seen]
        weak = self._vignetting(uv, at_camera[seen])
        snr = self._snr(weak, mark)
        # A blur circle of diameter c has the variance c^2 / 16 along each axis.
        edge = np.sqrt(world.psf_sigma_px**2 + 1 / 12 + blur**2 / 16 + (0.5 * world.optics.airy_px) ** 2)
        corner = self.corner[mark]
        if world.motion.moves:
            cov = _of_moved_discs(spread, snr, edge, self._streaks(pose, mark))
        else:
            cov = _of_discs(spread, snr, edge)
        cov[corner] = _of_corners(spread[corner], snr[corner], edge[corner])
        oblique = np.degrees(np.arccos(np.clip(cosine[mark], -1, 1)))
        return Expected(np.full(len(mark), station), mark, uv, cov, diameter, oblique)

    def _streaks(self, pose: Poses, mark: np.ndarray) -> np.ndarray:
        """(k, 2) px by which the images of marks (k,) move from the first to the last moment of the exposure."""
        world, rest = self.world, pose[np.zeros(len(mark), int)]
        ends = [
            project(
                world.interior,
                world.motion.camera_from_rest(rest, np.full(len(mark), side * world.motion.exposure_s / 2)),
                self.centre_mm[mark],
            )
            for side in (-1, 1)
        ]
        return np.nan_to_num(ends[1] - ends[0])

    def _hidden(self, eye: np.ndarray, mark: np.ndarray) -> np.ndarray:
        """(k,) whether anything stands before the middle or the rim of the print of marks (k,)."""
        angle = 2 * np.pi * np.arange(RIM) / RIM
        place = np.vstack([[0.0, 0.0], np.column_stack([np.cos(angle), np.sin(angle)])])
        reach = (self.radius_mm * self.printed)[mark, None, None]
        points = self.centre_mm[mark, None] + reach * np.einsum("kij,pj->kpi", self.axes[mark], place)
        hidden = hidden_by_meshes(eye, points.reshape(-1, 3), self.obstacles)
        return np.any(hidden.reshape(len(mark), len(place)), axis=1)

    def _snr(self, weak: np.ndarray, mark: np.ndarray) -> np.ndarray:
        """(k,) contrast of marks (k,) over the noise that counts along an edge, where `weak` (k,) of the light arrives:
        the mean of the information, which is the squared slope over the variance (METHODS section 6.1)."""
        # A blurred step's squared slope is a Gaussian of half the blur's variance, along which levels go from dark to
        # white: at t of the edge's width the part that is white is the normal distribution of t.
        node, weight = np.polynomial.hermite.hermgauss(EDGE_NODES)
        white = norm.cdf(node) * (weak * self.contrast_dn[mark])[:, None]
        variance = self.sheet.variance_dn2(self.black_dn + (weak * self.dark_dn[mark])[:, None] + white)
        # Variance that grows with the light tells of the edge too: half of (v'/v)^2.
        gain = self.sheet.noise_line()[1]
        information = 1 / variance + 0.5 * (gain / variance) ** 2
        information = (information * (weight / weight.sum())).sum(axis=1)
        worth = np.where(self.corner[mark], CORNER, np.where(self.coded[mark], CODED, 1.0))
        return np.asarray(weak * self.contrast_dn[mark] * np.sqrt(information) * worth)

    def _vignetting(self, uv: np.ndarray, at_camera: np.ndarray) -> np.ndarray:
        """(k,) part of the light that reaches pixels (k, 2) of places (k, 3) in the camera frame."""
        optics, interior = self.world.optics, self.world.interior
        size = np.array([interior.width_px, interior.height_px])
        r2 = ((uv - (size - 1) / 2) ** 2).sum(axis=1) * 4 / (size**2).sum()
        v1, v2, v3 = optics.vignetting
        factor = np.clip(1 + r2 * (v1 + r2 * (v2 + r2 * v3)), 1e-3, 1)
        if optics.natural_vignetting:
            factor = factor * np.maximum(at_camera[:, 2] / np.linalg.norm(at_camera, axis=1), 0.03) ** 4
        return np.asarray(factor)


def _of_discs(spread: np.ndarray, snr: np.ndarray, edge_px: np.ndarray) -> np.ndarray:
    """(n, 2, 2) bound of discs whose half-axes are the columns of `spread` (n, 2, 2), in chunks."""
    moments = spread @ np.swapaxes(spread, 1, 2) / 4
    parts = [slice(k, k + CHUNK) for k in range(0, len(snr), CHUNK)]
    return np.concatenate([bound_px2(moments[p], snr[p], edge_px[p]) for p in parts] or [np.zeros((0, 2, 2))])


def _of_moved_discs(spread: np.ndarray, snr: np.ndarray, edge_px: np.ndarray, streak_px: np.ndarray) -> np.ndarray:
    """(n, 2, 2) bound of discs that move by `streak_px` (n, 2) while they are exposed: an edge is as wide as the blur
    and the part of the streak across it, whose variance is a twelfth of its square, are together."""
    angle = 2 * np.pi * np.arange(RIM_OF_MOVED) / RIM_OF_MOVED
    tangent = np.einsum("nik,kj->nij", spread, np.array([-np.sin(angle), np.cos(angle)]))
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)  # times the element of the rim
    length = np.linalg.norm(normal, axis=1)
    across = np.einsum("ni,nij->nj", streak_px, normal) / length
    width = np.sqrt(edge_px[:, None] ** 2 + across**2 / 12)
    around = np.einsum("nik,nk,njk->nij", normal, 1 / (length * width), normal) * 2 * np.pi / RIM_OF_MOVED
    return np.linalg.inv(around) * (2 * np.sqrt(np.pi) / snr**2)[:, None, None]


def _of_corners(spread: np.ndarray, snr: np.ndarray, edge_px: np.ndarray) -> np.ndarray:
    """(n, 2, 2) bound of corners at which two edges cross (METHODS section 6.1): along each, on both sides as far as
    `spread` (n, 2, 2) and the estimator's window reach, a shift across it is told as a disc's rim tells it."""
    length = np.linalg.norm(spread, axis=1)
    across = np.stack([spread[:, 1], -spread[:, 0]], axis=1) / length[:, None]
    information = np.einsum("nik,nk,njk->nij", across, 2 * np.minimum(length, HALF_PX), across)
    return np.linalg.inv(information) * (2 * edge_px * np.sqrt(np.pi) / snr**2)[:, None, None]


def _panels_as_mesh(world: World) -> tuple[TrueMesh, np.ndarray]:
    """Everything flat or bent that may stand in a line of sight, lamps too, as one mesh; and (f,) whose each face is,
    -1 where it is a lamp's."""
    panels = world.panels
    vertices, faces, owner, count = [], [], [], 0
    for bent, n in ((False, 2), (True, STRIPS + 1)):
        some = np.flatnonzero(panels.bent == bent)
        u, v = np.meshgrid(np.linspace(-0.5, 0.5, n), np.linspace(-0.5, 0.5, n))
        xy = np.column_stack([u.ravel(), v.ravel()]) * panels.size_mm[some, None]
        vertices.append(panels.place(np.repeat(some, n * n), xy.reshape(-1, 2))[0])
        faces.append((_cells(n) + n * n * np.arange(len(some))[:, None, None]).reshape(-1, 3) + count)
        owner.append(np.repeat(some, 2 * (n - 1) ** 2))
        count += n * n * len(some)
    for lamp in world.lights:
        corner = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [1, 1, 0]]) / 2 * [*lamp.size_mm, 0]
        vertices.append(corner @ lamp.world_from_light.R[0].T + lamp.world_from_light.t_mm[0])
        faces.append(_cells(2) + count)
        owner.append(np.full(2, -1))
        count += 4
    return TrueMesh("panels", np.vstack(vertices), np.vstack(faces), 0.5, False), np.concatenate(owner)


def _cells(n: int) -> np.ndarray:
    """(2 (n - 1)^2, 3) triangles of a lattice of n x n points."""
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    return np.concatenate([np.column_stack([a, a + 1, a + n]), np.column_stack([a + 1, a + n + 1, a + n])])
