"""Cells of a table, row by row: from CSV files, Excel workbooks (.xlsx) and MATLAB files (.mat).

A workbook or an archive of a few kilobytes can unpack to gigabytes. Its declared sizes are therefore examined before
anything is unpacked.
"""

import csv
import io
import posixpath
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.cell_visibility import (
    BLACK,
    WHITE,
    Color,
    ConditionalFormat,
    NumberFormatParts,
    are_alike,
    background_of,
    color_of,
    is_on,
    shown_as,
)
from rig.compare.recordings.column_units import same_name
from rig.compare.recordings.file_kinds import MATLAB, UTF_16, ZIP, is_matlab_4, kind_of
from rig.compare.recordings.matlab_file import matlab_variables
from rig_shared.user_files import MOST_LINES, read_bytes, text_of

Lines = Iterator[tuple[int, list[str]]]

MOST_TABLE_BYTES = 100_000_000
_MOST_UNPACKED = 60_000_000
_MOST_CELLS = 2_000_000
_MOST_LISTED, _MOST_SHOWN = 20, 40
_SEPARATORS = (",", ";", "\t")
_COMMENT = ("#", "%", "//")
_COMMENT_ROW = (*_COMMENT, ";", "!", "--")
"""Signs before a row below the header that is commented out; alone, the last ones may mean that there is no value."""
_SEPARATOR_LINE = re.compile(r'"?sep=.?"?', re.IGNORECASE)  # written above the header for Excel
_WORKBOOK = ".xlsx"


class SameInAllRows(str):
    """A cell that a file has once for all rows."""

    __slots__ = ()


class NotUnderstood(str):
    """What a column is that has no cells, such as "a struct"."""

    __slots__ = ()


def refuse_not_understood(path: Path, column: str, cell: str) -> None:
    """Refuse a column that is there and cannot be read. Raises RecordingError."""
    if isinstance(cell, NotUnderstood):
        raise RecordingError(
            f"{path}, column {column}: is {cell}; it must be a full vector of numbers (full, double), a column of "
            "letters (N × 1), or a cell array of texts (cellstr), with one for each row",
            "not_understood",
        )


def file_and_sheet(path: Path) -> tuple[Path, str]:
    """Split the file from the sheet that is named after it, as in "counts.xlsx#Sheet2"; "" if none is named."""
    text = str(path)
    before, mark, sheet = text.rpartition("#")
    if mark and before.lower().endswith(_WORKBOOK) and not path.exists():
        return Path(before), sheet
    return path, ""


def table_lines(path: Path) -> Lines:
    """Yield the row and the stripped cells of the header (no cells for an empty file), then of each row.

    Comments and empty rows above the header are skipped, as are empty columns at the right. Raises RecordingError.
    """
    lines = _lines(path)
    first, header = next(lines, (1, []))
    while _is_above(header):
        first, header = next(lines, (first + 1, []))
        if not header and first > MOST_LINES:
            break
    header = [" ".join(same_name(cell).split()) for cell in _without_empty_ends(header, 0)]  # Excel breaks long names
    yield first, header
    for number, cells in lines:
        sign = next((sign for sign in _COMMENT_ROW if cells and cells[0].startswith(sign)), "")
        if sign and (cells[0] != sign or sign in _COMMENT):
            raise RecordingError(
                f"{path}, row {number}: begins with {cells[0][:_MOST_SHOWN]!r}, as a comment does; delete the row or "
                f"the sign {sign}",
                "comment_row",
            )
        yield number, _without_empty_ends(cells, len(header))


def _is_above(cells: list[str]) -> bool:
    return bool(cells) and (not any(cells) or cells[0].startswith(_COMMENT) or _is_separator_line(cells))


def _is_separator_line(cells: list[str]) -> bool:
    return _SEPARATOR_LINE.fullmatch(",".join(cells).strip()) is not None


def _without_empty_ends(cells: list[str], columns: int) -> list[str]:
    while len(cells) > columns and not cells[-1]:
        cells = cells[:-1]
    return cells


def _lines(path: Path) -> Lines:
    file, sheet = file_and_sheet(path)
    try:
        content = read_bytes(file, MOST_TABLE_BYTES)
    except OSError as error:
        reason = error.strerror or str(error)
        raise RecordingError(f"{path}: {reason}", "unreadable") from None
    if content.startswith(ZIP):
        return iter(_of_workbook(path, content, sheet))
    if file.suffix.lower() == ".mat" and is_matlab_4(content):
        raise _no_table(path, "a MATLAB file of version 4; save it in MATLAB with save(…, '-v7')")
    if content.startswith(MATLAB) and file.suffix.lower() == ".mat":
        return _of_matlab(path, content)
    return _of_csv(path, content)


def _no_table(path: Path, kind: str, reason: str = "") -> RecordingError:
    if kind and kind != "text":
        return RecordingError(f"{path}: not a table (CSV in UTF-8, .xlsx, .mat); it is {kind}", "no_csv")
    return RecordingError(f"{path}: not a CSV file in UTF-8: {reason}; save it as CSV UTF-8", "no_csv")


def _of_csv(path: Path, content: bytes) -> Lines:
    """Yield the rows of a CSV; its separator is the one that splits the header into the most columns."""
    if max(content.count(b"\n"), content.count(b"\r")) > MOST_LINES:
        reason = f"more than {MOST_LINES} lines, which is the limit"
        raise RecordingError(f"{path}: {reason}", "unreadable")
    utf_16 = content.startswith(UTF_16)
    kind = "" if utf_16 or not content else kind_of(content)
    if kind not in ("", "text"):
        raise _no_table(path, kind)
    row = 1
    try:
        lines = text_of(content, encoding="utf-16" if utf_16 else "utf-8-sig")
        row, header, sign = _header(lines)
        for number, line in enumerate(csv.reader(chain([header], lines), delimiter=sign), row):
            yield number, [cell.strip() for cell in line]
            row = number
    except UnicodeDecodeError as error:
        row = 1 + content[: error.start].count(b"\n")
        reason = f"row {row} has a byte of another encoding (perhaps Latin-1 or Windows-1252)"
        raise _no_table(path, "", "its text is not complete" if utf_16 else reason) from None
    except csv.Error as error:
        raise _no_table(path, "", str(error)) from None


def _header(lines: Iterator[str]) -> tuple[int, str, str]:
    """Return the row, the text and the separator of the first line with names of columns."""
    row, header = 1, next(lines, "")
    while header and (header.startswith(_COMMENT) or not header.strip(" ,;\t\r\n") or _is_separator_line([header])):
        row, header = row + 1, next(lines, "")
    return row, header, max(_SEPARATORS, key=lambda sign: len(next(csv.reader([header], delimiter=sign), [])))


def has_semicolons(path: Path) -> bool:
    """Return whether a table that can be read is a CSV whose columns are separated by semicolons."""
    content = read_bytes(file_and_sheet(path)[0], MOST_TABLE_BYTES)
    if content.startswith((ZIP, MATLAB)):
        return False
    encoding = "utf-16" if content.startswith(UTF_16) else "utf-8-sig"
    return _header(text_of(content, encoding=encoding))[2] == ";"


# Workbooks: Office Open XML, ECMA-376. Sheets are read in the order of the workbook.

_MAIN = "{http://schemas.openxmlformats.org/spreadsheetml/2006/main}"
_STRICT = "{http://purl.oclc.org/ooxml/spreadsheetml/main}"
_REFERENCE = re.compile(r"([A-Z]{1,3})(\d{1,7})")
_END = re.compile(r"\$?([A-Z]{0,3})\$?(\d{0,7})")
_LETTER = re.compile(r"[^\W\d_]|[%‰]")
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, ElementTree.ParseError, KeyError, ValueError, IndexError, EOFError,
    NotImplementedError, RuntimeError, OSError,
)  # fmt: skip


class _Workbook(NamedTuple):
    """An open workbook: its archive, shared texts, and the styles that change what a number means."""

    path: Path
    archive: zipfile.ZipFile
    texts: list[str]
    shown: Mapping[int, str]
    """What cells of a style are not plain numbers for, by the number of the style, e.g. "a percentage"."""
    struck: frozenset[int]
    colors: Mapping[int, tuple[Color, Color]]
    """Colors of text and background, by the number of the style."""
    parts: Mapping[int, NumberFormatParts]
    """Number formats of the workbook's own, by the number of the style."""
    conditional: list[ConditionalFormat]
    hidden: frozenset[str]
    """Names of hidden sheets."""
    computed: bool
    """Whether its formulas have values: a program that writes 0 for each asks Excel to compute all on opening."""

    def colors_of(self, style: int) -> tuple[Color, Color]:
        return self.colors.get(style, (BLACK, WHITE))


@lru_cache(maxsize=1)  # a header is looked at several times before the rows are read
def _of_workbook(path: Path, content: bytes, sheet: str) -> list[tuple[int, list[str]]]:
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if "xl/workbook.xml" not in archive.namelist():
                raise _no_table(path, kind_of(content))
            sheets, hidden, computed = _sheets(archive)
            book = _Workbook(path, archive, _shared_texts(archive), *_styles(archive), hidden, computed)
            return _one_sheet(book, sheets, sheet)
    except RecordingError:
        raise
    except _DAMAGE as error:
        kind = "a damaged or encrypted workbook" if b"xl/workbook.xml" in content else kind_of(content)
        reason = (str(error).strip("'\" ") or type(error).__name__).splitlines()[0]
        raise _no_table(path, f"{kind} ({reason})" if kind.startswith("a damaged") else kind) from None


def cell_comments(path: Path) -> str:
    """Return a sentence on the comments of a workbook's cells, which may reject them; "" for none."""
    file, sheet = file_and_sheet(path)
    content = read_bytes(file, MOST_TABLE_BYTES)
    if not content.startswith(ZIP):
        return ""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            sheets, *_ = _sheets(archive)
            parts = [sheets[sheet]] if sheet else list(sheets.values())
            found = [one for part in parts for one in _comments(archive, part)]
    except _DAMAGE:
        return "Cell comments are there, and cannot be read."
    if not found:
        return ""
    more = f" and {len(found) - _MOST_COMMENTS} more" if len(found) > _MOST_COMMENTS else ""
    return f"Cell comments are not read: {'; '.join(found[:_MOST_COMMENTS])}{more}."


_MOST_COMMENTS = 5


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


def _one_sheet(book: _Workbook, sheets: Mapping[str, str], sheet: str) -> list[tuple[int, list[str]]]:
    if sheet and sheet not in sheets:
        raise RecordingError(
            f"{book.path}: there is no sheet {sheet}; the sheets are {', '.join(list(sheets)[:_MOST_LISTED])}",
            "no_sheet",
        )
    read = {name: _rows(book, sheets[name]) for name in ([sheet] if sheet else sheets)}
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
    if archive.getinfo(name).file_size > _MOST_UNPACKED:
        raise ValueError(f"{name} is larger than {_MOST_UNPACKED / 1e6:g} MB")
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


def _styles(
    archive: zipfile.ZipFile,
) -> tuple[
    dict[int, str],
    frozenset[int],
    dict[int, tuple[Color, Color]],
    dict[int, NumberFormatParts],
    list[ConditionalFormat],
]:
    """Return what `_Workbook` has of the styles: `shown`, `struck`, `colors`, `parts` and `conditional`."""
    if "xl/styles.xml" not in archive.namelist():
        return {}, frozenset(), {}, {}, []
    own: dict[int, str] = {}
    styles: list[tuple[int, int, int]] = []
    fonts: list[bool] = []
    inks: list[Color] = []
    fills: list[Color] = []
    conditional: list[ConditionalFormat] = []
    for element in _xml(archive, "xl/styles.xml"):
        if element.tag == f"{_MAIN}numFmts":
            own = {int(one.get("numFmtId", 0)): one.get("formatCode", "") for one in element}
        elif element.tag == f"{_MAIN}cellXfs":
            styles = [
                (int(one.get("numFmtId", 0)), int(one.get("fontId", 0)), int(one.get("fillId", 0))) for one in element
            ]
        elif element.tag == f"{_MAIN}fonts":
            fonts = [is_on(one.find(f"{_MAIN}strike")) for one in element]
            inks = [color_of(one.find(f"{_MAIN}color")) for one in element]
        elif element.tag == f"{_MAIN}fills":
            fills = [background_of(next(iter(one), None), _MAIN) for one in element]
        elif element.tag == f"{_MAIN}dxfs":
            conditional = [ConditionalFormat.of(one, _MAIN) for one in element]
    shown = {n: what for n, (number, *_) in enumerate(styles) if (what := shown_as(number, own.get(number, "")))}
    struck = frozenset(n for n, (_, font, _) in enumerate(styles) if font < len(fonts) and fonts[font])
    colors = {
        n: (inks[font] if font < len(inks) else BLACK, fills[fill] if fill < len(fills) else WHITE)
        for n, (_, font, fill) in enumerate(styles)
    }
    parts = {n: NumberFormatParts.of(own[number]) for n, (number, *_) in enumerate(styles) if number in own}
    return shown, struck, colors, parts, conditional


def _is_unseen(cell: ElementTree.Element, book: _Workbook) -> bool:
    """Return whether a cell with content shows none: by its color, or by its number format."""
    style = int(cell.get("s", 0))
    if are_alike(*book.colors_of(style)):
        return True
    if style not in book.parts:
        return False
    number = float(cell.findtext(f"{_MAIN}v") or "nan") if cell.get("t", "n") == "n" else None
    return book.parts[style].hides(number)


class _ConditionalCells(NamedTuple):
    """Cells that look different where a condition holds."""

    areas: list[tuple[range, range]]
    """Rows from 1 and columns from 0."""
    format: ConditionalFormat

    def may_mislead(self, row: int, column: int, colors: tuple[Color, Color]) -> bool:
        """Return whether a cell of these colors is one of them, and may not show its number."""
        inside = any(row in rows and column in columns for rows, columns in self.areas)
        return inside and self.format.may_mislead(*colors)


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
    right = _column_number(last[1]) if last[1] else _MOST_CELLS
    return range(int(first[2] or 1), int(last[2] or _MOST_CELLS) + 1), range(_column_number(first[1]), right + 1)


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


def _rows(book: _Workbook, part: str) -> list[tuple[int, list[str]]]:
    found, cells = list[tuple[int, list[str]]](), 0
    hidden, struck, invisible, merged, columns = list[int](), list[int](), list[int](), list[str](), set[int]()
    styles, conditional = list[list[int]](), list[_ConditionalCells]()
    for element in _xml(book.archive, part):
        if element.tag == f"{_MAIN}col" and _is_hidden(element, "width"):
            columns.update(range(int(element.get("min", 0)), int(element.get("max", 0)) + 1))
        if element.tag == f"{_MAIN}mergeCell":
            merged += [element.get("ref", "")] if _has_rows(element.get("ref", "")) else []
        if element.tag.endswith("}conditionalFormatting"):
            conditional += _conditional_cells(element, book)
        if element.tag != f"{_MAIN}row":
            continue
        number = int(element.get("r", found[-1][0] + 1 if found else 1))
        row, unseen, of_row = list[str](), False, list[int]()
        for cell in element.findall(f"{_MAIN}c"):
            at = _REFERENCE.fullmatch(cell.get("r", ""))
            column = _column_number(at[1]) if at else len(row)
            text = _cell(cell, book)
            of_row += [0] * (column - len(row)) + [int(cell.get("s", 0))]
            row += [""] * (column - len(row)) + [text]
            unseen |= text != "" and _is_unseen(cell, book)
        cells += len(row)
        if cells > _MOST_CELLS:
            raise ValueError(f"more than {_MOST_CELLS} cells")
        if any(row):
            hidden += [number] if _is_hidden(element, "ht") else []
            crossed = any(int(cell.get("s", 0)) in book.struck for cell in element.iter(f"{_MAIN}c"))
            struck += [number] if crossed else []
            invisible += [number] if unseen else []
        element.clear()
        found.append((number, row))
        styles.append(of_row)
    unseen_columns = sorted({n for _, row in found for n, cell in enumerate(row, 1) if cell and n in columns})
    uncertain = [
        number for (number, row), of_row in zip(found, styles, strict=True)
        if any(
            text and one.may_mislead(number, column, book.colors_of(style))
            for one in conditional for column, (text, style) in enumerate(zip(row, of_row, strict=True))
        )
    ]  # fmt: skip
    _refuse_unclear(book.path, hidden, struck, invisible, uncertain, unseen_columns, merged)
    before = min((next(n for n, cell in enumerate(row) if cell) for _, row in found if any(row)), default=0)
    found = [(number, row[before:]) for number, row in found]
    width = len(_without_empty_ends(next((row for _, row in found if any(row)), []), 0))
    return [(number, row + [""] * (width - len(row)) if any(row) else [""]) for number, row in found]


def _is_hidden(line: ElementTree.Element, size: str) -> bool:
    """Return whether a row or column is hidden, or has no size."""
    return line.get("hidden", "0") in ("1", "true") or float(line.get(size, 1.0)) == 0


def _has_rows(merged: str) -> bool:
    ends = [_REFERENCE.fullmatch(end) for end in merged.split(":")]
    return len({end[2] for end in ends if end is not None}) > 1


def _refuse_unclear(
    path: Path,
    hidden: list[int],
    struck: list[int],
    invisible: list[int],
    uncertain: list[int],
    unseen: list[int],
    merged: list[str],
) -> None:
    """Refuse a sheet in which a reader sees other rows or columns than a program, or cells of several rows."""
    for rows, what, remedy in (
        (
            hidden,
            "has rows that are hidden, by a filter or by hand",
            "copy the visible rows to a new sheet, or show all",
        ),
        (struck, "has rows that are struck out", "delete them, or remove the strikethrough"),
        (
            invisible,
            "has rows with cells that do not show their content, since their text has the color of the background or "
            "their number format has no digits",
            "delete the content of these cells, or make it visible",
        ),
        (
            uncertain,
            "has rows with cells that a conditional format may hide, strike out or show as another number",
            "remove the conditional format, and look at the cells again",
        ),
        (
            unseen,
            "has columns that are hidden, counted from A",
            "copy the visible columns to a new sheet, or show all",
        ),
    ):
        if rows:
            listed = ", ".join(map(str, rows[:_MOST_LISTED])) + ", …" * (len(rows) > _MOST_LISTED)
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


def _cell(cell: ElementTree.Element, book: _Workbook) -> str:
    kind, value = cell.get("t", "n"), cell.findtext(f"{_MAIN}v") or ""
    if cell.find(f"{_MAIN}f") is not None and not (value and book.computed):
        return "(a formula that was not computed; open the workbook in Excel or LibreOffice, and save it)"
    if kind == "s":
        return book.texts[int(value)].strip() if value else ""
    if kind == "inlineStr":
        inside = cell.find(f"{_MAIN}is")
        return "" if inside is None else _text(inside).strip()
    if kind == "b":
        return "TRUE" if value == "1" else "FALSE"
    style = int(cell.get("s", 0))
    if kind == "n" and value:
        parts = book.parts.get(style)
        shown = book.shown.get(style) or (parts.sign_problem(float(value)) if parts else "")
        return f"{value} ({shown})" if shown else value.strip()
    return value.strip()


def _of_matlab(path: Path, content: bytes) -> Lines:
    """Yield the vectors of a MATLAB file as columns; scalars and single texts are the same in all rows."""
    try:
        variables = matlab_variables(content, _MOST_UNPACKED)
    except (ValueError, struct.error) as error:
        raise _no_table(path, f"a damaged MATLAB file ({error})") from None
    columns = {one.name: one for one in variables if one.length is not None}
    others = {one.name: NotUnderstood(one.problem) for one in variables if one.length is None}
    lengths = {one.length or 0 for one in columns.values()} - {1} or {1}
    if not columns or len(lengths) > 1 or max(lengths) * len(variables) > _MOST_CELLS:
        held = ", ".join(f"{one.name} ({one.size})" for one in variables[:_MOST_LISTED]) or "no variables"
        raise RecordingError(
            f"{path}: must have vectors of one length, whose names are the columns; it has {held}; save them with "
            "save(FILE, 'position_mm', 'rate', '-v7'), the fields of a struct with -struct",
            "no_mat_table",
        )
    rows = max(lengths)
    unclear = {name: NotUnderstood(problem) for name, one in columns.items() if (problem := one.row_problem(rows))}
    read = {name: one.column() for name, one in columns.items() if name not in unclear}
    return _as_lines(read, others | unclear, rows)


def _as_lines(columns: Mapping[str, Sequence[str]], others: Mapping[str, "NotUnderstood"], length: int) -> Lines:
    """Yield the rows of vectors and scalars; `others` have one cell in all rows."""
    texts = {
        name: some if len(some) == length else [SameInAllRows(some[0])] * length for name, some in columns.items()
    }
    yield 1, [*texts, *others]
    for row in range(length):
        yield row + 2, [*(some[row] for some in texts.values()), *others.values()]
