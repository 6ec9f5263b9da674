"""Cluttered views to find targets in: a wall, boxes, lines of strokes like text, stripes, squares, bits of dots, bright
rods, bars in front, and sheets of the shapes in `shapes.py`.

Every surface is a small panel under light of its own that slopes across it, so a view is rendered in about a second and
its truth is known.
"""

from dataclasses import dataclass

import numpy as np

from testfield.bench.clutter_world import ClutterPanels, behind, light_of, world_of
from testfield.bench.shapes import HIGHLIGHT, SHAPES, Shapes
from testfield.camera.interior import Interior
from testfield.camera.pose import rotation
from testfield.camera.project import directions, project_camera
from testfield.render.irradiance import Irradiance
from testfield.scene.world import World
from testfield.seeds import generator
from testfield.targets.field import Field
from testfield.targets.marks import RADII
from testfield.targets.ring_code import BITS, code_words

WIDTH_PX, HEIGHT_PX, FOCAL_PX = 1280, 960, 1600.0
SIZES_PX = ((8.0, 12.0), (12.0, 20.0), (20.0, 36.0))
"""Diameters of the targets of a view, of the circle of the dot's area; views take turns."""
LARGEST_TILT_DEG = 70.0
BLUR_OF_SEGMENT, BLUR_OF_DOT = 0.29, 0.15
"""Largest blur, as parts of a segment's width in the ring's middle and of a dot's diameter: more blurred, no ring could
be read, and an 8 px dot not be told from a square."""


@dataclass(frozen=True)
class ClutteredView:
    """A world of one station and its light; n targets at `xy_px` (n, 2) with `code` (n,), 0 plain, `diameter_px` (n,)
    of the dot's area, `tilt_deg` (n,), and whether nothing hides or cuts any of them: `clear` (n,)."""

    world: World
    light: Irradiance
    xy_px: np.ndarray
    code: np.ndarray
    diameter_px: np.ndarray
    tilt_deg: np.ndarray
    clear: np.ndarray


def cluttered_view(seed: int, index: int, targets: bool = True) -> ClutteredView:
    """View number `index`: code length, ring's shape, polarity, sizes and blur follow from the number by turns."""
    random = generator(seed, f"clutter/{index}")
    bits = BITS[index % len(BITS)]
    shape = list(RADII)[index // 2 % 2]
    white_on_black = index // 3 % 3 != 2
    smallest, largest = SIZES_PX[index // 6 % len(SIZES_PX)]
    segment_px = np.pi * (RADII[shape].inner + RADII[shape].outer) / 2 * smallest / bits
    blur_px = random.uniform(0.4, min(3.0, BLUR_OF_SEGMENT * segment_px, BLUR_OF_DOT * smallest))
    parameters = np.array([FOCAL_PX, FOCAL_PX, 0.5 * WIDTH_PX, 0.5 * HEIGHT_PX, -0.1, 0.03, 0, 2e-4, -3e-4])
    interior = Interior(WIDTH_PX, HEIGHT_PX, parameters)
    panels = ClutterPanels(random)
    marks: list[tuple[int, np.ndarray, float, int]] = []
    _background(panels, marks, random)
    rows = (
        _targets(panels, marks, random, interior, (smallest, largest), shape, bits, white_on_black) if targets else []
    )
    bars = _bars(panels, random)
    shapes = _shapes(panels, blur_px, generator(seed, f"clutter/{index}/shapes"))

    panel = [marks[k][0] for k in rows]
    at = np.array([panels.rows[p][0] for p in panel]).reshape(-1, 3)
    R = np.array([panels.rows[p][1] for p in panel]).reshape(-1, 3, 3)
    radius_mm = np.array([marks[k][2] / 2 for k in rows])
    sight = at / np.linalg.norm(at, axis=1, keepdims=True)
    cosine = np.abs(np.sum(sight * R[:, :, 2], axis=1))
    diameter_px = 2 * radius_mm * FOCAL_PX / at[:, 2] * np.sqrt(cosine / np.maximum(sight[:, 2], 0.1))
    world = world_of(
        panels, marks, shapes, interior, blur_px, Field(bits, (), white_on_black=white_on_black, code_radii=shape)
    )
    code = np.array([marks[k][3] for k in rows], int)
    # A dot needs as much around it as its ring would, or a little ground.
    reach = np.where(code > 0, RADII[shape].outer + 0.4, 1.7)
    extent_px = diameter_px / np.sqrt(cosine) / 2 * reach
    xy_px = project_camera(interior, at) if len(at) else np.zeros((0, 2))
    inside = ((xy_px > extent_px[:, None]) & (xy_px < [WIDTH_PX, HEIGHT_PX] - extent_px[:, None])).all(axis=1)
    clear = inside & ~behind(xy_px, extent_px, at[:, 2], [panels.rows[k] for k in [*panel, *bars]], interior)
    tilt_deg = np.degrees(np.arccos(np.clip(cosine, 0, 1)))
    return ClutteredView(world, light_of(panels, shapes), xy_px, code, diameter_px, tilt_deg, clear)


def _turn(random: np.random.Generator, largest_tilt: float) -> np.ndarray:
    """The frame of a panel that looks at the camera, but for a tilt (rad) and a turn of its own."""
    towards = random.uniform(0, 2 * np.pi)
    tilt = random.uniform(0, largest_tilt)
    lean = rotation(tilt * np.array([np.cos(towards), np.sin(towards), 0]))
    spin = rotation(np.array([0, 0, random.uniform(0, 2 * np.pi)]))
    return lean @ np.diag([1.0, -1.0, -1.0]) @ spin


def _place(random: np.random.Generator, near_mm: float, far_mm: float) -> np.ndarray:
    depth = random.uniform(near_mm, far_mm)
    return depth * np.array([random.uniform(-0.45, 0.45), random.uniform(-0.35, 0.35), 1.0])


def _background(panels: ClutterPanels, marks: list, random: np.random.Generator) -> None:
    tone = random.uniform(0.03, 0.8)
    panels.add(
        np.array([0, 0, 6500.0]), rotation(np.array([0.1, 0.1, 0])) @ np.diag([1.0, -1, -1]), (9000, 8000), tone, 0
    )
    for _ in range(14):  # boxes
        box = (random.uniform(80, 1400), random.uniform(80, 1400))
        panels.add(_place(random, 4600, 5800), _turn(random, 1.1), box, random.uniform(0.02, 0.9), 0)
    for _ in range(7):  # lines of strokes, like text
        at, R = _place(random, 4000, 4500), _turn(random, 0.8)
        paper, print_, height = random.uniform(0.02, 0.9), random.uniform(0.02, 0.9), random.uniform(15, 70)
        panels.add(at, R, (height * 16, height * 5), paper, 0)
        for row in (-1.5, 0, 1.5):
            for column in range(14):
                stroke = (height * random.uniform(0.1, 0.5), height * random.uniform(0.2, 1))
                offset = np.array([(column - 6.5) * height, row * height, 1.0])
                turn = rotation(np.array([0, 0, random.choice([0, np.pi / 2, 0.4])]))
                panels.add(at + R @ offset, R @ turn, stroke, print_, 0)
    for _ in range(2):  # stripes
        at, R, width = _place(random, 4000, 4500), _turn(random, 1.0), random.uniform(10, 60)
        for k in range(10):
            panels.add(at + R @ np.array([2 * k * width, 0, 0]), R, (width, 700), random.choice([0.05, 0.85]), 0)
    for _ in range(25):  # square blobs of targets' sizes, and pieces of dots that a panel's edge cuts
        size = random.uniform(15, 90)
        panels.add(_place(random, 3600, 3900), _turn(random, 1.0), (size, size), random.uniform(0.02, 0.9), 0)
    for _ in range(15):
        size, dark = random.uniform(60, 260), random.random() < 0.5
        panel = panels.add(
            _place(random, 3500, 3590), _turn(random, 1.0), (size, size), *((0.05, 0.8) if dark else (0.8, 0.05))
        )
        cut = random.uniform(-0.5, 0.5)
        marks.append((panel, size * np.array([0.5, cut]), size * random.uniform(0.3, 0.8), 0))


def _shapes(panels: ClutterPanels, blur_px: float, random: np.random.Generator) -> Shapes:
    """Sheets of shapes in rows, shapes anywhere, and rods that shine; all of it behind the targets."""
    # The pixel blurs too, as much as a Gaussian of 0.29 px; tilt makes what is there half as wide.
    shapes = Shapes(2 * np.hypot(blur_px, 0.29) * 3800 / FOCAL_PX)
    for _ in range(4):
        at, R, pitch = _place(random, 3900, 4400), _turn(random, 1.0), np.exp(random.uniform(*np.log([30, 120])))
        paper, print_ = random.permutation([random.uniform(0.02, 0.3), random.uniform(0.45, 0.9)])
        sheet = panels.add(at, R, (9 * pitch, 7 * pitch), paper, 0)
        panels.rows[sheet] = (*panels.rows[sheet][:5], np.full(4, level := random.uniform(0.35, 1.0)))
        for k in range(48):
            cell, kind = np.array([k % 8 - 3.5, k // 8 - 2.5, 0]) * pitch, SHAPES[int(random.integers(len(SHAPES)))]
            size = pitch * random.uniform(0.15, 0.42)
            shapes.add(at + R @ (cell + [0, 0, 0.5]), R, size, kind, level * print_, level * paper, random)
    flat = [kind for kind in SHAPES if kind[0] != HIGHLIGHT]
    for _ in range(60):
        at, size = _place(random, 3500, 3590), np.exp(random.uniform(*np.log([5, 60])))
        kind = flat[int(random.integers(len(flat)))]
        shapes.add(at, _turn(random, 1.0), size, kind, random.uniform(0.02, 0.9), 0, random)
    for _ in range(8):
        length = random.uniform(30, 500)
        rod = panels.add(_place(random, 3620, 3700), _turn(random, 1.0), (length, random.uniform(4, 20)), 0.9, 0)
        panels.rows[rod] = (*panels.rows[rod][:5], np.full(4, random.uniform(0.8, 3.0)))
    return shapes


def _targets(
    panels: ClutterPanels,
    marks: list,
    random: np.random.Generator,
    interior: Interior,
    sizes_px: tuple[float, float],
    shape: str,
    bits: int,
    white_on_black: bool,
) -> list[int]:
    """Targets on cards all over the image, every fourth one plain; the indices of their marks."""
    quiet = RADII[shape].quiet
    spacing = 1.02 * quiet * sizes_px[1] / np.sqrt(np.cos(np.radians(0.6 * LARGEST_TILT_DEG)))
    columns, rows = int(WIDTH_PX / spacing), int(HEIGHT_PX / spacing)
    ink = random.uniform(0.6, 0.9), random.uniform(0.02, 0.1)
    ground, print_ = (ink[1], ink[0]) if white_on_black else ink
    mine = []
    for k in range(columns * rows):
        if random.random() < 0.15:
            continue
        pixel = (np.array([k % columns, k // columns]) + 0.5) * spacing + random.uniform(-0.1, 0.1, 2) * spacing
        depth = random.uniform(2000, 3300)
        at = directions(interior, pixel[None])[0] * depth
        tilt = np.radians(LARGEST_TILT_DEG) * np.sqrt(random.random())
        towards = random.uniform(0, 2 * np.pi)
        lean = rotation(tilt * np.array([np.cos(towards), np.sin(towards), 0]))
        facing = _facing(at)
        R = facing @ lean @ rotation(np.array([0, 0, random.uniform(0, 2 * np.pi)]))
        size_px = np.exp(random.uniform(*np.log(sizes_px)))
        diameter = size_px / np.sqrt(np.cos(tilt)) * depth / FOCAL_PX
        code = 0 if k % 4 == 3 else int(random.integers(1, len(code_words(bits)) + 1))
        side = diameter * quiet
        panel = panels.add(at, R, (side, side), ground, print_)
        mine.append(len(marks))
        marks.append((panel, np.zeros(2), diameter, code))
    return mine


def _facing(at: np.ndarray) -> np.ndarray:
    z = -at / np.linalg.norm(at)
    x = np.cross([0.0, -1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _bars(panels: ClutterPanels, random: np.random.Generator) -> list[int]:
    """Dark and bright bars in front of everything."""
    made = []
    for _ in range(4):
        size = (random.uniform(5, 25), random.uniform(150, 700))
        made.append(
            panels.add(_place(random, 900, 1300), _turn(random, 0.5), size, random.choice([0.03, 0.4, 0.85]), 0)
        )
    return made
