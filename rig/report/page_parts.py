"""Parts that all reports share: figures inside the page, one template, one style, the glossary."""

import base64
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from typing import Any, TypeVar

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from rig.printable import printable
from rig.report.glossary import GLOSSARY
from rig.report.plot import Plot

Item = TypeVar("Item")


@dataclass(frozen=True)
class Section:
    """Part of a page: heading, paragraphs (separated by blank lines), list, table and figures."""

    title: str
    text: str
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    figures: tuple[Plot, ...] = ()
    points: tuple[str, ...] = ()


def alone(figure: Plot) -> Section:
    """Return a section that contains one figure, under its title."""
    return Section(figure.title, "", figures=(figure,))


def figures_of(items: Sequence[Item], most: int, make: Callable[[Sequence[Item]], Plot]) -> list[Plot]:
    """Return one figure with a panel per item, or several with numbers in their titles if a page is too small."""
    made = [make(items[k : k + most]) for k in range(0, len(items), most)]
    if len(made) < 2:
        return made
    return [replace(one, title=f"{one.title}, {k} of {len(made)}") for k, one in enumerate(made, 1)]


def as_svg(figure: Plot) -> str:
    """Return a figure for the src of an img on a page."""
    return "data:image/svg+xml;base64," + base64.b64encode(figure.page_svg.encode()).decode()


def render(template: str, **about: Any) -> str:
    """Return a self-contained page rendered from a template of this package."""
    page = _templates().get_template(template).render(picture=as_svg, glossary=GLOSSARY, **about)
    return page.replace(_PAGE_SCRIPT, _zoom_library() + _PAGE_SCRIPT, 1) if _CHART in page else page


_CHART, _PAGE_SCRIPT = '<div class="zoom">', '<script type="module">'


_QUOTED = re.compile(r"`([^`\n]+)`")
_OPTION = re.compile(r"(?<![\w-])(--[a-z][\w-]*)(=[^\s;()]*[^\s;(),.])?")
_SWAPPED = re.compile(r"\b(black|white)\b", re.IGNORECASE)
_MINUS = re.compile(r"(?<![\w.,=/+-])-(?=\d)")
_POWER = re.compile(r"(?<![\w.])(?<!\w-)(\d+(?:\.\d+)?)e([+−-]?)0*(\d{1,3})\b")  # 3e5469 ends the name of a run
_LEAST_POWER = 1e6
_HIGH = str.maketrans("0123456789-−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻")
_UNBROKEN = re.compile(
    r"(?<=[\d.)]) (?=(?:mm|µm|gwt|kPa|MPa|MB|N|s|ms|min|bits?|strain|%|\d{3})(?![\w/]))"
    r"|(?<=[±×=<≥…]) (?=[\d−])|(?<=\d) (?=[±×…])|(?<=[\w²|]) (?=[=<≥] [\d−])"
)
_INTERVAL = re.compile(r"\[−?\d[^\[\]a-z]*\]")
_NO_BREAK = "\N{NO-BREAK SPACE}"


def prose(text: str) -> Markup:
    """Return a text of a page: commands between backticks and options as code, numbers as they are printed."""
    parts = _QUOTED.split(printable(text))
    return Markup("").join(_code(part) if number % 2 else _plain(part) for number, part in enumerate(parts))


def _code(text: str) -> Markup:
    """Return a command as code; no line ends within the name of an option."""
    return Markup(f"<code>{_OPTION.sub(_whole, str(escape(printable(text))))}</code>")


def _whole(option: re.Match[str]) -> str:
    return f'<span class="one">{option[1]}</span>{option[2] or ""}'


def _plain(text: str) -> Markup:
    """Return words with a minus before negative numbers, powers of ten, and no line between a number and its unit."""
    found = _OPTION.search(text)
    if found is not None:
        return _plain(text[: found.start()]) + _code(found[0]) + _plain(text[found.end() :])
    numbers = _UNBROKEN.sub(_NO_BREAK, _POWER.sub(_power, _MINUS.sub("−", text)))
    return escape(_INTERVAL.sub(lambda found: found[0].replace(" ", _NO_BREAK), numbers))


def _power(number: re.Match[str]) -> str:
    sign, plain = number[2].replace("+", ""), 10 ** int(number[3])
    if not sign and plain < _LEAST_POWER:
        return f"{float(number[1]) * plain:.0f}"
    return f"{number[1]} × 10{(sign + number[3]).translate(_HIGH)}"


def _caption(figure: Plot) -> Markup:
    """Return a caption; black and white change places on dark pages, except over maps of colors."""
    text = prose(figure.whole_caption)
    return text if figure.has_map else Markup(_SWAPPED.sub(_swapped, text))


def _swapped(word: re.Match[str]) -> str:
    other = {"black": "white", "white": "black"}[word[0].lower()]
    return f'<span data-dark="{other.capitalize() if word[0][0].isupper() else other}">{word[0]}</span>'


@cache
def _zoom_library() -> str:
    """Return the vendored library that plots charts to zoom into."""
    folder = files("rig") / "panel" / "static" / "vendor" / "uplot"
    script = (folder / "uPlot.esm.js").read_text(encoding="utf-8")
    style = (folder / "uPlot.min.css").read_text(encoding="utf-8")
    start, _, _ = script.replace("\t", " ").rpartition("export {")  # a page has no control characters
    return f'<style>{style}</style>\n<script type="module">\n{start}globalThis.uPlot = uPlot;\n</script>\n'


def _visible(value: Any) -> Any:
    """Return a value of a page, a text with visible control characters; markup remains markup."""
    return type(value)(printable(value)) if isinstance(value, str) and not value.isprintable() else value


@cache
def _templates() -> Environment:
    """Return the templates; each is compiled once."""
    made = Environment(
        loader=PackageLoader("rig.report"),
        autoescape=True,
        finalize=_visible,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {"prose": prose, "code": _code, "caption": _caption}
    return made
