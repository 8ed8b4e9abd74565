"""Where a protocol presses: by its own schedule, or over a range, so that the simulation covers a recording."""

import math
from collections.abc import Sequence

from pydantic import Field, model_validator

from rig.errors import RuleError
from rig.protocol.api import ProtocolParameters

SPACING_MM = 0.17
"""Of the source's schedules, and of a range where nothing else is asked for."""

_DECIMALS = 3
_MOST_POSITIONS = 500


class RangeParameters(ProtocolParameters):
    """Base of the `Parameters` of a script that is stepped across the pad."""

    from_mm: float | None = Field(None, ge=-20, le=20, description="x of a range instead of the schedule")
    to_mm: float | None = Field(None, ge=-20, le=20, description="x where it ends")
    spacing_mm: float | None = Field(None, gt=0, le=5, description="largest step of the range; 0.17 by default")

    @model_validator(mode="after")
    def _whole(self) -> "RangeParameters":
        """Both ends or neither, apart, and no spacing of a range that is not asked for."""
        begin, end = self.from_mm, self.to_mm
        if begin is None and end is None:
            if self.spacing_mm is not None:
                raise RuleError("spacing_mm = {spacing_mm:g}: expected from_mm and to_mm beside it",
                                code="spacing_of_no_range", spacing_mm=self.spacing_mm)  # fmt: skip
        elif begin is None or end is None:
            given, missing = ("to_mm", "from_mm") if begin is None else ("from_mm", "to_mm")
            raise RuleError("{given} without {missing}: expected both ends of the range", code="half_a_range",
                            given=given, missing=missing)  # fmt: skip
        elif begin == end:
            raise RuleError("from_mm = {from_mm:g}, to_mm = {to_mm:g}: expected two ends that differ",
                            code="empty_range", from_mm=begin, to_mm=end)  # fmt: skip
        elif self._steps(begin, end) >= _MOST_POSITIONS:
            raise RuleError("{positions} positions: expected {high} or fewer", code="too_many_positions",
                            positions=self._steps(begin, end) + 1, high=_MOST_POSITIONS)  # fmt: skip
        return self

    def _steps(self, begin: float, end: float) -> int:
        return math.ceil(abs(end - begin) / (self.spacing_mm or SPACING_MM) - 1e-9)

    def positions(self, schedule: Sequence[float]) -> tuple[float, ...]:
        """x in mm from one end of the range to the other, in equal steps; the schedule where no range is given."""
        begin, end = self.from_mm, self.to_mm
        if begin is None or end is None:
            return tuple(schedule)
        n = self._steps(begin, end)
        return tuple(round(begin + (end - begin) * k / n, _DECIMALS) for k in range(n + 1))


def about_the_centre(positions: int) -> tuple[float, ...]:
    """So many x in mm, decreasing, 0.17 apart about the pad's centre."""
    return tuple(round(SPACING_MM * (0.5 * (positions - 1) - k), _DECIMALS) for k in range(positions))
