"""Where the indentor is, and motions that are watched: one is begun, and looked at until the indentor is there."""

import math
from collections.abc import Callable
from contextlib import suppress

from rig.devices.stage.base import Looks, Stage, StageHeld, StageOverridden, StageStatus, is_held
from rig.engine.rig_settings import RigSettings

_ATTEMPTS = 5


class FeltError(Exception):
    """What was felt or changed while something moved must end the motion; the stage is at rest again."""

    def __init__(self, reason: str, force_gwt: float | None = None) -> None:
        super().__init__(reason)
        self.force_gwt = force_gwt


class TouchError(FeltError):
    """A touch where it only ends the motion."""


def insist(lift: Callable[[], None]) -> None:
    """Go up from a trip. Somebody who changes the speed meanwhile does not keep it down: it goes on at full speed."""
    for _ in range(_ATTEMPTS - 1):
        with suppress(FeltError):
            return lift()
    return lift()


class Motion:
    """A stage over one finger: x, along and height above the pad's nominal apex, mm; nan where it is not known."""

    def __init__(self, settings: RigSettings, stage: Stage, glance: Callable[[], None]) -> None:
        """glance: what is done at each look at the stage; a FeltError from it brings the stage to rest."""
        self._settings, self._stage, self._glance = settings, stage, glance
        self.x_mm, self.along_mm, self.height_mm = math.nan, 0.0, math.nan
        self.begun = False  # whether anything was ever told to move

    def home(self) -> None:
        """Find the switches. Raises StageError, and what a glance raises."""
        self._watched(self._stage.homing(), lambda at: None, self._stage.stop)
        at = self._stage.status()
        self._be_over(at)
        self._be_at_height(at)

    def aside(self, x_mm: float, along_mm: float, speed_mm_s: float) -> None:
        """To another place at this height. Raises StageError, and what a glance raises."""
        frame = self._settings.frame
        x, y = frame.pad_centre_x_mm + x_mm, frame.pad_y_mm + along_mm
        self._watched(self._stage.moving(x_mm=x, y_mm=y, speed_mm_s=speed_mm_s), self._be_over, self._stage.halt)
        self.x_mm, self.along_mm = x_mm, along_mm

    def to_height(self, height_mm: float, speed_mm_s: float) -> None:
        """Straight up or down. Raises StageError, and what a glance raises."""
        z = self._settings.frame.apex_z_mm + height_mm
        self._watched(self._stage.moving(z_mm=z, speed_mm_s=speed_mm_s), self._be_at_height, self._stage.halt)
        self.height_mm = height_mm

    def _watched(self, looks: Looks, seen: Callable[[StageStatus], None], halt: Callable[[], None]) -> None:
        self.begun = True
        try:
            for at in looks:
                if at is not None:
                    seen(at)
                    if is_held(at.state):
                        raise StageHeld(at.state)
                self._felt(seen, halt)
        except StageOverridden as error:
            self._come_to_rest(seen, self._stage.halt)
            raise FeltError(str(error)) from error

    def _felt(self, seen: Callable[[StageStatus], None], halt: Callable[[], None]) -> None:
        try:
            self._glance()
        except FeltError:
            self._come_to_rest(seen, halt)
            raise

    def _come_to_rest(self, seen: Callable[[StageStatus], None], halt: Callable[[], None]) -> None:
        halt()
        if self._stage.homed:
            seen(self._stage.status())

    def _be_over(self, at: StageStatus) -> None:
        frame = self._settings.frame
        self.x_mm, self.along_mm = at.x_mm - frame.pad_centre_x_mm, at.y_mm - frame.pad_y_mm

    def _be_at_height(self, at: StageStatus) -> None:
        self.height_mm = at.z_mm - self._settings.frame.apex_z_mm
