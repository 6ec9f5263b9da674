"""Algorithms of one's own in a finished run's folder, sound ones, and what measures with them."""

import csv
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

CENTROID = '''
import numpy as np
from testfield import register
from testfield.detect.centre import Centres


@register("centroids", "brightest")
def brightest(image_dn, sheet, xy_px, moments_px2, half=3):
    """The brightest pixel near the middle."""
    found = Centres.empty(len(xy_px))
    for k, (x, y) in enumerate(np.rint(xy_px).astype(int)):
        part = image_dn[max(y - half, 0) : y + half + 1, max(x - half, 0) : x + half + 1]
        row, column = np.unravel_index(np.argmax(part), part.shape)
        found.xy_px[k], found.ok[k] = (max(x - half, 0) + column, max(y - half, 0) + row), True
    return found
'''
RECIPE = """
name = "mine"
load = ["brightest.py"]
smallest_diameter_px = 6

[centroid]
name = "brightest"
half = 2

[calibrator]
name = "zhang"
lens = "brown"
hold = ["k3"]

[reconstructor]
command = "python points.py {observations} {calibration} {sheet} {csv}"
time_limit_s = 20
"""
COMPARISON = """
scenes = ["../scene.toml"]
recipes = ["recipe.toml"]
centroids = ["star", "template"]
draws = 3
matters_px = 0.002
matters_um = 4
until = "calibrate"

[[factor]]
field = "camera.f_number"
title = "aperture"
values = [4, 8.0]
"""


def make_own(folder: Path) -> None:
    """Write recipes, a comparison, and what programs and folders give, into `folder`/own."""
    from testfield.camera.images import Frame
    from testfield.chain.run import resume
    from testfield.detect.observations import Observations
    from testfield.measure.results import image_digest
    from testfield.reconstruct.points import Points

    run, own = resume(folder, 1), folder / "own"
    for name in ("", "detector", "calibrator", "reconstructor"):
        (own / name).mkdir()
    (own / "brightest.py").write_text(CENTROID)
    (own / "points.py").write_text("")
    (own / "recipe.toml").write_text(RECIPE)
    (own / "comparison.toml").write_text(COMPARISON)
    seen = Observations.load(folder / "observations.parquet", run.field)
    seen.take(seen.station == 0).measured.save_csv(own / "centres.csv")
    shown = {name: seen.take(seen.station == k).measured for k, name in enumerate(run.stations)}
    for name, rows in shown.items():
        rows.save_csv(own / f"detector/{name}.csv")
    frames = {name: Frame.load(folder / f"frames/{name}.png", name) for name in run.stations}
    images = {name: image_digest(frame) for name, frame in frames.items()}
    sheet = {"format": 1, "scene": "tiny", "seed": 1, "noise_seed": None, "images": images}
    (own / "detector/export.json").write_text(json.dumps(sheet))
    (own / "calibrator/camera.json").write_text(json.dumps(_camera(run)))
    points = Points.load(folder / "points.parquet")
    lines = [
        (*map(repr, (int(c), *xyz)), "0.01", "0.01", "0.02")
        for c, xyz in zip(points.code, points.xyz_mm.tolist(), strict=True)
    ]
    text = "\n".join(",".join(line) for line in (("code,x_mm,y_mm,z_mm,u_x_mm,u_y_mm,u_z_mm",), *lines))
    (own / "reconstructor/points.csv").write_text(text + "\n")
    for name, part in (
        ("detector", 'detector = { folder = "detector" }'),
        ("calibrator", 'calibrator = { folder = "calibrator" }'),
        ("reconstructor", 'reconstructor = { folder = "reconstructor" }'),
        ("program", '[detector]\ncommand = "cp centres.csv {csv}"'),
        ("calibrating", '[calibrator]\ncommand = "cp calibrator/camera.json {json}"'),
        ("reconstructing", '[reconstructor]\ncommand = "cp reconstructor/points.csv {csv}"'),
    ):
        (own / f"{name}.toml").write_text(f"{part}\n")


def _camera(run: Any) -> dict[str, Any]:
    world = run.world
    found: dict[str, Any] = {"interior": world.interior.to_json()}
    found |= {"labels": ["fx", "cx"], "covariance": [[0.01, 0.001], [0.001, 0.02]], "notes": ["true"]}
    for key, names, at in (
        ("stations", world.station_name, world.camera_from_world),
        ("boards", [board.name for board in world.field.boards], world.world_from_board),
    ):
        poses = zip(names, at.R.tolist(), at.t_mm.tolist(), strict=True)
        found[key] = {name: {"R": R, "t_mm": t} for name, R, t in poses}
    return found


def of_csv(draw: Callable[[Any], Any], data: bytes) -> bytes:
    """A CSV file with changed cells, another head, other rows, or changed bytes."""
    from cases import WEIRD, changed_bytes

    act = draw(st.sampled_from(["bytes", "cell", "cell", "cell", "drop", "rename", "rows", "none", "short", "many"]))
    if act == "bytes":
        return changed_bytes(draw, data)
    rows = list(csv.reader(io.StringIO(data.decode())))
    row, column = draw(st.integers(1, len(rows) - 1)), draw(st.integers(0, len(rows[0]) - 1))
    if act == "cell":
        words = st.sampled_from(["nan", "inf", "-inf", "", "1e300", "-1", "0", "1.5", "9" * 30, "true", '"', "0x10"])
        rows[row][column] = draw(st.one_of(words, words, WEIRD.map(str)))
    elif act == "drop":
        rows = [[*one[:column], *one[column + 1 :]] for one in rows]
    elif act == "rename":
        rows[0][column] = draw(st.one_of(st.sampled_from(rows[0]), st.text(max_size=5)))
    elif act == "rows":
        rows.insert(row, list(rows[row]))
    elif act == "none":
        rows = rows[: draw(st.integers(0, 2))]
    elif act == "short":
        rows[row] = rows[row][:column]
    else:
        rows += [rows[row]] * draw(st.sampled_from([100, 30_000]))
    out = io.StringIO()
    csv.writer(out).writerows(rows)
    return out.getvalue().encode(errors="surrogatepass")


def measure_with(words: list[str]) -> int:
    """Measure RUN with RECIPE, in-process, as `compare` does: what the first frame shows, and all from observations.

    Says one sentence and returns 2 as the command does; what is measured must be finite.
    """
    from testfield.camera.images import Frame
    from testfield.chain.run import resume
    from testfield.detect.observations import Observations
    from testfield.errors import TestfieldError
    from testfield.measure.pipeline import detect, measure
    from testfield.measure.recipe import Recipe
    from testfield.measure.results import recipe_at

    folder, path = Path(words[0]), Path(words[1])
    try:
        run, recipe = resume(folder, 1), Recipe.load(path)
        name = run.stations[0]
        frame = Frame.load(folder / f"frames/{name}.png", name)
        if recipe.detector is not None:
            seen = detect(frame, run.field, recipe_at(recipe, [frame])).measured
            assert np.isfinite(seen.xy_px).all()
        else:
            seen = Observations.load(folder / "observations.parquet", run.field)
            found = measure(seen, run.field, recipe)
            assert np.isfinite(found.points.xyz_mm).all() and np.isfinite(found.calibration.stations.t_mm).all()
    except TestfieldError as error:
        print(f"testfield: {' '.join(error.sentence().split())}", file=sys.stderr)
        return 2
    return 0
