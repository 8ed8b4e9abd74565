"""Session of manual control: orders carried out one at a time, each through the engine."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from datetime import datetime
from typing import Literal

from rig.data.journal import NoJournal
from rig.devices.base import (
    Axis,
    ForceError,
    ForceReading,
    ForceSensor,
    StageError,
    StageHeld,
    StageStatus,
    ZeroedByDriver,
    is_held,
)
from rig.engine import Engine, verbs
from rig.engine.bench import Bench
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.contact import ContactRecord, KnownContact
from rig.engine.engine import State
from rig.engine.limits import AT_MM
from rig.engine.motion import DOWN, UP, Direction
from rig.engine.sensing import ForceZero, NoReadingError, Sensing, zero_readings_gwt
from rig.engine.steps import StepEnd, Steps, resume_position
from rig.errors import BadInputError, LimitError, NotReadyError
from rig.session.script_run import stopped_at_once
from rig.settings import ZERO_LIFT_MM, RigSettings
from rig.transport.wire import TransportError
from rig.units import GWT_N

SIZES_MM = (0.01, 0.05, 0.1, 0.5, 1.0, 5.0)
"""Sizes of a step (mm)."""

FASTEST_MM_S = 10.0
"""Highest speed of manual control (mm/s); the guarded motions are slower."""

SPEED_MM_S = 2.0
"""Speed of a step (mm/s) unless chosen, and where no guard asks for a lower one."""

Verb = Literal["home", "zero", "zero anyway", "park"]

Heard = Callable[[StageStatus | None, ForceReading], None]
"""Receives each force reading, with the position of the stage by its last report."""


def no_force_readings(error: Exception) -> BadInputError:
    """Return the error for a motion without a reading from the sensor."""
    return BadInputError(
        f"{error}; nothing was moved. To move without force readings, use --without-force", "not_felt"
    )


class OverheardSensor:
    """Force sensor that passes every reading, or failure, to a listener."""

    def __init__(
        self, sensor: ForceSensor, on_reading: Callable[[ForceReading], None], on_failure: Callable[[str], None]
    ) -> None:
        self._sensor, self._on_reading, self._on_failure = sensor, on_reading, on_failure

    def connect(self) -> str:
        """Connect. Raises ForceError, TransportError."""
        return self._sensor.connect()

    def identify(self) -> str:
        """Return the identification. Raises ForceError, TransportError."""
        return self._sensor.identify()

    def zero(self) -> None:
        """Zero at the present load. Raises ForceError, TransportError."""
        self._sensor.zero()

    def close(self) -> None:
        """Close the port."""
        self._sensor.close()

    @property
    def subtracted_n(self) -> float:
        """Load that the driver subtracts since its last zero (N)."""
        return self._sensor.subtracted_n if isinstance(self._sensor, ZeroedByDriver) else 0.0

    @property
    def sample_period_s(self) -> float:
        """Time between new values (s)."""
        return self._sensor.sample_period_s

    @property
    def resolution_gwt(self) -> float:
        """Smallest step of the reading (gwt)."""
        return self._sensor.resolution_gwt

    def read(self) -> ForceReading:
        """Return the latest reading. Raises ForceError, TransportError."""
        try:
            reading = self._sensor.read()
        except (ForceError, TransportError) as error:
            self._on_failure(str(error))
            raise
        self._on_reading(reading)
        return reading


class ManualSession:
    """Session on one bench: it holds the engine, and the memory of zero, position and contact.

    The position is known if the last command left the homed stage there; it is recorded again at the end.
    """

    def __init__(
        self,
        settings: RigSettings,
        bench: Bench,
        known: LastKnown,
        on_reading: Heard = lambda at, reading: None,
        on_failure: Callable[[str], None] = lambda problem: None,
    ) -> None:
        """Prepare a session. known: what the last command left. on_reading, on_failure: of each force reading."""
        self._settings, self._bench, self._known, self._on_reading = settings, bench, known, on_reading
        self.memory = BenchMemory(settings)
        self.sensing = Sensing(settings, bench.clock, OverheardSensor(bench.force, self._heard, on_failure))
        self.sensing.zero = known.zero
        self.force_gwt: float | None = None  # last reading, from the zero
        self._at: StageStatus | None = None
        self.engine = Engine(settings, bench, NoJournal())  # until the session has begun
        self._steps = Steps(self.engine)

    @contextmanager
    def begun(self) -> Iterator[None]:
        """Connect both devices; at the end, record where the stage was left.

        Raises StageError, TransportError; BadInputError if the sensor does not answer.
        """
        stage = self._bench.stage
        stage.connect()
        try:
            self.sensing.connect()
        except (ForceError, TransportError) as error:
            raise no_force_readings(error) from None
        if self._known.is_where_left(self.ask_stage()):
            stage.trust_position()
        with self.memory.moving(stage):
            self._begin_engine(self._known.contact)
            yield

    @property
    def homed(self) -> bool:
        """Whether the position is trusted, so that heights are known."""
        return self._bench.stage.homed

    @property
    def tripped(self) -> bool:
        """Whether a trip is latched, which only homing leaves."""
        return self.engine.state is State.TRIPPED

    @property
    def at(self) -> StageStatus | None:
        """Position by the last report, also during a step."""
        frame, motion = self._settings.frame, self.engine.motion
        if self._at is None or not (self.homed and math.isfinite(motion.height_mm)):
            return self._at
        x_mm, y_mm = frame.pad_centre_x_mm + motion.x_mm, frame.pad_y_mm + motion.along_mm
        return StageStatus(self._at.state, x_mm, y_mm, frame.apex_z_mm + motion.height_mm, self._at.referenced)

    def look(self) -> StageStatus:
        """Ask the stage, and read the force; a missing reading goes to the listener. Raises StageError."""
        at = self.ask_stage()
        try:
            self.sensing.now()
        except NoReadingError:
            self.force_gwt = None
        return at

    def steps_per_mm(self, axis: Axis) -> float:
        """Return the controller's steps per mm. Raises StageError for an axis without a drive."""
        return self._bench.stage.steps_per_mm(axis)

    def step(self, direction: Direction, by_mm: float, speed_mm_s: float = SPEED_MM_S) -> StepEnd:
        """Make a step. Raises as `Steps.make`; LimitError, too, for an axis without a drive."""
        try:
            self.steps_per_mm(direction.axis)
        except StageError as error:
            raise LimitError(f"{error}; nothing was moved", error.code) from error
        return self._made(lambda: self._steps.make(direction, by_mm, speed_mm_s))

    def park(self) -> StepEnd:
        """Lift to the park height. Raises as `Steps.park`."""
        return self._made(lambda: self._steps.park(self._settings.habits.travel_speed_mm_s))

    def contact(self) -> StepEnd:
        """Measure the state of contact at rest. Raises StageError, TransportError."""
        return self._steps.contact()

    def home(self) -> KnownContact:
        """Home, which leaves a trip behind, and return the state of contact.

        Raises ENDINGS but ForceError, BadInputError.
        """
        if not self.sensing.absolute:
            self.sensing.zero = None  # Changes from a provisional zero would show no lift.
        self._begin_engine(self.memory.read().contact, trusted=False)
        try:
            with stopped_at_once(self.engine):
                verbs.home(self.engine)
        except ForceError as error:
            raise no_force_readings(error) from None
        finally:
            self.engine.heartbeat.rest()
        self.ask_stage()
        return self.engine.known_contact

    def zero(self) -> str:
        """Zero the sensor, lift by `ZERO_LIFT_MM` and stay there; return the sensor's identification.

        Raises NotReadyError after a trip; LimitError without readings, if they scatter, or if the last recorded zero
        or the lift shows a contact; StageError if the stage did not lift; ForceError, TransportError.
        """
        if self.tripped:
            raise NotReadyError("zero: not allowed after a trip; home first", "tripped")
        self._steps.forget()
        last = self.memory.read()
        if last.zero is not None:
            self.sensing.zero = last.zero
        _refuse_touched(self.sensing, last)
        from_mm = self.ask_stage().z_mm
        if self.homed and from_mm + ZERO_LIFT_MM + AT_MM > 0:  # The top of the travel leaves no room for the lift.
            self._moved_by(DOWN, from_mm + ZERO_LIFT_MM + AT_MM)
        name, zero = take_zero(self.sensing, self.memory)
        try:
            found = self._moved_by(UP, ZERO_LIFT_MM)
            if found.known.force_gwt is None:
                raise LimitError("no steady force after the lift; zero the sensor again", "no_reading")
            if abs(found.known.force_gwt) >= self.sensing.touch_gwt:
                changed = verbs.changed_zero(found.known.force_gwt)
                raise LimitError(str(changed), changed.code)
        except BaseException:
            self.sensing.zero = None
            raise
        self.memory.record_zero(self.sensing.lasting_zero or zero)
        return name

    def zero_anyway(self) -> str:
        """Zero the sensor unchecked, without a motion; return its identification. Raises LimitError, ForceError."""
        self._steps.forget()
        name, zero = take_zero(self.sensing, self.memory)
        self.memory.record_zero(self.sensing.lasting_zero or zero)
        return name

    def _made(self, make: Callable[[], StepEnd]) -> StepEnd:
        if is_held(state := self.ask_stage().state):
            raise StageHeld(state)  # Somebody holds the board on purpose; a command would reset it.
        known = math.isfinite(self.engine.motion.height_mm)
        if known and not (self.homed or self.tripped):
            self._begin_engine(self.memory.read().contact)  # The stage has lost its position.
        with stopped_at_once(self.engine):
            found = make()
        with suppress(StageError) if self.tripped else nullcontext():  # A stopped board reports its reset first.
            self.ask_stage()
        return found

    def _moved_by(self, direction: Direction, by_mm: float) -> StepEnd:
        """Move straight by a distance. Raises LimitError if it was not covered, StageError."""
        from_mm = self.ask_stage().z_mm
        try:
            found = self.step(direction, by_mm, self._settings.habits.descent_speed_mm_s)
        except StageError as error:
            raise not_checked(error) from error
        if found.ended_by is not None:
            raise LimitError(f"{found.ended_by}; nothing was zeroed; keep the finger away", found.ended_by.code)
        if abs(self.ask_stage().z_mm - from_mm) < by_mm - AT_MM:
            raise not_checked(StageError("the stage did not move", "did_not_move"))
        return found

    def _begin_engine(self, contact: KnownContact | None, *, trusted: bool = True) -> None:
        engine = Engine(self._settings, self._bench, NoJournal(), memory=self.memory, sensing=self.sensing)
        engine.contact = ContactRecord(may_touch=contact is not None and contact.may_touch)
        if trusted and self.homed:
            resume_position(engine)
        self.engine, self._steps = engine, Steps(engine)

    def ask_stage(self) -> StageStatus:
        """Ask the stage. Raises StageError, TransportError."""
        self._at = at = self._bench.stage.status()
        return at

    def _heard(self, reading: ForceReading) -> None:
        zero = self.sensing.zero
        self.force_gwt = (reading if zero is None else zero.without_offset(reading)).force_n / GWT_N
        self._on_reading(self.at, reading)


def take_zero(sensing: Sensing, memory: BenchMemory) -> tuple[str, ForceZero]:
    """Zero a sensor at its present load; return its identification and the zero, which the caller records.

    Raises LimitError without readings or if they scatter, ForceError, TransportError.
    """
    name = sensing.connect()
    sensing.sensor.zero()
    sensing.zero = None  # Readings now have a new zero.
    memory.record_zero(None)
    try:
        zero = sensing.take_zero(zero_readings_gwt(sensing.raw))
        if refused := verbs.refused_zero(sensing, zero):
            raise LimitError(str(refused), refused.code)
    except NoReadingError as error:
        sensing.zero = None
        raise LimitError(f"{error}; zero the sensor again", "no_reading") from error
    except BaseException:
        sensing.zero = None
        raise
    return name, zero


def not_checked(error: StageError | TransportError) -> StageError:
    """Return the error for a zero without a stage that could check it by a lift."""
    return StageError(
        f"the zero cannot be checked by a lift of {ZERO_LIFT_MM:g} mm: {error}; home first (`rig home`), or, if "
        "nothing touches the indentor, use --anyway",
        error.code,
    )


def _refuse_touched(sensing: Sensing, last: LastKnown) -> None:
    """Raise LimitError if the force from the last zero, or without one the record of contact, may be a contact."""
    if last.zero is None:
        if last.contact is not None and last.contact.kind not in ("lifted", "raised"):
            raise LimitError(
                f"there is no zero on record, and the indentor is {last.contact.words}, so nothing was zeroed; "
                "free the finger and home, or, if nothing touches the indentor, use --anyway",
                "maybe_touched",
            )
        return
    try:
        force_gwt = sensing.at_rest_gwt()
    except NoReadingError as error:
        remedy = "let the sensor settle, or use --anyway if nothing touches the indentor"
        raise LimitError(f"{error}; nothing was zeroed; {remedy}", error.code) from error
    if abs(force_gwt) >= sensing.touch_gwt:
        taken = datetime.fromtimestamp(last.zero_unix_s).isoformat(" ", "minutes")
        raise LimitError(
            f"the sensor reads {force_gwt:.2f} gwt from the last recorded zero ({taken}), more than "
            f"{sensing.touch_gwt:.2f} gwt, so nothing was zeroed; if nothing touches the indentor, use --anyway",
            "maybe_touched",
        )
