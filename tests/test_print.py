"""Prints: what comes out of the printer is what the field sheet says, to a hundredth of a millimetre."""

import io
import json
import re
import shutil
import subprocess
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pypdf
import pytest

from testfield.author.drawn_dxf import as_dxf
from testfield.author.drawn_page import as_pdf, as_png, as_svg
from testfield.author.measured_print import load_points, measured, stretched
from testfield.author.pages import Page, one_page, paper, tiled, usable
from testfield.author.print_files import Paper, cards_of, pages_of
from testfield.author.prints import print_of
from testfield.camera.images import Frame, SensorSheet
from testfield.cli.main import main
from testfield.cli.print import _as_measured
from testfield.detect.detect import detect
from testfield.detect.observations import MEASURED
from testfield.errors import TestfieldError
from testfield.targets.board_pattern import BoardPattern
from testfield.targets.field import Field, NominalBoard
from testfield.targets.marks import Marks

DPI = 600
SEEN = 4
"""Pixels of the raster that a camera's pixel sees along each side: dots of 6 mm are 35 px then."""
TRUE_TO_MM = 0.01
CAPTION = "test"


def ring_board(columns: int, rows: int, pitch_mm: float, name: str = "A") -> NominalBoard:
    """Codes at every other place of a grid, dots between them."""
    x, y = np.meshgrid(
        (np.arange(columns) - (columns - 1) / 2) * pitch_mm, (np.arange(rows) - (rows - 1) / 2) * pitch_mm
    )
    n = x.size
    coded = (np.arange(columns)[None] + np.arange(rows)[:, None]).ravel() % 2 == 0
    code = np.where(coded, np.cumsum(coded), 0)
    return NominalBoard(name, Marks(np.column_stack([x.ravel(), y.ravel()]), np.full(n, 6.0), code), 0.0, 0.0)


def sheet_of(*boards: NominalBoard, white_on_black: bool = True, loose: dict[int, float] | None = None) -> Field:
    return Field(14, boards, (), loose or {}, white_on_black)


def rasterised(pdf: bytes, folder: Path, page: int = 0) -> np.ndarray:
    """A page of a PDF in grey, by PDFium, and by Poppler where it is installed: both must agree on what is printed."""
    import pypdfium2

    shown = pypdfium2.PdfDocument(pdf)[page]
    # PDFium stretches a page to whole pixels, by 0.02 mm on A4: one that has whole pixels it leaves alone.
    wide, high = ((np.ceil(length * DPI / 72) - 1e-3) * 72 / DPI for length in shown.get_size())
    shown.set_mediabox(0, shown.get_height() - high, wide, shown.get_height())
    image = np.asarray(shown.render(scale=DPI / 72, grayscale=True).to_pil())
    if shutil.which("pdftoppm"):
        (folder / "page.pdf").write_bytes(pdf)
        command = ["pdftoppm", "-r", str(DPI), "-gray", "-f", str(page + 1), "-l", str(page + 1), "-singlefile"]
        subprocess.run([*command, str(folder / "page.pdf"), str(folder / "page")], check=True)
        poppler = cv2.imread(str(folder / "page.pgm"), cv2.IMREAD_UNCHANGED)
        assert np.abs(np.subtract(image.shape, poppler.shape)).max() <= 1
        return poppler
    return image


def frame_of(image: np.ndarray) -> Frame:
    """A camera's image of a raster."""
    rows, columns = (size // SEEN * SEEN for size in image.shape)
    image = cv2.GaussianBlur(image.astype(np.float32), None, 0.6 * SEEN)
    seen = image[:rows, :columns].reshape(rows // SEEN, SEEN, columns // SEEN, SEEN).mean(axis=(1, 3))
    # White paper does not saturate a camera, and black ink is not without light.
    noise = np.random.default_rng(3).normal(0, 200, seen.shape)
    return Frame(
        "page", np.rint(2000 + 200 * seen + noise).clip(0).astype(np.uint16), SensorSheet(40.0, 8000.0, 100, 16)
    )


def errors_mm(image: np.ndarray, page: Page, sheet: Field) -> np.ndarray:
    """(n, 2) where marks are found in a page's image less where the sheet says they are."""
    found = detect(frame_of(image), sheet, "forward_model", 8.0)
    board = page.print.board
    assert board is not None
    index = [b.name for b in sheet.boards].index(board.name)
    own = found.board == index
    assert own.sum() == len(board.marks)
    at_mm = board.marks.xy_mm[found.point[own]] + page.paper_mm / 2 + page.shift_mm
    from_top = np.column_stack([at_mm[:, 0], page.paper_mm[1] - at_mm[:, 1]])
    return (found.xy_px[own] + 0.5) * (SEEN * 25.4 / DPI) - from_top


@pytest.mark.parametrize("white_on_black", [True, False])
def test_a_printed_page_has_its_marks_where_the_sheet_says(tmp_path: Path, white_on_black: bool) -> None:
    board = ring_board(5, 7, 32.0)
    sheet = sheet_of(board, white_on_black=white_on_black)
    (page,), printed = pages_of(sheet, {}, Paper())
    errors = errors_mm(rasterised(as_pdf([page], CAPTION), tmp_path), page, printed)
    assert np.abs(errors).max() < TRUE_TO_MM
    by_png = cv2.imdecode(np.frombuffer(as_png(page, CAPTION, DPI), np.uint8), cv2.IMREAD_UNCHANGED)
    assert np.abs(errors_mm(by_png, page, printed)).max() < TRUE_TO_MM


def test_a_tiled_board_is_a_stitched_one_whose_pages_are_known_by_themselves(tmp_path: Path) -> None:
    board = ring_board(9, 9, 40.0)
    sheet = sheet_of(board)
    pages, printed = pages_of(sheet, {}, Paper(tile=True))
    assert len(pages) > 2
    assert [b.name for b in printed.boards] == [f"A {k + 1}" for k in range(len(pages))]
    codes = np.concatenate([b.marks.code[b.marks.code > 0] for b in printed.boards])
    assert sorted(codes) == sorted(board.marks.code[board.marks.code > 0])
    assert sum(len(b.marks) for b in printed.boards) == len(board.marks)
    for page in pages:
        reach = page.print.reach_mm[:, None] - 1e-6
        assert (np.abs(page.print.marks.xy_mm) + reach < page.print.size_mm / 2).all()
        low, high = (
            page.paper_mm / 2
            + page.shift_mm
            + sign * page.print.size_mm / 2
            - (page.overlap_mm * np.array(page.glue)) * (sign < 0)
            for sign in (-1, 1)
        )
        assert (low >= 5 - 1e-6).all()
        assert (high <= page.paper_mm - 5 + 1e-6).all()
    # Side by side the pages are the board again.
    area = sum(np.prod(page.print.size_mm) for page in pages)
    assert area == pytest.approx(np.prod(print_of(board, sheet).size_mm))
    image = rasterised(as_pdf(pages, CAPTION), tmp_path, 1)
    assert np.abs(errors_mm(image, pages[1], printed)).max() < TRUE_TO_MM


def test_a_page_called_as_a_board_is_is_refused() -> None:
    sheet = sheet_of(ring_board(9, 9, 40.0), replace(ring_board(3, 3, 40.0), name="A 1"))
    with pytest.raises(TestfieldError, match="another name"):
        pages_of(sheet, {}, Paper(tile=True))


def test_cuts_keep_off_the_marks_where_there_is_room() -> None:
    pages, _ = pages_of(sheet_of(ring_board(9, 9, 40.0)), {"A": (360.0, 360.0)}, Paper(tile=True))
    for page in pages:
        room = page.print.size_mm / 2 - np.abs(page.print.marks.xy_mm) - page.print.reach_mm[:, None]
        assert room.min() > 3


def test_opencv_finds_a_printed_charuco_board_where_its_sheet_says(tmp_path: Path) -> None:
    pattern = BoardPattern("charuco", 6, 8, 28.0, 21.0, "DICT_5X5_100")
    board = NominalBoard(
        "C", Marks(pattern.points_mm, np.full(35, 5.0), np.zeros(35, int)), 0.0, 0.0, pattern, (180.0, 240.0)
    )
    (page,), _ = pages_of(sheet_of(board), {}, Paper())
    image = rasterised(as_pdf([page], CAPTION), tmp_path)
    opencv = cv2.aruco.CharucoBoard((6, 8), 28.0, 21.0, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100))
    seen = cv2.GaussianBlur(image, (0, 0), 2.0)
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(opencv).detectBoard(seen)
    assert len(numbers) == 35
    found_mm = (corners.reshape(-1, 2) + 0.5) * 25.4 / DPI
    there = pattern.points_mm[numbers.ravel()] + page.paper_mm / 2 + page.shift_mm
    assert np.abs(found_mm - np.column_stack([there[:, 0], page.paper_mm[1] - there[:, 1]])).max() < 0.03


def test_every_format_has_its_true_size() -> None:
    (page,), _ = pages_of(sheet_of(ring_board(3, 3, 50.0)), {}, Paper())
    import ezdxf
    from PIL import Image

    pdf = pypdf.PdfReader(io.BytesIO(as_pdf([page], CAPTION)))
    width, height = (float(v) * 25.4 / 72 for v in list(pdf.pages[0].mediabox)[2:])
    assert (width, height) == pytest.approx((210, 297), abs=1e-3)
    assert pdf.trailer["/Root"]["/ViewerPreferences"]["/PrintScaling"] == "/None"
    head = as_svg(page, CAPTION)[:1500].decode()
    assert re.search(r'width="210mm"', head)
    assert re.search(r'height="297mm"', head)
    image = Image.open(io.BytesIO(as_png(page, CAPTION, 300)))
    assert image.size == pytest.approx((210 * 300 / 25.4, 297 * 300 / 25.4), abs=1)
    assert image.info["dpi"] == pytest.approx((300, 300), abs=0.1)
    drawing = ezdxf.read(io.StringIO(as_dxf(page.print).decode()))
    assert drawing.units == ezdxf.units.MM
    circles = np.array([[c.dxf.center.x, c.dxf.center.y, c.dxf.radius] for c in drawing.modelspace().query("CIRCLE")])
    marks = page.print.marks
    assert np.allclose(circles, np.column_stack([marks.xy_mm, marks.diameter_mm / 2]))


def test_a_dxf_of_squares_covers_what_is_black_once() -> None:
    import ezdxf

    pattern = BoardPattern("charuco", 4, 5, 30.0, 22.0, "DICT_4X4_50")
    one = print_of(
        NominalBoard("C", Marks(pattern.points_mm, np.ones(12), np.zeros(12, int)), 0.0, 0.0, pattern), sheet_of()
    )
    drawing = ezdxf.read(io.StringIO(as_dxf(one).decode()))
    boxes = [np.array([p[:2] for p in line]) for line in drawing.modelspace().query('LWPOLYLINE[layer=="CELLS"]')]
    area = sum(float(np.ptp(box[:, 0]) * np.ptp(box[:, 1])) for box in boxes)
    cells = pattern.cells
    assert area == pytest.approx((np.outer(np.diff(cells.y_mm), np.diff(cells.x_mm)) * cells.black).sum())
    assert all(cells.at(box.mean(axis=0)) for box in boxes)


def test_cards_of_all_loose_targets_share_pages_and_none_covers_another() -> None:
    loose = {code: 12.0 + code % 3 for code in range(1, 60)}
    pages = cards_of(sheet_of(loose=loose), Paper())
    assert sorted(np.concatenate([page.print.marks.code for page in pages])) == sorted(loose)
    for page in pages:
        area = page.print.areas_mm
        assert (np.abs(area) <= np.tile(page.print.size_mm / 2, 2) + 1e-6).all()
        apart = (area[:, None, 2:] <= area[None, :, :2]).any(axis=2)
        assert (apart | apart.T | np.eye(len(area), dtype=bool)).all()


@pytest.mark.parametrize("white_on_black", [True, False])
def test_cards_bear_their_numbers_and_are_read_as_such(tmp_path: Path, white_on_black: bool) -> None:
    loose = {code: 14.0 for code in (7, 101, 444, 516)}
    sheet = sheet_of(loose=loose, white_on_black=white_on_black)
    pdf = as_pdf(cards_of(sheet, Paper()), CAPTION)
    assert set(map(str, loose)) <= set(pypdf.PdfReader(io.BytesIO(pdf)).pages[0].extract_text().split())
    found = detect(frame_of(rasterised(pdf, tmp_path)), sheet, "forward_model", 8.0)
    assert sorted(found.code[found.code > 0]) == sorted(loose)
    assert (found.status[found.code > 0] == MEASURED).all()


def test_what_no_page_holds_and_what_no_printer_draws_is_refused() -> None:
    large = sheet_of(ring_board(9, 9, 40.0))
    with pytest.raises(TestfieldError, match="--tile it over pages of A4"):
        pages_of(large, {}, Paper())
    coded = replace(large.boards[0].marks, code=np.where(large.boards[0].marks.code == 1, 1, 0))
    with pytest.raises(TestfieldError, match=r"take A2$"):  # no pages of which each has codes
        pages_of(sheet_of(replace(large.boards[0], marks=coded)), {}, Paper())
    with pytest.raises(TestfieldError, match="dots of a printer"):
        pages_of(large, {}, Paper(tile=True, dpi=60))
    with pytest.raises(TestfieldError, match="coded targets"):
        few = ring_board(9, 9, 40.0)
        marks = replace(few.marks, code=np.where(few.marks.code <= 2, few.marks.code, 0))
        pages_of(sheet_of(replace(few, marks=marks)), {}, Paper(tile=True))
    with pytest.raises(TestfieldError, match="no cut"):
        tiled(print_of(ring_board(9, 9, 12.0), large), np.array([60.0, 70.0]), 5.0, 10.0)
    pattern = BoardPattern("checkerboard", 20, 20, 30.0)
    board = NominalBoard(
        "K", Marks(pattern.points_mm, np.ones(361), np.zeros(361, int)), 0.0, 0.0, pattern, (620.0, 620.0)
    )
    with pytest.raises(TestfieldError, match="found as a whole"):
        pages_of(sheet_of(board), {}, Paper(tile=True))
    with pytest.raises(TestfieldError, match="no paper"):
        paper("A9")


def test_a_page_across_is_taken_where_an_upright_one_is_too_narrow() -> None:
    one = print_of(ring_board(7, 3, 36.0), sheet_of())
    page = one_page(one, paper("A4"), 5.0)
    assert page.paper_mm.tolist() == [297, 210]
    assert (one.size_mm <= usable(page.paper_mm, 5.0)).all()


def test_measured_points_enter_the_sheet_turned_into_its_frame(tmp_path: Path) -> None:
    board = ring_board(5, 5, 40.0)
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    printed = board.marks.xy_mm @ np.array([[1.0008, 0.0002], [0.0, 0.9995]])
    table = printed @ turn.T + [300, -20]
    file = tmp_path / "A.csv"
    rows = [f"{k + 1},{x:.6f},{y:.6f},0.003" for k, (x, y) in enumerate(table) if k != 7]
    file.write_text("\n".join(["mark,x_mm,y_mm,u_mm", *rows]))
    found = measured(board, load_points(file, board, None))
    # The frame of a sheet is free: compared by distances, and the mark that nobody measured too.
    for a, b in ((0, 24), (4, 20), (7, 12)):
        true = np.linalg.norm(printed[a] - printed[b])
        assert np.linalg.norm(found.marks.xy_mm[a] - found.marks.xy_mm[b]) == pytest.approx(true, abs=2e-4)
    assert found.u_xy_mm == pytest.approx(0.003, rel=0.1)
    both = stretched(sheet_of(board), 1.0008, 0.9995, 2e-5)
    assert both.u_scale == 2e-5
    assert np.allclose(both.boards[0].marks.xy_mm, board.marks.xy_mm * [1.0008, 0.9995])


def test_boards_that_were_all_measured_have_a_scale_that_somebody_must_state(tmp_path: Path) -> None:
    sheet = sheet_of(ring_board(3, 3, 40.0), ring_board(3, 3, 40.0, "B"))
    file = tmp_path / "points.csv"
    rows = [f"{k + 1},{x},{y},0.002" for k, (x, y) in enumerate(sheet.boards[0].marks.xy_mm)]
    file.write_text("\n".join(["mark,x_mm,y_mm,u_mm", *rows]))

    def entered(u_scale: float | None, *boards: str) -> float:
        points = [f"{board}={file}" for board in boards]
        args = Namespace(scale_x=None, scale_y=None, u_scale=u_scale, u_um=None, points=points)
        return _as_measured(replace(sheet, u_scale=5e-4), args).u_scale

    assert entered(None, "A") == 5e-4  # of the other board nobody knows more
    assert entered(3e-6, "A", "B") == 3e-6
    with pytest.raises(TestfieldError, match="--u-scale"):
        entered(None, "A", "B")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("x_mm,y_mm\n1,2", "no column mark or code, u_mm"),
        ("mark,x_mm,y_mm,u_mm\n1,2,x,0.1", "line 2"),
        ("mark,x_mm,y_mm,u_mm\n99,2,3,0.1", "no mark 99"),
        ("mark,x_mm,y_mm,u_mm\n1,2,nan,0.1", "line 2"),
        ("mark,x_mm,y_mm,u_mm\n1,2,3,0.1\n1,2,3,0.1", "twice"),
        ("mark,x_mm,y_mm,u_mm\n1,2,3,0.1", "1 points"),
        ("mark,x_mm,y_mm,u_mm\n1,0,0,0.1\n2,500,0,0.1\n3,0,900,0.1", "from where it was printed"),
    ],
)
def test_a_table_of_points_that_is_wrong_is_refused_with_its_line(tmp_path: Path, text: str, what: str) -> None:
    board, file = ring_board(3, 3, 40.0), tmp_path / "points.csv"
    file.write_text(text)
    with pytest.raises(TestfieldError) as found:
        measured(board, load_points(file, board, None))
    assert what in str(found.value)


def test_the_command_prints_a_scene_and_writes_over_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "print"
    command = ["print", "charuco", "--paper", "A1", "--out", str(out), "--json"]
    assert main(command) == 0
    files = json.loads(capsys.readouterr().out)["files"]
    assert {Path(file).name for file in files} == {"field.json", "boards.pdf", "cards.pdf"}
    assert Field.load(out / "field.json").u_scale == 5e-4
    on_paper = json.loads((out / "print.json").read_text())["sheet_on_paper"]
    assert on_paper in pypdf.PdfReader(out / "boards.pdf").pages[0].extract_text()
    assert main(command) == 2
    assert "--force" in capsys.readouterr().err
    assert main([*command, "--force", "--scale-x", "1.001", "--scale-y", "1.001"]) == 2
    assert "--u-scale" in capsys.readouterr().err
    assert main([*command, "--force", "--scale-x", "1.001", "--scale-y", "1.001", "--u-scale", "2e-5"]) == 0
    capsys.readouterr()
    # What was measured is in the sheet, and the digest on the paper that is in hand is still that of the pages.
    assert json.loads((out / "print.json").read_text())["sheet_on_paper"] == on_paper
    assert Field.load(out / "field.json").u_scale == 2e-5
    assert main([*command, "--force", "--formats", "svg"]) == 0
    assert {file.suffix for file in out.iterdir()} == {".json", ".svg"}
    capsys.readouterr()
    assert main([*command, "--board", "charco", "--force"]) == 2
    assert main(["print", "quick", "--formats", "pfd", "--out", str(out)]) == 2
    assert "pdf" in capsys.readouterr().err
