"""The conversation with a GRBL board: one line, one answer, and everything that comes unasked.

Source: GRBL 1.1 interface wiki. Send-response on purpose, not character counting: nothing may be queued
beyond one safe increment.
"""

import math
from collections.abc import Generator
from contextlib import suppress
from typing import Any

from rig.devices.stage.base import (
    StageAlarm,
    StageError,
    StageHeld,
    StageOverridden,
    StageRejected,
    StageReset,
    StageTimeout,
    is_held,
)
from rig.devices.stage.grbl.grbl_words import (
    ALARMS,
    ERRORS,
    FULL,
    HOLD_AND_RESET,
    OVERRIDDEN,
    StatusFields,
    Xyz,
    is_banner,
    number_after,
    parse_status,
)
from rig.transport import LineReader, Transport
from rig.transport.clock import Clock

REPLY_S = 2.0
STATUS_S = 0.3
BANNER_S = 3.0
# After a banner the board may still print a message, and a second reset may be on its way.
QUIET_S = 0.05
ASK_TIMES = 3
RESET = b"\x18"
FULL_SPEED = b"\x90\x95\x99"


class GrblLink:
    """Lines and real-time bytes over a transport; alarms and resets become exceptions."""

    def __init__(self, transport: Transport, clock: Clock) -> None:
        self._transport = transport
        self._clock = clock
        self.name = transport.name
        self._reader = LineReader(transport, clock)
        self.in_step = False
        self.trusted = False
        self.times_stopped = 0  # from whatever thread
        self.offset: Xyz | None = None
        self.overrides = FULL
        self.pins = ""  # of the last status

    def hello(self) -> list[str]:
        """Ask a board of unknown state who it is. Raises StageError."""
        self.trusted = False
        # A banner that lies in the buffer is just how the board says it is there.
        with suppress(StageReset):
            self.hear_pending()
        self.in_step = True
        return self.command("$I")

    def full_speed(self) -> None:
        """End what overrides there are; a change from here on is somebody else's."""
        self.send_now(FULL_SPEED)
        self.overrides = FULL

    def refuse_interference(self, state: str) -> None:
        """Raises StageHeld where somebody holds the board, StageOverridden where they changed how fast it goes."""
        if is_held(state):
            raise StageHeld(state, f"{self.name}: ")
        if self.overrides != FULL:
            changed: dict[str, Any] = {
                f"{what}_percent": is_now
                for what, is_now in zip(OVERRIDDEN, self.overrides, strict=True)
                if is_now != 100
            }
            found = ", ".join(f"{name.removesuffix('_percent')} override {{{name}}} %" for name in changed)
            raise StageOverridden(
                f"{{port}}: {found}: somebody changed it at the controller, expected 100 %",
                port=self.name,
                **changed,
            )

    def recover(self) -> None:
        """Reset the board if it may still owe an answer or be deaf; the position is not trusted from here."""
        self.trusted = False
        if not self.in_step:
            self.reset()

    def stop_now(self) -> None:
        """Hold and reset, from any thread; before that goes out, lines that another thread would send are refused."""
        self.times_stopped += 1
        self.in_step = self.trusted = False
        self._transport.write(HOLD_AND_RESET)

    def send_now(self, data: bytes) -> None:
        """Real-time bytes: they wait for nothing."""
        self._transport.write(data)

    def command(self, line: str, *, look_s: float = math.inf) -> list[str]:
        """Send one line and wait for its ok; returns what was printed before it. Raises StageError.

        A board that somebody holds reads no line but answers `?`: look_s is how often it is asked.
        """
        talk = self.talking(line, REPLY_S, look_s)
        while True:
            try:
                next(talk)
                self.send_now(b"?")
            except StopIteration as over:
                return list(over.value)

    def talking(self, line: str, timeout_s: float, look_s: float = math.inf) -> Generator[list[str], None, list[str]]:
        """Send one line; yields what came so far each look_s until its ok, and returns it then. Raises StageError."""
        self.require_in_step(line)
        self.hear_pending()
        self._transport.write(line.encode("ascii") + b"\n")
        deadline_s = self._clock.monotonic_s() + timeout_s
        printed: list[str] = []
        while True:
            heard = self._hear(min(deadline_s, self._clock.monotonic_s() + look_s))
            if heard == "ok":
                return printed
            if heard is not None:
                self._refuse_error(heard, line)
                self._refuse_hold(heard)
                printed.append(heard)
            elif self._clock.monotonic_s() < deadline_s:
                yield printed
            else:
                self.in_step = self.trusted = False
                raise StageTimeout(
                    "{port}: no answer to {line!r} in {timeout_s:g} s",
                    code="no_reply",
                    port=self.name,
                    line=line,
                    timeout_s=timeout_s,
                )

    def require_in_step(self, line: str) -> None:
        """Raises StageError where the board may still owe an answer to another line."""
        if not self.in_step:
            raise StageError(
                "{port}: the board must be reset before {line!r}", code="needs_reset", port=self.name, line=line
            )

    def _refuse_error(self, heard: str, line: str) -> None:
        code = number_after(heard, "error:")
        if code is not None:
            raise StageRejected(code, line, ERRORS.get(code, "see the controller's manual"))

    def _refuse_hold(self, heard: str) -> None:
        """The line waits in the board's buffer for whoever holds it: only a reset takes it back."""
        fields = parse_status(heard)
        if fields is not None and is_held(fields.state):
            self.pins = fields.pins
            self.in_step = self.trusted = False
            self.refuse_interference(fields.state)

    def ask_status(self) -> StatusFields:
        """Send `?` and return its answer; a garbled one is asked again. Raises StageError."""
        for _ in range(ASK_TIMES):
            self.hear_pending()
            self._transport.write(b"?")
            deadline_s = self._clock.monotonic_s() + STATUS_S
            while (heard := self._hear(deadline_s)) is not None:
                fields = parse_status(heard)
                if fields is not None:
                    self.offset = fields.offset or self.offset
                    self.overrides = fields.overrides or self.overrides
                    self.pins = fields.pins
                    return fields
                if heard.startswith("<"):
                    break
        self.trusted = False
        raise StageTimeout(
            "{port}: no answer to ?, is it a GRBL board at this baud rate?", code="no_status", port=self.name
        )

    def listen_until(self, t_s: float) -> None:
        """Let time pass, but hear an alarm or a reset at once. Raises StageAlarm, StageReset."""
        while self._hear(t_s) is not None:
            pass

    def hear_pending(self) -> None:
        """Take in what has come unasked. Raises StageAlarm, StageReset."""
        while (line := self._reader.next_pending()) is not None:
            self._notice(line)

    def reset(self) -> None:
        """Reset the board and wait until it is through; drops queue, hold, alarm text and late answers.

        Twice if need be: the board loses a reset that comes while it prints a soft-limit alarm.
        """
        self.trusted = False
        for _ in range(2):
            self._reader.discard()
            self._transport.write(RESET)
            if self._await_banner():
                self.in_step = True
                self.offset, self.overrides = None, FULL
                return
        raise StageTimeout("{port}: no banner after a reset", code="no_banner", port=self.name)

    def _await_banner(self) -> bool:
        deadline_s = self._clock.monotonic_s() + BANNER_S
        seen = False
        while (line := self._reader.read_line(deadline_s)) is not None:
            seen = seen or is_banner(line)
            if seen:
                deadline_s = self._clock.monotonic_s() + QUIET_S
        return seen

    def _hear(self, deadline_s: float) -> str | None:
        line = self._reader.read_line(deadline_s)
        if line is not None:
            self._notice(line)
        return line

    def _notice(self, line: str) -> None:
        if is_banner(line):
            # It may have crossed with a line on the wire: whether that line still gets an answer is unknown.
            self.in_step, self.trusted, self.offset, self.overrides = False, False, None, FULL
            raise StageReset("{port}: the board was reset ({line})", port=self.name, line=line)
        code = number_after(line, "ALARM:")
        if code is not None:
            self.in_step = self.trusted = False
            raise StageAlarm(code, ALARMS.get(code, "see the controller's manual"), port=self.name)
