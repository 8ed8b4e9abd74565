"""Virtual Trinamic modules in binary TMCL: axis parameters, motion, reference search, limit switches, flags.

Sources: Trinamic TMCL firmware manuals (reading of the TMCM-1161); bytes exchanged with pytrinamic 0.2.26. From
secondary sources and so parameters: units, and the pause after which a module drops an incomplete frame. Also from
secondary sources: the flags, which reading clears, the reference search, and that a stop command does not end one.
Simplified: the home switch is at the upper end of every axis in every search mode, every stop brakes with the
acceleration, and a limit switch stops at once.
"""

import struct
from collections.abc import Callable, Mapping
from math import ceil, inf

from sim.devices.clock import Scheduler
from sim.devices.counted_motor import CountedMotor, Inbox, MotorPair, MotorSpec, by_address
from sim.devices.line import SerialLine, VirtualStageSpec

LENGTH = 9
ROR, ROL, MST, MVP, SAP, GAP, STAP, RSAP, SGP, GGP, RFS, VERSION = 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 13, 136
DONE, BAD_CHECKSUM, UNKNOWN_COMMAND, WRONG_TYPE, BAD_VALUE = 100, 1, 2, 3, 4
TARGET, POSITION, TARGET_SPEED, SPEED, MAX_SPEED, ACCELERATION = 0, 1, 2, 3, 4, 5
REACHED, RIGHT_SWITCH, LEFT_SWITCH, SEARCH_MODE, LOST_STEPS, DRIVER = 8, 10, 11, 193, 207, 208
SWITCHES = {"right": RIGHT_SWITCH, "left": LEFT_SWITCH}
FIRMWARE = b"1161V146"
OFF = 0x1A
"""Flags of the motor driver that switch it off: temperature, short circuits."""
FASTEST = 7_999_774
"""Largest speed and acceleration, in the module's own units."""
BACK_OFF_MM, FAR_MM = 0.5, 1.0
_BODY = struct.Struct(">BBBBi")


class TmclRefusal(Exception):  # noqa: N818
    """A command that is not obeyed, with the status of the reply."""

    def __init__(self, status: int) -> None:
        super().__init__(status)
        self.status = status


class VirtualTmclAxis(CountedMotor):
    """One motor with its axis parameters; `carriage_at(t)` is its true height in microsteps, 0 at home.

    The home switch is the left one where the module counts upwards away from home.
    """

    def __init__(self, scheduler: Scheduler, spec: VirtualStageSpec, name: str) -> None:
        own, motor = spec.own[name], MotorSpec.of(spec, name)
        left, per_mm = own["home_switch"] == "left", motor.counts_per_mm
        switches = 0.0, -(motor.travel_mm + FAR_MM) * per_mm
        super().__init__(scheduler, counts_upwards=not left, start=motor.start, play=motor.play, switches=switches)
        self._motor = motor
        self._home, self._far = (LEFT_SWITCH, RIGHT_SWITCH) if left else (RIGHT_SWITCH, LEFT_SWITCH)
        self.stored: dict[int, int] = {
            MAX_SPEED: ceil(10.0 * per_mm * motor.speed_unit),
            ACCELERATION: ceil(motor.acceleration_mm_s2 * per_mm * motor.acceleration_unit),
            **dict.fromkeys((6, 7, 12, 13, 149), 0),
            140: own["resolution"],
            SEARCH_MODE: own["search_mode"],
            194: ceil(5.0 * per_mm * motor.speed_unit),
            195: ceil(0.5 * per_mm * motor.speed_unit),
        }
        self.pressed: set[int] = set()
        self.power_cycle()

    # --- truth, and what an operator or an accident does ---

    def power_cycle(self) -> None:
        """Switch off and on: the carriage stops at once, position and parameters are those of the start."""
        super().power_cycle()
        self.parameters = dict(self.stored)
        self.target = self.target_speed = 0
        self._positions = True  # towards the target; else at a speed
        self.lost = self.driver = 0

    def press(self, side: str) -> None:
        """Make a limit switch active, left or right; the motor stops at once."""
        self.pressed.add(SWITCHES[side])
        self._halt()

    def stall(self) -> None:
        """Block the carriage: the module notices lost steps, and stops."""
        self._halt()
        self.lost |= 1

    def fail(self, flags: int) -> None:
        """Report flags of the motor driver, and stop."""
        self._halt()
        self.driver = flags

    # --- state ---

    @property
    def searching(self) -> bool:
        """Whether a reference search is active."""
        self._settle()
        return self._searching

    def parameter(self, number: int) -> int:
        """Return an axis parameter. Raises TmclRefusal."""
        self._settle()
        if number in PARAMETERS:
            return PARAMETERS[number][0](self)
        if number not in self.parameters:
            raise TmclRefusal(WRONG_TYPE)
        return self.parameters[number]

    def speed(self) -> int:
        """Return the speed in the module's unit; not 0 as long as the motor moves."""
        velocity = self._sign * self._axis.velocity_at(self._now_s) * self._motor.speed_unit
        return round(velocity) or int(self.busy and bool(velocity))

    def switch(self, number: int) -> int:
        """Return whether a limit switch is active."""
        reached = self.at_home if number == self._home else self.at_far_end
        return int(reached or number in self.pressed)

    def read_lost_steps(self) -> int:
        """Return the flags of lost steps, which reading clears."""
        lost, self.lost = self.lost, 0
        return lost

    # --- commands ---

    def set_parameter(self, number: int, value: int) -> None:
        """Set an axis parameter. Raises TmclRefusal."""
        self._settle()
        _, command = PARAMETERS.get(number, (None, None))
        if command is not None:
            command(self, value)
        elif number not in self.parameters:
            raise TmclRefusal(WRONG_TYPE)
        elif not 0 <= value <= FASTEST:
            raise TmclRefusal(BAD_VALUE)
        else:
            self.parameters[number] = value
            if number in (MAX_SPEED, ACCELERATION) and self._positions and not self._searching:
                self._follow()

    def store(self, number: int) -> int:
        """Store an axis parameter for the next start. Raises TmclRefusal."""
        self.stored[number] = self.parameter(number)
        return 0

    def restore(self, number: int) -> int:
        """Set an axis parameter to its stored value. Raises TmclRefusal."""
        self.set_parameter(number, self.stored.get(number, 0))
        return 0

    def move_to(self, target: int) -> None:
        """Go to a position."""
        self._settle()
        self.target, self._positions, self._searching = target, True, False
        self._follow()

    def move_by(self, counts: int) -> None:
        """Go on by a distance from the present position."""
        self.move_to(self.position() + counts)

    def rotate(self, speed: int) -> None:
        """Run at a speed, until a limit switch."""
        self._settle()
        self._positions, self._searching, self.target_speed = False, False, speed
        height = 0.0 if self._sign * speed > 0 else self._lowest
        if not speed:
            self._brake(self._acceleration)
        self._ramp([(height, abs(speed) / self._motor.speed_unit)])

    def stop(self) -> None:
        """Brake to rest; a reference search continues."""
        if not self.searching:
            self._positions, self.target_speed = False, 0
            self._brake(self._acceleration)

    def search(self) -> None:
        """Search the home switch: run to it, back off, and come back slowly."""
        if self.driver & OFF:
            return
        fast, slow = self.parameters[194] / self._motor.speed_unit, self.parameters[195] / self._motor.speed_unit
        self._ramp([(0.0, fast), (-BACK_OFF_MM * self._motor.counts_per_mm, fast), (0.0, slow)])
        self._searching = True

    def end_search(self) -> None:
        """End a reference search."""
        if self.searching:
            self._searching, self._positions = False, False
            self._brake(self._acceleration)

    # --- motion ---

    def _follow(self) -> None:
        """Go to the target at the maximum speed; brake if that is 0."""
        height = self._height(self.target)
        speed = self.parameters[MAX_SPEED] / self._motor.speed_unit
        if not speed:
            self._brake(self._acceleration)
        elif height != self._axis.position_at(self._axis.end_s) or self.busy:
            self._ramp([(min(max(height, self._lowest), max(self.carriage_at(self._now_s), 0)), speed)])

    def _ramp(self, legs: list[tuple[float, float]]) -> None:
        if not self.driver & OFF and not self.pressed and all(speed for _, speed in legs):
            self._go(legs, self._acceleration, self._acceleration)

    def _halt(self) -> None:
        self._positions = self._searching = False
        self._brake(inf)

    def _arrive_home(self) -> None:
        super()._arrive_home()
        self.target, self._positions = 0, True

    @property
    def _acceleration(self) -> float:
        return max(self.parameters[ACCELERATION], 1) / self._motor.acceleration_unit


PARAMETERS: dict[int, tuple[Callable[[VirtualTmclAxis], int], Callable[[VirtualTmclAxis, int], None] | None]] = {
    TARGET: (lambda axis: axis.target, VirtualTmclAxis.move_to),
    POSITION: (VirtualTmclAxis.position, VirtualTmclAxis.set_count),
    TARGET_SPEED: (lambda axis: axis.target_speed, VirtualTmclAxis.rotate),
    SPEED: (VirtualTmclAxis.speed, None),
    REACHED: (lambda axis: int(axis.position() == axis.target and not axis.busy), None),
    RIGHT_SWITCH: (lambda axis: axis.switch(RIGHT_SWITCH), None),
    LEFT_SWITCH: (lambda axis: axis.switch(LEFT_SWITCH), None),
    LOST_STEPS: (VirtualTmclAxis.read_lost_steps, None),
    DRIVER: (lambda axis: axis.driver, None),
}
"""Parameters that are no stored value: what reading shows, and what setting does; None for one that is only read."""

Act = Callable[[VirtualTmclAxis, int, int], int | None]
"""Carries out a command on an axis, with its type and value; returns the value of the reply, None for that sent."""
PARAMETER_COMMANDS: dict[int, Act] = {
    SAP: lambda axis, number, value: axis.set_parameter(number, value),
    GAP: lambda axis, number, _: axis.parameter(number),
    STAP: lambda axis, number, _: axis.store(number),
    RSAP: lambda axis, number, _: axis.restore(number),
}
MOTION_COMMANDS: dict[tuple[int, int], Act] = {
    (ROR, 0): lambda axis, _, speed: axis.rotate(speed),
    (ROL, 0): lambda axis, _, speed: axis.rotate(-speed),
    (MST, 0): lambda axis, *_: axis.stop(),
    (MVP, 0): lambda axis, _, target: axis.move_to(target),
    (MVP, 1): lambda axis, _, counts: axis.move_by(counts),
    (RFS, 0): lambda axis, *_: axis.search(),
    (RFS, 1): lambda axis, *_: axis.end_search(),
    (RFS, 2): lambda axis, *_: int(axis.searching),
}


class TmclModules(MotorPair):
    """Modules on one line: each reads nine bytes and replies to those with its address.

    frame_pause_s: pause after which an incomplete frame is dropped; infinite for a module that waits for ever.
    """

    x: VirtualTmclAxis
    z: VirtualTmclAxis

    def __init__(
        self,
        scheduler: Scheduler,
        line: SerialLine,
        modules: Mapping[int, Mapping[int, VirtualTmclAxis]],
        x: VirtualTmclAxis,
        z: VirtualTmclAxis,
        *,
        host: int = 2,
        frame_pause_s: float = 0.02,
    ) -> None:
        self._line, self.modules, self.x, self.z, self._host = line, modules, x, z, host
        self._globals: dict[tuple[int, int, int], int] = {}
        self.heard = Inbox(scheduler, frame_pause_s)
        line.connect(self._hear, self.heard.clear)

    def power_cycle(self) -> None:
        """Switch the modules off and on."""
        self.heard.clear()
        super().power_cycle()

    def _hear(self, data: bytes) -> None:
        self.heard.add(data)
        while len(self.heard.data) >= LENGTH:
            self._read(self.heard.take(LENGTH))

    def _read(self, frame: bytes) -> None:
        address, command, kind, number, value = _BODY.unpack(frame[:-1])
        if address not in self.modules:
            return
        if sum(frame[:-1]) & 0xFF != frame[-1]:
            self._reply(address, BAD_CHECKSUM, command, value)
            return
        if (command, kind) == (VERSION, 0):
            self._line.device_write(bytes([self._host]) + FIRMWARE)
            return
        try:
            self._reply(address, DONE, command, self._obey(address, command, kind, number, value))
        except TmclRefusal as refusal:
            self._reply(address, refusal.status, command, value)

    def _reply(self, address: int, status: int, command: int, value: int) -> None:
        body = _BODY.pack(self._host, address, status, command, value)
        self._line.device_write(body + bytes([sum(body) & 0xFF]))

    def _obey(self, address: int, command: int, kind: int, number: int, value: int) -> int:
        """Execute a command and return the value of its reply. Raises TmclRefusal."""
        place = (address, number, kind)
        if command == VERSION:
            return int.from_bytes(FIRMWARE[1:4], "big")
        if command == SGP:
            self._globals[place] = value
            return value
        if command == GGP:
            return self._globals.get(place, 0)
        axis = self.modules[address].get(number)
        if axis is None:
            raise TmclRefusal(BAD_VALUE)
        act = PARAMETER_COMMANDS.get(command) or MOTION_COMMANDS.get((command, kind))
        if act is None:
            raise TmclRefusal(WRONG_TYPE if command in (ROR, ROL, MST, MVP, RFS) else UNKNOWN_COMMAND)
        found = act(axis, kind, value)
        return value if found is None else found


def tmcl_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualStageSpec) -> TmclModules:
    """Return the modules of both axes on one line. Raises TwinError."""
    x, z = (VirtualTmclAxis(scheduler, spec, name) for name in "xz")
    modules = by_address({"x": x, "z": z}, spec, "tmcl", "motor")
    return TmclModules(scheduler, line, modules, x, z, host=spec.own["host_address"])
