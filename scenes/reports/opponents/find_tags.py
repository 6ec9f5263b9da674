"""Corners of a grid of AprilTags by the package `aprilgrid`:

    python find_tags.py IMAGE.png FIELD.json CENTRES.csv

Of a tag that stands upright its corners begin at the top right and go round against the clock; ours begin at the top
left and go round with it.
"""

import json
import sys
from pathlib import Path

import cv2
from aprilgrid import Detector

OURS = (1, 0, 3, 2)
"""The numbers that its corners have here."""


def main(image_file: str, sheet_file: str, csv_file: str) -> None:
    """Find the tags of the one board in an image, and write their corners."""
    image = cv2.imread(image_file, cv2.IMREAD_GRAYSCALE)
    pattern = json.loads(Path(sheet_file).read_text())["boards"][0]["pattern"]
    many = pattern["columns"] * pattern["rows"]
    rows = ["x_px,y_px,board,point"]
    for tag in Detector("t36h11b1").detect(image):  # borders of one cell
        number = int(tag.tag_id) - pattern["first_tag"]
        if 0 <= number < many:
            for k, (x, y) in enumerate(tag.corners.reshape(4, 2).tolist()):
                rows.append(f"{x:.6f},{y:.6f},0,{4 * number + OURS[k]}")
    Path(csv_file).write_text("\n".join(rows) + "\n")


main(*sys.argv[1:])
