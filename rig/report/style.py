"""The style of figures and labels: colors that survive print, the same bytes every time."""

import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sim.measures.measures import PLOTTED_AS_MAGNITUDE, STRAINS

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"  # Okabe & Ito
PURPLE, YELLOW = "#CC79A7", "#E69F00"
DOTTED = (0, (1, 3))
"""Dashes of lines that captions call dotted; matplotlib's own look solid where lines are thin."""
PNG_DOTS_PER_INCH = 200  # also used to measure text, whose widths are rounded at coarser resolutions
_IMAGES_DOTS_PER_INCH = 100
"""Resolution of the raster parts of an SVG (dpi)."""
PAGE_IN = (10.9, 6.3)
"""Width and height (in) of a figure beside its heading and caption on landscape A4; larger figures are scaled
down."""

_ORDERED = mpl.colormaps["viridis"]
_LIGHTEST = 0.86  # lighter lines fade on paper
_MOST_TICKS = 9
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

    def _save(self, target: io.StringIO | io.BytesIO, **options: Any) -> None:
        with mpl.rc_context():
            mpl.rcdefaults()  # The user's settings are for other figures.
            mpl.rcParams.update(_STYLE)
            self._laid_out.savefig(target, **options)

    @cached_property
    def _laid_out(self) -> Figure:
        """Figure laid out once for all formats; saving would render everything again for its layout."""
        figure = Figure(figsize=self.size, dpi=PNG_DOTS_PER_INCH, layout=self.layout)
        self.draw(figure)
        engine = figure.get_layout_engine()
        if engine is not None:
            engine.execute(figure)
            figure.set_layout_engine(None)
        return figure


def shade(k: int, n: int) -> Any:
    """Return the k-th of n colors in order."""
    return _ORDERED(_LIGHTEST * k / (n - 1) if n > 1 else 0.3)


def shade_of(value: float, values: Sequence[float]) -> Any:
    """Return the color of one of several values by rank, since schedules are densest where responses differ most."""
    ranked = sorted(set(values))
    return shade(ranked.index(value), len(ranked))


def signed(x_mm: float) -> str:
    """Format with two decimals, a typographic minus and no negative zero."""
    return f"{round(x_mm, 2) + 0.0:.2f}".replace("-", "−")


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


_ABBREVIATED = {"sed": "SED"}
_WIDEST_PLAIN = 1e5


def label(measure: str) -> str:
    """Return a measure with its sign convention, e.g. "−ep1" where compression is plotted upwards."""
    name = _ABBREVIATED.get(measure, measure)
    return f"−{name}" if measure in PLOTTED_AS_MAGNITUDE else name


def unit(measure: str) -> str:
    """Return the unit of a measure; strains have none, all others are in pseudo-units."""
    return "strain" if measure in STRAINS else "pseudo-units³" if measure == "third" else "pseudo-units"


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
