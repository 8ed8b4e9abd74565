"""Numbers in the cells of a table: decimal signs and thousands separators.

"-2,000" is −2000 or −2.000. Another cell of the table may tell; otherwise the cell is refused.
"""

import math
import re
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from rig_shared.number_text import read_number
from sim.tables import is_number

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d*([eE][+-]?\d+)?", re.ASCII)
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}([.,])\d{3}", re.ASCII)  # −2,000 and 2.000
_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(([.,'’ \u00a0\u202f])\d{3})(\2\d{3})+", re.ASCII)  # 2,000,000
_WHOLE = re.compile(r"[+-]?\d{3,}", re.ASCII)


class NumberFormat(NamedTuple):
    """Decimal sign of a table, and the columns in which a separator may be one of thousands."""

    comma: str = ""
    """A cell with a decimal comma; "" if the point is the decimal sign."""
    ambiguous: frozenset[str] = frozenset()

    def number(self, text: str) -> float:
        """Return the number of a cell, NaN for a text."""
        text = _minus(text)
        if self.comma and "." in text:  # 1.234,5 or a mixture: which of the two is the decimal sign?
            return math.nan
        if _NUMBER.fullmatch(text.replace(",", ".")) is None:
            return math.nan
        value = read_number(text.replace(",", "."))
        return value if is_number(value) else math.nan

    def could_be_thousands(self, column: str, text: str) -> bool:
        """Return whether a separator in a cell may be one of thousands."""
        text = _minus(text)
        return _GROUPS.fullmatch(text) is not None or (
            column in self.ambiguous and _GROUPED.fullmatch(text) is not None
        )


def label_key(label: str) -> str | float:
    """Return what all ways of writing a label have in common: the number of `1`, `1.0` and `01`, or small letters.

    A label that is no number is compared as text, with single spaces: `A1` is `a1`, and not `A01`.
    """
    number = NumberFormat().number(label)
    return " ".join(label.split()).casefold() if math.isnan(number) else number


def number_format(rows: Iterable[Mapping[str, str]], *, semicolons: bool = False) -> NumberFormat:
    """Return the format of the numbers of a table; semicolons separate columns where the comma is a decimal sign."""
    columns: dict[str, list[str]] = {}
    for cells in rows:
        for name, text in cells.items():
            columns.setdefault(name, []).append(_minus(text))
    commas = [text for texts in columns.values() for text in texts if "," in text and _DECIMAL_COMMA.fullmatch(text)]
    proven = next((text for text in commas if _GROUPED.fullmatch(text) is None), "")
    points = [text for texts in columns.values() for text in texts if "." in text and _NUMBER.fullmatch(text)]
    unproven = semicolons and not any(_GROUPED.fullmatch(text) is None for text in points)
    ambiguous = {
        name
        for name, texts in columns.items()
        if (not proven and any("," in text and _GROUPED.fullmatch(text) for text in texts))
        or _points_group(texts, unproven)
    }
    return NumberFormat(proven, frozenset(ambiguous))


def _points_group(texts: list[str], unproven: bool) -> bool:
    """Return whether all points of a column may separate thousands, and a whole number or the table suggests it."""
    pointed = [text for text in texts if "." in text]
    grouped = bool(pointed) and all(_GROUPED.fullmatch(text) for text in pointed)
    return grouped and (unproven or any(_WHOLE.fullmatch(text) for text in texts))


def without_separators(text: str) -> str:
    """Return a cell without the separators of thousands, as a remedy."""
    return re.sub(r"[.,'’ \u00a0\u202f]", "", text)


def _minus(text: str) -> str:
    return text.replace("−", "-")
