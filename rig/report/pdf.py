"""A report as PDF, laid out for A4 from its HTML page."""

import base64
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib as mpl
from fpdf import FPDF
from fpdf.enums import MethodReturnValue
from fpdf.fonts import FontFace
from PIL import Image

from rig.report.style import PAGE_IN, PNG_DOTS_PER_INCH

HEADINGS = ("h1", "h2", "h3")
_TEXTS = (*HEADINGS, "p", "li", "figcaption")
_SKIPPED = ("style", "script", "nav", "title")
_CELLS = ("td", "th")
_SPACES = re.compile(r"[ \t\r\n]+")  # non-breaking spaces stay


@dataclass
class PageBlock:
    """Heading, paragraph, image or table of a page."""

    kind: str
    text: str = ""
    picture: bytes = b""
    rows: list[list[str]] = field(default_factory=list)


def blocks(html: str) -> list[PageBlock]:
    """Return the parts of a report page in order; images must be PNG."""
    reader = _Reader()
    reader.feed(html)
    return [block for block in reader.found if block.text or block.picture or block.rows]


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[PageBlock] = []
        self._skipping = 0
        self._pieces: list[str] | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in _SKIPPED:
            self._skipping += 1
        elif tag in _TEXTS or tag in _CELLS:
            self._pieces = []
        elif tag == "table":
            self.found.append(PageBlock("table"))
        elif tag == "tr":
            self.found[-1].rows.append([])
        elif tag == "img":
            _, _, content = (dict(attrs)["src"] or "").partition("base64,")
            self.found.append(PageBlock("picture", picture=base64.b64decode(content)))

    def handle_endtag(self, tag: str) -> None:
        if tag in _SKIPPED:
            self._skipping -= 1
        elif tag in _TEXTS or tag in _CELLS:
            text, self._pieces = _SPACES.sub(" ", "".join(self._pieces or [])).strip(), None
            if tag in _CELLS:
                self.found[-1].rows[-1].append(text)
            else:
                self.found.append(PageBlock(tag, f"• {text}" if tag == "li" else text))

    def handle_data(self, data: str) -> None:
        if self._pieces is not None and not self._skipping:
            self._pieces.append(data)


_POINTS = {"h1": 15.0, "h2": 12.0, "h3": 10.0, "p": 8.5, "li": 8.5, "figcaption": 7.5}
_TABLE_POINTS = 6.5
_WIDEST_CHARACTERS = 40
_MM_PER_CHARACTER = 1.35
_BOLD = 1.3  # width of bold text relative to regular text
_CELL_PADDING_MM = 4.0
_LINE_MM_PER_POINT = 0.5
_ABOVE_HEADING_MM, _AFTER_TEXT_MM, _AFTER_PICTURE_MM, _AFTER_TABLE_MM = 2.0, 1.0, 1.0, 2.0
_LEAST_OF_A_TABLE_MM = 30.0
_LONG_TABLE_MM = 90.0
"""Height in mm above which a table may be split; its header is repeated."""
_MM_PER_INCH = 25.4


class _Document(FPDF):
    """Document in A4 landscape with page numbers in the footer."""

    def footer(self) -> None:
        self.set_y(-10)
        self.set_font("DejaVu", "", 6.5)
        self.cell(0, 4, f"{self.page_no()} / {{nb}}", align="R")


def as_pdf(html: str, when: datetime) -> bytes:
    """Return the page as a PDF in A4 landscape; the same page and date give the same bytes."""
    pdf = _Document(orientation="landscape", format="A4")
    pdf.set_creation_date(when)
    pdf.set_auto_page_break(True, margin=14)
    fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
    pdf.add_font("DejaVu", "", fonts / "DejaVuSans.ttf")
    pdf.add_font("DejaVu", "B", fonts / "DejaVuSans-Bold.ttf")
    pdf.add_page()
    found = blocks(html)
    for k, block in enumerate(found):
        if pdf.get_y() > pdf.t_margin and pdf.will_page_break(_together_mm(pdf, found[k:])):
            pdf.add_page()
        if block.kind == "table":
            _table(pdf, block.rows)
        elif block.kind == "picture":
            _picture(pdf, block.picture)
        else:
            _text(pdf, block)
    return bytes(pdf.output())


def _together_mm(pdf: FPDF, rest: Sequence[PageBlock]) -> float:
    """Return the height (mm) of the first block and of the blocks that must share its page."""
    first, *after = rest
    height = _height_mm(pdf, first)
    return height + _together_mm(pdf, after) if after and _keeps(first.kind, after[0].kind) else height


def _keeps(kind: str, following: str) -> bool:
    """Return whether a block shares a page with the next: headings, table introductions, images with captions."""
    return kind in HEADINGS or (kind, following) in (("p", "table"), ("p", "picture"), ("picture", "figcaption"))


def _height_mm(pdf: FPDF, block: PageBlock) -> float:
    if block.kind == "table":
        height = _table_mm(pdf, block.rows)
        return height if height < _LONG_TABLE_MM else _LEAST_OF_A_TABLE_MM
    if block.kind == "picture":
        return _size_mm(pdf, block.picture)[1] + _AFTER_PICTURE_MM
    lines = _written(pdf, block, dry_run=True, output=MethodReturnValue.HEIGHT)
    return float(lines) + _AFTER_TEXT_MM + (_ABOVE_HEADING_MM if block.kind in HEADINGS else 0.0)


def _text(pdf: FPDF, block: PageBlock) -> None:
    if block.kind in HEADINGS:
        pdf.ln(_ABOVE_HEADING_MM)
        pdf.start_section(block.text, HEADINGS.index(block.kind), strict=False)
    _written(pdf, block)
    pdf.ln(_AFTER_TEXT_MM)


def _written(pdf: FPDF, block: PageBlock, **how: Any) -> Any:
    points = _POINTS[block.kind]
    pdf.set_font("DejaVu", "B" if block.kind in HEADINGS else "", points)
    line = points * _LINE_MM_PER_POINT
    text = block.text.replace(" %", "\N{NO-BREAK SPACE}%")
    return pdf.multi_cell(0, line, text, align="L", new_x="LMARGIN", new_y="NEXT", **how)


def _picture(pdf: FPDF, content: bytes) -> None:
    pdf.image(io.BytesIO(content), w=_size_mm(pdf, content)[0])
    pdf.ln(_AFTER_PICTURE_MM)


def _size_mm(pdf: FPDF, content: bytes) -> tuple[float, float]:
    """Return width and height (mm): the size of the image, or the largest that fits a page below a heading."""
    with Image.open(io.BytesIO(content)) as image:
        own = image.width / PNG_DOTS_PER_INCH * _MM_PER_INCH
        shape = image.height / image.width
    width = min(own, pdf.epw, PAGE_IN[1] * _MM_PER_INCH / shape)
    return width, width * shape


def _table(pdf: FPDF, rows: list[list[str]]) -> None:
    pdf.set_font("DejaVu", "", _TABLE_POINTS)
    filled, widths = _columns(rows)
    width = min(pdf.epw, sum(widths))
    with pdf.table(
        col_widths=tuple(widths),
        width=width,
        align="LEFT",
        text_align="LEFT",
        line_height=_TABLE_POINTS * _LINE_MM_PER_POINT,
        borders_layout="HORIZONTAL_LINES",
        headings_style=FontFace(emphasis="BOLD"),
    ) as table:
        for row in filled:
            table.row(row)
    pdf.line(pdf.l_margin, pdf.get_y(), pdf.l_margin + width, pdf.get_y())
    pdf.ln(_AFTER_TABLE_MM)


def _columns(rows: list[list[str]]) -> tuple[list[list[str]], list[float]]:
    """Return the rows padded to one length, and the preferred width of each column (mm)."""
    columns = max(len(row) for row in rows)
    filled = [row + [""] * (columns - len(row)) for row in rows]
    return filled, [_CELL_PADDING_MM + _MM_PER_CHARACTER * _characters(c) for c in zip(*filled, strict=True)]


def _characters(column: tuple[str, ...]) -> int:
    """Return the preferred width in characters: the longest short cell, and the longest word of the header."""
    longest_word = max((len(word) for word in column[0].split()), default=1)
    return max(round(_BOLD * longest_word), min(_WIDEST_CHARACTERS, max(len(cell) for cell in column[1:] or column)))


def _table_mm(pdf: FPDF, rows: list[list[str]]) -> float:
    """Estimate the height of a table (mm) from its number of characters."""
    filled, widths = _columns(rows)
    shrunk = min(1.0, pdf.epw / sum(widths))
    room = [max(shrunk * width - _CELL_PADDING_MM, 1.0) / _MM_PER_CHARACTER for width in widths]
    lines = [max(-(-len(cell) // int(most + 1)) for cell, most in zip(row, room, strict=True)) for row in filled]
    return sum(lines) * _TABLE_POINTS * _LINE_MM_PER_POINT + _AFTER_TABLE_MM
