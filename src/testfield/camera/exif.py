"""What a photograph's EXIF says of the camera that took it: model, focal length, the size of the image.

Tags of CIPA DC-008 (Exif 2.32). The 35 mm equivalent is that focal length which has the same angle of view over the
image's diagonal on film of 36 x 24 mm (CIPA DCG-001).
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

MAKE, MODEL, DETAILS = 0x010F, 0x0110, 0x8769
FOCAL_LENGTH, FOCAL_LENGTH_35_MM, SERIAL, LENS = 0x920A, 0xA405, 0xA431, 0xA434
FILM_DIAGONAL_MM = float(np.hypot(36, 24))
ALIKE = 0.005
"""Relative difference within which focal lengths are one: lenses report theirs in steps."""


@dataclass(frozen=True)
class Exif:
    """Of one image file: its `size_px` (width, height), the `camera` (maker, model, serial number and lens, as far as
    the file tells, else empty), `focal_mm` and `focal_35_mm`, 0 where the file does not tell."""

    size_px: tuple[int, int]
    camera: str = ""
    focal_mm: float = 0.0
    focal_35_mm: float = 0.0

    @property
    def focal_px(self) -> float | None:
        """The focal length by its 35 mm equivalent; None where the file tells none. Makers round it."""
        if not self.focal_35_mm:
            return None
        return float(self.focal_35_mm * np.hypot(*self.size_px) / FILM_DIAGONAL_MM)

    @property
    def said(self) -> str:
        """One line for a person."""
        parts = [f"{self.size_px[0]} x {self.size_px[1]} px"]
        parts += [self.camera] if self.camera else []
        parts += [f"{self.focal_mm:g} mm"] if self.focal_mm else []
        parts += [f"{self.focal_35_mm:g} mm on 35 mm film"] if self.focal_35_mm else []
        return ", ".join(parts)

    def like(self, other: "Exif") -> bool:
        """Whether both may be of one camera at one focal length; what a file does not tell contradicts nothing."""
        focals = ((self.focal_mm, other.focal_mm), (self.focal_35_mm, other.focal_35_mm))
        return (
            self.size_px == other.size_px
            and (self.camera == other.camera or not self.camera or not other.camera)
            and all(abs(a - b) <= ALIKE * max(a, b) for a, b in focals if a and b)
        )


def read_exif(path: Path) -> Exif | None:
    """What the header of an image file tells; None where it cannot be read, for the decoder has its own say."""
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                size, tags = image.size, image.getexif()
                details = tags.get_ifd(DETAILS)
    except Exception:  # any damage, or a format that the library does not know
        return None
    words = [tags.get(MAKE), tags.get(MODEL), details.get(SERIAL), details.get(LENS)]
    said = dict.fromkeys(str(word).replace("\0", " ").strip() for word in words if word)
    camera = " ".join(word for word in said if word and word.isprintable())
    return Exif(
        (int(size[0]), int(size[1])), camera, _positive(details, FOCAL_LENGTH), _positive(details, FOCAL_LENGTH_35_MM)
    )


def _positive(tags: dict, number: int) -> float:
    """A positive number, 0 where there is none."""
    try:
        value = float(tags.get(number, 0))
    except (TypeError, ValueError, ZeroDivisionError):
        return 0.0
    return value if 0 < value < 1e5 else 0.0
