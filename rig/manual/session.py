"""Session of manual control: orders carried out one at a time, each through the engine."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import TypeVar

from rig.data.journal import NoJournal
from rig.devices.base import (
    Axis,
    ForceError,
    ForceReading,
    StageError,
    StageHeld,
    StageStatus,
    is_held,
)
from rig.engine import Engine, verbs
from rig.engine.bench import Bench
from rig.engine.bench_memory import BenchMemory, LastKnown
from rig.engine.contact import ContactRecord, KnownContact
from rig.engine.engine import State
from rig.engine.motion import Direction
from rig.engine.sensing import NoReadingError, ReadingListener, Sensing
from rig.engine.steps import StepEnd, Steps, resume_position, take_zero
from rig.errors import BadInputError, LimitError
from rig.session.script_run import stopped_at_once
from rig.settings import ZERO_LIFT_MM, RigSettings
from rig.transport.wire import TransportError
from rig.units import GWT_N

_T = TypeVar("_T")

SIZES_MM = (0.01, 0.05, 0.1, 0.5, 1.0, 5.0)
"""Sizes of a step (mm)."""

FASTEST_MM_S = 10.0
"""Highest speed of manual control (mm/s); the guarded motions are slower."""

SPEED_MM_S = 2.0
"""Speed of a step (mm/s) unless chosen, and where no guard asks for a lower one."""

OnPositionedReading = Callable[[StageStatus | None, ForceReading], None]
"""Receives each force reading, with the position of the stage by its last report."""


def no_force_readings(error: Exception) -> BadInputError:
    """Return the error for a motion without a reading from the sensor."""
    return BadInputError(
        f"{error}; nothing was moved. To move without force readings, use --without-force", "not_felt"
    )


class ManualSession:
    """Session on one bench: it holds the engine, and the memory of zero, position and contact.

    The position is known if the last command left the homed stage there; it is recorded again at the end.
    """

    def __init__(
        self,
        settings: RigSettings,
        bench: Bench,
        known: LastKnown,
        on_reading: OnPositionedReading = lambda at, reading: None,
        on_failure: Callable[[str], None] = lambda problem: None,
    ) -> None:
        """Prepare a session. known: what the last command left. on_reading, on_failure: of each force reading."""
        self._settings, self._bench, self._known, self._on_reading = settings, bench, known, on_reading
        self.memory = BenchMemory(settings)
        self.sensing = Sensing(settings, bench.clock, bench.force, ReadingListener(self._receive_reading, on_failure))
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
        return self._carry_out(lambda steps: steps.make(direction, by_mm, speed_mm_s))

    def park(self) -> StepEnd:
        """Lift to the park height. Raises as `Steps.park`."""
        return self._carry_out(lambda steps: steps.park(self._settings.habits.travel_speed_mm_s))

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
        """Zero the sensor as `Steps.zero`, and record the zero; return the sensor's identification.

        Raises as `Steps.zero`.
        """
        before, speed_mm_s = self.memory.read(), self._settings.habits.descent_speed_mm_s
        try:
            name, zero = self._carry_out(lambda steps: steps.zero(before, speed_mm_s))
        except StageError as error:
            raise not_checked(error) from error
        self.memory.record_zero(self.sensing.lasting_zero or zero)
        return name

    def zero_anyway(self) -> str:
        """Zero the sensor unchecked, without a motion; return its identification. Raises LimitError, ForceError."""
        self._steps.forget()
        name, zero = take_zero(self.sensing, self.memory)
        self.memory.record_zero(self.sensing.lasting_zero or zero)
        return name

    def _carry_out(self, order: Callable[[Steps], _T]) -> _T:
        """Carry out an order at the position that the stage knows now."""
        if is_held(state := self.ask_stage().state):
            raise StageHeld(state)  # Somebody holds the board on purpose; a command would reset it.
        known = math.isfinite(self.engine.motion.height_mm)
        if known and not (self.homed or self.tripped):
            self._begin_engine(self.memory.read().contact)  # The stage has lost its position.
        with stopped_at_once(self.engine):
            found = order(self._steps)
        with suppress(StageError) if self.tripped else nullcontext():  # A stopped board reports its reset first.
            self.ask_stage()
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

    def _receive_reading(self, reading: ForceReading) -> None:
        self.force_gwt = self.sensing.from_zero(reading).force_n / GWT_N
        self._on_reading(self.at, reading)


def not_checked(error: StageError | TransportError) -> StageError:
    """Return the error for a zero without a stage that could check it by a lift."""
    return StageError(
        f"the zero cannot be checked by a lift of {ZERO_LIFT_MM:g} mm: {error}; home first (`rig home`), or, if "
        "nothing touches the indentor, use --anyway",
        error.code,
    )
