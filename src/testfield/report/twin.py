"""The page of a twin: figures of the job and of the twin side by side, and their images."""

import base64
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from testfield.author.twin_compare import ALIKE, Row
from testfield.report.pages import page
from testfield.report.style import shown
from testfield.store.text import write_text

WIDTH_PX, MOST_PAIRS = 720, 6
"""Of each image on the page, and how many stations are shown: the page is one file to be sent."""


def write_twin(
    folder: Path,
    name: str,
    scene: str,
    rows: Sequence[Row],
    reasons: Sequence[str],
    notes: Sequence[str],
    images: Sequence[tuple[str, np.ndarray, np.ndarray]],
) -> Path:
    """Write `twin.html` into a folder: `images` are a station's name, its photograph and its frame, (h, w) each, of
    which some are shown, evenly chosen. Returns the page's path."""
    ratio = rows[0].ratio if rows and rows[0].ratio else float("nan")
    count = min(len(images), MOST_PAIRS)
    chosen: list[int] = np.unique(np.linspace(0, max(len(images) - 1, 0), count).astype(int)).tolist()
    pairs = []
    for k in chosen:
        station, photograph, frame = images[k]
        # Both by the curve that shows the photograph, so that what is brighter in the one is seen to be.
        levels, order = np.unique(photograph, return_index=True)
        tones = shown(photograph).ravel()[order]
        pairs.append((station, *(_embedded(np.interp(one, levels, tones)) for one in (photograph, frame))))
    text = page(
        "twin.html",
        name=name,
        scene=scene,
        rows=rows,
        reasons=reasons,
        notes=notes,
        pairs=pairs,
        ratio=ratio,
        alike=bool(1 / ALIKE <= ratio <= ALIKE),
        most=ALIKE,
    )
    path = folder / "twin.html"
    write_text(path, text)
    return path


def _embedded(tones: np.ndarray) -> str:
    """An image of 0 to 1 as a data URL."""
    grey = (255 * tones).astype(np.uint8)
    size = (WIDTH_PX, max(1, round(grey.shape[0] * WIDTH_PX / grey.shape[1])))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA if size[0] < grey.shape[1] else cv2.INTER_LINEAR)
    data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes()
    return "data:image/jpeg;base64," + base64.b64encode(data).decode()
