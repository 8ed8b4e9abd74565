"""A finger that moves, the truth about it, and an engine over it: on a stub bench, and on the virtual benches.

What a program may do is judged by the truth, sampled every few milliseconds of the virtual clock, and never by what
its sensor said.
"""

import io
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain, pairwise
from typing import Any

from rig.bench.checks import contact
from rig.bench.virtual import bench_around
from rig.data.journal import NoJournal
from rig.devices.base import LOOK_S, Axis, ForceReading, StageStatus
from rig.engine import Engine, Pause, verbs
from rig.engine.bench_memory import BenchMemory
from rig.engine.contact import KnownContact
from rig.engine.dead_man import Direction
from rig.engine.sensing import ForceZero, Sensing
from rig.manual import home_and_zero
from rig.manual.jog import Moved
from rig.plan.config import Config
from rig.session.early_ending import FinalPosition
from rig.settings import RigSettings
from rig.units import GWT_N
from sim.carriage import Carriage, TruePose
from sim.devices.clock import VirtualClock
from tests.stub_bench import StubBench, StubSensor, StubStage

TRIP_GWT = 16.0
STOP_MM = 1.5
"""How far a stage may go sideways in contact: the way to the threshold, speed × age of a reading, stop distance."""
OVERSHOOT_GWT = 1.5
"""By how much the program itself may pass the trip (gwt)."""
FACT_S = 1.0
"""How long a measurement at rest is a fact (s)."""
TRUTH_S = 0.002
STAGES = ("grbl", "leadshine", "zaber", "standa", "tmcl")


# --- the finger ---


@dataclass(frozen=True)
class Movement:
    """The skin rises by so much (mm; sinks if negative) at a speed, stays, and goes back; a shake is a sine."""

    at_s: float
    by_mm: float
    speed_mm_s: float
    stays_s: float = math.inf
    cycles: int = 0  # of a shake, whose highest speed is speed_mm_s

    def rise_mm(self, t_s: float) -> float:
        """Return by how much the skin is higher at a time (mm)."""
        after_s = t_s - self.at_s
        if after_s <= 0:
            return 0.0
        if self.cycles:
            turns = self.speed_mm_s * after_s / (2 * math.pi * abs(self.by_mm))
            return self.by_mm * math.sin(2 * math.pi * turns) if turns < self.cycles else 0.0
        takes_s = abs(self.by_mm) / self.speed_mm_s
        share = min(after_s / takes_s, 1.0)
        if after_s > takes_s + self.stays_s:
            share = max(1.0 - (after_s - takes_s - self.stays_s) / takes_s, 0.0)
        return self.by_mm * share


class MovingFinger:
    """A finger F = k d^1.5 below its skin, whose height above the nominal apex is a function of time.

    Beside it, beyond a place in x, stands another one or the fold of a nail: a higher skin behind a steep flank.
    """

    def __init__(self, k_gwt: float = 13.0, skin_mm: float = 0.0) -> None:
        self.k_gwt, self.at_rest_mm = k_gwt, skin_mm
        self.highest_mm = 4.5
        self.movements: list[Movement] = []
        self.beside_x_mm, self.beside_mm, self.flank_mm = math.inf, 0.0, 0.5

    def moves(self, at_s: float, by_mm: float, speed_mm_s: float = 10.0, stays_s: float = math.inf) -> None:
        """From a time on: rise or sink, and perhaps come back."""
        self.movements.append(Movement(at_s, by_mm, speed_mm_s, stays_s))

    def shakes(self, at_s: float, by_mm: float, speed_mm_s: float = 10.0, cycles: int = 5) -> None:
        """From a time on: a sine."""
        self.movements.append(Movement(at_s, by_mm, speed_mm_s, cycles=cycles))

    def stands_beside(self, x_mm: float, by_mm: float, flank_mm: float = 0.5) -> None:
        """Put a second finger beside it, so much higher."""
        self.beside_x_mm, self.beside_mm, self.flank_mm = x_mm, by_mm, flank_mm

    def skin_mm(self, x_mm: float, t_s: float) -> float:
        """Return the height of the skin (mm)."""
        rise_mm = self.at_rest_mm + sum(movement.rise_mm(t_s) for movement in self.movements)
        flank = min(max((x_mm - self.beside_x_mm) / self.flank_mm, 0.0), 1.0)
        return min(rise_mm + self.beside_mm * flank, self.highest_mm)

    def force_gwt(self, x_mm: float, height_mm: float, t_s: float) -> float:
        """Return the true force on the finger (gwt)."""
        return self.k_gwt * max(self.skin_mm(x_mm, t_s) - height_mm, 0.0) ** 1.5


# --- the truth ---


@dataclass(frozen=True)
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
    """Everything that really happened, sampled from timers of the clock."""

    def __init__(
        self, clock: VirtualClock, finger: MovingFinger, place_mm: Callable[[], tuple[float, float]]
    ) -> None:
        """place_mm: x and height of the indentor over the finger, now."""
        self.clock, self.finger, self._place_mm = clock, finger, place_mm
        self.samples: list[Truth] = []
        self.said: list[Said] = []
        self._sample()

    def now(self) -> Truth:
        """Return the truth of this instant."""
        t_s, (x_mm, height_mm) = self.clock.monotonic_s(), self._place_mm()
        return Truth(t_s, x_mm, height_mm, self.finger.force_gwt(x_mm, height_mm, t_s))

    def _sample(self) -> None:
        now = self.now()
        self.samples.append(now)
        near = self.finger.skin_mm(now.x_mm, now.t_s) > now.height_mm - 0.5
        self.clock.call_at(now.t_s + (TRUTH_S if near else 5 * TRUTH_S), self._sample)

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

    def lies(self) -> list[Said]:
        """Return where it was said that the indentor is lifted, of a finger touched for longer than a fact is old."""
        return [said for said in self.said if said.lifted and said.touched_s > FACT_S]

    def worst_gwt(self, since: int = 0) -> float:
        """Return the highest force (gwt), since a number of samples."""
        return max((sample.force_gwt for sample in self.samples[since:]), default=0.0)

    def dragged(self, least_gwt: float, since: int = 0) -> tuple[float, float]:
        """Return the longest way sideways in one contact (mm), and the highest force on it (gwt).

        Only the stage counts: a finger that moves along below it is not dragged by it.
        """
        worst = (0.0, 0.0)
        far_mm = force_gwt = 0.0
        for before, after in pairwise(self.samples[since:]):
            if min(before.force_gwt, after.force_gwt) < least_gwt:
                far_mm = force_gwt = 0.0
                continue
            if after.x_mm != before.x_mm:
                far_mm += abs(after.x_mm - before.x_mm)
                force_gwt = max(force_gwt, after.force_gwt)
                worst = max(worst, (far_mm, force_gwt))
        return worst

    def made_gwt(self, trip_gwt: float, read_s: float, since: int = 0) -> float:
        """Return by how much the program passed the trip, beyond what the finger would have done to a halted stage.

        The stage of the replay halts where it was at the first reading above the trip, read_s after the force.
        """
        made_gwt, samples, at = 0.0, self.samples, since
        while at < len(samples):
            if samples[at].force_gwt <= trip_gwt:
                at += 1
                continue
            end = at
            while end < len(samples) and samples[end].force_gwt > trip_gwt:
                end += 1
            spell = samples[at:end]
            halted = next((one for one in spell if one.t_s >= spell[0].t_s + read_s), spell[-1])
            replayed = (self.finger.force_gwt(halted.x_mm, halted.height_mm, one.t_s) for one in spell)
            worst_gwt, alone_gwt = max(one.force_gwt for one in spell), max(replayed)
            made_gwt = max(made_gwt, worst_gwt - max(alone_gwt, trip_gwt))
            at = end
        return made_gwt


# --- the engine over it, on a stub bench ---


class TrueStage(StubStage):
    """A stub stage that is at every instant where it really is, homes up first, and jogs at its speed."""

    def homing(self) -> Iterator[StageStatus | None]:
        self.told.append("home")
        x_mm, y_mm, _ = self.at_mm
        yield from self._going([x_mm, y_mm, self.switches_mm[2]], self.homing_s)
        yield from self._going(list(self.switches_mm), self.homing_s)
        self.homed = True

    def jog(self, axis: str, mm: float, speed_mm_s: float) -> None:
        to_mm = list(self.at_mm)
        to_mm["xyz".index(axis)] += mm
        self.told.append(("jog", axis, mm))
        for _ in self._going(to_mm, abs(mm) / speed_mm_s):
            pass

    def _going(self, to_mm: list[float], lasts_s: float) -> Iterator[StageStatus | None]:
        from_mm, begun_s = list(self.at_mm), self.clock.monotonic_s()
        share = 0.0
        while share < 1.0:
            look_s = self.clock.monotonic_s() + LOOK_S
            while self.clock.monotonic_s() < look_s and share < 1.0:
                self.clock.wait_s(TRUTH_S)
                share = min((self.clock.monotonic_s() - begun_s) / max(lasts_s, TRUTH_S), 1.0)
                self.at_mm = [was + share * (to - was) for was, to in zip(from_mm, to_mm, strict=True)]
            self.at_look()
            yield None if self.silent else self.status()
        self.at_mm = list(to_mm)


class TrueSensor(StubSensor):
    """A stub sensor under the true force: a sample each period, late, drifting, noisy or frozen if it shall be."""

    def __init__(self, clock: VirtualClock, force_gwt: Callable[[float], float]) -> None:
        """force_gwt: the true force at a time."""
        super().__init__(clock)
        self._force_gwt = force_gwt
        self.late_s = self.offset_gwt = self.drift_gwt_s = self.noise_gwt = 0.0
        self.frozen = False
        self.first_s = clock.monotonic_s()
        self._dice = 1

    def read(self) -> ForceReading:
        if not self.frozen:
            now_s = self.clock.monotonic_s()
            at_s = self.sample_period_s * math.floor((now_s - self.late_s) / self.sample_period_s + 1e-6)
            drift_gwt = self.offset_gwt + self.drift_gwt_s * (now_s - self.first_s)
            shows_gwt = self._force_gwt(at_s) + drift_gwt + self.noise_gwt * self._throw()
            self.shows_gwt = self.resolution_gwt * round(shows_gwt / self.resolution_gwt)
        return super().read()

    def _throw(self) -> float:
        """Return a number between −√3 and √3, whose standard deviation is 1."""
        self._dice = self._dice * 48271 % 2147483647
        return math.sqrt(3) * (2 * self._dice / 2147483647 - 1)


class FingerOnStub(StubBench):
    """An engine over a moving finger: stub stage, stub sensor, virtual clock; the record of the bench is on disk."""

    def __init__(self, tables: Mapping[str, Any] | None = None, finger: MovingFinger | None = None) -> None:
        self.settings = RigSettings.model_validate(with_trip(tables))
        self.clock = VirtualClock(1.7e9, 100.0)
        self.finger = MovingFinger() if finger is None else finger
        self.stage = TrueStage(self.clock)
        self.witness = Witness(self.clock, self.finger, self._place_mm)
        self.force: TrueSensor = TrueSensor(self.clock, self._force_gwt)
        self.operator, self.pause = self, Pause()
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.at_event: Callable[[str], object] = lambda stream: None
        self.memory = BenchMemory(self.settings)
        self.engine = self.begin()

    def begin(self) -> Engine:
        """Begin another command on the same bench: a new engine, which knows only what is on record."""
        self.engine = engine = Engine(self.settings, self, self)
        engine.keep_contact, engine.keep_zero = self._keep_contact, self._keep_zero
        return engine

    def resume(self) -> Engine:
        """Begin as a resumed run does; mounted, homed, zeroed and over the finger again."""
        self.begin()
        verbs.leave_finger(self.engine, self.memory.read(), resumed=True)
        verbs.mount(self.engine, "bar:3.0")
        verbs.zero(self.engine)
        verbs.move_to(self.engine, 0.0)
        return self.engine

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        super().event(stream, data)
        if "contact" in data:
            self._hears(f"event {stream}", str(data["contact"]), lifted=data["contact"] == "lifted")

    def ask(self) -> None:
        """Let everything that speaks of contact say it."""
        ask(self.witness, self.engine, self.least_gwt)
        status(self.witness, Config.model_validate(with_trip(None)), self.least_gwt)

    @property
    def least_gwt(self) -> float:
        """The true force that is a touch for the sensor: its threshold, and as much as its noise and steps."""
        return max(self.settings.habits.touch_force_gwt, 6 * self.force.noise_gwt) + 2 * self.force.resolution_gwt

    @property
    def read_s(self) -> float:
        """How long after a force its reading may arrive (s)."""
        return LOOK_S + self.force.sample_period_s + self.force.late_s

    def _place_mm(self) -> tuple[float, float]:
        frame = self.settings.frame
        return self.stage.at_mm[0] - frame.pad_centre_x_mm, self.stage.at_mm[2] - frame.apex_z_mm

    def _force_gwt(self, t_s: float) -> float:
        """Return the true force at a time that may be past."""
        samples = self.witness.samples
        at = next((one for one in reversed(samples) if one.t_s <= t_s + 1e-9), samples[0])
        x_mm, height_mm = self._place_mm() if t_s >= samples[-1].t_s else (at.x_mm, at.height_mm)
        return self.finger.force_gwt(x_mm, height_mm, t_s)

    def _keep_contact(self, known: KnownContact) -> None:
        self._hears("the record", known.words, lifted=not known.may_touch)
        self.memory.touched(known)

    def _keep_zero(self, zero: ForceZero | None) -> None:
        self.memory.forget_zero() if zero is None else self.memory.zeroed(zero)

    def _hears(self, by: str, words: str, *, lifted: bool) -> None:
        self.witness.hears(by, words, lifted=lifted, least_gwt=self.least_gwt)


def with_trip(tables: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return tables of a configuration with the soft trip of these tests."""
    tables = dict(tables or {})
    return {**tables, "limits": {"soft_trip_n": TRIP_GWT * GWT_N, **tables.get("limits", {})}}


def ask(witness: Witness, engine: Engine, least_gwt: float) -> None:
    """Let an engine say what it knows of contact, and what the ending of its run would."""
    known, at = engine.known_contact, FinalPosition.of(engine)
    witness.hears("the engine", known.words, lifted=not known.may_touch, least_gwt=least_gwt)
    claims = at.left == "lifted" or at.may_touch is False
    witness.hears("the ending", at.words, lifted=claims and at.left != "not moved", least_gwt=least_gwt)


def status(witness: Witness, config: Config, least_gwt: float) -> None:
    """Let `rig status` say what is on record."""
    found = contact(config)
    witness.hears("rig status", found["where_text"], lifted=found["may_touch"] is False, least_gwt=least_gwt)


# --- the engine and manual control over it, on the virtual benches ---


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


class FingerOnBytes:
    """Commands on a virtual bench over a moving finger: real drivers, bytes and twins; the record is on disk."""

    virtual = False  # Its devices are asked in rests, too.

    def __init__(
        self, kind: str, tables: Mapping[str, Any] | None = None, finger: MovingFinger | None = None
    ) -> None:
        self.config = Config.model_validate(with_trip({"stage": {"kind": kind}, **(tables or {})}))
        self.clock, self.pause = VirtualClock(1.7e9, 100.0), Pause()
        self.finger = MovingFinger() if finger is None else finger
        plants: list[FingerUnderCarriage] = []

        def make(carriage: Carriage) -> FingerUnderCarriage:
            plants.append(FingerUnderCarriage(carriage, self.finger))
            return plants[0]

        self.bench = bench_around(make, self.config, self.clock, io.StringIO(), self.pause)
        self.stage, self.force, self.operator = self.bench.stage, self.bench.force, self
        self._plant, self.memory = plants[0], BenchMemory(self.config)
        self.witness = Witness(self.clock, self.finger, self._place_mm)
        self.least_gwt = self.config.habits.touch_force_gwt + 0.02
        self.read_s = LOOK_S + self.config.force.sample_period_s
        self.engine = self.begin()

    def mount(self, indentor: str, meanwhile: Callable[[], object]) -> str:
        return indentor

    # as `rig run`

    def begin(self) -> Engine:
        """Begin another run, which knows only what is on record."""
        self.engine = engine = Engine(self.config, self, NoJournal())
        engine.keep_contact, engine.keep_zero = self._keep_contact, self._keep_zero
        return engine

    def ready(self) -> Engine:
        """Mounted, homed, zeroed and over x = 0, at clearance."""
        verbs.mount(self.engine, "bar:3.0")
        verbs.home(self.engine)
        verbs.zero(self.engine)
        verbs.move_to(self.engine, 0.0)
        return self.engine

    def resume(self) -> Engine:
        """Begin as a resumed run does; mounted, homed, zeroed and over the finger again."""
        self.begin()
        verbs.leave_finger(self.engine, self.memory.read(), resumed=True)
        return self.ready()

    def left(self) -> None:
        """End a command: the place of the stage is on record, as after one by hand."""
        self.memory.left(self.stage.status())

    # by hand

    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float = 10.0) -> Moved:
        """As `rig jog --axis --by-mm`."""
        direction = Direction(axis, 1 if by_mm > 0 else -1)
        sensing = home_and_zero.feel(Sensing(self.config, self.clock, self.force))
        hand_of = home_and_zero.at_hand(
            self.config, self.stage, self.clock, sensing, lambda at, force_gwt: None, self.memory.read()
        )
        with hand_of as hand:
            return hand.go(lambda: direction, speed_mm_s, abs(by_mm))

    def zero_by_hand(self) -> None:
        """As `rig zero`."""
        home_and_zero.zero(self.config, Sensing(self.config, self.clock, self.force), anyway=False)

    def home_by_hand(self) -> None:
        """As `rig home`."""
        home_and_zero.home(self.config, self, home_and_zero.feel(Sensing(self.config, self.clock, self.force)))

    # what is said

    def ask(self) -> None:
        """Let everything that speaks of contact say it."""
        ask(self.witness, self.engine, self.least_gwt)
        status(self.witness, self.config, self.least_gwt)

    def _place_mm(self) -> tuple[float, float]:
        pose = self._plant.carriage.pose_at(self.clock.monotonic_s())
        return pose.x_mm, pose.above_apex_mm

    def _keep_contact(self, known: KnownContact) -> None:
        self.witness.hears("the record", known.words, lifted=not known.may_touch, least_gwt=self.least_gwt)
        self.memory.touched(known)

    def _keep_zero(self, zero: ForceZero | None) -> None:
        self.memory.forget_zero() if zero is None else self.memory.zeroed(zero)
