"""Motion of one drive's axis: ramps of its own up and down, in pulses, on the track that boards use too."""

from math import sqrt

from sim.devices.grbl.motion import Piece, Ramp, Track

_NEGLIGIBLE_PULSES = 1e-6


class DriveAxis:
    """A carriage on one axis: position in pulses from the home switch, speeds in pulses/s, ramps in pulses/s²."""

    def __init__(self, position: int, play: float = 0.0) -> None:
        self._track = Track((position, 0, 0), (play, 0.0, 0.0))

    @property
    def end_s(self) -> float:
        """When the carriage comes to rest, as planned now."""
        return self._track.end_s

    def position_at(self, t_s: float) -> int:
        """Whole pulses at an instant, past, present or planned."""
        return self._track.counts_at(t_s)[0]

    def nut_at(self, t_s: float) -> int:
        """Whole pulses at an instant of what hangs on the screw, behind the motor by the play where it went up."""
        return self._track.nut_at(t_s)[0]

    def velocity_at(self, t_s: float) -> float:
        """Signed pulses/s."""
        piece = self._track.piece_at(t_s)
        return self._track.speed_at(t_s) * (piece.slope[0] if piece else 1.0)

    def moving(self, t_s: float) -> bool:
        """Whether the carriage is on its way."""
        return t_s < self._track.end_s

    def go(self, targets: list[tuple[float, float]], up: float, down: float, now_s: float) -> None:
        """Run to each (position, speed) in turn, at rest in each; brake first if the first is behind or too near."""
        velocity = self.velocity_at(now_s)
        path = _Path(self._track.position_at(now_s)[0], now_s)
        if (targets[0][0] - path.position) * velocity < 0.5 * abs(velocity) ** 3 / down:
            path, velocity = self._braked(down, now_s), 0.0
        for position, speed in targets:
            way = position - path.position
            path.run(way, ramps_to_rest(abs(way), abs(velocity), speed, up, down))
            velocity = 0.0
        self._follow(path, now_s)

    def keep_going(self, velocity: float, up: float, down: float, for_s: float, room: float, now_s: float) -> None:
        """Run at this velocity for for_s more, then slow down; never farther than `room` pulses from here."""
        present = self.velocity_at(now_s)
        if present * velocity < 0:
            self.brake(down, now_s)
            return
        speed, cruise = abs(present), abs(velocity)
        rising_s = min(max(cruise - speed, 0.0) / up, for_s)
        top = speed + up * rising_s
        ramps = [Ramp(rising_s, speed, up), Ramp(for_s - rising_s, top, 0.0), Ramp(top / down, top, -down)]
        if sum(ramp.mm for ramp in ramps) > room:
            ramps = ramps_to_rest(room, speed, cruise, up, down)
        path = _Path(self._track.position_at(now_s)[0], now_s)
        path.run(velocity, ramps)
        self._follow(path, now_s)

    def brake(self, down: float, now_s: float) -> None:
        """Slow down to rest."""
        self._follow(self._braked(down, now_s), now_s)

    def _braked(self, down: float, now_s: float) -> "_Path":
        path = _Path(self._track.position_at(now_s)[0], now_s)
        velocity = self.velocity_at(now_s)
        path.run(velocity, [Ramp(abs(velocity) / down, abs(velocity), -down)])
        return path

    def _follow(self, path: "_Path", now_s: float) -> None:
        self._track.replace_from(now_s, path.pieces, (path.position, 0.0, 0.0))


class _Path:
    """Pieces one after another, from a position at an instant."""

    def __init__(self, position: float, t_s: float) -> None:
        self.position, self._t_s = position, t_s
        self.pieces: list[Piece] = []

    def run(self, direction: float, ramps: list[Ramp]) -> None:
        sign = 1.0 if direction >= 0 else -1.0
        for ramp in ramps:
            if ramp.duration_s > 0:
                self.pieces.append(Piece(self._t_s, ramp, (self.position, 0.0, 0.0), (sign, 0.0, 0.0)))
                self._t_s += ramp.duration_s
                self.position += sign * ramp.mm


def ramps_to_rest(length: float, speed: float, cruise: float, up: float, down: float) -> list[Ramp]:
    """Ramps over `length` pulses from `speed` to rest, no faster than cruise; too short a way is braked harder."""
    if length < _NEGLIGIBLE_PULSES:
        return []
    top = sqrt((length + 0.5 * speed * speed / up) / (0.5 / up + 0.5 / down))
    if top <= speed:
        return [Ramp(2 * length / speed, speed, -0.5 * speed * speed / length)]
    peak = max(min(top, cruise), speed)
    level = length - 0.5 * (peak * peak - speed * speed) / up - 0.5 * peak * peak / down
    return [
        Ramp((peak - speed) / up, speed, up),
        Ramp(max(level, 0.0) / peak, peak, 0.0),
        Ramp(peak / down, peak, -down),
    ]
