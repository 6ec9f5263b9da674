"""Files made elsewhere belong to the images that they were made of: told by the digests that an export writes down."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from testfield.camera.images import Frame
from testfield.errors import TestfieldError, speaking
from testfield.measure.outside import Results
from testfield.measure.recipe import Recipe
from testfield.store.digests import digest
from testfield.store.sheets import Sheet, checked, read_json

EXPORT = "export.json"
PARTS = ("detector", "calibrated_by", "points_from")


class ExportSheet(Sheet):
    """What an export says of itself: the scene, its seeds, and of each image the digest of its pixels."""

    scene: str
    seed: int
    noise_seed: int | None = None
    images: dict[str, str]


def image_digest(frame: Frame) -> str:
    """Digest of a frame's pixels, whatever file holds them."""
    return digest(frame.pixels_dn)


def recipe_at(recipe: Recipe, frames: Sequence[Frame]) -> Recipe:
    """The recipe for these frames: of each folder of results, the place in it that was made of them.

    A folder without any `export.json` is taken as it is. Raises `TestfieldError` where all that it holds was made of
    other images.
    """
    found: dict[str, Any] = {
        part: _at(getattr(recipe, part), frames) for part in PARTS if isinstance(getattr(recipe, part), Results)
    }
    return replace(recipe, **found) if found else recipe


def _at(results: Results, frames: Sequence[Frame]) -> Results:
    sheets = sorted(results.folder.rglob(EXPORT))
    if not sheets:
        return results
    images = {frame.station: image_digest(frame) for frame in frames}
    known = [_load(sheet) for sheet in sheets]
    for sheet, export in zip(sheets, known, strict=True):
        if images.items() <= export.images.items():
            return replace(results, folder=sheet.parent)
    near = max(range(len(known)), key=lambda k: len(images.keys() & known[k].images.keys()))
    station = next((name for name in images if known[near].images.get(name) != images[name]), next(iter(images)))
    raise TestfieldError(
        f"these results are of other images (of scene '{known[near].scene}', digest "
        f"{known[near].images.get(station, 'none')[:12]} instead of {images[station][:12]})",
        f"{sheets[near]}, images.{station}",
        "export the scene with this noise, and measure its images",
    )


@speaking("export")
def _load(path: Path) -> ExportSheet:
    data = read_json(path)
    return checked(ExportSheet, {key: data[key] for key in ExportSheet.model_fields if key in data})
