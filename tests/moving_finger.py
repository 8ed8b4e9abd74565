"""A finger that moves, the truth about it, and the benches over it: a stub, and the virtual ones of all stages.

What a program may do is judged by the truth, sampled every few milliseconds of the virtual clock, and never by what
its sensor reports.
"""

import io
import math
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any

from rig.bench.checks import contact_as_json
from rig.bench.virtual import bench_around
from rig.devices.base import (
    LOOK_S,
    Axis,
    ForceOverload,
    ForceReading,
    ForceSensor,
    ForceTimeout,
    Stage,
    StageError,
    StageNotHomed,
    StageReset,
    StageStatus,
    StageTimeout,
)
from rig.devices.registry import BUILT_IN
from rig.engine import Engine, Pause, verbs
from rig.engine.bench import Meanwhile
from rig.engine.bench_memory import BenchMemory, state_folder
from rig.engine.contact import KnownContact
from rig.engine.motion import Direction
from rig.engine.sensing import ForceZero
from rig.engine.steps import StepEnd
from rig.errors import EngineError
from rig.manual.owner_process import ManualOwner
from rig.manual.session import ManualSession
from rig.plan.config import Config
from rig.session.early_ending import FinalPosition
from rig.transport.stop_gate import StopGate
from rig.transport.wire import Transport, TransportError
from rig.units import GWT_N
from sim.carriage import Carriage, TruePose
from sim.devices.clock import VirtualClock
from tests.stub_bench import StubSensor, StubStage

TRIP_GWT = 16.0
STOP_MM = 0.6
"""How far a stage may go sideways in contact: the way to the threshold, speed × age of a reading, stop distance."""
OVERSHOOT_GWT = 1.5
"""By how much the program itself may pass the trip after a reading above it (gwt)."""
FACT_S = 1.0
"""How long a measurement at rest is a fact (s)."""
STAGES = BUILT_IN["stage"]
_TRUTH_S, _FREE_S, _STILL_S = 0.004, 0.05, 0.02
"""Time between two samples of the truth (s): in contact; at most, far above; in contact while nothing moves."""
_FASTEST_MM_S = 60.0  # of finger and stage towards each other


# --- the finger ---


@dataclass(frozen=True)
class Movement:
    """The skin rises by so much (mm; sinks if negative) at a speed, stays, and goes back; a shake is a sine."""

    at_s: float
    by_mm: float
    speed_mm_s: float
    stays_s: float = math.inf
    cycles: int = 0  # of a shake, whose highest speed is speed_mm_s

    @property
    def lasts_s(self) -> float:
        """Return the time of the rise, or of the whole shake (s)."""
        if self.cycles:
            return self.cycles * 2 * math.pi * abs(self.by_mm) / self.speed_mm_s
        return abs(self.by_mm) / self.speed_mm_s

    def rise_mm(self, t_s: float) -> float:
        """Return by how much the skin is higher at a time (mm)."""
        after_s = t_s - self.at_s
        if after_s <= 0:
            return 0.0
        if self.cycles:
            return self.by_mm * math.sin(self.speed_mm_s * after_s / self.by_mm) if after_s < self.lasts_s else 0.0
        if after_s <= self.lasts_s + self.stays_s:
            return self.by_mm * min(after_s / self.lasts_s, 1.0)
        return self.by_mm * max(1.0 - (after_s - self.lasts_s - self.stays_s) / self.lasts_s, 0.0)


class MovingFinger:
    """A finger F = k d^1.5 below its skin, whose height above the nominal apex is a function of time.

    Beside it, beyond a place in x, stands another one or the fold of a nail: a higher skin behind a steep flank.
    """

    lowest_mm, highest_mm = -4.0, 4.5

    def __init__(self, k_gwt: float = 13.0) -> None:
        self.k_gwt = k_gwt
        self.movements: list[Movement] = []
        self.beside_x_mm, self.beside_mm, self.flank_mm = math.inf, 0.0, 0.5

    def moves(self, at_s: float, by_mm: float, speed_mm_s: float = 10.0, **more: Any) -> None:
        """From a time on: rise or sink, and perhaps come back (stays_s), or shake (cycles)."""
        self.movements.append(Movement(at_s, by_mm, speed_mm_s, **more))

    def stands_beside(self, x_mm: float, by_mm: float, flank_mm: float) -> None:
        """Put a second finger beside it, so much higher."""
        self.beside_x_mm, self.beside_mm, self.flank_mm = x_mm, by_mm, flank_mm

    def rise_mm(self, t_s: float) -> float:
        """Return the height of the first finger above the nominal apex (mm)."""
        return sum(movement.rise_mm(t_s) for movement in self.movements)

    def skin_mm(self, x_mm: float, t_s: float) -> float:
        """Return the height of the skin above the nominal apex (mm)."""
        flank = min(max((x_mm - self.beside_x_mm) / self.flank_mm, 0.0), 1.0)
        return min(max(self.rise_mm(t_s) + self.beside_mm * flank, self.lowest_mm), self.highest_mm)

    def force_gwt(self, x_mm: float, height_mm: float, t_s: float) -> float:
        """Return the true force on the finger (gwt)."""
        return self.k_gwt * max(self.skin_mm(x_mm, t_s) - height_mm, 0.0) ** 1.5


# --- the truth ---


@dataclass(frozen=True, slots=True)
class Truth:
    """Where the stage was and what it pressed, at one instant."""

    t_s: float
    x_mm: float
    height_mm: float
    force_gwt: float


@dataclass(frozen=True)
class Said:
    """What was said of contact, and for how long the finger had then been touched (s)."""

    by: str
    words: str
    lifted: bool
    touched_s: float
    force_gwt: float


class Witness:
    """Everything that really happened, sampled by timers of the clock."""

    def __init__(
        self, clock: VirtualClock, finger: MovingFinger, place_mm: Callable[[float], tuple[float, float]]
    ) -> None:
        """place_mm: x and height of the indentor over the finger at a time, mm."""
        self.clock, self.finger, self._place_mm = clock, finger, place_mm
        self.samples: list[Truth] = []
        self.said: list[Said] = []
        self._sample()

    def now(self) -> Truth:
        """Return the truth of this instant."""
        return self.at(self.clock.monotonic_s())

    def at(self, t_s: float) -> Truth:
        """Return the truth of an instant."""
        x_mm, height_mm = self._place_mm(t_s)
        return Truth(t_s, x_mm, height_mm, self.finger.force_gwt(x_mm, height_mm, t_s))

    def _sample(self) -> None:
        now, before = self.now(), self.samples[-1] if self.samples else None
        self.samples.append(now)
        next_s = _TRUTH_S
        if now.force_gwt == 0.0:
            gap_mm = now.height_mm - self.finger.skin_mm(now.x_mm, now.t_s)
            next_s = min(max(gap_mm / _FASTEST_MM_S, _TRUTH_S), _FREE_S)
        elif before is not None and before.force_gwt == now.force_gwt and before.x_mm == now.x_mm:
            next_s = _STILL_S
        self.clock.call_at(now.t_s + next_s, self._sample)

    def touched_s(self, least_gwt: float) -> float:
        """Return for how long the finger has been touched without a break (s)."""
        now = self.now()
        since_s = now.t_s
        for sample in chain([now], reversed(self.samples)):
            if sample.force_gwt < least_gwt:
                break
            since_s = sample.t_s
        return now.t_s - since_s

    def hears(self, by: str, words: str, *, lifted: bool, least_gwt: float) -> None:
        """Note what is said of contact."""
        self.said.append(Said(by, words, lifted, self.touched_s(least_gwt), self.now().force_gwt))

    def lies(self, since: int = 0) -> list[Said]:
        """Return where it was said that the indentor is lifted, of a finger touched for longer than a fact is old."""
        return [said for said in self.said[since:] if said.lifted and said.touched_s > FACT_S]

    def worst_gwt(self, since: int = 0) -> float:
        """Return the highest force (gwt), since a number of samples."""
        return max((sample.force_gwt for sample in self.samples[since:]), default=0.0)

    def spells(self, least_gwt: float, since: int = 0) -> Iterator[list[Truth]]:
        """Yield the times in which the force was at least so high, since a number of samples."""
        spell: list[Truth] = []
        for sample in self.samples[since:]:
            if sample.force_gwt >= least_gwt:
                spell.append(sample)
            elif spell:
                yield spell
                spell = []
        if spell:
            yield spell

    def dragged(self, least_gwt: float, since: int = 0) -> tuple[float, float]:
        """Return the longest way sideways in one contact (mm), and the highest force on it (gwt).

        Only the stage counts: a finger that moves along below it is not dragged by it.
        """
        worst = (0.0, 0.0)
        for spell in self.spells(least_gwt, since):
            moved = [(before, after) for before, after in pairwise(spell) if after.x_mm != before.x_mm]
            far_mm = sum(abs(after.x_mm - before.x_mm) for before, after in moved)
            worst = max(worst, (far_mm, max((after.force_gwt for _, after in moved), default=0.0)))
        return worst

    def made_gwt(self, trip_gwt: float, read_s: float, since: int = 0) -> float:
        """Return by how much the program passed the trip, beyond what the finger would have done to a halted stage.

        In the replay the stage halts where it was at the first reading above the trip, read_s after the force.
        """
        made_gwt = 0.0
        for spell in self.spells(trip_gwt, since):
            halted = next((one for one in spell if one.t_s >= spell[0].t_s + read_s), spell[-1])
            worst_gwt = alone_gwt = 0.0
            for one in spell:
                worst_gwt = max(worst_gwt, one.force_gwt)
                halted_gwt = self.finger.force_gwt(halted.x_mm, halted.height_mm, one.t_s)
                alone_gwt = max(alone_gwt, one.force_gwt if one.t_s <= halted.t_s else halted_gwt)
            made_gwt = max(made_gwt, worst_gwt - alone_gwt)
        return made_gwt


# --- devices over it ---


class JumpingClock(VirtualClock):
    """A virtual clock whose wall time may jump, and whose computer may have been suspended."""

    jumped_s = slept_s = 0.0

    def unix_s(self) -> float:
        return super().unix_s() + self.jumped_s

    def suspended_s(self) -> float:
        return self.slept_s


class TrueStage(StubStage):
    """A stub stage that is at every instant where it really is, homes up first, and may fail.

    fails: `stalls` and reports it late, `strays` sideways, `resets` (loses its position), or is `lost`.
    """

    def __init__(self, clock: VirtualClock) -> None:
        super().__init__(clock)
        self.fails: str | None = None
        self._stopped, self._look_s = False, LOOK_S
        self._way: tuple[list[float], list[float], float, float] | None = None  # from, to (mm), begun, duration (s)

    def place_mm(self, t_s: float) -> list[float]:
        """Return where it really is at a time, which may lie just ahead or behind."""
        if self._way is None:
            return self.at_mm
        from_mm, to_mm, begun_s, lasts_s = self._way
        share = min(max((t_s - begun_s) / lasts_s, 0.0), 1.0)
        return [was + share * (to - was) for was, to in zip(from_mm, to_mm, strict=True)]

    def connect(self) -> str:
        self.fails = None
        return super().connect()

    def homing(self) -> Iterator[StageStatus | None]:
        self.told.append("home")
        self._stopped, self._look_s = False, LOOK_S
        x_mm, y_mm, _ = self.at_mm
        for to_mm in ([x_mm, y_mm, self.switches_mm[2]], list(self.switches_mm)):
            yield from self._going(to_mm, max(abs(to - at) for to, at in zip(to_mm, self.at_mm, strict=True)) / 20.0)
        self.homed = True

    def moving(self, **motion: Any) -> Iterator[StageStatus | None]:
        self._refuse()
        if not self.homed:
            raise StageNotHomed("the stub stage")
        self._look_s = motion.get("look_s", LOOK_S)
        yield from super().moving(**motion)

    def jog(self, axis: str, mm: float, speed_mm_s: float) -> None:
        to_mm = list(self.at_mm)
        to_mm["xyz".index(axis)] += mm
        self.told.append(("jog", axis, mm))
        for _ in self._going(to_mm, abs(mm) / speed_mm_s):
            pass

    def status(self) -> StageStatus:
        self._refuse()
        return super().status()

    def stop(self) -> None:
        super().stop()
        self._stopped = True
        if self.fails == "strays":
            self.fails = None

    def unlock(self) -> None:
        super().unlock()
        self._stopped = False

    def _refuse(self) -> None:
        if self.fails == "lost":
            raise TransportError("the stub stage is unplugged")
        if self.fails == "resets":
            self.homed = False
            raise StageReset("the stub stage was reset")

    def _going(self, to_mm: list[float], lasts_s: float) -> Iterator[StageStatus | None]:
        from_mm, begun_s = list(self.at_mm), self.clock.monotonic_s()
        self._way = way = (from_mm, list(to_mm), begun_s, max(lasts_s, _TRUTH_S))
        ends_s = begun_s + way[3]
        try:
            while (now_s := self.clock.monotonic_s()) < ends_s - 1e-9:
                if self.fails == "stalls":
                    self._way = None
                    self.clock.wait_s(1.0)
                    self.homed, self.fails = False, None
                    raise StageTimeout("the stub stage does not arrive")
                if self.fails == "strays":
                    self._way = None
                    self.at_mm[0] += 5.0 * self._look_s
                    self.clock.wait_s(self._look_s)
                    yield self.status()
                    continue
                self._way = way
                self.clock.wait_s(min(self._look_s, ends_s - now_s))
                self.at_mm = self.place_mm(self.clock.monotonic_s())
                self._way = None  # It stands if nobody asks for more.
                if self._stopped:
                    raise StageReset("the stub stage was stopped")
                self._refuse()
                self.at_look()
                yield None if self.silent else self.status()
        finally:
            if self._way is not None:
                self.at_mm = self.place_mm(self.clock.monotonic_s())
                self._way = None


class TrueSensor(StubSensor):
    """A stub sensor under the true force: a sample each period, late_s old, with noise."""

    def __init__(self, clock: VirtualClock, force_gwt: Callable[[float], float], config: Config) -> None:
        """force_gwt: the true force at a time."""
        super().__init__(clock)
        self.sample_period_s, self.late_s = config.force.sample_period_s, config.force.latency_s
        self.noise_gwt = config.virtual.cell_noise_gwt
        self._force_gwt, self._dice = force_gwt, 1

    def read(self) -> ForceReading:
        periods = (self.clock.monotonic_s() - self.late_s) / self.sample_period_s
        shows_gwt = self._force_gwt(self.sample_period_s * math.floor(periods + 1e-6)) + self._throw_gwt()
        self.shows_gwt = self.resolution_gwt * round(shows_gwt / self.resolution_gwt)
        return super().read()

    def _throw_gwt(self) -> float:
        """Return noise of a uniform distribution (gwt)."""
        self._dice = self._dice * 48271 % 2147483647
        return self.noise_gwt * math.sqrt(3) * (2 * self._dice / 2147483647 - 1)


class AilingSensor:
    """A force sensor, real driver or stub, that may fail in front of the engine.

    fails: is `dead`, shows an `overload`, stays `frozen`, or `drifts` from now on by drifts_gwt_s.
    """

    def __init__(self, sensor: ForceSensor, clock: VirtualClock) -> None:
        self._sensor, self._clock = sensor, clock
        self.fails: str | None = None
        self.drifts_gwt_s, self._since_s = 0.0, 0.0
        self._last: ForceReading | None = None
        self.zeroed_s = 0.0  # when it was last zeroed
        self.read_s: list[float] = []  # when it was read since then

    def fail(self, how: str | None) -> None:
        """Fail from now on; None: no longer."""
        self.fails, self._since_s = how, self._clock.monotonic_s()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sensor, name)

    def zero(self) -> None:
        self.zeroed_s = self._clock.monotonic_s()
        self.read_s.clear()
        self._sensor.zero()

    def read(self) -> ForceReading:
        if self.fails == "dead":
            self._clock.wait_s(0.5)
            raise ForceTimeout("the sensor does not answer")
        if self.fails == "overload":
            raise ForceOverload("above the range of the sensor")
        reading = self._sensor.read()
        self.read_s.append(self._clock.monotonic_s())
        force_n = reading.force_n
        if self.fails == "frozen" and self._last is not None:
            force_n = self._last.force_n
        if self.fails == "drifts":
            force_n += self.drifts_gwt_s * (self._clock.monotonic_s() - self._since_s) * GWT_N
        self._last = ForceReading(force_n, reading.stable, reading.t_s, reading.also)
        return self._last


class Cable(StopGate):
    """The gate between a stage and its driver, which a stop closes; a cut cable is closed for everybody."""

    cut = False

    def refuse(self, wire: Transport) -> None:
        if self.cut:
            raise TransportError(f"{wire.name}: unplugged", "lost")
        super().refuse(wire)

    def write(self, wire: Transport, data: bytes) -> None:
        self.refuse(wire)
        super().write(wire, data)


class FingerUnderCarriage:
    """The moving finger as the plant of a virtual bench."""

    def __init__(self, carriage: Carriage, finger: MovingFinger) -> None:
        self.carriage, self.finger = carriage, finger

    def mount(self, indentor: str) -> None:
        """It does not matter."""

    def pose_at(self, t_s: float) -> TruePose:
        pose = self.carriage.pose_at(t_s)
        skin_mm = self.finger.skin_mm(pose.x_mm, t_s)
        return TruePose(pose.x_mm, pose.above_apex_mm, skin_mm - pose.above_apex_mm)

    def force_n(self, t_s: float) -> float:
        pose = self.carriage.pose_at(t_s)
        return self.finger.force_gwt(pose.x_mm, pose.above_apex_mm, t_s) * GWT_N


# --- benches over it ---


class FingerBench:
    """Commands on one bench over a moving finger, as a person gives them; the record of the bench is on disk.

    It is the bench of an engine, its operator and its journal, and hears what is said of contact.
    """

    virtual = False  # Its devices are asked in rests, too.
    config: Config
    clock: JumpingClock
    stage: Stage
    force: AilingSensor
    witness: Witness
    engine: Engine

    def _set_up(self, tables: Mapping[str, Any] | None) -> None:
        limits = {"soft_trip_n": TRIP_GWT * GWT_N, **(tables or {}).get("limits", {})}
        # Near the switches, so that homing and the descent from it are short.
        frame = {"apex_z_mm": -13.0, "pad_centre_x_mm": -12.0}
        self.config = Config.model_validate({"frame": frame, **(tables or {}), "limits": limits})
        self.clock, self.pause, self.operator = JumpingClock(1.7e9, 100.0), Pause(), self
        self.finger = MovingFinger()
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.at_event: Callable[[str], object] = lambda stream: None
        shutil.rmtree(state_folder(), ignore_errors=True)
        self.memory = BenchMemory(self.config)

    # the bench of an engine

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        return indentor

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        self.at_event(stream)
        self.events.append((stream, dict(data)))
        if "contact" in data:
            self._hears(f"event {stream}", str(data["contact"]), lifted=data["contact"] == "lifted")

    def settle(self) -> None:
        """Nothing is queued."""

    def of(self, stream: str) -> list[dict[str, Any]]:
        """The events of one stream so far."""
        return [data for name, data in self.events if name == stream]

    def touched(self, known: KnownContact) -> None:
        """Record the contact, as the memory of a bench."""
        self._hears("the record", known.words, lifted=not known.may_touch)
        self.memory.touched(known)

    def record_zero(self, zero: ForceZero | None) -> None:
        """Record the zero, as the memory of a bench."""
        self.memory.record_zero(zero)

    # as `rig run`

    def begin(self, contact_s: float = 0.0) -> Engine:
        """Begin another run, or part of one; it knows only what is on record."""
        self.before = self.memory.read()
        self.memory.moves()
        self.engine = Engine(self.config, self, self, contact_s=contact_s, memory=self)
        return self.engine

    def close(self) -> None:
        """End a command: the position of a homed stage is recorded."""
        if self.stage.homed:
            with suppress(StageError, TransportError):
                self.memory.left(self.stage.status())

    def ready(self) -> Engine:
        """Mounted, homed, zeroed and over x = 0, at clearance."""
        verbs.mount(self.engine, "bar:3.0")
        verbs.home(self.engine)
        verbs.zero(self.engine)
        verbs.move_to(self.engine, 0.0)
        return self.engine

    def resume(self) -> Engine:
        """Begin another part of a run after what failed was put right; it leaves the finger first."""
        self.plug_in()
        return self.begin(self.engine.contact_time.total_s)

    def plug_in(self) -> None:
        """Put right what failed, and free the stage after a stop."""
        self.force.fail(None)

    @contextmanager
    def stopped_as_by_rig_stop(self) -> Iterator[None]:
        """Let the driver send its stop, as from another thread."""
        yield

    # by hand

    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float = 10.0) -> StepEnd:
        """As `rig jog --axis --by-mm`."""
        direction = Direction(axis, 1 if by_mm > 0 else -1)
        with self._session() as session:
            found = session.step(direction, abs(by_mm), speed_mm_s)
        self._hears("rig jog", found.known.words, lifted=not found.known.may_touch)
        return found

    def zero_by_hand(self) -> None:
        """As `rig zero`."""
        with self._session() as session:
            session.zero()

    def home_by_hand(self) -> None:
        """As `rig home`."""
        try:
            known = ManualSession(self.config, self, self.memory.read()).home()
            self._hears("rig home", known.words, lifted=not known.may_touch)
        finally:
            self.close()

    @contextmanager
    def _session(self) -> Iterator[ManualSession]:
        session = ManualSession(self.config, self, self.memory.read())
        try:
            with session.begun():
                yield session
        finally:
            self.close()

    # what is said

    def ask(self) -> None:
        """Let the engine, the ending of its run and `rig status` say what they know of contact."""
        known, at = self.engine.known_contact, FinalPosition.of(self.engine)
        self._hears("the engine", known.words, lifted=not known.may_touch)
        ends_lifted = at.left != "not moved" and (at.left == "lifted" or at.may_touch is False)
        self._hears("the ending", at.words, lifted=ends_lifted)
        with suppress(StageError, TransportError):
            found = contact_as_json(self.memory.read().aged_contact(self.stage.status()))
            self._hears("rig status", found["where_text"], lifted=found["may_touch"] is False)

    def _hears(self, by: str, words: str, *, lifted: bool) -> None:
        self.witness.hears(by, words, lifted=lifted, least_gwt=self.least_gwt)

    @property
    def least_gwt(self) -> float:
        """The true force that is a touch for the sensor: its threshold, and two steps."""
        noise_gwt = self.config.virtual.cell_noise_gwt
        return max(self.config.habits.touch_force_gwt, 6 * noise_gwt) + 3 * noise_gwt + 0.02

    @property
    def read_s(self) -> float:
        """How long after a force its reading may arrive (s)."""
        return LOOK_S + 2 * self.config.force.sample_period_s + self.config.force.latency_s


class FingerOnStub(FingerBench):
    """A stub stage and a stub sensor: no bytes."""

    def __init__(self, tables: Mapping[str, Any] | None = None) -> None:
        self._set_up(tables)
        self.stub = TrueStage(self.clock)
        self.stage = self.stub  # type: ignore[assignment]
        frame = self.config.frame

        def place_mm(t_s: float) -> tuple[float, float]:
            x_mm, _, z_mm = self.stub.place_mm(t_s)
            return x_mm - frame.pad_centre_x_mm, z_mm - frame.apex_z_mm

        self.witness = Witness(self.clock, self.finger, place_mm)
        self.force = AilingSensor(TrueSensor(self.clock, self._force_gwt, self.config), self.clock)
        self.begin()

    def _force_gwt(self, t_s: float) -> float:
        """Return the true force at a time that may be past."""
        samples = self.witness.samples
        if t_s > samples[-1].t_s:
            return self.witness.at(t_s).force_gwt
        return next((one.force_gwt for one in reversed(samples) if one.t_s <= t_s + 1e-9), 0.0)

    def plug_in(self) -> None:
        super().plug_in()
        self.stub.fails = None


class FingerOnBytes(FingerBench):
    """The virtual bench of a kind of stage: real drivers, bytes and twins."""

    def __init__(self, kind: str, tables: Mapping[str, Any] | None = None) -> None:
        self._set_up({"stage": {"kind": kind}, **(tables or {})})
        self.cable = Cable()
        plants: list[FingerUnderCarriage] = []

        def make(carriage: Carriage) -> FingerUnderCarriage:
            plants.append(FingerUnderCarriage(carriage, self.finger))
            return plants[0]

        bench = bench_around(make, self.config, self.clock, io.StringIO(), self.pause, self.cable)

        def place_mm(t_s: float) -> tuple[float, float]:
            pose = plants[0].carriage.pose_at(t_s)
            return pose.x_mm, pose.above_apex_mm

        self.stage, self.force = bench.stage, AilingSensor(bench.force, self.clock)
        self.witness = Witness(self.clock, self.finger, place_mm)
        self.begin()

    def plug_in(self) -> None:
        super().plug_in()
        self.cable.cut = False
        self.cable.open()

    @contextmanager
    def stopped_as_by_rig_stop(self) -> Iterator[None]:
        with self.cable.stopping():
            yield

    def click(self, axis: Axis, by_mm: float) -> None:
        """As clicks on a direction of the panel, also while it moves; then the panel shows contact, and is left."""
        owner = ManualOwner(self.config, self, self.cable, io.StringIO(), self.memory.read())
        click = {"axis": axis, "sign": 1 if by_mm > 0 else -1, "by_mm": abs(by_mm), "tab": "one"}
        until_s = self.clock.monotonic_s() + 0.5

        def act() -> None:
            now_s, shown = self.clock.monotonic_s(), owner.answers["status"]({})
            if now_s < until_s:
                with suppress(EngineError):
                    owner.answers["step"](click)
            elif shown["busy"] is None:
                found = shown["contact"] or contact_as_json(None)
                self._hears("the panel", found["where_text"], lifted=found["may_touch"] is False)
                owner.leave()
                return
            self.clock.call_at(now_s + 0.1, act)

        with owner.begun():
            act()
            owner.run()
