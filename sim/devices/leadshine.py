"""Virtual Leadshine CS2RS / iEM-RS drive in PR mode: registers, motion, homing, alarms and jog.

Source: CS2RS and iEM-RS user manuals. From secondary sources and so parameters: the unit of the ramp words, and the
registers of pulses per turn and jog speed. Also from secondary sources: the types of a path (0 none, 3 homing), that
a path is read when it is triggered, and that trigger words 10 to 1F run PR0 to PR15. Simplified: the home switch is
at the positive end in every homing mode; a path triggered while another runs brakes to rest first; a path cannot jump
to another.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from sim.devices.clock import Scheduler
from sim.devices.counted_motor import CountedMotor, MotorPair
from sim.devices.line import SerialLine, TwinError, VirtualStageSpec
from sim.devices.modbus import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusBus, RegisterFault, signed, words

STATUS, FEEDBACK, FEEDBACK_RPM, COMMANDED, ALARM = 0x1003, 0x1014, 0x1046, 0x602C, 0x2203
CONTROL, TRIGGER, PR0, PR0_TRIGGER = 0x1801, 0x6002, 0x6200, 0x6207
SOFT_LIMITS, POSITIVE_LIMIT, NEGATIVE_LIMIT = 0x6000, 0x6006, 0x6008
HOMING_HIGH, HOMING_LOW, HOMING_RAMP_UP, HOMING_RAMP_DOWN = 0x600F, 0x6010, 0x6011, 0x6012
PATHS, PATH_REGISTERS = 16, 8
NO_PATH, ABSOLUTE, VELOCITY, HOMING, RELATIVE = 0x0000, 0x0001, 0x0002, 0x0003, 0x0041
RUN_PR0, HOME, SET_ZERO, QUICK_STOP = 0x0010, 0x0020, 0x0021, 0x0040
CLEAR_ALARM, SAVE, SAVE_MAPPING, JOG_POSITIVE, JOG_NEGATIVE = 0x1111, 0x2211, 0x2244, 0x4001, 0x4002
FAULT, ENABLED, RUNNING, COMMAND_DONE, PATH_DONE, HOMED = (1 << bit for bit in (0, 1, 2, 4, 5, 6))
JOG_S = 0.05
QUICK_STOP_S = 0.01
_FOREVER_S = 3600.0
_NO_LIMIT = 1 << 31
_OUTPUTS_KEPT = 1000


@dataclass(frozen=True)
class DriveParameters:
    """Settings of the drive itself, and differences between drives.

    inverted: the motor runs against the axis. ramp_rpm: the ramp words are ms for this speed. output_register
    switches a plain digital output. inputs_register shows the digital inputs.
    """

    pulses_per_rev: int = 400
    inverted: bool = False
    ramp_rpm: float = 1000.0
    pulses_per_rev_register: int = 0x0001
    jog_rpm_register: int = 0x01E1
    output_register: int | None = None
    inputs_register: int = 0x0179


class VirtualDrive(CountedMotor):
    """Registers of one drive; its carriage is `carriage_at(t)` pulses from the home switch, + towards it.

    start: position of the carriage at power-on. play: the screw's lost motion, pulses. The drive knows neither.
    stored: EEPROM contents that differ from the maker's, by register, such as user paths.
    """

    functions = frozenset({0x03, 0x06, 0x10})

    def __init__(
        self,
        scheduler: Scheduler,
        parameters: DriveParameters | None = None,
        *,
        start: int = -4000,
        play: float = 0.0,
        stored: Mapping[int, int] | None = None,
    ) -> None:
        self._parameters = parameters or DriveParameters()
        super().__init__(scheduler, counts_upwards=not self._parameters.inverted, start=start, play=play)
        paths = range(PR0, PR0 + PATHS * PATH_REGISTERS)
        self._stored = dict.fromkeys((*range(0x6000, 0x6015), *paths, CONTROL), 0)
        self._stored[self._parameters.pulses_per_rev_register] = self._parameters.pulses_per_rev
        self._stored[self._parameters.jog_rpm_register] = 60
        self._stored |= {HOMING_HIGH: 200, HOMING_LOW: 50, HOMING_RAMP_UP: 100, HOMING_RAMP_DOWN: 100}
        if self._parameters.output_register is not None:
            self._stored[self._parameters.output_register] = 0
        self._stored |= stored or {}
        self.outputs: deque[tuple[float, int]] = deque(maxlen=_OUTPUTS_KEPT)  # all switching events: s, word
        self._inputs = 0  # pressed inputs as bits, DI1 lowest; each is configured as a quick stop
        self._stopped_s = -1.0  # end of the last quick stop, so that a running one is not restarted
        self.eeprom_saves = 0
        triggers: dict[int, Callable[[], None]] = {
            **{RUN_PR0 + n: partial(self._path, PR0 + PATH_REGISTERS * n) for n in range(PATHS)},
            HOME: self._home,
            SET_ZERO: self._set_zero,
            QUICK_STOP: self._stop,
        }
        controls: dict[int, Callable[[], None]] = {
            CLEAR_ALARM: self._clear,
            **dict.fromkeys((SAVE, SAVE_MAPPING), self._save),
            JOG_POSITIVE: partial(self._jog, 1),
            JOG_NEGATIVE: partial(self._jog, -1),
        }
        self._words = {PR0_TRIGGER: triggers, TRIGGER: triggers, CONTROL: controls}
        """Registers that execute a word, and the meanings of words there."""
        self.power_cycle()

    def power_cycle(self) -> None:
        """Switch off and on: the carriage stops at once, its position becomes zero, unsaved registers are lost."""
        super().power_cycle()
        self._held = dict(self._stored)
        self._alarm, self._done = 0, True

    def press(self, number: int) -> None:
        """Press the button wired to DI1 … DI7: a quick stop that prevents motion until release."""
        self._settle()
        self._inputs |= 1 << number - 1
        self._stop()

    def release(self, number: int) -> None:
        """Release the button."""
        self._inputs &= ~(1 << number - 1)

    def fault(self, code: int) -> None:
        """Raise an alarm: the motor stops, and cannot move until the alarm is cleared."""
        self._alarm = code
        self._stop()

    def read(self, address: int, count: int) -> list[int]:
        """Return current registers. Raises RegisterFault."""
        self._settle()
        shown = self._held | self._shown()
        try:
            return [shown[n] for n in range(address, address + count)]
        except KeyError:
            raise RegisterFault(ILLEGAL_ADDRESS) from None

    def write(self, address: int, values: Sequence[int]) -> None:
        """Write registers and execute trigger and control words. Raises RegisterFault."""
        self._settle()
        if any(n not in self._held for n in range(address, address + len(values))):
            raise RegisterFault(ILLEGAL_ADDRESS)
        self._held |= dict(enumerate(values, address))
        output = self._parameters.output_register
        if output is not None and address <= output < address + len(values):
            self.outputs.append((self._scheduler.monotonic_s(), self._held[output]))
        for register, meanings in self._words.items():
            if address <= register < address + len(values) and self._held[register]:
                word, self._held[register] = self._held[register], 0
                if word not in meanings:
                    raise RegisterFault(ILLEGAL_VALUE)
                meanings[word]()

    # --- reading ---

    def _shown(self) -> dict[int, int]:
        now_s = self._scheduler.monotonic_s()
        position = words(self._count(now_s))
        rpm = words(round(self._sign * self._axis.velocity_at(now_s) / self._per_rpm))
        shown = {STATUS: self._status(now_s), ALARM: self._alarm}
        shown[self._parameters.inputs_register] = self._inputs
        for first, pair in ((COMMANDED, position), (FEEDBACK, position), (FEEDBACK_RPM, rpm)):
            shown |= {first: pair[0], first + 1: pair[1]}
        return shown

    def _status(self, now_s: float) -> int:
        moving = self._axis.moving(now_s)
        status = RUNNING if moving else (COMMAND_DONE | PATH_DONE) * self._done
        return status | (FAULT if self._alarm else ENABLED) | HOMED * self._homed

    # --- commands ---

    def _clear(self) -> None:
        self._alarm = 0

    def _save(self) -> None:
        self.eeprom_saves += 1
        self._stored = dict(self._held)

    def _jog(self, sign: int) -> None:
        self._run(sign * self._held[self._parameters.jog_rpm_register], JOG_S, self._ramps(HOMING_RAMP_UP))

    def _set_zero(self) -> None:
        self.set_count(0)
        self._homed = True

    def _path(self, first: int) -> None:
        if self._blocked():
            return
        mode, high, low, rpm = (self._held[first + n] for n in range(4))
        if mode not in (NO_PATH, ABSOLUTE, RELATIVE, VELOCITY, HOMING):
            raise RegisterFault(ILLEGAL_VALUE)
        ramps = self._ramps(first + 4)
        if mode == HOMING:
            self._home()
        elif mode == VELOCITY:
            self._run(rpm - (rpm << 1 & 0x10000), _FOREVER_S, ramps)
        elif mode != NO_PATH and rpm:
            target = signed(high, low) + (self._count(self._axis.end_s) if mode == RELATIVE else 0)
            allowed = min(max(target, self._limits()[0]), self._limits()[1])
            self._searching, self._done = False, allowed == target
            self._go([(self._height(allowed), rpm * self._per_rpm)], *ramps)

    def _run(self, rpm: int, for_s: float, ramps: tuple[float, float]) -> None:
        if self._blocked() or not rpm:
            return
        now_s = self._scheduler.monotonic_s()
        low, high = self._limits()
        room = high - self._count(now_s) if rpm > 0 else self._count(now_s) - low
        self._searching = False
        self._axis.keep_going(self._sign * rpm * self._per_rpm, *ramps, for_s, max(room, 0), now_s)

    def _home(self) -> None:
        """Run fast to the switch, half a turn back, and slowly to it again."""
        fast, slow = (self._held[n] * self._per_rpm for n in (HOMING_HIGH, HOMING_LOW))
        if self._blocked() or not (fast and slow):
            return
        half_turn = self._held[self._parameters.pulses_per_rev_register] / 2
        self._done = True
        self._search([(0.0, fast), (-half_turn, fast), (0.0, slow)], *self._ramps(HOMING_RAMP_UP))

    def _stop(self) -> None:
        now_s = self._scheduler.monotonic_s()
        speed = abs(self._axis.velocity_at(now_s))
        self._searching = self._done = False
        if speed and self._stopped_s != self._axis.end_s:
            self._axis.brake(speed / QUICK_STOP_S, now_s)
            self._stopped_s = self._axis.end_s

    def _blocked(self) -> bool:
        return bool(self._alarm or self._inputs)

    # --- units ---

    @property
    def _per_rpm(self) -> float:
        return self._held[self._parameters.pulses_per_rev_register] / 60

    def _ramps(self, register: int) -> tuple[float, float]:
        """Return ramps up and down in pulses/s², from two words in ms for ramp_rpm."""
        up, down = (
            1000 * self._parameters.ramp_rpm * self._per_rpm / max(self._held[register + n], 1) for n in (0, 1)
        )
        return up, down

    def _limits(self) -> tuple[int, int]:
        """Return the soft limits in counts, (lowest, highest)."""
        if not (self._held[SOFT_LIMITS] & 2 and self._homed):
            return -_NO_LIMIT, _NO_LIMIT
        low, high = (signed(self._held[n], self._held[n + 1]) for n in (NEGATIVE_LIMIT, POSITIVE_LIMIT))
        return low, high


class DrivePair(MotorPair):
    """Two drives as a stage: x lateral, z vertical, y set by hand."""

    x: VirtualDrive
    z: VirtualDrive

    def __init__(self, x: VirtualDrive, z: VirtualDrive) -> None:
        self.x, self.z = x, z

    def press(self, name: str) -> None:
        """Press an input of the vertical drive, di1 … di7."""
        self.z.press(int(name.removeprefix("di")))

    def release(self, name: str) -> None:
        """Release an input of the vertical drive."""
        self.z.release(int(name.removeprefix("di")))


def leadshine_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualStageSpec) -> DrivePair:
    """Return both drives on one line, whichever ports the real ones use. Raises TwinError."""
    x, z = spec.own["x"], spec.own["z"]
    if x["device_id"] == z["device_id"]:
        raise TwinError("drives: the virtual drives share one port; give each another device id", "same_device_id")
    pair = DrivePair(_drive(scheduler, spec, "x", x), _drive(scheduler, spec, "z", z))
    ModbusBus(scheduler, line, {x["device_id"]: pair.x, z["device_id"]: pair.z}, framing=spec.framing)
    return pair


def _drive(scheduler: Scheduler, spec: VirtualStageSpec, axis: str, drive: Mapping[str, Any]) -> VirtualDrive:
    number = "xyz".index(axis)
    parameters = DriveParameters(
        pulses_per_rev=drive["pulses_per_rev"],
        inverted=spec.steps_per_mm[number] < 0,
        ramp_rpm=drive["ramp_rpm"],
        pulses_per_rev_register=drive["pulses_per_rev_register"],
        jog_rpm_register=drive["jog_rpm_register"],
        inputs_register=spec.inputs_register,
        output_register=spec.sync["register_address"] if axis == spec.sync["drive"] else None,
    )
    return VirtualDrive(scheduler, parameters, play=spec.play_steps[number])
