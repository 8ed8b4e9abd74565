"""What is said with plausible fingers stated, as rows: for `--json` and as sections of the report."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.compare.comparison import Comparison, Joint
from rig.compare.fingers import PlausibleFingers
from rig.compare.results import Pair, joint_row, number
from rig.compare.with_finger import WithFinger
from rig.report.page import Section
from rig.report.style import as_limits, as_number, as_positions
from sim.models.interpolation import HOW_MADE

Row = dict[str, Any]

_HEADER = (
    "measure", "receptor (mm)", "R²", "best finger", "k, on this finger", "95 % interval", "on all fingers",
    "ε₀, on this finger", "95 % interval", "on all fingers",
)  # fmt: skip


@dataclass(frozen=True)
class FingerTable:
    """What one joint fit says with the finger anywhere in the stated ranges.

    `rows` has each measure that by least squares explains no less than the best, at the receptor where it explains
    most, with and without doubt of the finger. Which of these the recordings can tell apart is the answers' to say.
    """

    joint: Joint
    plausible: PlausibleFingers
    rows: list[Row]

    @property
    def interpolated(self) -> bool:
        """Whether fingers were not built in full."""
        return any(overlay.stimulus.interpolated for overlay in self.joint.overlays)


def finger_tables(comparison: Comparison) -> list[FingerTable]:
    """One for each joint fit, each fitted once; none where no fingers are stated."""
    plausible = comparison.plausible
    return [] if plausible is None else [_table(WithFinger(joint), plausible) for joint in comparison.joints]


def _table(found: WithFinger, plausible: PlausibleFingers) -> FingerTable:
    rows = [_row(found, pair, plausible) for pair in _best_of_set(found)]
    return FingerTable(found.joint, plausible, rows)


def fingers_as_json(comparison: Comparison, tables: Sequence[FingerTable]) -> dict[str, Any]:
    """What `rig compare --json` prints besides when fingers are stated; nothing without."""
    plausible = comparison.plausible
    if plausible is None:
        return {}
    return {
        "fingers": {
            "ranges": {name: list(limits) for name, limits in plausible.ranges.items()},
            "built": 3 ** len(plausible.free),
            "interpolation": HOW_MADE if any(table.interpolated for table in tables) else None,
            "joint": [row for table in tables for row in table.rows],
        }
    }


def _best_of_set(found: WithFinger) -> list[Pair]:
    chosen = found.indistinguishable
    if chosen is None:
        return []
    explained = np.where(chosen & np.isfinite(found.explained), found.explained, -np.inf)
    return [(m, int(np.argmax(row))) for m, row in enumerate(explained) if np.isfinite(row).any()]


def _row(found: WithFinger, pair: Pair, plausible: PlausibleFingers) -> Row:
    limits = found.interval(*pair)
    given = joint_row(found.joint, pair)
    return {
        **{name: given[name] for name in ("shapes", "condition", "measure", "receptor_mm")},
        "r2": number(found.explained[pair]),
        "best_finger": {name: round(value, 6) for name, value in plausible.values(found.place[pair]).items()},
        "k": number(found.fit.k[pair]),
        "k_interval": [number(v) for v in limits.k] if limits else None,
        "eps0": number(found.fit.eps0[pair]),
        "eps0_interval": [number(v) for v in limits.eps0] if limits else None,
        "resampled": limits.over if limits else None,
        "on_this_finger": {name: given[name] for name in _GIVEN},
    }


_GIVEN = ("k", "k_interval", "eps0", "eps0_interval", "r2")


def finger_section(table: FingerTable) -> Section:
    """For the report."""
    plausible = table.plausible
    ranges = "; ".join(f"{name} {low:g} … {high:g}" for name, (low, high) in plausible.ranges.items())
    made = f" The fingers were {HOW_MADE}; `--exact` builds each in full." if table.interpolated else ""
    return Section(
        f"On all plausible fingers: {table.joint.title}",
        f"Stated as plausible: {ranges} (file with SHA-256 {plausible.sha256}). Least squares; each pair may have "
        "its best finger. Intervals “on all fingers” are the hull of those on every finger of the ranges on which it "
        "does not fit significantly worse than on its best one: they hold for whatever finger lies within the "
        "ranges, and for no other. “On this finger” is what the run's own finger gives." + made,
        _HEADER,
        tuple(_cells(row) for row in table.rows),
    )


def _cells(row: Row) -> tuple[str, ...]:
    given = row["on_this_finger"]
    place = ", ".join(f"{name.rpartition('.')[2]} {as_number(value)}" for name, value in row["best_finger"].items())
    values = [
        (as_number(given[name]), as_limits(given[f"{name}_interval"]), as_limits(row[f"{name}_interval"]))
        for name in ("k", "eps0")
    ]
    return (row["measure"], as_positions([row["receptor_mm"]]), as_number(row["r2"]), place,
            *values[0], *values[1])  # fmt: skip
