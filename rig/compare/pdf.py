"""A report as PDF: what its HTML page says, laid out for A4, so that there is one source for both."""

import base64
import io
from dataclasses import dataclass, field
from datetime import datetime
from html.parser import HTMLParser
from pathlib import Path

import matplotlib as mpl
from fpdf import FPDF
from fpdf.fonts import FontFace
from PIL import Image

from rig.compare.style import PNG_DOTS_PER_INCH

_POINTS = {"h1": 15.0, "h2": 12.0, "h3": 10.0, "p": 8.5, "li": 8.5, "figcaption": 7.5}
_TABLE_POINTS = 6.5
_SKIPPED = ("style", "nav", "title")
_CELLS = ("td", "th")
_WIDEST_CHARACTERS = 40
_MM_PER_CHARACTER = 1.35
_BOLD = 1.3  # times as wide
_CELL_PADDING_MM = 4.0
_LINE_MM_PER_POINT = 0.5
_BELOW_HEADING_MM = 30.0
_MM_PER_INCH = 25.4


@dataclass
class Block:
    """A heading, a paragraph, a picture or a table, in the order of the page."""

    kind: str
    text: str = ""
    picture: bytes = b""
    rows: list[list[str]] = field(default_factory=list)


def blocks(html: str) -> list[Block]:
    """What a page of this program's reports consists of; pictures must be PNG."""
    reader = _Reader()
    reader.feed(html)
    return [block for block in reader.found if block.text or block.picture or block.rows]


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[Block] = []
        self._skipping = 0
        self._pieces: list[str] | None = None

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag in _SKIPPED:
            self._skipping += 1
        elif tag in _POINTS or tag in _CELLS:
            self._pieces = []
        elif tag == "table":
            self.found.append(Block("table"))
        elif tag == "tr":
            self.found[-1].rows.append([])
        elif tag == "img":
            _, _, content = (dict(attrs)["src"] or "").partition("base64,")
            self.found.append(Block("picture", picture=base64.b64decode(content)))

    def handle_endtag(self, tag: str) -> None:
        if tag in _SKIPPED:
            self._skipping -= 1
        elif tag in _POINTS or tag in _CELLS:
            text, self._pieces = " ".join("".join(self._pieces or []).split()), None
            if tag in _CELLS:
                self.found[-1].rows[-1].append(text)
            else:
                self.found.append(Block(tag, f"• {text}" if tag == "li" else text))

    def handle_data(self, data: str) -> None:
        if self._pieces is not None and not self._skipping:
            self._pieces.append(data)


def as_pdf(html: str, when: datetime) -> bytes:
    """The page on A4, landscape; the same page and date give the same bytes."""
    pdf = FPDF(orientation="landscape", format="A4")
    pdf.set_creation_date(when)
    fonts = Path(mpl.get_data_path()) / "fonts" / "ttf"
    pdf.add_font("DejaVu", "", fonts / "DejaVuSans.ttf")
    pdf.add_font("DejaVu", "B", fonts / "DejaVuSans-Bold.ttf")
    pdf.add_page()
    found = blocks(html)
    for k, block in enumerate(found):
        if block.kind == "table":
            _table(pdf, block.rows)
        elif block.kind == "picture":
            _picture(pdf, block.picture)
        else:
            _text(pdf, block, found[k + 1 : k + 3])
    return bytes(pdf.output())


def _text(pdf: FPDF, block: Block, after: list[Block]) -> None:
    """A heading is not left at the foot of a page, without the picture that comes after it."""
    points = _POINTS[block.kind]
    heading = block.kind.startswith("h")
    pdf.set_font("DejaVu", "B" if heading else "", points)
    if heading:
        pdf.ln(2)
        pictures = [_size(pdf, one.picture)[1] for one in after if one.picture]
        if pdf.will_page_break(_BELOW_HEADING_MM + max(pictures, default=0.0)):
            pdf.add_page()
    pdf.multi_cell(0, points * _LINE_MM_PER_POINT, block.text, align="L", new_x="LMARGIN", new_y="NEXT")
    pdf.ln(1)


def _picture(pdf: FPDF, content: bytes) -> None:
    width, height = _size(pdf, content)
    if pdf.will_page_break(height):
        pdf.add_page()
    pdf.image(io.BytesIO(content), w=width)
    pdf.ln(1)


def _size(pdf: FPDF, content: bytes) -> tuple[float, float]:
    """Width and height in mm: its own size, or what fits a page below a heading."""
    with Image.open(io.BytesIO(content)) as image:
        own = image.width / PNG_DOTS_PER_INCH * _MM_PER_INCH
        shape = image.height / image.width
    width = min(own, pdf.epw, (pdf.eph - _BELOW_HEADING_MM) / shape)
    return width, width * shape


def _table(pdf: FPDF, rows: list[list[str]]) -> None:
    pdf.set_font("DejaVu", "", _TABLE_POINTS)
    columns = max(len(row) for row in rows)
    filled = [row + [""] * (columns - len(row)) for row in rows]
    widths = [_CELL_PADDING_MM + _MM_PER_CHARACTER * _characters(column) for column in zip(*filled, strict=True)]
    with pdf.table(
        col_widths=tuple(widths),
        width=min(pdf.epw, sum(widths)),
        align="LEFT",
        text_align="LEFT",
        line_height=_TABLE_POINTS * _LINE_MM_PER_POINT,
        borders_layout="HORIZONTAL_LINES",
        headings_style=FontFace(emphasis="BOLD"),
    ) as table:
        for row in filled:
            table.row(row)
    pdf.ln(2)


def _characters(column: tuple[str, ...]) -> int:
    """How wide a column wants to be: its longest cell, if that is no sentence, and its header's longest word."""
    longest_word = max((len(word) for word in column[0].split()), default=1)
    return max(round(_BOLD * longest_word), min(_WIDEST_CHARACTERS, max(len(cell) for cell in column[1:] or column)))
