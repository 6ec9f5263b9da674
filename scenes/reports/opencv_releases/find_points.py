"""Points of a calibration board by whatever OpenCV is installed, from 4.5 on, with nothing but cv2 and numpy:

    python find_points.py IMAGE.png FIELD.json CENTRES.csv

What is looked for, and how, follows from the field sheet: a ChArUco board's corners; a checkerboard's by sectors, or by
the older finder and cornerSubPix where the board is called 'classic'; the circles of a grid. ChArUco corners carry
their numbers; others are written without names, and testfield names them by where they are.
"""

import json
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

VERSION = tuple(int(part) for part in cv2.__version__.split(".")[:2])
ARUCO: Any = cv2.aruco
"""Of another interface in every other release."""
UNTIL = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)


def charuco(image: Any, pattern: dict[str, Any]) -> tuple[list[int], Any]:
    """Numbers and places of a ChArUco board's corners. The programming interface changed with 4.7; up to 4.5, corners
    were numbered from the bottom row."""
    words = ARUCO.getPredefinedDictionary(getattr(ARUCO, pattern["names"]))
    size, lengths = (pattern["columns"], pattern["rows"]), (pattern["pitch_mm"], pattern["mark_mm"])
    if hasattr(ARUCO, "CharucoDetector"):
        board = ARUCO.CharucoBoard(size, *lengths, words)
        corners, numbers, _, _ = ARUCO.CharucoDetector(board).detectBoard(image)
    else:
        board = ARUCO.CharucoBoard_create(*size, *lengths, words)
        tags, found, _ = ARUCO.detectMarkers(image, words)
        corners, numbers = None, None
        if found is not None and len(found):
            _, corners, numbers = ARUCO.interpolateCornersCharuco(tags, found, image, board)
    if numbers is None or len(numbers) == 0:
        return [], []
    row, column = np.divmod(np.ravel(numbers), size[0] - 1)
    if VERSION < (4, 6):
        row = size[1] - 2 - row
    return (row * (size[0] - 1) + column).tolist(), corners


def checkerboard(image: Any, pattern: dict[str, Any], classic: bool) -> Any:
    """Places of a checkerboard's inner corners, by one of OpenCV's two finders."""
    size = (pattern["columns"] - 1, pattern["rows"] - 1)
    if classic:
        found, corners = cv2.findChessboardCorners(image, size)
        return cv2.cornerSubPix(image, corners, (5, 5), (-1, -1), UNTIL) if found else []
    cv2.setRNGSeed(1)
    found, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_ACCURACY)
    return corners if found else []


def circles(image: Any, pattern: dict[str, Any]) -> Any:
    """Centres of a symmetric grid's circles: those of OpenCV's blob detector, put in order."""
    found, centres = cv2.findCirclesGrid(image, (pattern["columns"], pattern["rows"]))
    return centres if found else []


def main(image_file: str, sheet_file: str, csv_file: str) -> None:
    """Find the points of the one board in an image, and write them."""
    cv2.setNumThreads(1)
    image: Any = cv2.imread(image_file, cv2.IMREAD_GRAYSCALE)
    sheet = json.loads(Path(sheet_file).read_text())
    board = sheet["boards"][0]
    pattern, numbers = board["pattern"], [0]
    named = pattern["kind"] == "charuco"
    if named:
        numbers, points = charuco(image, pattern)
    elif pattern["kind"] == "checkerboard":
        points = checkerboard(image, pattern, board["name"] == "classic")
    else:
        points = circles(255 - image if sheet["white_on_black"] else image, pattern)
    points = np.asarray(points, float).reshape(-1, 2).tolist()
    rows = ["x_px,y_px,board,point" if named else "x_px,y_px"]
    for k, (x, y) in enumerate(points):
        rows.append(f"{x:.6f},{y:.6f}" + (f",0,{numbers[k]}" if named else ""))
    Path(csv_file).write_text("\n".join(rows) + "\n")


main(*sys.argv[1:])
