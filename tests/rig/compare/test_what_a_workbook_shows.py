"""Cells of a workbook that a reader does not see, or sees as another number, are refused."""

import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.rig.compare.recording_files import (
    ALL,
    MAIN,
    RATES_ROWS,
    RELATIONS,
    XML,
    Case,
    check,
    xlsx,
)

COMPUTE = '<calcPr calcId="124519" fullCalcOnLoad="1"/>'


def styled(
    style: str = "", row: str = "", after: str = "", before: str = "", value: str = "<v>{y}</v>", kind: str = "",
    ink: str = "", fill: str = "", number: int = 200, header: str = "rate", pattern: str = "",
    dxf: str = "", calculation: str = "",
) -> Any:  # fmt: skip
    """A workbook whose rates have a style, whose third row has an attribute, with more after its cells."""
    write = xlsx({"A": [["position_mm", header], *RATES_ROWS[1:]]}, inline=True)

    def change(folder: Path) -> str:
        path = Path(write(folder))
        with zipfile.ZipFile(path) as file:
            parts = {name: file.read(name).decode() for name in file.namelist()}
        sheet = parts["xl/worksheets/sheet1.xml"]
        for n, (_, y) in enumerate(RATES_ROWS[1:], 2):
            cell = f'<c r="B{n}" s="1"{kind}>{value.format(y=y)}</c>'
            sheet = sheet.replace(f'<c r="B{n}" s="0"><v>{y}</v></c>', cell)
        sheet = sheet.replace('<row r="3">', f'<row r="3" {row}>').replace("</sheetData>", f"</sheetData>{after}")
        sheet = sheet.replace("<sheetData>", f"{before}<sheetData>")
        parts["xl/worksheets/sheet1.xml"] = sheet
        parts["xl/workbook.xml"] = parts["xl/workbook.xml"].replace("</workbook>", f"{calculation}</workbook>")
        xfs = '<cellXfs><xf numFmtId="0" fontId="0"/><xf numFmtId="FORMAT" fontId="1" fillId="1"/></cellXfs>'.replace(
            "FORMAT", str(number)
        )
        code = "0.0" if style in ("", "struck") else style
        formats = f'<numFmts><numFmt numFmtId="200" formatCode="{code}"/></numFmts>'
        fonts = (
            "<fonts><font/><font>" + "<strike/>" * (style == "struck") + f"{ink and f'<color {ink}/>'}</font></fonts>"
        )
        solid = fill and f'<patternFill patternType="solid"><fgColor {fill}/></patternFill>'
        fills = f"<fills><fill/><fill>{solid or pattern}</fill></fills>"
        parts["xl/styles.xml"] = (
            f"{XML}<styleSheet {MAIN}>{formats}{fonts}{fills}{xfs}<dxfs>{dxf}</dxfs></styleSheet>"
        )
        with zipfile.ZipFile(path, "w") as file:
            for name, content in parts.items():
                file.writestr(name, content)
        return str(path)

    return change


def conditional(dxf: str, cells: str = "B3 B5:B9", rule: str = "", **cell: str) -> Any:
    """A workbook with a conditional format, whose rule is here that the value is above 10."""
    rule = (
        rule or '<cfRule type="cellIs" dxfId="0" priority="1" operator="greaterThan"><formula>10</formula></cfRule>'
    )
    after = f'<conditionalFormatting sqref="{cells}">{rule}</conditionalFormatting>'
    return styled(after=after, dxf=f"<dxf>{dxf}</dxf>", **cell)


X14 = 'xmlns:x14="http://schemas.microsoft.com/office/spreadsheetml/2009/9/main"'
XM = 'xmlns:xm="http://schemas.microsoft.com/office/excel/2006/main"'
RED_ON_PINK = '<font><color rgb="FF9C0006"/></font><fill><patternFill><bgColor rgb="FFFFC7CE"/></patternFill></fill>'
WHITE_TEXT = '<font><color rgb="FFFFFFFF"/></font>'


def commented(target: str, comment: str) -> Callable[[Path], str]:
    """A workbook with a comment on the second rate."""

    def write(folder: Path) -> str:
        path = styled()(folder)
        place = "xl/comments1.xml" if target.startswith("..") else target.lstrip("/")
        with zipfile.ZipFile(path, "a") as archive:
            archive.writestr(
                "xl/worksheets/_rels/sheet1.xml.rels",
                f'{XML}<Relationships><Relationship Id="c" Type="{RELATIONS}/comments" Target="{target}"/>'
                "</Relationships>",
            )
            archive.writestr(
                place,
                f'{XML}<comments {MAIN}><commentList><comment ref="B3" authorId="0"><text><r><t>{comment}</t></r>'
                "</text></comment></commentList></comments>",
            )
        return path

    return write


SHOWN = {
    "plain": Case("numbers", styled(), rates=ALL),
    "thousands separators": Case("the same numbers", styled("#,##0.0"), rates=ALL),
    "percent": Case("0.8 is shown as 80 %", styled("0%"), code="no_number", says=("a percentage",)),
    "scaled": Case("2000 is shown as 2", styled("0.0,"), code="no_number", says=("in thousands",)),
    "a unit in the format": Case("shown in another unit than the header's", styled("0.0&quot; 1/min&quot;"),
                                 code="no_number", says=("1/min", "header")),
    **{
        f"a unit in the format {code}": Case(
            "shown in another unit than the header's", styled(code), code="no_number", says=(unit, "header")
        )
        for code, unit in (("0.0[$/min]", "/min"), ("0.0[$ µm]", "µm"), ("0.0\\ \\k", "k"), ("0[$%-409]", "%"))
    },
    "the header's unit in the format": Case("the same numbers", styled("0.0&quot; Hz&quot;"), rates=ALL),
    "a language in the format": Case("the same numbers", styled("[$-409]0.0"), rates=ALL),
    **{
        f"a digit {said}": Case("a reader sees another number", styled(
            value=f"<is><r><t>{{y}}</t></r><r><rPr>{style}</rPr><t>1</t></r></is>", kind=' t="inlineStr"'),
            code="no_number", says=("row 2", "'6.01", said))
        for said, style in (("superscript", '<vertAlign val="superscript"/>'), ("struck out", "<strike/>"),
                            ("subscript", '<vertAlign val="subscript"/>'))
    },
    "a digit in bold": Case("the same number", styled(
        value='<is><r><t>{y}</t></r><r><rPr><b/><strike val="0"/><vertAlign val="baseline"/></rPr><t>0</t></r></is>',
        kind=' t="inlineStr"'), rates=ALL),
    **{
        f"a row with {hidden}": Case("a reader does not see it", styled(row=hidden), code="unclear_rows",
                                     says=("hidden", "(3)", "visible rows"))
        for hidden in ('hidden="1"', 'ht="0"', 'ht="0.0" customHeight="1"')
    },
    **{
        f"a column with {hidden}": Case(
            "a reader does not see it", styled(before=f'<cols><col min="2" max="3" {hidden}/></cols>'),
            code="unclear_rows", says=("hidden", "(2)", "visible columns"),
        )
        for hidden in ('hidden="1"', 'width="0"')
    },
    "a narrow column": Case("a reader sees it", styled(before='<cols><col min="2" max="3" width="4.5"/></cols>'),
                            rates=ALL),
    "a hidden column, empty": Case("nothing to see", styled(before='<cols><col min="3" max="9" hidden="1"/></cols>'),
                                   rates=ALL),
    "a hidden sheet": Case("a reader does not see it", xlsx({"A": [], "old": RATES_ROWS}, hidden="old"),
                           code="hidden_sheet", says=("with rows, old, is hidden", "synthetic.xlsx#old")),
    "a hidden sheet, named": Case("chosen", xlsx({"A": [], "old": RATES_ROWS}, "#old", hidden="old"), rates=ALL),
    "struck out": Case("a reader takes it for deleted", styled("struck"), code="unclear_rows", says=("struck out",)),
    **{
        f"text {ink} on {fill or 'no fill'}": Case("a reader sees nothing", styled(ink=ink, fill=fill),
                                                   code="unclear_rows", says=("do not show", "(2, 3, 4, 5)"))
        for ink, fill in (
            ('rgb="FFFFFFFF"', ""), ('rgb="FFFAFAFA"', ""), ('theme="0"', ""), ('indexed="9"', ""),
            ('indexed="65"', ""),
            ('rgb="FFFF0000"', 'rgb="FFFF0000"'), ('theme="0"', 'theme="0" tint="-0.05"'), ("", 'indexed="64"'),
            ("", 'rgb="FF000000"'),
        )
    },
    **{
        f"text {ink} on {pattern}": Case("openpyxl writes no fill so", styled(ink=ink, pattern=pattern),
                                         code="unclear_rows", says=("do not show", "(2, 3, 4, 5)"))
        for ink in ('rgb="FFFFFFFF"', 'theme="0"', 'indexed="9"') for pattern in (
            "<patternFill/>", '<patternFill><fgColor rgb="FF4472C4"/></patternFill>',
            '<patternFill patternType="none"/>')
    },
    "white text on a gradient": Case("a reader sees it", styled(
        ink='rgb="FFFFFFFF"', pattern='<gradientFill><stop position="0"><color theme="4"/></stop></gradientFill>'),
        rates=ALL),
    **{
        f"text {ink} on {fill}": Case("a reader sees it", styled(ink=ink, fill=fill), rates=ALL)
        for ink, fill in (
            ('rgb="FFFFFFFF"', 'rgb="FF4472C4"'), ('theme="0"', 'theme="4"'), ('theme="1"', 'theme="0"'),
            ('auto="1"', 'indexed="65"'), ('theme="0" tint="-0.5"', 'theme="0"'),
        )
    },
    **{
        f"shown by {code}": Case("a reader sees nothing", styled(code), code="unclear_rows",
                                 says=("do not show", "(2, 3, 4, 5)"))
        for code in (";;;", ";;", ";-0.0", "\\-;-0.0", "&quot;+&quot;")
    },
    **{
        f"shown by {code}": Case("a reader sees it", styled(code), rates=ALL)
        for code in (
            "0.0;", "0.0;;", "0.0;-0.0;;@", "0.0;[Red]-0.0",
            "_-* #,##0.0_-;\\-* #,##0.0_-;_-* &quot;-&quot;??_-;_-@_-",
            "#,##0.0_);(#,##0.0)", "0.0;[Red]0.0", "0.00E-00", "0.0&quot; s-1&quot;", "+0.0;-0.0;0.0",
        )
    },
    **{
        f"negative rates shown by {code}": Case("a reader sees other numbers", styled(code, value="<v>-1</v>"),
                                                code="no_number", says=("'-1 (shown without its sign in Excel)'",))
        for code in ("0.0;0.0", "0.0;0.0;0", "0.0_-;0.0_-", "0.0;&quot;+&quot;0.0")
    },
    **{
        f"rates shown by {code}": Case("a reader sees other numbers", styled(code), code="no_number", says=(what,))
        for code, what in (
            ("-0.0", "with another sign in Excel"), ("(0.0);-0.0", "with another sign in Excel"),
            ("0.0-", "with another sign in Excel"), ("\\-0.0", "with another sign in Excel"),
            ("&quot;1&quot;0.0", "shown as 1 in Excel"), ("[&lt;10]0.0;0", "by conditions"),
            ("#,##0.00 [$€-407]", "€"), ("&quot;£&quot;0.0", "£"), ("$0.0", "$"), ("0.0\\ ¥", "¥"),
        )
    },
    "rates shown as a currency": Case("a format that Excel has built in", styled(number=44), code="no_number",
                                      says=("a currency",)),
    "percent, with the header's unit": Case(
        "40 % are stored as 0.4", styled("0%", header="rate (%)"), code="no_number",
        says=("a percentage in Excel", "cell format General"),
    ),
    "a zero that is not shown": Case(
        "nothing, or zero?", styled("0.0;-0.0;;@", value="<v>0</v>"), code="unclear_rows", says=("do not show",)
    ),
    "merged cells": Case("one cell in two rows", styled(after='<mergeCells><mergeCell ref="A2:A3"/></mergeCells>'),
                         code="merged_cells", says=("A2:A3", "unmerge")),
    "a merged title": Case("in one row", styled(after='<mergeCells><mergeCell ref="A1:B1"/></mergeCells>'),
                           rates=ALL),
    **{
        f"on a condition, {what}": Case("a reader may see nothing, or another number", write, code="unclear_rows",
                                        says=("conditional format", f"({rows})", "remove"))
        for what, rows, write in (
            ("white text", "3, 5", conditional(WHITE_TEXT)),
            ("text like its own fill", "3, 5", conditional('<font><color theme="0"/></font>', fill='theme="0"')),
            ("a fill like its own text", "3, 5", conditional(
                '<fill><patternFill><bgColor rgb="FF010101"/></patternFill></fill>')),
            ("no digits", "1, 2, 3, 4, 5", conditional('<numFmt numFmtId="201" formatCode=";;;"/>', "A1:XFD1048576")),
            ("no digits for 0", "2, 3, 4, 5", conditional('<numFmt numFmtId="201" formatCode="0;-0;"/>', "B2:B9")),
            ("a unit", "3", conditional('<numFmt numFmtId="201" formatCode="0.0&quot; kHz&quot;"/>', "B3")),
            ("percent", "3", conditional('<numFmt numFmtId="9" formatCode="0%"/>', "B3")),
            ("struck out", "3", conditional("<font><strike/></font>", "3:3")),
            ("a bar alone", "3", conditional("", "B3", '<cfRule type="dataBar"><dataBar showValue="0"/></cfRule>')),
            ("an icon alone", "3, 4", styled(after=(
                f'<extLst><ext {X14} {XM}><x14:conditionalFormattings><x14:conditionalFormatting><x14:cfRule '
                'type="iconSet"><x14:iconSet showValue="0"/></x14:cfRule><xm:sqref>B3:B4</xm:sqref>'
                "</x14:conditionalFormatting></x14:conditionalFormattings></ext></extLst>"))),
            ("white text by another sheet", "3", styled(after=(
                f'<extLst><ext {X14} {XM}><x14:conditionalFormattings><x14:conditionalFormatting><x14:cfRule '
                f'type="expression"><xm:f>other!A1</xm:f><x14:dxf>{WHITE_TEXT}</x14:dxf></x14:cfRule><xm:sqref>B3'
                "</xm:sqref></x14:conditionalFormatting></x14:conditionalFormattings></ext></extLst>"))),
        )
    },
    **{
        f"on a condition, {what}": Case("a reader sees it", write, rates=ALL)
        for what, write in (
            ("red on pink", conditional(RED_ON_PINK)),
            ("bold", conditional("<font><b/><strike val='0'/></font>")),
            ("white on blue", conditional(WHITE_TEXT, fill='rgb="FF4472C4"')),
            ("more digits", conditional('<numFmt numFmtId="201" formatCode="0.000"/>')),
            ("a bar", conditional("", "B3", '<cfRule type="dataBar"><dataBar><cfvo type="min"/></dataBar></cfRule>')),
            ("a number format of an empty cell", conditional('<numFmt numFmtId="200" formatCode="0%"/>', "C2")),
            ("white text in empty cells", conditional(WHITE_TEXT, "C1:C9 B6:B9")),
        )
    },
    **{
        f"formulas {what}": Case("0 is no value of theirs", styled(value=value, kind=kind, calculation=calculation),
                                 code="no_number", says=("a formula that was not computed", "save it"))
        for what, value, kind, calculation in (
            ("without values", "<f>A2</f>", "", ""),
            ("whose values are 0 until Excel computes them", "<f>A2</f><v>0</v>", "", COMPUTE),
            ("of one group, with 0 for each", '<f t="shared" si="0"/><v>0</v>', "", COMPUTE),
            ("with an empty text for each", "<f>A2</f><v></v>", ' t="str"', COMPUTE),
        )
    },
    "formulas with values": Case("computed", styled(value="<f>A2</f><v>{y}</v>"), rates=ALL),
    "numbers beside such formulas": Case("no formula", styled(calculation=COMPUTE), rates=ALL),
    "logical": Case("TRUE is no rate", styled(value="<v>1</v>", kind=' t="b"'), code="no_number", says=("TRUE",)),
    **{
        f"cell comments, as {by} writes them": Case(
            "they may reject a press, and are said", commented(target, "exclude: electrode moved"), rates=ALL,
            read_as="Cell comments are not read: B3: exclude: electrode moved.",
        )
        for by, target in (("Excel", "../comments1.xml"), ("openpyxl", "/xl/comments/comment1.xml"))
    },
    "comments that are damaged": Case(
        "they are there", commented("../comments1.xml", "<"), rates=ALL,
        read_as="Cell comments are there, and cannot be read.",
    ),
    "no cell comments": Case("nothing is said", styled(), rates=ALL, silent="comments"),
    "a table from B3": Case("empty rows and columns before it", xlsx({"A": [
        [], [], *([None, *row] for row in RATES_ROWS)]}), rates=ALL),
}  # fmt: skip
CASES = SHOWN


@pytest.mark.parametrize("name", CASES)
def test_a_workbook_counts_as_a_reader_sees_it(name: str, tmp_path: Path) -> None:
    check(CASES[name], tmp_path)
