"""The page of `testfield view`: one file with three.js, the scene's data and a small script, which loads nothing."""

import base64
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from testfield.author.view_data import ViewData
from testfield.report.pages import page
from testfield.scene.world import ROLES
from testfield.targets.field import TIME

SCRIPTS = ("view_data.js", "view_scene.js", "view_marks.js", "view_panel.js", "view_main.js")
"""Parts of the page's script, in the order in which they are run."""
MOST_BYTES = 5_000_000
FINEST = 65535
"""Places in images are whole numbers up to this one, which is less than a tenth of a pixel of any sensor."""


def view_page(data: ViewData) -> str:
    """The page as text."""
    from markupsafe import Markup

    here = Path(__file__).parent
    script = "\n".join((here / name).read_text(encoding="utf-8") for name in SCRIPTS)
    text = json.dumps({"about": about(data), "arrays": packed(arrays(data))}, allow_nan=False)
    return page(
        "view.html",
        name=data.job.scene.name,
        description=data.job.scene.description,
        style=Markup((here / "view.css").read_text(encoding="utf-8")),
        three=Markup((here / "three/three.min.js").read_text(encoding="utf-8")),
        licence=Markup((here / "three/LICENSE").read_text(encoding="utf-8")),
        script=Markup(script),
        # What is between script tags ends at the next "</", whatever it is in JSON.
        data=Markup(text.replace("</", "<\\/").replace("<!--", "<\\!--")),
    )


def about(data: ViewData) -> dict[str, Any]:
    """Names and words."""
    job, stations, actual = data.job, data.stations, data.actual
    boards = job.world.field.boards
    codes = job.world.marks.code[data.target].tolist()
    place = {int(code): k for k, code in enumerate(codes)}
    return {
        "name": job.scene.name,
        "roles": list(ROLES),
        "targets": list(data.target_names),
        "boards": [board.name for board in boards],
        "stations": [
            {"name": name, "camera": camera, "size_px": size.tolist()}
            for name, camera, size in zip(stations.name, stations.camera, stations.size_px, strict=True)
        ],
        "meshes": [
            {"name": mesh.name, "albedo": mesh.albedo, "vertices": len(mesh.vertices_mm), "faces": len(mesh.faces)}
            for mesh in data.surfaces.meshes
        ],
        "bars": [
            {
                "name": bar.name,
                "role": bar.role,
                "ends": [place[code] for code in bar.codes],
                "length_mm": bar.length_mm,
                "u_length_mm": bar.u_length_mm,
            }
            for bar in job.world.field.scale_bars
            if set(bar.codes) <= set(place)
        ],
        "times": max((code // TIME for code in codes), default=0) + 1,
        "notes": list(data.notes),
        "run": None if actual is None else {"method": actual.method, "fitted": actual.fitted},
    }


def arrays(data: ViewData) -> dict[str, np.ndarray]:
    """Numbers, in the types in which the script finds them; mm in the world frame, px in images."""
    job, marks, s, d = data.job, data.job.world.marks, data.surfaces, data.drawings
    largest = float(data.stations.size_px.max())
    vertices = [mesh.vertices_mm for mesh in s.meshes]
    faces = [mesh.faces for mesh in s.meshes]
    floats = {
        "mark_mm": job.world.mark_world_mm,
        "mark_xy": marks.xy_mm,
        "diameter_mm": marks.diameter_mm,
        "angle_deg": data.angle_deg,
        "axes_mm": data.axes_mm,
        "eye_mm": data.stations.eye_mm,
        "axis": data.stations.axis,
        "frustum_mm": data.stations.corners_mm,
        "reach_mm": data.stations.reach_mm,
        "flat_mm": s.flat_mm,
        "bent_mm": s.bent_mm,
        "size_mm": s.size_mm,
        "ground": s.ground,
        "ink": s.ink,
        "lamps_mm": s.lamps_mm,
        "vertices_mm": np.concatenate([np.zeros((0, 3)), *vertices]),
        "dots": data.prints.dots,
        "sectors": data.prints.sectors,
        "boxes": data.prints.boxes,
        "outline_px": d.outline_px,
    }
    if data.actual is not None:
        floats |= {"error_mm": data.actual.error_mm, "stated_mm": data.actual.axes_mm}
    whole = {
        "target": data.target,
        "mark_panel": marks.panel,
        "mark_role": marks.role,
        "mark_board": marks.board + 1,  # 0 is none
        "mark_point": marks.point + 1,
        "mark_code": marks.code,
        "rays": data.rays,
        "corner": marks.corner,
        "flat": s.flat,
        "bent": s.bent,
        "of_room": s.of_room,
        "faces": np.concatenate([np.zeros((0, 3), int), *faces]),
        "dots_panel": data.prints.dots_panel,
        "sectors_panel": data.prints.sectors_panel,
        "boxes_panel": data.prints.boxes_panel,
        "seen_first": d.first,
        "seen_mark": d.mark,
        "drawn_first": d.drawn_first,
        "drawn": d.drawn,
        "outline_image": d.outline_image,
        "outline_board": d.outline_board,
    }
    found = {name: np.asarray(values, "<f4") for name, values in floats.items()}
    found |= {name: np.asarray(values, "<u4") for name, values in whole.items()}
    unit = FINEST / largest
    found["drawn_xy"] = np.clip(np.rint(d.xy_px * unit), 0, FINEST).astype("<u2")
    found["drawn_axes"] = np.clip(np.rint(d.axes_px * unit), 0, FINEST).astype("<u2")
    found["drawn_angle"] = np.rint((d.angle_rad % np.pi) * 255 / np.pi).astype("<u1")
    return found


def packed(named: dict[str, np.ndarray]) -> dict[str, list[str]]:
    """Type and bytes of each array, compressed."""
    return {
        name: [values.dtype.str[-2:], base64.b64encode(zlib.compress(values.tobytes(), 6)).decode()]
        for name, values in named.items()
    }
