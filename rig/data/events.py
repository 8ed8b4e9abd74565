"""Events of a journal: one class an event, with what its columns mean; tables, files and pages derive from it.

The unit of a column follows from its name, its type in a file from its annotation. Positions are in the frame of the
finger.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_type_hints

from rig.units import unit_of_key

Index = Annotated[
    int, "number of the press among those of its kind, from 0, in the order of the protocol; −1 outside a press"
]
HoldNumber = Annotated[int, "number of the hold in its indentation, from 1"]
Indentor = Annotated[str, "shape of the indentor, e.g. bar:3.0"]
Across = Annotated[float, "lateral position of the indentor's reference point, from the center of the pad"]
Along = Annotated[float, "position along the finger, from the receptor plane"]
Height = Annotated[float, "height of the indentor's lowest point above the nominal apex of the finger"]
Depth = Annotated[
    float, "depth past the fitted contact, corrected for the rig's compliance; empty before contact is found"
]
Force = Annotated[float, "force on the finger, positive when pressing"]
TargetKind = Annotated[str, "commanded quantity and its unit: doi_mm (depth past contact) or force_gwt"]
TargetValue = Annotated[float, "commanded value, in the unit of target"]
HoldTarget = Annotated[float, "commanded value of this hold, in the unit of target"]
ContactHeight = Annotated[float, "height of first contact above the nominal apex, from the fit"]
ContactTime = Annotated[float, "total contact time in the run so far"]
ContactState = Annotated[
    str, "state of contact: lifted (measured), raised (by position only), disagreement, touching or unknown"
]
Block = Annotated[int, "number of the block in the schedule, from 1; empty outside a schedule"]
Repeat = Annotated[int, "repetition of the condition in its block, from 1; empty outside a schedule"]
Condition = Annotated[str, "item of the schedule, as text"]
Verb = Annotated[str, "verb of the press: indent or ramp"]
Increments = Annotated[int, "number of holds, at equal parts of the target"]
AskedSpeed = Annotated[float, "speed that the protocol asked for, of the press or the ramp"]
AskedHold = Annotated[float, "duration of each hold that the protocol asked for"]
AskedRest = Annotated[float, "shortest time from the last lift-off to the touch that the protocol asked for"]
PredictedDepth = Annotated[float, "depth in the last hold that the finger model predicts"]
PredictedForce = Annotated[float, "force in the last hold that the finger model predicts"]
DepthSd = Annotated[float, "standard deviation of doi_mm, from the step of the stage and the compliance"]
MeanForce = Annotated[float, "mean force over the readings of the hold"]
ForceSd = Annotated[float, "standard deviation of the readings of the hold"]
PeakForce = Annotated[float, "highest force since the previous hold, or since contact"]
Readings = Annotated[int, "number of readings in the hold"]
HoldDuration = Annotated[float, "actual duration of the hold"]
TargetDepth = Annotated[
    float, "commanded depth past contact, for a hold its own part; empty if a force was commanded"
]
TargetForce = Annotated[float, "commanded force, for a hold its own part; empty if a depth was commanded"]
Reason = Annotated[str, "reason, as text"]


class Event:
    """An event. Its docstring describes its table; a column with a default is absent while it is None."""

    def data(self) -> dict[str, Any]:
        """Return the values by column."""
        event: type = type(self)
        values = ((column, getattr(self, column.name)) for column in columns_of(event))
        return {one.name: value for one, value in values if not (value is None and one.is_optional)}


class PressEvent(Event):
    """An event of a press. Columns that begin with `true_` come from the virtual plant and are absent on hardware."""


# --- events of a press ---
# Nothing compares or prints events; without these methods, a program starts sooner.


@dataclass(frozen=True, eq=False, repr=False)
class IndentationStartEvent(PressEvent):
    """An indentation begins."""

    index: Index
    indentor: Indentor | None
    x_mm: Across
    verb: Verb
    target: TargetKind
    value: TargetValue
    increments: Increments
    speed_mm_s: AskedSpeed
    hold_s: AskedHold
    rest_s: AskedRest | None = None
    predicted_doi_mm: PredictedDepth | None = None
    predicted_force_gwt: PredictedForce | None = None
    block: Block | None = None
    repeat: Repeat | None = None
    condition: Condition | None = None


@dataclass(frozen=True, eq=False, repr=False)
class SampleEvent(PressEvent):
    """A reading of the force, with the position of the indentor."""

    index: Index
    phase: Annotated[str, "activity: clearance, moving, approach, back off, touch, press, ramp, hold or compliance"]
    x_mm: Across | None
    height_mm: Height | None
    doi_mm: Depth | None
    force_gwt: Force
    stable: Annotated[bool, "whether the sensor reported the reading as stable"]
    contact_s: ContactTime
    of_the_sensor: Mapping[str, float] = field(default_factory=dict)

    def data(self) -> dict[str, Any]:
        """Return the values by column, with those that the sensor adds."""
        return {**super().data(), **self.of_the_sensor}


@dataclass(frozen=True, eq=False, repr=False)
class TouchEvent(PressEvent):
    """Contact was found: F ∝ d^1.5 through the readings of the touch-off."""

    index: Index
    threshold_gwt: Annotated[float, "force that counts as contact"]
    height_at_threshold_mm: Annotated[float, "height at which the force first exceeded the threshold"]
    contact_height_mm: ContactHeight
    fit_points: Annotated[int, "number of readings in the fit; 0: contact of the press before"]
    doi_bias_mm: Annotated[float, "depth already reached when the force exceeded the threshold, from the fit"]
    doi_mm: Depth
    rested_s: Annotated[float, "time from the last lift-off to this touch"] | None = None
    true_doi_bias_mm: Annotated[float, "virtual bench only: true depth at the touch minus doi_mm"] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class RampEvent(PressEvent):
    """A ramp begins, with its force limits."""

    index: Index
    speed_mm_s: Annotated[float, "speed of the ramp"]
    measured_gwt: Annotated[float, "force at the depth of the ramp, by the last press by increments there"]
    trip_gwt: Annotated[float, "force that trips the ramp"]
    bound_gwt: Annotated[
        float, "force that it does not exceed: the trip of a press and the overshoot of an increment"
    ]
    stop_mm: Annotated[float, "stopping distance, with the delays of sensor, reading and controller"]


@dataclass(frozen=True, eq=False, repr=False)
class HoldStartEvent(PressEvent):
    """The target, or an equal part of it, is reached and the hold begins."""

    index: Index
    hold: HoldNumber
    target: TargetKind
    commanded: HoldTarget
    doi_mm: Depth
    force_gwt: Force


@dataclass(frozen=True, eq=False, repr=False)
class HoldEndEvent(PressEvent):
    """A hold ended, with the depth and force that were delivered."""

    index: Index
    hold: HoldNumber
    x_mm: Across
    doi_mm: Depth
    doi_sd_mm: DepthSd
    force_gwt: MeanForce
    force_sd_gwt: ForceSd
    commanded: HoldTarget
    peak_gwt: PeakForce
    ramp_gwt: Annotated[float, "change of force during the ramp to the hold"]
    ramp_s: Annotated[float, "duration of the ramp to the hold"]
    readings: Readings
    asked_s: Annotated[float, "commanded duration of the hold"]
    hold_s: HoldDuration
    interval_sd_s: Annotated[float, "standard deviation of the time between readings of the hold"]
    true_x_mm: Annotated[float, "virtual bench only: true lateral position of the indentor"] | None = None
    true_doi_mm: Annotated[float, "virtual bench only: true depth past contact"] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class SyncEvent(PressEvent):
    """A pulse for the recording amplifier."""

    index: Index
    at: Annotated[str, "event that the pulse marks: touch, ramp, hold_start or hold_end"]
    rise_s: Annotated[float, "time since the start of the run when the device had confirmed the rise"]
    uncertainty_s: Annotated[float, "uncertainty of the rise: it may have been earlier by as much"]
    width_s: Annotated[float, "duration of the pulse"]


@dataclass(frozen=True, eq=False, repr=False)
class IndentationEndEvent(PressEvent):
    """The indentor is back at clearance."""

    index: Index
    duration_s: Annotated[float, "duration from the start of the indentation until clearance"]


# --- other events ---


@dataclass(frozen=True, eq=False, repr=False)
class MountEvent(Event):
    """An indentor was mounted."""

    indentor: Indentor


@dataclass(frozen=True, eq=False, repr=False)
class HomeEvent(Event):
    """The home switches were found."""

    controller: Annotated[str, "identification reported by the stage's controller"]
    contact: ContactState
    force_gwt: Force | None


@dataclass(frozen=True, eq=False, repr=False)
class ZeroEvent(Event):
    """The force sensor was zeroed in the air."""

    sensor: Annotated[str, "identification reported by the force sensor"]
    noise_gwt: Annotated[float, "standard deviation of readings in the air"]
    offset_gwt: Annotated[float, "zero: reading in the air that is subtracted from every reading"]
    drift_gwt: (
        Annotated[float, "drift of the previous zero: mean force in the air just before; empty at the first zeroing"]
        | None
    )


@dataclass(frozen=True, eq=False, repr=False)
class MoveEvent(Event):
    """The indentor moved to a position, at clearance."""

    x_mm: Across
    along_mm: Along
    height_mm: Height


@dataclass(frozen=True, eq=False, repr=False)
class FindEvent(Event):
    """Contact was found by touch() alone."""

    index: Index
    indentor: Indentor | None
    x_mm: Across
    along_mm: Along
    contact_height_mm: ContactHeight


@dataclass(frozen=True, eq=False, repr=False)
class RetractEvent(Event):
    """The indentor was lifted to clearance."""

    height_mm: Height | None
    contact_s: ContactTime
    contact: ContactState
    force_gwt: Force | None


@dataclass(frozen=True, eq=False, repr=False)
class ReferenceEvent(Event):
    """A reference press was compared with the first one."""

    index: Index
    deviation: Annotated[float, "largest deviation from the first reference press, relative to its force"]


@dataclass(frozen=True, eq=False, repr=False)
class RestEvent(Event):
    """A pause without contact ended."""

    rest_s: Annotated[float, "duration of the pause"]


@dataclass(frozen=True, eq=False, repr=False)
class CountSourceEvent(Event):
    """The source of the counts that choose presses was opened."""

    source: Annotated[str, "what the script named: a file, a stream, a virtual nerve, or a function"]
    presses: Annotated[int, "number of presses that may be chosen"]
    truth: Annotated[str, "parameters of a virtual nerve with its candidate, as JSON; empty if recorded"] | None


@dataclass(frozen=True, eq=False, repr=False)
class ChoiceEvent(Event):
    """The next press was chosen from the counts so far, or the presses ended."""

    index: Annotated[int, "number of the indentation that was chosen, from 0"]
    indentor: Indentor | None
    x_mm: Across | None
    target: TargetKind | None
    value: TargetValue | None
    reason: Annotated[str, "why this press, or why there is none (docs/adaptive_runs.md)"]
    count: Annotated[int, "spikes in the hold of the indentation before; empty if no count arrived"] | None
    probabilities: Annotated[str, "probability of each candidate after that count, as JSON"]
    information_bits: (
        Annotated[float, "information (bits) that the press is expected to give about which candidate is true"] | None
    )
    possible: (
        Annotated[int, "number of the press among those that the run may choose from, from 0; empty at the end"]
        | None
    )
    chosen_in_s: Annotated[float, "time between the arrival of the count and the choice"]


@dataclass(frozen=True, eq=False, repr=False)
class CheckpointEvent(Event):
    """The protocol passed a checkpoint."""

    name: Annotated[str, "name of the checkpoint"]


@dataclass(frozen=True, eq=False, repr=False)
class NoteEvent(Event):
    """The protocol wrote a note."""

    text: Annotated[str, "text of the note"]


@dataclass(frozen=True, eq=False, repr=False)
class AlarmEvent(Event):
    """An alarm was raised; the run continued unless limits.on_alarm is trip."""

    reason: Reason


@dataclass(frozen=True, eq=False, repr=False)
class TripEvent(Event):
    """The rig tripped."""

    reason: Reason
    force_gwt: Force | None
    contact_s: ContactTime


@dataclass(frozen=True, eq=False, repr=False)
class PausedEvent(Event):
    """The operator paused the run."""

    reason: Reason


@dataclass(frozen=True, eq=False, repr=False)
class ResumedEvent(Event):
    """The operator resumed the run."""

    by: Annotated[str, "who resumed the run"]


@dataclass(frozen=True, eq=False, repr=False)
class OfTheSensor:
    """Columns that a force sensor may add to its readings (`ForceReading.also`); its registry entry names them."""

    fx_n: Annotated[float, "force along the sensor's x axis, not zeroed"]
    fy_n: Annotated[float, "force along the sensor's y axis, not zeroed"]
    fz_n: Annotated[float, "force along the sensor's z axis, not zeroed"]
    tx_nm: Annotated[float, "torque about the sensor's x axis, not zeroed"]
    ty_nm: Annotated[float, "torque about the sensor's y axis, not zeroed"]
    tz_nm: Annotated[float, "torque about the sensor's z axis, not zeroed"]
    packets_lost: Annotated[int, "packets of the sensor that have not arrived since its stream was started"]
    packets_repeated: Annotated[int, "packets of the sensor without a new sample since its stream was started"]
    packets_late: Annotated[int, "packets of the sensor that arrived after a newer one since its stream was started"]


@dataclass(frozen=True, eq=False, repr=False)
class OfThePress:
    """Last columns of every table of a press."""

    indentor: Indentor
    target_doi_mm: TargetDepth
    target_force_gwt: TargetForce
    block: Block
    repeat: Repeat
    condition: Condition


# --- what follows from the classes ---


class Column(NamedTuple):
    """A column of a table."""

    name: str
    unit: str
    type: type
    what: str
    is_optional: bool = False

    @property
    def dtype(self) -> Literal["bool", "text (UTF-8)", "float64"]:
        """Type in data.h5, where a missing number is NaN and a missing text empty."""
        return "text (UTF-8)" if self.type is str else "bool" if self.type is bool else "float64"


TIME = Column("t_s", "s", float, "time of the event since the start of the run")
"""First column of every table of events."""


def is_last_hold(end: Mapping[str, Any], start: Mapping[str, Any]) -> bool:
    """Return whether a hold that has ended finishes the press that began with `start`."""
    return end.get("hold") is not None and end["hold"] == start.get("increments")


@cache
def columns_of(table: type) -> tuple[Column, ...]:
    """Return the columns of a class of events, or of another table."""
    hints = get_type_hints(table, include_extras=True)
    found = []
    for one in fields(table):
        annotated = next(
            (hint for hint in (hints[one.name], *get_args(hints[one.name])) if hasattr(hint, "__metadata__")), None
        )
        if annotated is not None:
            kind, what = get_args(annotated)[:2]
            found.append(Column(one.name, unit_of_key(one.name), kind, what, one.default is None))
    return tuple(found)


def stream_of(event: type[Event]) -> str:
    """Return the name of the stream of a class of events: `hold_end` of HoldEndEvent."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "_", event.__name__.removesuffix("Event")).lower()


def description_of(table: type) -> str:
    """Return what a table contains, without a capital and a full stop."""
    words = (table.__doc__ or "").rstrip(".")
    return words[:1].lower() + words[1:]


PRESS_EVENTS: tuple[type[Event], ...] = tuple(PressEvent.__subclasses__())
EVENTS = (*PRESS_EVENTS, *(event for event in Event.__subclasses__() if event is not PressEvent))

READING = "sample"
"""Ending of the names of the streams of readings."""

INSTANTS = ("rise_s",)
"""Columns whose values are times of the run, like `t_s`; any other time is a duration."""

WAITED_FOR = ("mount", "resumed")
"""Events that end a wait for a person, which does not count as run time."""


def units_of(table: type) -> dict[str, str]:
    """Return the columns of a table with their units."""
    return {column.name: column.unit for column in columns_of(table)}


PRESS_STREAMS = {stream_of(event): units_of(event) for event in PRESS_EVENTS}
"""Streams of one press, with their columns and units."""

OF_THE_PRESS = units_of(OfThePress)
OF_A_SENSOR = units_of(OfTheSensor)

_NOT_DATA = {name: units for name, units in PRESS_STREAMS.items() if name != "ramp"}

STREAMS = {
    **{stream_of(event): units_of(event) for event in EVENTS},
    **{f"precondition_{name}": units for name, units in _NOT_DATA.items()},
    **{f"reference_{name}": units for name, units in _NOT_DATA.items()},
    **{f"find_{name}": PRESS_STREAMS[name] for name in ("sample", "touch")},
}
"""All streams. Presses that are not data (`precondition_…`, `reference_…`) have separate streams."""


def streams_with(also: Iterable[str]) -> Mapping[str, Mapping[str, str]]:
    """Return all streams, with these columns of a force sensor in samples."""
    more = {name: OF_A_SENSOR[name] for name in also}
    return {name: {**units, **more} if name.endswith(READING) else units for name, units in STREAMS.items()}
