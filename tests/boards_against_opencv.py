"""What OpenCV's calibrateCamera makes of the points that `testfield measure` measured.

    python tests/boards_against_opencv.py FOLDER

FOLDER is what `testfield measure IMAGE... --target KIND --out FOLDER` wrote. OpenCV takes the board for exact and every
point for equally good; k3 is held at zero. Prints one line: images, points, OpenCV's rms and fx; the same of FOLDER.
"""

import json
import sys
from pathlib import Path

import cv2
import numpy as np

from testfield.calibrate.calibration import Calibration
from testfield.detect.observations import Observations
from testfield.detect.target_spec import parse_target
from testfield.measure.patterns import board_pattern


def main(folder: Path) -> None:
    """Print the line of one folder."""
    answer = json.loads((folder / "measurement.json").read_text())
    o = Observations.load(folder / "observations.parquet")
    pattern = board_pattern(parse_target(answer["field"]))
    for name, interior in [(n, c["interior"]) for n, c in answer.get("cameras", {"": answer}).items()]:
        own = np.array(o.cameras)[o.station] == name if o.cameras else np.ones(len(o), bool)
        rows = [np.flatnonzero((o.station == s) & (o.board == 0) & own) for s in range(len(o.stations))]
        rows = [row for row in rows if len(row) >= 6]
        board = np.column_stack([pattern.points_mm * [1, -1], np.zeros(len(pattern.points_mm))]).astype(np.float32)
        size = Calibration.load(folder / "calibration.json").interior
        rms, matrix, *_ = cv2.calibrateCamera(
            [board[o.point[row]] for row in rows],
            [o.xy_px[row].astype(np.float32) for row in rows],
            (size.width_px, size.height_px),
            None,  # type: ignore[call-overload]
            None,
            flags=cv2.CALIB_FIX_K3,
        )
        points = sum(map(len, rows))
        print(
            f"{name or folder.name}: {len(rows)} images, {points} points; "
            f"OpenCV rms {rms:.4f} px, fx {matrix[0, 0]:.2f}; "
            f"testfield rms {answer['reprojection_rms_px']:.4f} px, fx {interior['fx']:.2f}"
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
