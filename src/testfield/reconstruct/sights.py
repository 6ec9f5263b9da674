"""Which rays meet at which target: observations as arrays over points and rays, padded where a point has fewer."""

from dataclasses import dataclass, replace

import numpy as np

from testfield.adjust.normals import target_normals
from testfield.calibrate.calibration import Calibration
from testfield.camera.circle import disc_centre_px
from testfield.camera.lens import jacobian_xy
from testfield.camera.pose import cross_matrix
from testfield.camera.project import camera_jacobian, plane_of
from testfield.camera.several import by_camera
from testfield.detect.observations import Observations
from testfield.targets.field import Field


@dataclass(frozen=True)
class Sights:
    """n targets seen by up to k stations.

    `code` (n,); `station` (n, k) places among the calibration's stations; `there` (n, k) which of them are rays at all;
    `xy_px` (n, k, 2) with `cov_px2` (n, k, 2, 2); `moments_px2` (n, k, 2, 2) of the discs' images of targets with
    `radius_mm` (n,), NaN where pixels are projections of the marks' centres.
    """

    code: np.ndarray
    station: np.ndarray
    there: np.ndarray
    xy_px: np.ndarray
    cov_px2: np.ndarray
    moments_px2: np.ndarray
    radius_mm: np.ndarray

    def __len__(self) -> int:
        return len(self.code)

    @property
    def rays(self) -> np.ndarray:
        """(n,) how many rays each point has."""
        return self.there.sum(axis=1)

    def places(self, calibration: Calibration) -> np.ndarray:
        """(n,) from how many places each point is seen: a camera that stays where it is sees it from one."""
        _, place = np.unique(calibration.stations.origin_mm, axis=0, return_inverse=True)
        seen = np.zeros((len(self), int(place.max(initial=-1)) + 1), bool)
        point, slot = np.nonzero(self.there)
        seen[point, place.ravel()[self.station[point, slot]]] = True
        return seen.sum(axis=1)

    def take(self, points: np.ndarray) -> "Sights":
        """Some of the targets."""
        return Sights(**{name: values[points] for name, values in vars(self).items()})

    def without(self, rays: np.ndarray) -> "Sights":
        """The same with the rays in the mask (n, k) turned down."""
        return replace(self, there=self.there & ~rays)


def sights_of(observations: Observations, calibration: Calibration, field: Field) -> Sights:
    """The sights of all loose targets of the field that two calibrated stations or more have measured."""
    rows = observations.measured
    place = {name: k for k, name in enumerate(calibration.station_names)}
    station = np.array([place.get(name, -1) for name in rows.stations], int)[rows.station]
    radius = {code: diameter / 2 for code, diameter in field.loose.items()}
    wanted = np.isin(rows.code, list(radius)) & (rows.board < 0) & (station >= 0)
    here = np.flatnonzero(wanted)
    here = here[np.lexsort((station[here], rows.code[here]))]
    code, first, count = np.unique(rows.code[here], return_index=True, return_counts=True)
    enough = count >= 2
    code, first, count = code[enough], first[enough], count[enough]
    n, k = len(code), int(count.max(initial=2))
    slot = np.arange(k)
    there = slot < count[:, None]
    row = here[np.minimum(first[:, None] + slot, max(len(here) - 1, 0))] if n else np.zeros((0, k), int)
    cov = np.where(there[..., None, None], rows.cov_px2[row], np.eye(2))
    radii = np.array([radius[int(c)] for c in code]) if rows.centre_of_disc else np.full(n, np.nan)
    found = Sights(code, station[row], there, rows.xy_px[row], cov, rows.moments_px2[row], radii)
    return found.take(found.places(calibration) >= 2)


@dataclass(frozen=True)
class Rays:
    """Sights at present values of their points (n, 3): everything the estimators are made of.

    Of every ray: `lines` (n, k, 2, 3), D of METHODS section 1.5, two directions square to the
    ray, whose products with a place's distance from the origin are the residuals `t` times those on the plane before
    the lens; `depth_mm` (n, k); `to_line` (n, k, 2, 2), how a residual in px becomes one of the lines'; `by_point`
    (n, k, 2, 3) and `by_calibration` (n, k, 2, P), derivatives of the pixel; `residual_px` (n, k, 2), observed minus
    predicted; `misclosure` (n, k, 2), by how much the lines miss the points; `plane` (n, k, 2), the ray's place on the
    plane before the lens. All are zero where there is no ray.
    """

    lines: np.ndarray
    depth_mm: np.ndarray
    to_line: np.ndarray
    by_point: np.ndarray
    by_calibration: np.ndarray
    residual_px: np.ndarray
    misclosure: np.ndarray
    plane: np.ndarray

    def reprojected(self) -> "Rays":
        """The same with the image's own coordinates as lines: misclosures are residuals in px."""
        same = np.broadcast_to(np.eye(2), self.to_line.shape)
        return replace(self, lines=self.by_point, to_line=same, misclosure=self.residual_px)


def rays_of(sights: Sights, calibration: Calibration, xyz_mm: np.ndarray) -> Rays:
    """Rays of sights, linearised at points (n, 3)."""
    camera = calibration.camera_of_image[sights.station]
    centre = _centres_of_discs(sights, calibration, camera, xyz_mm)
    parts = [
        _rays_by(k, replace(sights, there=sights.there & (camera == k)), calibration, xyz_mm, centre)
        for k in range(len(calibration.interiors))
    ]
    # What is no ray of a camera is zero in its part.
    if len(parts) == 1:
        return parts[0]
    return Rays(**{name: np.sum([getattr(part, name) for part in parts], axis=0) for name in vars(parts[0])})


def _rays_by(camera: int, sights: Sights, calibration: Calibration, xyz_mm: np.ndarray, centre_px: np.ndarray) -> Rays:
    """The rays of one camera; all of them are given that are `there`."""
    interior, poses = calibration.interiors[camera], calibration.stations
    n, k = sights.there.shape
    R = poses.R[sights.station]
    turned = np.einsum("nkij,nj->nki", R, xyz_mm)
    at_camera = turned + poses.t_mm[sights.station]
    uv, by_interior, by_place = camera_jacobian(interior, at_camera.reshape(-1, 3))
    by_place = by_place.reshape(n, k, 2, 3)
    uv = uv.reshape(n, k, 2)
    residual = sights.xy_px - np.where(np.isfinite(sights.radius_mm)[:, None, None], centre_px, uv)
    # What a disc adds to its centre's projection is taken away before the pixel becomes a ray.
    plane = plane_of(interior, uv + residual)
    slope = jacobian_xy(interior.lens, plane, interior.coefficients) * interior.parameters[:2, None]
    slope = interior.displacement_slope(uv) @ slope if interior.modes else slope
    flat = np.concatenate([np.broadcast_to(np.eye(2), (n, k, 2, 2)), -plane[..., None]], axis=-1)
    good = sights.there & np.isfinite(residual).all(axis=-1) & np.isfinite(plane).all(axis=-1)

    by_calibration = np.zeros((n, k, 2, len(calibration.labels)))
    own = calibration.interior_unknowns(camera)
    names = [name for name in own if name in calibration.labels]
    chosen = [own.index(name) for name in names]
    by_calibration[..., calibration.index(names)] = by_interior.reshape(n, k, 2, len(interior.names))[..., chosen]
    stated = [calibration.station_unknowns(s) for s in range(len(poses))]
    if calibration.states([name for names in stated for name in names]):
        unknowns = np.array([calibration.index(names) for names in stated])
        six = np.concatenate([-by_place @ cross_matrix(turned), by_place], axis=-1)
        index = unknowns[sights.station][:, :, None, :]
        np.put_along_axis(by_calibration, np.broadcast_to(index, (n, k, 2, 6)), six, axis=-1)

    depth = at_camera[..., 2] if len(calibration.interiors) == 1 else np.where(sights.there, at_camera[..., 2], 0)
    to_line = depth[..., None, None] * np.linalg.inv(np.where(good[..., None, None], slope, np.eye(2)))
    keep = good[..., None, None]
    lines = np.where(keep, flat @ R, 0)
    # Measured from the present point, so that nothing is lost in large coordinates.
    misclosure = np.einsum("nkij,nkj->nki", lines, poses.origin_mm[sights.station] - xyz_mm[:, None, :])
    return Rays(
        lines=lines,
        depth_mm=depth,
        to_line=np.where(keep, to_line, 0),
        by_point=np.where(keep, by_place @ R, 0),
        by_calibration=np.where(keep, by_calibration, 0),
        residual_px=np.where(good[..., None], residual, 0),
        misclosure=misclosure,
        plane=np.where(good[..., None], plane, 0),
    )


def _centres_of_discs(sights: Sights, calibration: Calibration, camera: np.ndarray, xyz_mm: np.ndarray) -> np.ndarray:
    """(n, k, 2) centres in px of discs' images, zero where no discs are seen."""
    n, k = sights.there.shape
    if not np.isfinite(sights.radius_mm).any():
        return np.zeros((n, k, 2))
    poses, interiors, by = calibration.stations[sights.station.ravel()], calibration.interiors, camera.ravel()
    normal = target_normals(interiors, by, poses, sights.there, xyz_mm, sights.radius_mm, sights.moments_px2)
    at, facing, radius = (np.repeat(values, k, axis=0) for values in (xyz_mm, normal, sights.radius_mm))
    return by_camera(disc_centre_px, interiors, by, poses, at, facing, radius).reshape(n, k, 2)
