"""One row for each press of a run: what was asked and what was delivered, when and where."""

import math
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Annotated, Any

from rig.data.events import (
    Across,
    Along,
    AskedHold,
    AskedSpeed,
    Block,
    Condition,
    ContactHeight,
    DepthSd,
    ForceSd,
    HoldDuration,
    Increments,
    Indentor,
    MeanForce,
    PeakForce,
    PredictedDepth,
    PredictedForce,
    Readings,
    Repeat,
    TargetDepth,
    TargetForce,
    Verb,
    is_last_hold,
)
from rig.data.run import Event, Run


@dataclass(frozen=True, kw_only=True)
class PressRecord:
    """A press of the data: what was asked, and what its last hold delivered; nothing was if it was interrupted."""

    t_s: Annotated[float, "time of the run at which the press began"]
    index: Annotated[int, "number of the press, from 0, in the order of the protocol"]
    block: Block | None
    repeat: Repeat | None
    condition: Condition | None
    indentor: Indentor | None
    x_mm: Across
    along_mm: Along | None
    verb: Verb | None
    target_doi_mm: TargetDepth | None
    target_force_gwt: TargetForce | None
    increments: Increments
    speed_mm_s: AskedSpeed | None
    asked_s: AskedHold | None
    predicted_doi_mm: PredictedDepth | None
    predicted_force_gwt: PredictedForce | None
    complete: Annotated[bool, "whether the last hold ended; a press that did not is repeated in a row of its own"]
    contact_height_mm: ContactHeight | None = None
    hold_start_s: Annotated[float, "time of the run at which the last hold began"] | None = None
    hold_end_s: Annotated[float, "time of the run at which the last hold ended"] | None = None
    end_s: Annotated[float, "time of the run at which the indentor was back at clearance"] | None = None
    doi_mm: Annotated[float, "depth past the fitted contact that was delivered in the last hold"] | None = None
    doi_sd_mm: DepthSd | None = None
    force_gwt: MeanForce | None = None
    force_sd_gwt: ForceSd | None = None
    peak_gwt: PeakForce | None = None
    readings: Readings | None = None
    hold_s: HoldDuration | None = None


def presses(run: Run) -> list[PressRecord]:
    """Return the presses of a run that are data, in order of time."""
    starts = sorted(_all(run, "indentation_start"), key=_time)
    moves = sorted(_all(run, "move"), key=_time)
    moved_s, within = [move["t_s"] for move in moves], _by_press(run)
    rows, begun_again_s = [], dict[int, float]()
    for start in reversed(starts):
        index, begun_s = start["index"], start["t_s"]
        until_s, begun_again_s[index] = begun_again_s.get(index, math.inf), begun_s
        last = {stream: event for stream, event in within[index] if begun_s <= event["t_s"] < until_s}
        moved = bisect_right(moved_s, begun_s)
        rows.append(_press(start, moves[moved - 1].get("along_mm") if moved else None, last))
    return rows[::-1]


def presses_table(run: Run) -> list[dict[str, Any]]:
    """Return the rows by column."""
    return [asdict(row) for row in presses(run)]


def _press(start: Event, along_mm: float | None, last: Mapping[str, Event]) -> PressRecord:
    """Return the row of a press from its start and the last event of each stream."""
    target, hold = {start["target"]: start["value"]}, last.get("hold_end", {})
    complete = is_last_hold(hold, start)
    asked: dict[str, Any] = {name: start.get(name) for name in _ASKED}
    delivered: dict[str, Any] = {name: hold.get(name) for name in _DELIVERED if complete}
    return PressRecord(
        **asked,
        along_mm=along_mm,
        target_doi_mm=target.get("doi_mm"),
        target_force_gwt=target.get("force_gwt"),
        asked_s=start.get("hold_s"),
        complete=complete,
        contact_height_mm=last.get("touch", {}).get("contact_height_mm"),
        hold_start_s=last["hold_start"]["t_s"] if complete and "hold_start" in last else None,
        hold_end_s=hold["t_s"] if complete else None,
        end_s=last["indentation_end"]["t_s"] if "indentation_end" in last else None,
        **delivered,
    )


_ASKED = (
    *("t_s", "index", "block", "repeat", "condition", "indentor", "x_mm", "verb", "increments", "speed_mm_s"),
    *("predicted_doi_mm", "predicted_force_gwt"),
)
_DELIVERED = ("doi_mm", "doi_sd_mm", "force_gwt", "force_sd_gwt", "peak_gwt", "readings", "hold_s")
_WITHIN = ("touch", "hold_start", "hold_end", "indentation_end")


def _by_press(run: Run) -> Mapping[int, list[tuple[str, Event]]]:
    """Return the events of presses by index, in order of time."""
    found = defaultdict[int, list[tuple[str, Event]]](list)
    for stream, event in sorted(((s, e) for s in _WITHIN for e in _all(run, s)), key=lambda one: _time(one[1])):
        found[event["index"]].append((stream, event))
    return found


def _all(run: Run, stream: str) -> Sequence[Event]:
    return [*run.superseded.get(stream, []), *run.stream(stream)]


def _time(event: Event) -> float:
    return float(event["t_s"])
