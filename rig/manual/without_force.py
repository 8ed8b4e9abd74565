"""Manual control of a stage whose force sensor does not work: bounded jogs that nothing ends at a finger."""

from collections.abc import Iterator
from contextlib import contextmanager

from rig.clock import Clock
from rig.devices.base import Axis, Stage, StageStatus
from rig.engine.bench_memory import BenchMemory
from rig.engine.contact import KnownContact, contact_at
from rig.engine.motion import Direction
from rig.engine.steps import StepEnd, step_without_force
from rig.errors import LimitError
from rig.settings import RigSettings


class SessionWithoutForce:
    """Session on a connected stage: home, and steps without force."""

    force_gwt = None

    def __init__(self, settings: RigSettings, stage: Stage, clock: Clock) -> None:
        self._settings, self._stage, self._clock = settings, stage, clock
        self.memory = BenchMemory(settings)

    @contextmanager
    def begun(self) -> Iterator[None]:
        """Take the position from the last command, and record it again at the end. Raises StageError."""
        if self.memory.read().is_where_left(self._stage.status()):
            self._stage.trust_position()
        with self.memory.moving(self._stage):
            yield

    def look(self) -> StageStatus:
        """Ask the stage. Raises StageError."""
        return self._stage.status()

    def steps_per_mm(self, axis: Axis) -> float:
        """Return the controller's steps per mm. Raises StageError for an axis without a drive."""
        return self._stage.steps_per_mm(axis)

    def step(self, direction: Direction, by_mm: float, speed_mm_s: float) -> StepEnd:
        """Jog by a distance. Raises LimitError if it ends too deep in the known finger, StageError."""
        step_without_force(self._settings, self._stage, self._clock, self.memory, direction, by_mm, speed_mm_s)
        return self.contact()

    def contact(self) -> StepEnd:
        """Return what the position alone shows of contact. Raises StageError."""
        known = contact_at(
            self._settings, self._stage.status(), placed=self._stage.homed, force_gwt=None, touch_gwt=0.0,
            unix_s=self._clock.unix_s(),
        )  # fmt: skip
        self.memory.touched(known)
        return StepEnd(known, None)

    def home(self) -> KnownContact:
        """Home, and return what the position alone shows of contact. Raises StageError."""
        self._stage.home()
        return self.contact().known

    def zero(self) -> str:
        """Refuse: there is no force."""
        raise LimitError("zero: not possible without the force sensor", "not_felt")

    def park(self) -> StepEnd:
        """Refuse: a step up does the same."""
        raise LimitError("park: not possible without the force sensor; step up instead", "not_felt")
