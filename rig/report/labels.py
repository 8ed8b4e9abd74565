"""How measures and numbers are written in figures and tables."""

from collections.abc import Iterable, Sequence

from sim.measures.measures import PLOTTED_AS_MAGNITUDE, STRAINS

_ABBREVIATED = {"sed": "SED"}
_WIDEST_PLAIN = 1e5


def label(measure: str) -> str:
    """A measure with its sign convention: "−ep1" where compression is plotted upwards."""
    name = _ABBREVIATED.get(measure, measure)
    return f"−{name}" if measure in PLOTTED_AS_MAGNITUDE else name


def unit(measure: str) -> str:
    """Strains are numbers, everything else is in pseudo-units."""
    return "strain" if measure in STRAINS else "pseudo-units³" if measure == "third" else "pseudo-units"


def as_number(value: float | None, digits: int = 3) -> str:
    """A number for a table with a typographic minus; a dash where there is none."""
    if value is None:
        return "–"
    plain = f"{float(f'{value:.{digits}g}'):.12g}" if abs(value) < _WIDEST_PLAIN else f"{value:.{digits}g}"
    return plain.replace("-", "−")


def as_positions(values: Iterable[float]) -> str:
    """Places in mm for a table; a dash where there are none."""
    return " ".join(as_number(round(float(v), 3) + 0.0, 4) for v in values) or "–"


def as_limits(values: Sequence[float | None] | None) -> str:
    """An interval for a table; nothing where there is none."""
    return f"[{as_number(values[0])}, {as_number(values[1])}]" if values else ""
