"""Virtual GRBL 1.1h board with the bytes, delays and deaf states of the real one.

Source: GRBL 1.1 interface wiki and the behavior of the 1.1h firmware. The board is event-driven: it works when a byte
arrives and at the few times it waits for. Spindle and coolant are plain outputs. Not simulated: arcs, probe, hard
limits.
"""

from math import inf

from sim.devices.clock import Scheduler
from sim.devices.grbl import core
from sim.devices.grbl.core import Mechanics, Overrides, Wait
from sim.devices.grbl.gcode import GcodeCommand, GcodeError, parse
from sim.devices.grbl.planner import BLOCKS, Vec
from sim.devices.grbl.settings import SOFT_LIMITS, STEP_DIRECTION, STEPS_PER_MM
from sim.devices.grbl.settings import TRAVEL as TRAVEL_MM
from sim.devices.grbl.system_commands import INVALID_STATEMENT, NOT_IDLE, GrblSystem
from sim.devices.line import SerialLine, VirtualStageSpec

LOCKED, TRAVEL = 9, 15
SOFT_LIMIT = 2
END, FLOWS = (2, 30), (0, 2, 30)


class VirtualGrbl(GrblSystem):
    """Board with three axes behind a serial line, switched on at construction.

    `settings` change the rig's defaults, `work_offset_mm` is the stored G54, and `mechanics` are unknown to the
    board.
    """

    def _execute(self, line: str, now_s: float) -> int | None:
        if line.startswith("$"):
            return self._execute_system(line, now_s)
        if not line:
            return 0
        if self._state in ("Alarm", "Jog"):
            return LOCKED
        try:
            command = parse(line, self._modal, self._offsets, self._parser_mm)
        except GcodeError as problem:
            return problem.number
        if self._state == "Check":
            self._modal, self._offsets = command.modal, command.offsets
            self._parser_mm = command.targets_mm[-1] if command.targets_mm else self._parser_mm
            return 0
        if command.modal.outputs != self._modal.outputs:
            self._wait_for(Wait(lambda: self._planner.end_s, lambda then_s: self._switch(command, then_s)))
            return None
        return self._proceed(command, now_s)

    def _switch(self, command: GcodeCommand, now_s: float) -> None:
        """Switch outputs once the stage is at rest, before the rest of their line."""
        self._switch_outputs(command.modal, now_s)
        self._reports.show_overrides()
        self._reply(self._proceed(command, now_s))

    def _proceed(self, command: GcodeCommand, now_s: float) -> int | None:
        self._modal, self._offsets = command.modal, command.offsets
        if command.zeroed:
            # The firmware waits here until all motion is over (FORCE_BUFFER_SYNC_DURING_WCO_CHANGE).
            self._wait_for(Wait(lambda: self._planner.end_s, lambda then_s: self._zeroed(command, then_s)))
            return None
        return self._execute_motion(command, now_s)

    def _zeroed(self, command: GcodeCommand, now_s: float) -> None:
        self._reports.show_offset()
        self._reply(self._execute_motion(command, now_s))

    def _execute_motion(self, command: GcodeCommand, now_s: float) -> int | None:
        if command.dwell_s is not None:
            self._dwell(command.dwell_s)
            return None
        if command.flow in FLOWS:
            self._wait_for(Wait(lambda: self._planner.end_s, self._end if command.flow in END else self._pause))
            return None
        return self._moves(command.targets_mm, command.feed, now_s)

    def _moves(self, targets_mm: tuple[Vec, ...], feed: float, now_s: float) -> int | None:
        """Queue moves one after another; the second of two, as in G28, starts after the first."""
        if not targets_mm:
            return 0
        if len(targets_mm) == 1:
            return self._move(targets_mm[0], feed, now_s)
        self._move(targets_mm[0], feed, now_s)
        self._wait_for(
            Wait(lambda: self._planner.end_s, lambda then_s: self._reply(self._moves(targets_mm[1:], feed, then_s)))
        )
        return None

    def _pause(self, now_s: float) -> None:
        """Hold on M0 until a resume, and answer only then."""
        self._suspend(now_s, "Hold")
        self._wait_for(Wait(lambda: self._planner.end_s, lambda _: self._reply(0)))

    def _end(self, now_s: float) -> None:
        """End the program on M2 or M30: outputs off, most modes and all overrides reset."""
        ended = self._modal.after_program()
        self._switch_outputs(ended, now_s)
        self._modal = ended
        self._set_overrides(Overrides(), now_s)
        self._reports.show_offset()
        self._send(core.PROGRAM_END)
        self._reply(0)

    def _dwell(self, seconds: float) -> None:
        def start(now_s: float) -> None:
            self._wait_for(Wait(lambda: now_s + seconds, lambda _: self._reply(0)))

        self._wait_for(Wait(lambda: self._planner.end_s, start))

    # --- motion ---

    def _jog(self, line: str, now_s: float) -> int | None:
        if self._state not in ("Idle", "Jog"):
            return NOT_IDLE
        if not line.startswith("$J="):
            return INVALID_STATEMENT
        try:
            command = parse(line[3:], self._modal, self._offsets, self._parser_mm, jog=True)
        except GcodeError as problem:
            return problem.number
        target = command.targets_mm[0]
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
        """Ignore everything but a reset."""
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


def grbl_twin(scheduler: Scheduler, line: SerialLine, spec: VirtualStageSpec) -> VirtualGrbl:
    """Return a board with the settings that the rig expects."""
    reversed_axes = sum(1 << i for i, per_mm in enumerate(spec.steps_per_mm) if per_mm < 0)
    settings: dict[int, float] = {STEP_DIRECTION: reversed_axes}
    settings |= {TRAVEL_MM + i: mm for i, mm in enumerate(spec.travel_mm)}
    settings |= {STEPS_PER_MM + i: abs(per_mm) for i, per_mm in enumerate(spec.steps_per_mm)}
    return VirtualGrbl(scheduler, line, settings=settings, mechanics=Mechanics(play_steps=spec.play_steps))
