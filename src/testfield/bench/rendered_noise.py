"""What common noise is worth on rendered images: paired intervals against unpaired ones, over several small scenes.

One recipe takes part twice, under two names, so that noise that is not the same would be seen. What intervals without
common noise would be is computed from each recipe's own scatter, and measured too: draws of one recipe are paired with
other draws of the other.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from testfield.evaluate.check import Check, Limit
from testfield.evaluate.common_noise import noise_of, noise_table
from testfield.evaluate.compare import table_of
from testfield.evaluate.compared import Until
from testfield.evaluate.comparison import Comparison
from testfield.evaluate.comparison_cases import cases_of
from testfield.evaluate.execute import execute
from testfield.evaluate.metrics import CENTRE
from testfield.evaluate.paired import difference
from testfield.measure.recipe import Algorithm, Recipe
from testfield.store.text import write_text

DRAWS, LEAST_DRAWS = 12, 4
FIRST, AGAIN = "forward_model", "forward_model, again"
OTHERS = ("template", "edge_zernike", "star", "weighted_centroid", "grey_centroid")
SEVERAL = Limit(3.0)
"""What the interval of a difference is hoped to become narrower by."""
SAME = Limit(0.0, 0.0)
AS_COMPUTED = Limit(0.8, 1.25)
SCENES = {
    "small_sharp": {"f_number": 4.0, "time_ms": 0.3},
    "small_usual": {"f_number": 5.6, "time_ms": 0.6},
    "small_dim": {"f_number": 8.0, "time_ms": 0.3},
    "small_blurred": {"f_number": 11.0, "time_ms": 2.4},
}
"""Apertures and exposures of the same board: how much light there is, and how far it is spread."""
SCENE = """
name = "{name}"
seed = 7

[volume]
size_mm = [1000, 600, 800]

[camera]
width_px = 640
height_px = 512
pixel_pitch_um = 9.6
focal_length_mm = 8.0
f_number = {f_number}
psf_sigma_px = 0.6

[exposure]
time_ms = {time_ms}

[room]
ambient_w_m2_sr = 3.0

[[boards]]
name = "A"
size_mm = [500, 360]
position_mm = [0, 0, 400]
normal = [0, -1, 0]
extension_zone = {{ columns = 6, rows = 7, pitch_mm = 45, diameter_mm = 18, centre_mm = [105, 0] }}
recognition_zone = {{ columns = 2, rows = 4, pitch_mm = 80, diameter_mm = 18, centre_mm = [-165, 0], first_code = 1 }}

[[stations]]
generator = "arc"
count = 2
radius_mm = 1200
height_mm = 650
azimuth_deg = [-38, 38]
look_at_mm = [0, 0, 400]

[render]
light_paths = 16
light_spacing_mm = 400
"""


def bench_rendered_noise(draws: int, folder: Path, jobs: int, tell: Callable[[str], None]) -> list[Check]:
    """The figures, from so many draws of every scene; rendered scenes and finished cases are kept in `folder`."""
    comparison = small_comparison(draws, folder)
    rows = execute(cases_of(comparison), folder, jobs, "bench")
    return noise_checks(rows[rows.draw > 0], [recipe.name for recipe in comparison.recipes], tell)


def small_comparison(draws: int, folder: Path) -> Comparison:
    """The scenes, which are written into `folder`, and the recipes."""
    recipes = [Recipe(name=name, centroid=Algorithm(name)) for name in (FIRST, *OTHERS)]
    recipes.insert(1, replace(recipes[0], name=AGAIN))
    paths = []
    (folder / "scenes").mkdir(parents=True, exist_ok=True)
    for name, said in SCENES.items():
        paths.append(folder / "scenes" / f"{name}.toml")
        write_text(paths[-1], SCENE.format(name=name, **said))
    return Comparison(tuple(paths), tuple(recipes), draws, until=Until.DETECT, source="bench")


def noise_checks(rows: pd.DataFrame, recipes: Sequence[str], tell: Callable[[str], None]) -> list[Check]:
    """The figures of the rows of a comparison, in which the second recipe is the first one again."""
    first, again, *others = recipes
    table = table_of(rows.assign(factor="", level=-1) if "factor" not in rows else rows, CENTRE)
    twice = float((table[first] - table[again]).abs().max())
    found = [
        Check("one recipe twice, largest difference of an rms", twice, None, SAME, "px", "the same noise for both")
    ]
    noise = noise_table(rows, recipes).set_index("recipe")
    ratios = np.array([_unpaired_as_computed(rows, first, name) for name in others])
    value = float(np.sqrt((ratios[:, 0] / ratios[:, 1]).mean()))
    how = "draws of one recipe with other draws of the other"
    found.append(Check("interval with other noise, measured over computed", value, None, AS_COMPUTED, "", how))
    scenes = table.index.unique("scene")
    for name in others:
        own = noise.loc[name]
        scatter = own.spread_first / own.spread
        how = (
            f"correlation {own.correlation:.2f} (at most {scatter:.2f}, ratio of scatters), {own['items']:.0f} centres"
        )
        found.append(
            Check(f"{name}: a centre's difference, times narrower", float(own.narrower), None, SEVERAL, "", how)
        )
        a, b = ([table[one].loc[scene].to_numpy(float) for scene in scenes] for one in (first, name))
        alone = [difference([x], [y], 1e-9) for x, y in zip(a, b, strict=True)]
        times = float(np.median([one.unpaired_u / one.estimate.u for one in alone]))
        how = f"median of {len(scenes)} scenes; {1 / np.sqrt(1 - own.correlation**2):.2f} of errors without bias"
        found.append(Check(f"{name}: rms of one scene, times narrower", times, None, SEVERAL, "", how))
        pooled = difference(a, b, 1e-9)
        how = f"{len(scenes)} scenes as the units, which differ"
        found.append(
            Check(
                f"{name}: rms over scenes, times narrower",
                pooled.unpaired_u / pooled.estimate.u,
                None,
                SEVERAL,
                "",
                how,
            )
        )
        tell(f"{name}: {own.narrower:.2f}, {times:.2f}, {found[-1].value:.2f} times narrower")
    return found


def _unpaired_as_computed(rows: pd.DataFrame, first: str, other: str) -> tuple[float, float]:
    """Variance of a centre's difference when the draws of the other recipe are those of the next noise; and the sum of
    both variances."""
    apart, computed = 0.0, 0.0
    for _, setup in rows.groupby("scene"):
        pair = noise_of(setup, first, other)
        if pair is not None:
            a, b = pair
            apart += float(((np.roll(b, 1, axis=0) - a) ** 2).sum())
            computed += float((a**2).sum() + (b**2).sum())
    return apart, computed
