"""Figures as data and a style: panels of series, each with the rows of a table that it shows."""

import io
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from rig.report.style import INK, as_number, on_dark, shade, signed, some_of, wrapped

Array = NDArray[np.float64]

PAGE_IN = (10.9, 6.3)
"""Width and height (in) of a figure beside its heading and caption on landscape A4; larger figures are scaled
down."""
PHONE_IN = 4.0
"""Width (in) of a figure that fits a window of 420 pixels, at 96 in an inch."""
PNG_DOTS_PER_INCH = 200  # also used to measure text, whose widths are rounded at coarser resolutions
_IMAGES_DOTS_PER_INCH = 100
"""Resolution of the raster parts of an SVG (dpi)."""
_ON_MAP = "map"
"""Prefix of the ids of what is plotted over a map of colors, which keeps its colors on dark pages."""
_COLOR = re.compile(r"(fill|stroke): (#[0-9a-f]{6})")
_MARKER_ON_MAP = re.compile(rf'<g id="{_ON_MAP}_\d+">\s*<defs>\s*<path id="(\w+)"[^>]*style="([^"]*)"')
_MOST_TICKS = 9
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
class Rows:
    """Rows of a table that a series shows: `columns` in the order of its data, and the values that its rows share.

    A table is a CSV file of the run's folder, or one of the report. A "-" before a column changes its sign.
    """

    table: str
    columns: tuple[str, ...]
    where: Mapping[str, object]


def rows_of(table: str, *columns: str, **where: object) -> Rows:
    """Return the rows of a table that have these values."""
    return Rows(table, columns, where)


class Series:
    """Data of a panel, the method of matplotlib's Axes that draws them in a style, and the rows that they are.

    A series without rows is a guide, such as a line at zero.
    """

    def __init__(self, method: str, *data: Any, rows: Rows | None, **style: Any) -> None:
        self.method, self.data, self.rows, self.style = method, data, rows, style

    def draw(self, axes: Axes) -> None:
        getattr(axes, self.method)(*self.data, **self.style)

    @property
    def name(self) -> str:
        """Name in the legend, or ""."""
        return str(self.style.get("label") or "")

    def along(self, axis: Literal["x", "y"]) -> Array:
        """Return the finite values along an axis; none for a guide, or along an axis of names or densities."""
        x_and_y = _X_AND_Y.get(self.method, (0, 1))
        number, other = x_and_y if axis == "x" else x_and_y[::-1]
        if self.rows is None or number is None:
            return np.zeros(0)
        if self.method == "broken_barh":  # pairs of begin and length
            spans = np.asarray(self.data[0], dtype=float).reshape(-1, 2)
            return np.concatenate([spans[:, 0], spans.sum(axis=1)])
        if self.method == "fill_between" and axis == "y":
            values = np.concatenate([np.ravel(np.asarray(edge, dtype=float)) for edge in self.data[1:3]])
            return values[np.isfinite(values)]
        values = _raveled(self.data[number])
        if other is not None and np.size(self.data[other]) == len(values):
            values = values[np.isfinite(_raveled(self.data[other]))]
        return values[np.isfinite(values)]


def _raveled(values: Any) -> Array:
    """Return (n,) numbers; the rows of an event plot have different lengths."""
    parts = values if isinstance(values, list) else [values]
    return np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in parts or [[]]])


_X_AND_Y: dict[str, tuple[int | None, int | None]] = {
    "stairs": (1, 0), "hist": (0, None), "eventplot": (0, None), "broken_barh": (0, None), "imshow": (None, None),
    "axvline": (0, None),
}  # fmt: skip
"""Which data of a method lie along x and y, where these are not the first and the second."""


def guide(method: str, *data: Any, **style: Any) -> Series:
    """Return a mark that shows no data, such as a line at zero."""
    return Series(method, *data, rows=None, **style)


def entry(name: str, **style: Any) -> Series:
    """Return an entry of a legend for series that have no names of their own."""
    return guide("plot", [], [], label=name, **style)


def handles(entries: Iterable[Series]) -> list[Line2D]:
    """Return the entries as a legend takes them."""
    return [Line2D([], [], **one.style) for one in entries]


@dataclass(frozen=True)
class Subplot:
    """Series on one pair of axes, whose labels end with the unit in brackets."""

    x: str
    y: str
    series: Sequence[Series]
    title: str = ""
    printed: str = "xy"
    """Axes whose labels the panel prints; a neighbor or the figure prints the others."""
    x_names: Sequence[str] = ()
    y_names: Sequence[str] = ()
    """Ticks of an axis that has names instead of numbers."""
    color: str = ""
    """Label of the color scale."""
    is_part: bool = False
    """Whether data lie beyond the limits on purpose."""


Arrange = Callable[[Figure], Iterable[Axes]]
Finish = Callable[[Figure, list[Axes]], object]


def in_grid(panels: int, columns: int = 1, room: "Room | None" = None, **how: Any) -> Arrange:
    """Arrange panels in rows from left to right."""

    def arrange(figure: Figure) -> list[Axes]:
        rows = -(-panels // columns)
        subplots = partial(figure.subplots, squeeze=False) if room is None else partial(room.panels, figure)
        grid: Any = subplots(rows, columns, **how)
        for axes in grid.ravel()[panels:]:
            axes.set_axis_off()
        return list(grid.ravel()[:panels])

    return arrange


_ALONE = in_grid(1)
_Style = Mapping[str, Any]


@dataclass(frozen=True)
class Plot:
    """A figure of a page: its data in panels, heading and caption, and how it is drawn in a size (in)."""

    size: tuple[float, float]
    panels: Sequence[Subplot]
    title: str = ""
    caption: str = ""
    """What is plotted, without the files of the data, which follow from the series."""
    message: str = ""
    """What the figure shows, in a sentence."""
    arrange: Arrange = _ALONE
    finish: Finish = lambda figure, axes: None
    """Sets limits, ticks, legends and color scales after the series are drawn."""
    legend: Sequence[Series] = ()
    titles: _Style | None = field(default_factory=dict)
    """Style of the panels' titles; None if `finish` writes them."""
    labels: _Style = field(default_factory=dict)
    ticks: _Style = field(default_factory=dict)
    layout: Literal["constrained"] | None = "constrained"
    """Layout engine; None if `arrange` sets the margins."""
    charts: "tuple[ZoomChart, ...]" = ()
    """The same lines to zoom into on a screen; paper shows the figure."""

    def draw(self, figure: Figure) -> list[Axes]:
        """Draw into a figure; return the axes of the panels in their order."""
        drawn = list(self.arrange(figure))
        for axes, panel in zip(drawn, self.panels, strict=True):
            for one in panel.series:
                one.draw(axes)
            for axis in panel.printed:
                getattr(axes, f"set_{axis}label")(getattr(panel, axis), **self.labels)
            if panel.title and self.titles is not None:
                axes.set_title(panel.title, **self.titles)
            if self.ticks:
                axes.tick_params(**self.ticks)
        self.finish(figure, drawn)
        return drawn

    @property
    def whole_caption(self) -> str:
        """Caption with the files that have the data."""
        tables = [one.rows.table for panel in self.panels for one in panel.series if one.rows is not None]
        files = list(dict.fromkeys(name for name in tables if name.endswith(".csv")))
        return f"{self.caption} Data: {', '.join(files)}." if files else self.caption

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

    @property
    def alt(self) -> str:
        """Text for readers who do not see the figure: its message, axes and ranges."""
        panels = self.panels
        parts = [f"{len(panels)} panels"] if len(panels) > 1 else []
        for y, x in dict.fromkeys((one.y, one.x) for one in panels):
            mine = [one for one in panels if (one.y, one.x) == (y, x)]
            both = [_with_range(y, "y", mine), _with_range(x, "x", mine)]
            parts += [" against ".join(filter(None, both))] if any(both) else []
        lists = [*(("rows", one.y_names) for one in panels), *(("columns", one.x_names) for one in panels)]
        parts += dict.fromkeys(f"{what}: {_some(names)}" for what, names in lists if names)
        parts += dict.fromkeys(f"color: {one.color}" for one in panels if one.color)
        if self.names:
            parts.append(f"legend: {_some(self.names)}")
        return " ".join(f"{self.message} {'; '.join(parts)}.".split())

    @property
    def names(self) -> list[str]:
        """Names in the legends."""
        drawn = [one for panel in self.panels for one in panel.series]
        return list(dict.fromkeys(one.name for one in (*drawn, *self.legend) if one.name))

    def _save(self, target: io.StringIO | io.BytesIO, **options: Any) -> None:
        with _own_settings():
            self._laid_out.savefig(target, **options)

    @property
    def _laid_out(self) -> Figure:
        return self._drawn[0]

    @cached_property
    def _drawn(self) -> tuple[Figure, list[Axes]]:
        """Figure laid out once for all formats, since saving would lay it out again, and the axes of its panels."""
        with _own_settings():
            figure = Figure(figsize=self.size, dpi=PNG_DOTS_PER_INCH, layout=self.layout)
            panels = self.draw(figure)
            engine = figure.get_layout_engine()
            if engine is not None:
                engine.execute(figure)
                figure.set_layout_engine(None)
        _mark_maps(figure)
        return figure, panels


@dataclass(frozen=True)
class ZoomLine:
    """Line of a chart; None in `y` is a gap."""

    name: str
    color: str
    y: Sequence[float | None]


@dataclass(frozen=True)
class ZoomBand:
    """Intervals in x, shown as a strip below the lines of a chart."""

    name: str
    color: str
    spans: Sequence[tuple[float, float]]


@dataclass(frozen=True)
class ZoomChart:
    """Lines over shared ascending x, with the labels of both axes."""

    x_label: str
    y_label: str
    x: Sequence[float]
    lines: tuple[ZoomLine, ...]
    bands: tuple[ZoomBand, ...] = ()

    @property
    def as_data(self) -> dict[str, Any]:
        """Content for the page's script."""
        parts = {
            key: [{"name": one.name, "colors": (one.color, on_dark(one.color))} for one in found]
            for key, found in (("lines", self.lines), ("bands", self.bands))
        }
        spans = [band.spans for band in self.bands]
        labels = {"x_label": self.x_label, "y_label": self.y_label}
        return {**labels, **parts, "spans": spans, "data": [self.x, *(line.y for line in self.lines)]}


@contextmanager
def _own_settings() -> Iterator[None]:
    """Plot without the user's settings, which are for other figures."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


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
        if maps := _mapped(axes):
            over = [text for text in axes.texts if axes.bbox.overlaps(text.get_window_extent())]
            covered = any(not isinstance(one, PathCollection) for one in maps)  # dots have the page between them
            on_page = (*axes.collections, *axes.lines, *axes.patches) if covered else maps
            for artist in dict.fromkeys((*axes.images, *on_page, *over)):
                artist.set_gid(f"{_ON_MAP}_{number}")
                number += 1


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more


def _with_range(name: str, axis: Literal["x", "y"], panels: Sequence[Subplot]) -> str:
    values = np.concatenate([np.zeros(0), *(one.along(axis) for panel in panels for one in panel.series)])
    return f"{name}, {as_number(values.min())} to {as_number(values.max())}" if name and len(values) else name


POSITIONS = "indentor x (mm)"
"""Label of the scale of lines colored by position."""


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
    bar = figure.colorbar(scale, label=POSITIONS, ticks=ticks, cax=beside)
    bar.ax.set_yticklabels([signed(ranked[k]) for k in ticks], fontsize=8)


_POINTS_A_CHARACTER = 0.55
"""Mean width of a character relative to the size of the font."""
_TITLE_POINTS = 9


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
