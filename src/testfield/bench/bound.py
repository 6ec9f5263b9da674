"""The physical limit: the Cramer-Rao bound of each dot's centre (METHODS section 6.1)."""

import numpy as np

from testfield.bench.dots import GROUND, INK, Dots
from testfield.camera.circle import plane_axes
from testfield.camera.project import project_camera
from testfield.detect.disc import disc_in_pixels

POINTS = 512
EVEN, UNEVEN = 8, 10
"""How many parameters are unknown: centre, shape, blur, contrast, background; also the light's gradient."""


def mean_pixels(dots: Dots) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Windows (n, m, m) of the noise-free image in DN, their derivatives (n, 10, m, m), and the windows' first pixels
    (n, 2).

    The parameters are centre, shape (three), blur, contrast, background, and the contrast's gradient in x and y. The
    dots' outlines are followed through the whole lens.
    """
    world = dots.world
    n = len(world.marks)
    pose = world.camera_from_world[np.zeros(n, int)]
    centre = pose.apply(world.mark_world_mm)
    axes = plane_axes(np.einsum("nij,nj->ni", pose.R, world.mark_normal))
    angle = 2 * np.pi * np.arange(POINTS) / POINTS
    rim = np.cos(angle)[:, None] * axes[0][:, None] + np.sin(angle)[:, None] * axes[1][:, None]
    outline = project_camera(world.interior, centre[:, None] + (world.marks.diameter_mm / 2)[:, None, None] * rim)
    first = np.fft.fft(outline, axis=1) * (1j * np.fft.fftfreq(POINTS, 1 / POINTS))[None, :, None]
    tangent = np.fft.ifft(first, axis=1).real
    area = (outline[..., 0] * tangent[..., 1] - outline[..., 1] * tangent[..., 0]).sum(axis=1)
    turn = np.where(area < 0, -1, 1)[:, None]  # the side of the plane that is seen decides the sense
    outline[:, :, :] = np.where(turn[..., None] < 0, outline[:, ::-1], outline)
    tangent = np.where(turn[..., None] < 0, -tangent[:, ::-1], tangent)

    blur = dots.case.blur_px
    half = int(np.ceil(dots.case.diameter_px / 2 * 1.15 + 5 * np.hypot(blur, 0.29) + 1))
    middle = np.rint(dots.xy_px)
    from_centre = outline - dots.xy_px[:, None, :]
    u, v = from_centre[..., 0], from_centre[..., 1]
    zero, one = np.zeros_like(u), np.ones_like(u)
    shapes = [(one, zero), (zero, one), (u, zero), (v, u), (zero, v)]
    by_shape = np.stack([np.stack(s, axis=-1) for s in shapes], axis=1)
    offset = np.arange(-half, half + 1.0)
    grid = np.broadcast_to(offset, (n, len(offset)))
    disc = disc_in_pixels(outline - middle[:, None], tangent, by_shape, np.full(n, blur), grid, grid)

    white_dn = dots.sensor.electrons_per_radiance * dots.light / dots.sensor.gain_e_per_dn
    contrast, ground = ((white_dn * a)[:, None, None] for a in (INK - GROUND, GROUND))
    at = (dots.xy_px - middle)[:, :, None, None]
    dx, dy = offset - at[:, 0], offset[:, None] - at[:, 1]
    spread = blur**2 + 1 / 12
    lit = [d * disc.value - spread * disc.by_shape[:, k] for k, d in ((0, dx), (1, dy))]
    flat = np.ones_like(disc.value)
    jacobian = np.concatenate(
        [contrast[:, None] * disc.by_shape, np.stack([contrast * disc.by_blur, disc.value, flat, *lit], axis=1)], axis=1
    )
    return dots.sensor.sheet.black_level_dn + ground + contrast * disc.value, jacobian, middle - half


def cramer_rao(dots: Dots) -> tuple[np.ndarray, np.ndarray]:
    """Least covariances (n, 2, 2) in px^2 that an unbiased centre can have: light known, and its gradient unknown.

    The noise's variance depends on the mean, so the variance tells of the centre too; both parts are counted. Of a
    ring code the dot alone is taken to tell of the centre.
    """
    mean, jacobian, _ = mean_pixels(dots)
    sheet = dots.sensor.sheet
    variance = sheet.variance_dn2(mean)
    by_mean = sheet.variance_dn2(mean + 0.5) - sheet.variance_dn2(mean - 0.5)
    weight = 1 / variance + 0.5 * (by_mean / variance) ** 2
    flat = jacobian.reshape(len(mean), UNEVEN, -1).astype(float)
    fisher = (flat * weight.reshape(len(mean), 1, -1)) @ np.swapaxes(flat, 1, 2)
    return _centre(fisher[:, :EVEN, :EVEN]), _centre(fisher)


def _centre(fisher: np.ndarray) -> np.ndarray:
    """(n, 2, 2) covariances of the centre, all other parameters unknown."""
    scale = 1 / np.sqrt(np.einsum("nii->ni", fisher))
    inverse = np.linalg.inv(fisher * scale[:, :, None] * scale[:, None, :])
    return (inverse * scale[:, :, None] * scale[:, None, :])[:, :2, :2]


def closed_form_px(dots: Dots) -> float:
    """METHODS' formula for a circle of the longer axis, 1.5023 / SNR sqrt(s / D), in px."""
    edge = np.sqrt(dots.case.blur_px**2 + 1 / 12)
    return float(1.5023 / dots.case.snr * np.sqrt(edge / dots.case.diameter_px))
