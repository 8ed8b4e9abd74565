"""The straight moves of a GRBL board's queue: how fast each may go, and how fast it may be entered.

Source: the 1.1h firmware: planner.c (junction deviation, $11; limits, $110–122; overrides), stepper.c (segments).
"""

from dataclasses import dataclass
from math import ceil, inf, sqrt

from sim.devices.grbl.motion import Counts, Vec

# The firmware moves no slower than 1 mm/min, whatever F says.
SLOWEST_MM_S = 1 / 60
# The stepper is fed by segments of 10 ms, or of 1.25 steps where that takes longer.
SEGMENT_S, SEGMENT_STEPS = 0.01, 1.25
_STRAIGHT = 0.999999


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Per axis: steps/mm, mm/s, mm/s²; the junction deviation in mm."""

    steps_per_mm: Vec
    max_speed: Vec
    accel: Vec
    junction_mm: float


@dataclass(frozen=True, slots=True)
class Share:
    """Of the speed asked for, as overrides leave it: of a feed, and of a rapid. A jog has the whole of it."""

    feed: float = 1.0
    rapid: float = 1.0

    def of(self, speed: float, most: float, *, jog: bool) -> float:
        if speed == inf:
            return most * self.rapid
        return min(speed if jog else speed * self.feed, most)


@dataclass(slots=True)
class Block:
    """One straight move at up to cruise; done_mm of it lie behind, end_s is when it will be over.

    asked is the speed before overrides (inf for a rapid), most what the axes allow.
    """

    start: Counts
    target: Counts
    mm: float
    unit: Vec
    slope: Vec
    asked: float
    most: float
    jog: bool
    accel: float
    cruise: float = 0.0
    max_entry_sq: float = 0.0
    done_mm: float = 0.0
    end_s: float = inf

    def obey(self, share: Share) -> None:
        self.cruise = max(share.of(self.asked, self.most, jog=self.jog), SLOWEST_MM_S)

    def segment_s(self, speed: float) -> float:
        """How long a segment is at a speed in mm/s."""
        reached = max(speed, min(self.cruise, self.accel * SEGMENT_S))
        per_mm = max(abs(steps) for steps in self.slope)
        return SEGMENT_S * max(ceil(SEGMENT_STEPS / (per_mm * reached * SEGMENT_S) - 1e-9), 1)

    def at(self, done_mm: float) -> Vec:
        (x, y, z), (i, j, k) = self.start, self.slope
        return (x + i * done_mm, y + j * done_mm, z + k * done_mm)


def block_between(limits: AxisLimits, start: Counts, target: Counts, speed: float, jog: bool) -> Block:
    """A move from one place in steps to another, at up to speed (mm/s, inf for a rapid)."""
    steps = [b - a for a, b in zip(start, target, strict=True)]
    mm = [n / per for n, per in zip(steps, limits.steps_per_mm, strict=True)]
    length = sqrt(sum(d * d for d in mm))
    unit = (mm[0] / length, mm[1] / length, mm[2] / length)
    slope = (steps[0] / length, steps[1] / length, steps[2] / length)
    most, accel = _along(limits.max_speed, unit), _along(limits.accel, unit)
    return Block(start, target, length, unit, slope, speed, most, jog, accel)


def _along(limit: Vec, unit: Vec) -> float:
    """The largest value along unit that keeps each axis within its own limit."""
    return min(most / abs(part) for most, part in zip(limit, unit, strict=True) if part)


def max_entry_sq(limits: AxisLimits, before: Block, block: Block) -> float:
    """Speed² at which a block may be entered from the one before it."""
    slower = min(before.cruise, block.cruise) ** 2
    cosine = sum(a * b for a, b in zip(before.unit, block.unit, strict=True))
    if cosine > _STRAIGHT:
        return slower
    if cosine < -_STRAIGHT:
        return 0.0
    return min(slower, _junction_sq(limits, before.unit, block.unit, cosine))


def _junction_sq(limits: AxisLimits, before: Vec, after: Vec, cosine: float) -> float:
    """Speed² at which a circle that cuts the corner by the junction deviation needs the allowed accel."""
    turn = [b - a for a, b in zip(before, after, strict=True)]
    size = sqrt(sum(d * d for d in turn))
    accel = _along(limits.accel, (turn[0] / size, turn[1] / size, turn[2] / size))
    sine_half = sqrt(0.5 * (1 + cosine))
    return accel * limits.junction_mm * sine_half / (1 - sine_half)
