"""Light from all around as a picture of it: a gradient over height, or an equirectangular file."""

from pathlib import Path

import numpy as np

from testfield.errors import TestfieldError
from testfield.scene.named_files import named_file
from testfield.scene.room_parts import GradientPart, MapPart
from testfield.scene.world import Sky

COPY = "environment_as_run"
"""Name, without its suffix, of the copy of a map's file in a run's folder."""
GRADIENT_ROWS, GRADIENT_COLUMNS = 257, 8
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear red, green and blue (Rec. 709)."""


def map_path(part: MapPart, folder: Path) -> Path:
    """Where a map's file is: as the scene names it or, in a run's folder, the copy made when it was run."""
    return named_file(part.file, copy_name(part), folder)


def copy_name(part: MapPart) -> str:
    """Name of the copy of a map's file in a run's folder."""
    return f"{COPY}{Path(part.file).suffix}"


def sky_of(part: GradientPart | MapPart, where: str, folder: Path = Path()) -> Sky:
    """The environment a scene asks for; `where` names the field, `folder` is what its file is relative to.

    Raises `TestfieldError` for a file that is none.
    """
    if isinstance(part, GradientPart):
        height = np.sin(np.linspace(np.pi / 2, -np.pi / 2, GRADIENT_ROWS))
        ends = np.where(height > 0, part.zenith_w_m2_sr, part.ground_w_m2_sr)
        rows = part.horizon_w_m2_sr + (ends - part.horizon_w_m2_sr) * np.abs(height)
        return Sky(np.repeat(rows[:, None], GRADIENT_COLUMNS, axis=1).astype(np.float32))
    place = f"{where}.file"
    values = _grey(_read(map_path(part, folder), place)) * part.scale_w_m2_sr
    if not np.isfinite(values).all() or values.min() < 0 or values.max() == 0:
        raise TestfieldError(
            f"value {part.file}: the picture has no light, or values below zero or not finite", place, "mend it"
        )
    return Sky(values.astype(np.float32), np.radians(part.azimuth_deg))


def _read(path: Path, place: str) -> np.ndarray:
    """Linear values (h, w) or (h, w, 3) of red, green, blue."""
    import cv2

    if not path.is_file():
        raise TestfieldError(f"value {path}: no such file", place, "paths are relative to the scene file")
    if path.suffix.lower() == ".exr":
        return _read_exr(path, place)
    image = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    if image is None:
        raise TestfieldError(f"value {path}: not a readable picture", place, "give an EXR, HDR or PNG")
    linear = image.astype(float)
    if image.dtype.kind == "u":
        share = linear / (2.0 ** (8 * image.dtype.itemsize) - 1)
        linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return linear[..., 2::-1] if linear.ndim == 3 else linear


def _read_exr(path: Path, place: str) -> np.ndarray:
    import OpenEXR

    try:
        with OpenEXR.File(str(path)) as file:
            channels = {name: np.array(channel.pixels, float) for name, channel in file.channels().items()}
    except (RuntimeError, ValueError, OSError) as error:
        raise TestfieldError(f"value {path}: not a readable EXR ({error})", place) from error
    for name in ("RGB", "RGBA", "Y"):
        if name in channels:
            values = channels[name]
            return values[..., :3] if values.ndim == 3 else values
    if set("RGB") <= set(channels):
        return np.stack([channels[name] for name in "RGB"], axis=-1)
    raise TestfieldError(f"value {path}: its channels are {', '.join(channels)}", place, "give R, G and B, or Y")


def _grey(values: np.ndarray) -> np.ndarray:
    return values @ LUMINANCE if values.ndim == 3 else values
