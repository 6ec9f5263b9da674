"""Lens: projection and its inverse agree, and what lies outside the domain is flagged."""

import numpy as np

from testfield.camera.interior import Interior
from testfield.camera.lens import lens_model, lens_names
from testfield.camera.project import directions, project_camera
from testfield.certify.verdict import Verdict

WIDTH_PX, HEIGHT_PX = 4096, 3000
_CENTRE = [2041.0, 1507.0]


def certify_lens(quick: bool) -> list[Verdict]:
    """Round trips over the whole image for every model, with and without a residual field; and the domain's edge."""
    step = 200 if quick else 40
    grid = np.stack(np.meshgrid(np.arange(-0.5, WIDTH_PX, step), np.arange(-0.5, HEIGHT_PX, step)), -1).reshape(-1, 2)
    field = np.random.default_rng(0).normal(0, 0.1, (2, 6, 6))
    worst: dict[str, float] = {}
    for model, example, (fx, fy, *coefficients) in _examples():
        name = f"{model}, {example}" if example else model
        for residual in (None, field):
            camera = Interior(WIDTH_PX, HEIGHT_PX, np.array([fx, fy, *_CENTRE, *coefficients]), model, residual)
            error = np.abs(project_camera(camera, 5000 * directions(camera, grid)) - grid).max()
            worst[name] = max(worst.get(name, 0.0), float(error) if np.isfinite(error) else np.inf)
    verdicts = [
        Verdict("lens", f"round trip, {name}", error, 1e-9, "px", f"{len(grid)} pixels to rays and back")
        for name, error in worst.items()
    ]
    return [
        *verdicts,
        Verdict("lens", "points folded back", _folded(), 0, "points", "points beyond each model's reach"),
    ]


def _examples() -> list[tuple[str, str, tuple[float, ...]]]:
    """Lens model, name and values (fx, fy, coefficients) of all examples."""
    return [(model, name, row) for model in lens_names() for name, row in lens_model(model).examples.items()]


def _folded() -> int:
    """How many points beyond a model's reach, or behind the camera, are given a pixel."""
    given = 0
    for model in lens_names():
        coefficients = lens_model(model).folding
        if coefficients is None:
            continue
        camera = Interior(WIDTH_PX, HEIGHT_PX, np.array([1000, 1000, *_CENTRE, *coefficients], float), model)
        reach = camera.lens.reach(camera.coefficients)
        angle = np.linspace(0, 2 * np.pi, 100)
        for radius in np.linspace(1.0001, 5, 50) * reach:
            beyond = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.ones(100)])
            given += int(np.isfinite(project_camera(camera, beyond)).any(axis=1).sum())
        behind = np.column_stack([np.cos(angle), np.sin(angle), -np.ones(100)])
        given += int(np.isfinite(project_camera(camera, behind)).any(axis=1).sum())
    return given
