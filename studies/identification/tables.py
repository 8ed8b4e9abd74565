"""The tables of many identifications."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

Row = dict[str, Any]


def demands(sets: Mapping[str, Sequence[Row]]) -> list[list[str]]:
    """What is demanded, and what each set measured."""
    columns = [_inside(_of(rows, "inside")) + _outside(_of(rows, "outside")) for rows in sets.values()]
    asked = [[what, demanded] for what, demanded, _ in columns[0]]
    return [
        ["", "demanded", *sets],
        *([*row, *(column[k][2] for column in columns)] for k, row in enumerate(asked)),
    ]


def kinds(sets: Mapping[str, Sequence[Row]]) -> list[list[str]]:
    """Fingers from outside the prior, by set and kind."""
    rows = [["set", "from outside", "fingers", "flagged", "covered", "median error"]]
    for name, all_rows in sets.items():
        rows += [[name, *cells] for cells in _kinds(_of(all_rows, "outside"))]
    return rows


def _of(rows: Sequence[Row], of: str) -> list[Row]:
    return [row for row in rows if row["of"] == of]


def _inside(rows: Sequence[Row]) -> list[tuple[str, str, str]]:
    if not rows:
        return []
    error, configured = (np.abs(np.concatenate([row[key] for row in rows])) for key in ("error", "configured_error"))
    half, covered = (np.concatenate([row[key] for row in rows]) for key in ("half", "covered"))
    flagged = np.mean([row["mismatch"] is not None for row in rows])
    return [
        ("fingers of the prior", "≥ 200", f"{len(rows)}"),
        ("median error of force, held-back shapes", "≤ 5 %", f"{_percent(np.median(error))}"),
        ("90th percentile of it", "≤ 10 %", f"{_percent(np.quantile(error, 0.9))}"),
        (
            "the same of the unmet finger",
            "–",
            f"{_percent(np.median(configured))}, {_percent(np.quantile(configured, 0.9))}",
        ),
        ("median half-width of the 90 % band", "≤ 8 %", f"{_percent(np.median(half))}"),
        ("truth in the 90 % band", "85 … 95 %", f"{_percent(covered.mean())}"),
        ("flagged as no finger of the prior", "≤ 5 %", f"{_percent(float(flagged))}"),
        *_bench(rows),
    ]


def _bench(rows: Sequence[Row]) -> list[tuple[str, str, str]]:
    presses, bench_s = [row["presses"] for row in rows], [row["bench_s"] for row in rows]
    highest = max(max(row["of_trip"], default=0.0) for row in rows)
    ended = sum(row["ended"] is not None for row in rows)
    update_s = np.concatenate([row["update_s"] for row in rows])
    return [
        ("presses, median and most", "≤ 8", f"{np.median(presses):g}, {max(presses)}"),
        ("seconds of bench time, median and most", "≤ 180", f"{np.median(bench_s):.0f}, {max(bench_s):.0f}"),
        ("seconds of an update, median and most", "≤ 1", f"{np.median(update_s):.2f}, {update_s.max():.2f}"),
        ("highest force while learning over its trip", "≤ 1", f"{highest:.2f}"),
        ("highest force while learning", "–", f"{max(row['highest_gwt'] for row in rows):.1f} gwt"),
        ("meetings that ended before their end", "–", f"{ended}"),
    ]


def _outside(rows: Sequence[Row]) -> list[tuple[str, str, str]]:
    if not rows:
        return []
    well = sum(_well(row) for row in rows)
    return [("fingers from outside: covered or flagged", "≥ 36 of 40", f"{well} of {len(rows)}")]


def _well(row: Row) -> bool:
    """Flagged, or stopped by a trip, or four fifths of its forces in their bands."""
    return row["mismatch"] is not None or row["ended"] is not None or bool(np.mean(row["covered"]) >= 0.8)


def _kinds(rows: Sequence[Row]) -> list[list[str]]:
    found = []
    for kind in dict.fromkeys(row["kind"] for row in rows):
        own = [row for row in rows if row["kind"] == kind]
        flagged = sum(row["mismatch"] is not None or row["ended"] is not None for row in own)
        covered, error = (np.concatenate([row[key] for row in own]) for key in ("covered", "error"))
        median = _percent(float(np.median(np.abs(error))))
        found.append([kind, f"{len(own)}", f"{flagged}", _percent(covered.mean()), median])
    return found


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"
