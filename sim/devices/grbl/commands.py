"""Real-time commands of the virtual GRBL board, including overrides, and its alarms.

Source: GRBL 1.1 interface wiki and the behavior of the 1.1h firmware.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from sim.devices.clock import Scheduler
from sim.devices.grbl import core
from sim.devices.grbl.core import OVERRIDE_BYTES, GrblCore, Mechanics, Wait
from sim.devices.grbl.gcode import BAD_NUMBER, NUMBER, GcodeError, parse
from sim.devices.grbl.planner import BLOCKS, Vec
from sim.devices.grbl.settings import HOMING, INCHES, homing_motion
from sim.devices.line import SerialLine

# The firmware pauses this long after printing an alarm, and ignores input meanwhile.
ALARM_PAUSE_S = 0.5

# A report waits for space in the transmit buffer; further requests meanwhile are dropped.
TX_BYTES = 104

STOP_PINS = {"door": "D", "hold": "H"}

RESET_IN_MOTION, RESET_IN_HOMING, DOOR_IN_HOMING = 3, 6, 7


class GrblRealtime(GrblCore):
    """Board that answers `?` `!` `~` 0x18 0x84 0x85, and 0x90 to 0x9D, at any time."""

    def __init__(
        self,
        scheduler: Scheduler,
        line: SerialLine,
        *,
        settings: Mapping[int, float] | None = None,
        work_offset_mm: Vec = (0.0, 0.0, 0.0),
        mechanics: Mechanics | None = None,
    ) -> None:
        super().__init__(scheduler, line, settings, work_offset_mm, mechanics or Mechanics())
        self._reporting_until_s = 0.0
        self._realtime = {
            ord("?"): self._report_status,
            ord("!"): self._hold,
            ord("~"): self._resume,
            0x18: self._reset,
            0x84: self._open_door,
            0x85: self._cancel_jog,
            0xA0: self._toggle_coolant,
        }
        self._realtime.update({byte: partial(self._override, byte) for byte in OVERRIDE_BYTES})

    def press(self, name: str) -> None:
        """Press a button wired to an input: door or hold."""
        now_s = self._scheduler.monotonic_s()
        self._settle(now_s)
        self._pressed.add(STOP_PINS[name])
        if name == "door":
            self._open_door(now_s)
        else:
            self._hold(now_s)

    def release(self, name: str) -> None:
        """Release the button; the board keeps its state until a command."""
        self._pressed.discard(STOP_PINS[name])

    def _report_status(self, now_s: float) -> None:
        if self._state == "Home":
            self._asked_in_homing = True
        elif not self._deaf and now_s >= self._reporting_until_s:
            self._send(self._reports.line(self._snapshot(now_s)))
            self._reporting_until_s = self._wire.device_blocked_until_s(TX_BYTES)

    def _snapshot(self, now_s: float) -> core.Snapshot:
        carriage = self.carriage_steps_at(now_s)
        return core.Snapshot(
            state=self._state_text(now_s),
            machine_mm=self._machine_mm(carriage),
            feed=60 * self._planner.track.speed_at(now_s),
            blocks_free=BLOCKS - self._planner.unfinished(now_s),
            bytes_free=core.RX_BYTES - len(self._rx),
            pins="".join(axis for axis, steps in zip("XYZ", carriage, strict=True) if steps >= 0)
            + "".join(sorted(self._pressed)),
            modal=self._modal,
            offset_mm=self._offsets.of(self._modal.system),
            overrides=self._overrides,
        )

    def _state_text(self, now_s: float) -> str:
        stopping = now_s < self._planner.end_s
        if self._state == "Hold":
            return "Hold:1" if stopping else "Hold:0"
        if self._state == "Door":
            return "Door:2" if stopping else "Door:0"
        return self._state

    def _override(self, byte: int, now_s: float) -> None:
        if not self._deaf:
            self._set_overrides(self._overrides.after(byte), now_s)

    def _toggle_coolant(self, now_s: float) -> None:
        if self._state in ("Idle", "Run", "Hold", "Jog"):
            toggled = replace(self._modal, coolant=9 if self._modal.coolant == 8 else 8)
            self._switch_outputs(toggled, now_s)
            self._modal = toggled
            self._reports.show_overrides()

    def _hold(self, now_s: float) -> None:
        if self._state == "Jog":
            self._cancel_jog(now_s)
        elif self._state in ("Idle", "Run"):
            self._suspend(now_s, "Hold")

    def _open_door(self, now_s: float) -> None:
        if self._state == "Home":
            self._planner.halt(now_s)
            self._alarm(DOOR_IN_HOMING, self._abort)
        elif self._state not in ("Alarm", "Sleep"):
            self._send("[MSG:Check Door]")
            if self._state == "Jog":
                self._after_jog = "Door"
                self._cancel_jog(now_s)
            else:
                self._suspend(now_s, "Door")

    def _suspend(self, now_s: float, state: str) -> None:
        if self._state == "Run":
            self._planner.hold(now_s)
        self._state = state
        self._arm()

    def _resume(self, now_s: float) -> None:
        """Resume; a `~` that comes before the stop is complete is lost, as on the real board."""
        ajar = STOP_PINS["door"] in self._pressed
        stopped = not ajar and self._state in ("Hold", "Door") and now_s >= self._planner.end_s
        if stopped and not (self._wait and self._wait.through_hold):
            self._state = "Run" if self._planner.resume(now_s) else "Idle"
            self._arm()
            self._pump(now_s)

    def _cancel_jog(self, now_s: float) -> None:
        if self._state == "Jog" and not self._jog_cancelled:
            self._jog_cancelled = True
            self._planner.hold(now_s)
            self._arm()
            self._scheduler.call_at(self._planner.end_s, self._after_jog_cancel)

    def _after_jog_cancel(self) -> None:
        now_s = self._scheduler.monotonic_s()
        self._settle(now_s)
        self._arm()
        self._pump(now_s)

    def _reset(self, now_s: float) -> None:
        if self._deaf and not self._dead:
            return
        if self._state == "Home" or (not self._dead and now_s < self._planner.end_s):
            slip = self._planner.halt(now_s, self._slip_steps)
            (x, y, z), (i, j, k) = self._zero, slip
            self._zero = (x - i, y - j, z - k)
            self._alarm(RESET_IN_HOMING if self._state == "Home" else RESET_IN_MOTION, self._abort)
        else:
            self._abort(now_s)

    def _alarm(self, code: int, then: Callable[[float], None]) -> None:
        self._state = "Alarm"
        self._deaf = True
        self._send(f"ALARM:{code}")
        until_s = self._scheduler.monotonic_s() + ALARM_PAUSE_S
        self._wait_for(Wait(lambda: until_s, then))

    def _abort(self, now_s: float) -> None:
        """Restart the program; an interrupted line still gets its ok."""
        if self._owes_ok:
            self._reply(0)
        self._boot(now_s, locked=self._state in ("Alarm", "Sleep"))
        if STOP_PINS["door"] in self._pressed:  # the firmware checks the door when the program starts
            self._open_door(now_s)


# --- system ---
#
# Source: the 1.1h firmware, system.c, in its order of checks. Not simulated: `$RST=` is error 3, and startup lines
# are stored but never run.

INVALID_STATEMENT, NO_HOMING, NOT_IDLE = 3, 5, 8
STARTUP_LINES, _LARGEST_SETTING = 2, 255


class GrblSystem(GrblRealtime):
    """Board that answers `$…`; subclasses implement jogs."""

    _build_info = ""
    _startup: tuple[str, ...] = ("",) * STARTUP_LINES

    def _jog(self, line: str, now_s: float) -> int | None:
        raise NotImplementedError

    def _execute_system(self, line: str, now_s: float) -> int | None:
        if line.startswith("$J"):
            return self._jog(line, now_s)
        if line == "$":
            return self._print(core.HELP)
        if line[1] in "$GCX":
            return self._execute_at_any_time(line)
        return self._execute_at_rest(line, now_s) if self._state in ("Idle", "Alarm") else NOT_IDLE

    def _execute_at_any_time(self, line: str) -> int | None:
        if len(line) > 2:
            return INVALID_STATEMENT
        if line == "$G":
            return self._print(core.parser_state(self._modal, self._settings.flag(INCHES)))
        if line == "$$":
            return NOT_IDLE if self._state == "Run" else self._print(*self._settings.listing())
        return self._check() if line == "$C" else self._unlock()

    def _execute_at_rest(self, line: str, now_s: float) -> int | None:
        kind, rest = line[1], line[2:]
        if kind == "#" and not rest:
            return self._print(*core.parameters(self._offsets, self._settings.flag(INCHES)))
        if kind == "H":
            return self._home(now_s, rest)
        if kind == "I" and not rest:
            return self._print(*core.build(self._build_info))
        if kind == "I" and rest.startswith("="):
            self._build_info = rest[1:]
            return 0
        if line == "$N":
            return self._print(*(f"$N{i}={text}" for i, text in enumerate(self._startup)))
        if line == "$SLP":
            self._sleep()
            return None
        if kind in "#ISR":
            return INVALID_STATEMENT
        return self._store_startup(rest) if kind == "N" else self._store(line[1:], now_s)

    def _store(self, text: str, now_s: float) -> int:
        number = NUMBER.match(text)
        if number is None:
            return BAD_NUMBER
        if text[number.end() : number.end() + 1] != "=":
            return INVALID_STATEMENT
        value = NUMBER.match(text, number.end() + 1)
        if value is None:
            return BAD_NUMBER
        if value.end() < len(text) or not 0 <= float(number[0]) <= _LARGEST_SETTING:
            return INVALID_STATEMENT
        code = self._settings.store(int(float(number[0])), float(value[0]))
        self._planner.limits = self._settings.limits()
        self._sync(now_s)
        if int(float(number[0])) == INCHES:
            self._reports.show_offset()
        return code

    def _store_startup(self, text: str) -> int:
        number = NUMBER.match(text)
        if self._state != "Idle":
            return NOT_IDLE
        if number is None:
            return BAD_NUMBER
        if text[number.end() : number.end() + 1] != "=":
            return INVALID_STATEMENT
        line = text[number.end() + 1 :]
        try:
            parse(line, self._modal, self._offsets, self._parser_mm)
        except GcodeError as problem:
            return problem.number
        chosen = int(float(number[0]))
        self._startup = tuple(line if i == chosen else kept for i, kept in enumerate(self._startup))
        return 0

    def _print(self, *lines: str) -> int:
        self._send(*lines)
        return 0

    def _check(self) -> int | None:
        """Toggle check mode, in which g-code is parsed but nothing moves; leaving it resets the board."""
        if self._state == "Check":
            self._send(core.DISABLED, "ok")
            self._owes_ok = False
            self._abort(self._scheduler.monotonic_s())
            return None
        if self._state != "Idle":
            return NOT_IDLE
        self._state = "Check"
        return self._print(core.ENABLED)

    def _unlock(self) -> int:
        if self._state == "Alarm":
            self._state = "Idle"
            self._send("[MSG:Caution: Unlocked]")
        return 0

    def _sleep(self) -> None:
        self._reply(0)
        self._state = "Sleep"
        self._send("[MSG:Sleeping]")

    def _home(self, now_s: float, rest: str) -> int | None:
        if not self._settings.flag(HOMING):
            return NO_HOMING
        if rest:
            return INVALID_STATEMENT
        pieces, end_s, at_rest = homing_motion(self._settings, self.carriage_steps_at(now_s), now_s)
        self._planner.follow(pieces, at_rest, now_s)
        self._state = "Home"
        self._wait_for(Wait(lambda: end_s, self._homed))
        return None

    def _homed(self, now_s: float) -> None:
        pull_off = -self._settings[27]
        believed = self._to_steps((pull_off, pull_off, pull_off))
        x, y, z = (b - c for b, c in zip(believed, self.carriage_steps_at(now_s), strict=True))
        self._zero = (x, y, z)
        self._sync(now_s)
        if self._asked_in_homing:
            self._asked_in_homing = False
            self._send(self._reports.line(self._snapshot(now_s)))
        self._state = "Idle"
        self._reply(0)
