"""Stage with two motors of Trinamic modules, x lateral and z vertical, on one port, in binary TMCL.

Sources: Trinamic TMCL firmware manuals (reading of the TMCM-1161); the maker's client, pytrinamic 0.2.26, and bytes
exchanged with it. Second-hand and so settings: units, flags, the mode of the reference search.

The maximum speed of a standing axis is 0. A target is sent, read back, and started by the speed, so that an error in
a command starts nothing. The driver also recognizes by this 0 a module that was switched off since. It stores nothing
in a module: all is lost at power-off.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from rig.clock import Clock
from rig.devices.base import (
    Looks,
    Stage,
    StageAlarm,
    StageError,
    StageOverridden,
    StageReset,
    StageTimeout,
)
from rig.devices.one_axis import POLL_S, TwoAxisStage, WatchedAxis, WayHome, travel_s, whole_speed
from rig.devices.registry import Evidence, Opener, StageKind
from rig.devices.tmcl_link import ABSOLUTE, END_SEARCH, MST, MVP, RFS, SAP, SEARCH, Motor, TmclLink
from rig.settings import BenchSettings, StageSettings, TmclAxisSettings, TmclSettings

TARGET, POSITION, SPEED, MAX_SPEED, ACCELERATION = 0, 1, 3, 4, 5
RIGHT_SWITCH, LEFT_SWITCH, RESOLUTION, SEARCH_MODE = 10, 11, 140, 193
SWITCHES = {"right": RIGHT_SWITCH, "left": LEFT_SWITCH}

HOME_S, HOMING_BEGINS_S = 180.0, 0.5
# A move may take this much longer than computed from length, speed and acceleration.
LATE_FACTOR, LATE_S = 1.5, 5.0
# A move may be this much faster than commanded; speed_unit is wrong if it is faster.
FAST_FACTOR, FAST_MM = 1.5, 0.05
STOP_S, HALT_S = 1.0, 2.0
TOLERANCE_MM = 2.5e-3
# The home switch may be active so far from home.
HOME_ZONE_MM = 1.0
# After homing, the module's position is at most so far from 0.
HOMED_WITHIN_MM = 0.5


@dataclass(frozen=True, slots=True)
class Look:
    """Status of one axis in the units of the module; position_mm in machine mm."""

    target: int
    position: int
    speed: int
    max_speed: int
    switches: Mapping[int, bool]
    flags: Mapping[int, int]
    searching: bool
    position_mm: float

    @property
    def busy(self) -> bool:
        """Whether the axis moves."""
        return self.speed != 0 or self.searching


class TmclAxis(WatchedAxis[Look]):
    """One axis, in machine mm.

    counts_per_mm: microsteps for each mm, negative if the module counts upwards away from home.
    """

    def __init__(
        self,
        link: TmclLink,
        clock: Clock,
        name: str,
        axis: TmclAxisSettings,
        units: TmclSettings,
        *,
        counts_per_mm: float,
        travel_mm: float,
        least_acceleration_mm_s2: float,
    ) -> None:
        self.name, self.travel_mm, self.steps_per_mm = name, travel_mm, counts_per_mm
        self.motor = Motor(axis.address, axis.motor)
        self._link, self._clock, self._axis, self._units = link, clock, axis, units
        self._least_acceleration_mm_s2 = least_acceleration_mm_s2
        self._acceleration_mm_s2 = math.inf
        self._flags = {number: 0 for number in (units.lost_steps_parameter, units.fault_parameter) if number}
        self._max_speed: int | None = None  # what the module must report; None: not known
        self._jogs_to: int | None = None

    def connect(self) -> str:
        """Compare the module with the configuration and return its identification. Raises StageError."""
        self._max_speed = None
        version = self._link.version(self.motor)
        for name, parameter, expected in (
            ("microstep resolution", RESOLUTION, self._axis.resolution),
            ("reference search mode", SEARCH_MODE, self._axis.search_mode),
        ):
            found = self._number(parameter)
            if found != expected:
                self._refuse_setting(name, parameter, found, expected)
        acceleration = self._number(ACCELERATION)
        unit = abs(self.steps_per_mm) * self._units.acceleration_unit
        self._acceleration_mm_s2 = acceleration / unit or math.inf
        if self._acceleration_mm_s2 < self._least_acceleration_mm_s2:
            least = f"at least {math.ceil(self._least_acceleration_mm_s2 * unit)} (stage.acceleration_mm_s2)"
            self._refuse_setting("acceleration", ACCELERATION, acceleration, least)
        self.look()
        return f"{self.name}: TMCL module {self.motor.address}, motor {self.motor.number}, firmware {version}"

    # --- motion ---

    def homing(self, keep_on: Callable[[], bool], others: Callable[[], None]) -> Iterator[Look]:
        """Search the home switch, where the position is 0 from then on; yield at each look.

        others checks that no other axis moves, once this one should. Raises StageError.
        """
        self._set_max_speed(self.native_speed(self._axis.home_speed_mm_s))
        if not keep_on():
            raise self._stopped()
        self._command(RFS, SEARCH)
        others()
        begun, begins_by_s = False, self._clock.monotonic_s() + HOMING_BEGINS_S
        way, before_s = WayHome(), self._clock.monotonic_s()

        def look() -> tuple[Look, bool]:
            nonlocal begun, before_s
            found = self.look()
            if not keep_on():
                raise self._stopped()
            self.refuse_flags()
            took_s, before_s = self._clock.monotonic_s() - before_s, self._clock.monotonic_s()
            # By the speed: the position becomes 0 at the switch.
            up_mm = found.speed / (self.steps_per_mm * self._units.speed_unit) * took_s
            if way.is_wrong(up_mm, at_switch=found.switches[SWITCHES[self._axis.home_switch]]):
                self._command(RFS, END_SEARCH)  # No stop ends a search.
                raise self._homes_the_wrong_way()
            begun = begun or found.searching
            if not begun and self._clock.monotonic_s() >= begins_by_s:
                raise self._did_not_home(found)
            return found, begun and not found.busy

        yield from self._until(look, HOME_S, 0.0, "homing")
        found = self.look()
        if found.busy or abs(found.position_mm) > HOMED_WITHIN_MM:
            raise self._did_not_home(found)
        self.disarm()

    def moving(self, to_mm: float, speed_mm_s: float, keep_on: Callable[[], bool], look_s: float) -> Iterator[Look]:
        """Move to a position at a speed; yield each look, until arrival.

        A motion that leaves the way from start to target, or is too fast, is stopped. Raises StageError; MoveError
        before any byte.
        """
        speed, target = self.native_speed(speed_mm_s), round(to_mm * self.steps_per_mm)
        start = self._standing(trusted=True)
        if self._max_speed != 0:
            self.disarm()
        self._aim(target)
        if not keep_on():
            raise self._stopped()
        begun_s, low, high = self._clock.monotonic_s(), *sorted((start, target))
        self._set_max_speed(speed)
        stood_at: int | None = None

        def strayed(found: Look) -> StageError | None:
            if found.max_speed != self._max_speed:
                return self._was_reset(found)
            if found.target != target:
                return StageOverridden(f"{self._label}: another program has changed the target")
            if not low - self._tolerance <= found.position <= high + self._tolerance:
                return self._not_there(found, to_mm)
            fastest_mm = FAST_FACTOR * speed_mm_s * (self._clock.monotonic_s() - begun_s) + FAST_MM
            if abs(found.position - start) > fastest_mm * abs(self.steps_per_mm):
                return StageError(
                    f"{self._label} moves faster than {speed_mm_s:g} mm/s; check speed_unit and microstep_um",
                    "too_fast",
                )
            return None

        def look() -> tuple[Look, bool]:
            nonlocal stood_at
            found = self.look()
            if not keep_on():
                raise self._stopped()
            self.refuse_alarms(found)
            if (problem := strayed(found)) is not None:
                self._link.send_now([self.motor])
                raise problem
            if found.busy:
                stood_at = None
                return found, False
            if abs(found.position - target) > self._tolerance:
                if stood_at == found.position:
                    raise self._not_there(found, to_mm)
                stood_at = found.position
                return found, False
            return found, True

        mm = abs((target - start) / self.steps_per_mm)
        expected_s = travel_s(mm, speed_mm_s, self._acceleration_mm_s2)
        what = f"the move to {to_mm:g} mm"
        yield from self._until(look, LATE_FACTOR * expected_s + LATE_S, expected_s, what, look_s)
        self.disarm()

    def jog(self, by_mm: float, speed_mm_s: float, keep_on: Callable[[], bool]) -> None:
        """Move by a distance from rest, and return at once. Raises StageError."""
        speed, target = (
            self.native_speed(speed_mm_s),
            self._standing(trusted=False) + round(by_mm * self.steps_per_mm),
        )
        self.disarm()
        self._aim(target)
        if not keep_on():
            raise self._stopped()
        self._set_max_speed(speed)
        self._jogs_to = target

    def halt(self) -> None:
        """Stop this axis and return at rest; steps are not lost. Raises StageError."""
        self._stop(HALT_S)
        self.disarm()

    def mm(self, look: Look) -> float:
        """Return the position (mm)."""
        return look.position_mm

    def confirm_stopped(self) -> None:
        """Repeat the stop until the axis rests. Raises StageError."""
        self._max_speed = None
        self._stop(STOP_S)

    def disarm(self) -> None:
        """Set the maximum speed of the axis to 0, so that nothing can start it. Raises StageError."""
        self._set_max_speed(0)

    # --- state ---

    def look(self) -> Look:
        """Return the status of the axis. Raises StageError."""
        parameters = (TARGET, POSITION, SPEED, MAX_SPEED, RIGHT_SWITCH, LEFT_SWITCH, *self._flags)
        values, search = self._link.ask(self.motor, parameters)
        found = dict(zip(parameters, values, strict=True))
        for number in self._flags:
            # A module clears a flag when it is read.
            self._flags[number] |= found[number]
        if not (found[SPEED] or search) and self._jogs_to == found[POSITION]:
            self._jogs_to = None
            self.disarm()
            found[MAX_SPEED] = 0
        return Look(
            found[TARGET],
            found[POSITION],
            found[SPEED],
            found[MAX_SPEED],
            {number: found[number] != 0 for number in SWITCHES.values()},
            dict(self._flags),
            search != 0,
            found[POSITION] / self.steps_per_mm + 0.0,
        )

    def refuse_alarms(self, found: Look) -> None:
        """Refuse flags, and a limit switch that is not expected to be active. Raises StageAlarm."""
        self.refuse_flags()
        for side, number in SWITCHES.items():
            home = side == self._axis.home_switch
            expected = abs(found.position_mm) <= HOME_ZONE_MM if home else not self._axis.far_switch
            if found.switches[number] and not expected:
                raise self._alarm(number, f"unexpected {side} limit switch")

    def refuse_flags(self) -> None:
        """Refuse flags of lost steps and of the motor driver. Raises StageAlarm."""
        units = self._units
        for number, mask, meaning in (
            (units.lost_steps_parameter, -1, "steps lost"),
            (units.fault_parameter, units.fault_mask, "fault of the motor driver"),
        ):
            flags = self._flags.get(number, 0) & mask
            if flags:
                raise self._alarm(number, f"{meaning}, flags {flags:#x}")

    def refuse_news(self, found: Look) -> None:
        """Refuse alarms, and a module that was switched off. Raises StageError."""
        self.refuse_alarms(found)
        if found.max_speed != self._max_speed is not None and self._number(MAX_SPEED) != self._max_speed:
            raise self._was_reset(found)

    def refuse_moving(self) -> None:
        """Refuse an axis that moves without a command; end its search, which no stop ends. Raises StageError."""
        (speed,), search = self._link.ask(self.motor, (SPEED,))
        if speed or search:
            self._command(RFS, END_SEARCH)
            raise StageError(f"{self._label} moves without a command; check the addresses", "moves")

    def clear_flags(self) -> None:
        """Forget flags that the module no longer reports. Raises StageAlarm if it still does."""
        self.look()
        self._flags = dict.fromkeys(self._flags, 0)
        self.look()
        self.refuse_flags()

    def native_speed(self, speed_mm_s: float) -> int:
        """Return the speed in the module's unit, rounded down. Raises MoveError below 1."""
        return whole_speed(speed_mm_s, abs(self.steps_per_mm) * self._units.speed_unit)

    # --- helpers ---

    def _aim(self, target: int) -> None:
        """Send a target and read it back; an axis that moves already stops if they differ."""
        self._command(MVP, ABSOLUTE, target)
        if (found := self._number(TARGET)) != target:
            self._link.send_now([self.motor])
            self._refuse_setting("target", TARGET, found, target)

    def _set_max_speed(self, speed: int) -> None:
        """Set the maximum speed and read it back; the axis stops if they differ."""
        self._max_speed = None
        self._command(SAP, MAX_SPEED, speed)
        if (found := self._number(MAX_SPEED)) != speed:
            self._link.send_now([self.motor])
            self._refuse_setting("maximum speed", MAX_SPEED, found, speed)
        self._max_speed = speed

    def _stop(self, within_s: float) -> None:
        deadline_s = self._clock.monotonic_s() + within_s
        problem: StageError | None = None
        while self._clock.monotonic_s() < deadline_s:
            try:
                self._command(MST)
                (speed,), search = self._link.ask(self.motor, (SPEED,))
                if search:
                    self._command(RFS, END_SEARCH)
                elif not speed and self._rests():
                    return
                problem = None
            except StageError as error:
                problem = error
            self._clock.wait_s(POLL_S)
        raise problem or StageTimeout(
            f"{self._label} still moves {within_s:g} s after a stop; use the emergency stop", "still_runs"
        )

    def _rests(self) -> bool:
        """Return whether the axis rests: without speed, and still at one position after a while."""
        once = self._number(POSITION)
        self._clock.wait_s(POLL_S)
        (again, speed), search = self._link.ask(self.motor, (POSITION, SPEED))
        return again == once and not (speed or search)

    def _standing(self, *, trusted: bool) -> int:
        """Return the position at rest."""
        found = self.look()
        self.refuse_alarms(found) if trusted else self.refuse_flags()
        if found.busy:
            raise StageOverridden(f"{self._label} moves already; another program moves it")
        if trusted:
            self.refuse_news(found)
        return found.position

    @property
    def _tolerance(self) -> float:
        return max(TOLERANCE_MM * abs(self.steps_per_mm), 1.0)

    def _number(self, parameter: int) -> int:
        return self._link.ask(self.motor, (parameter,))[0][0]

    def _command(self, command: int, kind: int = 0, value: int = 0) -> None:
        self._link.command(self.motor, command, kind, value)

    def _alarm(self, number: int, meaning: str) -> StageAlarm:
        return StageAlarm(number, f"{self._label}: {meaning}")

    def _refuse_setting(self, setting: str, parameter: int, found: object, expected: object) -> None:
        raise StageError(
            f"{self._label}: {setting} of the module (parameter {parameter}) is {found}, expected {expected}",
            "not_as_configured",
        )

    def _not_there(self, found: Look, target_mm: float) -> StageError:
        return StageError(f"{self._label} is at {found.position_mm:.4f} mm instead of {target_mm:g} mm", "not_there")

    def _did_not_home(self, found: Look) -> StageError:
        return StageError(
            f"{self._label} did not home: it is at position {found.position}; check search_mode, and home again",
            "did_not_home",
        )

    def _was_reset(self, found: Look) -> StageReset:
        return StageReset(
            f"{self._label}: maximum speed is {found.max_speed}, was set to {self._max_speed}; the module was "
            "switched off, or another program uses it; home again"
        )

    @property
    def _label(self) -> str:
        return f"{self._link.name}: {self.name} axis"


class TmclStage(TwoAxisStage[TmclAxis, Look]):
    """Stage with two motors of Trinamic modules."""

    def __init__(self, link: TmclLink, x: TmclAxis, z: TmclAxis, settings: BenchSettings) -> None:
        super().__init__(x, z, name=f"{link.name}: the stage", settings=settings)
        self._link = link

    def homing(self) -> Looks:
        """Home z, then x. A fault is not cleared. Raises StageError."""
        self._trusted = False
        keep_on = self._until_stopped()
        for axis in self._up_first():
            axis.look()
            axis.refuse_flags()
            axis.disarm()
        z, x = self._up_first()
        for axis, other in ((z, x), (x, z)):
            try:
                for _ in axis.homing(keep_on, other.refuse_moving):
                    yield None
            except StageError:
                self._send_stop()
                raise
        self._trusted = keep_on()

    def unlock(self) -> None:
        """Forget flags that the modules no longer report; the position stays untrusted. Raises StageError."""
        self._trusted = False
        for axis in self._up_first():
            axis.clear_flags()

    def set_output(self, on: bool) -> None:
        """Refuse: no output of a module is supported. Raises StageError."""
        raise StageError("a TMCL stage has no output for pulses; set sync.output to off", "no_output")

    def close(self) -> None:
        self._link.close()

    def _send_stop(self) -> None:
        self._link.send_now([axis.motor for axis in self._up_first()])

    def _refuse_alarm(self, axis: TmclAxis, look: Look) -> None:
        if self._trusted:
            axis.refuse_news(look)
        axis.refuse_flags()

    def _is_referenced(self, axis: TmclAxis, look: Look) -> bool:
        # A standing axis that this driver has homed has maximum speed 0; one that was switched off has another.
        return look.busy or look.max_speed == 0


def steps_per_mm(stage: StageSettings, axis: str) -> float:
    """Return the microsteps per mm that the configuration gives; y has no motor."""
    own = stage.own(TmclSettings)
    found = own.x if axis == "x" else own.z
    return (-1e3 if found.home_switch == "left" else 1e3) / found.microstep_um


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    stage, own = settings.stage, settings.stage.own(TmclSettings)
    link = TmclLink(opener(stage.port), clock, baud=stage.baud, host=own.host_address)
    x, z = (
        TmclAxis(
            link,
            clock,
            name,
            axis,
            own,
            counts_per_mm=math.copysign(settings.calibration.value(f"{name}_steps_per_mm", nominal), nominal),
            travel_mm=stage.travel_mm["xyz".index(name)],
            least_acceleration_mm_s2=stage.acceleration_mm_s2 if name == "z" else 0.0,
        )
        for name, axis in (("x", own.x), ("z", own.z))
        if (nominal := steps_per_mm(stage, name))
    )
    return TmclStage(link, x, z, settings)


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Read the position of both motors, because the version query contains bytes on which other boards act."""
    own = settings.stage.own(TmclSettings)
    transport = opener(settings.stage.port)
    motors = [Motor(axis.address, axis.motor) for axis in (own.x, own.z)]
    silent = []
    for motor in motors:
        try:
            # Two tries: no byte is sent that ends a frame.
            TmclLink(transport, clock, host=own.host_address).ask(motor, (POSITION,), tries=2)
        except StageError:
            silent.append(motor)
    if len(silent) == len(motors):
        return None
    named = [f"module {motor.address}, motor {motor.number}" for motor in motors]
    if silent:
        raise StageError(
            f"{transport.name}: of the TMCL motors {named[0]} and {named[1]}, only one answers; "
            f"{named[motors.index(silent[0])]} does not; check its power, cable and address, or set the addresses "
            "under [stage.tmcl]",
            "one_motor",
        )
    return f"TMCL {named[0]} and {named[1]}"


DEVICE = StageKind(
    name="tmcl",
    device="two motors of Trinamic modules (binary TMCL)",
    driver=_driver,
    settings=TmclSettings,
    axes="xz",
    steps_per_mm=steps_per_mm,
    twin="sim.devices.tmcl:tmcl_twin",
    ramps=True,
    probe=_probe,
    tests=("tests/rig/test_tmcl_driver.py", "tests/rig/test_makers_clients.py"),
    evidence=Evidence(manual="commands and parameters in pytrinamic 0.2.26", client="pytrinamic 0.2.26"),
)
