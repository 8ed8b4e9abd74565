"""Look-ahead motion planner with GRBL's rules: entry speeds by a backward and a forward pass.

What is planned anew (a hold, another move, an override) begins where the segments end that are prepared already.
Source: GRBL 1.1 interface wiki and the 1.1h firmware: planner.c (junction deviation, $11; per-axis limits, $110–122;
overrides), stepper.c (segments).
"""

from itertools import dropwhile
from math import floor, inf, sqrt

from sim.devices.grbl.blocks import AxisLimits, Block, Share, block_between, max_entry_sq
from sim.devices.grbl.motion import Counts, Piece, Ramp, Track, Vec, trapezoid

BLOCKS = 15
_NEGLIGIBLE_MM, _NEGLIGIBLE_SQ = 1e-9, 1e-9
# Segments that lie ready, the one that is being stepped included (stepper.h: a ring of 6, of which one stays free).
PREPARED = 5


class Planner:
    """A queue of up to 15 blocks on a track; positions are steps of the carriage."""

    def __init__(self, limits: AxisLimits, start: Counts, play: Vec = (0.0, 0.0, 0.0)) -> None:
        self.limits = limits
        self.track = Track(start, play)
        self._blocks: list[Block] = []
        self._share = Share()
        self._begun_s = 0.0  # when the carriage last set out from rest

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

    def queue(self, start: Counts, target: Counts, speed: float, now_s: float, *, jog: bool = False) -> bool:
        """Append a move at up to speed (mm/s, inf for a rapid) and plan again; False if it is no move."""
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
        """Once the segments run out, slow down along the path at the blocks' own acceleration; the queue is kept."""
        self._retire(now_s)
        from_s, left = self._unprepared(now_s)
        pieces, stop = self._braking(from_s, self.track.speed_at(from_s), left)
        self.track.replace_from(from_s, pieces, stop)

    def override(self, share: Share, now_s: float, *, moving: bool) -> None:
        """From now on blocks go at these shares of their speeds, the one under way too; jogs do not."""
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
        """Go on from rest; False if nothing is queued."""
        self._retire(now_s)
        self._begun_s = now_s
        self._plan(now_s, 0.0, self._blocks)
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

    def _unprepared(self, now_s: float) -> tuple[float, list[Block]]:
        """When the prepared segments end, and the blocks not over by then; the first one's progress is noted."""
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

    def _plan(self, from_s: float, speed: float, blocks: list[Block]) -> None:
        pieces: list[Piece] = []
        rest = self.track.position_at(from_s)
        t_s, entry_sq = from_s, speed * speed
        for block, exit_sq in zip(blocks, _exit_speeds_sq(blocks, entry_sq), strict=True):
            t_s = _lay(block, _ramps(block, entry_sq, exit_sq), t_s, pieces)
            block.end_s, rest, entry_sq = t_s, block.target, exit_sq
        self.track.replace_from(from_s, pieces, rest)

    def _braking(self, from_s: float, speed: float, blocks: list[Block]) -> tuple[list[Piece], Vec]:
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


def _exit_speeds_sq(blocks: list[Block], entry_sq: float) -> list[float]:
    exits = [0.0] * len(blocks)
    for i in range(len(blocks) - 1, 0, -1):
        exits[i - 1] = min(blocks[i].max_entry_sq, exits[i] + 2 * blocks[i].accel * blocks[i].mm)
    for i, block in enumerate(blocks):
        most_by = 2 * block.accel * (block.mm - block.done_mm)
        exits[i] = min(exits[i], entry_sq + most_by)
        if entry_sq - most_by > exits[i] + _NEGLIGIBLE_SQ:
            exits[i] = entry_sq - most_by  # an override came too late for this block
        entry_sq = exits[i]
    return exits


def _ramps(block: Block, entry_sq: float, exit_sq: float) -> list[Ramp]:
    """What is left of a block; faster than its cruise, as an override may find it, it slows down first."""
    mm, v0, v1 = block.mm - block.done_mm, sqrt(entry_sq), sqrt(exit_sq)
    top = max(block.cruise, v1)
    slowing_mm = (entry_sq - top * top) / (2 * block.accel)
    if not _NEGLIGIBLE_MM < slowing_mm < mm:
        return trapezoid(mm, v0, v1, block.cruise, block.accel)
    slowing = Ramp((v0 - top) / block.accel, v0, -block.accel)
    return [slowing, *trapezoid(mm - slowing_mm, top, v1, block.cruise, block.accel)]


def _lay(block: Block, ramps: list[Ramp], t_s: float, pieces: list[Piece]) -> float:
    """Put ramps on a block one after another; returns when the last one is over."""
    done_mm = block.done_mm
    for ramp in ramps:
        piece = Piece(t_s, ramp, block.at(done_mm), block.slope, done_mm)
        pieces.append(piece)
        t_s, done_mm = piece.t1_s, done_mm + ramp.mm
    return t_s
