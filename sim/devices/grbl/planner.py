"""Look-ahead motion planner with GRBL's rules: entry speeds by a backward and a forward pass.

A new plan (a hold, another move, an override) begins where the segments prepared so far end. Source: GRBL 1.1
interface wiki and the 1.1h firmware: planner.c (junction deviation, $11; per-axis limits, $110–122; overrides),
stepper.c (segments).
"""

from bisect import bisect_right
from dataclasses import dataclass
from itertools import dropwhile
from math import ceil, floor, inf, sqrt

# --- motion ---
#
# Motion is stored as pieces of constant acceleration, exact at any time.

Vec = tuple[float, float, float]
Counts = tuple[int, int, int]

HISTORY_S = 2.0
_PRUNE_OVER = 64
_NO_MOTION_MM = 1e-9


@dataclass(frozen=True, slots=True)
class ConstantAcceleration:
    """Constant acceleration along a path: duration in s, initial speed in mm/s, acceleration in mm/s²."""

    duration_s: float
    v0: float
    accel: float

    @property
    def mm(self) -> float:
        return (self.v0 + 0.5 * self.accel * self.duration_s) * self.duration_s

    def mm_at(self, tau_s: float) -> float:
        return (self.v0 + 0.5 * self.accel * tau_s) * tau_s

    def speed_at(self, tau_s: float) -> float:
        return max(self.v0 + self.accel * tau_s, 0.0)

    def until(self, tau_s: float) -> "ConstantAcceleration":
        return ConstantAcceleration(tau_s, self.v0, self.accel)


@dataclass(frozen=True, slots=True)
class Piece:
    """A ramp in time and space: origin in steps at t0_s, slope in steps per mm, done_mm behind it."""

    t0_s: float
    ramp: ConstantAcceleration
    origin: Vec
    slope: Vec
    done_mm: float = 0.0

    @property
    def t1_s(self) -> float:
        return self.t0_s + self.ramp.duration_s

    def mm_at(self, t_s: float) -> float:
        tau = min(max(t_s - self.t0_s, 0.0), self.ramp.duration_s)
        return self.ramp.mm_at(tau)

    def at(self, t_s: float) -> Vec:
        mm = self.mm_at(t_s)
        (x, y, z), (i, j, k) = self.origin, self.slope
        return (x + i * mm, y + j * mm, z + k * mm)


class Track:
    """Past and planned motion of a carriage, in steps; the last second of the past is stored.

    play is each screw's lost motion, in steps: the nut follows down at once, and up only after the play.
    """

    def __init__(self, rest: Counts, play: Vec = (0.0, 0.0, 0.0)) -> None:
        self._rest: Vec = rest
        self._play, self._has_play = play, any(play)
        self._nut_rest: Vec = rest
        self._nuts: list[Vec] = []  # at the start of each piece
        self._pieces: list[Piece] = []
        self._starts: list[float] = []
        self.end_s = 0.0

    def position_at(self, t_s: float) -> Vec:
        """Return the position of each axis at t_s in steps, not rounded."""
        if t_s >= self.end_s:
            return self._rest
        piece = self.piece_at(t_s)
        if piece is None:
            return self._pieces[0].origin if self._pieces else self._rest
        return piece.at(t_s)

    def counts_at(self, t_s: float) -> Counts:
        """Return whole steps at t_s."""
        x, y, z = self.position_at(t_s)
        return (round(x), round(y), round(z))

    def nut_at(self, t_s: float) -> Counts:
        """Return the nuts' whole steps at t_s: behind by the play where they were driven up last."""
        x, y, z = self.nut_position_at(t_s)
        return (round(x), round(y), round(z))

    def speed_at(self, t_s: float) -> float:
        """Return the speed along the path in mm/s."""
        piece = self.piece_at(t_s) if t_s < self.end_s else None
        if piece is None or t_s >= piece.t1_s:
            return 0.0
        return piece.ramp.speed_at(t_s - piece.t0_s)

    def piece_at(self, t_s: float) -> Piece | None:
        """Return the last piece that began by t_s."""
        index = bisect_right(self._starts, t_s) - 1
        return self._pieces[index] if index >= 0 else None

    def replace_from(self, t_s: float, pieces: list[Piece], rest: Vec) -> None:
        """Replace all motion after t_s by pieces, after which the carriage rests at `rest`."""
        nut = self.nut_position_at(t_s)
        self._cut(t_s)
        for piece in pieces:
            self._nuts.append(nut)
            nut = self._followed(nut, piece.at(piece.t1_s))
        self._nut_rest = self._followed(nut, rest)
        self._pieces += pieces
        self._starts += [piece.t0_s for piece in pieces]
        self._rest = rest
        self.end_s = pieces[-1].t1_s if pieces else t_s
        self._prune(t_s)

    def _cut(self, t_s: float) -> None:
        index = bisect_right(self._starts, t_s)
        del self._pieces[index:], self._starts[index:], self._nuts[index:]
        if self._pieces and self._pieces[-1].t1_s > t_s:
            last = self._pieces[-1]
            shorter = last.ramp.until(t_s - last.t0_s)
            self._pieces[-1] = Piece(last.t0_s, shorter, last.origin, last.slope, last.done_mm)

    def _prune(self, now_s: float) -> None:
        if len(self._pieces) > _PRUNE_OVER:
            old = bisect_right(self._starts, now_s - HISTORY_S) - 1
            if old > 0:
                del self._pieces[:old], self._starts[:old], self._nuts[:old]

    def nut_position_at(self, t_s: float) -> Vec:
        """Return the nuts' position at t_s in steps, not rounded: no axis reverses within a piece."""
        if t_s >= self.end_s:
            return self._nut_rest
        index = bisect_right(self._starts, t_s) - 1
        if index < 0:
            return self._nuts[0] if self._nuts else self._nut_rest
        return self._followed(self._nuts[index], self._pieces[index].at(t_s))

    def _followed(self, nut: Vec, screw: Vec) -> Vec:
        """Return the nut's position after one-way motion of the screw: pushed down, or pulled up behind the play."""
        if not self._has_play:
            return screw
        x, y, z = (min(max(n, s - play), s) for n, s, play in zip(nut, screw, self._play, strict=True))
        return (x, y, z)


def trapezoid(mm: float, v0: float, v1: float, cruise: float, accel: float) -> list[ConstantAcceleration]:
    """Return ramps over a distance from speed v0 to v1, within cruise (mm/s) and accel (mm/s²)."""
    if mm < _NO_MOTION_MM:
        return []
    top = sqrt(accel * mm + 0.5 * (v0 * v0 + v1 * v1))
    if top <= max(v0, v1) * (1 + 1e-12):
        # One ramp needs the whole length: rounding must not leave it short or long.
        return [ConstantAcceleration(2 * mm / (v0 + v1), v0, (v1 * v1 - v0 * v0) / (2 * mm))]
    peak = max(min(top, cruise), v0, v1)
    level_mm = mm - (2 * peak * peak - v0 * v0 - v1 * v1) / (2 * accel)
    ramps = [
        ConstantAcceleration((peak - v0) / accel, v0, accel),
        ConstantAcceleration(max(level_mm, 0.0) / peak, peak, 0.0),
        ConstantAcceleration((peak - v1) / accel, peak, -accel),
    ]
    return [ramp for ramp in ramps if ramp.duration_s > 0]


# --- blocks ---
#
# Source: the 1.1h firmware: planner.c (junction deviation, $11; limits, $110–122; overrides), stepper.c (segments).

# The firmware moves no slower than 1 mm/min, whatever F says.
SLOWEST_MM_S = 1 / 60
# The stepper receives segments of 10 ms, or of 1.25 steps where those take longer.
SEGMENT_S, SEGMENT_STEPS = 0.01, 1.25
_STRAIGHT = 0.999999


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Limits of each axis in steps/mm, mm/s and mm/s², and the junction deviation in mm."""

    steps_per_mm: Vec
    max_speed: Vec
    accel: Vec
    junction_mm: float


@dataclass(frozen=True, slots=True)
class Share:
    """Fraction of the requested speed under overrides, for feeds and rapids; jogs keep all of it."""

    feed: float = 1.0
    rapid: float = 1.0

    def of(self, speed: float, most: float, *, jog: bool) -> float:
        if speed == inf:
            return most * self.rapid
        return min(speed if jog else speed * self.feed, most)


@dataclass(slots=True)
class PlannerBlock:
    """Straight move at up to cruise speed; done_mm of it is complete, end_s is its planned end.

    asked is the requested speed before overrides (inf for a rapid), most the limit of the axes.
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
        """Return the duration of a segment at a speed in mm/s."""
        reached = max(speed, min(self.cruise, self.accel * SEGMENT_S))
        per_mm = max(abs(steps) for steps in self.slope)
        return SEGMENT_S * max(ceil(SEGMENT_STEPS / (per_mm * reached * SEGMENT_S) - 1e-9), 1)

    def at(self, done_mm: float) -> Vec:
        (x, y, z), (i, j, k) = self.start, self.slope
        return (x + i * done_mm, y + j * done_mm, z + k * done_mm)


def block_between(limits: AxisLimits, start: Counts, target: Counts, speed: float, jog: bool) -> PlannerBlock:
    """Return a move between two positions in steps, at up to speed (mm/s, inf for a rapid)."""
    steps = [b - a for a, b in zip(start, target, strict=True)]
    mm = [n / per for n, per in zip(steps, limits.steps_per_mm, strict=True)]
    length = sqrt(sum(d * d for d in mm))
    unit = (mm[0] / length, mm[1] / length, mm[2] / length)
    slope = (steps[0] / length, steps[1] / length, steps[2] / length)
    most, accel = _along(limits.max_speed, unit), _along(limits.accel, unit)
    return PlannerBlock(start, target, length, unit, slope, speed, most, jog, accel)


def _along(limit: Vec, unit: Vec) -> float:
    """Return the largest value along unit that keeps each axis within its own limit."""
    return min(most / abs(part) for most, part in zip(limit, unit, strict=True) if part)


def max_entry_sq(limits: AxisLimits, before: PlannerBlock, block: PlannerBlock) -> float:
    """Return the largest speed² at the junction of two blocks."""
    slower = min(before.cruise, block.cruise) ** 2
    cosine = sum(a * b for a, b in zip(before.unit, block.unit, strict=True))
    if cosine > _STRAIGHT:
        return slower
    if cosine < -_STRAIGHT:
        return 0.0
    return min(slower, _junction_sq(limits, before.unit, block.unit, cosine))


def _junction_sq(limits: AxisLimits, before: Vec, after: Vec, cosine: float) -> float:
    """Return the speed² at which a circle within the junction deviation needs the allowed acceleration."""
    turn = [b - a for a, b in zip(before, after, strict=True)]
    size = sqrt(sum(d * d for d in turn))
    accel = _along(limits.accel, (turn[0] / size, turn[1] / size, turn[2] / size))
    sine_half = sqrt(0.5 * (1 + cosine))
    return accel * limits.junction_mm * sine_half / (1 - sine_half)


BLOCKS = 15
_NEGLIGIBLE_MM, _NEGLIGIBLE_SQ = 1e-9, 1e-9
# Prepared segments, including the running one (stepper.h: a ring of 6, of which one stays free).
PREPARED = 5


class MotionPlanner:
    """Queue of up to 15 blocks on a track; positions are steps of the carriage."""

    def __init__(self, limits: AxisLimits, start: Counts, play: Vec = (0.0, 0.0, 0.0)) -> None:
        self.limits = limits
        self.track = Track(start, play)
        self._blocks: list[PlannerBlock] = []
        self._share = Share()
        self._begun_s = 0.0  # when the carriage last started from rest

    @property
    def end_s(self) -> float:
        """Planned time at which the carriage comes to rest."""
        return self.track.end_s

    def unfinished(self, now_s: float) -> int:
        """Return the number of unfinished blocks."""
        self._retire(now_s)
        return len(self._blocks)

    def next_end_s(self) -> float:
        """Return when the current block frees its slot."""
        return self._blocks[0].end_s if self._blocks else 0.0

    def queue(self, start: Counts, target: Counts, speed: float, now_s: float, *, jog: bool = False) -> bool:
        """Append a move at up to speed (mm/s, inf for a rapid) and replan; return False if it has no length."""
        self._retire(now_s)
        if start == target:
            return False
        block = block_between(self.limits, start, target, speed, jog)
        block.obey(self._share)
        if self._blocks:
            block.max_entry_sq = max_entry_sq(self.limits, self._blocks[-1], block)
        self._blocks.append(block)
        self._plan_anew(now_s)
        return True

    def hold(self, now_s: float) -> None:
        """Brake along the path after the prepared segments at the blocks' own acceleration; keep the queue."""
        self._retire(now_s)
        from_s, left = self._unprepared(now_s)
        pieces, stop = self._braking(from_s, self.track.speed_at(from_s), left)
        self.track.replace_from(from_s, pieces, stop)

    def override(self, share: Share, now_s: float, *, moving: bool) -> None:
        """Apply fractions of their speeds to all blocks, including the current one; jogs keep theirs."""
        self._retire(now_s)
        self._share = share
        left = self._unprepared(now_s)[1] if moving else self._blocks
        for i, block in enumerate(left):
            block.obey(share)
            if i:
                block.max_entry_sq = max_entry_sq(self.limits, left[i - 1], block)
        if moving:
            self._plan_anew(now_s)

    def resume(self, now_s: float) -> bool:
        """Continue from rest; return False if the queue is empty."""
        self._retire(now_s)
        self._begun_s = now_s
        self._plan(now_s, 0.0, self._blocks)
        return bool(self._blocks)

    def follow(self, pieces: list[Piece], rest: Counts, now_s: float) -> None:
        """Run a motion that is planned elsewhere, such as homing."""
        self.track.replace_from(now_s, pieces, rest)

    def halt(self, now_s: float, slip_steps: int = 0) -> Counts:
        """Stop stepping at once and drop the queue.

        Returns the slip: how far inertia carries each moving axis past its last step.
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

    def _unprepared(self, now_s: float) -> tuple[float, list[PlannerBlock]]:
        """Return the end of the prepared segments and the blocks unfinished by then, with their progress."""
        from_s = self._prepared_s(now_s)
        left = list(dropwhile(lambda block: block.end_s <= from_s, self._blocks))
        if left and from_s < self.end_s:
            piece = self.track.piece_at(from_s)
            assert piece is not None
            left[0].done_mm = piece.done_mm + piece.mm_at(from_s)
        return from_s, left

    def _prepared_s(self, now_s: float) -> float:
        if now_s >= self.end_s or not self._blocks:
            self._begun_s = now_s
            return now_s
        segment_s = self._blocks[0].segment_s(self.track.speed_at(now_s))
        running = floor((now_s - self._begun_s) / segment_s + 1e-9)
        return min(self._begun_s + (running + PREPARED) * segment_s, self.end_s)

    def _plan_anew(self, now_s: float) -> None:
        from_s, left = self._unprepared(now_s)
        self._plan(from_s, self.track.speed_at(from_s), left)

    def _plan(self, from_s: float, speed: float, blocks: list[PlannerBlock]) -> None:
        pieces: list[Piece] = []
        rest = self.track.position_at(from_s)
        t_s, entry_sq = from_s, speed * speed
        for block, exit_sq in zip(blocks, _exit_speeds_sq(blocks, entry_sq), strict=True):
            t_s = _lay(block, _ramps(block, entry_sq, exit_sq), t_s, pieces)
            block.end_s, rest, entry_sq = t_s, block.target, exit_sq
        self.track.replace_from(from_s, pieces, rest)

    def _braking(self, from_s: float, speed: float, blocks: list[PlannerBlock]) -> tuple[list[Piece], Vec]:
        pieces: list[Piece] = []
        t_s, speed_sq = from_s, speed * speed
        for block in blocks:
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
        return pieces, blocks[-1].target if blocks else self.track.position_at(from_s)


def _exit_speeds_sq(blocks: list[PlannerBlock], entry_sq: float) -> list[float]:
    exits = [0.0] * len(blocks)
    for i in range(len(blocks) - 1, 0, -1):
        exits[i - 1] = min(blocks[i].max_entry_sq, exits[i] + 2 * blocks[i].accel * blocks[i].mm)
    for i, block in enumerate(blocks):
        most_by = 2 * block.accel * (block.mm - block.done_mm)
        exits[i] = min(exits[i], entry_sq + most_by)
        if entry_sq - most_by > exits[i] + _NEGLIGIBLE_SQ:
            exits[i] = entry_sq - most_by  # an override took effect too late for this block
        entry_sq = exits[i]
    return exits


def _ramps(block: PlannerBlock, entry_sq: float, exit_sq: float) -> list[ConstantAcceleration]:
    """Return the remaining ramps of a block; above its cruise speed, as after an override, it brakes first."""
    mm, v0, v1 = block.mm - block.done_mm, sqrt(entry_sq), sqrt(exit_sq)
    top = max(block.cruise, v1)
    slowing_mm = (entry_sq - top * top) / (2 * block.accel)
    if not _NEGLIGIBLE_MM < slowing_mm < mm:
        return trapezoid(mm, v0, v1, block.cruise, block.accel)
    slowing = ConstantAcceleration((v0 - top) / block.accel, v0, -block.accel)
    return [slowing, *trapezoid(mm - slowing_mm, top, v1, block.cruise, block.accel)]


def _lay(block: PlannerBlock, ramps: list[ConstantAcceleration], t_s: float, pieces: list[Piece]) -> float:
    """Append ramps of a block to the pieces; return their end time."""
    done_mm = block.done_mm
    for ramp in ramps:
        piece = Piece(t_s, ramp, block.at(done_mm), block.slope, done_mm)
        pieces.append(piece)
        t_s, done_mm = piece.t1_s, done_mm + ramp.mm
    return t_s
