"""Stage with two motors of Trinamic modules, x lateral and z vertical, on one port, in binary TMCL.

Sources: Trinamic TMCL firmware manuals (reading of the TMCM-1161); the maker's client, pytrinamic 0.2.26, and bytes
exchanged with it. Second-hand and so settings: units, flags, the mode of the reference search.

The maximum speed of a standing axis is 0. A target is sent, read back, and started by the speed, so that an error in
a command starts nothing. The driver also recognizes by this 0 a module that was switched off since. It stores nothing
in a module: all is lost at power-off.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

from rig.clock import Clock
from rig.devices.base import Stage, StageError, StageOverridden, StageReset
from rig.devices.counted_axis import (
    AxisSpec,
    CountedAxis,
    Destination,
    Fault,
    FaultKind,
    Look,
    Setting,
    TwoAxisStage,
)
from rig.devices.drive_link import both_answer
from rig.devices.registry import Evidence, Opener, StageKind
from rig.devices.tmcl_link import ABSOLUTE, END_SEARCH, MST, MVP, RFS, SAP, SEARCH, Motor, TmclLink
from rig.settings import BenchSettings, StageSettings, TmclAxisSettings, TmclSettings

TARGET, POSITION, SPEED, MAX_SPEED, ACCELERATION = 0, 1, 3, 4, 5
RIGHT_SWITCH, LEFT_SWITCH, RESOLUTION, SEARCH_MODE = 10, 11, 140, 193
SWITCHES = {"right": RIGHT_SWITCH, "left": LEFT_SWITCH}
NAMES = {
    TARGET: "target",
    MAX_SPEED: "maximum speed",
    ACCELERATION: "acceleration",
    RESOLUTION: "microstep resolution",
    SEARCH_MODE: "reference search mode",
}
# A move may be this much faster than commanded.
FAST_FACTOR, FAST_MM = 1.5, 0.05
# The home switch may be active so far from home.
HOME_ZONE_MM = 1.0
# After homing, the module's position is at most so far from 0.
HOMED_WITHIN_MM = 0.5


@dataclass(frozen=True, slots=True)
class TmclLook(Look):
    """State of an axis; searching: whether a reference search is active."""

    searching: bool = False


class TmclAxis(CountedAxis[TmclLook]):
    """One motor of a module, which may count upwards away from home."""

    halt_again_s = 0.0
    stopped_after = (StageReset, StageOverridden)  # it follows the target that another program gave it
    link: TmclLink

    def __init__(
        self, link: TmclLink, clock: Clock, spec: AxisSpec, axis: TmclAxisSettings, units: TmclSettings
    ) -> None:
        super().__init__(link, clock, spec, speed_unit=units.speed_unit, acceleration_unit=units.acceleration_unit)
        self.motor = Motor(axis.address, axis.motor)
        self._axis, self._units = axis, units
        self._flags = {number: 0 for number in (units.lost_steps_parameter, units.fault_parameter) if number}
        self._max_speed: int | None = None  # what the module must report; None: not known
        self._target: int | None = None  # of the motion under way
        self._lost: Fault | None = None  # since the last homing

    # --- settings ---

    def identify(self) -> str:
        self._max_speed = self._target = self._lost = None
        version = self.link.version(self.motor)
        return f"TMCL module {self.motor.address}, motor {self.motor.number}, firmware {version}"

    def settings(self) -> Iterator[Setting]:
        yield self._setting(RESOLUTION, self._axis.resolution)
        yield self._setting(SEARCH_MODE, self._axis.search_mode)
        yield from self.accelerations({_name(ACCELERATION): self._number(ACCELERATION)})
        self.look()  # A parameter that the module does not have is refused now.

    # --- motion ---

    def aim(self, target: Destination, speed: int) -> None:
        # Before a jog also a module that was switched off since, whose speed is its default.
        if target.by is not None or self._max_speed != 0:
            self._disarm()
        self.link.command(self.motor, MVP, ABSOLUTE, target.position)
        self._confirm(TARGET, target.position)

    def go(self, target: Destination, speed: int) -> None:
        self._set_max_speed(speed)
        self._target = target.position

    def strayed(
        self, found: TmclLook, start: int, target: int, speed_mm_s: float, begun_s: float
    ) -> StageError | None:
        """Return an error also for an axis that is too fast: the unit of speed is second-hand."""
        fastest_mm = FAST_FACTOR * speed_mm_s * (self._clock.monotonic_s() - begun_s) + FAST_MM
        if abs(found.position - start) > fastest_mm * abs(self.steps_per_mm):
            return StageError(
                f"{self.label} moves faster than {speed_mm_s:g} mm/s; check speed_unit and microstep_um", "too_fast"
            )
        return super().strayed(found, start, target, speed_mm_s, begun_s)

    def finish_move(self) -> None:
        if self._max_speed != 0:
            self._disarm()

    def send_stop(self, after_s: float, *, halting: bool) -> None:
        if not halting:
            self._max_speed = None
        self.link.command(self.motor, MST)

    def rests(self) -> bool:
        (speed,), search = self.link.ask(self.motor, (SPEED,))
        if search:
            self.end_search()  # No stop ends a search.
        return not (speed or search)

    def halt(self) -> None:
        """Slow down to rest, and note a module that was switched off before it is disarmed. Raises StageError."""
        super().halt()
        found, expected = self._number(MAX_SPEED), self._max_speed or 0
        if found != expected:
            self._lost = _lost(found, expected)
        self._disarm()

    def stop_now(self) -> None:
        self.link.send_now([self.motor])

    def before_homing(self) -> None:
        """Disarm, and leave a target that an earlier program left, which the speed of the search would start."""
        self._target = self._lost = None
        self.link.command(self.motor, MST)
        self._disarm()

    def aim_home(self) -> None:
        self._set_max_speed(self.native_speed(self._axis.home_speed_mm_s))

    def go_home(self) -> None:
        self.link.command(self.motor, RFS, SEARCH)

    def end_search(self) -> None:
        self.link.command(self.motor, RFS, END_SEARCH)

    def refuse_moving(self) -> None:
        """Refuse an axis that moves without a command, and end its search. Raises StageError."""
        (speed,), search = self.link.ask(self.motor, (SPEED,))
        if speed or search:
            self.end_search()
            raise StageError(f"{self.label} moves without a command; check the addresses", "moves")

    def homes(self, found: TmclLook) -> bool:
        return found.searching

    def not_home(self, found: TmclLook) -> str | None:
        for fault in found.faults:
            if fault.kind is FaultKind.LOST:
                return f"it {fault.words}"
        if abs(self.mm(found)) <= HOMED_WITHIN_MM:
            return None
        return f"it is at position {found.position}; check search_mode"

    def finish_homing(self) -> None:
        self._disarm()

    def clear(self) -> None:
        self.look()  # A module clears a flag when it is read.
        self._flags = dict.fromkeys(self._flags, 0)

    # --- state ---

    def look(self) -> TmclLook:
        parameters = (TARGET, POSITION, SPEED, MAX_SPEED, RIGHT_SWITCH, LEFT_SWITCH, *self._flags)
        values, search = self.link.ask(self.motor, parameters)
        found = dict(zip(parameters, values, strict=True))
        for number in self._flags:
            self._flags[number] |= found[number]
        busy = found[SPEED] != 0 or search != 0
        if not busy and self._target == found[POSITION] and self._max_speed == found[MAX_SPEED]:
            self._target = None
            self._disarm()
            found[MAX_SPEED] = 0
        return TmclLook(
            position=found[POSITION],
            busy=busy,
            faults=tuple(self._faults(found, busy=busy)),
            at_switch=found[SWITCHES[self._axis.home_switch]] != 0,
            up_mm_s=math.copysign(found[SPEED] / self.speed_unit, found[SPEED] * self.steps_per_mm),
            searching=search != 0,
        )

    def _faults(self, found: Mapping[int, int], *, busy: bool) -> Iterator[Fault]:
        units = self._units
        for number, mask, meaning in (
            (units.lost_steps_parameter, -1, "steps lost"),
            (units.fault_parameter, units.fault_mask, "fault of the motor driver"),
        ):
            if flags := self._flags.get(number, 0) & mask:
                yield Fault(FaultKind.ALARM, number, f"{meaning}, flags {flags:#x}")
        at_home = abs(found[POSITION] / self.steps_per_mm) <= HOME_ZONE_MM
        for side, number in SWITCHES.items():
            home = side == self._axis.home_switch
            if found[number] and not (at_home if home else not self._axis.far_switch):
                yield Fault(FaultKind.DISPLACED, number, f"unexpected {side} limit switch")
        # A standing axis that this driver has homed has maximum speed 0; one that was switched off has another.
        expected = found[MAX_SPEED] if busy and self._max_speed is None else self._max_speed or 0
        if found[MAX_SPEED] != expected:
            yield _lost(found[MAX_SPEED], expected)
        elif self._lost is not None:
            yield self._lost
        if self._target not in (None, found[TARGET]):
            yield Fault(FaultKind.OVERRIDDEN, TARGET, "another program has changed the target")

    # --- helpers ---

    def _disarm(self) -> None:
        """Set the maximum speed of the axis to 0, so that nothing can start it. Raises StageError."""
        self._set_max_speed(0)

    def _set_max_speed(self, speed: int) -> None:
        self._max_speed = None
        self.link.command(self.motor, SAP, MAX_SPEED, speed)
        self._confirm(MAX_SPEED, speed)
        self._max_speed = speed

    def _confirm(self, parameter: int, value: int) -> None:
        """Read a parameter back; an axis that moves already stops if it differs. Raises StageError."""
        setting = self._setting(parameter, value)
        if setting.found != value:
            self.stop_now()
        self.compare(setting)

    def _setting(self, parameter: int, expected: int) -> Setting:
        return Setting(_name(parameter), self._number(parameter), expected)

    def _number(self, parameter: int) -> int:
        return self.link.ask(self.motor, (parameter,))[0][0]


def _lost(found: int, expected: int) -> Fault:
    why = "the module was switched off, or another program uses it"
    return Fault(FaultKind.LOST, MAX_SPEED, f"has maximum speed {found}, was set to {expected}; {why}")


def _name(parameter: int) -> str:
    return f"{NAMES[parameter]} of the module (parameter {parameter})"


class TmclStage(TwoAxisStage[TmclAxis]):
    """Stage with two motors of Trinamic modules."""

    def _send_stop(self) -> None:
        z, x = self._up_first()
        z.link.send_now([z.motor, x.motor])


def steps_per_mm(stage: StageSettings, axis: str) -> float:
    """Return the microsteps per mm that the configuration gives; y has no motor."""
    own = stage.own(TmclSettings)
    found = own.x if axis == "x" else own.z
    return (-1e3 if found.home_switch == "left" else 1e3) / found.microstep_um


def _driver(opener: Opener, clock: Clock, settings: BenchSettings) -> Stage:
    stage, own = settings.stage, settings.stage.own(TmclSettings)
    link = TmclLink(opener(stage.port), clock, baud=stage.baud, host=own.host_address)
    x, z = (
        TmclAxis(link, clock, AxisSpec.of(settings, name, steps_per_mm(stage, name)), axis, own)
        for name, axis in (("x", own.x), ("z", own.z))
    )
    return TmclStage(x, z, settings)


def _probe(opener: Opener, clock: Clock, settings: BenchSettings) -> str | None:
    """Read the position of both motors, because the version query contains bytes on which other boards act."""
    own = settings.stage.own(TmclSettings)
    transport = opener(settings.stage.port)
    answers = {}
    for motor in (Motor(axis.address, axis.motor) for axis in (own.x, own.z)):
        name = f"module {motor.address}, motor {motor.number}"
        answers[name] = False
        with suppress(StageError):
            # Two tries: no byte is sent that ends a frame.
            TmclLink(transport, clock, host=own.host_address).ask(motor, (POSITION,), tries=2)
            answers[name] = True
    if not both_answer(transport.name, answers, "one_motor", "set the addresses under [stage.tmcl]"):
        return None
    return "TMCL " + " and ".join(answers)


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
