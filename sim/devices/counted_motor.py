"""Motion of virtual drives that count steps: trapezoids, home switch, far switch, search for home, power.

The home switch is at the upper end of every axis, and the far one beyond the travel.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import TypeVar

from sim.devices.clock import Scheduler
from sim.devices.grbl.planner import ConstantAcceleration, Piece, Track
from sim.devices.line import TwinError, VirtualStageSpec

START_MM = -10.0
_NEGLIGIBLE_PULSES = 1e-6


class DriveAxis:
    """Carriage on one axis: position in pulses from the home switch, speeds in pulses/s, ramps in pulses/s²."""

    def __init__(self, position: int, play: float = 0.0) -> None:
        self._track = Track((position, 0, 0), (play, 0.0, 0.0))

    @property
    def end_s(self) -> float:
        """Planned time at which the carriage comes to rest."""
        return self._track.end_s

    def position_at(self, t_s: float) -> int:
        """Return whole pulses at a time, past, present or planned."""
        return self._track.counts_at(t_s)[0]

    def nut_at(self, t_s: float) -> int:
        """Return the nut's whole pulses at a time: behind the motor by the play where it went up last."""
        return self._track.nut_at(t_s)[0]

    def velocity_at(self, t_s: float) -> float:
        """Return the signed velocity in pulses/s."""
        piece = self._track.piece_at(t_s)
        return self._track.speed_at(t_s) * (piece.slope[0] if piece else 1.0)

    def moving(self, t_s: float) -> bool:
        """Return whether the carriage is moving."""
        return t_s < self._track.end_s

    def go(self, targets: list[tuple[float, float]], up: float, down: float, now_s: float) -> None:
        """Run to each (position, speed) in turn, resting in each; brake first if the first is behind or too near."""
        velocity = self.velocity_at(now_s)
        path = _Path(self._track.position_at(now_s)[0], now_s)
        if (targets[0][0] - path.position) * velocity < 0.5 * abs(velocity) ** 3 / down:
            path, velocity = self._braked(down, now_s), 0.0
        for position, speed in targets:
            distance = position - path.position
            path.run(distance, ramps_to_rest(abs(distance), abs(velocity), speed, up, down))
            velocity = 0.0
        self._follow(path, now_s)

    def keep_going(self, velocity: float, up: float, down: float, for_s: float, room: float, now_s: float) -> None:
        """Run at a velocity for for_s more, then brake, within `room` pulses from here."""
        present = self.velocity_at(now_s)
        if present * velocity < 0:
            self.brake(down, now_s)
            return
        speed, cruise = abs(present), abs(velocity)
        rising_s = min(max(cruise - speed, 0.0) / up, for_s)
        top = speed + up * rising_s
        ramps = [
            ConstantAcceleration(rising_s, speed, up),
            ConstantAcceleration(for_s - rising_s, top, 0.0),
            ConstantAcceleration(top / down, top, -down),
        ]
        if sum(ramp.mm for ramp in ramps) > room:
            ramps = ramps_to_rest(room, speed, cruise, up, down)
        path = _Path(self._track.position_at(now_s)[0], now_s)
        path.run(velocity, ramps)
        self._follow(path, now_s)

    def brake(self, down: float, now_s: float) -> None:
        """Brake to rest."""
        self._follow(self._braked(down, now_s), now_s)

    def _braked(self, down: float, now_s: float) -> "_Path":
        path = _Path(self._track.position_at(now_s)[0], now_s)
        velocity = self.velocity_at(now_s)
        path.run(velocity, [ConstantAcceleration(abs(velocity) / down, abs(velocity), -down)])
        return path

    def _follow(self, path: "_Path", now_s: float) -> None:
        self._track.replace_from(now_s, path.pieces, (path.position, 0.0, 0.0))


@dataclass(frozen=True)
class MotorSpec:
    """Motor of an axis as configured: counts for each mm, travel, acceleration, lost motion of the screw in counts.

    start: height at power-on. speed_unit, acceleration_unit: of the drive, for one count per s and s².
    """

    counts_per_mm: float
    travel_mm: float
    acceleration_mm_s2: float
    play: float
    start: int
    speed_unit: float
    acceleration_unit: float

    @classmethod
    def of(cls, spec: VirtualStageSpec, axis: str) -> "MotorSpec":
        """Return the motor of an axis."""
        number = "xyz".index(axis)
        per_mm = abs(spec.steps_per_mm[number])
        units = (spec.own.get(key, 1.0) for key in ("speed_unit", "acceleration_unit"))
        travel_mm, play = spec.travel_mm[number], spec.play_steps[number]
        return cls(per_mm, travel_mm, spec.acceleration_mm_s2, play, round(START_MM * per_mm), *units)


M = TypeVar("M", bound="CountedMotor")


def by_address(axes: Mapping[str, M], spec: VirtualStageSpec, kind: str, number: str) -> dict[int, dict[int, M]]:
    """Return axes on one line by the address of their device and their number there. Raises TwinError."""
    places = {name: (spec.own[name]["address"], spec.own[name][number]) for name in axes}
    if len({*places.values()}) < len(places):
        raise TwinError(f"{kind}: x and z have one address and {number}; give each its own", "same_axis")
    found: dict[int, dict[int, M]] = {}
    for name, (address, which) in sorted(places.items(), key=lambda place: place[1]):
        found.setdefault(address, {})[which] = axes[name]
    return found


class CountedMotor:
    """Motor of a drive that counts, with its truth: heights in counts from home, past, present or planned.

    counts_upwards: the drive's count grows towards home. start: height at power-on. play: the screw's lost motion.
    switches: heights of the home switch and of the far one.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        *,
        counts_upwards: bool = True,
        start: int = 0,
        play: float = 0.0,
        switches: tuple[float, float] = (0.0, -inf),
    ) -> None:
        self._scheduler, self._axis = scheduler, DriveAxis(start, play)
        self._sign = 1 if counts_upwards else -1
        self._highest, self._lowest = switches
        self._zero = start
        self._homed = self._searching = False

    # --- truth ---

    def carriage_at(self, t_s: float) -> int:
        """Return the motor's true height."""
        return self._axis.position_at(t_s)

    def nut_at(self, t_s: float) -> int:
        """Return the nut's height: behind by the play where the motor went up last."""
        return self._axis.nut_at(t_s)

    def power_cycle(self) -> None:
        """Switch off and on: the carriage stops at once, and the drive counts from where it stands."""
        self._brake(inf)
        self._zero = self.carriage_at(self._now_s)
        self._homed = self._searching = False

    # --- state ---

    @property
    def busy(self) -> bool:
        """Whether the motor turns."""
        self._settle()
        return self._axis.moving(self._now_s)

    def position(self) -> int:
        """Return the drive's count."""
        self._settle()
        return self._count(self._now_s)

    @property
    def at_home(self) -> bool:
        """Whether the home switch is active."""
        return self.carriage_at(self._now_s) >= self._highest

    @property
    def at_far_end(self) -> bool:
        """Whether the far switch is active."""
        return self.carriage_at(self._now_s) <= self._lowest

    def _count(self, t_s: float) -> int:
        return self._sign * (self.carriage_at(t_s) - self._zero)

    def _height(self, count: int) -> int:
        return self._zero + self._sign * count

    def set_count(self, count: int) -> None:
        """Let the drive count from here on."""
        self._zero = self.carriage_at(self._now_s) - self._sign * count

    # --- motion ---

    def _go(self, legs: Sequence[tuple[float, float]], up: float, down: float) -> None:
        """Go to heights at speeds, in turn."""
        self._axis.go(list(legs), up, down, self._now_s)

    def _search(self, legs: Sequence[tuple[float, float]], up: float, down: float) -> None:
        """Search home by these legs; at their end the drive is homed."""
        self._homed, self._searching = False, True
        self._go(legs, up, down)

    def _brake(self, deceleration: float) -> None:
        if self._axis.velocity_at(self._now_s):
            self._axis.brake(deceleration, self._now_s)

    def _settle(self) -> None:
        """Update the state after a search."""
        if self._searching and not self._axis.moving(self._now_s):
            self._searching, self._homed = False, True
            self._arrive_home()

    def _arrive_home(self) -> None:
        """Count from home."""
        self._zero = 0

    @property
    def _now_s(self) -> float:
        return self._scheduler.monotonic_s()


class MotorPair:
    """Two motors as a stage: x lateral, z vertical, y set by hand."""

    x: CountedMotor
    z: CountedMotor

    def carriage_steps_at(self, t_s: float) -> tuple[int, int, int]:
        """Return the motors' true position in counts from home (x, y, z)."""
        return self.x.carriage_at(t_s), 0, self.z.carriage_at(t_s)

    def nut_steps_at(self, t_s: float) -> tuple[int, int, int]:
        """Return the nuts' true position in counts from home (x, y, z)."""
        return self.x.nut_at(t_s), 0, self.z.nut_at(t_s)

    def power_cycle(self) -> None:
        """Switch both off and on."""
        for motor in (self.x, self.z):
            motor.power_cycle()


class Inbox:
    """Bytes that a device has received and not yet read; after a pause it forgets those of an incomplete frame."""

    def __init__(self, scheduler: Scheduler, forgets_s: float = inf) -> None:
        self._scheduler, self.forgets_s = scheduler, forgets_s
        self.data, self._last_s = b"", -inf

    def add(self, data: bytes) -> None:
        """Take in bytes."""
        now_s = self._scheduler.monotonic_s()
        self.data = data if now_s - self._last_s > self.forgets_s else self.data + data
        self._last_s = now_s

    def take(self, length: int) -> bytes:
        """Remove and return the first bytes."""
        taken, self.data = self.data[:length], self.data[length:]
        return taken

    def clear(self) -> None:
        """Forget all bytes."""
        self.data = b""


class _Path:
    """Consecutive pieces from a position at a time."""

    def __init__(self, position: float, t_s: float) -> None:
        self.position, self._t_s = position, t_s
        self.pieces: list[Piece] = []

    def run(self, direction: float, ramps: Sequence[ConstantAcceleration]) -> None:
        sign = 1.0 if direction >= 0 else -1.0
        for ramp in ramps:
            if ramp.duration_s > 0:
                self.pieces.append(Piece(self._t_s, ramp, (self.position, 0.0, 0.0), (sign, 0.0, 0.0)))
                self._t_s += ramp.duration_s
                self.position += sign * ramp.mm


def ramps_to_rest(length: float, speed: float, cruise: float, up: float, down: float) -> list[ConstantAcceleration]:
    """Return ramps over `length` pulses from `speed` to rest, up to cruise; a short distance is braked harder."""
    if length < _NEGLIGIBLE_PULSES:
        return []
    top = sqrt((length + 0.5 * speed * speed / up) / (0.5 / up + 0.5 / down))
    if top <= speed:
        return [ConstantAcceleration(2 * length / speed, speed, -0.5 * speed * speed / length)]
    peak = max(min(top, cruise), speed)
    level = length - 0.5 * (peak * peak - speed * speed) / up - 0.5 * peak * peak / down
    return [
        ConstantAcceleration((peak - speed) / up, speed, up),
        ConstantAcceleration(max(level, 0.0) / peak, peak, 0.0),
        ConstantAcceleration(peak / down, peak, -down),
    ]
