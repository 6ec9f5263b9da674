"""Stated uncertainty where the true lens is richer than the model: scenes with a residual field, calibrated without it.

    python -m testfield.bench.residual_field --draws 20 --rms 0 0.02 0.1 0.3

Each draw has a field, a workshop and noise of its own. `--rendered` renders its images and detects what is in them;
without it observations are drawn at the physical bound (`simulate/observations.py`): a second instead of a minute.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from testfield.chain.recipe import recipe_of
from testfield.chain.run import Run, begin
from testfield.chain.stages import run_stage
from testfield.evaluate.case import changed, scene_table
from testfield.measure.pipeline import measure
from testfield.scene.build import build_world
from testfield.scene.load import parse_scene
from testfield.scene.truth import see
from testfield.score.camera import score_camera
from testfield.score.points import score_points
from testfield.score.scorecard import load_scorecard
from testfield.seeds import seed_of
from testfield.simulate.observations import draw_observations
from testfield.store.text import write_text

KINDS = ("rings", "dots", "checkerboard", "circles")
FIGURES = ("points", "imaging", "interior")
UPRIGHT_DEG = (-25, 20, -10, 25)
"""Rolls from which a symmetric grid of dots still shows which side is up."""


def scene_of(kind: str, rms_px: float, draw: int, scenes: Path) -> dict[str, Any]:
    """A small scene with targets of a kind, as a plain table; `scenes` is the folder of the project's own scenes."""
    if kind in ("rings", "dots"):
        table = scene_table(scenes / "quick.toml")
        changes: dict[str, Any] = {"measure.calibrator": "self" if kind == "rings" else "stitched"}
    else:
        table, changes = scene_table(scenes / "charuco.toml"), {}
        changes["boards.0.pattern"] = (
            {"kind": "checkerboard", "columns": 12, "rows": 9, "square_mm": 32}
            if kind == "checkerboard"
            else {"kind": "circles", "columns": 12, "rows": 9, "pitch_mm": 32, "diameter_mm": 16}
        )
        if kind == "circles":
            changes |= {f"stations.{k}.roll_deg": list(UPRIGHT_DEG) for k in (0, 1)}
            changes |= {f"stations.{k}.roll_deg": [UPRIGHT_DEG[k % 4]] for k in range(2, len(table["stations"]))}
    changes |= {"seed": 1000 + draw, "measure.hold": ["k3"]}
    if rms_px:
        changes["camera.residual_field"] = {"rms_px": rms_px}
    return changed(table, changes)


def trial(kind: str, rms_px: float, draw: int, scenes: Path, folder: Path | None = None) -> dict[str, Any]:
    """NEES per degree of freedom of check `points`, of the camera's `imaging` and of its `interior` parameters, and the
    `s_px` of the field that was found (0: none); from images where a `folder` is given to render in."""
    import tomli_w

    table = scene_of(kind, rms_px, draw, scenes)
    if folder is None:
        card = _drawn(table, f"{kind}/{rms_px}/{draw}")
    else:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "scene.toml", tomli_w.dumps(table))
        card = _rendered(begin(folder / "scene.toml", folder / "run", None, 1)[0])
    camera, points = card["calibration"], card["points"]
    return {
        "points": points["anees"]
        if points["anees"] is not None and np.isfinite(points["anees"])
        else points["anees_fitted"],
        "imaging": camera["imaging_anees"],
        "interior": camera["interior_anees"],
        "imaging_error_px": camera["imaging_error_px"],
        "imaging_u_px": camera["imaging_u_px"],
        "s_px": (camera["lens_misfit"] or {}).get("s_px", 0.0),
        "rejected": camera["rejected"],
        "rmse_mm": points["rmse_mm"],
        "mean_u_mm": points["mean_u_mm"],
    }


def _drawn(table: dict[str, Any], name: str) -> dict[str, Any]:
    import tomli_w

    scene = parse_scene(tomli_w.dumps(table), table["name"], Path())
    world = build_world(scene)
    observations = draw_observations(scene, world, see(world), seed_of(scene.seed, f"residual_field/noise/{name}"))
    measured = measure(observations, world.field, recipe_of(scene))
    return {
        "calibration": score_camera(world, measured.calibration),
        "points": score_points(world, measured.calibration, measured.points).card(),
    }


def _rendered(run: Run) -> dict[str, Any]:
    for stage in ("render", "expose", "detect", "calibrate", "reconstruct", "score"):
        run_stage(run, stage)
    return load_scorecard(run.folder / "scorecard.json")


def main() -> None:
    """Print one line a kind and field: mean NEES of each figure, and in how many draws a field was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="number of the first draw")
    parser.add_argument("--rms", type=float, nargs="+", default=[0.0, 0.02, 0.1, 0.3])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--scenes", type=Path, default=Path("scenes"))
    parser.add_argument("--rendered", type=Path, metavar="FOLDER", help="render in this folder")
    args = parser.parse_args()
    print(f"{'kind':<14}{'field px':>9}{'found':>7}" + "".join(f"{name:>10}" for name in FIGURES) + f"{'u px':>9}")
    for kind in args.kinds:
        for rms in args.rms:
            found = []
            for draw in range(args.first, args.first + args.draws):
                folder = args.rendered / f"{kind}-{rms:g}-{draw}" if args.rendered else None
                found.append(trial(kind, rms, draw, args.scenes, folder))
            mean = {name: np.mean([f[name] for f in found]) for name in (*FIGURES, "imaging_u_px")}
            share = np.mean([f["s_px"] > 0 for f in found])
            figures = "".join(f"{mean[name]:>10.2f}" for name in FIGURES)
            print(f"{kind:<14}{rms:>9g}{share:>7.0%}{figures}{mean['imaging_u_px']:>9.4f}", flush=True)


if __name__ == "__main__":
    main()
