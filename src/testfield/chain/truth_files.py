"""The truth as files for people and peers: `truth/marks.parquet`, `truth/views.parquet`, `truth/camera.json`."""

import json
from pathlib import Path

import numpy as np

from testfield.chain.keys import truth_modules
from testfield.chain.run import Run
from testfield.scene.world import ROLES
from testfield.store.code import code_digest
from testfield.store.digests import digest
from testfield.store.sheets import FORMAT
from testfield.store.text import write_text

NOTES = {"format": str(FORMAT)}


def write_truth(run: Run) -> None:
    """Write the truth of a run, unless it is there."""
    key = digest(code_digest(*truth_modules(run.scene, run.world)), run.scene.model_dump(), run.world.meshes)
    run.ledger.make("truth/marks.parquet", key, lambda path: _marks(run, path))
    run.ledger.make("truth/views.parquet", key, lambda path: _views(run, path))
    run.ledger.make("truth/camera.json", key, lambda path: _camera(run, path))


def _marks(run: Run, path: Path) -> None:
    """One row a mark: where it is in the world (mm), what it is."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    world, marks = run.world, run.world.marks
    xyz, normal = world.mark_world_mm, world.mark_normal
    columns = {
        "panel": [world.panels.name[k] for k in marks.panel],
        "role": [ROLES[k] for k in marks.role],
        "clean": run.views.clean,
        "board": marks.board,
        "point": marks.point,
        "code": marks.code,
        "diameter_mm": marks.diameter_mm,
        **{f"{axis}_mm": xyz[:, k] for k, axis in enumerate("xyz")},
        **{f"normal_{axis}": normal[:, k] for k, axis in enumerate("xyz")},
    }
    pq.write_table(pa.table(columns).replace_schema_metadata(NOTES), path)


def _views(run: Run, path: Path) -> None:
    """One row for each mark that any part of is visible in a station; `mark` is its row in marks.parquet."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    views = run.views
    station, mark = np.nonzero(views.visible > 0)
    at = station, mark
    columns = {
        "station": np.array(run.stations, dtype=object)[station],
        "mark": mark,
        "visible": views.visible[at],
        "centre_x_px": views.centre_px[at][:, 0],
        "centre_y_px": views.centre_px[at][:, 1],
        "disc_x_px": views.disc_px[at][:, 0],
        "disc_y_px": views.disc_px[at][:, 1],
        "diameter_px": views.diameter_px[at],
        "semi_major_px": views.semi_axes_px[at][:, 0],
        "semi_minor_px": views.semi_axes_px[at][:, 1],
        "angle_deg": views.angle_deg[at],
        "obliquity_deg": views.obliquity_deg[at],
    }
    pq.write_table(pa.table(columns).replace_schema_metadata(NOTES), path)


def _camera(run: Run, path: Path) -> None:
    world = run.world
    poses = {
        name: {"R": R.tolist(), "t_mm": t.tolist()}
        for name, R, t in zip(world.station_name, world.camera_from_world.R, world.camera_from_world.t_mm, strict=True)
    }
    boards = {
        sheet.name: {"R": R.tolist(), "t_mm": t.tolist()}
        for sheet, R, t in zip(world.field.boards, world.world_from_board.R, world.world_from_board.t_mm, strict=True)
    }
    data = {
        "format": FORMAT,
        "interior": world.interior.to_json(),
        "camera_from_world": poses,
        "world_from_board": boards,
    }
    write_text(path, json.dumps(data, indent=1))
