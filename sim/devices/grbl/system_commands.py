"""The `$` lines of the virtual GRBL board.

Source: the 1.1h firmware, system.c, in its order of checks. Not simulated: `$RST=` is error 3, and startup lines are
kept but never run.
"""

from collections.abc import Callable
from functools import cached_property

from sim.devices.grbl import core
from sim.devices.grbl.core import Wait
from sim.devices.grbl.gcode import BAD_NUMBER, NUMBER, GcodeError, parse
from sim.devices.grbl.realtime_commands import GrblRealtime
from sim.devices.grbl.settings import HOMING, INCHES, homing_motion

INVALID_STATEMENT, NO_HOMING, NOT_IDLE = 3, 5, 8
STARTUP_LINES, _LARGEST_SETTING = 2, 255
AT_ANY_TIME, REFUSED = "$GCX", "$GCX#ISR"
"""Second characters of lines that the board executes in any state, and of those that set nothing."""


class GrblSystem(GrblRealtime):
    """Board that answers `$…`; subclasses implement jogs."""

    _build_info = ""
    _startup: tuple[str, ...] = ("",) * STARTUP_LINES

    def _jog(self, line: str, now_s: float) -> int | None:
        raise NotImplementedError

    def _execute_system(self, line: str, now_s: float) -> int | None:
        if line.startswith("$J"):
            return self._jog(line, now_s)
        if line[1:2] not in AT_ANY_TIME and self._state not in ("Idle", "Alarm"):
            return NOT_IDLE
        if line in self._system_lines:
            return self._system_lines[line]()
        for begin, act in self._with_values.items():
            if line.startswith(begin):
                return act(line.removeprefix(begin))
        return INVALID_STATEMENT if line[1] in REFUSED else self._store(line[1:])

    @cached_property
    def _system_lines(self) -> dict[str, Callable[[], int | None]]:
        """Handlers of whole lines."""
        return {
            "$": lambda: self._print(core.HELP),
            "$G": lambda: self._print(core.parser_state(self._modal, self._settings.flag(INCHES))),
            "$$": lambda: NOT_IDLE if self._state == "Run" else self._print(*self._settings.listing()),
            "$C": self._check,
            "$X": self._unlock,
            "$#": lambda: self._print(*core.parameters(self._offsets, self._settings.flag(INCHES))),
            "$I": lambda: self._print(*core.build(self._build_info, "VZ" if self.homes_to_origin else "V")),
            "$N": lambda: self._print(*(f"$N{i}={text}" for i, text in enumerate(self._startup))),
            "$SLP": self._sleep,
        }

    @cached_property
    def _with_values(self) -> dict[str, Callable[[str], int | None]]:
        """Handlers of lines by how they begin; each gets the rest of its line."""
        return {"$H": self._home, "$I=": self._store_build, "$N": self._store_startup}

    def _store(self, text: str) -> int:
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
        self._sync(self._scheduler.monotonic_s())
        if int(float(number[0])) == INCHES:
            self._reports.show_offset()
        return code

    def _store_build(self, text: str) -> int:
        self._build_info = text
        return 0

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

    def _home(self, rest: str) -> int | None:
        if not self._settings.flag(HOMING):
            return NO_HOMING
        if rest:
            return INVALID_STATEMENT
        now_s = self._scheduler.monotonic_s()
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
