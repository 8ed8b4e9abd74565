"""The style of figures and labels: colors that survive print, the same bytes every time."""

import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure

from sim.measures.measures import BY_NAME

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"  # Okabe & Ito
PURPLE, YELLOW = "#CC79A7", "#E69F00"
DOTTED = (0, (1, 3))
"""Dashes of lines that captions call dotted; matplotlib's own look solid where lines are thin."""
PAGE_IN = (10.9, 6.3)
"""Width and height (in) of a figure beside its heading and caption on landscape A4; larger figures are scaled
down."""
PNG_DOTS_PER_INCH = 200  # also used to measure text, whose widths are rounded at coarser resolutions
_IMAGES_DOTS_PER_INCH = 100
"""Resolution of the raster parts of an SVG (dpi)."""

INK, PAPER = "#e6e6e6", "#16181b"
"""Text and background of dark pages, as in `templates/style.css`."""
_TOWARDS_WHITE = 0.35
"""Share of white in colors on dark pages; less would hide the darkest ones."""
_ON_MAP = "map"
"""Prefix of the ids of what is plotted over a map of colors, which keeps its colors on dark pages."""
_COLOR = re.compile(r"(fill|stroke): (#[0-9a-f]{6})")
_MARKER_ON_MAP = re.compile(rf'<g id="{_ON_MAP}_\d+">\s*<defs>\s*<path id="(\w+)"[^>]*style="([^"]*)"')

_ORDERED = mpl.colormaps["viridis"]
_LIGHTEST = 0.86  # lighter lines fade on paper
_MOST_TICKS = 9
_ALIGNED = 0.01
"""Distance of panels in one row or column, relative to the figure."""
_UPRIGHT = 90.0
_MOST_NAMES = 8
"""Number of names of a legend in the description of a figure."""
_STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "rig",
    "svg.fonttype": "none",  # text stays text in a saved figure
    "legend.frameon": False,
}


@dataclass(frozen=True)
class Plot:
    """A figure with its size in inches, plotted on request."""

    size: tuple[float, float]
    draw: Callable[[Figure], None]
    layout: Literal["constrained"] | None = "constrained"
    """Layout engine; None if the figure sets its own margins."""

    @cached_property
    def svg(self) -> str:
        """Figure as SVG text."""
        text = io.StringIO()
        self._save(text, format="svg", dpi=_IMAGES_DOTS_PER_INCH, metadata={"Date": None})
        return text.getvalue()

    @cached_property
    def png(self) -> bytes:
        """Figure as a PNG image."""
        content = io.BytesIO()
        self._save(content, format="png", dpi=PNG_DOTS_PER_INCH, metadata={"Software": None})
        return content.getvalue()

    @cached_property
    def page_svg(self) -> str:
        """Figure as SVG text that follows the page's color scheme."""
        return self.svg.replace("<defs>", f"<defs>{_dark_rules(self.svg)}", 1)

    @cached_property
    def has_map(self) -> bool:
        """Whether the figure contains a map of colors."""
        return any(_mapped(axes) for axes in self._laid_out.axes)

    @cached_property
    def axes_in_words(self) -> str:
        """What is plotted against what, over which ranges, for readers who do not see the figure."""
        return _in_words(self._laid_out)

    def _save(self, target: io.StringIO | io.BytesIO, **options: Any) -> None:
        with _own_settings():
            self._laid_out.savefig(target, **options)

    @cached_property
    def _laid_out(self) -> Figure:
        """Figure laid out once for all formats; saving would render everything again for its layout."""
        with _own_settings():
            figure = Figure(figsize=self.size, dpi=PNG_DOTS_PER_INCH, layout=self.layout)
            self.draw(figure)
            engine = figure.get_layout_engine()
            if engine is not None:
                engine.execute(figure)
                figure.set_layout_engine(None)
        _mark_maps(figure)
        return figure


@contextmanager
def _own_settings() -> Iterator[None]:
    """Plot without the user's settings, which are for other figures."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def on_dark(color: str) -> str:
    """Return a color of a figure on a dark page: black and white change places, hues become lighter."""
    rgb, (ink, paper) = mpl.colors.to_rgb(color), (mpl.colors.to_rgb(one) for one in (INK, PAPER))
    if len(set(rgb)) == 1:
        mixed = [a + (b - a) * rgb[0] for a, b in zip(ink, paper, strict=True)]
    else:
        mixed = [value + (1 - value) * _TOWARDS_WHITE for value in rgb]
    red, green, blue = mixed
    return mpl.colors.to_hex((red, green, blue))


def _dark_rules(svg: str) -> str:
    """Return the style of dark pages for the colors of a figure; matplotlib leaves out black as a fill."""
    kept = f':not([id^="{_ON_MAP}"] *)'
    rules = [f"svg{{fill:{INK}}}", f'[id^="{_ON_MAP}"]{{fill:#000}}']
    rules += [
        f'[style*="{key}: {c}"]{kept}{{{key}:{on_dark(c)}!important}}' for key, c in sorted(set(_COLOR.findall(svg)))
    ]
    for name, style in _MARKER_ON_MAP.findall(svg):  # browsers match the shape in <use> without its ancestors
        rules += [f"#{name}{{{key}:{c}!important}}" for key, c in _COLOR.findall(style)]
    return f"<style>@media screen and (prefers-color-scheme: dark){{{''.join(rules)}}}</style>"


def _mapped(axes: Axes) -> list[Artist]:
    """Return the maps of colors in axes, or a color scale of one; scales of lines are not among them."""
    bar = getattr(axes, "_colorbar", None)
    if bar is not None and getattr(bar.mappable, "axes", None) is None:
        return []
    return [one for one in (*axes.images, *axes.collections) if _has_values(one.get_array())]


def _has_values(array: Any) -> bool:
    """Whether a map has a color anywhere; an empty one only has marks on the page."""
    return array is not None and bool(np.isfinite(np.ma.filled(np.ma.asarray(array, dtype=float), np.nan)).any())


def _mark_maps(figure: Figure) -> None:
    number = 0
    for axes in figure.axes:
        if _mapped(axes):
            over = [text for text in axes.texts if axes.bbox.overlaps(text.get_window_extent())]
            for artist in (*axes.images, *axes.collections, *axes.lines, *axes.patches, *over):
                artist.set_gid(f"{_ON_MAP}_{number}")
                number += 1


def _in_words(figure: Figure) -> str:
    panels = [axes for axes in figure.axes if axes.get_visible() and axes.axison and not hasattr(axes, "_colorbar")]
    parts = [*_axes_in_words(panels), *_names_of_ticks(panels)]
    if len(panels) > 1:
        parts.insert(0, f"{len(panels)} panels")
    scales = [axes.get_ylabel() or axes.get_xlabel() for axes in figure.axes if hasattr(axes, "_colorbar")]
    parts += [f"color: {name}" for name in dict.fromkeys(scales) if name]
    boxes = [*figure.legends, *(box for axes in panels if (box := axes.get_legend()) is not None)]
    names = list(dict.fromkeys(text.get_text() for box in boxes for text in box.get_texts()))
    if names:
        parts.append(f"legend: {_some(names)}")
    return " ".join("; ".join(parts).split()) + "."


Limits = tuple[float, float] | None


def _axes_in_words(panels: Sequence[Axes]) -> list[str]:
    """Return each pair of axes once, with the range over all of its panels."""
    ranges: dict[tuple[str, str], list[tuple[Limits, Limits]]] = {}
    for axes in panels:
        names = _label_of(axes, "y", panels), _label_of(axes, "x", panels)
        ranges.setdefault(names, []).append((_limits(axes, "y"), _limits(axes, "x")))
    found = []
    for names, limits in ranges.items():
        both = [_with_range(name, ends) for name, ends in zip(names, zip(*limits, strict=True), strict=True) if name]
        found += [" against ".join(both)] if both else []
    return found


def _names_of_ticks(panels: Sequence[Axes]) -> list[str]:
    """Return the names beside rows and columns, each list once."""
    found = []
    for which, what in (("y", "rows"), ("x", "columns")):
        for axes in panels:
            if names := _names(getattr(axes, f"{which}axis")):
                found.append(f"{what}: {_some(names)}")
    return list(dict.fromkeys(found))


def _names(axis: Axis) -> list[str]:
    """Return the labels of an axis whose ticks are names and not numbers."""
    found = [tick.get_text() for tick in axis.get_ticklabels()]
    return found if any(re.search(r"[^\W\d_]", text) and "$" not in text for text in found) else []


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more


def _label_of(axes: Axes, which: str, panels: Sequence[Axes]) -> str:
    """Return the label of an axis; panels inside a grid have that of the outer one."""

    def edge(one: Axes) -> float:
        return float(getattr(one.get_position(), f"{which}0"))

    aligned = [one for one in panels if abs(edge(one) - edge(axes)) < _ALIGNED]
    figure: Any = axes.figure
    whole = getattr(figure, f"_sup{which}label")
    loose = [text for text in figure.texts if (text.get_rotation() == _UPRIGHT) == (which == "y")]
    labels = [getattr(one, f"get_{which}label")() for one in (axes, *aligned)]
    labels += [text.get_text() for text in (whole, *loose) if text is not None and text is not figure._suptitle]
    return next((text for text in labels if text), "")


def _limits(axes: Axes, which: str) -> Limits:
    """Return the ends of an axis; None if its ticks are names."""
    axis = getattr(axes, f"{which}axis")
    if _names(axis):
        return None
    low, high = sorted(axis.get_view_interval())
    return float(low), float(high)


def _with_range(name: str, limits: Iterable[Limits]) -> str:
    known = [ends for ends in limits if ends is not None]
    if not known:
        return name
    low, high = min(one[0] for one in known), max(one[1] for one in known)
    return f"{name}, {as_number(low)} to {as_number(high)}"


def shade(k: int, n: int) -> Any:
    """Return the k-th of n colors in order."""
    return _ORDERED(_LIGHTEST * k / (n - 1) if n > 1 else 0.3)


def shade_of(value: float, values: Sequence[float]) -> Any:
    """Return the color of one of several values by rank, since schedules are densest where responses differ most."""
    ranked = sorted(set(values))
    return shade(ranked.index(value), len(ranked))


def signed(x_mm: float, decimals: int = 2) -> str:
    """Format with a typographic minus and no negative zero."""
    return f"{round(x_mm, decimals) + 0.0:.{decimals}f}".replace("-", "−")


def some_of(n: int, most: int) -> list[int]:
    """Return the indices of evenly spread ticks that fit, including the first and the last."""
    return sorted({round(k * (n - 1) / (most - 1)) for k in range(most)})


def position_scale(axes: Axes, positions: Sequence[float]) -> None:
    """Add a scale for lines colored by position, right of a panel; it takes about 0.8 inches."""
    ranked = sorted(set(positions))
    n = len(ranked)
    if n == 1:
        return
    figure: Any = axes.figure
    width, _ = figure.get_size_inches()
    place = axes.get_position()
    beside = figure.add_axes((place.x1 + 0.12 / width, place.y0, 0.12 / width, place.height))
    bands = mpl.colors.ListedColormap([shade(k, n) for k in range(n)])
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(-0.5, n - 0.5), bands)
    ticks = some_of(n, _MOST_TICKS)
    bar = figure.colorbar(scale, label="indentor x (mm)", ticks=ticks, cax=beside)
    bar.ax.set_yticklabels([signed(ranked[k]) for k in ticks], fontsize=8)


_POINTS_A_CHARACTER = 0.55
"""Mean width of a character relative to the size of the font."""
_TITLE_POINTS = 9


def wrapped(text: str, most: int) -> str:
    """Break a title into lines of at most `most` characters, after spaces and commas."""
    lines = [""]
    for part in re.findall(r"[^ \n,]+[ \n,]*", text):
        if lines[-1] and len(lines[-1] + part.rstrip()) > most:
            lines.append("")
        lines[-1] += part
    return "\n".join(line.rstrip() for line in lines)


def row_title(axes: Axes, text: str) -> None:
    """Write a title from the left edge of a panel to the right edge of the figure, for the whole row."""
    figure: Any = axes.figure
    room_in = (1 - axes.get_position().x0) * figure.get_size_inches()[0]
    most = int(72 * room_in / (_POINTS_A_CHARACTER * _TITLE_POINTS))
    axes.set_title(wrapped(text, most), loc="left", fontsize=_TITLE_POINTS)


@dataclass(frozen=True)
class Room:
    """Margins of a figure without a layout engine, and gaps between its columns and rows (in)."""

    left: float = 0.6
    right: float = 0.1
    bottom: float = 0.5
    top: float = 0.3
    columns: float = 0.6
    rows: float = 0.6

    def panels(self, figure: Figure, rows: int, columns: int, **how: Any) -> Any:
        """Return (rows, columns) axes."""
        width, height = figure.get_size_inches()
        across = (width - self.left - self.right - (columns - 1) * self.columns) / columns
        down = (height - self.bottom - self.top - (rows - 1) * self.rows) / rows
        grid = {
            "left": self.left / width,
            "right": 1 - self.right / width,
            "bottom": self.bottom / height,
            "top": 1 - self.top / height,
            "wspace": self.columns / across,
            "hspace": self.rows / down,
        }
        return figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid, **how)


_WIDEST_PLAIN = 1e5


def label(measure: str) -> str:
    """Return a measure with its sign convention, e.g. "−ep1" where compression is plotted upwards."""
    if measure not in BY_NAME:
        return measure
    return f"−{BY_NAME[measure].symbol}" if BY_NAME[measure].as_magnitude else BY_NAME[measure].symbol


def unit(measure: str) -> str:
    """Return the unit of a measure; strains have none, all others are in pseudo-units."""
    return {"1": "strain"}.get(BY_NAME[measure].unit, BY_NAME[measure].unit.replace("unit", "units"))


def as_number(value: float | None, digits: int = 3) -> str:
    """Format a number for a table with a typographic minus; a dash if undefined."""
    if value is None:
        return "–"
    plain = f"{float(f'{value:.{digits}g}'):.12g}" if abs(value) < _WIDEST_PLAIN else f"{value:.{digits}g}"
    return plain.replace("-", "−")


def as_positions(values: Iterable[float]) -> str:
    """Format positions (mm) for a table; a dash if there are none."""
    return " ".join(as_number(round(float(v), 3) + 0.0, 4) for v in values) or "–"


def as_limits(values: Sequence[float | None] | None) -> str:
    """Format an interval for a table; empty if there is none."""
    return f"[{as_number(values[0])}, {as_number(values[1])}]" if values else ""
