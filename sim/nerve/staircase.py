"""Depth of an indentor that a stage moves from one known position to the next, with a rest after each move."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import ArgumentError
from sim.nerve.stimulus import Stimulus

Array = NDArray[np.float64]


class Staircase(Stimulus):
    """Depth against time through known positions, as a rig's journal has them.

    Each move begins when the position before it is known, at constant acceleration, speed and deceleration; then the
    indentor rests. A move that would not end before the next position is known is as much faster. Depths of 0 or less
    are out of contact; the first speed is not used. Raises ArgumentError if the times do not ascend, or a number is
    not finite.
    """

    def __init__(
        self,
        times_s: Sequence[float],
        depths_mm: Sequence[float],
        speeds_mm_s: Sequence[float],
        acceleration_mm_s2: float,
    ) -> None:
        super().__init__(times_s, depths_mm)
        if not len(speeds_mm_s) == len(times_s) or not acceleration_mm_s2 > 0:
            raise ArgumentError("a staircase needs a speed for each position", "bad_stimulus")
        self._speeds_mm_s, self._acceleration_mm_s2 = np.array(speeds_mm_s, dtype=float), acceleration_mm_s2
        steps, room_s = np.diff(self.depths_mm), np.diff(self.times_s)
        length = np.abs(steps)
        speed = np.minimum(self._speeds_mm_s[1:], np.sqrt(length * acceleration_mm_s2))
        moving = length > 0
        speed = np.where(moving, speed, 1.0)
        lasts = np.where(moving, length / speed + speed / acceleration_mm_s2, 0.0)
        faster = np.maximum(lasts / room_s, 1.0)
        self._sign, self._length = np.sign(steps), length
        self._speed = np.where(moving, speed * faster, 0.0)
        self._gain = acceleration_mm_s2 * faster**2
        self._ramp_s, self._lasts_s = self._speed / self._gain, lasts / faster

    def later(self, by_s: float) -> "Staircase":
        """Return the same moves, later by a time (s)."""
        return Staircase(
            (self.times_s + by_s).tolist(),
            self.depths_mm.tolist(),
            self._speeds_mm_s.tolist(),
            self._acceleration_mm_s2,
        )

    @property
    def fastest_in_contact_mm_s(self) -> float:
        """Highest speed of a move deeper into the skin (mm/s)."""
        into = (self._sign > 0) & (self.depths_mm[1:] > 0)
        return float(max(self._speed[into], default=0.0))

    def depth_mm(self, t_s: ArrayLike) -> Array:
        """Return depths at times (mm)."""
        t = np.asarray(t_s, dtype=float)
        k = np.clip(np.searchsorted(self.times_s, t, side="right") - 1, 0, len(self._length) - 1)
        since, ramp, gain = t - self.times_s[k], self._ramp_s[k], self._gain[k]
        left = self._lasts_s[k] - since
        gone = np.where(left < ramp, self._length[k] - gain * left**2 / 2, self._speed[k] * (since - ramp / 2))
        gone = np.where(since < ramp, gain * since**2 / 2, gone)
        gone = np.where(left <= 0, self._length[k], np.where(since > 0, gone, 0.0))
        return np.asarray(self.depths_mm[k] + self._sign[k] * gone)
