"""Look-ahead motion planner with GRBL's rules: entry speeds by a backward and a forward pass.

Source: GRBL 1.1 interface wiki and firmware behaviour (junction deviation, $11; per-axis limits, $110–122).
"""

from dataclasses import dataclass
from math import inf, sqrt

from sim.devices.grbl.motion import Counts, Piece, Ramp, Track, Vec, trapezoid

BLOCKS = 15
# The firmware moves no slower than 1 mm/min, whatever F says.
SLOWEST_MM_S = 1 / 60
_STRAIGHT = 0.999999


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Per axis: steps/mm, mm/s, mm/s²; the junction deviation in mm."""

    steps_per_mm: Vec
    max_speed: Vec
    accel: Vec
    junction_mm: float


@dataclass(slots=True)
class Block:
    """One straight move; done_mm of it lie behind, end_s is when it will be over."""

    start: Counts
    target: Counts
    mm: float
    unit: Vec
    slope: Vec
    cruise: float
    accel: float
    max_entry_sq: float = 0.0
    done_mm: float = 0.0
    end_s: float = inf

    def at(self, done_mm: float) -> Vec:
        (x, y, z), (i, j, k) = self.start, self.slope
        return (x + i * done_mm, y + j * done_mm, z + k * done_mm)


class Planner:
    """A queue of up to 15 blocks on a track; positions are steps of the carriage."""

    def __init__(self, limits: AxisLimits, start: Counts, play: Vec = (0.0, 0.0, 0.0)) -> None:
        self.limits = limits
        self.track = Track(start, play)
        self._blocks: list[Block] = []

    @property
    def end_s(self) -> float:
        """When the carriage comes to rest, as planned now."""
        return self.track.end_s

    def unfinished(self, now_s: float) -> int:
        """Blocks not yet over."""
        self._retire(now_s)
        return len(self._blocks)

    def next_end_s(self) -> float:
        """When the block under way frees its place."""
        return self._blocks[0].end_s if self._blocks else 0.0

    def queue(self, start: Counts, target: Counts, speed: float, now_s: float) -> bool:
        """Append a move at up to speed (mm/s, inf for a rapid) and plan again; False if it is no move."""
        self._retire(now_s)
        if start == target:
            return False
        block = _block(self.limits, start, target, speed)
        if self._blocks:
            block.max_entry_sq = _max_entry_sq(self.limits, self._blocks[-1], block)
        self._note_progress(now_s)
        self._blocks.append(block)
        self._plan(now_s, self.track.speed_at(now_s))
        return True

    def hold(self, now_s: float) -> None:
        """Slow down along the path at the blocks' own acceleration, to a stop; the queue is kept."""
        self._retire(now_s)
        self._note_progress(now_s)
        pieces, stop = self._braking(now_s, self.track.speed_at(now_s))
        self.track.replace_from(now_s, pieces, stop)

    def resume(self, now_s: float) -> bool:
        """Go on from rest; False if nothing is queued."""
        self._retire(now_s)
        self._plan(now_s, 0.0)
        return bool(self._blocks)

    def follow(self, pieces: list[Piece], rest: Counts, now_s: float) -> None:
        """Run a motion that is not planned here, such as homing."""
        self.track.replace_from(now_s, pieces, rest)

    def halt(self, now_s: float, slip_steps: int = 0) -> Counts:
        """No more steps from this instant, queue dropped.

        Returns the slip: what inertia carries each axis that was moving past the last step it was sent.
        """
        piece = self.track.piece_at(now_s)
        slope = piece.slope if piece and now_s < piece.t1_s else (0.0, 0.0, 0.0)
        x, y, z = self.track.counts_at(now_s)
        i, j, k = (slip_steps * ((along > 0) - (along < 0)) for along in slope)
        self.track.replace_from(now_s, [], (x + i, y + j, z + k))
        self._blocks.clear()
        return (i, j, k)

    def _retire(self, now_s: float) -> None:
        while self._blocks and self._blocks[0].end_s <= now_s:
            del self._blocks[0]

    def _note_progress(self, now_s: float) -> None:
        if self._blocks and now_s < self.end_s:
            piece = self.track.piece_at(now_s)
            assert piece is not None
            self._blocks[0].done_mm = piece.done_mm + piece.mm_at(now_s)

    def _plan(self, now_s: float, speed: float) -> None:
        pieces: list[Piece] = []
        rest = self.track.position_at(now_s)
        t_s, entry_sq = now_s, speed * speed
        for block, exit_sq in zip(self._blocks, _exit_speeds_sq(self._blocks, entry_sq), strict=True):
            ramps = trapezoid(block.mm - block.done_mm, sqrt(entry_sq), sqrt(exit_sq), block.cruise, block.accel)
            t_s = _lay(block, ramps, t_s, pieces)
            block.end_s, rest, entry_sq = t_s, block.target, exit_sq
        self.track.replace_from(now_s, pieces, rest)

    def _braking(self, now_s: float, speed: float) -> tuple[list[Piece], Vec]:
        pieces: list[Piece] = []
        t_s, speed_sq = now_s, speed * speed
        for block in self._blocks:
            needed_mm = speed_sq / (2 * block.accel)
            mm = min(needed_mm, block.mm - block.done_mm)
            exit_sq = max(speed_sq - 2 * block.accel * mm, 0.0) if mm < needed_mm else 0.0
            ramps = trapezoid(mm, sqrt(speed_sq), sqrt(exit_sq), block.cruise, block.accel)
            t_s = _lay(block, ramps, t_s, pieces)
            if mm == needed_mm:
                block.done_mm += mm
                block.end_s = inf
                return pieces, block.at(block.done_mm)
            block.end_s, speed_sq = t_s, exit_sq
        return pieces, self._blocks[-1].target if self._blocks else self.track.position_at(now_s)


def _block(limits: AxisLimits, start: Counts, target: Counts, speed: float) -> Block:
    steps = [b - a for a, b in zip(start, target, strict=True)]
    mm = [n / per for n, per in zip(steps, limits.steps_per_mm, strict=True)]
    length = sqrt(sum(d * d for d in mm))
    unit = (mm[0] / length, mm[1] / length, mm[2] / length)
    slope = (steps[0] / length, steps[1] / length, steps[2] / length)
    cruise = max(min(speed, _along(limits.max_speed, unit)), SLOWEST_MM_S)
    return Block(start, target, length, unit, slope, cruise, _along(limits.accel, unit))


def _along(limit: Vec, unit: Vec) -> float:
    """The largest value along unit that keeps each axis within its own limit."""
    return min(most / abs(part) for most, part in zip(limit, unit, strict=True) if part)


def _max_entry_sq(limits: AxisLimits, before: Block, block: Block) -> float:
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


def _exit_speeds_sq(blocks: list[Block], entry_sq: float) -> list[float]:
    exits = [0.0] * len(blocks)
    for i in range(len(blocks) - 1, 0, -1):
        exits[i - 1] = min(blocks[i].max_entry_sq, exits[i] + 2 * blocks[i].accel * blocks[i].mm)
    for i, block in enumerate(blocks):
        exits[i] = min(exits[i], entry_sq + 2 * block.accel * (block.mm - block.done_mm))
        entry_sq = exits[i]
    return exits


def _lay(block: Block, ramps: list[Ramp], t_s: float, pieces: list[Piece]) -> float:
    """Put ramps on a block one after another; returns when the last one is over."""
    done_mm = block.done_mm
    for ramp in ramps:
        piece = Piece(t_s, ramp, block.at(done_mm), block.slope, done_mm)
        pieces.append(piece)
        t_s, done_mm = piece.t1_s, done_mm + ramp.mm
    return t_s
