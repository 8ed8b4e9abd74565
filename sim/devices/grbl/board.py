"""A virtual GRBL 1.1h board: the same bytes, the same waiting, the same ways to go deaf.

Source: GRBL 1.1 interface wiki and the behaviour of the 1.1h firmware. Nothing ticks: the board works when
a byte arrives and at the few instants it waits for. Spindle and coolant are outputs and nothing more. Not simulated:
probe, hard limits, check mode.
"""

import re
from math import inf

from sim.devices.grbl import report
from sim.devices.grbl.core import Wait
from sim.devices.grbl.gcode import Command, GcodeError, parse
from sim.devices.grbl.homing import homing_motion
from sim.devices.grbl.motion import Vec
from sim.devices.grbl.planner import BLOCKS
from sim.devices.grbl.realtime import GrblRealtime
from sim.devices.grbl.settings import HOMING, SOFT_LIMITS

BAD_NUMBER, INVALID_STATEMENT, NO_HOMING, NOT_IDLE, LOCKED, TRAVEL = 2, 3, 5, 8, 9, 15
SOFT_LIMIT = 2

_SETTING = re.compile(r"\$(\d+\.?\d*)=([+-]?(?:\d+\.?\d*|\.\d+))$")


class VirtualGrbl(GrblRealtime):
    """A board with three axes behind a serial line, switched on at once.

    VirtualGrbl(scheduler, line, *, settings, work_offset_mm, mechanics): settings change the rig's defaults,
    work_offset_mm is the stored G54; of the mechanics the board knows nothing.
    """

    def _execute(self, line: str, now_s: float) -> int | None:
        if line.startswith("$"):
            return self._execute_system(line, now_s)
        if not line:
            return 0
        if self._state in ("Alarm", "Jog"):
            return LOCKED
        try:
            command = parse(line, self._modal, self._parser_mm, self._offset_mm)
        except GcodeError as problem:
            return problem.code
        if command.modal.outputs != self._modal.outputs:
            self._wait_for(Wait(lambda: self._planner.end_s, lambda then_s: self._switch(command, then_s)))
            return None
        return self._proceed(command, now_s)

    def _switch(self, command: Command, now_s: float) -> None:
        """Outputs change once the stage is at rest, before the rest of their line."""
        self._switch_outputs(command.modal, now_s)
        self._reports.show_overrides()
        self._reply(self._proceed(command, now_s))

    def _proceed(self, command: Command, now_s: float) -> int | None:
        self._modal = command.modal
        if command.dwell_s is not None:
            self._dwell(command.dwell_s)
            return None
        return 0 if command.target_mm is None else self._move(command.target_mm, command.feed, now_s)

    def _execute_system(self, line: str, now_s: float) -> int | None:
        if line.startswith("$J"):
            return self._jog(line, now_s)
        if line == "$":
            return self._print(report.HELP)
        if line == "$G":
            return self._print(report.parser_state(self._modal))
        if line == "$$":
            return NOT_IDLE if self._state == "Run" else self._print(*self._settings.listing())
        if line == "$X":
            return self._unlock()
        return self._execute_at_rest(line, now_s) if self._state in ("Idle", "Alarm") else NOT_IDLE

    def _execute_at_rest(self, line: str, now_s: float) -> int | None:
        if line == "$I":
            return self._print(*report.BUILD)
        if line == "$#":
            return self._print(*report.parameters(self._offset_mm))
        if line == "$N":
            return self._print("$N0=", "$N1=")
        if line == "$H":
            return self._home(now_s)
        if line == "$SLP":
            self._sleep()
            return None
        setting = _SETTING.match(line)
        if setting is None:
            return INVALID_STATEMENT if line[1].isdigit() or line[1] in "HIN#S" else BAD_NUMBER
        code = self._settings.store(float(setting[1]), float(setting[2]))
        self._planner.limits = self._settings.limits()
        self._sync(now_s)
        return code

    def _print(self, *lines: str) -> int:
        self._send(*lines)
        return 0

    def _unlock(self) -> int:
        if self._state == "Alarm":
            self._state = "Idle"
            self._send("[MSG:Caution: Unlocked]")
        return 0

    def _sleep(self) -> None:
        self._reply(0)
        self._state = "Sleep"
        self._send("[MSG:Sleeping]")

    def _home(self, now_s: float) -> int | None:
        if not self._settings.flag(HOMING):
            return NO_HOMING
        pieces, end_s, rest = homing_motion(self._settings, self.carriage_steps_at(now_s), now_s)
        self._planner.follow(pieces, rest, now_s)
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

    def _dwell(self, seconds: float) -> None:
        def start(now_s: float) -> None:
            self._wait_for(Wait(lambda: now_s + seconds, lambda _: self._reply(0)))

        self._wait_for(Wait(lambda: self._planner.end_s, start))

    # --- motion ---

    def _jog(self, line: str, now_s: float) -> int | None:
        if self._state not in ("Idle", "Jog"):
            return LOCKED if self._state == "Alarm" else NOT_IDLE
        if not line.startswith("$J="):
            return INVALID_STATEMENT
        try:
            command = parse(line[3:], self._modal, self._parser_mm, self._offset_mm, jog=True)
        except GcodeError as problem:
            return problem.code
        target = command.target_mm
        assert target is not None
        if self._beyond_travel(target):
            return TRAVEL
        return self._enqueue(target, command.feed, now_s, "Jog")

    def _move(self, target_mm: Vec, feed: float, now_s: float) -> int | None:
        if not self._beyond_travel(target_mm):
            return self._enqueue(target_mm, feed, now_s, "Run")
        if self._state == "Run":
            self._suspend(now_s, "Hold")
        self._wait_for(Wait(lambda: self._planner.end_s, self._soft_limit, through_hold=True))
        return None

    def _beyond_travel(self, target_mm: Vec) -> bool:
        travel = self._settings.per_axis(130)
        return self._settings.flag(SOFT_LIMITS) and any(
            mm > 0 or mm < -most for mm, most in zip(target_mm, travel, strict=True)
        )

    def _soft_limit(self, now_s: float) -> None:
        self._planner.halt(now_s)
        self._alarm(SOFT_LIMIT, self._die)

    def _die(self, _now_s: float) -> None:
        """Deaf to everything but a reset."""
        self._send("[MSG:Reset to continue]")
        self._dead = True

    def _enqueue(self, target_mm: Vec, feed: float, now_s: float, state: str) -> int | None:
        self._parser_mm = target_mm
        if self._planner.unfinished(now_s) < BLOCKS:
            self._queue(target_mm, feed, now_s, state)
            return 0

        def place_is_free(then_s: float) -> None:
            self._queue(target_mm, feed, then_s, state)
            self._reply(0)

        self._wait_for(Wait(self._planner.next_end_s, place_is_free))
        return None

    def _queue(self, target_mm: Vec, feed: float, now_s: float, state: str) -> None:
        x, y, z = (b - zero for b, zero in zip(self._to_steps(target_mm), self._zero, strict=True))
        speed = feed / 60 if feed < inf else inf
        if self._planner.queue(self._queued_to, (x, y, z), speed, now_s, jog=state == "Jog"):
            self._state = state
        self._queued_to = (x, y, z)
