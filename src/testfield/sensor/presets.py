"""Named sensors with the figures of their data sheets, and where the figures are from (`presets.toml`)."""

import tomllib
from functools import lru_cache
from pathlib import Path
from typing import Any

from testfield.store.text import read_text

ABOUT = ("description", "source", "verified", "shutter")
OF_THE_CAMERA = ("width_px", "height_px", "pixel_pitch_um")


@lru_cache
def presets() -> dict[str, dict[str, Any]]:
    """All presets by name: figures under the scene file's names, and `ABOUT` where they are from."""
    return tomllib.loads(read_text(Path(__file__).with_name("presets.toml")))


def with_preset(scene: dict[str, Any]) -> dict[str, Any]:
    """A scene's data with what its `sensor.preset` says wherever the scene itself says nothing.

    Data without a known preset come back as they are; what is wrong with them is told by the schema.
    """
    if isinstance(scene.get("cameras"), list):
        scene = scene | {"cameras": [_camera_with_preset(one) for one in scene["cameras"]]}
    sensor, camera = scene.get("sensor", {}), scene.get("camera", {})
    if not isinstance(sensor, dict) or not isinstance(camera, dict) or not isinstance(sensor.get("preset"), str):
        return scene
    figures = presets().get(sensor["preset"], {})
    body = {name: value for name, value in figures.items() if name in OF_THE_CAMERA}
    chip = {name: value for name, value in figures.items() if name not in (*OF_THE_CAMERA, *ABOUT)}
    return scene | {"sensor": chip | sensor, "camera": body | camera}


def _camera_with_preset(camera: Any) -> Any:
    """One of several cameras with what its own `sensor.preset` says."""
    if not isinstance(camera, dict) or "sensor" not in camera:
        return camera
    filled = with_preset({"sensor": camera["sensor"], "camera": {k: v for k, v in camera.items() if k != "sensor"}})
    return filled["camera"] | {"sensor": filled["sensor"]}
