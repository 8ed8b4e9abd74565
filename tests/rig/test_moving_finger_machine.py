"""A finger that moves is a rule of the tests: state machines over the stub bench and over the virtual benches.

Each rule is a step of a person, a script, the finger or bad luck; after each one the truth is judged. A failure that
was found is kept in tests/rig/test_moving_finger.py as its steps. `make shake` draws more (tests/shake.py): FINGERS=n
examples of each machine, from the seed FINGER_SEED.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from itertools import groupby, pairwise
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from rig.devices.base import Axis
from rig.devices.registry import ramps
from rig.engine import Pause, RecordError, Target, TripError, verbs
from rig.engine.engine import Engine, State
from rig.engine.indentation import indent, ramp
from rig.engine.reference import compare_reference
from rig.errors import NotReadyError, RigError
from rig.records import PressId
from rig.session.script_run import AT_ONCE, ENDINGS, stopped_at_once
from rig.transport.wire import TransportError
from tests.moving_finger import (
    FACT_S,
    OVERSHOOT_GWT,
    STAGES,
    STOP_MM,
    TRIP_GWT,
    FingerBench,
    FingerOnBytes,
    FingerOnStub,
    Truth,
)

SLOW_MADE_GWT = 8.0
"""By how much the program may pass the trip before its first reading above it, at the usual travel speed, and in
proportion to a faster one (gwt): half the trip.
"""
USUAL_TRAVEL_MM_S = 5.0
NOISIEST_GWT = 0.2
READINGS_OF_A_ZERO = 12
CONTACT_S = 60.0
COMPLETED_S = 10.0
"""How long a controller takes at most for what a killed program told it (s)."""
LOOK_S = 5.0
"""How long the last look of the contact time and the lift after it take (s)."""


def tenths(low: float, high: float) -> st.SearchStrategy[float]:
    """Draw a number with one decimal place; a simple one is a small one."""
    return st.integers(round(low * 10), round(high * 10)).map(lambda n: n / 10)


WHEN_S = tenths(0.0, 6.0)
SPEEDS_MM_S = st.sampled_from([5.0, 1.0, 2.0, 20.0, 50.0])
MOVEMENTS = st.one_of(
    st.fixed_dictionaries({"by_mm": st.one_of(tenths(0.2, 4.0), tenths(-4.0, -0.2)), "speed_mm_s": SPEEDS_MM_S}),
    st.fixed_dictionaries({"by_mm": tenths(0.2, 4.0), "speed_mm_s": SPEEDS_MM_S, "stays_s": tenths(0.0, 3.0)}),
    st.fixed_dictionaries({"by_mm": tenths(0.2, 2.0), "speed_mm_s": SPEEDS_MM_S, "cycles": st.integers(1, 10)}),
)
"""The finger rises or leaves, pulses, or shakes."""
MEANWHILE = st.one_of(st.none(), st.tuples(tenths(0.0, 1.0), MOVEMENTS))
"""What the finger does during a verb, after this share of its usual time."""
HABITS: dict[str, dict[str, Any]] = {
    "usual": {},
    "fast": {
        "approach_speed_mm_s": 2.0,
        "press_speed_mm_s": 2.0,
        "retouch_margin_mm": 0.05,
        "travel_speed_mm_s": 9.0,
    },
    "park": {"park_height_mm": 4.0, "clearance_mm": 1.5},
}
SENSORS: dict[str, dict[str, Any]] = {
    "usual": {},
    "quick": {"force": {"sample_period_s": 0.02}},
    "late": {"force": {"latency_s": 0.1}, "virtual": {"cell_latency_s": 0.1}},
    "noisy": {"virtual": {"cell_noise_gwt": 0.01}},
}

HABIT, SENSOR, K_GWT = st.sampled_from(list(HABITS)), st.sampled_from(list(SENSORS)), st.sampled_from([13.0, 4.0])
BY_HAND_MM = st.sampled_from([sign * mm for mm in (0.5, 5.0, 1.0, 0.1, 0.05) for sign in (1, -1)])

Movements = dict[str, Any]
Meanwhile = tuple[float, Movements] | None


class BrokenPromiseError(AssertionError):
    """What a program must not do."""


class Killed(BaseException):
    """The program is gone, without a chance to stop or to record anything."""


class FingerMachine(RuleBasedStateMachine):
    """Steps over one bench. Each ends with a judgement of what really happened in it."""

    bench: FingerBench

    def __init__(self) -> None:
        super().__init__()
        self.over = True  # whether the run has ended: by its end, an error, a trip or a stop
        self._blind = False  # whether the sensor shows what is not there
        self._judged = self._heard = 0  # samples and what was said, so far

    def begins(self, bench: FingerBench, k_gwt: float) -> None:
        """Over a finger that keeps still so far."""
        self.bench = bench
        bench.finger.k_gwt = k_gwt
        bench.ready()
        self.over = False

    # --- the finger ---

    @rule(after_s=WHEN_S, movement=MOVEMENTS)
    def finger_moves(self, after_s: float, movement: Movements) -> None:
        """It rises or leaves, pulses, or shakes."""
        self.bench.finger.moves(self._in_s(after_s), **movement)

    @rule(speed_mm_s=SPEEDS_MM_S)
    def finger_lies_down(self, speed_mm_s: float) -> None:
        """Back to where it was at first."""
        rise_mm = self.bench.finger.rise_mm(self.bench.clock.monotonic_s())
        if abs(rise_mm) > 1e-6:
            self.bench.finger.moves(self._in_s(0.0), -rise_mm, speed_mm_s)

    @precondition(lambda self: self.bench.witness.now().height_mm > self.bench.finger.highest_mm)
    @rule(x_mm=tenths(0.5, 4.0), higher_mm=tenths(0.5, 4.0), slope=st.sampled_from([1.0, 0.5, 0.2]))
    def second_finger(self, x_mm: float, higher_mm: float, slope: float) -> None:
        """It comes beside the first while the indentor is far above both."""
        self.bench.finger.stands_beside(x_mm, higher_mm, higher_mm / slope)

    # --- a script ---

    @precondition(lambda self: not self.over)
    @rule(finger=MEANWHILE)
    def home(self, finger: Meanwhile) -> None:
        self._meanwhile(finger, 6.0)
        self._do(verbs.home)

    @precondition(lambda self: not self.over)
    @rule(finger=MEANWHILE)
    def zero(self, finger: Meanwhile) -> None:
        self._meanwhile(finger, 2.5)
        if self._do(verbs.zero):
            self._judge_zero()

    @precondition(lambda self: not self.over)
    @rule(x_mm=tenths(-4.0, 6.0), finger=MEANWHILE)
    def move_to(self, x_mm: float, finger: Meanwhile) -> None:
        self._meanwhile(finger, abs(x_mm - self.bench.witness.now().x_mm) / 5.0 + 0.2)
        self._do(lambda engine: verbs.move_to(engine, x_mm))

    @precondition(lambda self: not self.over)
    @rule(force_gwt=tenths(0.5, 7.0), hold_s=tenths(0.0, 5.0), finger=MEANWHILE)
    def indent_to_force(self, force_gwt: float, hold_s: float, finger: Meanwhile) -> None:
        self._meanwhile(finger, 60.0)
        self._do(lambda engine: indent(engine, Target("force_gwt", force_gwt), hold_s=hold_s))

    @precondition(lambda self: not self.over)
    @rule(
        doi_mm=tenths(0.1, 0.8),
        increments=st.integers(1, 3),
        rest_s=st.sampled_from([0.0, 3.0, 30.0]),
        finger=MEANWHILE,
    )
    def indent_to_depth(self, doi_mm: float, increments: int, rest_s: float, finger: Meanwhile) -> None:
        self._meanwhile(finger, 60.0)
        self._do(lambda engine: indent(engine, Target("doi_mm", doi_mm), increments=increments, rest_s=rest_s))

    @precondition(lambda self: not self.over and ramps(self.bench.config.stage))
    @rule(
        doi_mm=tenths(0.1, 0.5),
        speed_mm_s=tenths(0.5, 3.0),
        times=st.integers(1, 4),
        rest_s=st.sampled_from([0.0, 3.0, 30.0]),
        finger=MEANWHILE,
    )
    def ramp(self, doi_mm: float, speed_mm_s: float, times: int, rest_s: float, finger: Meanwhile) -> None:
        """From the third one on nothing touches the finger before."""
        self._meanwhile(finger, 60.0 + 10.0 * times)

        def press(engine: Engine) -> None:
            for _ in range(times):
                ramp(engine, doi_mm, speed_mm_s, rest_s=rest_s)

        self._do(press)

    @precondition(lambda self: not self.over)
    @rule(x_mm=tenths(-2.0, 2.0), doi_mm=tenths(0.1, 0.5), presses=st.integers(1, 3), finger=MEANWHILE)
    def precondition_skin(self, x_mm: float, doi_mm: float, presses: int, finger: Meanwhile) -> None:
        self._meanwhile(finger, 30.0 * presses)

        def press(engine: Engine) -> None:
            for n in range(presses):
                verbs.be_over(engine, x_mm)
                indent(engine, Target("doi_mm", doi_mm), hold_s=0.2, press_id=PressId(n, "precondition"))

        self._do(press)

    @precondition(lambda self: not self.over)
    @rule(x_mm=st.sampled_from([0.0, -1.0]), finger=MEANWHILE)
    def reference(self, x_mm: float, finger: Meanwhile) -> None:
        """Its alarm trips only if limits.on_alarm says so; a finger that moved meanwhile raises it."""
        self._meanwhile(finger, 60.0)

        def press(engine: Engine) -> None:
            verbs.be_over(engine, x_mm)
            found = indent(engine, Target("doi_mm", 0.3), increments=2, hold_s=0.2, press_id=PressId(0, "reference"))
            compare_reference(engine, found)

        self._do(press)

    @precondition(lambda self: not self.over)
    @rule()
    def retract(self) -> None:
        self._do(verbs.retract)

    @precondition(lambda self: not self.over)
    @rule(seconds=tenths(0.5, 8.0), finger=MEANWHILE)
    def rest(self, seconds: float, finger: Meanwhile) -> None:
        self._meanwhile(finger, seconds)
        begun, before_s = len(self.bench.witness.samples), self.bench.engine.contact_time.total_s
        self._do(lambda engine: verbs.rest(engine, seconds))
        self._judge_rest(begun, before_s)

    @precondition(lambda self: not self.over)
    @rule(after_s=WHEN_S, for_s=tenths(0.5, 5.0), goes_on=st.booleans())
    def pause(self, after_s: float, for_s: float, goes_on: bool) -> None:
        """Ctrl-C or SIGTERM, in the next steps; answered after a time."""
        bench, at_s = self.bench, self._in_s(after_s)

        def go_on(meanwhile: Callable[[], object]) -> bool:
            bench.pause, self._paused = Pause(), True
            until_s = bench.clock.monotonic_s() + for_s
            while bench.clock.monotonic_s() < until_s:
                meanwhile()
                bench.clock.wait_s(0.1)
            return goes_on

        bench.pause = Pause(lambda: bench.clock.monotonic_s() >= at_s, go_on)

    @rule(after_s=WHEN_S, how=st.sampled_from(["second Ctrl-C", "rig stop"]))
    def stop(self, after_s: float, how: str) -> None:
        """It comes anywhere, in the next steps."""

        def stop() -> None:
            if not self._running:
                return
            self._struck = True
            if how != "rig stop":
                raise KeyboardInterrupt
            self._stopped = True
            with self.bench.stopped_as_by_rig_stop():
                self.bench.stage.stop()

        self.bench.clock.call_at(self._in_s(after_s), stop)

    _running = _paused = False  # whether a verb runs; whether it was paused
    _struck = _stopped = False  # whether it was stopped, which leaves the indentor where it is; by `rig stop`
    _killed = False  # whether nobody drives the stage, which completes what it was told
    _cut = False  # whether its cable is cut, so that it completes its motion

    @precondition(lambda self: not self.over)
    @rule()
    def ends(self) -> None:
        """The script is done."""
        self._end()

    @precondition(lambda self: self.over)
    @rule()
    def resume(self) -> None:
        """A new part of the run, after what failed was put right."""
        self._judge_anew()
        self.over = self._blind = False
        self.bench.resume()
        if self._do(lambda engine: verbs.leave_finger(engine, self.bench.before, resumed=True)):
            self._do(lambda engine: self.bench.ready())

    def _judge_anew(self) -> None:
        """Judge only from now on, if the program before was killed or cut off, or its sensor showed a false force."""
        if self._killed or self._cut or self._blind:
            self._killed, self._cut, self._judged = False, False, len(self.bench.witness.samples)

    # --- nothing, and questions ---

    @rule(seconds=tenths(0.5, 8.0))
    def idle(self, seconds: float) -> None:
        """The script computes, or nobody does anything."""
        self.bench.clock.wait_s(seconds)
        self._judge()

    @precondition(lambda self: not self._killed)
    @rule()
    def ask(self) -> None:
        self.bench.ask()
        self._judge()

    # --- bad luck ---

    @rule(how=st.sampled_from(["dead", "overload", "frozen", "drifts", None]), drifts_gwt_s=tenths(-2.0, 2.0))
    def sensor_fails(self, how: str | None, drifts_gwt_s: float) -> None:
        self.bench.force.drifts_gwt_s = drifts_gwt_s
        self.bench.force.fail(how)
        self._blind = self._blind or how in ("frozen", "drifts")

    @rule(by_s=st.sampled_from([3600.0, -3600.0, 5.0, -0.5]))
    def wall_clock_jumps(self, by_s: float) -> None:
        self.bench.clock.jumped_s += by_s

    @rule(for_s=tenths(1.0, 20.0), by_mm=tenths(0.0, 4.0))
    def computer_sleeps(self, for_s: float, by_mm: float) -> None:
        """Meanwhile the finger may come up."""
        self.bench.clock.slept_s += for_s
        if by_mm:
            self.bench.finger.moves(self._in_s(0.0), by_mm, 1e4)

    @precondition(lambda self: not self.over)
    @rule(after=st.integers(0, 30))
    def journal_fails(self, after: int) -> None:
        """Each event fails, beginning with one of the next."""
        left = iter(range(after))

        def fail(stream: str) -> None:
            if next(left, None) is None:
                raise RecordError("no space left")

        self.bench.at_event = fail

    # --- carried out, and judged ---

    def _in_s(self, seconds: float) -> float:
        return self.bench.clock.monotonic_s() + seconds

    def _meanwhile(self, finger: Meanwhile, lasts_s: float) -> None:
        """Let the finger do something in the next verb."""
        if finger is not None:
            share, movement = finger
            self.bench.finger.moves(self._in_s(share * lasts_s), **movement)

    def _do(self, verb: Callable[[Engine], object]) -> bool:
        """Carry out a verb of a script and judge it; return whether it ended normally."""
        engine = self.bench.engine
        self._running, self._struck, self._stopped, self._paused = True, False, False, False
        problem: BaseException | None = None
        try:
            with stopped_at_once(engine, lambda: self._stopped, lambda: AT_ONCE):
                verb(engine)
        except (KeyboardInterrupt, *ENDINGS) as error:
            problem = error
        except Killed:
            self.over, self._killed, self._running = True, True, False  # Nothing strikes a program that has ended.
            self.bench.clock.wait_s(COMPLETED_S)
            self.bench.pause, self.bench.at_event = Pause(), lambda stream: None
            return False
        finally:
            self._running = False
        self._judge()
        if problem is None:
            return True
        self._judge_end(problem)
        if engine.state is not State.READY or not isinstance(problem, RigError) or engine.problem is not None:
            self._end()
        return False

    def _end(self) -> None:
        """Let the run end, as a session does."""
        self.over = True
        self.bench.pause, self.bench.at_event = Pause(), lambda stream: None
        if self.bench.engine.contact.may_touch:
            self.bench.memory.touched(self.bench.engine.known_contact)
        self.bench.close()
        self.bench.ask()
        self._judge()

    def _judge(self) -> None:
        """Judge everything since the last time the finger was free."""
        bench, witness = self.bench, self.bench.witness
        engine = bench.engine
        if not (self._blind or self._killed):
            far_mm, force_gwt = witness.dragged(bench.least_gwt, self._judged)
            judge(far_mm <= STOP_MM or self._cut, f"dragged by {far_mm:.2f} mm at up to {force_gwt:.1f} gwt")
            made_gwt = witness.made_gwt(TRIP_GWT, bench.read_s, self._judged)
            judge(made_gwt <= OVERSHOOT_GWT, f"{made_gwt:.2f} gwt more, after a reading above the trip")
            made_gwt = witness.made_gwt(TRIP_GWT, 0.0, self._judged)
            faster = max(bench.config.habits.travel_speed_mm_s / USUAL_TRAVEL_MM_S, 1.0)
            judge(made_gwt <= SLOW_MADE_GWT * faster, f"{made_gwt:.2f} gwt more above the trip than the finger alone")
            for said in witness.lies(self._heard):
                judge(False, f"{said.by}: {said.words}, at {said.force_gwt:.1f} gwt for {said.touched_s:.1f} s")
        contact_s, most_s = engine.contact_time.total_s, bench.config.limits.max_contact_s
        running = not self.over and engine.state is State.READY
        judge(not running or contact_s <= most_s + LOOK_S, f"touched for {contact_s:.1f} s")
        self._heard = len(witness.said)
        free = (n for n in range(len(witness.samples) - 1, self._judged, -1) if self._is_free(witness.samples[n]))
        self._judged = next(free, self._judged)

    def _is_free(self, sample: Truth) -> bool:
        return sample.force_gwt < self.bench.least_gwt

    def _judge_rest(self, begun: int, before_s: float) -> None:
        """In a rest a force above the trip ends it with a lift, and contact counts; in a pause a hand may touch.

        begun: number of the first sample. before_s: contact time before.
        """
        bench, engine = self.bench, self.bench.engine
        gone = self._killed or self._cut or self._struck
        if gone or self._paused or self._blind or bench.force.fails or not engine.sensing.absolute:
            return
        late_s = FACT_S + bench.read_s
        for spell in bench.witness.spells(TRIP_GWT + bench.least_gwt, begun):
            low = [one for one in spell if one.height_mm <= spell[0].height_mm + 0.1]
            stood_s = low[-1].t_s - low[0].t_s
            judge(stood_s <= late_s, f"rested for {stood_s:.1f} s above the trip")
        touched_s = [spell[-1].t_s - spell[0].t_s for spell in bench.witness.spells(2 * bench.least_gwt, begun)]
        least_s, counted_s = sum(max(s - late_s, 0.0) for s in touched_s), engine.contact_time.total_s - before_s
        judge(counted_s >= least_s, f"counted {counted_s:.1f} s of contact, not {least_s:.1f} s")

    def _judge_zero(self) -> None:
        """A zero was taken in the air."""
        bench, engine = self.bench, self.bench.engine
        if self._blind or bench.force.fails or not engine.sensing.zeroed:
            return
        noise_gwt = engine.sensing.noise_gwt
        judge(noise_gwt <= NOISIEST_GWT, f"noise of {noise_gwt:.2f} gwt")
        read_s = bench.force.read_s[:READINGS_OF_A_ZERO]
        unread_s = max(after_s - before_s for before_s, after_s in pairwise([bench.force.zeroed_s, *read_s]))
        samples = [one for one in bench.witness.samples if bench.force.zeroed_s <= one.t_s <= read_s[-1]]
        there = [one for one in samples if abs(one.height_mm - samples[0].height_mm) < 1e-3]
        # Readings may miss a shorter touch; one that they do not miss is noise.
        pressed = 0.0
        for touched, spell in groupby(there, key=lambda one: one.force_gwt > 0.0):
            touch = list(spell)
            if touched and touch[-1].t_s - touch[0].t_s >= unread_s:
                pressed += sum(before.force_gwt * (after.t_s - before.t_s) for before, after in pairwise(touch))
        mean_gwt = pressed / (there[-1].t_s - there[0].t_s) if len(there) > 1 else 0.0
        judge(mean_gwt < bench.least_gwt, f"a zero at {mean_gwt:.2f} gwt")

    def _judge_end(self, problem: BaseException) -> None:
        """A trip is left only by homing in a new run, is named by every ending, and lifts until nothing touches."""
        bench, engine = self.bench, self.bench.engine
        trip = engine.problem if isinstance(engine.problem, TripError) else None
        if trip is None:
            return
        judge(engine.state is State.TRIPPED, f"a trip left the engine {engine.state.value}")
        with suppress(NotReadyError):
            verbs.home(engine)
            judge(False, "homed after a trip")
        judge(trip.code in str(getattr(problem, "code", "")) or str(trip) in str(problem), f"{problem}, not {trip}")
        now, park_mm = bench.witness.now(), bench.config.habits.park_height_mm
        healthy = not (self._blind or bench.force.fails) and isinstance(problem, TripError) and bench.stage.homed
        touched_s = bench.witness.touched_s(bench.least_gwt)
        judge(
            not (healthy and touched_s > FACT_S and now.height_mm < park_mm - 0.05),
            f"left at {now.height_mm:.2f} mm with {now.force_gwt:.1f} gwt for {touched_s:.1f} s: {trip}",
        )


def judge(right: bool, words: str) -> None:
    """Fail with these words unless something is right."""
    if not right:
        raise BrokenPromiseError(words)


class StubMachine(FingerMachine):
    """Over the stub bench, whose stage may fail in more ways."""

    bench: FingerOnStub

    @initialize(habits=HABIT, sensor=SENSOR, k_gwt=K_GWT)
    def begins_on_stub(self, habits: str, sensor: str, k_gwt: float) -> None:
        tables = {"habits": HABITS[habits], "limits": {"max_contact_s": CONTACT_S}, **SENSORS[sensor]}
        self.begins(FingerOnStub(tables), k_gwt)

    @rule(after_s=WHEN_S, how=st.sampled_from(["stalls", "strays", "resets", "lost"]))
    def stage_fails(self, after_s: float, how: str) -> None:
        def fail() -> None:
            if self._running:
                self.bench.stub.fails = how

        self.bench.clock.call_at(self._in_s(after_s), fail)


class BytesMachine(FingerMachine):
    """Over the virtual benches, where a person moves by hand between two runs."""

    bench: FingerOnBytes

    @initialize(kind=st.sampled_from(STAGES), habits=HABIT, sensor=SENSOR, k_gwt=K_GWT)
    def begins_on_bytes(self, kind: str, habits: str, sensor: str, k_gwt: float) -> None:
        tables = {"habits": HABITS[habits], "limits": {"max_contact_s": CONTACT_S}, **SENSORS[sensor]}
        self.begins(FingerOnBytes(kind, tables), k_gwt)

    @rule(after_s=WHEN_S)
    def cable_is_cut(self, after_s: float) -> None:
        def cut() -> None:
            if self._running:
                self.bench.cable.cut = self._cut = True

        self.bench.clock.call_at(self._in_s(after_s), cut)

    @rule(after_s=WHEN_S)
    def kill(self, after_s: float) -> None:
        """As `kill -9`: no byte goes out any more, and the controller completes what it was told."""

        def kill() -> None:
            if self._running:
                self.bench.cable.cut = True
                raise Killed

        self.bench.clock.call_at(self._in_s(after_s), kill)

    @precondition(lambda self: self.over)
    @rule(
        by_mm=tenths(-5.0, 5.0).filter(bool),
        speed_mm_s=st.sampled_from([10.0, 2.0, 1.0]),
        axis=st.sampled_from(["x", "z"]),
        finger=MEANWHILE,
    )
    def jog(self, by_mm: float, speed_mm_s: float, axis: Axis, finger: Meanwhile) -> None:
        self._meanwhile(finger, abs(by_mm) / speed_mm_s + 1.0)
        self._by_hand(lambda: self.bench.jog(axis, by_mm, speed_mm_s))

    @precondition(lambda self: self.over)
    @rule(axis=st.sampled_from(["x", "z"]), by_mm=BY_HAND_MM, finger=MEANWHILE)
    def click(self, axis: Axis, by_mm: float, finger: Meanwhile) -> None:
        """A button of the panel."""
        self._meanwhile(finger, 2.0)
        self._by_hand(lambda: self.bench.click(axis, by_mm))

    @precondition(lambda self: self.over)
    @rule(finger=MEANWHILE)
    def rig_zero(self, finger: Meanwhile) -> None:
        self._meanwhile(finger, 2.5)
        if self._by_hand(self.bench.zero_by_hand):
            self._judge_zero()

    @precondition(lambda self: self.over)
    @rule(finger=MEANWHILE)
    def rig_home(self, finger: Meanwhile) -> None:
        self._meanwhile(finger, 6.0)
        self._by_hand(self.bench.home_by_hand)

    def _by_hand(self, deed: Callable[[], object]) -> bool:
        """Carry out a command by hand and judge it; return whether it ended normally."""
        self._judge_anew()
        self.bench.plug_in()
        try:
            deed()
        except (RigError, TransportError):
            return False
        finally:
            self._judge()
        return True


def replay(machine: FingerMachine, *steps: tuple[str, dict[str, Any]]) -> None:
    """Carry out these steps of a machine again, as it printed them."""
    for name, arguments in steps:
        getattr(machine, name)(**arguments)


EXAMPLES, SEED = int(os.environ.get("FINGERS", "0")), int(os.environ.get("FINGER_SEED", "0"))


def few(examples: int, steps: int, stages: int = 1) -> settings:
    """Return settings for `make test`, or for many examples on each of so many stages."""
    return settings(
        max_examples=EXAMPLES * stages or examples,
        stateful_step_count=steps,
        deadline=None,
        derandomize=not EXAMPLES,
        database=None,
        print_blob=False,
        report_multiple_bugs=False,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
    )


TestStubMachine = StubMachine.TestCase
TestStubMachine.settings = few(20, 12)
TestBytesMachine = BytesMachine.TestCase
TestBytesMachine.settings = few(12, 10, len(STAGES))
if EXAMPLES:
    TestStubMachine, TestBytesMachine = seed(SEED)(TestStubMachine), seed(SEED)(TestBytesMachine)

pytestmark = pytest.mark.timeout(0 if EXAMPLES else 600)
