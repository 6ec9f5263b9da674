"""What is done with one frame in a process of its own, which loads this file and no more of the chain than it needs."""

from pathlib import Path
from typing import Any

from testfield.errors import TestfieldError


def expose_one(work: tuple) -> tuple[dict[str, Path], str, str]:
    """Write a frame's two parts; only the process that keeps the ledger puts them in their places."""
    import testfield.sensor.expose as sensor_room
    from testfield.camera.images import Radiance
    from testfield.store.atomic import part_path

    source, target, size, sensor, (sensor_seed, seed), (image, sheet), key, world = work
    part = part_path(target)
    part.parent.mkdir(parents=True, exist_ok=True)
    radiance = Radiance.load(source)
    if (radiance.station, radiance.values.shape) != (source.stem, size):
        raise TestfieldError(
            f"an image of '{radiance.station}' of {radiance.values.shape[1]} x {radiance.values.shape[0]} px, and "
            f"'{source.stem}' of {size[1]} x {size[0]} px is wanted",
            str(source),
            "render again",
        )
    sensor_room.expose(radiance, sensor, sensor_seed, noise_seed=seed).save(part)
    return {image: part, sheet: part.with_suffix(".json")}, key, world


def detect_one(work: tuple) -> Any:
    """Observations of a frame, which is read and must be as large as its camera says."""
    from testfield.camera.images import Frame
    from testfield.measure.pipeline import detect

    source, name, field, recipe, (width, height) = work
    frame = Frame.load(source, name)
    if frame.pixels_dn.shape != (height, width):
        found = f"{frame.pixels_dn.shape[1]} x {frame.pixels_dn.shape[0]}"
        raise TestfieldError(
            f"the image is {found} px and the camera {width} x {height}", str(source), "all frames are of one camera"
        )
    return detect(frame, field, recipe)
