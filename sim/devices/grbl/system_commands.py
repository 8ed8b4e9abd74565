"""The `$` lines of the virtual GRBL board.

Source: the 1.1h firmware, system.c, in its order of checks. Not simulated: `$RST=` is error 3, and startup lines are
kept but never run.
"""

from sim.devices.grbl import core
from sim.devices.grbl.core import Wait
from sim.devices.grbl.gcode import BAD_NUMBER, NUMBER, GcodeError, parse
from sim.devices.grbl.realtime_commands import GrblRealtime
from sim.devices.grbl.settings import HOMING, INCHES, homing_motion

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
            return self._print(*core.build(self._build_info, "VZ" if self.homes_to_origin else "V"))
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
        home_mm = 0.0 if self.homes_to_origin else -self._settings[27]
        believed = self._to_steps((home_mm, home_mm, home_mm))
        x, y, z = (b - c for b, c in zip(believed, self.carriage_steps_at(now_s), strict=True))
        self._zero = (x, y, z)
        self._sync(now_s)
        if self._asked_in_homing:
            self._asked_in_homing = False
            self._send(self._reports.line(self._snapshot(now_s)))
        self._state = "Idle"
        self._reply(0)
