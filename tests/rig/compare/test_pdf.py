"""A report as PDF: what it is made from, and that the same page gives the same bytes."""

import base64
import io
import re
import zlib
from datetime import UTC, datetime

from PIL import Image

from rig.report.pdf import as_pdf, blocks

WHEN = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


def picture(width: int, height: int) -> str:
    content = io.BytesIO()
    Image.new("RGB", (width, height), "white").save(content, format="PNG")
    return "data:image/png;base64," + base64.b64encode(content.getvalue()).decode()


PAGE = f"""<html><head><title>not shown</title><style>p {{ color: red }}</style></head><body>
<h1>Which measure?</h1><nav><a href="#a">not shown</a></nav>
<p>ε₀ of <strong>ep1</strong> is <code>−0.02</code>,
the rest not.</p><ul><li>one &amp; two</li></ul>
<table><tr><th>measure</th><th>k</th></tr><tr><td>ep1</td><td>3 <small>[2, 4]</small></td></tr></table>
<figure><img alt="x" src="{picture(40, 20)}"><figcaption>A picture.</figcaption></figure></body></html>"""


def test_a_page_becomes_blocks_in_its_order() -> None:
    found = blocks(PAGE)
    assert [block.kind for block in found] == ["h1", "p", "li", "table", "picture", "figcaption"]
    assert found[1].text == "ε₀ of ep1 is −0.02, the rest not."
    assert found[2].text == "• one & two"
    assert found[3].rows == [["measure", "k"], ["ep1", "3 [2, 4]"]]
    assert found[4].picture.startswith(b"\x89PNG")


def test_the_same_page_gives_the_same_bytes() -> None:
    first, second = as_pdf(PAGE, WHEN), as_pdf(PAGE, WHEN)
    assert first == second
    assert first.startswith(b"%PDF-1.")
    assert b"D:20260102030405Z" in first  # the date is what was given, not the day of the export
    assert as_pdf(PAGE.replace("ep1", "ep3"), WHEN) != first


def pages(html: str) -> list[list[bytes]]:
    """What each page shows, in order: Tj a piece of text, Do an image; without the page's number."""
    found = [content[1] for content in re.finditer(rb"stream\r?\n(x.*?)endstream", as_pdf(html, WHEN), re.DOTALL)]
    contents = [zlib.decompressobj().decompress(content) for content in found]
    shown = [re.findall(rb"\b(Tj|Do)\b", content) for content in contents if b" Tf" in content]
    return [page[:-PIECES_OF_NUMBER] for page in shown]


PIECES_OF_NUMBER = 2  # "1 / " and how many there are


def test_a_high_picture_goes_to_a_page_with_its_heading_and_its_caption() -> None:
    figure = f"<h2>c</h2><figure><img src='{picture(2000, 3000)}'><figcaption>d</figcaption></figure>"
    before, after = pages(f"<h1>a</h1>{'<p>b</p>' * 6}{figure}")
    assert before == [b"Tj"] * (1 + 6)
    assert after == [b"Tj", b"Do", b"Tj"]
    assert pages(f"<h1>a</h1>{figure}") == [[b"Tj", b"Tj", b"Do", b"Tj"]]


def table(rows: int) -> str:
    return f"<table><tr><th>measure</th></tr>{'<tr><td>ep1</td></tr>' * rows}</table>"


def test_a_short_table_is_not_split_and_a_long_one_repeats_its_header() -> None:
    first, second = pages(f"{'<p>b</p>' * 32}<h2>c</h2>{table(12)}")
    assert (len(first), len(second)) == (32, 1 + 1 + 12)
    first, second = pages(table(70))
    assert len(first) + len(second) == 70 + 2
    assert len(second) > 2


def test_a_number_is_not_parted_from_its_per_cent_sign() -> None:
    assert blocks("<p>at 5\N{NO-BREAK SPACE}%  of\n the range</p>")[0].text == "at 5\N{NO-BREAK SPACE}% of the range"
