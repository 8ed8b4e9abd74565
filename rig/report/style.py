"""The style of figures and labels: colors that survive print, numbers as a paper prints them."""

import re
from collections.abc import Iterable, Sequence
from typing import Any

import matplotlib as mpl

from sim.measures.measures import BY_NAME

BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"  # Okabe & Ito
PURPLE, YELLOW = "#CC79A7", "#E69F00"
DOTTED = (0, (1, 3))
"""Dashes of lines that captions call dotted; matplotlib's own look solid where lines are thin."""
INK, PAPER = "#e6e6e6", "#16181b"
"""Text and background of dark pages, as in `templates/style.css`."""
_TOWARDS_WHITE = 0.35
"""Share of white in colors on dark pages; less would hide the darkest ones."""
_ORDERED = mpl.colormaps["viridis"]
_LIGHTEST = 0.86  # lighter lines fade on paper


def on_dark(color: str) -> str:
    """Return a color of a figure on a dark page: black and white change places, hues become lighter."""
    rgb, (ink, paper) = mpl.colors.to_rgb(color), (mpl.colors.to_rgb(one) for one in (INK, PAPER))
    if len(set(rgb)) == 1:
        mixed = [a + (b - a) * rgb[0] for a, b in zip(ink, paper, strict=True)]
    else:
        mixed = [value + (1 - value) * _TOWARDS_WHITE for value in rgb]
    red, green, blue = mixed
    return mpl.colors.to_hex((red, green, blue))


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


def wrapped(text: str, most: int) -> str:
    """Break a title into lines of at most `most` characters, after spaces and commas."""
    lines = [""]
    for part in re.findall(r"[^ \n,]+[ \n,]*", text):
        if lines[-1] and len(lines[-1] + part.rstrip()) > most:
            lines.append("")
        lines[-1] += part
    return "\n".join(line.rstrip() for line in lines)


_WIDEST_PLAIN = 1e5


def label(measure: str) -> str:
    """Return a measure with its sign convention, e.g. "−ep1" where compression is plotted upwards."""
    if measure not in BY_NAME:
        return measure
    return f"−{BY_NAME[measure].symbol}" if BY_NAME[measure].as_magnitude else BY_NAME[measure].symbol


def unit(measure: str) -> str:
    """Return the unit of a measure; strains have none, all others are in pseudo-units."""
    return {"1": "strain"}.get(BY_NAME[measure].unit, BY_NAME[measure].unit.replace("unit", "units"))


def in_unit(measure: str) -> str:
    """Return the label of an axis of a measure."""
    return f"{label(measure)} ({unit(measure)})"


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


def rate_label(unit: str) -> str:
    """Return the label of an axis of discharge rates in a unit of a recording."""
    return f"discharge rate ({'impulses/s' if unit == '1/s' else unit})"
