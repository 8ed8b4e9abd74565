"""Every figure and table of the source that the model can be asked about, in the source's order.

Matrix, page, tables and `docs/validation/source.md` come from this list.
"""

from studies.coding import chapter_6
from studies.source.printed import (
    bars,
    beside,
    cylinders,
    formula,
    geometry,
    profiles,
    steps,
    table,
    under_steps,
)
from studies.source.printed.entry import Entry

_STEP_SED, _LONG_SED, *_FORCES = under_steps.ENTRIES
_CYLINDERS, _DEPTHS = cylinders.ENTRIES
_STEP_PROFILES, _BAR_PROFILES = profiles.ENTRIES
_RECORDED_STEPS, _RECORDED_BARS, _RECORDED_TABLE = beside.RECORDED

ENTRIES: tuple[Entry, ...] = (
    *geometry.ENTRIES,
    *beside.BEFORE,
    *bars.ENTRIES,
    _CYLINDERS,
    *steps.ENTRIES,
    _STEP_SED,
    _LONG_SED,
    _DEPTHS,
    *formula.ENTRIES,
    *_FORCES,
    _STEP_PROFILES,
    _RECORDED_STEPS,
    _BAR_PROFILES,
    _RECORDED_BARS,
    _RECORDED_TABLE,
    *table.ENTRIES,
    *chapter_6.ENTRIES,
    *beside.OUTSIDE,
)


def named(keys: list[str]) -> tuple[Entry, ...]:
    """Those of some keys, all without any. Raises KeyError with the first that there is none of."""
    by_key = {entry.key: entry for entry in ENTRIES}
    return tuple(by_key[key] for key in keys) or ENTRIES
