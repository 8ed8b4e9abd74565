"""What every page has, whatever it reports: the glossary, figures by one template, prose without backticks."""

import re
from pathlib import Path

import pytest

from rig.report.glossary import GLOSSARY
from rig.report.page_parts import Section, prose, render
from rig.report.plot import Plot, Subplot

TEMPLATES = Path(__file__).parents[3] / "rig" / "report" / "templates"
PARTS = ("page.html.j2", "figure.html.j2", "section.html.j2")
PAGES = sorted(path.name for path in TEMPLATES.glob("*.html.j2") if path.name not in PARTS)
PANELS = [Subplot("x (mm)", "y (mm)", ())]


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_made_of_the_shared_parts(name: str) -> None:
    """Its head, glossary and script are the base's; its figures that of one macro, which has the alt text."""
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    assert text.startswith('{% extends "page.html.j2" %}')
    assert not re.search(r"<img|<figure|<head|<script", text)


@pytest.mark.parametrize("name", sorted(path.name for path in TEMPLATES.glob("*.j2")))
def test_no_line_of_a_command_ends_within_an_option(name: str) -> None:
    """The filter `code` prints a command so; what a template encloses itself may break after two hyphens."""
    assert not re.search(r"<code>\{\{[^}]*(command|words)", (TEMPLATES / name).read_text(encoding="utf-8"))


def test_the_glossary_is_one_click_away_and_has_the_words_of_the_pages() -> None:
    page = render("identification.html.j2", title="t", about="", sections=[])
    assert page.index('href="#glossary"') < page.index("<h1>")
    assert '<h2 id="glossary">' in page
    assert {"gwt", "DOI", "SED", "ep1", "SSRP"} <= set(GLOSSARY)
    assert list(GLOSSARY) == sorted(GLOSSARY, key=str.lower)
    assert all(f"<td>{word}</td>" in page for word in GLOSSARY)


@pytest.mark.parametrize(
    "where",
    [
        lambda text: Section("T", text),
        lambda text: Section("T", "", points=(text,)),
        lambda text: Section("T", "", ("h",), ((text,),)),
        lambda text: Section("T", "", figures=(Plot((1.0, 1.0), PANELS, "F", text, layout=None),)),
    ],
    ids=["paragraph", "list", "cell", "caption"],
)
def test_a_command_between_backticks_is_code_wherever_it_stands(where: object) -> None:
    page = render("identification.html.j2", title="t", about="", sections=[where("Run `rig check <x>` first.")])  # type: ignore[operator]
    assert "Run <code>rig check &lt;x&gt;</code> first." in page


PRINTED = {
    "a single backtick": ("a ` b <c>", "a ` b &lt;c&gt;"),
    "an option": ("(--fingers=a,b states it)", '(<code><span class="one">--fingers</span>=a,b</code> states it)'),
    "a command": ("`rig find --x-mm -3` at -3", '<code>rig find <span class="one">--x-mm</span> -3</code> at −3'),
    "negative numbers": ("-2 to [-1.16, -0.2]", "−2 to [−1.16,_−0.2]"),
    "hyphens": ("2026-11-30, bar-3, Fig. 5-8, x=-4, -c", "2026-11-30, bar-3, Fig. 5-8, x=-4, -c"),
    "powers of ten": ("6.9e-06, -1.31e+06, 9.73e+03, 3e4a-5", "6.9_×_10⁻⁶, −1.31_×_10⁶, 9730, 3e4a-5"),
    "names of runs": ("20261201T130931-steps-3e5469, a-1e5.csv", "20261201T130931-steps-3e5469, a-1e5.csv"),
    "a number and its unit": ("18 % at 1.5 mm, 10 000 nodes", "18_% at 1.5_mm, 10_000 nodes"),
    "an interval": ("529 [469, 615], 3 ± 1, -1.15 … -0.75", "529 [469,_615], 3_±_1, −1.15_…_−0.75"),
    "an equation": (
        "(p < 0.001), |r| ≥ 0.98, r = -0.15, e22 = ep1",
        "(p_&lt;_0.001), |r|_≥_0.98, r_=_−0.15, e22 = ep1",
    ),
}
"""Texts, and how a page prints them; _ is a space at which no line ends."""


@pytest.mark.parametrize(("text", "printed"), PRINTED.values(), ids=PRINTED)
def test_prose_is_printed_as_in_a_paper(text: str, printed: str) -> None:
    assert str(prose(text)) == printed.replace("_", "\N{NO-BREAK SPACE}")


def test_a_caption_changes_black_and_white_on_a_dark_page() -> None:
    figure = Plot((1.0, 1.0), PANELS, "F", "Black: the indentor; white: rests.", layout=None)
    page = render("identification.html.j2", title="t", about="", sections=[Section("T", "", figures=(figure,))])
    assert '<span data-dark="White">Black</span>: the indentor; <span data-dark="black">white</span>: rests.' in page
