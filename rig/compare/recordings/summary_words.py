"""Words that label sums, means and the like, which are no measurements."""

import re
from collections.abc import Mapping
from pathlib import Path

from rig.compare.exceptions import RecordingError

_SUMMARIES = (
    "all", "overall", "sd", "std", "se", "sem", "min", "max", "minimum", "maximum", "var", "count", "range", "ci",
    "cv", "iqr",
)  # fmt: skip
_LEVELS = {"all", "min", "max", "minimum", "maximum"}
"""Words that may be those of conditions."""
_NO_WORD = re.compile(r"[^\w%=.]+|_")
_SUMMARY_WORD = re.compile(
    r"(?<![^\W\d_])(means?|avg|averages?|medians?|sums?|totals?|pooled|mittel(?:wert)?|durchschnitt|summe|gesamt"
    r"|moyennes?|sommes?|promedio|media|suma|somma|totale|variances?|varianz|std ?dev|std|sem"
    r"|standard (?:deviation|error)|quantiles?|percentiles?|quartiles?|confidence|populations?|grand)(?![^\W\d_])"
    r"|\bn\s*=\s*\d|\b\d+(?:\.\d+)?\s*%"
)


def is_summary(label: str) -> bool:
    """Return whether the label of a repeat is that of a row of sums, means and the like, such as "mean (n=2)"."""
    return label.casefold() in _SUMMARIES or _SUMMARY_WORD.search(label.casefold()) is not None


def refuse_summary_label(path: Path, column: str, cells: Mapping[int, str]) -> None:
    """Refuse a row (by its number) that a column calls a sum, a mean and the like, as an index of pandas does."""
    words = {row: _NO_WORD.sub(" ", cell.casefold()).split() for row, cell in cells.items()}
    found = [row for row, label in words.items() if label and all(map(_is_summary_word, label))]
    if len(found) < len(cells) and not {" ".join(words[row]) for row in found} <= _LEVELS:
        raise RecordingError(
            f"{path}, row {found[0]}, column {column or 'without a name'}: {cells[found[0]]!r} must be the label of "
            "a measurement; delete rows with sums, means and the like",
            "totals",
        )


def _is_summary_word(word: str) -> bool:
    return word in _SUMMARIES or _SUMMARY_WORD.fullmatch(word) is not None
