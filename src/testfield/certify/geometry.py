"""Geometry: are targets' images where optics puts them, and is every edge pixel as full as it should be?

Targets of all sizes and tilts are strewn over a large sensor behind strongly distorting lenses, under light that is the
same everywhere, with ink of albedo 1 on ground of albedo 0: a pixel's value is then its fraction of ink, and the
reference (`reference.py`) says what it has to be.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from testfield.camera.images import Radiance
from testfield.camera.interior import Interior
from testfield.camera.pose import Poses, rotation
from testfield.camera.project import directions
from testfield.certify.reference import Sheet, Window, cells_in_pixels, ink_in_pixels
from testfield.certify.verdict import Verdict
from testfield.render.fast import render_fast
from testfield.render.irradiance import Irradiance
from testfield.render.stage import build_stage
from testfield.scene.world import CHECK, Panels, Print, TrueMarks, World
from testfield.targets.board_pattern import Cells
from testfield.targets.field import Field
from testfield.targets.ring_code import code_words, word_of_number

WIDTH_PX, HEIGHT_PX, STRIP_PX = 4096, 3000, 300
LENSES = {
    2000.0: (-0.12, 0.05, -0.01, 1e-3, -8e-4),
    3478.0: (-0.2, 0.1, -0.05, -1e-3, 1e-3),
    8000.0: (-0.8, 2.0, -4.0, 1e-3, 1e-3),
}
"""k1 k2 k3 p1 p2 for each focal length in px; none folds within the image."""

BITS = 14
CELLS = 3
SPACING_PX = 240.0
DIAMETER_PX = (4.0, 40.0)
TILT_DEG = 65.0
DISTANCE_MM = 3000.0

BENT_FOCAL_PX = 3478.0
BENT_RADIUS_MM = (400.0, 20000.0)

CELL_PX = (2.0, 12.0)

RMS_LIMIT_PX, WORST_LIMIT_PX, VALUE_LIMIT = 2e-4, 1e-3, 5e-4


@dataclass(frozen=True)
class Sample:
    """What was rendered of some targets and what should have been: `diameter_px`, `tilt_deg` (n,), `code` (n,) bool."""

    rendered: list[np.ndarray]
    true: list[Window]
    code: np.ndarray
    diameter_px: np.ndarray
    tilt_deg: np.ndarray

    def centre_errors_px(self) -> np.ndarray:
        """(n, 2) first moments of the rendered windows less those of the true ones."""
        pairs = zip(self.rendered, self.true, strict=True)
        return np.array([_centre(rendered) - _centre(true.values) for rendered, true in pairs])

    def value_errors(self, k: int) -> np.ndarray:
        """Errors of target k's pixels that an edge crosses, as parts of the contrast."""
        crossed = (self.true[k].values > 1e-9) & (self.true[k].values < 1 - 1e-9)
        return (self.rendered[k] - self.true[k].values)[crossed]


def certify_geometry(quick: bool, cells: int = CELLS) -> list[Verdict]:
    """Verdicts on centres and pixel values of dots and of ring codes.

    The whole takes three lenses and some 600 targets; `quick` one lens and the top tenth of its image. `cells` as in
    `render_fast`.
    """
    if quick:
        samples = [render_targets(strewn(3478.0, STRIP_PX), cells)]
    else:
        samples = [render_targets(strewn(focal_px, HEIGHT_PX), cells) for focal_px in LENSES]
    flat = [verdict for kind in (False, True) for verdict in judge(samples, kind)]
    height_px = STRIP_PX if quick else HEIGHT_PX
    squares = judge_squares(render_squares(squared(strewn(BENT_FOCAL_PX, height_px)), cells))
    return [*flat, judge_bent(render_targets(bent(strewn(BENT_FOCAL_PX, height_px)), cells)), squares]


def judge_squares(errors: np.ndarray) -> Verdict:
    """The verdict on pixel values of squares and tags."""
    how = (
        f"{len(errors)} pixels that edges of random cells cross, {CELL_PX[0]:.0f} to {CELL_PX[1]:.0f} px wide, tilted "
        f"up to {TILT_DEG:.0f} degrees, less exact area integrals; the contrast is 1"
    )
    rms = float(np.sqrt(np.mean(errors**2)))
    return Verdict("geometry", "squares and tags: pixel values, rms", rms, VALUE_LIMIT, "1", how)


def squared(world: World, seed: int = 1) -> World:
    """The same panels with cells of random sizes and colours in the place of their targets."""
    random = np.random.default_rng([seed, len(world.panels)])
    depth_mm = world.camera_from_world[np.zeros(len(world.panels), int)].after(world.panels.world_from_panel).t_mm[:, 2]
    prints = []
    for k, mm_a_px in enumerate(depth_mm / world.interior.fx):
        room = world.panels.size_mm[k] - 4 * mm_a_px
        lines = []
        for axis in (0, 1):
            widths = mm_a_px * random.uniform(*CELL_PX, 64)
            # Whole cells as far as there is room, the first of them at least.
            inside = np.cumsum(widths) < room[axis]
            ends = np.concatenate([[0.0], np.cumsum(widths)[inside] if inside.any() else [room[axis]]])
            lines.append(ends - ends[-1] / 2)
        black = random.random((len(lines[1]) - 1, len(lines[0]) - 1)) < 0.5
        black[0, 0] = True
        prints.append(Print(k, Cells(lines[0], lines[1], black)))
    none = np.zeros(0, int)
    marks = TrueMarks(
        panel=none, xy_mm=np.zeros((0, 2)), diameter_mm=np.zeros(0), code=none, role=none, board=none, point=none
    )
    return replace(world, marks=marks, prints=tuple(prints))


def render_squares(world: World, cells: int, alter: Callable[[World], World] = lambda world: world) -> np.ndarray:
    """Errors of all pixels that edges of a world's prints cross, as parts of the contrast; `alter` as below."""
    image = render_fast(build_stage(alter(world)), Irradiance.even(len(world.panels), np.pi), 0, cells)
    errors = []
    for part in world.prints:
        pose = world.camera_from_world[np.zeros(1, int)].after(world.panels.world_from_panel[np.array([part.panel])])
        print_ = part.cells
        true = cells_in_pixels(
            world.interior.parameters, pose.R[0], pose.t_mm[0], print_.x_mm, print_.y_mm, print_.black
        )
        crossed = (true.values > 1e-9) & (true.values < 1 - 1e-9)
        errors.append((true.of(image.values) - true.values)[crossed])
    return np.concatenate(errors)


def judge_bent(sample: Sample) -> Verdict:
    """One verdict on targets that are printed on bent panels."""
    errors = sample.centre_errors_px()
    how = (
        f"first moments of {len(errors)} targets on panels bent to {BENT_RADIUS_MM[0]:.0f} to "
        f"{BENT_RADIUS_MM[1]:.0f} mm either way, less those of exact area integrals over the same windows"
    )
    rms = float(np.sqrt(np.mean(errors**2)))
    return Verdict("geometry", "bent boards: centre by first moments, rms", rms, RMS_LIMIT_PX, "px", how)


def bent(world: World, seed: int = 1) -> World:
    """The same targets on panels bent about random axes, half of them outwards."""
    random = np.random.default_rng([seed, len(world.panels)])
    n = len(world.panels)
    radius_mm = np.exp(random.uniform(np.log(BENT_RADIUS_MM[0]), np.log(BENT_RADIUS_MM[1]), n)) * random.choice(
        [-1, 1], n
    )
    axis_rad = random.uniform(0, np.pi, n)
    return replace(world, panels=replace(world.panels, curvature_per_mm=1 / radius_mm, bend_axis_rad=axis_rad))


def judge(samples: list[Sample], code: bool) -> list[Verdict]:
    """Three verdicts on all dots or on all ring codes."""
    kind = "ring codes" if code else "dots"
    errors = np.concatenate([sample.centre_errors_px()[sample.code == code] for sample in samples])
    values = np.concatenate([s.value_errors(int(k)) for s in samples for k in np.flatnonzero(s.code == code)])
    centre = (
        f"first moments of {len(errors)} rendered {kind} less those of exact area integrals over the same windows; "
        f"dots of {DIAMETER_PX[0]:.0f} to {DIAMETER_PX[1]:.0f} px, tilted up to {TILT_DEG:.0f} degrees, all over"
    )
    pixel = f"{len(values)} pixels that edges of {kind} cross less exact area integrals; the contrast is 1"
    rms, worst = np.sqrt(np.mean(errors**2)), np.hypot(*errors.T).max()
    return [
        Verdict("geometry", f"{kind}: centre by first moments, rms", float(rms), RMS_LIMIT_PX, "px", centre),
        Verdict("geometry", f"{kind}: centre, worst", float(worst), WORST_LIMIT_PX, "px", centre),
        Verdict("geometry", f"{kind}: pixel values, rms", float(np.sqrt(np.mean(values**2))), VALUE_LIMIT, "1", pixel),
    ]


def render_targets(world: World, cells: int, alter: Callable[[World], World] = lambda world: world) -> Sample:
    """Render station 0 of a world of targets and compute what it should be.

    `alter` changes the world that is rendered, not the one that is true: a way to see the verdicts fail.
    """
    n = len(world.panels)
    light = Irradiance.even(n, np.pi)
    image: Radiance = render_fast(build_stage(alter(world)), light, 0, cells)
    camera_from_panel = world.camera_from_world[np.zeros(n, int)].after(world.panels.world_from_panel)
    marks, true = world.marks, []
    words = np.zeros(n, int)
    words[marks.code > 0] = word_of_number(marks.code[marks.code > 0], BITS)
    for k in range(n):
        R, t_mm = camera_from_panel.R[k], camera_from_panel.t_mm[k]
        curvature, axis_rad = world.panels.curvature_per_mm[k], world.panels.bend_axis_rad[k]
        sheet = Sheet(marks.xy_mm[k], 1 / curvature, axis_rad) if curvature else None
        if not sheet:
            t_mm = R[:, :2] @ marks.xy_mm[k] + t_mm
        radius_mm = marks.diameter_mm[k] / 2
        true.append(ink_in_pixels(world.interior.parameters, R, t_mm, radius_mm, int(words[k]), BITS, sheet=sheet))
    sight = camera_from_panel.t_mm / np.linalg.norm(camera_from_panel.t_mm, axis=1, keepdims=True)
    tilt_deg = np.degrees(np.arccos(np.clip(-np.sum(sight * camera_from_panel.R[:, :, 2], axis=1), -1, 1)))
    size_px = marks.diameter_mm * world.interior.fx / camera_from_panel.t_mm[:, 2] / np.sqrt(sight[:, 2])
    return Sample([window.of(image.values) for window in true], true, marks.code > 0, size_px, tilt_deg)


def strewn(focal_px: float, height_px: int, seed: int = 1) -> World:
    """Dots and ring codes by turns, one each on a small tilted panel, all over the topmost rows of a sensor.

    `focal_px` one of `LENSES`; `height_px` rows, fewer of which leave the lens as it is.
    """
    random = np.random.default_rng([seed, int(focal_px)])
    centre_px = ((WIDTH_PX - 1) / 2 + 11.3, (HEIGHT_PX - 1) / 2 - 7.7)
    parameters = np.array([focal_px, focal_px * 1.0003, *centre_px, *LENSES[focal_px]])
    interior = Interior(WIDTH_PX, height_px, parameters)

    columns, rows = int(WIDTH_PX / SPACING_PX), int(height_px / SPACING_PX)
    pixel = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
    n = len(pixel)
    spacing = np.array([WIDTH_PX / columns, height_px / rows])
    pixel = (pixel + 0.5) * spacing - 0.5 + random.uniform(-8, 8, (n, 2))

    sight = directions(interior, pixel)
    depth_mm = DISTANCE_MM * random.uniform(0.9, 1.1, n)
    position = sight / sight[:, 2:] * depth_mm[:, None]
    sight = position / np.linalg.norm(position, axis=1, keepdims=True)
    # The square root shares a wide angle's stretching between along and across the radius.
    diameter_mm = (
        np.exp(random.uniform(np.log(DIAMETER_PX[0]), np.log(DIAMETER_PX[1]), n))
        * depth_mm
        / focal_px
        * np.sqrt(sight[:, 2])
    )
    tilt = np.radians(random.permutation(np.linspace(0, TILT_DEG, n)))
    towards = random.uniform(0, 2 * np.pi, n)
    lean = rotation(tilt[:, None] * np.column_stack([np.cos(towards), np.sin(towards), np.zeros(n)]))
    spin = rotation(random.uniform(0, 2 * np.pi, n)[:, None] * [0, 0, 1.0])
    camera_from_panel = Poses(_facing(sight) @ lean @ spin, position)

    code = np.where(np.arange(n) % 2 == 1, random.integers(1, len(code_words(BITS)) + 1, n), 0)
    extent_mm = diameter_mm / 2 * np.where(code > 0, 3, 1)
    half_mm = 1.15 * extent_mm + 3 * depth_mm / focal_px
    offset = random.uniform(-0.05, 0.05, (n, 2)) * extent_mm[:, None]
    camera_from_world = Poses(rotation(np.array([[1.9, -0.4, 0.6]])), np.array([[20.0, -30.0, DISTANCE_MM]]))
    panels = Panels(
        name=tuple(f"panel{k}" for k in range(n)),
        world_from_panel=camera_from_world.inverse()[np.zeros(n, int)].after(camera_from_panel),
        size_mm=2 * half_mm[:, None] * np.ones(2),
        ground_albedo=np.zeros(n),
        ink_albedo=np.ones(n),
    )
    none = np.full(n, -1)
    return World(
        name="geometry",
        seed=seed,
        field_diagonal_mm=DISTANCE_MM,
        panels=panels,
        marks=TrueMarks(
            panel=np.arange(n),
            xy_mm=offset,
            diameter_mm=diameter_mm,
            code=code,
            role=np.full(n, CHECK),
            board=none,
            point=none,
        ),
        world_from_board=Poses.identity(0),
        station_name=("station",),
        camera_from_world=camera_from_world,
        interior=interior,
        psf_sigma_px=0.0,
        lights=(),
        ambient_radiance=0.0,
        field=Field(BITS, ()),
    )


def _facing(sight: np.ndarray) -> np.ndarray:
    """(n, 3, 3) frames of panels that look straight back along lines of sight (n, 3), columns x, y, z."""
    z = -sight
    x = np.cross([0.0, -1.0, 0.0], z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _centre(values: np.ndarray) -> np.ndarray:
    """(2,) first moments of pixel values, in px from the window's first pixel."""
    rows, columns = (np.arange(size) for size in values.shape)
    return np.array([values.sum(axis=0) @ columns, values.sum(axis=1) @ rows]) / values.sum()
