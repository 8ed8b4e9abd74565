"""A stage on a GRBL 1.1 or grblHAL board. Source: GRBL 1.1 interface wiki."""

from collections.abc import Mapping
from contextlib import suppress
from types import MappingProxyType
from typing import Literal

from rig.devices.stage.base import (
    LOOK_S,
    Axis,
    Looks,
    Stage,
    StageAlarm,
    StageError,
    StageNotHomed,
    StageRejected,
    StageReset,
    StageStatus,
    StageTimeout,
    is_held,
    next_look_s,
)
from rig.devices.stage.grbl.grbl_link import ASK_TIMES, GrblLink
from rig.devices.stage.grbl.grbl_settings import (
    INCHES,
    STEP_DIRECTION,
    STEPS_PER_MM,
    differences,
    expected_s_of,
    keys_of,
    misplaced,
    overrun,
    unreported,
)
from rig.devices.stage.grbl.grbl_words import (
    FULL,
    JOG_CANCEL,
    OUTPUT_WORDS,
    STOP_PINS,
    Xyz,
    machine_from,
    move_words,
    parse_setting,
)
from rig.transport import Transport
from rig.transport.clock import Clock

POLL_S = 0.02
HOME_S = 180.0
HALT_S = 2.0
# Longer than a step takes at the slowest speed there is, 1 mm/min.
STANDS_S = 0.5
# A second 0x85 at the very end of a jog leaves GRBL 1.1h suspended, Idle and deaf to lines until `~` or a reset.
CANCEL_AGAIN_S = 0.5
# A move may take this much longer than its length, speed and acceleration say.
LATE_FACTOR, LATE_S = 1.5, 5.0
ASK_FOR_OFFSET = 35
# An alarm, the banner after it, and one more of each.
NEWS = 4


class GrblStage(Stage):
    """Stage over a GRBL board, one move at a time; output: what set_output() switches.

    expected: settings, by number, without which connect() refuses the board.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        *,
        expected: Mapping[int, float] = MappingProxyType({INCHES: 0}),
        output: Literal["off", "coolant", "spindle"] = "off",
        backlash_mm: Xyz = (0.0, 0.0, 0.0),
    ) -> None:
        self._transport = transport
        self._clock = clock
        self._link = GrblLink(transport, clock)
        self._expected = expected
        self._output = output
        self._backlash_mm = backlash_mm
        self._settings: dict[int, float] = {}
        self._last: Xyz | None = None
        self._jogging = False

    @property
    def homed(self) -> bool:
        """Whether the position is to be trusted: homed, and no alarm, reset, timeout or stop since."""
        return self._link.trusted

    def connect(self) -> str:
        """Return the board's identity. The banner may have been missed, so the board is asked, or reset.

        Raises StageError, also where a setting of the board is not the expected one.
        """
        try:
            printed = self._link.hello()
        except (StageTimeout, StageRejected, StageAlarm, StageReset):
            self._link.reset()
            printed = self._link.command("$I")
        self._link.full_speed()
        board = self.settings()
        wrong = differences(board, self._expected) + unreported(printed, board)
        if wrong:
            place = f"{self._transport.name}: the board is not set as configured{keys_of(board, self._expected)}"
            raise StageError(f"{place}, expected {', '.join(wrong)}")
        return " ".join(line for line in printed if line.startswith("[") and not line.startswith("[MSG"))

    def settings(self) -> dict[int, float]:
        """The board's `$$`, by number. Raises StageError."""
        lines = self._link.command("$$")
        self._settings = dict(pair for pair in map(parse_setting, lines) if pair)
        return dict(self._settings)

    def homing(self) -> Looks:
        """`$H`; while it lasts the board answers nothing, `?` included. The position is given up as it begins."""
        if not self._link.in_step:
            self._link.reset()
        self._link.refuse_interference(self.status().state)
        self._link.trusted, times = False, self._link.times_stopped
        for _ in self._link.talking("$H", HOME_S, LOOK_S):
            yield None
        self.status()
        self._link.trusted = self._link.times_stopped == times

    def unlock(self) -> None:
        self._link.recover()
        self._link.command("$X")

    def status(self) -> StageStatus:
        """Where the stage is now. Raises StageError, also where somebody interferes with a jog."""
        now = self._status()
        if self._jogging:
            self._link.refuse_interference(now.state)
        return now

    def _status(self) -> StageStatus:
        fields = self._link.ask_status()
        asked = 0
        while fields.machine is None and (fields.work is None or self._link.offset is None):
            # Work coordinates ($10) mean nothing until the offset has come by; a garbled line has neither.
            asked += 1
            if asked > (ASK_TIMES if fields.work is None else ASK_FOR_OFFSET):
                raise StageError(f"{self._transport.name}: the status holds no machine position")
            fields = self._link.ask_status()
        self._last = fields.machine or machine_from(fields.work, self._link.offset)
        return StageStatus(fields.state, *self._last)

    def moving(
        self,
        *,
        x_mm: float | None = None,
        y_mm: float | None = None,
        z_mm: float | None = None,
        speed_mm_s: float,
        look_s: float = LOOK_S,
    ) -> Looks:
        """Straight to machine coordinates (mm) at speed_mm_s; over when the board says it is there.

        It is asked each look_s, and after the expected travel time each POLL_S. Where an axis has backlash it always
        arrives in its negative direction: down, for Z. Raises StageError; ValueError, StageNotHomed before any byte.
        """
        target = {axis: mm for axis, mm in (("X", x_mm), ("Y", y_mm), ("Z", z_mm)) if mm is not None}
        move_words(target, speed_mm_s)
        if self._link.in_step and not self.homed:
            raise StageNotHomed(f"{self._transport.name}: the stage")
        beyond = overrun(target, self._last, self._backlash_mm)
        if beyond != target:
            yield from self._going(beyond, speed_mm_s, look_s)
        yield from self._going(target, speed_mm_s, look_s)

    def _going(self, target: dict[str, float], speed_mm_s: float, look_s: float) -> Looks:
        self._link.refuse_interference("")
        self._jogging = False
        expected_s = expected_s_of(self._settings, self._last, target, speed_mm_s)
        self._link.command("G53G1G90G21" + move_words(target, speed_mm_s), look_s=LOOK_S)
        yield from self._arriving(target, expected_s, look_s)

    def halt(self) -> None:
        """Feed hold, and a reset once the board stands: from rest it loses no step, and what was queued is gone.

        Overrides end first: some grblHAL boards keep them through a reset.
        """
        if self._link.overrides != FULL:
            self._link.full_speed()
        deadline_s = self._clock.monotonic_s() + HALT_S
        trusted, times = self._link.trusted, self._link.times_stopped
        self.hold()
        while (state := self._status().state) not in ("Hold:0", "Idle"):
            if self._clock.monotonic_s() >= deadline_s:
                raise StageTimeout(f"{self._transport.name}: not at rest {HALT_S:g} s after a hold, state {state}")
            self._listen(POLL_S)
        self._link.reset()
        state = self._status().state
        if state != "Idle":
            raise StageError(f"{self._transport.name}: {state} after a halt, the position is lost")
        self._link.trusted = trusted and self._link.times_stopped == times

    def stop(self) -> None:
        """Feed hold and reset in one write: no queue, no lock, no waiting. Then home() or unlock()."""
        self._link.stop_now()

    def hold(self) -> None:
        """Slow down to a stop and stay there; resume() goes on, the position stays trusted. Raises TransportError."""
        self._link.send_now(b"!")

    def resume(self, timeout_s: float = 5.0) -> None:
        """End a hold. A `~` that comes while the board still slows down is lost, so it is looked at again.

        Raises StageError.
        """
        deadline_s = self._clock.monotonic_s() + timeout_s
        while is_held(self._status().state):
            if self._clock.monotonic_s() >= deadline_s:
                raise StageTimeout(f"{self._transport.name}: still held after {timeout_s:g} s")
            self._link.send_now(b"~")
            self._listen(POLL_S)

    def look(self) -> StageStatus:
        # Opening the port may have reset the board, or somebody stopped it: what that prints is not an answer.
        for _ in range(NEWS):
            with suppress(StageReset, StageAlarm):
                return self.status()
        return self.status()

    def steps_per_mm(self, axis: Axis) -> float:
        """`$100` … `$102`, with the sign of `$3`; known once connected."""
        reversed_axes = int(self._settings.get(STEP_DIRECTION, 0.0))
        sign = -1.0 if reversed_axes >> "xyz".index(axis) & 1 else 1.0
        return sign * self._settings[STEPS_PER_MM + "xyz".index(axis)]

    def jog(self, axis: Axis, by_mm: float, speed_mm_s: float) -> None:
        """`$J=`: needs a board that is idle or jogging. Raises StageError; ValueError before any byte."""
        self._link.refuse_interference("")
        self._jogging = True
        self._link.command("$J=G91G21" + move_words({axis.upper(): by_mm}, speed_mm_s), look_s=LOOK_S)

    def end_jog(self, timeout_s: float = 5.0) -> None:
        """0x85 until the board is at rest: one that comes before the jog has begun is lost.

        A board that says Jog and stands, as some grblHAL do after a cancel, is at rest. Raises StageError, also where
        a line may still wait in the board.
        """
        if not self._link.in_step:
            raise StageError(f"{self._transport.name}: a line may still wait in the board")
        deadline_s = self._clock.monotonic_s() + timeout_s
        self._jogging = False
        self._link.send_now(JOG_CANCEL)
        stood_at, stood_s, sent_s = None, 0.0, self._clock.monotonic_s()
        while (now := self.status()).state == "Jog":
            now_s = self._clock.monotonic_s()
            if now != stood_at:
                stood_at, stood_s = now, now_s
            if now_s - stood_s >= STANDS_S:
                return
            if now_s >= deadline_s:
                raise StageTimeout(f"{self._transport.name}: still jogging after {timeout_s:g} s")
            self._listen(POLL_S)
            if self._clock.monotonic_s() - sent_s >= CANCEL_AGAIN_S:
                sent_s = self._clock.monotonic_s()
                self._link.send_now(JOG_CANCEL)

    def set_output(self, on: bool) -> None:
        """Coolant (M8, M9) or spindle (M3, M5); the board switches when all motion before is over."""
        if self._output == "off":
            raise StageError(f"{self._transport.name}: no output of the board is configured, see sync.output")
        self._link.command(OUTPUT_WORDS[self._output][on], look_s=LOOK_S)

    def active_inputs(self) -> frozenset[str]:
        """Return the stop inputs that the last status named; status() asks anew."""
        return frozenset(STOP_PINS[letter] for letter in self._link.pins if letter in STOP_PINS)

    def close(self) -> None:
        self._transport.close()

    def _listen(self, seconds: float) -> None:
        self._link.listen_until(self._clock.monotonic_s() + seconds)

    def _arriving(self, target: dict[str, float], expected_s: float, look_s: float) -> Looks:
        begun_s = self._clock.monotonic_s()
        over_s, deadline_s = begun_s + expected_s, begun_s + LATE_FACTOR * expected_s + LATE_S
        due_s = next_look_s(begun_s, over_s, look_s)
        self._link.listen_until(min(over_s, due_s))
        while (now := self.status()).state != "Idle":
            self._link.refuse_interference(now.state)
            if now.state.startswith(("Alarm", "Sleep", "Check")):
                raise StageError(f"{self._transport.name}: {now.state} during a move")
            if self._clock.monotonic_s() >= deadline_s:
                raise StageTimeout(f"{self._transport.name}: move not over in time, state {now.state}")
            if self._clock.monotonic_s() >= due_s:
                yield now
                due_s = next_look_s(self._clock.monotonic_s(), over_s, look_s)
            self._link.listen_until(min(max(over_s, self._clock.monotonic_s() + POLL_S), due_s))
        self._link.refuse_interference(now.state)
        missed = misplaced(self._settings, target, (now.x_mm, now.y_mm, now.z_mm))
        if missed:
            raise StageError(f"{self._transport.name}: {missed}")
