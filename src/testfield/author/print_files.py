"""The files of a print: pages, drawings, and the field sheet that belongs to them."""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from testfield.author.drawn_dxf import as_dxf
from testfield.author.drawn_page import MOST_PIXELS, as_pdf, as_png, as_svg, pixels
from testfield.author.pages import (
    CAPTION_MM,
    OVERLAP_MM,
    Page,
    one_page,
    own_page,
    paper,
    tiled,
    upright_or_across,
    usable,
)
from testfield.author.prints import Print, card_of, prints_of
from testfield.errors import TestfieldError
from testfield.store.atomic import whole
from testfield.store.digests import file_digest
from testfield.store.text import read_text, write_text
from testfield.targets.field import Field
from testfield.targets.marks import Marks

LIST = "print.json"
"""In a print's folder: its files, and the digest on its pages."""
FORMATS = ("pdf", "svg", "dxf", "png")
OWN = "board"
"""The paper that is as large as what is printed on it."""
DOTS_A_FEATURE = 10.0
"""Printed dots across the smallest feature: with fewer, where its edges come to lie is the printer's choice."""
GAP_MM = 4.0
"""Between cards that share a page."""
U_SCALE = 5e-4
"""Of a print that nobody has measured: what makers of office printers state, and paper's moisture changes."""


@dataclass(frozen=True)
class Paper:
    """How pages are made: `name` of a paper or `OWN`, `margin_mm` that the printer leaves, `tile` whether what is
    larger goes over several pages that share `overlap_mm`, `dpi` of the printer."""

    name: str = "A4"
    margin_mm: float = 5.0
    tile: bool = False
    overlap_mm: float = OVERLAP_MM
    dpi: float = 600.0


def pages_of(sheet: Field, sizes_mm: dict[str, tuple[float, float]], how: Paper) -> tuple[list[Page], Field]:
    """The pages of all boards of a sheet, and the sheet of what is printed: parts of a board are boards of their own.

    Raises `TestfieldError` where a board does not fit, or where the printer cannot draw it true.
    """
    pages: list[Page] = []
    for one in prints_of(sheet, sizes_mm):
        check_dpi(one, how.dpi)
        if how.name == OWN:
            pages.append(own_page(one, how.margin_mm))
        elif how.tile and upright_or_across(one.size_mm, paper(how.name), how.margin_mm) is None:
            pages += tiled(one, paper(how.name), how.margin_mm, how.overlap_mm)
        else:
            pages.append(one_page(one, paper(how.name), how.margin_mm))
    boards = tuple(page.print.board for page in pages if page.print.board is not None)
    names = [board.name for board in boards]
    for page in pages:
        if names.count(page.print.name) > 1:
            raise TestfieldError(
                f"page {page.number} of board '{page.of}' is called '{page.print.name}', and a board is called so too",
                "--tile",
                "give one of the two boards another name",
            )
    return pages, replace(sheet, boards=boards)


def cards_of(sheet: Field, how: Paper) -> list[Page]:
    """Pages of the coded targets that belong to no board, to be cut out: bars' ends and stickers."""
    cards = [card_of(code, diameter, sheet) for code, diameter in sorted(sheet.loose.items())]
    if not cards:
        return []
    for card in cards:
        check_dpi(card, how.dpi)
    paper_mm = paper("A4" if how.name == OWN else how.name)
    room = usable(paper_mm, how.margin_mm)
    pages: list[Page] = []
    placed: list[tuple[Print, np.ndarray]] = []
    at, row_high = np.zeros(2), 0.0
    for card in sorted(cards, key=lambda c: -c.size_mm[1]):
        if np.any(card.size_mm > room):
            one_page(card, paper_mm, how.margin_mm)  # says what does not fit
        if at[0] + card.size_mm[0] > room[0]:
            at = np.array([0.0, at[1] + row_high + GAP_MM])
        if at[1] + card.size_mm[1] > room[1]:
            pages.append(_together(placed, paper_mm, room, sheet))
            at, placed = np.zeros(2), []
        if at[0] == 0:
            row_high = card.size_mm[1]
        placed.append((card, at + card.size_mm / 2))
        at = at + [card.size_mm[0] + GAP_MM, 0]
    pages.append(_together(placed, paper_mm, room, sheet))
    return [replace(page, number=k + 1, count=len(pages)) for k, page in enumerate(pages)]


def check_dpi(one: Print, dpi: float) -> None:
    """Raise `TestfieldError` where a printer of so many dots an inch cannot draw a print true."""
    dots = one.finest_mm * dpi / 25.4
    if dots < DOTS_A_FEATURE:
        raise TestfieldError(
            f"the finest print on '{one.name}' is {one.finest_mm:.3g} mm, {dots:.1f} dots of a printer of {dpi:.0f} "
            f"dpi, and edges come out true from {DOTS_A_FEATURE:.0f} dots on",
            "--dpi",
            f"take a printer of {int(np.ceil(DOTS_A_FEATURE * 25.4 / one.finest_mm / 100) * 100)} dpi, or larger marks",
        )


def write(
    folder: Path,
    name: str,
    boards: Sequence[Page],
    cards: Sequence[Page],
    sheet: Field,
    how: Paper,
    formats: Sequence[str],
    day: str,
    drawn: Field | None = None,
) -> list[Path]:
    """All files of a print, in the order in which somebody needs them; names, `day` and the field sheet's digest are on
    every page. What was written into the folder before and is no part of this print is removed.

    `drawn` is the sheet as it was before anybody measured the print: its digest is on the paper that is in hand, and
    stays there whatever is measured; absent, nobody has.
    """
    for page in [*boards, *cards] if "png" in formats else []:
        if pixels(page, how.dpi) > MOST_PIXELS:
            raise TestfieldError(
                f"a page of '{page.of}' would have {pixels(page, how.dpi) / 1e6:.0f} megapixels at {how.dpi:.0f} dpi, "
                f"and {MOST_PIXELS / 1e6:.0f} are written at most",
                "--formats png",
                "take PDF or SVG, which have no pixels, or a lower --dpi",
            )
    folder.mkdir(parents=True, exist_ok=True)
    written = [folder / "field.json"]
    with whole(written[0]) as part:
        sheet.save(part)
    digest = _digest(drawn or sheet)
    caption = f"{name}   sheet {digest}   {day}   print at 100 %, never to fit the page"

    def put(file: str, content: bytes) -> None:
        with whole(folder / file) as part:
            part.write_bytes(content)
        written.append(folder / file)

    for what, pages in (("boards", boards), ("cards", cards)):
        if pages and "pdf" in formats:
            put(f"{what}.pdf", as_pdf(pages, caption))
        for page in pages:
            stem = page.print.name.replace(" ", "-") if what == "boards" else f"cards-{page.number}"
            if "svg" in formats:
                put(f"{stem}.svg", as_svg(page, caption))
            if "png" in formats:
                put(f"{stem}.png", as_png(page, caption, how.dpi))
            if "dxf" in formats:
                put(f"{stem}.dxf", as_dxf(page.print))
    _tidy(folder, [file.name for file in written], digest)
    return written


def _digest(sheet: Field) -> str:
    """The twelve digits that are printed on pages: of the field sheet's file."""
    with TemporaryDirectory(prefix="testfield-") as folder:
        file = Path(folder) / "field.json"
        sheet.save(file)
        return file_digest(file)[:12]


def _tidy(folder: Path, names: list[str], digest: str) -> None:
    """Note what a print consists of, and remove what the note of an earlier one has besides."""
    note = folder / LIST
    earlier: list[str] = []
    if note.exists():
        with suppress(ValueError, TypeError, AttributeError):  # a damaged note lists nothing that may be removed
            earlier = [str(name) for name in json.loads(read_text(note)).get("files", [])]
    for name in earlier:
        if name not in names and Path(name).name == name and Path(name).suffix[1:] in FORMATS:
            (folder / name).unlink(missing_ok=True)
    with whole(note) as part:
        write_text(part, json.dumps({"sheet_on_paper": digest, "files": names}, indent=1))


def _together(placed: list[tuple[Print, np.ndarray]], paper_mm: np.ndarray, room: np.ndarray, sheet: Field) -> Page:
    """Cards as one print, from the top left of the room on."""
    middles = np.array([[x - room[0] / 2, room[1] / 2 - y] for _, (x, y) in placed])
    half = np.array([card.size_mm / 2 for card, _ in placed])
    diameter = np.concatenate([card.marks.diameter_mm for card, _ in placed])
    marks = Marks(middles, diameter, np.concatenate([card.marks.code for card, _ in placed]), sheet.bits)
    one = Print(
        name="cards",
        size_mm=room,
        white_on_black=sheet.white_on_black,
        marks=marks,
        codes=sheet.codes,
        radii=sheet.radii,
        cards=np.column_stack([middles - half, middles + half]),
    )
    return Page(paper_mm, one, np.array([0.0, CAPTION_MM / 2]), of="cards")
