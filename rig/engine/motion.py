"""Position of the indentor, and monitored motions."""

import math
from collections.abc import Callable
from contextlib import suppress
from enum import Enum

from rig.clock import Clock
from rig.devices.base import LOOK_S, Looks, Stage, StageError, StageHeld, StageOverridden, StageStatus, is_held
from rig.engine.corridor import PRINTED_MM, Corridor
from rig.errors import RigError
from rig.settings import RigSettings

_ATTEMPTS = 5


class InterruptedMotionError(RigError):
    """A force or a change during a motion that must end it; the stage is at rest again."""

    default_code = "felt"

    def __init__(self, sentence: str = "", code: str | None = None, force_gwt: float | None = None) -> None:
        super().__init__(sentence, code)
        self.force_gwt = force_gwt


class Outcome(Enum):
    """How a watched motion ended; every other ending trips."""

    ARRIVED = "arrived"
    TOUCHED = "touched"
    PAUSED = "paused"  # by the operator, or by the end of the contact time
    LATE = "late"  # A reading came too late.


class EndedMotionError(InterruptedMotionError):
    """End of a motion short of its target that is no fault of the rig."""

    def __init__(self, outcome: Outcome, force_gwt: float) -> None:
        super().__init__(outcome.value, outcome.value, force_gwt)
        self.outcome = outcome


class StrayedError(InterruptedMotionError):
    """Two reports in a row outside the corridor; the stage was stopped and its position is not trusted."""

    default_code = "strayed"

    def __init__(self, sentence: str, at: StageStatus, code: str | None = None) -> None:
        super().__init__(sentence, code)
        self.at = at


def refuse_strayed(corridor: Corridor, at: StageStatus, stage: Stage, clock: Clock) -> None:
    """Raise StrayedError if a report and a second one, requested at once, both lie outside the corridor.

    The second request clears a single corrupted digit and delays a true stop by one exchange at most.
    """
    if corridor.strayed(at, clock.monotonic_s()) is None:
        return
    again = stage.status()
    strayed = corridor.strayed(again, clock.monotonic_s())
    if strayed is not None:
        raise StrayedError(str(strayed), again, strayed.code)


def insist(lift: Callable[[], None]) -> None:
    """Lift after a trip, and try again at full speed if an operator changes the speed meanwhile."""
    for _ in range(_ATTEMPTS - 1):
        with suppress(InterruptedMotionError):
            return lift()
    return lift()


Check = Callable[[], None]
"""Check made at each status of a motion; if it raises InterruptedMotionError, the stage comes to rest."""


class Motion:
    """Motions of a stage over one finger: x, along and height above the pad's nominal apex (mm); nan if unknown."""

    def __init__(self, settings: RigSettings, stage: Stage, clock: Clock) -> None:
        self._settings, self._stage, self._clock = settings, stage, clock
        self.x_mm, self.along_mm, self.height_mm = math.nan, 0.0, math.nan
        self.begun = False  # whether any motion was ever commanded
        self.strayed = False  # whether the stage was ever stopped because it strayed
        self._floor_mm = math.nan

    def limit_depth(self, height_mm: float) -> None:
        """Set the lowest height that the stage itself allows, if it can; at rest only. Raises StageError."""
        floor_mm = round(max(self._settings.frame.apex_z_mm + height_mm, -self._settings.stage.travel_mm[2]), 6)
        if floor_mm != self._floor_mm:
            self._floor_mm = math.nan
            self._stage.limit_depth(floor_mm)
            self._floor_mm = floor_mm

    def forget_depth(self) -> None:
        """Forget the depth limit of the stage, which may have lost it."""
        self._floor_mm = math.nan

    def home(self, check: Check) -> None:
        """Home the stage. Raises StageError, and the errors of `check`."""
        self._watched(check, self._stage.homing(), lambda at: None, self._stage.stop, None)
        self.set_position(self._stage.status())

    def aside(self, x_mm: float, along_mm: float, speed_mm_s: float, check: Check, look_s: float = LOOK_S) -> None:
        """Move laterally at this height, polled every look_s. Raises StageError, and the errors of `check`."""
        frame = self._settings.frame
        x, y = frame.pad_centre_x_mm + x_mm, frame.pad_y_mm + along_mm
        looks = self._stage.moving(x_mm=x, y_mm=y, speed_mm_s=speed_mm_s, look_s=look_s)
        corridor = self._corridor(x, y, self._machine_mm[2], speed_mm_s)
        self._watched(check, looks, self._be_over, self._stage.halt, corridor)
        self.x_mm, self.along_mm = x_mm, along_mm

    def to_height(self, height_mm: float, speed_mm_s: float, check: Check, look_s: float = LOOK_S) -> None:
        """Move straight up or down, polled every look_s. Raises StageError, and the errors of `check`."""
        z = self._settings.frame.apex_z_mm + height_mm
        looks = self._stage.moving(z_mm=z, speed_mm_s=speed_mm_s, look_s=look_s)
        x, y, _ = self._machine_mm
        self._watched(check, looks, self._be_at_height, self._stage.halt, self._corridor(x, y, z, speed_mm_s))
        self.height_mm = height_mm

    def watched(self, looks: Looks, halt: Callable[[], None], check: Check) -> None:
        """Run a motion that watches its own way, at a position that is not known."""
        self._watched(check, looks, lambda at: None, halt, None)

    @property
    def _machine_mm(self) -> tuple[float, float, float]:
        frame = self._settings.frame
        return (
            frame.pad_centre_x_mm + self.x_mm,
            frame.pad_y_mm + self.along_mm,
            frame.apex_z_mm + self.height_mm,
        )

    def _corridor(self, x_mm: float, y_mm: float, z_mm: float, speed_mm_s: float) -> Corridor | None:
        """Return the corridor from the present position, or None if that is unknown."""
        start_mm = self._machine_mm
        if not all(map(math.isfinite, start_mm)):
            return None
        settings = self._settings
        return Corridor(
            start_mm, (x_mm, y_mm, z_mm), speed_mm_s, self._clock.monotonic_s(),
            settings.stage.resolution_mm + PRINTED_MM,
            tuple(2 * settings.calibration.value(f"{axis}_backlash_mm", 0.0) for axis in "xyz"),
        )  # fmt: skip

    def _watched(
        self,
        check: Check,
        looks: Looks,
        seen: Callable[[StageStatus], None],
        halt: Callable[[], None],
        corridor: Corridor | None,
    ) -> None:
        self.begun = True
        try:
            for at in looks:
                if at is not None:
                    seen(at)
                    if is_held(at.state):
                        raise StageHeld(at.state)
                self._checked(check, at, seen, halt, corridor)
        except StageOverridden as error:
            self._come_to_rest(seen, self._stage.halt)
            raise InterruptedMotionError(str(error), error.code) from error
        except RigError:
            raise
        except Exception:  # an error in this program or in a driver
            with suppress(RigError):
                self._come_to_rest(seen, halt)
            raise

    def _checked(
        self,
        check: Check,
        at: StageStatus | None,
        seen: Callable[[StageStatus], None],
        halt: Callable[[], None],
        corridor: Corridor | None,
    ) -> None:
        try:
            if corridor is not None and at is not None:
                refuse_strayed(corridor, at, self._stage, self._clock)
            check()
        except StrayedError as strayed:
            trusted = self._stage.homed
            self._stage.stop()  # At once: a halt would first slow down, farther the wrong way.
            self.set_position(strayed.at)
            if not trusted:  # The stage has lost its position.
                raise StageError(str(strayed), strayed.code) from strayed
            self.strayed = True
            raise
        except InterruptedMotionError:
            self._come_to_rest(seen, halt)
            raise

    def _come_to_rest(self, seen: Callable[[StageStatus], None], halt: Callable[[], None]) -> None:
        halt()
        if self._stage.homed:
            seen(self._stage.status())

    def set_position(self, at: StageStatus) -> None:
        """Take the position from a status."""
        self._be_over(at)
        self._be_at_height(at)

    def _be_over(self, at: StageStatus) -> None:
        frame = self._settings.frame
        self.x_mm, self.along_mm = at.x_mm - frame.pad_centre_x_mm, at.y_mm - frame.pad_y_mm

    def _be_at_height(self, at: StageStatus) -> None:
        self.height_mm = at.z_mm - self._settings.frame.apex_z_mm
