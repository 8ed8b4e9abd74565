"""Cells of an Excel workbook (.xlsx): Office Open XML, ECMA-376. Sheets are read in the order of the workbook.

A workbook of a few kilobytes can unpack to gigabytes. Its declared sizes are therefore examined before anything is
unpacked. `_UNCLEAR` are the ways in which a reader of the sheet sees something else than this program.
"""

import io
import math
import posixpath
import re
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.cell_visibility import (
    BLACK,
    WHITE,
    CellStyle,
    ConditionalFormat,
    NumberFormatParts,
    background_of,
    color_of,
    is_on,
    shown_as,
)
from rig.compare.recordings.file_kinds import kind_of, no_table

MOST_UNPACKED = 60_000_000
MOST_CELLS = 2_000_000
_MOST_LISTED, _MOST_SHOWN, _MOST_COMMENTS = 20, 40, 5
_MAIN = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
_STRICT = "{http://purl.oclc.org/ooxml/spreadsheetml/main}"
_REFERENCE = re.compile(r"([A-Z]{1,3})(\d{1,7})")
_END = re.compile(r"\$?([A-Z]{0,3})\$?(\d{0,7})")
_LETTER = re.compile(r"[^\W\d_]|[%‰]")
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, ElementTree.ParseError, KeyError, ValueError, IndexError, EOFError,
    NotImplementedError, RuntimeError, OSError,
)  # fmt: skip

_HIDDEN, _STRUCK, _INVISIBLE, _CONDITIONAL, _COLUMNS = range(5)
_UNCLEAR = {
    _HIDDEN: (
        "has rows that are hidden, by a filter or by hand", "copy the visible rows to a new sheet, or show all",
    ),
    _STRUCK: ("has rows that are struck out", "delete them, or remove the strikethrough"),
    _INVISIBLE: (
        "has rows with cells that do not show their content, since their text has the color of the background or "
        "their number format has no digits", "delete the content of these cells, or make it visible",
    ),
    _CONDITIONAL: (
        "has rows with cells that a conditional format may hide, strike out or show as another number",
        "remove the conditional format, and look at the cells again",
    ),
    _COLUMNS: (
        "has columns that are hidden, counted from A", "copy the visible columns to a new sheet, or show all",
    ),
}  # fmt: skip
"""What is wrong with rows or columns, and the remedy."""

Rows = list[tuple[int, list[str]]]


class SheetCells(NamedTuple):
    """Numbers of the rows of a sheet and their cells, and a sentence on their comments, "" for none."""

    rows: Rows
    comments: str


class _Workbook(NamedTuple):
    """An open workbook: its archive, shared texts, and the styles of its cells by their numbers."""

    path: Path
    archive: zipfile.ZipFile
    texts: list[str]
    styles: Mapping[int, CellStyle]
    conditional: list[ConditionalFormat]
    sheets: Mapping[str, str]
    """Parts of the sheets by their names."""
    hidden: frozenset[str]
    """Names of hidden sheets."""
    computed: bool
    """Whether its formulas have values: a program that writes 0 for each asks Excel to compute all on opening."""


class _Cell(NamedTuple):
    """A cell: its text, its number (None for a text), and its style."""

    text: str = ""
    number: float | None = None
    style: CellStyle = CellStyle()


@lru_cache(maxsize=1)  # a header is looked at several times before the rows are read
def sheet_cells(path: Path, content: bytes, sheet: str) -> SheetCells:
    """Return the cells of a sheet, "" for the only one with rows. Raises RecordingError."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if "xl/workbook.xml" not in archive.namelist():
                raise no_table(path, kind_of(content))
            (styles, conditional), (sheets, hidden, computed) = _styles(archive), _sheets(archive)
            texts = _shared_texts(archive)
            book = _Workbook(path, archive, texts, styles, conditional, sheets, hidden, computed)
            return SheetCells(_one_sheet(book, sheet), _comments_text(book, sheet))
    except RecordingError:
        raise
    except _DAMAGE as error:
        kind = "a damaged or encrypted workbook" if b"xl/workbook.xml" in content else kind_of(content)
        reason = (str(error).strip("'\" ") or type(error).__name__).splitlines()[0]
        raise no_table(path, f"{kind} ({reason})" if kind.startswith("a damaged") else kind) from None


def _comments_text(book: _Workbook, sheet: str) -> str:
    """Return a sentence on the comments of cells, which may reject them; "" for none."""
    try:
        parts = [book.sheets[sheet]] if sheet else list(book.sheets.values())
        found = [one for part in parts for one in _comments(book.archive, part)]
    except _DAMAGE:
        return "Cell comments are there, and cannot be read."
    more = f" and {len(found) - _MOST_COMMENTS} more" if len(found) > _MOST_COMMENTS else ""
    return f"Cell comments are not read: {'; '.join(found[:_MOST_COMMENTS])}{more}." if found else ""


def _comments(archive: zipfile.ZipFile, part: str) -> Iterator[str]:
    """Yield the cell and the text of each comment on a sheet."""
    folder, _, name = part.rpartition("/")
    relations = f"{folder}/_rels/{name}.rels"
    for relation in _xml(archive, relations) if relations in archive.namelist() else ():
        if relation.get("Type", "").endswith("/comments"):
            target = relation.get("Target", "")
            where = target.lstrip("/") if target.startswith("/") else posixpath.normpath(f"{folder}/{target}")
            for comment in _xml(archive, where):
                if comment.tag == f"{_MAIN}comment":
                    text = " ".join("".join(one.text or "" for one in comment.iter(f"{_MAIN}t")).split())
                    yield f"{comment.get('ref', '')}: {text[:_MOST_SHOWN]}"


def _one_sheet(book: _Workbook, sheet: str) -> Rows:
    if sheet and sheet not in book.sheets:
        raise RecordingError(
            f"{book.path}: there is no sheet {sheet}; the sheets are {', '.join(list(book.sheets)[:_MOST_LISTED])}",
            "no_sheet",
        )
    read = {name: _rows(book, book.sheets[name]) for name in ([sheet] if sheet else book.sheets)}
    full = {name: rows for name, rows in read.items() if any(any(cells) for _, cells in rows)}
    if len(full) > 1:
        raise RecordingError(
            f"{book.path}: {len(full)} sheets have rows; use FILE#SHEET, e.g. {book.path.name}#{next(iter(full))} "
            f"({', '.join(list(full)[:_MOST_LISTED])})",
            "several_sheets",
        )
    if not sheet and (unseen := book.hidden.intersection(full)):
        (name,) = unseen
        raise RecordingError(
            f"{book.path}: the only sheet with rows, {name}, is hidden; show it, or name it as "
            f"{book.path.name}#{name}",
            "hidden_sheet",
        )
    return next(iter(full.values()), [])


def _xml(archive: zipfile.ZipFile, name: str) -> Iterator[ElementTree.Element]:
    """Yield the elements of a part, at their ends; refuse large parts, and entities, which a workbook never has."""
    if archive.getinfo(name).file_size > MOST_UNPACKED:
        raise ValueError(f"{name} is larger than {MOST_UNPACKED / 1e6:g} MB")
    content = archive.read(name)
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise ValueError(f"{name} has entities")
    for _, element in ElementTree.iterparse(io.BytesIO(content)):
        element.tag = element.tag.replace(_STRICT, _MAIN)
        yield element


def _shared_texts(archive: zipfile.ZipFile) -> list[str]:
    if "xl/sharedStrings.xml" not in archive.namelist():
        return []
    found = []
    for element in _xml(archive, "xl/sharedStrings.xml"):
        if element.tag == f"{_MAIN}si":
            found.append(_text(element))
            element.clear()
    return found


def _text(element: ElementTree.Element) -> str:
    """Return the text of runs, without phonetic hints; one that is not what it seems says why, so it is no number."""
    runs = element.findall(f"{_MAIN}r")
    text = "".join(one.text or "" for part in (element, *runs) for one in part.findall(f"{_MAIN}t"))
    styles = [style for run in runs for style in run.findall(f"{_MAIN}rPr/*")]
    if any(style.tag == f"{_MAIN}strike" and is_on(style) for style in styles):
        return f"{text} (partly struck out in Excel)"
    raised = any(style.tag == f"{_MAIN}vertAlign" and style.get("val") != "baseline" for style in styles)
    return f"{text} (partly superscript or subscript in Excel)" if raised and not _LETTER.search(text) else text


def _styles(archive: zipfile.ZipFile) -> tuple[dict[int, CellStyle], list[ConditionalFormat]]:
    """Return the styles of cells by their numbers, and those of conditional formats."""
    if "xl/styles.xml" not in archive.namelist():
        return {}, []
    wanted = {f"{_MAIN}{name}": name for name in ("numFmts", "fonts", "fills", "cellXfs", "dxfs")}
    inside = {wanted[one.tag]: list(one) for one in _xml(archive, "xl/styles.xml") if one.tag in wanted}
    codes = {int(one.get("numFmtId", 0)): one.get("formatCode", "") for one in inside.get("numFmts", [])}
    fonts = {n: (is_on(one.find(f"{_MAIN}strike")), color_of(one.find(f"{_MAIN}color")))
             for n, one in enumerate(inside.get("fonts", []))}  # fmt: skip
    fills = {n: background_of(next(iter(one), None), _MAIN) for n, one in enumerate(inside.get("fills", []))}
    styles = {}
    for n, one in enumerate(inside.get("cellXfs", [])):
        number, font, fill = (int(one.get(key, 0)) for key in ("numFmtId", "fontId", "fillId"))
        struck, ink = fonts.get(font, (False, BLACK))
        parts = NumberFormatParts.of(codes[number]) if number in codes else None
        styles[n] = CellStyle(shown_as(number, codes.get(number, "")), struck, ink, fills.get(fill, WHITE), parts)
    return styles, [ConditionalFormat.of(one, _MAIN) for one in inside.get("dxfs", [])]


def _sheets(archive: zipfile.ZipFile) -> tuple[dict[str, str], frozenset[str], bool]:
    """Return the part of each sheet by its name, the names of hidden ones, and whether formulas have values."""
    targets = {
        element.get("Id", ""): element.get("Target", "")
        for element in _xml(archive, "xl/_rels/workbook.xml.rels")
        if element.tag.endswith("}Relationship")
    }
    found, hidden, computed = {}, set[str](), True
    for element in _xml(archive, "xl/workbook.xml"):
        if element.tag == f"{_MAIN}calcPr":
            computed = element.get("fullCalcOnLoad", "0") in ("0", "false")
        if element.tag == f"{_MAIN}sheet":
            key = next((value for name, value in element.attrib.items() if name.endswith("}id")), "")
            target = targets[key]
            hidden |= {element.get("name", "")} if element.get("state", "visible") != "visible" else set()
            found[element.get("name", "")] = target.lstrip("/") if target.startswith("/") else f"xl/{target}"
    tables = {name: part for name, part in found.items() if part in archive.namelist() and "worksheets/" in part}
    return tables, frozenset(hidden), computed


class _ConditionalCells(NamedTuple):
    """Cells that look different where a condition holds."""

    areas: list[tuple[range, range]]
    """Rows from 1 and columns from 0."""
    format: ConditionalFormat

    def may_mislead(self, row: int, column: int, cell: _Cell) -> bool:
        """Return whether a cell is one of them, and may not show its number."""
        inside = any(row in rows and column in columns for rows, columns in self.areas)
        return inside and self.format.may_mislead(cell.style.ink, cell.style.background)


def _conditional_cells(element: ElementTree.Element, book: _Workbook) -> Iterator[_ConditionalCells]:
    """Yield the rules of a conditional format; those of Excel 2010 have their areas and styles inside."""
    within = [one.text for one in element if one.tag.endswith("}sqref")]
    areas = [_area(one) for one in (element.get("sqref") or " ".join(filter(None, within))).split()]
    for rule in (one for one in element if one.tag.endswith("}cfRule")):
        known = [] if (number := rule.get("dxfId")) is None else [book.conditional[int(number)]]
        styles = [*known, *(ConditionalFormat.of(one, _MAIN) for one in rule if one.tag.endswith("}dxf"))]
        alone = any(one.get("showValue") in ("0", "false") for one in rule)  # a bar or an icon without its number
        for style in [*styles, *[ConditionalFormat(None, None, True)] * alone]:
            yield _ConditionalCells(areas, style)


def _area(cells: str) -> tuple[range, range]:
    """Return rows and columns of a range such as B3, B5:B9 or A:B."""
    ends = [_END.fullmatch(end) for end in cells.split(":")]
    if (first := ends[0]) is None or (last := ends[-1]) is None:
        raise ValueError(f"{cells} is no range of cells")
    right = _column_number(last[1]) if last[1] else MOST_CELLS
    return range(int(first[2] or 1), int(last[2] or MOST_CELLS) + 1), range(_column_number(first[1]), right + 1)


def _rows(book: _Workbook, part: str) -> Rows:
    rows, cells = list[tuple[int, list[_Cell]]](), 0
    unclear: dict[int, list[int]] = {question: [] for question in _UNCLEAR}
    conditional, merged, hidden_columns = list[_ConditionalCells](), list[str](), set[int]()
    for element in _xml(book.archive, part):
        if element.tag == f"{_MAIN}col" and _is_hidden(element, "width"):
            hidden_columns.update(range(int(element.get("min", 0)), int(element.get("max", 0)) + 1))
        if element.tag == f"{_MAIN}mergeCell" and _has_rows(element.get("ref", "")):
            merged.append(element.get("ref", ""))
        if element.tag.endswith("}conditionalFormatting"):
            conditional += _conditional_cells(element, book)
        if element.tag != f"{_MAIN}row":
            continue
        number, row = int(element.get("r", rows[-1][0] + 1 if rows else 1)), _row(element, book)
        rows.append((number, row))
        cells += len(row)
        if cells > MOST_CELLS:
            raise ValueError(f"more than {MOST_CELLS} cells")
        full = [cell for cell in row if cell.text]
        unclear[_HIDDEN] += [number] if full and _is_hidden(element, "ht") else []
        unclear[_STRUCK] += [number] if full and any(cell.style.struck for cell in row) else []
        unclear[_INVISIBLE] += [number] if any(cell.style.hides(cell.number) for cell in full) else []
        element.clear()
    for number, row in rows:
        full_columns = [(column, cell) for column, cell in enumerate(row) if cell.text]
        uncertain = any(one.may_mislead(number, *where) for one in conditional for where in full_columns)
        unclear[_CONDITIONAL] += [number] if uncertain else []
        unclear[_COLUMNS] += [column + 1 for column, _ in full_columns if column + 1 in hidden_columns]
    _refuse_unclear(book.path, unclear, merged)
    return _as_table([(number, [cell.text for cell in row]) for number, row in rows])


def _row(element: ElementTree.Element, book: _Workbook) -> list[_Cell]:
    row = list[_Cell]()
    for cell in element.findall(f"{_MAIN}c"):
        at = _REFERENCE.fullmatch(cell.get("r", ""))
        row += [_Cell()] * ((_column_number(at[1]) if at else len(row)) - len(row))
        row.append(_cell(cell, book))
    return row


def _as_table(rows: Rows) -> Rows:
    """Return rows without the empty columns before all of them, and as long as the first one."""
    full = [row for _, row in rows if any(row)]
    before = min((next(n for n, cell in enumerate(row) if cell) for row in full), default=0)
    width = max((n for n, cell in enumerate(full[0][before:], 1) if cell), default=0) if full else 0
    return [(number, row[before:] + [""] * (width - len(row[before:])) if any(row) else [""])
            for number, row in rows]  # fmt: skip


def _is_hidden(line: ElementTree.Element, size: str) -> bool:
    """Return whether a row or column is hidden, or has no size."""
    return line.get("hidden", "0") in ("1", "true") or float(line.get(size, 1.0)) == 0


def _has_rows(merged: str) -> bool:
    ends = [_REFERENCE.fullmatch(end) for end in merged.split(":")]
    return len({end[2] for end in ends if end is not None}) > 1


def _refuse_unclear(path: Path, unclear: Mapping[int, list[int]], merged: list[str]) -> None:
    """Refuse a sheet in which a reader sees other rows or columns than a program, or cells of several rows."""
    for question, (what, remedy) in _UNCLEAR.items():
        if found := sorted(set(unclear[question])):
            listed = ", ".join(map(str, found[:_MOST_LISTED])) + ", …" * (len(found) > _MOST_LISTED)
            raise RecordingError(f"{path}: {what} ({listed}); {remedy}", "unclear_rows")
    if merged:
        raise RecordingError(
            f"{path}: the cells {', '.join(merged[:_MOST_LISTED])} are merged over several rows; unmerge them and "
            "fill in every row",
            "merged_cells",
        )


def _column_number(letters: str) -> int:
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return number - 1


def _cell(cell: ElementTree.Element, book: _Workbook) -> _Cell:
    kind, value = cell.get("t", "n"), cell.findtext(f"{_MAIN}v") or ""
    style = book.styles.get(int(cell.get("s", 0)), CellStyle())
    number, text = _number(value) if kind == "n" else None, value.strip()
    if cell.find(f"{_MAIN}f") is not None and not (value and book.computed):
        text = "(a formula that was not computed; open the workbook in Excel or LibreOffice, and save it)"
    elif kind == "s":
        text = book.texts[int(value)].strip() if value else ""
    elif kind == "inlineStr":
        inside = cell.find(f"{_MAIN}is")
        text = "" if inside is None else _text(inside).strip()
    elif kind == "b":
        text = "TRUE" if value == "1" else "FALSE"
    elif number is not None and value and (shown := style.shown(number)):
        text = f"{value} ({shown})"
    return _Cell(text, number, style)


def _number(value: str) -> float:
    try:
        return float(value)
    except ValueError:
        return math.nan
