"""Rows of a table that sum up the others, as their mean does: they are no measurements.

A row is one by its label, or, at an end of the table, by its numbers: each is the sum, mean and the like of the
others to its last digit. What the numbers alone do not show is stated by the readers: rows, first and last one, sum.
"""

import math
import re
import unicodedata
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# --- labels ---

_LONG = (
    # English
    r"means?|avg|averages?|medians?|sums?|totals?|pooled|std|std ?dev|stdev|sem|standard (?:deviation|error)"
    r"|variances?|quantiles?|percentiles?|quartiles?|confidence|populations?|grand"
    # German, French, Spanish, Italian, Portuguese
    r"|mittel(?:wert)?|durchschnitt|summe|gesamt|insgesamt|standardabweichung|stabw|varianz"
    r"|moyennes?|sommes?|mediane|ecart[- ]type|promedio|media|mediana|suma|desviacion|somma|totale|soma|desvio"
    # Dutch, Swedish, Danish, Norwegian, Finnish, Polish, Czech, Turkish
    r"|gemiddelde|totaal|mediaan|standaarddeviatie|medel(?:varde)?|gennemsnit|gjennomsnitt|standardavvik"
    r"|keskiarvo|summa|srednia|odchylenie|prumer|soucet|ortalama|toplam"
    # Russian, Chinese, Japanese, Korean
    "|среднее|сумма|итого|медиана|平均|平均值|平均値|均值|总和|总计|合计|合計|中位数|中央値|标准差|標準偏差|평균|합계"
)
_SHORT = (
    r"all|overall|sd|se|min|max|minimum|maximum|var|count|range|ci|cv|iqr|mw|som|snitt|alle|alles|tous|todos|tutti"
    "|x\u0304|\u00f8|\u03c3|\u2211|\u03bc"
)
"""Words that are those of summaries only if they stand alone: "SD 12" may name a unit."""
_LEVELS = frozenset(("all", "min", "max", "minimum", "maximum", "n", "alle"))
"""Words that may be those of conditions if they occur several times."""
_NUMBER_OF = r"\bn\s*=\s*\d+|\b\d+(?:\.\d+)?\s*%"
_ANYWHERE = re.compile(rf"(?<![^\W\d_])(?:{_LONG})(?![^\W\d_])|{_NUMBER_OF}")
_WHOLE = re.compile(rf"{_LONG}|{_SHORT}|{_NUMBER_OF}")
_FILLER = re.compile(r"of|the|de|der|des|and|und|et|y|rows?|presses|repeats?|trials?|\d+")
_NO_WORD = re.compile(r"[^\w%=.\u0304\u2211]+|_")


def _plain(label: str) -> str:
    """Return a label in small letters without accents, but with the bar of a mean."""
    letters = unicodedata.normalize("NFKD", label.casefold())
    return unicodedata.normalize("NFC", "".join(x for x in letters if not unicodedata.combining(x) or x == "\u0304"))


def is_summary(label: str) -> bool:
    """Return whether a label is one of sums, means and the like, such as "mean (n=2)"."""
    plain = _plain(label).strip()
    return _WHOLE.fullmatch(plain) is not None or _ANYWHERE.search(plain) is not None


def labeled_summary(labels: Sequence[str]) -> int | None:
    """Return the first row that a column of labels calls a sum, a mean and the like, as an index of pandas does.

    None if all rows are called so, since that is what was recorded.
    """
    texts = [_NO_WORD.sub(" ", _plain(label)).strip() for label in labels]
    found = [k for k, text in enumerate(texts) if _names_a_summary(text, once=texts.count(text) == 1)]
    return found[0] if found and len(found) < len(labels) else None


def _names_a_summary(text: str, *, once: bool) -> bool:
    if text in _LEVELS:
        return once
    words = [word for word in text.split() if not _FILLER.fullmatch(word)]
    return _WHOLE.fullmatch(text) is not None or (bool(words) and all(map(_WHOLE.fullmatch, words)))


# --- numbers ---

FEWEST_OTHERS = 3
_STEPS, _STEPS_BESIDE = 1000, 20
"""Fewest steps of the last digit within the range of the others (in several columns, their product) that tell a sum
or mean, and beside a place that is one, too."""
_FEWEST_SUMMED = 4
"""Fewest numbers that are not 0 whose sum, beyond all of them, another one hardly is."""
_ROUNDING = 0.87
"""Error of a sum of n numbers, each rounded, in last digits by √n: three sd."""
_EXACT, _MOST_DECIMALS = 1e-9, 12


class SummaryRow(NamedTuple):
    """A row of a table, from 0, and which statistic of the others it has; `sure`: to more digits than by chance."""

    row: int
    word: str
    sure: bool


def summary_row(
    measured: ArrayLike, places: ArrayLike | None = None, *, fewest: int = FEWEST_OTHERS
) -> SummaryRow | None:
    """Return a row at an end that is the sum or mean of the others in all measured columns, or None.

    measured (n, m) and places (n, p) are as in the file, so that their last digit is known; NaN is no value. A place
    may be any, such as the next of equally spaced ones; a place that is a sum or mean, too, needs fewer digits. The
    two outer rows are compared with those further in, as a mean beside a sum or an sd.
    """
    values = np.asarray(measured, dtype=float)
    at = np.empty((len(values), 0)) if places is None else np.asarray(places, dtype=float)
    numbers, unsure = np.arange(len(values)), None
    for order in (numbers, numbers[::-1]):
        for outer in range(1, min(2, len(values) - fewest) + 1):
            rest = order[:-outer]
            for k, word in product(order[-outer:].tolist(), ("sum", "mean")):
                sure = _is_summed_up(values[rest], values[k], at[rest], at[k], word)
                if sure:
                    return SummaryRow(k, word, True)
                if sure is not None and outer == 1:
                    unsure = unsure or SummaryRow(k, word, False)
    return unsure


def _is_summed_up(values: Array, row: Array, places: Array, place: Array, word: str) -> bool | None:
    """Return whether a row surely is the sum or mean of others; None if its values are not."""
    known = np.isfinite(row) & (np.isfinite(values).sum(axis=0) > 1)
    values, row = values[:, known], row[known]
    summed = np.isfinite(values).sum(axis=0)
    found = np.nansum(values, axis=0) / (1 if word == "sum" else summed)
    if not len(row) or not (np.abs(found - row) <= 0.51 + summed).all():  # before digits are counted
        return None
    mine = np.full(len(row), last_digit(row[None]).min())  # a row of means has decimals in all columns
    within = _rounding(mine, last_digit(values), len(values), word) + _EXACT * np.abs(found)
    low, high = np.nanmin(values, axis=0), np.nanmax(values, axis=0)
    same = ((values == row).all(axis=1) & (places == place).all(axis=1)).any()
    if not (np.abs(found - row) <= within).all() or same or (word == "mean" and not (high > low).any()):
        return None
    scale = np.maximum(high - low, np.abs(found)) if word == "sum" else high - low
    steps = float(np.prod(np.maximum(scale / (2 * within), 1.0)))
    summands = np.count_nonzero(np.nan_to_num(values))
    if word == "sum" and summands < FEWEST_OTHERS:  # as of a silent afferent
        return None
    exact = (np.abs(found - row) <= 0.51 * mine + _EXACT * np.abs(found)).all()
    if not exact and steps < _STEPS_BESIDE:  # Of few digits a rounded sum says nothing.
        return None
    beyond = ((row > high + within) | (row < low - within)).all()
    if word == "sum" and beyond and summands >= _FEWEST_SUMMED:
        return True
    return steps >= (_STEPS_BESIDE if _has_place(places, place, word) else _STEPS)


def _has_place(places: Array, place: Array, word: str) -> bool:
    """Return whether a place is the sum or mean of others, too, and not one of several presses."""
    if not (np.ptp(places, axis=0) > 0).any():
        return False
    found = places.sum(axis=0) / (1 if word == "sum" else len(places))
    digits = last_digit(places)
    within = _rounding(np.minimum(last_digit(place[None]), digits), digits, len(places), word) + _EXACT * np.abs(
        found
    )
    repeated = len(np.unique(places, axis=0)) < len(places)
    taken = repeated and bool((places == place).all(axis=1).any())
    return bool((np.abs(found - place) <= within).all()) and not taken


def _rounding(mine: Array, digits: Array, others: int, word: str) -> Array:
    """Return by how much a row may miss a sum or mean: its last digit, and those of others, rounded like it."""
    of_others = _ROUNDING * digits * (math.sqrt(others) if word == "sum" else 1 / math.sqrt(others))
    return np.asarray(0.51 * mine + np.where((mine >= digits) & (digits < 1), of_others, 0.0))


def last_digit(table: Array) -> Array:
    """Return the place value of the last digit in each column of (n, columns), at most 1."""
    digit = np.full(table.shape[1], 10.0**-_MOST_DECIMALS)
    for decimals in range(_MOST_DECIMALS - 1, -1, -1):
        rounded = np.round(table, decimals)
        digit[((rounded == table) | np.isnan(table)).all(axis=0)] = 10.0**-decimals
    return digit
