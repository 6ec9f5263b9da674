"""Names, codes and marks of a scene that are there twice, or do not fit."""

import numpy as np
from scipy.spatial import cKDTree

from testfield.errors import TestfieldError
from testfield.scene.board_parts import BoardPart
from testfield.scene.room_parts import MeshPart, SurfacePart
from testfield.scene.schema import SceneFile
from testfield.scene.target_parts import MeasuringLinePart, ScaleBarPart
from testfield.scene.world import World
from testfield.targets.ring_code import code_words


def unique_names(scene: SceneFile, source: str) -> None:
    """Refuse two parts of one name."""
    groups: dict[str, tuple[BoardPart | ScaleBarPart | MeasuringLinePart | SurfacePart | MeshPart, ...]] = {
        "boards": scene.boards,
        "scale_bars": scene.scale_bars,
        "measuring_lines": scene.measuring_lines,
        "room.surfaces": scene.room.surfaces,
        "meshes": scene.meshes,
    }
    owners: dict[str, str] = {}
    for label, parts in groups.items():
        for k, part in enumerate(parts):
            where = f"{label}[{k}]"
            if part.name in owners:
                raise TestfieldError(
                    f"'{part.name}' is also the name of {owners[part.name]}", f"{source}, {where}.name", "rename one"
                )
            owners[part.name] = where


def codes_exist_and_differ(scene: SceneFile, world: World, source: str) -> None:
    """Refuse numbers that no code has, and such as occur twice."""
    codes = world.field.codes
    known = np.arange(1, len(code_words(scene.code_bits)) + 1) if codes is None else np.array(codes.numbers)
    owners: dict[int, str] = {}
    for code, panel in zip(world.marks.code, world.marks.panel, strict=True):
        if code == 0:
            continue
        owner = world.panels.name[panel]
        if code not in known:
            raise TestfieldError(
                f"code number {code} does not exist",
                f"{source}, {owner}",
                f"{scene.code_bits}-bit codes are numbered 1 to {known[-1]}"
                if codes is None
                else f"{codes.title} has the {len(known)} numbers {known[0]} to {known[-1]}",
            )
        if code in owners:
            raise TestfieldError(
                f"code number {code} is used twice",
                f"{source}, {owners[code]} and {owner}",
                "choose another number",
            )
        owners[int(code)] = owner


def marks_fit(scene: SceneFile, world: World, source: str) -> None:
    """Refuse marks that reach over an edge or into each other."""
    for k, board in enumerate(world.field.boards):
        if board.pattern is not None and (2 * board.pattern.half_mm > scene.boards[k].size_mm).any():
            need = " x ".join(f"{v:g}" for v in 2 * board.pattern.half_mm)
            raise TestfieldError(
                f"the pattern is {need} mm and reaches over the edge", f"{source}, boards[{k}].size_mm", "enlarge it"
            )
    marks = world.marks
    printed = marks.printed_radius_mm
    quiet = marks.diameter_mm / 2 * np.where(marks.code > 0, marks.radii.quiet, 1.2)
    for k in np.unique(marks.panel):
        here = np.flatnonzero((marks.panel == k) & ~marks.corner)
        if len(here) == 0:
            continue
        over = np.abs(marks.xy_mm[here]) + printed[here, None] > world.panels.size_mm[k] / 2
        if over.any():
            at = marks.xy_mm[here[np.argmax(over.any(axis=1))]]
            raise TestfieldError(
                f"a mark at ({at[0]:.1f}, {at[1]:.1f}) mm reaches over the edge",
                f"{source}, {world.panels.name[k]}",
                "enlarge size_mm, or move or shrink the zone",
            )
        pair = _too_close(marks.xy_mm[here], quiet[here], printed[here])
        if pair is not None:
            a, b = marks.xy_mm[here[list(pair)]]
            raise TestfieldError(
                f"marks at ({a[0]:.1f}, {a[1]:.1f}) and ({b[0]:.1f}, {b[1]:.1f}) mm are too close",
                f"{source}, {world.panels.name[k]}",
                f"leave each coded target its quiet zone of {marks.radii.quiet:g} dot radii",
            )


def _too_close(xy_mm: np.ndarray, quiet_mm: np.ndarray, printed_mm: np.ndarray) -> tuple[int, int] | None:
    """Two of n marks of which one is printed into the other's quiet zone, the first such pair; None where none is."""
    if len(xy_mm) < 2:
        return None
    tree = cKDTree(xy_mm)
    # Where each mark's nearest keeps off, only so many others can be near; without this there might be all pairs.
    nearest = tree.query(xy_mm, k=2)[1]
    first = nearest[np.arange(len(xy_mm)), (nearest[:, 0] == np.arange(len(xy_mm))).astype(int)]
    for near in (np.column_stack([np.arange(len(xy_mm)), first]), None):
        pairs = tree.query_pairs((quiet_mm + printed_mm).max(), output_type="ndarray") if near is None else near
        i, j = np.sort(pairs, axis=1).T
        need = np.maximum(quiet_mm[i] + printed_mm[j], printed_mm[i] + quiet_mm[j])
        bad = np.linalg.norm(xy_mm[i] - xy_mm[j], axis=1) < need
        if bad.any():
            i, j = i[bad], j[bad]
            k = np.lexsort([j, i])[0]
            return int(i[k]), int(j[k])
    return None
