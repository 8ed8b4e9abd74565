"""A report as PDF: what it is made from, and that the same page gives the same bytes."""

import base64
import io
from datetime import UTC, datetime

from PIL import Image

from rig.compare.pdf import as_pdf, blocks

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


def test_a_high_picture_goes_to_a_page_with_its_heading() -> None:
    page = f"<h1>a</h1><p>b</p><h2>c</h2><img src='{picture(2000, 3000)}'>"
    assert as_pdf(page, WHEN).count(b"/Type /Page\n") == 2
    assert as_pdf("<h1>a</h1><p>b</p><h2>c</h2>", WHEN).count(b"/Type /Page\n") == 1
