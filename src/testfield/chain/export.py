"""A scene's frames, field sheet, observations and truth as files that any program reads: PNG, JSON and CSV."""

import json
import shutil
from pathlib import Path

from testfield.camera.images import Frame
from testfield.chain.run import Run
from testfield.chain.truth_files import write_truth
from testfield.detect.observations import Observations
from testfield.measure.detector import eight_bits
from testfield.measure.results import EXPORT, image_digest
from testfield.store.atomic import whole
from testfield.store.sheets import FORMAT
from testfield.store.text import write_text

STAGES = ("render", "expose", "detect")
"""What a run must have made before it can be exported."""
TABLES = ("truth/marks", "truth/views")
COPIED = ("field.json", "truth/camera.json")


def export_run(run: Run, out: Path) -> None:
    """Write a run's folder for programs of others: `images/STATION.png` (16 bits, with the sensor's sheet as JSON) and
    `images/STATION.8bit.png`, `field.json`, `observations.csv`, `truth/*.csv`, `truth/camera.json`, and `export.json`,
    which tells the digest of every image. Results that lie beside it are known by that for these images' own."""
    write_truth(run)
    digests = {}
    for name in run.stations:
        source = run.need(f"frames/{name}.png", "expose")
        frame = Frame.load(source, name)
        digests[name] = image_digest(frame)
        _copy(source, out / f"images/{name}.png")
        _copy(source.with_suffix(".json"), out / f"images/{name}.json")
        _write_eight_bits(frame, out / f"images/{name}.8bit.png")
    for name in COPIED:
        _copy(run.need(name, "score"), out / name)
    for name in TABLES:
        _write_csv(run.need(f"{name}.parquet", "score"), out / f"{name}.csv")
    seen = Observations.load(run.need("observations.parquet", "detect"), run.field)
    with whole(out / "observations.csv") as path:
        seen.save_csv(path)
    about = {"format": FORMAT, "scene": run.scene.name, "seed": run.scene.seed, "noise_seed": run.scene.noise_seed}
    with whole(out / EXPORT) as path:
        write_text(path, json.dumps(about | {"images": digests}, indent=1))


def _copy(source: Path, target: Path) -> None:
    with whole(target) as path:
        shutil.copyfile(source, path)


def _write_eight_bits(frame: Frame, target: Path) -> None:
    import cv2

    with whole(target) as path:
        path.write_bytes(cv2.imencode(".png", eight_bits(frame))[1].tobytes())


def _write_csv(source: Path, target: Path) -> None:
    import pyarrow.parquet as pq
    from pyarrow import csv

    with whole(target) as path:
        csv.write_csv(pq.read_table(source), path)
