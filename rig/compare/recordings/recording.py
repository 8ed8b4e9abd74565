"""Recorded response profiles: rates against position, with their shape and condition."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.compare.exceptions import RecordingError
from rig.compare.recordings.column_units import MOST_RATE
from rig.compare.recordings.spike_times import SpikeClock
from rig_shared.plural import number_of
from sim.contact.shapes import shape_name
from sim.tables import is_number

Array = NDArray[np.float64]

_FEWEST_POSITIONS = 3
SAME_PLACE_DECIMALS = 3
"""Decimals of mm to which positions are rounded: presses at equal ones are repeats."""


@dataclass(frozen=True)
class FromSpikes:
    """What a recording from spike times was made of.

    `lost_mm` are the positions of the presses at which the unit was not observed, of `presses`; `span` says when it
    was. `spike_s` are the spikes in s since the start of the run. `shifted` returns the recording as it were if the
    clock of the file told a later time (s), `counted` that of a window of another length (s).
    """

    presses: int
    lost_mm: tuple[float, ...]
    span: str
    clock: SpikeClock
    notes: tuple[str, ...]
    spike_s: Array
    shifted: "Callable[[float], Recording]"
    counted: "Callable[[float], Recording]"

    def mirrored(self) -> "FromSpikes":
        """Return the origin of the mirrored recording."""
        shifted, counted = self.shifted, self.counted
        return replace(
            self,
            lost_mm=tuple(-x for x in self.lost_mm),
            shifted=lambda shift_s: shifted(shift_s).mirrored(),
            counted=lambda length_s: counted(length_s).mirrored(),
        )

    @property
    def not_observed(self) -> int:
        """Number of presses at which the unit was not observed."""
        return len(self.lost_mm)

    @property
    def changes(self) -> tuple[str, ...]:
        """The number of presses that were left out, for every plot; nothing for none."""
        return (f"without {self.not_observed} of {self.presses} presses, not observed",) if self.lost_mm else ()

    @property
    def lost(self) -> str:
        """How many presses were not observed, and why; an empty text for none."""
        if not self.lost_mm:
            return ""
        are = "is" if self.not_observed == 1 else "are"
        return f"{self.not_observed} of {number_of(self.presses, 'presses')} {are} not observed: {self.span}"

    @property
    def left_out(self) -> str:
        """`lost` as sentences; an empty text for none."""
        them = "It is" if self.not_observed == 1 else "They are"
        return f"{self.lost}. {them} left out." if self.lost_mm else ""


@dataclass(frozen=True)
class Recording:
    """Recorded rates against position, for one shape.

    `position_mm` (p,) ascends; `repeats` are the rates at each position; `sd` (p,) is that over repeats or from the
    file, NaN if unknown. `window_s` is the window in which the spikes of each press were counted, so that rate ×
    window is a count; None if unknown.
    """

    name: str
    position_mm: Array
    repeats: tuple[Array, ...]
    sd: Array
    changes: tuple[str, ...] = ()  # what was done to the file's numbers, for every plot
    sha256: str = ""  # of the file
    window_s: float | None = None
    spikes: FromSpikes | None = None
    """Origin of the rates, if they were counted from spike times."""
    rate_unit: str = "1/s"
    """Unit of the rates; of a table in a unit of its own, such as "a.u.", that one."""
    read_as: str = ""
    """Sentences on the columns that were read, and their units."""
    highest_in: str = ""
    """Where the file has the highest rate, e.g. "row 12"; "" for spike times."""
    rows_text: str = ""
    """First and last row of a table, and its sum, as in the file."""

    @property
    def rate(self) -> Array:
        """Mean rate (p,) over repeats."""
        return np.array([rates.mean() for rates in self.repeats])

    @property
    def contents(self) -> str:
        """What was read: the presses used of those in the file, positions, and the range of the rates."""
        each = np.concatenate(self.repeats)
        used, places = len(each), self.position_mm
        of = "" if self.spikes is None or not self.spikes.not_observed else f" of {self.spikes.presses}"
        unit = f" {self.rate_unit}"
        if self.window_s is not None:
            unit += f" ({each.min() * self.window_s:.0f} to {each.max() * self.window_s:.0f} spikes)"
        highest = next(x for x, rates in zip(places, self.repeats, strict=True) if rates.max() == each.max())
        where = f"{highest:g} mm" + f" ({self.highest_in})" * bool(self.highest_in)
        return (
            f"{used}{of} presses at {number_of(len(places), 'positions')} from {places[0]:g} to {places[-1]:g} mm, "
            f"{each.min():.4g} to {each.max():.4g}{unit}, highest at {where}."
            + f" In the file, {self.rows_text}"
            * bool(self.rows_text)
        )

    def mirrored(self) -> "Recording":
        """Return the recording with negated positions, for profiles that are mirror images in the finger's frame."""
        return replace(
            self,
            position_mm=-self.position_mm[::-1],
            repeats=self.repeats[::-1],
            sd=self.sd[::-1],
            changes=(*self.changes, "mirrored"),
            spikes=None if self.spikes is None else self.spikes.mirrored(),
        )

    def normalized(self, largest: float) -> "Recording":
        """Return the recording with rates divided by `largest`; the window is scaled so that the counts do not
        change.
        """
        repeats = tuple(rates / largest for rates in self.repeats)
        changes = (*self.changes, f"rates divided by {largest:g}")
        window_s = None if self.window_s is None else self.window_s * largest
        unit = "of the largest rate"
        return replace(
            self, repeats=repeats, sd=self.sd / largest, changes=changes, window_s=window_s, rate_unit=unit
        )


def recording(name: str, rows: list[tuple[float, float, float]], window_s: float | None = None) -> Recording:
    """Return a recording from rows (position_mm, rate, sd or NaN), one per repeat, in any order.

    window_s: window of the counts."""
    at: dict[float, list[tuple[float, float]]] = {}
    for position, rate, one_sd in rows:
        at.setdefault(position, []).append((rate, one_sd))
    places = sorted(at)
    repeats = tuple(np.array([rate for rate, _ in at[place]]) for place in places)
    given = [at[place][0][1] for place in places]
    sd = [np.std(r, ddof=1) if len(r) > 1 else g for r, g in zip(repeats, given, strict=True)]
    return Recording(name, np.array(places), repeats, np.array(sd), window_s=window_s)


def with_enough_positions(path: Path, found: Recording) -> Recording:
    """Return the recording. Raises RecordingError for fewer than three positions, which are too few for a profile."""
    if len(found.repeats) < _FEWEST_POSITIONS:
        lost = "" if found.spikes is None or not found.spikes.lost else f"; {found.spikes.lost}"
        raise RecordingError(
            f"{path}: {len(found.repeats)} positions, at least {_FEWEST_POSITIONS} are required{lost}",
            "few_positions",
        )
    return _without_copies(found)


def _without_copies(found: Recording) -> Recording:
    """Return the recording with one of each repeat if all are equal, as copies are: noise cannot be estimated."""
    repeated = [rates for rates in found.repeats if len(rates) > 1]
    firing = [rates for rates in repeated if rates.max() > 0]
    if len(firing) < _FEWEST_POSITIONS or any(np.ptp(rates) > _SAME * rates.max() for rates in repeated):
        return found
    sd = np.where([len(rates) > 1 for rates in found.repeats], np.nan, found.sd)
    text = "All repeats are equal, as copies are, and say nothing about the noise: each position counts once."
    return replace(
        found, repeats=tuple(rates[:1] for rates in found.repeats), sd=sd, read_as=f"{found.read_as} {text}".strip()
    )


def refuse_impossible_rate(path: Path, found: Recording) -> None:
    """Refuse counts that no afferent fires. Raises RecordingError."""
    most = max(float(rates.max()) for rates in found.repeats)
    if found.window_s is not None and most > MOST_RATE:
        raise RecordingError(
            f"{path}: {most * found.window_s:g} spikes in {found.window_s:g} s are {most:g} in 1 s, at most "
            f"{MOST_RATE:g} are possible; check the unit of time",
            "beyond_a_finger",
        )


_SAME = 1e-6
_UNITS = {"doi_mm": "mm", "force_gwt": "gwt"}
_CONDITION = re.compile(r"(\d+\.?\d*|\.\d+) ?(mm|gwt)", re.ASCII)


class ShapeKey(NamedTuple):
    """Canonical name of a shape, and a condition such as "8 gwt"; an empty condition matches any."""

    shape: str
    condition: str

    def __str__(self) -> str:
        """Return the key of a recording, "step:1" or "step:1@8 gwt"."""
        return f"{self.shape}@{self.condition}" if self.condition else self.shape


def shape_key(text: str) -> ShapeKey:
    """Parse "step:1" or "step:1@8gwt". Raises RecordingError, ShapeError."""
    shape, at, said = text.partition("@")
    condition = _CONDITION.fullmatch(said.strip())
    if at and condition is None:
        raise RecordingError(
            f"{text!r}: {said!r} after @ must be a force or a depth, e.g. 8gwt or 0.5mm", "no_condition"
        )
    return ShapeKey(shape_name(shape), f"{float(condition[1]):g} {condition[2]}" if condition else "")


def condition_of(started: Mapping[str, Any]) -> str:
    """Return the commanded force or depth of an indentation, from its `indentation_start`."""
    return f"{started['value']:g} {_UNITS[started['target']]}"


def finite_times(path: Path, dataset: str, times: Array) -> Array:
    """Return times that are all finite. Raises RecordingError."""
    wrong = np.flatnonzero(~is_number(times))
    if len(wrong):
        raise RecordingError(
            f"{path}, {dataset}, entry {int(wrong[0]) + 1}: {float(times[wrong[0]]):g} must be a number", "not_finite"
        )
    return times
