"""Boards of dots on which one thing is as wanted: size, tilt, noise, blur, light, place on the pixels' grid, a ring."""

from dataclasses import dataclass, field, replace

import numpy as np

from testfield.camera.circle import disc_image
from testfield.camera.images import Radiance
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation
from testfield.camera.project import directions
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.stage import build_stage
from testfield.scene.world import CHECK, Panels, TrueMarks, World
from testfield.seeds import generator
from testfield.sensor.expose import Sensor
from testfield.targets.code_table import CodeTable
from testfield.targets.field import Field
from testfield.targets.marks import USUAL, ring_radii
from testfield.targets.ring_code import code_words

FOCAL_PX, LENS, ASIDE_PX = 3478.0, (-0.2, 0.1, -0.05, 1e-3, -1e-3), 700.0
"""Focal length, k1 k2 k3 p1 p2, and how far from the principal point the board is seen."""
DISTANCE_MM, AZIMUTH_RAD = 3000.0, 0.5
SIDE = 8
CELLS = 6
INK, GROUND = 0.85, 0.04
CODE_STEP = 37
"""By how much neighbours' numbers differ."""


@dataclass(frozen=True)
class Case:
    """What the dots of one board are like.

    `diameter_px` the longer axis; `tilt_deg` against the line of sight; `snr` contrast over the noise at the edge;
    `blur_px` of the optics; `gradient` of the light over one diameter, as a part of it; `phase` (x, y) of all centres
    on the pixels' grid, or None for any; `coded` whether each dot is the middle of a ring code, of so many `bits`,
    the shape `radii` and the table `codes`, which change none of the random places.
    """

    diameter_px: float = 12.0
    tilt_deg: float = 20.0
    snr: float = 50.0
    blur_px: float = 0.7
    gradient: float = 0.0
    phase: tuple[float, float] | None = None
    coded: bool = False
    bits: int = field(default=14, repr=False)
    radii: str = field(default=USUAL, repr=False)
    codes: CodeTable | None = field(default=None, repr=False)


@dataclass(frozen=True)
class Dots:
    """A rendered board: `radiance`, the `sensor` that makes the wanted noise, and the truth of its n dots: `xy_px`
    (n, 2) centres of area and `moments_px2` (n, 2, 2) of the discs' images; `world` and its `light` (n,) in units of
    the light at the board's middle."""

    case: Case
    world: World
    radiance: Radiance
    sensor: Sensor
    xy_px: np.ndarray
    moments_px2: np.ndarray
    light: np.ndarray


def render_dots(case: Case, seed: int, cells: int = CELLS) -> Dots:
    """Render a case without noise."""
    world = _world(case, seed)
    marks = world.marks
    n = len(marks)
    poses = world.camera_from_world[np.zeros(n, int)]
    true = disc_image(world.interior, poses, world.mark_world_mm, world.mark_normal, marks.diameter_mm / 2)
    width_mm = world.panels.size_mm[0, 0]
    slope = case.gradient / (case.diameter_px * DISTANCE_MM / FOCAL_PX)  # a mm
    nodes = np.pi * (1 + slope * width_mm / 2 * np.array([-1.0, 1, -1, 1]))
    if nodes.min() < 0:
        raise ValueError(f"the light would be negative at the board's rim: {case}")
    even = Irradiance.even(1, np.pi)
    irradiance = replace(even, values=nodes.astype(np.float32))
    radiance = render_fast(build_stage(world), irradiance, 0, cells)
    light = 1 + slope * marks.xy_mm[:, 0]
    return Dots(case, world, radiance, sensor_of(case.snr), true.centroid_px, true.moments_px2, light)


def sensor_of(snr: float) -> Sensor:
    """A sensor exposed so that ink's contrast with the ground is `snr` times the noise halfway up an edge."""
    sensor = Sensor(3.45, 8.0, 1.0, 550.0, 0.6, 1e6, 2.3, 1.0, 64.0, 16)
    read_e2 = sensor.read_noise_e**2 + sensor.gain_e_per_dn**2 / 12
    a, b = INK - GROUND, (INK + GROUND) / 2
    # (a L)^2 = snr^2 (read^2 + b L) for the electrons L that white paper gives.
    electrons = snr**2 * (b + np.sqrt(b * b + 4 * a * a * read_e2 / snr**2)) / (2 * a * a)
    return replace(sensor, time_ms=electrons / sensor.electrons_per_radiance)


def _world(case: Case, seed: int) -> World:
    random = generator(seed, f"bench/{case}")
    across = 1.2 + ring_radii(case.radii).outer if case.coded else 2.2
    pitch = int(np.ceil(across * case.diameter_px + 12 * case.blur_px + 6))
    size = SIDE * pitch
    lens = LENS if case.phase is None else (0.0,) * 5
    principal = np.array([size / 2 - ASIDE_PX, size / 2 + ASIDE_PX / 2])
    interior = Interior(size, size, np.array([FOCAL_PX, FOCAL_PX, *principal, *lens]))
    grid = (np.arange(SIDE) + 0.5) * pitch
    pixel = np.floor(np.stack(np.meshgrid(grid, grid), -1).reshape(-1, 2))
    pixel += random.uniform(-0.5, 0.5, pixel.shape) if case.phase is None else np.array(case.phase)

    sight = directions(interior, np.array([[size / 2, size / 2]]))[0]
    sight /= np.linalg.norm(sight)
    z = -sight
    x = np.cross([0.0, -1.0, 0.0], z)
    x /= np.linalg.norm(x)
    facing = np.stack([x, np.cross(z, x), z], axis=-1)
    lean = np.radians(case.tilt_deg) * np.array([np.cos(AZIMUTH_RAD), np.sin(AZIMUTH_RAD), 0])
    R, middle = facing @ rotation(lean), sight * DISTANCE_MM
    rays = directions(interior, pixel)
    depth = (R[:, 2] @ middle) / (rays @ R[:, 2])
    xy_mm = (rays * depth[:, None] - middle) @ R[:, :2]

    n = len(pixel)
    zero, none = np.zeros(n, int), np.full(n, -1)
    known = np.arange(1, len(code_words(case.bits)) + 1) if case.codes is None else np.array(case.codes.numbers)
    code = known[CODE_STEP * np.arange(n) % len(known)] if case.coded else zero
    largest_mm = 2.5 * np.abs(xy_mm).max()
    pose = Poses(np.eye(3)[None], np.zeros((1, 3)))
    return World(
        name="dots",
        seed=seed,
        field_diagonal_mm=DISTANCE_MM,
        panels=Panels(
            name=("board",),
            world_from_panel=Poses(R[None], middle[None]),
            size_mm=np.full((1, 2), largest_mm),
            ground_albedo=np.array([GROUND]),
            ink_albedo=np.array([INK]),
        ),
        marks=TrueMarks(
            panel=zero,
            xy_mm=xy_mm,
            diameter_mm=case.diameter_px * depth / FOCAL_PX,
            code=code,
            role=np.full(n, CHECK),
            board=none,
            point=none,
            radii=ring_radii(case.radii),
        ),
        world_from_board=Poses.identity(0),
        station_name=("station",),
        camera_from_world=pose,
        interior=interior,
        psf_sigma_px=case.blur_px,
        lights=(),
        ambient_radiance=0.0,
        field=Field(case.bits, (), code_radii=case.radii, codes=case.codes),
    )
