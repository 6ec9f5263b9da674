"""The report on releases of OpenCV: its script finds what is there with the OpenCV at hand; its recipes are whole."""

import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import SCENES

from testfield.camera.images import Frame, SensorSheet
from testfield.evaluate.comparison import Comparison
from testfield.measure import outside
from testfield.measure.detector import by_program
from testfield.measure.outside import DETECTOR_GETS, Program
from testfield.scene.load import load_scene
from testfield.simulate.board_image import draw_board, facing
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks

REPORT = SCENES / "reports/opencv_releases.toml"
FOLDER = SCENES / "reports/opencv_releases"
SIZE = (960, 768)
BOARDS = {
    "charuco": BoardPattern("charuco", 10, 7, 38.0, 28.0, "DICT_5X5_100"),
    "sectors": BoardPattern("checkerboard", 10, 7, 38.0),
    "classic": BoardPattern("checkerboard", 10, 7, 38.0),
    "circles": BoardPattern("circles", 10, 7, 38.0, 19.0),
}


def drawn(name: str) -> tuple[Frame, Field, np.ndarray]:
    """A frame of a board without a lens or light, its sheet, and where its points are."""
    pattern = BOARDS[name]
    n = len(pattern.points_mm)
    marks = Marks(pattern.points_mm, np.full(n, pattern.free_mm), np.zeros(n, int))
    sheet = Field(14, (NominalBoard(name, marks, 0, 0, pattern, (420.0, 300.0)),), white_on_black=name != "circles")
    to_px = facing(2.0, (480.0, 384.0), 9.0, 1e-4)
    true = cv2.perspectiveTransform(pattern.points_mm[None], to_px)[0]
    if name == "circles":
        y, x = np.mgrid[: SIZE[1], : SIZE[0]]
        radius = np.hypot(x[..., None] - true[:, 0], y[..., None] - true[:, 1]).min(axis=-1)
        image = 3000 - 2600 * np.clip(19.5 - radius, 0, 1)
    else:
        image = draw_board(pattern, SIZE, to_px, fine=5, black_and_white=(400.0, 3000.0))
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + np.random.default_rng(1).normal(0, 8, image.shape)
    pixels = np.clip(np.rint(image), 0, 4095).astype(np.uint16)
    return Frame("one", pixels, SensorSheet(2.6, 2.3, 64.0, 12)), sheet, true


@pytest.mark.parametrize("name", BOARDS)
def test_the_script_finds_and_names_the_points_of_every_board(name: str) -> None:
    frame, sheet, true = drawn(name)
    command = f"{sys.executable} find_points.py {{image8}} {{sheet}} {{csv}}"
    found = by_program(frame, sheet, Program.of(command, FOLDER, "here", DETECTOR_GETS))
    assert sorted(found.point) == list(range(len(true))) and (found.board == 0).all()
    # Up to 4.7, ChArUco corners were half a pixel off in x and y.
    assert np.abs(found.xy_px - true[found.point]).max() < 0.15


def test_six_releases_from_4_5_to_5_0_meet_the_same_images(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(outside, "environment_of", lambda packages, where: asked.append(packages) or {})
    comparison = Comparison.load(REPORT).check()
    releases = [packages[0].partition("==")[2] for packages in asked]
    assert len(set(releases)) >= 6 and releases[0].startswith("4.5.") and releases[-1].startswith("5.0.")
    assert all("==" in package for packages in asked for package in packages)
    boards = [load_scene(scene).boards[0].name for scene in comparison.scenes]
    assert boards == list(BOARDS)


def test_recipes_differ_in_the_release_alone() -> None:
    told = [tomllib.loads(path.read_text()) for path in sorted(Path(FOLDER).glob("opencv_*.toml"))]
    assert len({str(recipe["detector"]) for recipe in told}) == 1
    for recipe in told:
        assert recipe["name"].removeprefix("OpenCV ") in recipe["environment"]["packages"][0]
