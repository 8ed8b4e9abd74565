"""Verbs of a script besides pressing; each is allowed in some states of the engine only (docs/safety_promises.md)."""

import math
import statistics
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

from rig.clock import Clock
from rig.engine import homing
from rig.engine.bench_memory import LastKnown
from rig.engine.engine import Engine, State
from rig.engine.limits import AT_MM
from rig.engine.sensing import APART_S, zero_readings_gwt
from rig.errors import LimitError, NotReadyError, PressPaused, RunAborted, TripError
from rig.records import NO_PRESS
from rig.units import GWT_N

_T = TypeVar("_T")

STOP_LOOK_S, REST_LOOK_S = 0.1, 1.0
"""Poll intervals of the stop inputs, and of stage and force sensor, during a wait at clearance (s)."""
_LOOK_TAKES_S = 0.25  # No look begins so shortly before the end of a rest.


def mount(engine: Engine, indentor: str) -> None:
    """Ask the operator to mount an indentor; the rig must be clear of the finger."""
    if engine.may_touch or engine.state is State.TRIPPED:
        raise NotReadyError(
            "mount: not allowed while {state}, because the indentor may touch the finger; lift it first",
            code="may_touch",
            state=engine.state.value,
        )
    engine.indentor = None
    engine.touched.forget()
    mounted = engine.bench.operator.mount(indentor, LooksAtClearance(engine, engine.clock, handled=True))
    if mounted != indentor:
        raise NotReadyError(
            "mount: indentor {mounted} is mounted, but {indentor} is required; mount {indentor}",
            code="wrong_indentor",
            mounted=mounted,
            indentor=indentor,
        )
    engine.indentor = indentor
    engine.record("mount", {"indentor": indentor})


def home(engine: Engine) -> None:
    """Home the stage; from then on the position is trusted."""
    if engine.state is State.TRIPPED:
        raise NotReadyError("home: not allowed after a trip; an operator must reset the rig first", code="tripped")
    engine.touched.forget()
    engine.heartbeat.rest()  # Homing lifts first, and lasts longer than the heartbeat allows.
    controller = engine.guarded(engine.bench.stage.connect)
    engine.sensing.connect()
    engine.sensing.moved = True  # The last reading may be old.
    engine.forget_depth()
    homing.home_watched(engine)
    engine.placed = False
    engine.limit_depth(-engine.settings.limits.search_mm - engine.settings.limits.max_doi_mm)
    touched, found = engine.may_touch, engine.measure_contact()
    if engine.sensing.absolute and (passed := engine.trips.passed_any(found.force_gwt or 0.0)):
        fields = {"reason": str(passed), "contact": found.kind, "not_lifted": str(engine.not_lifted)}
        both = TripError("{reason}; {not_lifted}", code=passed.code, **passed.fields, **fields)
        engine.trip(both, found.force_gwt)
    if (touched and found.kind == "disagreement") or (engine.sensing.absolute and found.kind == "raised"):
        left = engine.not_lifted
        homed = TripError(f"{{phase}}, and {left.sentence}", code=left.code, **left.fields, phase="homed")
        engine.trip(homed, found.force_gwt)
    engine.be_clear()
    engine.record("home", {"controller": controller, **_contact(engine)})


def leave_finger(engine: Engine, before: LastKnown, *, resumed: bool) -> None:
    """Home, which lifts first, if the indentor may touch the finger; journal the finding as an alarm.

    Parameters
    ----------
    before : LastKnown
        State that the previous command left: record of contact, and zero of the sensor.
    resumed : bool
        Whether to home in any case.
    """
    sensing, known = engine.sensing, before.contact
    engine.may_touch = known is not None and known.may_touch
    found = known.words if known is not None and known.may_touch else None
    try:
        if before.zero is not None:
            sensing.connect()
            # The indentor may have been changed, so an older zero counts only if a touch is on record.
            sensing.zero = replace(before.zero, provisional=not engine.may_touch)
            force_gwt = engine.force_at_rest_gwt()
            if force_gwt is not None and abs(force_gwt) >= sensing.touch_gwt:
                found = f"the sensor reads {force_gwt:.2f} gwt from the last recorded zero"
        if resumed or found is not None:
            home(engine)
    finally:
        sensing.zero = None
    if found is not None:
        engine.record("alarm", {"reason": f"before the first motion: {found}; now {engine.known_contact.words}"})


def _contact(engine: Engine) -> dict[str, Any]:
    """Return the state of contact for the journal."""
    known = engine.known_contact
    return {"contact": known.kind, "force_gwt": known.force_gwt}


def zero(engine: Engine) -> None:
    """Zero the force sensor in the air, and journal its drift since the last zero.

    A finger that has come up to the indentor looks like a drift. A drift as large as a touch is therefore measured
    again at habits.park_height_mm, where the sensor is then zeroed; a touch ends the descent back to clearance.
    """
    engine.require_clear("zero")
    sensing, settings = engine.sensing, engine.settings
    drift_gwt = _drift_gwt(engine)
    air_mm = min(settings.habits.park_height_mm, -settings.frame.apex_z_mm)
    lifts = drift_gwt is not None and abs(drift_gwt) >= sensing.touch_gwt and engine.height_mm < air_mm - AT_MM
    if lifts:
        engine.lift(air_mm)
        drift_gwt = _drift_gwt(engine)
    name = sensing.connect()
    engine.clock.wait_s(sensing.settle_s)
    sensing.sensor.zero()
    sensing.zero = None  # Readings now have a new zero.
    engine.keep_zero(None)
    found = sensing.take_zero(zero_readings_gwt(engine.raw_reading))
    engine.keep_zero(sensing.lasting_zero)
    known = {"noise_gwt": found.noise_gwt, "offset_gwt": found.offset_n / GWT_N}
    engine.know_contact(0.0)  # The reading just taken is the new zero.
    engine.record("zero", {"sensor": name, **known, "drift_gwt": drift_gwt})
    band_gwt = engine.settings.limits.zero_drift_gwt
    if drift_gwt is not None and abs(drift_gwt) > band_gwt:
        engine.alarm(
            TripError(
                "the zero of the force sensor has drifted by {drift_gwt:+.2f} gwt, more than "
                "limits.zero_drift_gwt = {band_gwt:g} gwt",
                code="zero_drift",
                drift_gwt=drift_gwt,
                band_gwt=band_gwt,
            )
        )
    if lifts:
        _go_to_clearance(engine, settings.habits.travel_speed_mm_s)


def _drift_gwt(engine: Engine) -> float | None:
    """Return the mean force at rest from the last zero (gwt), or None without a zero."""
    return statistics.fmean(zero_readings_gwt(engine.reading)) if engine.sensing.zeroed else None


def move_to(engine: Engine, x_mm: float, along_mm: float = 0.0) -> None:
    """Move to a position at clearance: laterally, and along the finger if the stage has that axis."""
    engine.require_clear("move_to")
    limits = engine.settings.limits
    for name, mm, (low, high) in (("x", x_mm, limits.x_mm), ("along", along_mm, limits.along_mm)):
        if not low <= mm <= high:
            raise LimitError(
                "move_to: {axis} = {at_mm:g} mm is outside limits.{axis}_mm = {low_mm:g} … {high_mm:g} mm",
                code="outside_limits",
                axis=name,
                at_mm=mm,
                low_mm=low,
                high_mm=high,
            )
    safe_point(engine)
    if engine.sensing.zeroed and engine.measured_ago_s > APART_S:  # The finger may have come up to the indentor.
        _refuse_contact_at_rest(engine)
    speed = engine.settings.habits.travel_speed_mm_s
    engine.move(lambda: engine.motion.aside(x_mm, along_mm, speed))
    _go_to_clearance(engine, speed)
    engine.placed = True
    engine.record("move", {"x_mm": x_mm, "along_mm": along_mm, "height_mm": engine.height_mm})


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
    about = {"height_mm": engine.height_mm, "contact_s": engine.contact.rounded_s}
    engine.record("retract", {**about, **_contact(engine)})


def rest(engine: Engine, seconds: float) -> None:
    """Wait at clearance (s).

    A pause takes effect at once, and its time counts. A stop input or a lost device ends the wait.
    """
    engine.require_clear("rest")
    clock, look = engine.clock, LooksAtClearance(engine, engine.clock)
    until_s = clock.monotonic_s() + seconds
    while (now_s := clock.monotonic_s()) < until_s:
        clock.wait_until(engine.bench.operator.pause.asked, min(now_s + STOP_LOOK_S, until_s))
        safe_point(engine)
        if until_s - clock.monotonic_s() > _LOOK_TAKES_S:
            look()
    engine.record("rest", {"rest_s": seconds})


def look_at_devices(engine: Engine) -> None:
    """Ask stage and force sensor in a wait at clearance, so that the loss of one ends the wait.

    Raises TripError for the sensor or a stop input, StageError or TransportError for the stage.
    """
    engine.guarded(engine.bench.stage.status)
    engine.reading()


class LooksAtClearance:
    """Checks of stop inputs and devices during a wait of any length; each call checks only what is due.

    While a person handles the indentor or the finger, only the participant's button acts, because the force of a hand
    must neither trip nor lift. The next step asks the devices.

    The devices of a virtual bench are not asked: they cannot be lost, and by the wall clock their time would depend
    on the speed of the computer.
    """

    def __init__(self, engine: Engine, clock: Clock, *, handled: bool = False) -> None:
        """clock: the clock that times the wait. handled: whether a person handles indentor or finger."""
        self._engine, self._clock, self._handled = engine, clock, handled
        self._inputs_s = clock.monotonic_s()
        asked = not (handled or getattr(engine.bench, "virtual", False))
        self._devices_s = self._inputs_s + REST_LOOK_S if asked else math.inf

    def __call__(self) -> None:
        """Check the inputs and devices that are due. Raises the errors of `look_at_devices`."""
        engine, now_s = self._engine, self._clock.monotonic_s()
        if engine.state is not State.READY:
            return
        if now_s >= self._inputs_s:
            self._inputs_s = now_s + STOP_LOOK_S
            if (problem := engine.stop_problem(at_rest=True)) and not self._handled:
                engine.trip(problem)
        if now_s >= self._devices_s:
            look_at_devices(engine)
            self._devices_s = self._clock.monotonic_s() + REST_LOOK_S


def checkpoint(engine: Engine, name: str) -> None:
    """Journal a checkpoint of the protocol."""
    engine.record("checkpoint", {"name": name})


def note(engine: Engine, text: str) -> None:
    """Journal a note."""
    engine.record("note", {"text": text})


def safe_point(engine: Engine) -> None:
    """Let an operator's pause take effect: lift and journal, then continue or raise RunAborted.

    Raises PressPaused if the lift interrupted an indentation.
    """
    pause = engine.bench.operator.pause
    if not pause.asked():
        return
    pressing = engine.state is State.IN_CONTACT
    if pressing:
        retract(engine)
    engine.touched.forget()  # the operator may move the finger
    engine.record("paused", {"reason": "operator"})
    if not pause.go_on(LooksAtClearance(engine, engine.clock, handled=True)):
        raise RunAborted(
            "stopped by the operator at a safe point; the indentor is lifted", code="stopped_at_a_safe_point"
        )
    engine.record("resumed", {"by": "operator"})
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
    docs/safety_design.md. A touch that vanishes at rest (vibration of the stage) is passed by one step. Before the
    first zero, forces count from readings before the descent.
    """
    habits, sensing = engine.settings.habits, engine.sensing
    down_mm, slow_mm_s, step_mm = habits.clearance_mm, habits.descent_speed_mm_s, habits.descent_step_mm
    provisional = not sensing.zeroed and engine.height_mm > down_mm + AT_MM
    try:
        if provisional:
            sensing.take_zero(zero_readings_gwt(engine.raw_reading), provisional=True)
        while sensing.zeroed and engine.height_mm > down_mm + AT_MM:
            engine.go_to_height(down_mm, slow_mm_s, touch_ends_it=True)
            _refuse_contact_at_rest(engine)
            if engine.height_mm > down_mm + AT_MM:
                engine.go_to_height(max(engine.height_mm - step_mm, down_mm), slow_mm_s)
                _refuse_contact_at_rest(engine)
    finally:
        if provisional:
            sensing.zero = None
    if engine.height_mm != down_mm:
        engine.go_to_height(down_mm, speed_mm_s)
    if sensing.zeroed:
        _refuse_contact(engine, engine.read_force_gwt(NO_PRESS, "clearance"))


def _refuse_contact_at_rest(engine: Engine) -> None:
    _refuse_contact(engine, engine.reading().force_n / GWT_N)


def _refuse_contact(engine: Engine, force_gwt: float) -> None:
    if abs(force_gwt) >= engine.sensing.touch_gwt:
        touched = TripError(
            "the sensor reads {force_gwt:.2f} gwt at clearance, {height_mm:.2f} mm above the nominal apex; "
            "check frame.apex_z_mm and the zero of the sensor",
            code="touch_at_clearance",
            force_gwt=force_gwt,
            height_mm=engine.height_mm,
        )
        engine.trip(touched, force_gwt)
