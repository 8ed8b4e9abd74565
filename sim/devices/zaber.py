"""Virtual chain of Zaber X-series devices in the ASCII protocol: settings, motion, homing, warnings and alerts.

Sources: Zaber ASCII protocol manual, firmware 6 and 7; transcripts of zaber-motion 10.3.0. From secondary sources and
so parameters: the units of speed and acceleration. Simplified: the home sensor is at the upper end of every axis, a
command with a wrong checksum gets no reply, and the position counts from where the axis stands until it is homed.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, inf
from typing import Any

from sim.devices.clock import Handle, Scheduler
from sim.devices.counted_motor import CountedMotor, MotorPair
from sim.devices.line import SerialLine, TwinError, VirtualStageSpec

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


@dataclass(frozen=True)
class ZaberUnits:
    """Native speed for one microstep per second, and native acceleration for one microstep per second squared."""

    speed: float = 1.6384
    acceleration: float = 1.6384e-4


class VirtualZaberAxis(CountedMotor):
    """One axis: counts grow from 0 at home downwards; `carriage_at(t)` is its true height in counts, 0 at home.

    start: height at power-on. play: the screw's lost motion. encoder_slip: counts by which the encoder differs from
    the motor's step counter.
    """

    def __init__(
        self,
        scheduler: Scheduler,
        units: ZaberUnits,
        *,
        counts_per_mm: float,
        travel_mm: float,
        acceleration_mm_s2: float,
        resolution: int = 64,
        start: int = 0,
        play: float = 0.0,
    ) -> None:
        super().__init__(scheduler, counts_upwards=False, start=start, play=play)
        self._units, self._counts_per_mm = units, counts_per_mm
        self.encoder_slip = 0
        self.settings: dict[str, int] = {
            "accel": max(ceil(acceleration_mm_s2 * counts_per_mm * units.acceleration), 1),
            "maxspeed": round(25.0 * counts_per_mm * units.speed),
            "limit.min": 0,
            "limit.max": round((travel_mm + 1.0) * counts_per_mm),
            "resolution": resolution,
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
        speed = 2.0 * self._counts_per_mm
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
                return "0"
            case ["get", setting]:
                return self._get(setting)
            case ["set", setting, value]:
                return self._set(setting, value)
            case ["warnings"]:
                found = self.warnings
                return " ".join([f"{len(found):02d}", *found])
            case ["warnings", "clear"]:
                found = self.warnings
                self._warnings -= CLEARED
                return " ".join([f"{len(found):02d}", *found])
            case ["home"]:
                self._begin()
                self._home()
            case ["stop"]:
                self._end(self._acceleration(None))
            case ["estop"]:
                self._end(abs(self._axis.velocity_at(self._now_s)) / ESTOP_S)
            case ["move", "abs" | "rel" | "vel" | "min" | "max" as kind, *numbers]:
                self._move(kind, [_whole(number) for number in numbers])
            case _:
                raise CommandRejected("BADCOMMAND")
        return "0"

    def _get(self, setting: str) -> str:
        if setting == "pos":
            return str(self.position())
        if setting == "encoder.pos":
            return str(self.position() + self.encoder_slip)
        if setting not in self.settings:
            raise CommandRejected("BADCOMMAND")
        return str(self.settings[setting])

    def _set(self, setting: str, value: str) -> str:
        number = _whole(value)
        if setting == "pos":
            self._set_count(number)
            self._homed = True
        elif setting == "resolution" or setting not in self.settings:
            raise CommandRejected("BADCOMMAND")
        elif setting in ("accel", "maxspeed") and number < (setting == "maxspeed"):
            raise CommandRejected("BADDATA")
        else:
            self.settings[setting] = number
        return "0"

    def _move(self, kind: str, numbers: list[int]) -> None:
        """Move to, by, at, or to a limit: [number] [speed [acceleration]]."""
        least = 0 if kind in ("min", "max") else 1
        if not least <= len(numbers) <= least + (1 if kind == "vel" else 2):
            raise CommandRejected("BADCOMMAND")
        first, rest = (numbers[0] if least else 0), numbers[least:]
        low, high = self.settings["limit.min"], self.settings["limit.max"]
        if kind == "vel":
            speed, target = abs(first), high if first > 0 else low
            rest = [speed, *rest]
            if not first:
                self._end(self._acceleration(None))
                return
        else:
            target = {"abs": first, "rel": self.position() + first, "min": low, "max": high}[kind]
        if not low <= target <= high or any(number < 0 for number in rest):
            raise CommandRejected("BADDATA")
        self._begin()
        native = rest[0] if rest and rest[0] else self.settings["maxspeed"]
        acceleration = self._acceleration(rest[1] if len(rest) > 1 and rest[1] else None)
        self._ramp([(self._height(target), native / self._units.speed)], acceleration)

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
        fast, off = HOME_MM_S * self._counts_per_mm, BACK_OFF_MM * self._counts_per_mm
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
        return accel / self._units.acceleration if accel else 1e4 * self._counts_per_mm


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
                return " ".join([f"{len(found):02d}", *found])
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
    own = spec.own
    units = ZaberUnits(own["speed_unit"], own["acceleration_unit"])
    places = {name: (own[name]["address"], own[name]["axis"]) for name in "xz"}
    if places["x"] == places["z"]:
        raise TwinError("zaber: x and z have one address and axis; give each its own", "same_axis")
    axes = {name: _axis(scheduler, units, spec, name, own[name]) for name in "xz"}
    devices: dict[int, dict[int, VirtualZaberAxis]] = {}
    for name, (address, number) in places.items():
        devices.setdefault(address, {})[number] = axes[name]
    chain = [VirtualZaberDevice(address, dict(sorted(those.items()))) for address, those in sorted(devices.items())]
    return ZaberChain(line, chain, axes["x"], axes["z"])


def _axis(
    scheduler: Scheduler, units: ZaberUnits, spec: VirtualStageSpec, name: str, own: Mapping[str, Any]
) -> VirtualZaberAxis:
    number = "xyz".index(name)
    counts_per_mm = abs(spec.steps_per_mm[number])
    return VirtualZaberAxis(
        scheduler,
        units,
        counts_per_mm=counts_per_mm,
        travel_mm=spec.travel_mm[number],
        acceleration_mm_s2=spec.acceleration_mm_s2,
        resolution=own["resolution"],
        start=round(-10.0 * counts_per_mm),
        play=spec.play_steps[number],
    )
