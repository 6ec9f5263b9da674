"""A page of every kind of target, rasterised: what is found on it lies where the field sheet says."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from testfield.author.drawn_page import as_pdf
from testfield.author.print_files import OWN, Paper, pages_of
from testfield.camera.photograph import photograph_of
from testfield.detect.observations import MEASURED
from testfield.detect.photograph import detect_in_photograph
from testfield.detect.target_spec import parse_target
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.code_table import codes_for
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks
from testfield.targets.rune_code import DOT

TRUE_TO_MM = 0.01
DPI = 200
AROUND_MM = 8.0
BOARDS = {
    "charuco:5x4:DICT_4X4_50:16:12": BoardPattern("charuco", 5, 4, 16.0, 12.0, "DICT_4X4_50"),
    "checkerboard:6x5:12": BoardPattern("checkerboard", 7, 6, 12.0),
    "squares:5x4:16:9": BoardPattern("squares", 5, 4, 16.0, 9.0),
    "aruco:DICT_4X4_50:12": BoardPattern("tags", 3, 2, 17.0, 12.0, "DICT_4X4_50", 3),
    "apriltag:36h11:14": BoardPattern("tags", 3, 2, 19.0, 14.0, "DICT_APRILTAG_36h11", 3),
    "tags:3x2:DICT_5X5_100:17:12:3": BoardPattern("tags", 3, 2, 17.0, 12.0, "DICT_5X5_100", 3),
    "aprilgrid:3x2:14:4.2": BoardPattern("aprilgrid", 3, 2, 18.2, 14.0, "DICT_APRILTAG_36h11", border_cells=2),
    "cctag:3": BoardPattern("cctag", 2, 1, 16.0, 12.0, first_tag=2, crowns=3),
    "cctag:4": BoardPattern("cctag", 2, 1, 20.0, 15.0, first_tag=90, crowns=4),
    "runetag": BoardPattern("runetag", 1, 1, 70.0, DOT * 70, first_tag=3505),
    "circles:7x5:10:6": BoardPattern("circles", 7, 5, 10.0, 6.0),
    "acircles:4x7:7:6": BoardPattern("acircles", 4, 7, 7.0, 6.0),
    "hexcircles:6x7:10:7": BoardPattern("hexcircles", 6, 7, 10.0, 7.0),
}
RINGS = [(14, "1:2:3", None), (12, "1:2.5:4", None), (20, "1:2:3", None), (14, "1:2:3", "metashape14")]
SINGLE = ("aruco", "apriltag", "cctag")


def seen(sheet: Field, dpi: int) -> tuple[np.ndarray, np.ndarray]:
    """A camera's picture (h, w) uint8 of the page of a sheet's one board, and where its marks are (n, 2) px."""
    import pypdfium2

    (page,), _ = pages_of(sheet, {}, Paper(OWN, dpi=2400))
    raster = pypdfium2.PdfDocument(as_pdf([page], "test"))[0].render(scale=dpi / 72, grayscale=True).to_numpy()
    raster = raster.reshape(raster.shape[:2]).astype(np.float32)
    noise = np.random.default_rng(3).normal(0, 2, raster.shape)
    # White paper does not saturate a camera, and black ink is not without light.
    level = 30 + 0.75 * cv2.GaussianBlur(raster, None, 0.7) + noise
    at_mm = sheet.boards[0].marks.xy_mm + page.paper_mm / 2 + page.shift_mm
    from_top = np.column_stack([at_mm[:, 0], page.paper_mm[1] - at_mm[:, 1]])
    # The raster is a whole number of pixels wide, to which PDFium stretches the page.
    return np.rint(level).clip(0, 255).astype(np.uint8), from_top / page.paper_mm * raster.shape[::-1] - 0.5


def sheet_of(pattern: BoardPattern) -> Field:
    points = pattern.points_mm
    size = tuple((2 * pattern.half_mm + AROUND_MM).tolist())
    marks = Marks(points, pattern.diameters_mm, np.zeros(len(points), int))
    return Field(14, (NominalBoard("A", marks, 0.0, 0.0, pattern, size),), (), {}, False)


@pytest.mark.parametrize(
    "dpi", [DPI, pytest.param(150, marks=pytest.mark.slow), pytest.param(600, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("kind", BOARDS)
def test_every_point_of_a_printed_board_is_found_where_its_sheet_says(kind: str, dpi: int) -> None:
    pattern, target = BOARDS[kind], parse_target(kind)
    image, true = seen(sheet_of(pattern), dpi)
    o = detect_in_photograph(photograph_of("page", image), target).observations
    number = o.point
    if target.kind in SINGLE:
        each = len(true) // len(pattern.tags)
        number = each * (o.code - pattern.first_tag) + o.point
    elif target.kind == "runetag":
        assert set(o.code[o.point >= 0].tolist()) == {pattern.first_tag}
    here = number >= 0
    assert sorted(number[here].tolist()) == list(range(len(true)))
    assert (o.status[here] == MEASURED).all()
    assert np.abs(o.xy_px[here] - true[number[here]]).max() * 25.4 / dpi < TRUE_TO_MM


@pytest.mark.parametrize(("bits", "shape", "table"), RINGS)
def test_every_ring_code_of_a_printed_board_is_read_where_its_sheet_says(
    bits: int, shape: str, table: str | None
) -> None:
    codes = codes_for(table, bits, "--codes")
    x, y = np.meshgrid([-15.0, 0.0, 15.0], [-7.5, 7.5])
    marks = Marks(np.column_stack([x.ravel(), y.ravel()]), np.full(6, 3.0), np.arange(1, 7), bits)
    sheet = replace(Field(bits, (NominalBoard("A", marks, 0.0, 0.0),), (), {}, False), code_radii=shape, codes=codes)
    image, true = seen(sheet, DPI)
    o = detect_in_photograph(photograph_of("page", image), parse_target(f"ring{bits}"), shape, codes=codes).observations
    read = o.code > 0
    assert sorted(o.code[read].tolist()) == marks.code.tolist()
    assert (o.status[read] == MEASURED).all()
    assert np.abs(o.xy_px[read] - true[o.code[read] - 1]).max() * 25.4 / DPI < TRUE_TO_MM
