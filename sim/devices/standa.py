"""Virtual Standa 8SMC controller in its binary protocol: settings, motion, homing, limit switches, alarms.

Sources: Standa 8SMC5-USB manual, communication protocol; protocol.xi of libximc, version 20.8. Simplified: homing
runs to the switch and back by HomeDelta, whatever the flags of the second motion say; in an alarm every command but
`stop` is confirmed and ignored; an error discards the received bytes; power-off loses the home position; a stop while
the motor turns is harsh at any speed.
"""

import struct
from collections.abc import Callable, Sequence
from functools import partial
from math import inf, trunc

from pymodbus.framer import FramerRTU

from sim.devices.clock import Scheduler
from sim.devices.counted_motor import CountedMotor, Inbox, MotorPair, MotorSpec
from sim.devices.line import SerialLine, VirtualStageSpec

SETTINGS = {
    "fbs": 18, "hom": 33, "mov": 30, "eng": 34, "ent": 14, "pwr": 20, "sec": 28, "eds": 26, "pid": 48, "sni": 28,
    "sno": 16, "eio": 18, "brk": 25, "ctl": 93, "joy": 22, "ctp": 18, "urt": 16, "net": 38, "pwd": 36, "cal": 118,
    "nmf": 30, "nvm": 36, "emf": 48, "eas": 54, "est": 46, "nme": 30, "sti": 70, "sts": 70, "mti": 70, "mts": 112,
    "eni": 70, "ens": 54, "hsi": 70, "hss": 50, "gri": 70, "grs": 58, "acc": 114,
}  # fmt: skip
"""Length of the frame that sets or returns each group of settings."""
IGNORED = ("save", "read", "sars", "rers", "eesv", "eerd")
"""Commands that are confirmed and change nothing."""
LETTERS, CRC_BYTES, FORGETS_S = 4, 2, 0.4

MOVE, MOVR, LEFT, RIGHT, STOP, HOME, SSTP = 1, 2, 3, 4, 5, 6, 8
FAILED, RUNNING = 0x40, 0x80
ERRC, ERRD, ERRV, HOMED, ALARM = 0x01, 0x02, 0x04, 0x20, 0x40
RIGHT_EDGE, LEFT_EDGE, BUTTON_RIGHT = 0x01, 0x02, 0x04
POWER_OFF, POWER_ON = 1, 3
ACCELERATES, STOPS_AT_EDGES, HOMES_RIGHT, HOMES_TO_LIMIT = 0x10, 0x06, 0x01, 0x30
FASTEST = 100_000
BEYOND_MM = 0.5


def crc(payload: bytes) -> bytes:
    """Return the CRC-16 of Modbus, low byte first."""
    return FramerRTU.compute_CRC(payload).to_bytes(CRC_BYTES, "big")


def frame(letters: str, payload: bytes = b"") -> bytes:
    """Return a frame."""
    return letters.encode("ascii") + payload + (crc(payload) if payload else b"")


class VirtualStandaController(CountedMotor):
    """Controller of one axis on its line; heights are in microsteps, 0 where homing ends.

    Where the upper switch is the right one, its count grows upwards.
    """

    def __init__(
        self, scheduler: Scheduler, line: SerialLine, spec: VirtualStageSpec, name: str, serial: int
    ) -> None:
        own, motor = spec.own[name], MotorSpec.of(spec, name)
        per_mm, microsteps = motor.counts_per_mm, own["microsteps"]
        switches = round(BEYOND_MM * per_mm), -round((motor.travel_mm + 1.0) * per_mm)
        super().__init__(
            scheduler,
            counts_upwards=own["home"] == "right",
            start=motor.start,
            play=motor.play,
            switches=switches,
        )
        self._line, self._serial, self._microsteps = line, serial, microsteps
        steps_per_mm = per_mm / microsteps
        ramp = min(max(round(1.2 * motor.acceleration_mm_s2 * steps_per_mm), 1), 0xFFFF)
        delta, part = divmod(switches[0], microsteps)
        homing = (round(5 * steps_per_mm), 0, round(steps_per_mm), 0, -self._sign * delta, -self._sign * part)
        self.settings = {name: bytes(length - LETTERS - CRC_BYTES) for name, length in SETTINGS.items()}
        self.settings |= {
            "hom": struct.pack("<IBIBihH9x", *homing, HOMES_TO_LIMIT | HOMES_RIGHT * (self._sign > 0)),
            "mov": struct.pack("<IBHHIBB9x", round(2 * steps_per_mm), 0, ramp, ramp, 0, 0, 0),
            "eng": struct.pack("<HHIBHhBH12x", 0, 500, 5000, 0, ACCELERATES, 0, microsteps.bit_length(), 200),
            "eds": struct.pack("<BBihih6x", STOPS_AT_EDGES, 0, 0, 0, 0, 0),
            "pwr": struct.pack("<BHHHB6x", 50, 1000, 60, 300, 0),
        }
        self._command, self._failed, self._power = 0, False, POWER_OFF
        self.flags = self.inputs = 0
        self._causes = 0
        self._commands = self._table()
        self._heard = Inbox(scheduler, FORGETS_S)
        line.connect(self._hear, self._heard.clear)

    # --- truth, and what an operator or an accident does ---

    def power_cycle(self) -> None:
        """Switch off and on: the carriage stops at once, and the home position is lost."""
        super().power_cycle()
        self._command, self._failed, self._power, self.flags = 0, False, POWER_OFF, 0
        self._heard.clear()

    def fail(self, flag: int, *, lasting: bool = False) -> None:
        """Enter the alarm state with a flag that stays until a stop; lasting: also after it."""
        self._brake(inf)
        self._causes = ALARM | flag if lasting else 0
        self.flags |= ALARM | flag
        self._power = POWER_OFF

    def slip(self, counts: int) -> None:
        """Lose steps: the position counter no longer matches the carriage."""
        self._zero += counts

    def push_button(self) -> None:
        """Hold down the button `right` of the controller, which moves the axis."""
        self.inputs |= BUTTON_RIGHT
        self._commands["rigt"][1](b"")

    # --- state ---

    def edges(self) -> int:
        """Return the active limit switches."""
        home, far = (RIGHT_EDGE, LEFT_EDGE) if self._sign > 0 else (LEFT_EDGE, RIGHT_EDGE)
        return home * self.at_home | far * self.at_far_end

    # --- frames ---

    def _hear(self, data: bytes) -> None:
        heard = self._heard
        heard.add(data)
        while heard.data:
            zeros = len(heard.data) - len(heard.data.lstrip(b"\0"))
            if zeros:
                self._line.device_write(heard.take(zeros))
                continue
            if len(heard.data) < LETTERS:
                return
            letters = heard.data[:LETTERS].decode("latin-1")
            if letters not in self._commands:
                self._refuse("errc", ERRC)
                return
            length, obey = self._commands[letters]
            if len(heard.data) < length:
                return
            payload, seal = heard.data[LETTERS : length - CRC_BYTES], heard.data[length - CRC_BYTES : length]
            if length > LETTERS and crc(payload) != seal:
                self._refuse("errd", ERRD)
                return
            heard.take(length)
            self._settle()
            reply = obey(payload) or b""
            self._line.device_write(reply if reply == b"errv" else frame(letters, reply))

    def _refuse(self, word: str, flag: int) -> None:
        self.flags |= flag
        self._heard.clear()
        self._line.device_write(word.encode("ascii"))

    def _table(self) -> dict[str, tuple[int, Callable[[bytes], bytes | None]]]:
        """Return the length of each command, and what executes it and returns the payload of its reply."""
        low, high = (self._lowest, self._highest)[:: self._sign]
        return {
            "gets": (LETTERS, lambda _: self._status()),
            "gpos": (LETTERS, lambda _: struct.pack("<ihq6x", *self._parts(self.position()), 0)),
            "gser": (LETTERS, lambda _: struct.pack("<I", self._serial)),
            "gfwv": (LETTERS, lambda _: struct.pack("<BBH", 4, 7, 12)),
            "geti": (LETTERS, lambda _: struct.pack("<4s2s8sBBH12x", b"XIMC", b"SM", b"8SMC5", 2, 3, 0)),
            **{f"g{name}": (LETTERS, lambda _, name=name: self.settings[name]) for name in SETTINGS},  # type: ignore[misc]
            **{f"s{name}": (size, partial(self._set, name)) for name, size in SETTINGS.items()},
            "spos": (26, self._count_from),
            "zero": (LETTERS, lambda _: self.set_count(0)),
            "pwof": (LETTERS, self._switch_off),
            **{letters: (LETTERS, partial(self._end, letters)) for letters in ("stop", "sstp")},
            "move": (18, partial(self._run, MOVE, lambda: self._zero)),
            "movr": (18, partial(self._run, MOVR, lambda: self.carriage_at(self._now_s))),
            "left": (LETTERS, partial(self._run, LEFT, lambda: low)),
            "rigt": (LETTERS, partial(self._run, RIGHT, lambda: high)),
            "home": (LETTERS, self._home),
            **dict.fromkeys(IGNORED, (LETTERS, lambda _: None)),
        }

    def _set(self, name: str, payload: bytes) -> bytes | None:
        if name == "mov":
            speed, *rest = struct.unpack("<IBHHIBB9x", payload)
            if speed > FASTEST or not all(rest[1:3]):
                ramps = [max(one, 1) for one in rest[1:3]]
                self.settings["mov"] = struct.pack("<IBHHIBB9x", min(speed, FASTEST), rest[0], *ramps, *rest[3:])
                self.flags |= ERRV
                return b"errv"
        self.settings[name] = payload
        return None

    def _count_from(self, payload: bytes) -> None:
        steps, part, _, ignored = struct.unpack("<ihqB5x", payload)
        if not ignored & 1:
            self.set_count(self._whole(steps, part))

    def _switch_off(self, _: bytes) -> None:
        self._brake(inf)
        self._power, self.flags = POWER_OFF, self.flags & ~HOMED

    def _status(self) -> bytes:
        moves = self.busy
        command = self._command | FAILED * self._failed | RUNNING * moves
        speed = self._parts(trunc(self._sign * self._axis.velocity_at(self._now_s))) if moves else (0, 0)
        return struct.pack(
            "<5Bihqih5hIIB4x",
            moves, command, self._power, 0, 0, *self._parts(self.position()), 0, *speed, 500, 2400, 100, 500, 300,
            self.flags, self.inputs | self.edges(), 1,
        )  # fmt: skip

    def _parts(self, counts: int) -> tuple[int, int]:
        """Return full steps, and the rest in microsteps of the present mode; both have the sign of the sum."""
        steps = trunc(counts / self._microsteps)
        return steps, trunc((counts - steps * self._microsteps) * self._mode / self._microsteps)

    def _whole(self, steps: int, part: int) -> int:
        return steps * self._microsteps + round(part * self._microsteps / self._mode)

    @property
    def _mode(self) -> int:
        """Microsteps per full step of the present mode."""
        return 1 << max(struct.unpack("<HHIBHhBH12x", self.settings["eng"])[6] - 1, 0)

    # --- motion ---

    def _begins(self, command: int) -> bool:
        """Return whether a motion begins: not with an alarm."""
        self._command, self._failed, self._searching = command, bool(self.flags & ALARM), False
        if not self._failed:
            self._power = POWER_ON
        return not self._failed

    def _run(self, command: int, begin: Callable[[], float], payload: bytes) -> None:
        """Run to a height: by the counts of the payload from where the way begins."""
        if self._begins(command):
            height = begin() + (self._sign * self._whole(*struct.unpack("<ih6x", payload)) if payload else 0)
            allowed = min(max(height, self._lowest), self._highest)
            self._failed = allowed != height
            speed, part, *ramps = struct.unpack("<IBHHIBB9x", self.settings["mov"])[:4]
            self._ramp([(allowed, self._whole(speed, part))], ramps)

    def _home(self, _: bytes) -> None:
        if self._begins(HOME):
            fast, part, _1, _2, delta, delta_part, _3 = struct.unpack("<IBIBihH9x", self.settings["hom"])
            ramps = struct.unpack("<IBHHIBB9x", self.settings["mov"])[2:4]
            speed = self._whole(fast, part)
            rest = self._highest + self._sign * self._whole(delta, delta_part)
            self._searching, self.flags = True, self.flags & ~HOMED
            self._ramp([(self._highest, speed), (rest, speed)], ramps)

    def _ramp(self, legs: list[tuple[float, float]], ramps: Sequence[int]) -> None:
        flags = struct.unpack("<HHIBHhBH12x", self.settings["eng"])[4]
        up, down = (ramp * self._microsteps if flags & ACCELERATES else 1e12 for ramp in ramps)
        if legs[0][1]:
            self._go(legs, up, down)

    def _end(self, letters: str, _: bytes) -> None:
        if letters == "stop":
            self.flags &= HOMED | self._causes
            if self._axis.velocity_at(self._now_s):
                self.flags &= ~HOMED
            self._brake(inf)
        elif not self.flags & ALARM:
            self._brake(struct.unpack("<IBHHIBB9x", self.settings["mov"])[3] * self._microsteps)
        self._command, self._failed = STOP if letters == "stop" else SSTP, False

    def _arrive_home(self) -> None:
        """Report it; the count stays until `zero`."""
        self.flags |= HOMED

    def _brake(self, deceleration: float) -> None:
        self._searching = False
        super()._brake(deceleration)


class StandaPair(MotorPair):
    """Two controllers as a stage: x lateral, z vertical, y set by hand."""

    x: VirtualStandaController
    z: VirtualStandaController

    def __init__(self, x: VirtualStandaController, z: VirtualStandaController) -> None:
        self.x, self.z = x, z


def standa_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualStageSpec) -> StandaPair:
    """Return both controllers, that of z on the line of the stage and that of x on its further line."""
    return StandaPair(
        VirtualStandaController(scheduler, line.further[0], spec, "x", 10001),
        VirtualStandaController(scheduler, line, spec, "z", 10003),
    )
