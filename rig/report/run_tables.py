"""Tables of a run's report, repeats by condition, and the numbers behind its figures as CSV."""

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.data import Run
from rig.data.dictionary import MODEL_TABLES, OF_A_HOLD
from rig.data.folder import replace_table
from rig.data.tables import booked_s, motions_in_contact, spans, tables
from rig.plan.finger_model import PredictedHold
from rig.records import SAME_DECIMALS, force_tolerance_gwt, grouped
from rig.report.style import as_number, signed
from rig.settings import HabitSettings, LimitSettings, StageSettings, limits_in_kpa
from rig_shared.natural_order import natural_order
from rig_shared.plural import number_of
from rig_shared.user_files import read_text, toml_of
from sim.measures.measures import MEASURES
from sim.units import GWT_N

COLUMNS = {
    name: tuple(OF_A_HOLD) + (("receptor_x_mm", *MEASURES) if name == "model_measures" else tuple(own))
    for name, own in MODEL_TABLES.items()
}
"""Columns of each file, in order."""


SAMPLES = ("sample", "precondition_sample", "reference_sample", "find_sample")
"""Streams of readings: of data, and of presses that are not data."""


def numbers_missing(run: Run) -> bool:
    """Return whether a file is missing."""
    return not all(_file(run, name).exists() for name in COLUMNS)


def write_numbers(run: Run, found: Sequence[PredictedHold], *, again: bool = True) -> None:
    """Write contact regions, pressure and skin in the receptor plane, and receptor measures of every hold.

    Existing files are rewritten only if `again` is set.
    """
    holds = {(row["index"], row["hold"]): row for row in tables(run)["hold_end"].rows}
    rows_of = {"model_contact": _contact, "model_pressure": _pressure, "model_measures": _measures}
    for name, rows in rows_of.items():
        if not again and _file(run, name).exists():
            continue
        written = []
        for response in found:
            hold = holds[response.index, response.hold["hold"]]
            of_a_hold = [hold.get(column) for column in OF_A_HOLD]
            written += [[*of_a_hold, *row] for row in rows(response)]
        replace_table(_file(run, name), COLUMNS[name], written)


def _file(run: Run, name: str) -> Path:
    return run.folder.path / f"{name}.csv"


Rows = Iterable[Sequence[object]]


def _contact(response: PredictedHold) -> Rows:
    result = response.result
    whole = (_digits(result.doi_mm), _digits(result.force_gwt), _digits(result.peak_pressure_kpa))
    return [(*whole, k, _digits(a), _digits(b)) for k, (a, b) in enumerate(result.contact_regions_mm, 1)]


def _pressure(response: PredictedHold) -> Rows:
    (x, kpa), (skin_x, skin_y) = response.result.pressure_profile_kpa, response.result.skin_profile
    return [tuple(map(_digits, row)) for row in zip(x, skin_x, skin_y, kpa, strict=True)]


def _measures(response: PredictedHold) -> Rows:
    receptors = response.result.model.receptors.position_mm[:, 0]
    values = [response.result.receptor_measures[measure] for measure in MEASURES]
    return [tuple(map(_digits, row)) for row in zip(receptors, *values, strict=True)]


def _digits(value: float) -> str:
    return f"{value:.7g}"


Array = NDArray[np.float64]

UNITS = {"doi_mm": "mm", "force_gwt": "gwt"}
_DEPTHS = 60


@dataclass(frozen=True)
class Condition:
    """Presses with the same indentor, x and target of the last hold, and the indices of the repeats.

    Ramps also have the same speed; a press by increments has none.
    """

    indentor: str
    x_mm: float
    target: str  # doi_mm or force_gwt
    value: float
    motion: str
    indices: tuple[int, ...]

    @property
    def group(self) -> str:
        """Label that conditions at other positions share, e.g. "step:1 to 2.33 gwt"."""
        motion = f" {self.motion}" if self.motion else ""
        return f"{self.indentor} to {self.value:g} {UNITS[self.target]}{motion}"

    @property
    def place(self) -> str:
        """Label of the position, e.g. "x = −1.63"."""
        return f"x = {signed(self.x_mm)}"


@dataclass(frozen=True)
class Loading:
    """Force against depth over a condition's repeats: (n,) mm, mean and sd in gwt (NaN for one repeat)."""

    doi_mm: Array
    mean_gwt: Array
    sd_gwt: Array


def conditions(run: Run) -> list[Condition]:
    """Return the conditions of finished indentations, by indentor, target and position."""
    motions = {event["index"]: f"at {event['speed_mm_s']:g} mm/s" for event in run.stream("ramp")}

    def alike(start: dict[str, Any]) -> tuple[str, str, float, str, float]:
        value, x_mm = (round(start[key], SAME_DECIMALS) + 0.0 for key in ("value", "x_mm"))
        return start["indentor"], start["target"], value, motions.get(start["index"], ""), x_mm

    def order(one: tuple[tuple[str, str, float, str, float], object]) -> tuple[object, ...]:
        indentor, target, value, motion, x_mm = one[0]
        return natural_order(indentor), target, value, natural_order(motion), x_mm

    begun = [event for event in run.stream("indentation_start") if event["index"] in run.done]
    return [
        Condition(indentor, x_mm, target, value, motion, tuple(event["index"] for event in same))
        for (indentor, target, value, motion, x_mm), same in sorted(grouped(begun, key=alike).items(), key=order)
    ]


def by_target(found: Sequence[Condition]) -> dict[str, list[Condition]]:
    """Return the conditions that differ only in position, under their shared label."""
    return grouped(found, key=lambda condition: condition.group)


def loading(condition: Condition, run: Run) -> Loading | None:
    """Return the loading over the depths that all repeats reached; None if there are none."""
    curves = [_curve(run.readings_of(index)) for index in condition.indices]
    low, high = max(doi[0] for doi, _ in curves), min(doi[-1] for doi, _ in curves)
    if not low < high:
        return None
    at = np.linspace(low, high, _DEPTHS)
    force = np.stack([np.interp(at, *curve) for curve in curves])
    sd = force.std(axis=0, ddof=1) if len(curves) > 1 else np.full(_DEPTHS, np.nan)
    return Loading(at, force.mean(axis=0), sd)


def _curve(samples: Sequence[Mapping[str, Any]]) -> tuple[Array, Array]:
    """Return (n,) ascending depths and forces; readings at one depth, as in a hold, are averaged."""
    mine = [s for s in past_touch(samples) if s["doi_mm"] is not None]
    doi, back = np.unique([s["doi_mm"] for s in mine], return_inverse=True)
    return doi, np.bincount(back, [s["force_gwt"] for s in mine]) / np.bincount(back)


def past_touch(samples: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the readings of press and hold; of a ramp, without the press that may have come first."""
    down = "ramp" if any(sample["phase"] == "ramp" for sample in samples) else "press"
    return [sample for sample in samples if sample["phase"] in (down, "hold")]


_LIMITS = (
    "hard_trip_n",
    "max_force_gwt",
    "max_doi_mm",
    "max_pressure_kpa",
    "max_press_speed_mm_s",
    "max_contact_s",
)


@dataclass(frozen=True)
class DeliveredPress:
    """Commanded and delivered quantity of a press in its last hold, with the tolerance of the program."""

    index: int
    key: str  # force_gwt or doi_mm
    asked: float
    delivered: float
    sd: float
    tolerance: float

    @property
    def is_within(self) -> bool:
        """Whether the delivered mean lies within the tolerance."""
        return abs(self.delivered - self.asked) <= self.tolerance * (1 + _ROUNDING)

    @property
    def words(self) -> str:
        """Deviation with its sign and unit."""
        return f"{signed(self.delivered - self.asked, 3)} {UNITS[self.key]}"


_ROUNDING = 1e-6


def delivered(run: Run) -> list[DeliveredPress]:
    """Return the finished presses in order; a depth has the tolerance of one step of the stage."""
    settings = toml_of(read_text(run.folder.config))
    step_mm = settings.get("stage", {}).get("resolution_mm", StageSettings.model_fields["resolution_mm"].default)
    step_gwt = settings.get("force", {}).get("resolution_gwt", 0.0)
    found = []
    starts = {event["index"]: event for event in run.stream("indentation_start")}
    for index, holds in sorted(run.done.items()):
        last, key = holds[-1], starts[index]["target"]
        asked = float(last["commanded"] if "commanded" in last else starts[index]["value"])
        tolerance = step_mm if key == "doi_mm" else force_tolerance_gwt(asked, step_gwt)
        sd = last.get({"doi_mm": "doi_sd_mm", "force_gwt": "force_sd_gwt"}[key]) or 0.0
        found.append(DeliveredPress(index, key, asked, float(last[key]), float(sd), tolerance))
    return found


_MOST_LISTED = 4


def message(run: Run, found: Sequence[DeliveredPress]) -> str:
    """Return what was done, and whether it was delivered as asked."""
    where = " on the virtual bench" if run.start.get("virtual") else ""
    if not found:
        return f"No press was finished{where}."
    members = conditions(run)
    shapes = listed(list(dict.fromkeys(one.indentor for one in members)), "indentors")
    places = {one.x_mm for one in members}
    at = f"at x = {signed(places.pop())} mm" if len(places) == 1 else f"at {number_of(len(places), 'positions')}"
    targets = " and ".join(_targets(found, key) for key in UNITS if any(one.key == key for one in found))
    planned = int(run.start["planned_indentations"])
    all_of_them = planned <= len(found) or (run.complete and run.stream("choice"))  # a verdict may end the presses
    done = number_of(len(found), "presses") if all_of_them else f"{len(found)} of {planned} presses"
    return f"{done} of {shapes} to {targets} {at}{where}: {_delivered_in_words(found)}"


def _targets(found: Sequence[DeliveredPress], key: str) -> str:
    values = sorted({round(one.asked, SAME_DECIMALS) for one in found if one.key == key})
    if len(values) > _MOST_LISTED:
        return f"{values[0]:g} to {values[-1]:g} {UNITS[key]}"
    return f"{listed([f'{value:g}' for value in values], 'targets')} {UNITS[key]}"


def listed(names: Sequence[str], noun: str) -> str:
    """Return names as a list in words, or their number if there are many."""
    if len(names) > _MOST_LISTED:
        return number_of(len(names), noun)
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _delivered_in_words(found: Sequence[DeliveredPress]) -> str:
    outside = [one for one in found if not one.is_within]
    rules = {"force_gwt": "0.05 gwt or 1 %", "doi_mm": "one step of the stage"}
    within = " and ".join(rule for key, rule in rules.items() if any(one.key == key for one in found))
    if not outside:
        return f"{'all' if len(found) > 1 else 'it was'} delivered as asked, within {within}."
    worst = max(outside, key=lambda one: abs(one.delivered - one.asked) / (one.tolerance or 1.0))
    return (
        f"{len(found) - len(outside)} of {len(found)} delivered as asked, within {within}; the largest deviation "
        f"is {worst.words}, at press {worst.index}."
    )


@dataclass(frozen=True)
class Phase:
    """Phase of a run: total time (s), its share, time per indentation (s), and what its motions need at least (s)."""

    name: str
    seconds: float
    share: float
    each_s: float
    least_s: float | None


def phases(run: Run) -> list[Phase]:
    """Return the phases that took time."""
    booked, least = booked_s(run), _least_s(run)
    whole, presses = sum(booked.values()) or 1.0, max(len(run.done), 1)
    return [
        Phase(name, s, s / whole, s / presses, least[name] / presses if name in least else None)
        for name, s in booked.items()
        if s
    ]


def shortest_s(way_mm: float, speed_mm_s: float, acceleration_mm_s2: float) -> float:
    """Return the shortest time of a motion from rest to rest (s)."""
    if way_mm < speed_mm_s**2 / acceleration_mm_s2:
        return float(2 * np.sqrt(way_mm / acceleration_mm_s2))
    return way_mm / speed_mm_s + speed_mm_s / acceleration_mm_s2


def _least_s(run: Run) -> dict[str, float]:
    """Return the time that the ways of each phase need at the highest speeds of the configuration (s)."""
    config = toml_of(read_text(run.folder.config))
    habits = HabitSettings.model_validate(config.get("habits", {}))
    fastest_mm_s = LimitSettings.model_validate(limits_in_kpa(config.get("limits", {}))).max_press_speed_mm_s
    acceleration_mm_s2 = config.get("stage", {}).get("acceleration_mm_s2", StageSettings().acceleration_mm_s2)
    speeds_mm_s = {
        "lateral moves": habits.travel_speed_mm_s,
        "approach": fastest_mm_s,
        "touch-off": habits.approach_speed_mm_s,
        "press and seek": habits.press_speed_mm_s,
        "lift": habits.travel_speed_mm_s,
    }
    samples = (one for stream in SAMPLES for one in run.stream(stream))
    found = [one for one in (*samples, *run.stream("retract")) if one.get("height_mm") is not None]
    times_s, places_mm, x_mm = list[float](), list[tuple[float, float]](), 0.0
    for one in sorted(found, key=lambda one: one["t_s"]):
        x_mm = x_mm if one.get("x_mm") is None else one["x_mm"]
        times_s.append(one["t_s"])
        places_mm.append((x_mm, one["height_mm"]))
    least = dict.fromkeys(speeds_mm_s, 0.0)
    for span in spans(run):
        begin, end = bisect_right(times_s, span.begin_s), bisect_right(times_s, span.end_s)
        if span.what not in speeds_mm_s or not begin:
            continue
        way_mm = float(np.ptp(places_mm[begin - 1 : max(begin, end)], axis=0).max())
        least[span.what] += shortest_s(way_mm, speeds_mm_s[span.what], acceleration_mm_s2)
    return least


def why_approach(run: Run) -> str:
    """Return a sentence on the number and duration of polls during the approach; empty without one."""
    samples = (s for s in run.stream("sample") if s["index"] >= 0)
    looks = [
        (after["t_s"] - before["t_s"], before["height_mm"] - after["height_mm"])
        for before, after in pairwise(samples)
        if before["phase"] == after["phase"] == "approach" and before["index"] == after["index"]
    ]
    down = [(s, mm) for s, mm in looks if mm > 0]
    if not down:
        return ""
    seconds, fallen = np.median(down, axis=0)
    presses = len({s["index"] for s in run.stream("sample") if s["index"] >= 0})
    return (
        f"An approach descends by {fallen:.3g} mm, waits for a force reading, and repeats: {seconds:.2f} s "
        f"per step, {len(looks) / presses:.0f} steps per indentation. This keeps an unexpected force small; a "
        "lower clearance and larger steps are faster but allow a larger force."
    )


def limits(run: Run) -> list[tuple[str, str]]:
    """Return the limits of the run and the highest measured values, also of presses that are not data."""
    table = limits_in_kpa(toml_of(read_text(run.folder.config)).get("limits", {}))
    readings = [one for stream in SAMPLES for one in run.stream(stream)]
    highest_gwt, deepest_mm = (
        max((s[name] for s in readings if s.get(name) is not None), default=None) for name in ("force_gwt", "doi_mm")
    )
    rows = []
    if "soft_trip_n" in run.start:
        trip_n = run.start["soft_trip_n"]
        rows.append(("soft trip of this run", f"{trip_n / GWT_N:.2f} gwt ({trip_n:.4f} N)"))
    if highest_gwt is not None:
        rows.append(("highest measured force", f"{highest_gwt:.2f} gwt ({highest_gwt * GWT_N:.4f} N)"))
    if deepest_mm is not None:
        rows.append(("deepest", f"{deepest_mm:.3f} mm"))
    rows += motions_in_contact(run)
    rows.append(("total contact time", f"{run.contact_s:.1f} s"))
    return rows + [(f"limits.{key}", as_number(table[key])) for key in _LIMITS if key in table]


def devices(run: Run, provenance: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the identities that the devices reported."""
    identities = {
        "stage": {event["controller"] for event in run.stream("home")},
        "force": {event["sensor"] for event in run.stream("zero")},
    }
    return [
        (name, ", ".join([kind, *sorted(identities.get(name, ()))])) for name, kind in provenance["devices"].items()
    ]


@dataclass(frozen=True)
class ConditionRow:
    """Means and standard deviations of the last holds over a condition's repeats."""

    group: str
    x_mm: float
    times: int
    force: str
    doi: str
    peak_kpa: float
    regions_mm: list[tuple[float, float]]


def condition_rows(run: Run, found: Sequence[PredictedHold]) -> list[ConditionRow]:
    """Return one row for each condition."""
    last = {response.index: response for response in found if response.last}
    return [_row(condition, [last[index] for index in condition.indices]) for condition in conditions(run)]


def _row(condition: Condition, repeats: list[PredictedHold]) -> ConditionRow:
    force, doi = ([r.hold[key] for r in repeats] for key in ("force_gwt", "doi_mm"))
    peaks = [r.result.peak_pressure_kpa for r in repeats]
    return ConditionRow(
        condition.group,
        condition.x_mm,
        len(repeats),
        _spread(force, 2),
        _spread(doi, 3),
        float(np.mean(peaks)),
        repeats[0].result.contact_regions_mm,
    )


def _spread(values: list[float], decimals: int) -> str:
    """Return the mean as text, with ± the sd if there are repeats."""
    mean = f"{np.mean(values):.{decimals}f}"
    return f"{mean} ± {np.std(values, ddof=1):.{decimals}f}" if len(values) > 1 else mean


def scheduled(run: Run) -> list[str]:
    """Return the columns of a schedule that this run has; empty ones would push others off the page."""
    starts = run.stream("indentation_start")
    return [key for key in ("block", "repeat", "condition") if any(one.get(key) is not None for one in starts)]


def one_by_one(run: Run, found: Sequence[PredictedHold]) -> list[tuple[PredictedHold, dict[str, Any]]]:
    """Return each hold's response and how its indentation began."""
    starts = {event["index"]: event for event in run.stream("indentation_start")}
    return [(response, starts[response.index]) for response in found]
