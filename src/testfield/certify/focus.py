"""Focus and motion: is blur as large as the thin lens and the speed demand, and is it where it belongs?

Dots are rendered sharp and blurred. What blur adds to the second moments of a dot's image is the blur's own second
moments: those of a circle of diameter b are b^2 / 16, those of a streak of length l are l^2 / 12 along it. The expected
values are worked out here from the scene's numbers, not with the renderer's or the truth's code for blur.
"""

from dataclasses import replace

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.motion import Motion, Twist
from testfield.camera.optics import Optics
from testfield.camera.pose import Poses, rotation
from testfield.camera.project import project_camera
from testfield.certify.verdict import Verdict
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.stage import build_stage
from testfield.scene.world import CHECK, Panels, TrueMarks, World
from testfield.targets.field import Field

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 1400, 1000, 1800.0
LENS = (-0.15, 0.1, -0.02, 5e-4, -4e-4)
DEPTH_MM = (1400.0, 3200.0)
DIAMETER_PX, WINDOW_PX = 14.0, 34
PUPIL_MM, FOCUS_MM = 45.0, 2000.0
EXPOSURE_S, ROW_S = 0.02, 2e-5
SLIDE_MM_S, ROLL_RAD_S = 700.0, 1.2
LIMIT, SHIFT_LIMIT_PX, LEAST_BLUR_PX = 0.01, 0.02, 5.0


def certify_focus(quick: bool) -> list[Verdict]:
    """Verdicts on the blur circle, on streaks of moving cameras and targets, and on the rolling shutter."""
    world = _dots(1, 0.5 if quick else 1.0)
    light = Irradiance.even(len(world.panels), np.pi)
    sharp = _Moments(world, light)
    circle = _circle(world, light, sharp)
    slide = Twist(velocity_mm_s=(SLIDE_MM_S, 0.6 * SLIDE_MM_S, 0.0))
    roll = Twist(angular_velocity_rad_s=(0.0, 0.0, ROLL_RAD_S))
    streaks = [
        _streak(world, light, sharp, "camera slides", Motion(camera=slide, exposure_s=EXPOSURE_S)),
        _streak(world, light, sharp, "camera rolls", Motion(camera=roll, exposure_s=EXPOSURE_S)),
        _streak(world, light, sharp, "target slides", Motion(target=slide, exposure_s=EXPOSURE_S)),
    ]
    return [*circle, *streaks, _rolling(world, light, sharp)]


class _Moments:
    """First and second moments (n, 2), (n, 2, 2) of all dots' images in a render."""

    def __init__(self, world: World, light: Irradiance):
        image = render_fast(build_stage(world), light, 0, 3).values.astype(float)
        at = project_camera(world.interior, _in_camera(world))
        offset = np.arange(-WINDOW_PX, WINDOW_PX + 1)
        first, second = [], []
        for x, y in np.rint(at).astype(int):
            part = image[y + offset[0] : y + offset[-1] + 1, x + offset[0] : x + offset[-1] + 1]
            total = part.sum()
            mx, my = part.sum(axis=0) @ offset / total, part.sum(axis=1) @ offset / total
            dx, dy = offset - mx, offset - my
            xx, yy, xy = part.sum(axis=0) @ dx**2, part.sum(axis=1) @ dy**2, dy @ part @ dx
            first.append([x + mx, y + my])
            second.append(np.array([[xx, xy], [xy, yy]]) / total)
        self.first, self.second = np.array(first), np.array(second)


def _circle(world: World, light: Irradiance, sharp: _Moments) -> list[Verdict]:
    optics = Optics(aperture_mm=PUPIL_MM, focus_mm=FOCUS_MM)
    blurred = _Moments(replace(world, optics=optics), light)
    depth = _in_camera(world)[:, 2]
    # Gauss: a point at depth z is imaged c (1/s - 1/z) D wide where the image of depth s is sharp.
    expected = PUPIL_MM * FOCAL_PX * np.abs(1 / FOCUS_MM - 1 / depth) * np.sqrt(np.linalg.det(_stretch(world)))
    added = np.linalg.det(blurred.second - sharp.second)
    measured = 4 * np.maximum(added, 0) ** 0.25
    wide = expected > LEAST_BLUR_PX
    error = np.abs(measured / expected - 1)[wide].max()
    moved = np.hypot(*(blurred.first - sharp.first).T).max()
    how = f"{wide.sum()} dots, blur circles of {expected[wide].min():.1f} to {expected[wide].max():.1f} px"
    return [
        Verdict("focus", "blur circle against the thin lens, worst", float(error), LIMIT, "1", how),
        Verdict("focus", "defocus moves a centre, worst", float(moved), SHIFT_LIMIT_PX, "px", how),
    ]


def _streak(world: World, light: Irradiance, sharp: _Moments, name: str, motion: Motion) -> Verdict:
    blurred = _Moments(replace(world, motion=motion), light)
    flow = _flow_px_s(world, motion) * motion.exposure_s
    expected = np.linalg.norm(flow, axis=1)
    measured = np.sqrt(12 * np.linalg.eigvalsh(blurred.second - sharp.second)[:, 1])
    long = expected > LEAST_BLUR_PX
    error = np.abs(measured / expected - 1)[long].max()
    how = f"{long.sum()} dots, streaks of {expected[long].min():.1f} to {expected[long].max():.1f} px"
    return Verdict("focus", f"streak against speed x exposure, {name}, worst", float(error), LIMIT, "1", how)


def _rolling(world: World, light: Irradiance, sharp: _Moments) -> Verdict:
    """A rolling shutter moves a sliding target's image by speed x the time at which its row is exposed."""
    motion = Motion(target=Twist((SLIDE_MM_S / 2, 0.0, 0.0)), exposure_s=1e-4, row_s=ROW_S)
    shifted = _Moments(replace(world, motion=motion), light).first - sharp.first
    velocity = _flow_px_s(world, motion)
    # The row at which it is seen moves with it: t = (y0 + vy t - middle) row_s.
    time_s = (sharp.first[:, 1] - (world.interior.height_px - 1) / 2) * ROW_S / (1 - velocity[:, 1] * ROW_S)
    expected = velocity * time_s[:, None]
    long = np.linalg.norm(expected, axis=1) > 1
    error = (np.linalg.norm(shifted - expected, axis=1) / np.linalg.norm(expected, axis=1))[long].max()
    how = f"{long.sum()} dots, shifts up to {np.linalg.norm(expected, axis=1).max():.1f} px"
    return Verdict("focus", "rolling shutter's shift against speed x row time, worst", float(error), LIMIT, "1", how)


def _flow_px_s(world: World, motion: Motion) -> np.ndarray:
    """(n, 2) velocities of the dots' images: targets slide against the camera by v and turn against it by w x X."""
    point, R = _in_camera(world), world.camera_from_world.R[0]
    speed = (
        R @ motion.target.velocity_mm_s
        - np.array(motion.camera.velocity_mm_s)
        - np.cross(motion.camera.angular_velocity_rad_s, point)
    )
    flow = FOCAL_PX * (speed[:, :2] - point[:, :2] * speed[:, 2:] / point[:, 2:]) / point[:, 2:]
    return np.einsum("nij,nj->ni", _stretch(world), flow)


def _in_camera(world: World) -> np.ndarray:
    """(n, 3) the dots' centres in the camera's frame."""
    return world.camera_from_world[np.zeros(len(world.marks), int)].apply(world.mark_world_mm)


def _stretch(world: World) -> np.ndarray:
    """(n, 2, 2) how the lens' distortion stretches the image where each dot is."""
    point, step = _in_camera(world), 1e-4
    columns = []
    for axis in (0, 1):
        delta = np.zeros(3)
        delta[axis] = step
        move = delta * point[:, 2:] / FOCAL_PX
        ahead, behind = (project_camera(world.interior, point + sign * move) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * step))
    return np.stack(columns, axis=-1)


def _dots(seed: int, part: float) -> World:
    """White dots on black panels that face the camera at many depths, all over a part of the image, each way."""
    random = np.random.default_rng([seed, 4])
    interior = Interior(
        int(WIDTH_PX * part),
        int(HEIGHT_PX * part),
        np.array([FOCAL_PX, FOCAL_PX, WIDTH_PX / 2 + 5.2, HEIGHT_PX / 2 - 3.7, *LENS]),
    )
    grid = np.stack(np.meshgrid(np.arange(int(12 * part)), np.arange(int(8 * part))), axis=-1).reshape(-1, 2)
    pixel = (grid + 0.5) * [WIDTH_PX / 12, HEIGHT_PX / 8] + random.uniform(-15, 15, grid.shape)
    n = len(pixel)
    depth = random.uniform(*DEPTH_MM, n)
    xy = (pixel - interior.parameters[2:4]) / FOCAL_PX * depth[:, None]
    facing = np.diag([1.0, -1.0, -1.0])
    in_camera = Poses(np.broadcast_to(facing, (n, 3, 3)), np.column_stack([xy, depth]))
    camera = Poses(rotation(np.array([[0.3, -0.2, 1.1]])), np.array([[100.0, -50.0, 400.0]]))
    diameter = DIAMETER_PX * depth / FOCAL_PX
    zero, none = np.zeros(n, int), np.full(n, -1)
    return World(
        name="focus",
        seed=seed,
        field_diagonal_mm=DEPTH_MM[1],
        panels=Panels(
            name=tuple(f"panel{k}" for k in range(n)),
            world_from_panel=camera.inverse()[zero].after(in_camera),
            size_mm=2 * diameter[:, None] * np.ones(2),
            ground_albedo=np.zeros(n),
            ink_albedo=np.ones(n),
        ),
        marks=TrueMarks(
            panel=np.arange(n),
            xy_mm=np.zeros((n, 2)),
            diameter_mm=diameter,
            code=zero,
            role=zero + CHECK,
            board=none,
            point=none,
        ),
        world_from_board=Poses.identity(0),
        station_name=("station",),
        camera_from_world=camera,
        interior=interior,
        psf_sigma_px=0.0,
        lights=(),
        ambient_radiance=0.0,
        field=Field(14, ()),
    )
