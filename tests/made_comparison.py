"""Rows of a comparison that nobody rendered, with errors that are known, for what pages and tables make of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from testfield.evaluate.compare import Compared, conclude
from testfield.evaluate.compare_floor import Floor
from testfield.evaluate.compare_page import write_comparison
from testfield.evaluate.comparison import Comparison, Factor
from testfield.evaluate.known_rows import BROKEN, SHIFT_PX, TRUTH
from testfield.evaluate.metrics import CENTRE, CORNER, POINTS
from testfield.measure.recipe import Recipe

SIZE_PX = (640.0, 512.0)
APERTURE = Factor("camera.f_number", (2.8, 4.0, 5.6, 8.0), "aperture")


def made_comparison(recipes: int, scenes: int, draws: int, factors: tuple[Factor, ...] = ()) -> Comparison:
    """A comparison of that size."""
    names = tuple(Recipe(name=f"recipe {k}") for k in range(recipes))
    return Comparison(tuple(Path(f"scene_{k}.toml") for k in range(scenes)), names, draws, factors)


def made_rows(comparison: Comparison, marks: int = 60) -> pd.DataFrame:
    """Its rows: recipe k is k / 200 px worse than the first and misses k targets; the last one's calibration fails in
    the first draw of each scene."""
    rng = np.random.default_rng(5)
    levels = [(f.name, k) for f in comparison.factors for k in range(len(f.values))] or [("", -1)]
    rows: list[dict[str, Any]] = []
    for scene in comparison.scenes:
        for factor, level in levels:
            at = rng.uniform(0, SIZE_PX, (marks, 2))
            for draw in range(1, comparison.draws + 1):
                common = 0.02 * rng.normal(size=(marks, 2))
                for k, recipe in enumerate(comparison.recipes):
                    labels = {
                        "scene": scene.stem,
                        "factor": factor,
                        "level": level,
                        "draw": draw,
                        "recipe": recipe.name,
                    }
                    error = common + 0.002 * rng.normal(size=(marks, 2)) + 0.005 * k * (2 * at / SIZE_PX - 1)
                    rows.append(labels | _row(rng, at[k:], error[k:], marks, max(level, 0)))
                    if k == len(comparison.recipes) - 1 and draw == 1:
                        rows[-1] |= {
                            "failure": "too few boards",
                            "failure_kind": "refused",
                            "failure_stage": "calibrate",
                        }
        for kind, error_px in ((TRUTH, 0.0), (BROKEN, SHIFT_PX / np.sqrt(2))):
            labels = {"scene": scene.stem, "factor": levels[0][0], "level": levels[0][1], "draw": 0, "recipe": kind}
            rows.append(labels | {CENTRE.key: error_px})
    return pd.DataFrame(rows)


def _row(rng: np.random.Generator, at: np.ndarray, error: np.ndarray, marks: int, level: int) -> dict[str, Any]:
    rms, n = float(np.sqrt((error**2).mean())), len(at)
    grid = np.stack(np.meshgrid(np.linspace(0, 639, 9), np.linspace(0, 511, 7)), -1).reshape(-1, 2)
    off = 0.1 * rms * rng.normal(size=(len(grid), 2))
    points = rms * rng.normal(size=(8, 3))
    lengths = np.linspace(100, 900, 28)
    return {
        CENTRE.key: rms * (1 + 0.2 * level),
        CORNER.key: 2 * rms,
        POINTS.key: float(np.sqrt((points**2).mean())),
        "detection.expected": marks,
        "detection.missed": marks - n,
        "detection.found_fraction": n / marks,
        "detection.wrong_code": 0,
        "detection.false": 1,
        "ground_mm_per_px": 1.4,
        "time_detect_s": 0.1,
        "time_calibrate_s": 0.2,
        "time_reconstruct_s": 0.01,
        "memory_mb": 12.0,
        "station": [0] * n,
        "mark": list(range(marks - n, marks)),
        "x_px": at[:, 0].tolist(),
        "y_px": at[:, 1].tolist(),
        "dx_px": error[:, 0].tolist(),
        "dy_px": error[:, 1].tolist(),
        "centre_nees": ((error**2).sum(axis=1) / 0.02**2).tolist(),
        "camera_x_px": grid[:, 0].tolist(),
        "camera_y_px": grid[:, 1].tolist(),
        "camera_dx_px": off[:, 0].tolist(),
        "camera_dy_px": off[:, 1].tolist(),
        "calibration.interior_error.fx": rng.normal(),
        "calibration.interior_u.fx": 1.0,
        "point_code": list(range(8)),
        **{f"point_{axis}_mm": points[:, k].tolist() for k, axis in enumerate("xyz")},
        "point_nees": rng.chisquare(3, 8).tolist(),
        "length_mm": lengths.tolist(),
        "length_error_mm": (1e-5 * lengths * rng.normal(size=28)).tolist(),
    }


def made_page(
    comparison: Comparison, folder: Path, floor_px: float | None = 0.001, rows: pd.DataFrame | None = None
) -> tuple[Path, Compared]:
    """The page of such a comparison, or of other `rows` of it, and what it concludes."""
    names = [recipe.name for recipe in comparison.recipes]
    compared = conclude(made_rows(comparison) if rows is None else rows, names, comparison.matters)
    certificate = None if floor_px is None else {"centre_floor_px": floor_px, "valid": True}
    floor = Floor.of(certificate, compared.ground_um_per_px)
    made = {"command that repeats it": "testfield compare made.toml", "processor": "none"}
    return write_comparison(compared, comparison, floor, made, folder), compared
