"""Corridor of a motion: positions that a stage may report between start and target, given its speed.

The corridor is the second layer against a corrupted command and against a stage that does not stop. The first is that
a driver confirms commands before motion; the force is monitored in addition.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rig.devices.base import StageStatus
from rig.errors import EngineError

PRINTED_MM = 0.003
"""Rounding of a controller's reports, and error of a drive's feedback beyond one step (mm)."""

_AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Corridor:
    """Corridor of one motion, in machine mm: a box, since two axes move together only laterally, at clearance.

    A report may lie `tolerance_mm` outside, and each axis go `overrun_mm` beyond the target in its positive
    direction: twice its backlash. `begun_s`, when the command was sent, is on the clock of `strayed`.
    """

    start_mm: Sequence[float]
    target_mm: Sequence[float]
    speed_mm_s: float
    begun_s: float
    tolerance_mm: float
    overrun_mm: Sequence[float] = (0.0, 0.0, 0.0)

    def strayed(self, at: StageStatus, now_s: float) -> EngineError | None:
        """Return an error if a reported position lies outside the corridor, else None.

        The stage was there when the report arrived, at `now_s`, or earlier.
        """
        gone_mm = 0.0
        ways = zip(_AXES, (at.x_mm, at.y_mm, at.z_mm), self.start_mm, self.target_mm, self.overrun_mm, strict=True)
        for axis, is_mm, start_mm, target_mm, overrun_mm in ways:
            lowest_mm = min(start_mm, target_mm) - self.tolerance_mm
            highest_mm = max(start_mm, target_mm + (overrun_mm if target_mm > start_mm else 0.0)) + self.tolerance_mm
            if not lowest_mm <= is_mm <= highest_mm:
                return EngineError(
                    f"{_commanded(axis, start_mm, target_mm)}, but the stage reports {axis} = {is_mm:.3f} mm",
                    "off_its_way",
                )
            gone_mm = max(gone_mm, abs(is_mm - start_mm))
        lasted_s = now_s - self.begun_s
        if gone_mm > self.speed_mm_s * lasted_s + self.tolerance_mm:
            return EngineError(
                f"commanded {self.speed_mm_s:g} mm/s, but the stage reports {gone_mm:.3f} mm after {lasted_s:.3f} s",
                "ahead_of_its_speed",
            )
        return None


def _commanded(axis: str, start_mm: float, target_mm: float) -> str:
    if math.isclose(start_mm, target_mm, abs_tol=1e-9):
        return f"commanded no motion of {axis} at {start_mm:.3f} mm"
    return f"commanded {axis} from {start_mm:.3f} to {target_mm:.3f} mm"
