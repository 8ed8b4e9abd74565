"""Parts that all reports share: inline figures, one template, one style."""

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

from jinja2 import Environment, PackageLoader, StrictUndefined

from rig.printable import printable
from rig.report.style import Plot

Item = TypeVar("Item")


@dataclass(frozen=True)
class PageFigure:
    """Figure with its heading and caption."""

    title: str
    plot: Plot
    caption: str


@dataclass(frozen=True)
class Section:
    """Part of a page: heading, paragraphs (separated by blank lines), list, table and figures."""

    title: str
    text: str
    header: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    figures: tuple[PageFigure, ...] = ()
    points: tuple[str, ...] = ()


def alone(figure: PageFigure) -> Section:
    """Return a section that contains one figure, under its title."""
    return Section(figure.title, "", figures=(figure,))


def figures_of(
    title: str, items: Sequence[Item], most: int, draw: Callable[[Sequence[Item]], Plot], caption: str
) -> list[PageFigure]:
    """Return one figure with a panel per item, or several if a page is too small."""
    parts = [items[k : k + most] for k in range(0, len(items), most)]
    numbers = [f", {k + 1} of {len(parts)}" if len(parts) > 1 else "" for k in range(len(parts))]
    return [PageFigure(title + number, draw(part), caption) for number, part in zip(numbers, parts, strict=True)]


def as_svg(figure: PageFigure) -> str:
    """Return a figure for the src of an img on a page."""
    return "data:image/svg+xml;base64," + base64.b64encode(figure.plot.svg.encode()).decode()


def as_png(figure: PageFigure) -> str:
    """Return a figure for the src of an img on a page that becomes a PDF."""
    return "data:image/png;base64," + base64.b64encode(figure.plot.png).decode()


def render(template: str, picture: Callable[[PageFigure], str] = as_svg, **about: Any) -> str:
    """Return a self-contained page rendered from a template of this package."""
    return _templates().get_template(template).render(picture=picture, **about)


def _visible(value: Any) -> Any:
    """Return a value of a page, a text with visible control characters; markup remains markup."""
    return type(value)(printable(value)) if isinstance(value, str) and not value.isprintable() else value


@cache
def _templates() -> Environment:
    """Return the templates; each is compiled once."""
    return Environment(
        loader=PackageLoader("rig.report"),
        autoescape=True,
        finalize=_visible,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
