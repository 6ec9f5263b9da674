"""Drawings of a camera that photographs calibrated: how its image was covered, its residuals and their smooth part."""

from contextlib import AbstractContextManager, suppress
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from testfield.calibrate.calibration import Calibration
from testfield.report.figures import _round_up
from testfield.report.style import ACCENT, FAINT, INK, WARM, figure, svg_of

COLUMNS = 16
"""Cells along the longer side of an image."""
MOST_ARROWS = 1500
SMOOTH_PART = 1 / 12
"""Sigma of the Gaussian that smooths residuals, in the image's longer side."""
LEAST_WEIGHT = 5.0
"""Observations that a smoothed residual rests on at least."""
NEAR = 0.6
"""Weight of the nearest of them at least: at a sigma's distance."""
SIGNIFICANT = 3.0
"""Length of a smoothed residual, in its standard deviation by chance, from which it is no chance."""


def coverage(c: Calibration) -> tuple[bytes, dict[str, float]]:
    """Cells of the image by how many observations were used in them; and figures: parts of the image within the
    outline and in cells that have any, and the largest distance from the middle in the corner's."""
    interior, xy = c.interior, c.residual_at_px
    cell = max(interior.width_px, interior.height_px) / COLUMNS
    columns, rows = max(1, round(interior.width_px / cell)), max(1, round(interior.height_px / cell))
    edges = (np.linspace(0, interior.width_px, columns + 1), np.linspace(0, interior.height_px, rows + 1))
    count = np.histogram2d(xy[:, 0], xy[:, 1], bins=edges)[0].T
    middle = np.array([interior.width_px, interior.height_px]) / 2
    part, ring = outlined(xy, interior.width_px, interior.height_px)
    said = {
        "outline": 100 * part,
        "cells": 100 * float((count > 0).mean()),
        "radius": 100 * float(np.linalg.norm(xy - middle, axis=1).max(initial=0) / np.linalg.norm(middle)),
    }
    with _image(c) as (drawing, axes):
        most = max(float(count.max(initial=0)), 1.0)
        axes.imshow(
            np.where(count > 0, np.sqrt(count / most), np.nan),
            extent=(0, interior.width_px, interior.height_px, 0),
            cmap="Blues",
            vmin=0,
            vmax=1.6,
            interpolation="nearest",
        )
        axes.scatter(*xy.T, s=1.6, color=INK, lw=0, alpha=0.6)
        axes.plot(*ring.T, color=WARM, lw=1)
        _frame(axes, c)
        return svg_of(drawing), said


def outlined(xy_px: np.ndarray, width_px: int, height_px: int) -> tuple[float, np.ndarray]:
    """The part of an image within the convex outline of points (n, 2), and its corners (k, 2), the first one again at
    the end; nothing where all lie on a line."""
    with suppress(QhullError):
        if len(xy_px) > 2:
            hull = ConvexHull(xy_px)
            corners = np.append(hull.vertices, hull.vertices[0])
            return float(hull.volume / (width_px * height_px)), xy_px[corners]
    return 0.0, np.zeros((0, 2))


def residual_vectors(c: Calibration) -> bytes:
    """The residual of every observation (of every so many where there are very many)."""
    chosen = np.arange(0, len(c.residual_at_px), max(1, -(-len(c.residual_at_px) // MOST_ARROWS)))
    with _image(c) as (drawing, axes):
        _arrows(axes, c, c.residual_at_px[chosen], c.residual_px[chosen], ACCENT, 22)
        _frame(axes, c)
        return svg_of(drawing)


def smooth_part(c: Calibration) -> tuple[bytes, dict[str, float | None]]:
    """Residuals averaged over their neighbourhood, those that chance does not explain in colour; beside them what the
    adjustment has found smooth and corrected already. Figures: rms of what is left and of what was corrected, px."""
    interior = c.interior
    span = max(interior.width_px, interior.height_px)
    step = span / COLUMNS
    x, y = np.meshgrid(np.arange(step / 2, interior.width_px, step), np.arange(step / 2, interior.height_px, step))
    at = np.column_stack([x.ravel(), y.ravel()])
    mean, chance = smoothed(c.residual_at_px, c.residual_px, at, SMOOTH_PART * span)
    there = np.isfinite(mean).all(axis=1)
    sure = there & (np.linalg.norm(np.nan_to_num(mean), axis=1) > SIGNIFICANT * chance)
    corrected = interior.displacement(at) if interior.field_px is not None else None
    said: dict[str, float | None] = {
        "left": float(np.sqrt((mean[there] ** 2).sum(axis=1).mean())) if there.any() else None,
        "by_chance": float(np.sqrt((chance[there] ** 2).mean())) if there.any() else None,
        "sure": 100 * float(sure[there].mean()) if there.any() else None,
        "corrected": None,
    }
    with _image(c) as (drawing, axes):
        if corrected is not None and there.any():
            said["corrected"] = float(np.sqrt((corrected[there] ** 2).sum(axis=1).mean()))
            _arrows(axes, c, at[there], corrected[there], FAINT, COLUMNS, 0.3, "corrected: ")
        if there.any():
            # What chance makes must not look like a pattern.
            unit = float(_round_up(max(_unit(mean[there]), SIGNIFICANT * float(np.median(chance[there])))))
            _arrows(axes, c, at[there], mean[there], ACCENT, COLUMNS, 0.84, "left: ", unit)
            _arrows(axes, c, at[sure], mean[sure], WARM, COLUMNS, unit=unit, key=False)
        _frame(axes, c)
        return svg_of(drawing), said


def smoothed(xy: np.ndarray, vectors: np.ndarray, at: np.ndarray, sigma_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Gaussian means (k, 2) of vectors (n, 2) about points `at` (k, 2), NaN where too few are near; and the length (k,)
    that such a mean of independent vectors of the same size has by chance (rms)."""
    mean, chance = np.full((len(at), 2), np.nan), np.full(len(at), np.nan)
    if not len(xy):
        return mean, chance
    rms = float(np.sqrt((vectors**2).sum(axis=1).mean()))
    for k, near in enumerate(cKDTree(xy).query_ball_point(at, 2.5 * sigma_px)):
        if not near:
            continue
        w = np.exp(-((xy[near] - at[k]) ** 2).sum(axis=1) / (2 * sigma_px**2))
        enough = w.sum() ** 2 / (w**2).sum()
        if enough >= LEAST_WEIGHT and w.max() >= NEAR:
            mean[k] = w @ vectors[near] / w.sum()
            chance[k] = rms / np.sqrt(enough)
    return mean, chance


def _unit(vectors: np.ndarray) -> float:
    return float(_round_up(max(float(np.percentile(np.linalg.norm(vectors, axis=1), 90)), 1e-9)))


def _arrows(
    axes: Any,
    c: Calibration,
    at: np.ndarray,
    vectors: np.ndarray,
    colour: str,
    cells: int,
    key_x: float = 0.86,
    label: str = "",
    unit: float | None = None,
    key: bool = True,
) -> None:
    """Arrows, the 90th percentile about as long as one of so many `cells` along the image."""
    if not len(at):
        return
    unit = unit or _unit(vectors)
    cell = max(c.interior.width_px, c.interior.height_px) / cells
    arrows = axes.quiver(
        *at.T, *vectors.T, angles="xy", scale_units="xy", scale=unit / cell, color=colour, width=0.0026
    )
    if key:
        axes.quiverkey(arrows, key_x, 1.04, unit, f"{label}{unit:g} px", labelpos="E")


def _image(c: Calibration) -> AbstractContextManager[tuple[Any, Any]]:
    ratio = c.interior.height_px / c.interior.width_px
    return figure(6.1, min(6.1 * ratio, 8.0) + 0.55)


def _frame(axes: Any, c: Calibration) -> None:
    axes.set_xlim(0, c.interior.width_px)
    axes.set_ylim(c.interior.height_px, 0)
    axes.set_aspect("equal")
    axes.set_xlabel("x, px")
    axes.set_ylabel("y, px")
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
