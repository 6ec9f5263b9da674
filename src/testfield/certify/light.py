"""Light: the fast renderer against Mitsuba's own path tracer, and what its light's noise does to centres."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import kstest, norm

from testfield.camera.project import project
from testfield.certify.verdict import Verdict
from testfield.render.fast import render_fast
from testfield.render.irradiance import compute_irradiance
from testfield.render.path import render_path
from testfield.render.stage import build_stage
from testfield.render.view import render_view
from testfield.scene.schema import RenderPart
from testfield.scene.truth import see
from testfield.scene.world import GLOSS, MATT, RETRO, Gloss, Panels, PointLight, Retro, RingFlash, World

BLOCK = 8
SPACING_MM = 40.0
LIGHTS = 4
"""Independent computations of the fast light, so that its own noise is known."""
FINER = 8
NOISE, SAMPLES = 0.002, 1024
"""To which a coat's reflection is sampled."""


@dataclass(frozen=True)
class Effort:
    """What a comparison costs: image width, the fast light's grid and paths, and the path tracer's renders; and how far
    the means over all boards may then differ, as a part of the mean."""

    width_px: int
    spacing_mm: float
    paths: int
    repeats: int
    samples: int
    mean_limit: float = 1e-3


def certify_light(world: World, quick: bool) -> list[Verdict]:
    """Judge the light on a world with lamps, a room that reflects, and boards: interreflection and gradients; and what
    lights without size, coats and retro-reflecting ink do there."""
    usual = Effort(320, SPACING_MM, 8192, 16, 48) if quick else Effort(320, SPACING_MM, 8192, 40, 256)
    small = Effort(192, 60.0, 2048, 12, 32, 1e-2) if quick else Effort(256, 60.0, 8192, 24, 128, 2e-3)
    others = [verdict for name, other in variants(world).items() for verdict in _against_path(other, small, name)]
    return [*_against_path(world, usual), *_centres_moved(world, quick), *others]


def variants(world: World) -> dict[str, World]:
    """Worlds like this one, in which boards, cards and bars are of other inks and under other lights."""
    printed = np.isin(np.arange(len(world.panels)), world.marks.panel)
    dark = replace(world, lights=(), point_lights=(), sky=None, ambient_radiance=0.0)
    middle, eyes = world.mark_world_mm.mean(axis=0), world.camera_from_world.origin_mm
    distance = float(np.linalg.norm(eyes - middle, axis=1).mean())
    overhead = middle + distance * np.array([0.2, -0.7, 0.6])
    # One watt a steradian and square metre on a square metre at this distance, about what the lamps give.
    power = 3.0 * (distance / 1000) ** 2

    def of(ink: int) -> Panels:
        return replace(world.panels, ink=np.where(printed, ink, MATT))

    flash = RingFlash(0.01 * distance, 16, power, 1.0)
    retro = Retro(300.0, float(np.radians(45)), float(np.radians(0.8)), 0.05)
    return {
        "point light": replace(dark, point_lights=(PointLight(overhead, power),)),
        "ring flash on retro-reflecting ink": replace(dark, flash=flash, panels=of(RETRO), retro=retro),
        "gloss": replace(world, panels=of(GLOSS), gloss=Gloss(0.3, 0.04)),
    }


def _against_path(world: World, effort: Effort, name: str = "") -> list[Verdict]:
    """Means over blocks of board pixels: fast minus path, in units of the path tracer's own scatter."""
    small = _shrunk(world, effort.width_px)
    stage = build_stage(small)
    repeats, samples = effort.repeats, effort.samples
    station = 1 % len(world.station_name)
    on_boards = board_pixels(small, station)
    lights = (compute_irradiance(stage, effort.spacing_mm, effort.paths, 5 + k, lambda _: None) for k in range(LIGHTS))
    fast = np.stack(
        [
            block_means(
                render_view(stage, light, station, 8, NOISE, SAMPLES, 50 + k)[0].values.astype(float), on_boards
            )
            for k, light in enumerate(lights)
        ]
    )
    title = f"{name}: " if name else ""
    runs = np.stack([render_path(stage, station, samples, 100 + k).values for k in range(repeats)]).astype(float)
    blocks = np.stack([block_means(run, on_boards) for run in runs])
    difference = fast.mean(axis=0) - blocks.mean(axis=0)
    # The fast light has noise of its own, alike over a board: it is pooled over all blocks.
    own = fast.var(axis=0, ddof=1).mean() / LIGHTS
    u = np.sqrt(blocks.var(axis=0, ddof=1) / repeats + own)
    z = difference / u
    p_values = 2 * norm.sf(np.abs(z))
    # Student's t of few repeats has wider tails than the normal law; its variance is (n-1)/(n-3).
    expected = np.sqrt((repeats - 1) / (repeats - 3))
    how = f"{len(z)} blocks of {BLOCK} x {BLOCK} board pixels, {repeats} renders of {samples} samples a pixel"
    # One light's noise is common to a whole board, so it does not average out over blocks.
    common = fast.mean(axis=1).var(ddof=1) / LIGHTS
    overall = float(abs(difference.mean()) / np.sqrt((blocks.var(axis=0, ddof=1) / repeats).mean() / len(u) + common))
    return [
        Verdict(
            "light", f"{title}fast minus path, rms of z", float(np.sqrt((z**2).mean()) / expected), 1.25, "sigma", how
        ),
        Verdict(
            "light",
            f"{title}p-values not uniform (Kolmogorov-Smirnov distance)",
            float(kstest(p_values, "uniform").statistic),
            1.95 / np.sqrt(len(z)) + 0.03,
            "",
            "limit: 0.1 % level, and 0.03 for Student's tails",
        ),
        Verdict("light", f"{title}fast minus path, mean over all boards", overall, 3.5, "sigma", how),
        Verdict(
            "light",
            f"{title}the same as a part of the mean",
            float(abs(difference.mean()) / blocks.mean()),
            effort.mean_limit,
            "of mean",
            how,
        ),
    ]


def _centres_moved(world: World, quick: bool) -> list[Verdict]:
    """What the light's noise does to first-moment centres, as a scene has it by default, and what all its error does:
    points that are too far apart err alike every time, and no scatter shows it."""
    stage = build_stage(world)
    seeds, default = 3 if quick else 8, RenderPart()

    def centres(spacing_mm: float, paths: int, seed: int) -> np.ndarray:
        light = compute_irradiance(stage, spacing_mm, paths, seed, lambda _: None)
        return first_moment_centres(world, render_fast(stage, light, 0, 3).values.astype(float))

    usual = np.array([centres(default.light_spacing_mm, default.light_paths, 1000 + k) for k in range(seeds)])
    finer = centres(default.light_spacing_mm / 2, default.light_paths * FINER, 2000)
    how = f"{usual.shape[1]} dots, {seeds} independent computations of the light"
    scatter, error = np.std(usual, axis=0, ddof=1), usual - finer
    return [
        Verdict("light", f"centre {name}, rms", float(np.sqrt((value**2).mean())), 0.0005, "px", how + more)
        for name, value, more in (
            ("scatter from light noise", scatter, ""),
            ("error from light", error, f", against one with {FINER} times the paths at half the spacing"),
        )
    ]


def first_moment_centres(world: World, image: np.ndarray) -> np.ndarray:
    """First moments above the black of all plain dots that station 0 sees fully."""
    views, marks = see(world), world.marks
    centres = []
    for k in np.flatnonzero((marks.code == 0) & (views.visible[0] == 1)):
        half = int(np.ceil(0.75 * views.diameter_px[0, k])) + 3
        x, y = np.rint(views.disc_px[0, k]).astype(int)
        part = image[y - half : y + half + 1, x - half : x + half + 1]
        g = np.arange(-half, half + 1)
        if part.shape != (len(g), len(g)):
            continue
        ink = np.where(np.hypot(*np.meshgrid(g, g)) <= half, part - np.percentile(part, 10), 0)
        centres.append([x + ink.sum(0) @ g / ink.sum(), y + ink.sum(1) @ g / ink.sum()])
    return np.array(centres)


def _shrunk(world: World, width_px: int) -> World:
    """The world seen by a camera of fewer pixels and the same field of view, without blur."""
    scale = width_px / world.interior.width_px
    parameters = world.interior.parameters.copy()
    parameters[:2] *= scale
    parameters[2:4] = (parameters[2:4] + 0.5) * scale - 0.5
    height_px = int(world.interior.height_px * scale) // BLOCK * BLOCK
    interior = replace(world.interior, width_px=width_px, height_px=height_px, parameters=parameters)
    return replace(world, interior=interior, psf_sigma_px=0.0)


def board_pixels(world: World, station: int) -> np.ndarray:
    """(h, w) pixels well inside the outline of a board's image; what stands before it both renderers see alike."""
    import cv2

    mask = np.zeros((world.interior.height_px, world.interior.width_px), np.uint8)
    names = {sheet.name for sheet in world.field.boards}
    # Each side in short pieces, for boards that are bent.
    part = np.linspace(-1, 1, 33)[:-1]
    side = np.column_stack([part, np.full(len(part), -1.0)])
    rim = np.concatenate([side, side[:, ::-1] * [-1, 1], -side, side[:, ::-1] * [1, -1]])
    for k, size in enumerate(world.panels.size_mm):
        corner = (rim if world.panels.bent[k] else np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])) * size / 2
        outline_mm, _ = world.panels.place(np.full(len(corner), k), corner)
        pose = world.camera_from_world[np.full(len(corner), station)]
        outline = project(world.interior, pose, outline_mm)
        if world.panels.name[k] in names and np.isfinite(outline).all():
            if world.panels.bent[k]:
                cv2.fillPoly(mask, [np.rint(outline).astype(np.int32)], 1)
            else:
                cv2.fillConvexPoly(mask, np.rint(outline).astype(np.int32), 1)
    return cv2.erode(mask, np.ones((5, 5), np.uint8)).astype(bool)


def block_means(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Means over the blocks that lie wholly in the mask."""
    h, w = (n // BLOCK * BLOCK for n in values.shape)

    def fold(a: np.ndarray) -> np.ndarray:
        return a[:h, :w].reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK).transpose(0, 2, 1, 3).reshape(-1, BLOCK**2)

    return fold(values)[fold(mask).all(axis=1)].mean(axis=1)
