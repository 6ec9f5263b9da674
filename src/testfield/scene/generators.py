"""Stations and check targets from their generators."""

import numpy as np

from testfield.camera.pose import rotation
from testfield.errors import TestfieldError
from testfield.scene.frames import camera_looking, unit
from testfield.scene.station_parts import (
    Aimed,
    StationArc,
    StationGrid,
    StationPart,
    StationPose,
    StationRandom,
    StationSingle,
)
from testfield.scene.target_parts import CheckGrid, CheckOnBoard, CheckOnMesh, CheckPart, CheckRandom, MeasuringLinePart
from testfield.seeds import Plane, generator, normals
from testfield.targets.field import MeasuringLine

LARGEST_BOX_MM = 1e6
MOST_IN_VAIN = 2000
"""Random places tried in a row without finding one more."""


def stations(parts: tuple[StationPart, ...], seed: int) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names, rotations (n, 3, 3) and translations (n, 3) of camera-from-world poses."""
    names: list[str] = []
    rotations, translations = [], []
    for number, part in enumerate(parts):
        # Counted among its like, so that other stations listed before it leave it where it was.
        nth = sum(isinstance(p, StationRandom) and p.seed == getattr(part, "seed", 0) for p in parts[:number])
        for k, position in enumerate(_station_positions(part, nth, seed)):
            named = isinstance(part, (StationSingle, StationPose)) and part.name
            name = named or f"station{len(names) + 1:02d}"
            if name in names:
                raise TestfieldError(f"two stations are called '{name}'", f"stations[{number}].name", "rename one")
            if isinstance(part, StationPose):
                R = rotation(np.radians(part.rotation_deg))
                t = -R @ position
            else:
                R, t = _looking(part, number, k, position)
            names.append(name)
            rotations.append(R)
            translations.append(t)
    return names, np.array(rotations), np.array(translations)


def _looking(part: Aimed, number: int, k: int, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    try:
        return camera_looking(position, np.array(part.look_at_mm), np.radians(part.roll_deg[k % len(part.roll_deg)]))
    except ValueError as error:
        raise TestfieldError(str(error), f"stations[{number}]", "move position_mm or look_at_mm") from error


def _station_positions(part: StationPart, nth: int, seed: int) -> np.ndarray:
    """(n, 3) positions; `nth` counts the random arrangements of one seed."""
    if isinstance(part, (StationSingle, StationPose)):
        return np.array([part.position_mm], float)
    if isinstance(part, StationArc):
        azimuth = np.radians(
            np.linspace(*part.azimuth_deg, part.count) if part.count > 1 else [np.mean(part.azimuth_deg)]
        )
        x = part.look_at_mm[0] + part.radius_mm * np.sin(azimuth)
        y = part.look_at_mm[1] - part.radius_mm * np.cos(azimuth)
        return np.column_stack([x, y, np.full(part.count, part.height_mm)])
    if isinstance(part, StationGrid):
        return lattice(part.counts, part.low_mm, part.high_mm)
    if isinstance(part, StationRandom):
        low, high = np.array(part.low_mm), np.array(part.high_mm)
        drawn = Plane(seed, f"stations/{nth}/{part.seed}").uniforms(range(1), 3 * part.count).reshape(-1, 3)
        return low + (high - low) * drawn
    axis = unit(np.array(part.axis))
    helper = np.array([0, 0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0, 0])
    first = unit(np.cross(helper, axis))
    angle = 2 * np.pi * np.arange(part.count)[:, None] / part.count
    return np.array(part.centre_mm) + part.radius_mm * (np.cos(angle) * first + np.sin(angle) * np.cross(axis, first))


def lattice(counts: tuple, low: tuple, high: tuple) -> np.ndarray:
    """(n, 3) points of a regular lattice, x fastest; a single point along an axis lies in the middle."""
    axes = [
        np.linspace(a, b, n) if n > 1 else np.array([(a + b) / 2]) for n, a, b in zip(counts, low, high, strict=True)
    ]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def check_cards(
    parts: tuple[CheckPart, ...], seed: int, clear_of: list[tuple[np.ndarray, float]]
) -> list[tuple[int, np.ndarray, np.ndarray, float]]:
    """Check targets on cards of their own: code, position (3,), unit normal (3,), diameter.

    `clear_of` are spheres (centre, radius) that random targets keep out of.
    """
    cards: list[tuple[int, np.ndarray, np.ndarray, float]] = []
    for number, part in enumerate(parts):
        if isinstance(part, (CheckOnBoard, CheckOnMesh)):
            continue
        if isinstance(part, CheckRandom):
            positions, normals = _random_places(part, number, seed, clear_of)
        elif isinstance(part, CheckGrid):
            positions = lattice(part.counts, part.low_mm, part.high_mm)
            normals = np.broadcast_to(unit(np.array(part.normal)), positions.shape)
        else:
            positions, normals = np.array([part.position_mm]), unit(np.array(part.normal))[None]
        first = part.first_code if isinstance(part, (CheckGrid, CheckRandom)) else part.code
        cards += [(first + k, p, n, part.diameter_mm) for k, (p, n) in enumerate(zip(positions, normals, strict=True))]
    return cards


def line_cards(
    parts: tuple[MeasuringLinePart, ...], seed: int
) -> tuple[list[tuple[int, np.ndarray, np.ndarray, float]], list[MeasuringLine]]:
    """Cards of the targets on measuring lines, as `check_cards` gives them, and what the sheet says of the lines.

    The sheet has the lengths of the scene; the true ones differ by draws from their uncertainty.
    """
    cards: list[tuple[int, np.ndarray, np.ndarray, float]] = []
    sheets = []
    for part in parts:
        off = part.u_length_mm * normals(seed, f"measuring_line/{part.name}", len(part.lengths_mm))[:, 0]
        at = np.concatenate([[0.0], part.lengths_mm + off])
        codes = tuple(part.first_code + k for k in range(len(at)))
        along, normal = unit(np.array(part.direction)), unit(np.array(part.normal))
        cards += [
            (code, np.array(part.start_mm) + d * along, normal, part.diameter_mm)
            for code, d in zip(codes, at, strict=True)
        ]
        sheets.append(MeasuringLine(part.name, codes, part.lengths_mm, part.u_length_mm))
    return cards, sheets


def _random_places(
    part: CheckRandom, number: int, seed: int, clear_of: list[tuple[np.ndarray, float]]
) -> tuple[np.ndarray, np.ndarray]:
    edges_mm = np.subtract(part.high_mm, part.low_mm)
    if edges_mm.max() > LARGEST_BOX_MM:
        raise TestfieldError(
            f"the box is {edges_mm.max():.3g} mm long",
            f"check_targets[{number}].high_mm",
            f"give millimetres, {LARGEST_BOX_MM:.0g} at most",
        )
    # No packing of spheres is denser than 0.7405; sieving at random finds no more than about half of that.
    fits = 0.7405 * np.prod(edges_mm + part.spacing_mm) / (np.pi / 6 * max(part.spacing_mm, 1e-9) ** 3)
    if part.count > fits:
        raise TestfieldError(
            f"{part.count} targets {part.spacing_mm:g} mm apart do not fit in the box",
            f"check_targets[{number}]",
            "enlarge the box, or lower count or spacing_mm",
        )
    places: list[np.ndarray] = []
    centres, radii = np.array([c for c, _ in clear_of]).reshape(-1, 3), np.array([r for _, r in clear_of])
    in_vain = 0
    while len(places) < part.count and in_vain < MOST_IN_VAIN:
        if in_vain == 0:
            # Each target has a stream of its own: where another goes, or a board, moves only whom it would touch.
            rng = generator(seed, f"check_targets/{part.first_code + len(places)}/{part.seed}")
        place = rng.uniform(part.low_mm, part.high_mm)
        in_vain += 1
        apart = not places or np.linalg.norm(place - np.array(places), axis=1).min() >= part.spacing_mm
        if apart and (np.linalg.norm(place - centres, axis=1) > radii).all():
            places.append(place)
            in_vain = 0
    if len(places) < part.count:
        raise TestfieldError(
            f"only {len(places)} of {part.count} targets find a place",
            f"check_targets[{number}]",
            "enlarge the box, or lower count or spacing_mm",
        )
    mean = unit(np.array(part.normal))
    helper = np.array([0, 0, 1.0]) if abs(mean[2]) < 0.9 else np.array([1.0, 0, 0])
    first = unit(np.cross(helper, mean))
    names = [f"check_targets/{part.first_code + k}/{part.seed}/attitude" for k in range(part.count)]
    lots = np.array([Plane(seed, name).uniforms(range(1), 2)[0] for name in names])
    flattest = np.cos(np.radians(part.spread_deg))
    tilt = np.arccos(flattest + (1 - flattest) * lots[:, :1])
    turn = 2 * np.pi * lots[:, 1:]
    aside = np.cos(turn) * first + np.sin(turn) * np.cross(mean, first)
    return np.array(places), np.cos(tilt) * mean + np.sin(tilt) * aside
