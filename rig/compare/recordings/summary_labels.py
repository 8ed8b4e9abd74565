"""Labels of rows that are no measurements: sums, means and the like."""

import re
from collections.abc import Sequence

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.columns import Row

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


def refuse_summary_labels(rows: Sequence[Row]) -> None:
    """Refuse a row that a column which is not read calls a sum, a mean and the like, as an index of pandas does."""
    for name in rows[0].unread if rows else ():
        labels = [" ".join(_NO_WORD.sub(" ", row.unread[name].casefold()).split()) for row in rows]
        found = [n for n, label in enumerate(labels) if label and all(map(_is_summary_word, label.split()))]
        if len(found) == len(rows) or {labels[n] for n in found} <= _LEVELS:
            continue
        row = rows[found[0]]
        raise RecordingError(
            f"{row.path}, row {row.row}, column {name or 'without a name'}: {row.unread[name]!r} must be the "
            "label of a measurement; delete rows with sums, means and the like",
            "totals",
        )


def _is_summary_word(word: str) -> bool:
    return word in _SUMMARIES or _SUMMARY_WORD.fullmatch(word) is not None
