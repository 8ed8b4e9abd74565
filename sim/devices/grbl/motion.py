"""Where a carriage is and was: pieces of constant acceleration, exact at any instant."""

from bisect import bisect_right
from dataclasses import dataclass
from math import sqrt

Vec = tuple[float, float, float]
Counts = tuple[int, int, int]

HISTORY_S = 2.0
_PRUNE_OVER = 64
_NEGLIGIBLE_MM = 1e-9


@dataclass(frozen=True, slots=True)
class Ramp:
    """Constant acceleration along a path: duration in s, speed at the start in mm/s, accel in mm/s²."""

    duration_s: float
    v0: float
    accel: float

    @property
    def mm(self) -> float:
        return (self.v0 + 0.5 * self.accel * self.duration_s) * self.duration_s


@dataclass(frozen=True, slots=True)
class Piece:
    """One ramp in time and space: origin in steps at t0_s, slope in steps per mm, done_mm behind it."""

    t0_s: float
    ramp: Ramp
    origin: Vec
    slope: Vec
    done_mm: float = 0.0

    @property
    def t1_s(self) -> float:
        return self.t0_s + self.ramp.duration_s

    def mm_at(self, t_s: float) -> float:
        tau = min(max(t_s - self.t0_s, 0.0), self.ramp.duration_s)
        return (self.ramp.v0 + 0.5 * self.ramp.accel * tau) * tau

    def at(self, t_s: float) -> Vec:
        mm = self.mm_at(t_s)
        (x, y, z), (i, j, k) = self.origin, self.slope
        return (x + i * mm, y + j * mm, z + k * mm)


class Track:
    """The past and the planned future of a carriage, in steps; at least one second of past is kept.

    play is each screw's lost motion, in steps: what hangs on it follows down at once, and up only once the play is
    taken up.
    """

    def __init__(self, rest: Counts, play: Vec = (0.0, 0.0, 0.0)) -> None:
        self._rest: Vec = rest
        self._play = play
        self._nut_rest: Vec = rest
        self._nuts: list[Vec] = []  # at the start of each piece
        self._pieces: list[Piece] = []
        self._starts: list[float] = []
        self.end_s = 0.0

    def position_at(self, t_s: float) -> Vec:
        """Steps of each axis at t_s, not rounded."""
        if t_s >= self.end_s:
            return self._rest
        piece = self.piece_at(t_s)
        if piece is None:
            return self._pieces[0].origin if self._pieces else self._rest
        return piece.at(t_s)

    def counts_at(self, t_s: float) -> Counts:
        """Whole steps at t_s."""
        x, y, z = self.position_at(t_s)
        return (round(x), round(y), round(z))

    def nut_at(self, t_s: float) -> Counts:
        """Whole steps at t_s of what hangs on the screws: behind by the play where it was driven up last."""
        x, y, z = self._nut_at(t_s)
        return (round(x), round(y), round(z))

    def speed_at(self, t_s: float) -> float:
        """Speed along the path, mm/s."""
        piece = self.piece_at(t_s) if t_s < self.end_s else None
        if piece is None or t_s >= piece.t1_s:
            return 0.0
        return max(piece.ramp.v0 + piece.ramp.accel * (t_s - piece.t0_s), 0.0)

    def piece_at(self, t_s: float) -> Piece | None:
        """The last piece that began by t_s."""
        index = bisect_right(self._starts, t_s) - 1
        return self._pieces[index] if index >= 0 else None

    def replace_from(self, t_s: float, pieces: list[Piece], rest: Vec) -> None:
        """Forget what lay after t_s and put these pieces there; the carriage then rests at `rest`."""
        nut = self._nut_at(t_s)
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
            shorter = Ramp(t_s - last.t0_s, last.ramp.v0, last.ramp.accel)
            self._pieces[-1] = Piece(last.t0_s, shorter, last.origin, last.slope, last.done_mm)

    def _prune(self, now_s: float) -> None:
        if len(self._pieces) > _PRUNE_OVER:
            old = bisect_right(self._starts, now_s - HISTORY_S) - 1
            if old > 0:
                del self._pieces[:old], self._starts[:old], self._nuts[:old]

    def _nut_at(self, t_s: float) -> Vec:
        """Exact at any instant: along a piece no axis turns round."""
        if t_s >= self.end_s:
            return self._nut_rest
        index = bisect_right(self._starts, t_s) - 1
        if index < 0:
            return self._nuts[0] if self._nuts else self._nut_rest
        return self._followed(self._nuts[index], self._pieces[index].at(t_s))

    def _followed(self, nut: Vec, screw: Vec) -> Vec:
        """The nut once the screw has gone in one direction to its new place: pushed down, or drawn up by the play."""
        x, y, z = (min(max(n, s - play), s) for n, s, play in zip(nut, screw, self._play, strict=True))
        return (x, y, z)


def trapezoid(mm: float, v0: float, v1: float, cruise: float, accel: float) -> list[Ramp]:
    """Ramps that cover mm from speed v0 to v1, as fast as cruise (mm/s) and accel (mm/s²) allow."""
    if mm < _NEGLIGIBLE_MM:
        return []
    top = sqrt(accel * mm + 0.5 * (v0 * v0 + v1 * v1))
    if top <= max(v0, v1) * (1 + 1e-12):
        # One ramp needs the whole length: rounding must not leave it short or long.
        return [Ramp(2 * mm / (v0 + v1), v0, (v1 * v1 - v0 * v0) / (2 * mm))]
    peak = max(min(top, cruise), v0, v1)
    level_mm = mm - (2 * peak * peak - v0 * v0 - v1 * v1) / (2 * accel)
    ramps = [
        Ramp((peak - v0) / accel, v0, accel),
        Ramp(max(level_mm, 0.0) / peak, peak, 0.0),
        Ramp((peak - v1) / accel, peak, -accel),
    ]
    return [ramp for ramp in ramps if ramp.duration_s > 0]
