"""Virtual chain of Zaber X-series devices in the ASCII protocol: settings, motion, homing, warnings and alerts.

Sources: Zaber ASCII protocol manual, firmware 6 and 7; transcripts of zaber-motion 10.3.0. From secondary sources and
so parameters: the units of speed and acceleration. Simplified: the home sensor is at the upper end of every axis, a
command with a wrong checksum gets no reply, and the position counts from where the axis stands until it is homed.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, inf

from sim.devices.clock import Handle, Scheduler
from sim.devices.counted_motor import CountedMotor, MotorPair, MotorSpec, by_address
from sim.devices.line import SerialLine, VirtualStageSpec

PRIORITY = (
    "FF", "FN", "FZ", "FH", "FV", "FO", "FC", "FM", "FD", "FQ", "FI", "FA", "FR", "FS", "FB", "FP", "FE", "FT",
    "WL", "WV", "WT", "WS", "WM", "WP", "WR", "WH", "NC", "NI", "ND", "NR", "NT", "NU", "NJ", "NB",
)  # fmt: skip
"""Warnings, the highest first."""
DISABLING = frozenset(("FF", "FH", "FV", "FO", "FC", "FM", "FD"))
CLEARED = frozenset(("FQ", "FI", "FA", "FR", "FS", "FB", "FP", "FE", "FT", "WL", "WS"))
"""Warnings that stay until they are cleared; the others end with their cause, or with the next movement."""
NO_WARNING = "--"
DEVICE_ID, FIRMWARE, BUILD = 50081, "7.38", "20000"
ESTOP_S, BACK_OFF_MM, HOME_MM_S = 0.01, 0.5, 5.0
_SEALED = re.compile(rb"/(.*):([0-9A-F]{2})")
_LONGEST = 256


class CommandRejected(Exception):  # noqa: N818
    """A command that gets the flag RJ; its text is the data of the reply."""


class VirtualZaberAxis(CountedMotor):
    """One axis: counts grow from 0 at home downwards; `carriage_at(t)` is its true height in counts, 0 at home.

    encoder_slip: counts by which the encoder differs from the motor's step counter.
    """

    def __init__(self, scheduler: Scheduler, spec: VirtualStageSpec, name: str) -> None:
        motor = MotorSpec.of(spec, name)
        super().__init__(scheduler, counts_upwards=False, start=motor.start, play=motor.play)
        self._motor, per_mm = motor, motor.counts_per_mm
        self.encoder_slip = 0
        self.settings: dict[str, int] = {
            "accel": max(ceil(motor.acceleration_mm_s2 * per_mm * motor.acceleration_unit), 1),
            "maxspeed": round(25.0 * per_mm * motor.speed_unit),
            "limit.min": 0,
            "limit.max": round((motor.travel_mm + 1.0) * per_mm),
            "resolution": spec.own[name]["resolution"],
        }
        self._warnings: set[str] = set()
        self._ending: Handle | None = None
        self.on_idle: Callable[[], None] = lambda: None

    # --- truth, and what an operator or an accident does ---

    def power_cycle(self) -> None:
        """Switch off and on: the carriage stops at once, the home position and the warnings are lost."""
        super().power_cycle()
        self._warnings.clear()

    def stall(self) -> None:
        """Block the carriage: the axis stops and shows FS."""
        self.fail("FS")

    def fail(self, flag: str) -> None:
        """Stop at once with a fault or a warning that stays until it is cleared."""
        self._brake(inf)
        self._searching = False
        self._warnings.add(flag)
        self.on_idle()

    def warn(self, flag: str) -> None:
        """Show a warning and continue, as after a stall with recovery (WS)."""
        self._warnings.add(flag)

    def repair(self, flag: str) -> None:
        """Remove the cause of a fault."""
        self._warnings.discard(flag)

    def turn_knob(self, counts: int) -> None:
        """Move by hand at the knob."""
        if self.busy:
            self._warnings.add("NI")
        self._warnings.add("NC")
        speed = 2.0 * self._motor.counts_per_mm
        self._ramp([(self._axis.position_at(self._now_s) - counts, speed)], self._acceleration(None))

    # --- state ---

    @property
    def warnings(self) -> list[str]:
        """Active warnings, the highest first."""
        self._settle()
        found = self._warnings | (set() if self._homed else {"WR"})
        return sorted(found, key=PRIORITY.index)

    # --- commands ---

    def obey(self, words: Sequence[str]) -> str:
        """Execute a command of an axis and return the data of its reply. Raises CommandRejected."""
        self._settle()
        match list(words):
            case []:
                pass
            case ["get", setting]:
                return self._get(setting)
            case ["set", setting, value]:
                return self._set(setting, value)
            case ["warnings"] | ["warnings", "clear"]:
                found = self.warnings
                self._warnings -= CLEARED if words[1:] else set()
                return _listed(found)
            case ["home"]:
                self._begin()
                self._home()
            case ["stop"]:
                self._end(self._acceleration(None))
            case ["estop"]:
                self._end(abs(self._axis.velocity_at(self._now_s)) / ESTOP_S)
            case ["move", kind, *numbers] if kind in MOVES:
                self._move(kind, [_whole(number) for number in numbers])
            case _:
                raise CommandRejected("BADCOMMAND")
        return "0"

    def _get(self, setting: str) -> str:
        at = self.position()
        shown = {**self.settings, "pos": at, "encoder.pos": at + self.encoder_slip}
        if setting not in shown:
            raise CommandRejected("BADCOMMAND")
        return str(shown[setting])

    def _set(self, setting: str, value: str) -> str:
        number = _whole(value)
        if setting not in LEAST:
            raise CommandRejected("BADCOMMAND")
        if number < LEAST[setting]:
            raise CommandRejected("BADDATA")
        if setting == "pos":
            self.set_count(number)
            self._homed = True
        else:
            self.settings[setting] = number
        return "0"

    def _move(self, kind: str, numbers: list[int]) -> None:
        """Move: [number] [speed [acceleration]]."""
        fewest, most, target_of = MOVES[kind]
        if not fewest <= len(numbers) <= most:
            raise CommandRejected("BADCOMMAND")
        first, rest = (numbers[0] if fewest else 0), numbers[fewest:]
        if kind == "vel":
            if not first:
                self._end(self._acceleration(None))
                return
            rest = [abs(first), *rest]
        target = target_of(self, first)
        if not self.settings["limit.min"] <= target <= self.settings["limit.max"] or any(n < 0 for n in rest):
            raise CommandRejected("BADDATA")
        self._begin()
        native = rest[0] if rest and rest[0] else self.settings["maxspeed"]
        acceleration = self._acceleration(rest[1] if len(rest) > 1 and rest[1] else None)
        self._ramp([(self._height(target), native / self._motor.speed_unit)], acceleration)

    def _begin(self) -> None:
        """Begin a movement command, which interrupts a running one and clears the warnings that last until then."""
        if any(flag in DISABLING for flag in self._warnings):
            raise CommandRejected("DRIVERDISABLED")
        if self.busy and "NC" not in self._warnings:
            self._warnings.add("NI")
        else:
            self._warnings -= {"NI", "WM", "NC"}
        self._searching = False

    def _end(self, deceleration: float) -> None:
        if self.busy:
            self._warnings.add("NI")
            self._searching = False
            self._brake(deceleration)
            self._schedule_end()

    def _home(self) -> None:
        fast, off = HOME_MM_S * self._motor.counts_per_mm, BACK_OFF_MM * self._motor.counts_per_mm
        homed = self._homed  # Until the search ends.
        self._search([(0.0, fast), (-off, fast), (0.0, fast / 10)], *2 * (self._acceleration(None),))
        self._homed = homed
        self._schedule_end()

    def _arrive_home(self) -> None:
        super()._arrive_home()
        self._warnings.discard("WH")

    def _ramp(self, legs: list[tuple[float, float]], acceleration: float) -> None:
        self._go(legs, acceleration, acceleration)
        self._schedule_end()

    def _schedule_end(self) -> None:
        if self._ending is not None:
            self._ending.cancel()
        self._ending = self._scheduler.call_at(self._axis.end_s, self.on_idle)

    def _acceleration(self, native: int | None) -> float:
        """Return counts/s²; 0 is as fast as the motor can."""
        accel = self.settings["accel"] if native is None else native
        return accel / self._motor.acceleration_unit if accel else 1e4 * self._motor.counts_per_mm


LEAST = {"accel": 0, "maxspeed": 1, "limit.min": -inf, "limit.max": -inf, "pos": -inf}
"""Settings of an axis that can be set, with their least values."""
MOVES: dict[str, tuple[int, int, Callable[[VirtualZaberAxis, int], int]]] = {
    "abs": (1, 3, lambda axis, count: count),
    "rel": (1, 3, lambda axis, count: axis.position() + count),
    "vel": (1, 2, lambda axis, speed: axis.settings["limit.max" if speed > 0 else "limit.min"]),
    "min": (0, 2, lambda axis, _: axis.settings["limit.min"]),
    "max": (0, 2, lambda axis, _: axis.settings["limit.max"]),
}
"""Kinds of the command `move`: least and largest number of values, and the target from the first one."""


def _listed(warnings: list[str]) -> str:
    return " ".join([f"{len(warnings):02d}", *warnings])


def _whole(text: str) -> int:
    if not re.fullmatch(r"-?\d{1,10}", text):
        raise CommandRejected("BADDATA")
    return int(text)


@dataclass
class VirtualZaberDevice:
    """Device of a chain with its axes, by number; settings of the device itself by name."""

    address: int
    axes: Mapping[int, VirtualZaberAxis]
    settings: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.settings = {
            "deviceid": str(DEVICE_ID),
            "version": FIRMWARE,
            "version.build": BUILD,
            "system.serial": str(10000 + self.address),
            "system.axiscount": str(len(self.axes)),
            "system.access": "1",
            "device.hw.modified": "0",
            "comm.address": str(self.address),
            "comm.alert": "0",
            "comm.checksum": "1",
            "comm.packet.size.max": "80",
            "comm.command.packets.max": "10",
            "comm.word.size.max": "50",
            "get.settings.max": "1",
            **self.settings,
        }

    def flags(self, axis: int) -> tuple[str, str]:
        """Return the state and the highest warning of an axis, or of all for 0."""
        those = list(self.axes.values()) if axis == 0 else [self.axes[axis]]
        shown = sorted({flag for one in those for flag in one.warnings}, key=PRIORITY.index)
        return "BUSY" if any(one.busy for one in those) else "IDLE", shown[0] if shown else NO_WARNING

    def obey(self, axis: int, words: Sequence[str]) -> str:
        """Execute a command and return the data of its reply. Raises CommandRejected."""
        if axis:
            if list(words[:1]) in (["get"], ["set"]) and words[1:2] and words[1] in self.settings:
                raise CommandRejected("DEVICEONLY")
            return self.axes[axis].obey(words)
        match list(words):
            case ["get", setting] if setting in self.settings:
                return self.settings[setting]
            case ["set", "comm.alert" | "comm.checksum" as setting, "0" | "1" as value]:
                self.settings[setting] = value
                return "0"
            case ["system", "reset"]:
                for one in self.axes.values():
                    one.power_cycle()
                return "0"
            case ["warnings", *_]:
                found = sorted({flag for one in self.axes.values() for flag in one.warnings}, key=PRIORITY.index)
                for one in self.axes.values():
                    one.obey(words)
                return _listed(found)
        found = [one.obey(words) for one in self.axes.values()]
        return " ".join(found) if list(words[:1]) == ["get"] else found[0]


class ZaberChain(MotorPair):
    """Devices on one line: it reads commands, and each addressed device replies in turn."""

    x: VirtualZaberAxis
    z: VirtualZaberAxis

    def __init__(
        self,
        line: SerialLine,
        devices: Sequence[VirtualZaberDevice],
        x: VirtualZaberAxis,
        z: VirtualZaberAxis,
    ) -> None:
        self._line, self.devices, self.x, self.z = line, {one.address: one for one in devices}, x, z
        self._heard = b""
        self._begun: dict[tuple[int, int, int | None], str] = {}
        line.connect(self._hear, self._forget)
        for device in devices:
            for number, axis in device.axes.items():
                axis.on_idle = lambda device=device, number=number: self._alert(device, number)  # type: ignore[misc]

    def power_cycle(self) -> None:
        """Switch the chain off and on."""
        self._forget()
        super().power_cycle()

    def _forget(self) -> None:
        self._heard = b""
        self._begun.clear()

    def _hear(self, data: bytes) -> None:
        *lines, rest = re.split(rb"[\r\n]", self._heard + data)
        self._heard = rest[-_LONGEST:]
        for line in lines:
            if line.startswith(b"/"):
                self._read(line)

    def _read(self, line: bytes) -> None:
        sealed = _SEALED.fullmatch(line)
        if sealed is not None:
            if -sum(sealed[1]) & 0xFF != int(sealed[2], 16):
                return
            line = b"/" + sealed[1]
        words = line[1:].decode("latin-1").split()
        numbers: list[int] = []
        while words and len(numbers) < 3 and re.fullmatch(r"\d+|--", words[0]):
            numbers.append(-1 if words[0] == "--" else int(words[0]))
            del words[0]
        address, axis, number = (*numbers, *(0, 0, -1)[len(numbers) :])
        self._execute(address, axis, None if number < 0 else number, words)

    def _execute(self, address: int, axis: int, number: int | None, words: list[str]) -> None:
        place = (address, axis, number)
        if words[:1] == ["cont"]:
            words = [*self._begun.pop(place, "").split(), *words[2:]]
        if words and words[-1].endswith("\\"):
            self._begun[place] = " ".join(words)[:-1]
            return
        those = list(self.devices.values()) if address == 0 else [self.devices.get(address)]
        for device in those:
            if device is not None:
                self._answer(device, axis, number, words)

    def _answer(self, device: VirtualZaberDevice, axis: int, number: int | None, words: list[str]) -> None:
        flag, scope = "OK", axis if axis in (0, *device.axes) else 0
        try:
            if scope != axis:
                raise CommandRejected("BADAXIS")
            if number is not None and number > 99:
                raise CommandRejected("BADMESSAGEID")
            data = device.obey(axis, words)
        except CommandRejected as refusal:
            flag, data = "RJ", str(refusal)
        state, warning = device.flags(scope)
        shown = "" if number is None else f" {number:02d}"
        self._send(device, f"@{device.address:02d} {scope}{shown} {flag} {state} {warning} {data}")

    def _alert(self, device: VirtualZaberDevice, number: int) -> None:
        if device.settings["comm.alert"] == "1":
            state, warning = device.flags(number)
            self._send(device, f"!{device.address:02d} {number} {state} {warning}")

    def _send(self, device: VirtualZaberDevice, line: str) -> None:
        content = line.encode("ascii")
        seal = f":{-sum(content[1:]) & 0xFF:02X}" if device.settings["comm.checksum"] == "1" else ""
        self._line.device_write(content + seal.encode("ascii") + b"\r\n")


def zaber_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualStageSpec) -> ZaberChain:
    """Return the devices of both axes on one line. Raises TwinError."""
    x, z = (VirtualZaberAxis(scheduler, spec, name) for name in "xz")
    devices = by_address({"x": x, "z": z}, spec, "zaber", "axis")
    return ZaberChain(line, [VirtualZaberDevice(address, axes) for address, axes in devices.items()], x, z)
