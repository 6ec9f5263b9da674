"""A frame as every detector takes it: marks bright, a mosaic balanced, and what the noise then is."""

from dataclasses import astuple, replace

import numpy as np

from testfield.camera.images import Frame, InvertedSheet, SensorSheet
from testfield.camera.mosaic import balanced


def bright_marks(frame: Frame, white_on_black: bool) -> tuple[np.ndarray, SensorSheet]:
    """The frame (h, w) as float32 with bright marks, and the sheet that describes its noise."""
    image, sheet = frame.pixels_dn.astype(np.float32), frame.sheet
    if sheet.bayer:
        image, gains = balanced(image, sheet.black_level_dn)
        sheet = replace(sheet, balance=gains)
    if white_on_black:
        return image, sheet
    inverted = InvertedSheet(*astuple(sheet))
    return inverted.largest_dn - image, inverted
