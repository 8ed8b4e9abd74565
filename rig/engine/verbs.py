"""Verbs of a script besides pressing; each is allowed in some states of the engine only (docs/safety_promises.md)."""

import math
import statistics
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TypeVar

from rig.clock import Clock
from rig.data.events import (
    AlarmEvent,
    CheckpointEvent,
    HomeEvent,
    MountEvent,
    MoveEvent,
    NoteEvent,
    PausedEvent,
    RestEvent,
    ResumedEvent,
    ZeroEvent,
)
from rig.devices.base import LOOK_S
from rig.engine import homing
from rig.engine.bench import EngineMemory
from rig.engine.bench_memory import LastKnown
from rig.engine.engine import Engine, State
from rig.engine.limits import AT_MM, TouchLimit, late_reading_s, refuse_outside
from rig.engine.motion import Outcome
from rig.engine.sensing import NOISE_STEPS, ForceZero, Sensing, zero_readings_gwt
from rig.engine.watch import Watch
from rig.errors import LimitError, NotReadyError, PressPaused, RigError, RunAborted, TripError
from rig.records import NO_PRESS
from rig.settings import ZERO_LIFT_MM
from rig.units import GWT_N

_T = TypeVar("_T")
_E = TypeVar("_E", bound=RigError)

STOP_LOOK_S, REST_LOOK_S = 0.1, 1.0
"""Intervals in a wait at clearance (s): of stop inputs and force; of the stage and of readings in the journal."""

LIFTED_READINGS = 6
"""Number of readings after the lift of a zero; their mean and scatter show whether the force changed."""


def mount(engine: Engine, indentor: str) -> None:
    """Ask the operator to mount an indentor; the rig must be clear of the finger."""
    if engine.contact.may_touch or engine.state is State.TRIPPED:
        raise NotReadyError(
            f"mount: not allowed while {engine.state.value}, because the indentor may touch the finger; lift it "
            "first",
            "may_touch",
        )
    engine.indentor = None
    engine.touched.forget()
    mounted = engine.bench.operator.mount(indentor, LooksAtClearance(engine, engine.clock, handled=True))
    if mounted != indentor:
        raise NotReadyError(
            f"mount: indentor {mounted} is mounted, but {indentor} is required; mount {indentor}", "wrong_indentor"
        )
    engine.indentor = indentor
    engine.record(MountEvent(indentor))


def home(engine: Engine) -> None:
    """Home the stage; from then on the position is trusted."""
    if engine.state is State.TRIPPED:
        raise NotReadyError("home: not allowed after a trip; end this run, and home with the next one", "tripped")
    engine.touched.forget()
    engine.heartbeat.rest()  # Homing lifts first, and lasts longer than the heartbeat allows.
    controller = engine.guarded(engine.bench.stage.connect)
    engine.sensing.connect()
    engine.sensing.moved = True  # The last reading may be old.
    engine.motion.forget_depth()
    homing.home_watched(engine)
    engine.placed = False
    engine.limit_depth(-engine.settings.limits.search_mm - engine.settings.limits.max_doi_mm)
    touched, found = engine.contact.may_touch, engine.measure_contact()
    if engine.sensing.absolute and (passed := engine.trips.passed_any(found.force_gwt or 0.0)):
        engine.trip(TripError(f"{passed}; {engine.not_lifted}", passed.code), found.force_gwt)
    if (touched and found.kind == "disagreement") or (engine.sensing.absolute and found.kind == "raised"):
        left = engine.not_lifted
        engine.trip(TripError(f"homed, and {left}", left.code), found.force_gwt)
    engine.enter_clearance()
    engine.record(HomeEvent(controller, engine.known_contact.kind, engine.known_contact.force_gwt))


def leave_finger(engine: Engine, before: LastKnown, *, resumed: bool) -> None:
    """Home, which lifts first, if `resumed` or the indentor may touch the finger; journal the finding as an alarm.

    `before` is the record of contact and the zero that the previous command left.
    """
    sensing, known = engine.sensing, before.contact
    may_touch = known is not None and known.may_touch
    engine.contact = replace(engine.contact, may_touch=may_touch)
    found = known.words if known is not None and may_touch else None
    try:
        if before.zero is not None:
            sensing.connect()
            # The indentor may have been changed, so an older zero counts only if a touch is on record.
            sensing.zero = replace(before.zero, provisional=not may_touch)
            force_gwt = engine.force_at_rest_gwt()
            if force_gwt is not None and abs(force_gwt) >= sensing.touch_gwt:
                found = f"the sensor reads {force_gwt:.2f} gwt from the last recorded zero"
        if resumed or found is not None:
            home(engine)
    finally:
        sensing.zero = None
    if found is not None:
        engine.record(AlarmEvent(f"before the first motion: {found}; now {engine.known_contact.words}"))


def zero(engine: Engine) -> None:
    """Zero the force sensor in the air, and journal its drift since the last zero.

    A finger that has come up to the indentor looks like a drift. A drift as large as a touch is therefore measured
    again at habits.park_height_mm, where the sensor is then zeroed; a touch ends the descent back to clearance. The
    zero counts only if its readings scatter no more than a sensor may, and if a lift of `ZERO_LIFT_MM` does not
    change the force by a touch; otherwise it trips.
    """
    engine.require_clear("zero")
    sensing, settings = engine.sensing, engine.settings
    drift_gwt = _drift_gwt(engine)
    top_mm = -settings.frame.apex_z_mm
    air_mm = min(settings.habits.park_height_mm, top_mm)
    lifts = drift_gwt is not None and abs(drift_gwt) >= sensing.touch_gwt and engine.height_mm < air_mm - AT_MM
    if lifts:
        engine.lift(air_mm)
        drift_gwt = _drift_gwt(engine)
    name = sensing.connect()
    engine.clock.wait_s(sensing.settle_s)
    zero_sensor(sensing, engine.memory)
    from_mm = engine.height_mm
    if from_mm > top_mm - ZERO_LIFT_MM:  # There must be room for the lift.
        engine.go_to_height(top_mm - ZERO_LIFT_MM, settings.habits.descent_speed_mm_s, touch_ends_it=True)
    found = sensing.take_zero(zero_readings_gwt(lambda: engine.reading(from_zero=False)))
    refused = zero_noise_error(TripError, sensing, found)
    if refused is None:
        engine.lift(max(engine.height_mm + ZERO_LIFT_MM, settings.habits.clearance_mm))
        lifted_gwt = [engine.reading().force_n / GWT_N for _ in range(LIFTED_READINGS)]
        refused = zero_in_contact_error(TripError, sensing, lifted_gwt)
    if refused is not None:
        sensing.zero = None
        engine.trip(refused)
    engine.memory.record_zero(sensing.lasting_zero)
    engine.record_contact(0.0)  # The lift has shown that nothing touched while the zero was taken.
    engine.record(ZeroEvent(name, found.noise_gwt, found.offset_n / GWT_N, drift_gwt))
    band_gwt = engine.settings.limits.zero_drift_gwt
    if drift_gwt is not None and abs(drift_gwt) > band_gwt:
        engine.alarm(
            TripError(
                f"the zero of the force sensor has drifted by {drift_gwt:+.2f} gwt, more than "
                f"limits.zero_drift_gwt = {band_gwt:g} gwt",
                "zero_drift",
            )
        )
    if lifts:
        _go_to_clearance(engine, settings.habits.travel_speed_mm_s)
    else:
        _descend(engine, max(from_mm, settings.habits.clearance_mm))


def zero_sensor(sensing: Sensing, memory: EngineMemory) -> None:
    """Zero a connected sensor; its readings have a new, unknown zero then. Raises ForceError, TransportError."""
    sensing.sensor.zero()
    sensing.zero = None
    memory.record_zero(None)


def zero_noise_error(kind: type[_E], sensing: Sensing, zero: ForceZero) -> _E | None:
    """Return the error for a zero whose readings scatter more than those of a sensor in the air, else None."""
    most_gwt = NOISE_STEPS * sensing.resolution_gwt
    if zero.noise_gwt <= most_gwt:
        return None
    return kind(
        f"the readings of the zero scatter by {zero.noise_gwt:.2f} gwt (standard deviation), more than "
        f"{most_gwt:.2f} gwt, {NOISE_STEPS:g} steps of the sensor: the finger moved, or the cell is too noisy; "
        "keep the finger away and zero again, shield the cell, or set force.resolution_gwt to its real step",
        "zero_scatters",
    )


def zero_in_contact_error(kind: type[_E], sensing: Sensing, lifted_gwt: Sequence[float]) -> _E | None:
    """Return the error for a zero from which a lift has changed the force as a touch does, else None.

    The noise that counts is that of the readings in the air, since a finger may have pressed in those of the zero.
    """
    change_gwt = statistics.fmean(lifted_gwt)
    if abs(change_gwt) < sensing.touch_with_noise_gwt(statistics.pstdev(lifted_gwt)):
        return None
    return kind(
        f"the force changed by {change_gwt:+.2f} gwt when the indentor was lifted by {ZERO_LIFT_MM:g} mm after "
        "the zero; the finger touches it, so keep the finger away and zero again",
        "zero_in_contact",
    )


def _drift_gwt(engine: Engine) -> float | None:
    """Return the mean force at rest from the last zero (gwt), or None without a zero."""
    return statistics.fmean(zero_readings_gwt(engine.reading)) if engine.sensing.zeroed else None


def move_to(engine: Engine, x_mm: float, along_mm: float = 0.0) -> None:
    """Move to a position at clearance: laterally, and along the finger if the stage has that axis."""
    engine.require_clear("move_to")
    refuse_outside(LimitError, "move_to", "x_mm", x_mm, engine.settings.limits.x_mm)
    refuse_outside(LimitError, "move_to", "along_mm", along_mm, engine.settings.limits.along_mm)
    safe_point(engine)
    provisional = not engine.sensing.zeroed
    if provisional:  # Before the first zero, forces count from readings at the present position.
        engine.sensing.take_zero(zero_readings_gwt(lambda: engine.reading(from_zero=False)), provisional=True)
    try:
        go_sideways(engine, x_mm, along_mm)
        _go_to_clearance(engine, engine.settings.habits.travel_speed_mm_s)
    finally:
        if provisional:
            engine.sensing.zero = None
    engine.placed = True
    engine.record(MoveEvent(x_mm, along_mm, engine.height_mm))


def guarded_sideways(engine: Engine) -> tuple[TouchLimit, Watch]:
    """Return the speed of a motion sideways, and what ends it: a touch, and a reading that comes too late."""
    return engine.touch_limit, Watch(touch_ends_it=True, late_s=late_reading_s(engine.settings))


def go_sideways(engine: Engine, x_mm: float, along_mm: float, most_mm_s: float = math.inf) -> None:
    """Move sideways at up to most_mm_s; contact is measured before, and a touch ends the move and trips.

    A late reading interrupts the move. A touch that vanishes at rest (the stage shakes) is passed by a step no
    longer than the way that the finger may be dragged. From the park height on, which no finger should reach, the
    stage has its travel speed until the first touch.
    """
    habits = engine.settings.habits
    limit, watch = guarded_sideways(engine)
    parked = engine.height_mm >= habits.park_height_mm - AT_MM
    speed_mm_s = min(habits.travel_speed_mm_s if parked else limit.speed_mm_s, most_mm_s)
    look_s = min(engine.sensing.sensor.sample_period_s, LOOK_S)
    _refuse_contact_before_move(engine)
    while (
        engine.run_watched(partial(engine.motion.aside, x_mm, along_mm, speed_mm_s, look_s=look_s), watch)
        is not Outcome.ARRIVED
    ):
        _refuse_contact_before_move(engine)
        speed_mm_s = min(limit.speed_mm_s, most_mm_s)
        left_mm = math.hypot(x_mm - engine.x_mm, along_mm - engine.along_mm)
        share = min(limit.in_contact_mm / left_mm, 1.0) if left_mm else 1.0
        next_x_mm = engine.x_mm + share * (x_mm - engine.x_mm)
        next_along_mm = engine.along_mm + share * (along_mm - engine.along_mm)
        engine.run_watched(partial(engine.motion.aside, next_x_mm, next_along_mm, speed_mm_s, look_s=look_s), Watch())
        _refuse_contact_before_move(engine)
        if share == 1.0:
            return


def _refuse_contact_before_move(engine: Engine) -> None:
    """Trip unless the force at rest shows that the indentor is lifted."""
    _refuse_contact_at_rest(engine)
    if engine.sensing.absolute and not engine.is_lifted and engine.measure_contact().may_touch:
        engine.trip(engine.not_lifted)


def be_over(engine: Engine, x_mm: float) -> None:
    """Move to a lateral position, unless already there."""
    if not engine.placed or (engine.x_mm, engine.along_mm) != (x_mm, 0.0):
        move_to(engine, x_mm)


def retract(engine: Engine) -> None:
    """Lift to clearance, straight up."""
    if engine.state not in (State.READY, State.IN_CONTACT):
        raise engine.not_allowed("retract")
    engine.lift()
    engine.confirm_lifted()
    engine.record(engine.after_lift())


def rest(engine: Engine, seconds: float) -> None:
    """Wait at clearance (s), watched as a hold is.

    A pause takes effect at once, and its time counts. A force above the soft trip, the end of the contact time, a
    stop input or a lost device ends the wait.
    """
    engine.require_clear("rest")
    wait_at_clearance(engine, engine.clock.monotonic_s() + seconds)
    engine.record(RestEvent(seconds))


def wait_at_clearance(engine: Engine, until_s: float) -> None:
    """Wait until a time on the clock of the bench (s), watched as a hold is; a pause takes effect at once."""
    clock, look = engine.clock, LooksAtClearance(engine, engine.clock)
    takes_s = 2 * engine.sensing.wait_s + STOP_LOOK_S  # No look begins so shortly before the end.
    while (now_s := clock.monotonic_s()) < until_s:
        clock.wait_until(engine.bench.operator.pause.asked, min(now_s + STOP_LOOK_S, until_s))
        safe_point(engine)
        if until_s - clock.monotonic_s() > takes_s:
            look()


class LooksAtClearance:
    """Checks of stop inputs, force and stage during a wait of any length; each call checks only what is due.

    While a person handles the indentor or the finger, only the participant's button acts, because the force of a hand
    must neither trip nor lift. The next step asks the devices.

    The devices of a virtual bench are asked only by its own clock: they cannot be lost, and by the wall clock their
    time would depend on the speed of the computer.
    """

    def __init__(self, engine: Engine, clock: Clock, *, handled: bool = False) -> None:
        """clock: the clock that times the wait. handled: whether a person handles indentor or finger."""
        self._engine, self._clock, self._handled = engine, clock, handled
        self._inputs_s = clock.monotonic_s()
        asked = not handled and (clock is engine.clock or not engine.bench.virtual)
        self._force_s = self._inputs_s if asked else math.inf
        self._stage_s = self._recorded_s = self._inputs_s + REST_LOOK_S if asked else math.inf

    def __call__(self) -> None:
        """Check what is due.

        Raises TripError for the force, its sensor or a stop input, LimitError for the contact time, StageError or
        TransportError for the stage.
        """
        engine, now_s = self._engine, self._clock.monotonic_s()
        if engine.state is not State.READY:
            return
        if now_s >= self._inputs_s:
            self._inputs_s = now_s + STOP_LOOK_S
            if (problem := engine.stop_inputs(engine, at_rest=True)) and not self._handled:
                engine.trip(problem)
        if now_s >= self._stage_s:
            engine.guarded(engine.bench.stage.status)
            self._stage_s = self._clock.monotonic_s() + REST_LOOK_S
        if now_s >= self._force_s:
            recorded = now_s >= self._recorded_s
            engine.watch_at_clearance(recorded=recorded)
            self._force_s = self._clock.monotonic_s() + STOP_LOOK_S
            if recorded:
                self._recorded_s = self._clock.monotonic_s() + REST_LOOK_S


def checkpoint(engine: Engine, name: str) -> None:
    """Journal a checkpoint of the protocol."""
    engine.record(CheckpointEvent(name))


def note(engine: Engine, text: str) -> None:
    """Journal a note."""
    engine.record(NoteEvent(text))


def safe_point(engine: Engine) -> None:
    """Let an operator's pause (a first Ctrl-C, or the panel's) take effect: lift, journal, continue or RunAborted.

    Raises PressPaused if the lift interrupted an indentation.
    """
    pause = engine.bench.operator.pause
    if not pause.asked():
        return
    pressing = engine.state is State.IN_CONTACT
    if pressing:
        retract(engine)
    engine.touched.forget()  # the operator may move the finger
    engine.record(PausedEvent("operator"))
    if not pause.go_on(LooksAtClearance(engine, engine.clock, handled=True)):
        raise RunAborted("stopped by the operator at a safe point; the indentor is lifted", "stopped_at_a_safe_point")
    engine.record(ResumedEvent("operator"))
    if pressing:
        raise PressPaused("paused by the operator")


def unpaused(press: Callable[[], _T]) -> _T:
    """Press, and repeat the press from clearance each time the operator pauses and resumes."""
    while True:
        with suppress(PressPaused):
            return press()


def _go_to_clearance(engine: Engine, speed_mm_s: float) -> None:
    """Descend slowly to clearance; a touch ends the descent, since frame and calibration may be wrong.

    This keeps a carriage that goes twice as far as commanded, with a sensor half a second late, within the bound of
    docs/safety_design.md. A touch that vanishes at rest (the stage shakes) is passed by one step. Before the
    first zero, forces count from readings before the descent.
    """
    down_mm = engine.settings.habits.clearance_mm
    _descend(engine, down_mm)
    if engine.height_mm != down_mm:
        engine.go_to_height(down_mm, speed_mm_s)
    if engine.sensing.absolute:
        _refuse_contact(engine, engine.read_force_gwt(NO_PRESS, "clearance"))


def _descend(engine: Engine, down_mm: float) -> None:
    habits = engine.settings.habits
    slow_mm_s, step_mm = habits.descent_speed_mm_s, habits.descent_step_mm
    while engine.height_mm > down_mm + AT_MM:
        engine.go_to_height(down_mm, slow_mm_s, touch_ends_it=True)
        _refuse_contact_at_rest(engine)
        if engine.height_mm > down_mm + AT_MM:
            engine.go_to_height(max(engine.height_mm - step_mm, down_mm), slow_mm_s)
            _refuse_contact_at_rest(engine)


def _refuse_contact_at_rest(engine: Engine) -> None:
    _refuse_contact(engine, engine.reading().force_n / GWT_N)


def _refuse_contact(engine: Engine, force_gwt: float) -> None:
    if abs(force_gwt) >= engine.sensing.touch_gwt:
        touched = TripError(
            f"the sensor reads {force_gwt:.2f} gwt at clearance, {engine.height_mm:.2f} mm above the nominal "
            "apex; check whether the finger has come up, frame.apex_z_mm, and the zero of the sensor",
            "touch_at_clearance",
        )
        engine.trip(touched, force_gwt)
