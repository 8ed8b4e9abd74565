"""Manual control of a stage whose force sensor does not work: bounded jogs that nothing ends at a finger."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

from rig.clock import Clock
from rig.devices.base import Axis, Stage, StageStatus
from rig.engine.bench_memory import BenchMemory
from rig.engine.contact import KnownContact, contact_at
from rig.engine.motion import DOWN, UP, Direction, jog
from rig.engine.steps import StepEnd
from rig.errors import LimitError
from rig.settings import RigSettings

_TINY_MM = 1e-6


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
        self._refuse_depth(direction, by_mm)
        if direction != UP:
            self.memory.touched(KnownContact(unix_s=self._clock.unix_s()))
        limits, left_mm = self._settings.limits, by_mm
        if direction == DOWN:
            speed_mm_s = min(speed_mm_s, limits.max_press_speed_mm_s)
        while left_mm > _TINY_MM:
            part_mm = min(left_mm, self._longest_mm(direction))
            jog(self._stage, self._clock, direction, part_mm, speed_mm_s)
            left_mm -= part_mm
        return self.contact()

    def _longest_mm(self, direction: Direction) -> float:
        """Return the longest jog (mm): down it is an increment, or above clearance a step of the descent."""
        if direction != DOWN:
            return math.inf
        habits = self._settings.habits
        height_mm = self._stage.status().z_mm - self._settings.frame.apex_z_mm
        above_mm = height_mm - habits.clearance_mm if self._stage.homed else 0.0
        return min(habits.descent_step_mm, above_mm) if above_mm > _TINY_MM else habits.increment_mm

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

    def _refuse_depth(self, direction: Direction, by_mm: float) -> None:
        deepest_mm = self._settings.limits.max_doi_mm
        height_mm = self._stage.status().z_mm - by_mm - self._settings.frame.apex_z_mm
        if self._stage.homed and direction == DOWN and height_mm < -deepest_mm - _TINY_MM:
            raise LimitError(
                f"{-height_mm:.2f} mm below the nominal apex is deeper than limits.max_doi_mm = {deepest_mm:g} mm; "
                "nothing was moved",
                "too_deep",
            )
