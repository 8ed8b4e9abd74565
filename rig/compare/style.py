"""How figures look: labelled, in colours that survive colour blindness and print, the same bytes every time."""

import io
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"  # Okabe & Ito
PURPLE, YELLOW = "#CC79A7", "#E69F00"
_ORDERED = mpl.colormaps["viridis"]
_STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.hashsalt": "rig",
    "svg.fonttype": "path",
    "legend.frameon": False,
}


def svg(size: tuple[float, float], draw: Callable[[Figure], None]) -> str:
    """A drawing of a size in inches."""
    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()


def shade(k: int, n: int) -> Any:
    """The k-th of n colours in order."""
    return _ORDERED(0.92 * k / (n - 1) if n > 1 else 0.3)


def shade_of(value: float, values: list[float]) -> Any:
    """The colour of one of a range of values."""
    low, high = min(values), max(values)
    return _ORDERED(0.92 * (value - low) / (high - low) if high > low else 0.3)


def signed(x_mm: float) -> str:
    """Two decimals with a typographic minus and no negative zero."""
    return f"{round(x_mm, 2) + 0.0:.2f}".replace("-", "−")


def position_bar(figure: Figure, axes: Any, positions: list[float]) -> None:
    """A scale for lines that are coloured by position."""
    low, high = min(positions), max(positions)
    if high == low:
        return
    scale = mpl.cm.ScalarMappable(
        mpl.colors.Normalize(low, high),
        mpl.colors.ListedColormap([_ORDERED(0.92 * k / 255) for k in range(256)]),
    )
    figure.colorbar(scale, ax=axes, label="indentor x (mm)")
