"""Tables of a run's report: what ran, by condition and one by one; what the time went to; limits and devices."""

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from rig.data import Run
from rig.data.bench_time import booked_s
from rig.plan.responses import Response
from rig.report.labels import as_number
from rig.report.run.conditions import Condition, conditions
from sim.units import GWT_N

_LIMITS = (
    "hard_trip_n",
    "max_force_gwt",
    "max_doi_mm",
    "max_pressure_n_cm2",
    "max_press_speed_mm_s",
    "max_contact_s",
)


@dataclass(frozen=True)
class Phase:
    """What some of the run's time went to: s in all, a share, and s an indentation."""

    name: str
    seconds: float
    share: float
    each_s: float


def phases(run: Run) -> list[Phase]:
    """What the run's time went to; nothing that took none."""
    booked = booked_s(run)
    whole, presses = sum(booked.values()) or 1.0, max(len(run.stream("indentation_end")), 1)
    return [Phase(name, s, s / whole, s / presses) for name, s in booked.items() if s]


def why_approach(run: Run) -> str:
    """How many looks the approach took, and what one took: a sentence, or nothing where nothing was approached."""
    samples = [s for s in run.stream("sample") if s["index"] >= 0]
    looks = [
        (after["t_s"] - before["t_s"], before["height_mm"] - after["height_mm"])
        for before, after in pairwise(samples)
        if before["phase"] == after["phase"] == "approach" and before["index"] == after["index"]
    ]
    down = [(s, mm) for s, mm in looks if mm > 0]
    if not down:
        return ""
    seconds, fallen = np.median(down, axis=0)
    presses = len({s["index"] for s in samples})
    return (
        f"An approach goes down by {fallen:.3g} mm, waits until the force sensor has read, and goes on: "
        f"{seconds:.2f} s a step, {len(looks) / presses:.0f} steps an indentation. That keeps small a force that "
        "nobody expects; a lower clearance and larger steps would save time at its price."
    )


def limits(run: Run) -> list[tuple[str, str]]:
    """The limits that the run went by beside what came nearest to them."""
    table: dict[str, Any] = tomllib.loads(run.folder.config.read_text(encoding="utf-8")).get("limits", {})
    forces = [s["force_gwt"] for s in run.stream("sample") if s["force_gwt"] is not None]
    depths = [s["doi_mm"] for s in run.stream("sample") if s["doi_mm"] is not None]
    rows = []
    if "soft_trip_n" in run.start:
        trip_n = run.start["soft_trip_n"]
        rows.append(("soft trip of this run", f"{trip_n / GWT_N:.2f} gwt ({trip_n:.4f} N)"))
    if forces:
        rows.append(("highest force read", f"{max(forces):.2f} gwt ({max(forces) * GWT_N:.4f} N)"))
    if depths:
        rows.append(("deepest", f"{max(depths):.3f} mm"))
    rows.append(("touched for, in all", f"{run.contact_s:.1f} s"))
    return rows + [(f"limits.{key}", as_number(table[key])) for key in _LIMITS if key in table]


def devices(run: Run, provenance: dict[str, Any]) -> list[tuple[str, str]]:
    """What the devices called themselves."""
    said = {
        "stage": {event["controller"] for event in run.stream("home")},
        "force": {event["sensor"] for event in run.stream("zero")},
    }
    return [(name, ", ".join([kind, *sorted(said.get(name, ()))])) for name, kind in provenance["devices"].items()]


@dataclass(frozen=True)
class ConditionRow:
    """Means and standard deviations over a condition's repeats, of their last holds."""

    group: str
    x_mm: float
    times: int
    force: str
    doi: str
    peak_pseudo: float
    regions_mm: list[tuple[float, float]]


def condition_rows(run: Run, found: Sequence[Response]) -> list[ConditionRow]:
    """One for each condition."""
    last = {response.index: response for response in found if response.last}
    return [_row(condition, [last[index] for index in condition.indices]) for condition in conditions(run)]


def _row(condition: Condition, repeats: list[Response]) -> ConditionRow:
    force, doi = ([r.hold[key] for r in repeats] for key in ("force_gwt", "doi_mm"))
    peaks = [r.result.peak_pressure_pseudo for r in repeats]
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
    """The mean, with ± the sd of repeats."""
    mean = f"{np.mean(values):.{decimals}f}"
    return f"{mean} ± {np.std(values, ddof=1):.{decimals}f}" if len(values) > 1 else mean


def one_by_one(run: Run, found: Sequence[Response]) -> list[tuple[Response, dict[str, Any]]]:
    """Every hold's answer beside how its indentation began."""
    starts = {event["index"]: event for event in run.stream("indentation_start")}
    return [(response, starts[response.index]) for response in found]
