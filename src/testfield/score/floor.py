"""The certificate beside a run's folder: which error the images themselves may have."""

import json
from pathlib import Path
from typing import Any

from testfield.errors import DAMAGE
from testfield.registry import module_of, names
from testfield.store.code import code_digest
from testfield.store.text import read_text


def renderer_digest() -> str:
    """What the certificate vouches for: the source of the renderer and the sensor, and the packages under them."""
    lenses = [module_of("lenses", name) for name in names("lenses")]
    return code_digest("testfield.render.fast", "testfield.render.irradiance", "testfield.sensor.expose", *lenses)


def floor_of(folder: Path) -> dict[str, Any] | None:
    """The certificate beside a run's folder, as a report states it; None where there is none.

    `valid` tells whether it was made with the renderer that is installed now.
    """
    path = folder.parent / "certificate.json"
    try:
        certificate = json.loads(read_text(path))
        figures = {
            f"{v['part']}: {v['name']}": {k: float(v[k]) for k in ("measured", "limit")} | {"unit": str(v["unit"])}
            for v in certificate["verdicts"]
        }
        return {
            "made": certificate["made"],
            "passed": certificate["passed"],
            "quick": certificate["quick"],
            "valid": certificate["code"] == renderer_digest(),
            "figures": figures,
            "centre_floor_px": max(
                (v["measured"] for name, v in figures.items() if v["unit"] == "px" and "rms" in name),
                default=None,
            ),
        }
    except DAMAGE:
        return None
