"""Protocol of a GRBL board: lines, reports, settings and work zero. Source: GRBL 1.1 interface wiki.

Each line waits for its reply, instead of counting characters, so that nothing is queued beyond one safe increment.
"""

import math
import re
from collections.abc import Generator, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from rig.clock import Clock
from rig.devices.base import (
    LOOK_S,
    MoveError,
    StageAlarm,
    StageError,
    StageHeld,
    StageOverridden,
    StageRejected,
    StageReset,
    StageTimeout,
    is_held,
)
from rig.devices.counted_axis import refuse_numbers, travel_s
from rig.settings import BenchSettings, StageBounds
from rig.transport import LineReader, Transport

ALARMS = {
    1: "hard limit",
    2: "soft limit: the target lies outside the travel",
    3: "reset while in motion: steps may be lost",
    4: "probe not in the expected state",
    5: "probe found nothing",
    6: "homing: reset during the cycle",
    7: "homing: door opened during the cycle",
    8: "homing: pull-off did not clear the switch",
    9: "homing: switch not found",
}
ERRORS = {
    1: "a word does not begin with a letter",
    2: "bad number",
    3: "unknown $ command or setting",
    4: "negative value",
    5: "homing is switched off ($22)",
    8: "not while the stage is busy",
    9: "locked: home or unlock first",
    10: "soft limits need homing ($22)",
    11: "line too long",
    13: "the safety door is open",
    15: "the jog target lies outside the travel",
    16: "not allowed in a jog",
    18: "the reset input is active (grblHAL)",
    20: "unsupported command",
    22: "no feed rate",
    45: "a limit switch is pressed (grblHAL)",
    46: "home first (grblHAL)",
    50: "the emergency stop is pressed (grblHAL)",
    51: "a motor driver reports a fault (grblHAL)",
    53: "unknown setting (grblHAL)",
    79: "not while an alarm is active (grblHAL)",
}
_BANNER = re.compile(r"Grbl(HAL)? \d\S* \[")
Xyz = tuple[float, float, float]
Overrides = tuple[int, int, int]
FULL: Overrides = (100, 100, 100)
HOLD_AND_RESET, JOG_CANCEL = b"!\x18", b"\x85"
OUTPUT_WORDS = {"coolant": ("M9", "M8"), "spindle": ("M5", "M3S1000")}
STOP_PINS = {"D": "door", "H": "hold"}
OVERRIDDEN = ("feed", "rapid", "spindle")


@dataclass(frozen=True, slots=True)
class StatusFields:
    """Fields of a `<…>` line: machine or work position (mm), at times their offset and the overrides (%)."""

    state: str
    machine: Xyz | None
    work: Xyz | None
    offset: Xyz | None
    overrides: Overrides | None = None
    pins: str = ""  # letters of the active inputs


def old_firmware(port: str, shown: str) -> StageError:
    """Return the error of a board with a firmware before GRBL 1.1."""
    return StageError(
        f"{port}: the firmware of the board is older than GRBL 1.1 ({shown}); install GRBL 1.1 or grblHAL on it, and "
        "compare its wiring, since pins differ",
        "old_firmware",
    )


def refuse_firmware(port: str, printed: Iterable[str]) -> None:
    """Raise StageError if the reply to `$I` is that of GRBL 0.9 or of FluidNC."""
    for line in printed:
        if re.match(r"\[0\.\d", line):
            raise old_firmware(port, line)
        if "FluidNC" in line:
            raise StageError(
                f"{port}: the firmware of the board is FluidNC ({line}), which keeps its settings in its own file; "
                "install GRBL 1.1 or grblHAL on it",
                "other_firmware",
            )


def homes_to_origin(printed: Iterable[str]) -> bool:
    """Return whether the reply to `$I` has the option Z: a homed board counts from where homing ends."""
    return any(line.startswith("[OPT:") and "Z" in line for line in printed)


def _is_old_status(line: str) -> bool:
    """Return whether this is a status of GRBL 0.9 or older, whose fields are separated by commas."""
    return re.match(r"<[A-Z][a-z]+,[^|]*>\Z", line) is not None


def is_banner(line: str) -> bool:
    """Return whether a line contains a banner, even after the rest of another line."""
    return "Grbl" in line and _BANNER.search(line) is not None


@lru_cache(maxsize=4)  # each status is looked at by several checks
def parse_status(line: str) -> StatusFields | None:
    """Parse the fields of a status line; None if it is garbled, or of GRBL 0.9."""
    if line[:1] != "<" or line[-1:] != ">" or "<" in line[1:] or _is_old_status(line):
        return None
    state, *parts = line[1:-1].split("|")
    fields = dict(part.partition(":")[::2] for part in parts)
    try:
        machine, work, offset = (_xyz(fields.get(name)) for name in ("MPos", "WPos", "WCO"))
        return StatusFields(state, machine, work, offset, _overrides(fields.get("Ov")), fields.get("Pn", ""))
    except ValueError:
        return None


def states(printed: Iterable[str]) -> list[str]:
    """Return the states of all status lines."""
    return [fields.state for line in printed if (fields := parse_status(line))]


def machine_from(work: Xyz | None, offset: Xyz | None) -> Xyz:
    """Return the machine position from work position and offset."""
    assert work is not None
    assert offset is not None
    return (work[0] + offset[0], work[1] + offset[1], work[2] + offset[2])


def parse_setting(line: str) -> tuple[int, float] | None:
    """Read `$n=v`; None for anything else, startup lines, text and garbled numbers included."""
    match = re.match(r"\$(\d+)=(-?\d+(?:\.\d*)?)(?![\d.])", line, re.ASCII)
    return (int(match[1]), float(match[2])) if match else None


def number_after(line: str, prefix: str) -> int | None:
    """Return the n of `prefix:n`, or None for another line; a garbled number counts as 0."""
    if not line.startswith(prefix):
        return None
    digits = line[len(prefix) :].strip()
    return int(digits) if digits.isdigit() else 0


def refuse_move(target: Mapping[str, float], speed_mm_s: float) -> None:
    """Raise MoveError for a move that no line can express."""
    if not target:
        raise MoveError("a move needs at least one of x_mm, y_mm, z_mm", "no_target")
    refuse_numbers(target, speed_mm_s)


def number(value: float, decimals: int = 4) -> str:
    """Return a number as text, without trailing zeros."""
    text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def feed_word(speed_mm_s: float) -> str:
    """Return the F word, mm/min."""
    return f"F{number(60 * speed_mm_s, 3)}"


def parse_modes(printed: Iterable[str]) -> tuple[frozenset[str], float | None]:
    """Return the modal words of the reply to `$G` and its feed (mm/min), or nothing and None."""
    for line in printed:
        if line.startswith("[GC:") and line.endswith("]"):
            words = line[4:-1].split()
            feeds = [text[1:] for text in words if text.startswith("F")]
            with suppress(ValueError):
                return frozenset(words), float(feeds[0]) if feeds else None
    return frozenset(), None


def _overrides(text: str | None) -> Overrides | None:
    if text is None:
        return None
    feed, rapid, spindle = map(int, text.split(","))
    return (feed, rapid, spindle)


def _xyz(text: str | None) -> Xyz | None:
    if text is None:
        return None
    x, y, z = map(float, text.split(",")[:3])
    if not math.isfinite(x + y + z):
        raise ValueError(text)
    return (x, y, z)


REPLY_S = 2.0
STATUS_S = 0.3
BANNER_S = 3.0
# After a banner the board may still print a message, or restart once more.
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
        self.times_stopped = 0  # counted from any thread
        self.offset: Xyz | None = None
        self.overrides = FULL
        self.pins = ""  # of the last status

    def hello(self) -> list[str]:
        """Ask a board in an unknown state for its identification. Raises StageError."""
        self.trusted = False
        # A banner in the buffer only shows that a board is connected.
        with suppress(StageReset):
            self.hear_pending()
        self.in_step = True
        return self.command("$I")

    def full_speed(self) -> None:
        """Reset all overrides to 100 %."""
        self.send_now(FULL_SPEED)
        self.overrides = FULL

    def refuse_interference(self, state: str) -> None:
        """Raise StageHeld if the board is held, StageOverridden if its speed was changed."""
        if is_held(state):
            raise StageHeld(state, f"{self.name}: ")
        if self.overrides != FULL:
            found = ", ".join(
                f"{what} override {percent} %"
                for what, percent in zip(OVERRIDDEN, self.overrides, strict=True)
                if percent != 100
            )
            raise StageOverridden(f"{self.name}: {found} at the controller; reset it to 100 %")

    def recover(self) -> None:
        """Reset the board if it may still owe a reply; the position is not trusted afterwards."""
        self.trusted = False
        if not self.in_step:
            self.reset()

    def stop_now(self) -> None:
        """Hold and reset, from any thread; lines of other threads are refused from now on."""
        self.times_stopped += 1
        self.in_step = self.trusted = False
        self._transport.write(HOLD_AND_RESET)

    def send_now(self, data: bytes) -> None:
        """Send real-time bytes at once."""
        self._transport.write(data)

    def command(self, line: str, *, look_s: float = math.inf) -> list[str]:
        """Send one line, wait for its ok and return the lines printed before it. Raises StageError.

        A held board does not read lines but answers `?`, which is sent every look_s.
        """
        talk = self.talking(line, REPLY_S, look_s)
        while True:
            try:
                next(talk)
                self.send_now(b"?")
            except StopIteration as over:
                return list(over.value)

    def talking(self, line: str, timeout_s: float, look_s: float = math.inf) -> Generator[list[str], None, list[str]]:
        """Send one line; yield the lines so far every look_s, and return them after ok. Raises StageError."""
        self.require_in_step(line)
        self.hear_pending()
        self._transport.write(line.encode("ascii") + b"\n")
        deadline_s = self._clock.monotonic_s() + timeout_s
        printed: list[str] = []
        while True:
            reply = self._hear(min(deadline_s, self._clock.monotonic_s() + look_s))
            if reply == "ok":
                return printed
            if reply is not None:
                self._refuse_error(reply, line)
                self._refuse_hold(reply)
                printed.append(reply)
            elif self._clock.monotonic_s() < deadline_s:
                yield printed
            else:
                self.in_step = self.trusted = False
                raise StageTimeout(
                    f"{self.name}: no answer to {line!r} within {timeout_s:g} s; check the power, the cable and "
                    "stage.baud",
                    "no_reply",
                )

    def require_in_step(self, line: str) -> None:
        """Raise StageError if the board may still owe a reply to another line."""
        if not self.in_step:
            raise StageError(
                f"{self.name}: the board may still owe an answer, so {line!r} was not sent; home the stage, which "
                "resets the board",
                "needs_reset",
            )

    def _refuse_error(self, reply: str, line: str) -> None:
        code = number_after(reply, "error:")
        if code is not None:
            raise StageRejected(code, line, ERRORS.get(code, "see the controller's manual"))

    def _refuse_hold(self, reply: str) -> None:
        """Raise if the board is held: the line waits in its buffer, and only a reset removes it."""
        fields = parse_status(reply)
        if fields is not None and is_held(fields.state):
            self.pins = fields.pins
            self.in_step = self.trusted = False
            self.refuse_interference(fields.state)

    def ask_status(self) -> StatusFields:
        """Send `?` and return the status; repeat if it is garbled. Raises StageError."""
        old = ""
        for _ in range(ASK_TIMES):
            self.hear_pending()
            self._transport.write(b"?")
            deadline_s = self._clock.monotonic_s() + STATUS_S
            while (reply := self._hear(deadline_s)) is not None:
                fields = parse_status(reply)
                if fields is not None:
                    self.overrides = fields.overrides or self.overrides
                    self.pins = fields.pins
                    return fields
                if reply.startswith("<"):
                    old = reply if _is_old_status(reply) else ""
                    break
        self.trusted = False
        if old:
            raise old_firmware(self.name, old)
        raise StageTimeout(
            f"{self.name}: no answer to a status request (?); check that it is a GRBL board, and stage.baud",
            "no_status",
        )

    def void_offset(self) -> None:
        """Forget the offset: reports before the ok of a line that sets it have the old one."""
        self.offset = None

    def listen_until(self, t_s: float) -> None:
        """Wait, but notice an alarm or a reset at once. Raises StageAlarm, StageReset."""
        while self._hear(t_s) is not None:
            pass

    def hear_pending(self) -> None:
        """Read unsolicited lines. Raises StageAlarm, StageReset, TransportError."""
        for line in self._reader.pending():
            self._notice(line)

    def reset(self) -> None:
        """Reset the board and wait for its banner; drops queue, hold, alarm text and late answers.

        A second attempt is made, because the board ignores a reset while it prints a soft-limit alarm.
        """
        self.trusted = False
        for _ in range(2):
            self._reader.discard()
            self._transport.write(RESET)
            if self._await_banner():
                self.in_step = True
                self.offset, self.overrides = None, FULL
                return
        raise StageTimeout(
            f"{self.name}: no startup message after a reset; check that it is a GRBL board, and stage.baud",
            "no_banner",
        )

    def _await_banner(self) -> bool:
        deadline_s = self._clock.monotonic_s() + BANNER_S
        seen = False
        while (line := self._reader.read_line(deadline_s)) is not None:
            if is_banner(line) and "Grbl 0." in line:
                raise old_firmware(self.name, line)
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
        # A board reports a new offset once, perhaps in answer to a `?` that was sent while it owed an ok.
        if (fields := parse_status(line)) is not None:
            self.offset = fields.offset or self.offset
        if is_banner(line):
            # The banner may have crossed a line, which may or may not still be answered.
            self.in_step, self.trusted, self.offset, self.overrides = False, False, None, FULL
            raise StageReset(f"{self.name}: the board restarted ({line}); home again")
        code = number_after(line, "ALARM:")
        if code is not None:
            self.in_step = self.trusted = False
            raise StageAlarm(code, ALARMS.get(code, "see the controller's manual"))


STEP_DIRECTION, REPORTS, INCHES, SOFT_LIMITS, HOMING, LASER = 3, 10, 13, 20, 22, 32
HOMING_DIRECTION, PULL_OFF = 23, 27
STEPS_PER_MM, MOST_MM_MIN, ACCELERATION, TRAVEL = 100, 110, 120, 130
VOLATILE_OFFSET = 384  # grblHAL stores G92 unless this is 1, which would wear out its memory.
_REPORTED = 1 << 5 | 1 << 6  # $10 in grblHAL: offset of the work zero, and overrides

# Boards print three decimals.
_TOLERANCE = 5e-4
_PRINTED_MM = 1e-3
# The board computes with 24 bits: rounding must not move a target beyond its soft limits.
_INSIDE_MM, _ROUND_OFF_MM = 2e-4, 1e-9


class Difference(NamedTuple):
    """Setting that differs from the expected value; `with_which` is an explanation."""

    number: int
    expected: float
    found: float
    with_which: str = ""

    def __str__(self) -> str:
        return f"${self.number}={self.expected:g} (found {self.found:g}{self.with_which})"


class Misplaced(NamedTuple):
    """Axis that is not at its target."""

    axis: str
    at_mm: float
    target_mm: float

    def __str__(self) -> str:
        return f"{self.axis} is at {self.at_mm} mm instead of {self.target_mm} mm"


def expected_settings(settings: BenchSettings) -> dict[int, float]:
    """Return the settings, by number, that the board must have: homing, travel and calibration.

    The soft limits and the travel of the vertical axis belong to enforced_settings().
    """
    expected: dict[int, float] = {INCHES: 0, HOMING: 1, LASER: 0}
    expected |= {TRAVEL + i: mm for i, mm in enumerate(settings.stage.travel_mm[:2])}
    measured = dict(settings.calibration.measured())
    steps = [measured.get(f"{axis}_steps_per_mm") for axis in "xyz"]
    expected |= {STEPS_PER_MM + i: abs(one.value) for i, one in enumerate(steps) if one}
    directions = [one.value < 0 for one in steps if one]
    if len(directions) == len(steps):
        expected[STEP_DIRECTION] = sum(against << i for i, against in enumerate(directions))
    return expected


def enforced_settings(board: Mapping[int, float], bounds: StageBounds) -> dict[int, float]:
    """Return the settings that make the board enforce its travel, the lowest height and the highest rate.

    A lower rate of the board is kept, since its motors may not be faster.
    """
    most_mm_min = 60 * bounds.fastest_mm_s
    rates = {n: most_mm_min for n in range(MOST_MM_MIN, MOST_MM_MIN + 3) if board.get(n, 0.0) > most_mm_min}
    return {**rates, SOFT_LIMITS: 1, TRAVEL + 2: -bounds.lowest_z_mm}


def differences(board: Mapping[int, float], expected: Mapping[int, float]) -> list[Difference]:
    """Return the settings that differ from the expected ones; a missing setting counts as 0."""
    return [
        Difference(number, value, board.get(number, 0.0))
        for number, value in expected.items()
        if differs(board, number, value)
    ]


def refuse_missing(port: str, board: Mapping[int, float], required: Mapping[int, float]) -> None:
    """Raise StageError if the board does not have a setting that must not be 0."""
    missing = [f"${number}" for number, value in sorted(required.items()) if value and number not in board]
    if missing:
        raise StageError(
            f"{port}: the board does not have the settings {', '.join(missing)}, which GRBL 1.1 and grblHAL have; "
            "install one of these on it",
            "settings_missing",
        )


def unsuited(printed: Iterable[str], board: Mapping[int, float]) -> list[Difference]:
    """Return the settings that prevent moves from being confirmed, or positions from being negative."""
    found, homes_down = list[Difference](), int(board.get(HOMING_DIRECTION, 0.0))
    if homes_to_origin(printed) and homes_down & 7:
        found.append(Difference(HOMING_DIRECTION, homes_down & ~7, homes_down, ", with which positions are positive"))
    elif homes_down & 4:
        up = homes_down & ~4
        found.append(Difference(HOMING_DIRECTION, up, homes_down, ", with which Z homes downwards"))
    if "[FIRMWARE:grblHAL]" not in printed:
        return found
    mask = int(board.get(REPORTS, _REPORTED))
    if mask & _REPORTED != _REPORTED:
        found.append(Difference(REPORTS, mask | _REPORTED, mask, ", which hides its work zero or its overrides"))
    if board.get(VOLATILE_OFFSET, 1.0) != 1:
        found.append(Difference(VOLATILE_OFFSET, 1, 0, ", which stores each target in memory that wears out"))
    return found


def expected_s_of(board: Mapping[int, float], was: Xyz, target: Mapping[str, float], speed_mm_s: float) -> float:
    """Return the duration of a move (s) with these settings; an unknown setting limits nothing."""
    moves = {i: abs(target[axis] - was[i]) for i, axis in enumerate("XYZ") if target.get(axis, was[i]) != was[i]}
    length, accel = math.hypot(*moves.values()), math.inf
    for i, mm in moves.items():
        most, steepest = (board.get(first + i, math.inf) for first in (MOST_MM_MIN, ACCELERATION))
        speed_mm_s = min(speed_mm_s, most / 60 * length / mm)
        accel = min(accel, steepest * length / mm)
    return travel_s(length, speed_mm_s, accel)


def overrun(target: dict[str, float], was: Xyz | None, backlash_mm: Xyz) -> dict[str, float]:
    """Return the target, overrun by twice the backlash on axes that would arrive in positive direction."""
    if was is None:
        return target
    slack = {
        axis: 2 * backlash
        for axis, backlash, from_mm in zip("XYZ", backlash_mm, was, strict=True)
        if target.get(axis, from_mm) > from_mm
    }
    return {axis: min(mm + slack[axis], 0.0) if slack.get(axis) else mm for axis, mm in target.items()}


def near(board: Mapping[int, float], axis: int, printed_mm: float, meant_mm: float) -> bool:
    """Return whether a printed position equals the intended one, to half a step and the last digit."""
    steps_per_mm = board.get(STEPS_PER_MM + axis)
    tolerance_mm = 0.5 / steps_per_mm + _PRINTED_MM if steps_per_mm else 0.5 * _PRINTED_MM
    return abs(printed_mm - meant_mm) <= tolerance_mm


def misplaced(board: Mapping[int, float], target: Mapping[str, float], at: Xyz) -> Misplaced | None:
    """Return the first axis that is not at its target, or None."""
    for i, (axis, is_mm) in enumerate(zip("XYZ", at, strict=True)):
        if axis in target and not near(board, i, is_mm, target[axis]):
            return Misplaced(axis, is_mm, target[axis])
    return None


def on_a_step(board: Mapping[int, float], axis: int, mm: float) -> float:
    """Return the position of the nearest step, as the board rounds, kept within the soft limits.

    The board prints three decimals but rests on a step, so its position is known exactly.
    """
    steps_per_mm = board.get(STEPS_PER_MM + axis)
    if steps_per_mm:
        mm = math.copysign(math.floor(abs(mm) * steps_per_mm + 0.5), mm) / steps_per_mm
    lowest_mm = -board.get(TRAVEL + axis, math.inf)
    if -_INSIDE_MM < mm <= _ROUND_OFF_MM:
        return -_INSIDE_MM
    return lowest_mm + _INSIDE_MM if lowest_mm - _ROUND_OFF_MM <= mm < lowest_mm + _INSIDE_MM else mm


def at_home(board: Mapping[int, float], *, to_origin: bool) -> dict[str, float]:
    """Return where homing ends (mm) by axis; empty if the board does not report its pull-off."""
    if to_origin:
        return dict.fromkeys("XYZ", 0.0)
    if PULL_OFF not in board:
        return {}
    negative, off_mm = int(board.get(HOMING_DIRECTION, 0.0)), board[PULL_OFF]
    ends = (off_mm - board.get(TRAVEL + i, 0.0) if negative >> i & 1 else -off_mm for i in range(3))
    return dict(zip("XYZ", ends, strict=True))


def keys_of(board: Mapping[int, float], expected: Mapping[int, float]) -> str:
    """Return the configuration key behind a difference, in brackets; empty for settings that are always required."""
    travel = [number for number in (TRAVEL, TRAVEL + 1) if number in expected]
    return " (stage.travel_mm)" if any(differs(board, number, expected[number]) for number in travel) else ""


def differs(board: Mapping[int, float], number: int, value: float) -> bool:
    """Return whether a setting differs from a value, to the printed precision; a missing setting counts as 0."""
    return abs(board.get(number, 0.0) - value) > _TOLERANCE


# Work zero: the target of a motion, set and read back before anything can move (decision 0036).
# GRBL has no checksums. A target is sent as an offset (G92), which moves nothing, and the board prints the
# resulting work zero (WCO in the next status). The stage moves only to a position that was read back, with a
# constant trigger.

SHORT_MM = 0.1
"""Length of an increment (mm), too short for the feed to matter: at 50 mm/s² it ends before full speed."""

MODES = "G90G21G94"
_OFFSET_ROUND_OFF_MM = 1e-9
# `$G` prints the feed without decimals.
_FEED_SHOWN_MM_MIN = 0.51


def offset_line(coordinates: Xyz, speed_mm_s: float) -> str:
    """Return the line that sets the work coordinates of the present position, modes and feed.

    G92 comes first and each later word is there twice if one bit of G92 turns it into another command that would
    move: `G90`, `G93` and `F92` are then refused, and a lost G leaves no number for it to join.
    """
    x, y, z = map(number, coordinates)
    return f"G92X{x}Y{y}Z{z}{MODES}{feed_word(speed_mm_s)}"


def doubt_about_zero(
    link: GrblLink, board: Mapping[int, float], present: Xyz, coordinates: Xyz, speed_mm_s: float
) -> str | None:
    """Set the work zero and read it back; nothing moves. Before a long motion, read back modes and feed as well.

    Settings of the board are by number, `present` is in machine mm, and `coordinates` are the work coordinates (mm)
    there. Returns the missing confirmation, or None; raises StageError if the board refuses the line, does not
    respond, is held, or is not idle.
    """
    link.void_offset()  # also if the board refuses the line
    link.command(offset_line(coordinates, speed_mm_s), look_s=LOOK_S)
    link.void_offset()
    if max(map(abs, coordinates)) > SHORT_MM + _OFFSET_ROUND_OFF_MM:
        printed = link.command("$G", look_s=LOOK_S)
        if (doubt := _doubt_about_modes(printed, 60 * speed_mm_s)) is not None:
            return doubt
    fields = link.ask_status()
    link.refuse_interference(fields.state)
    if fields.state != "Idle":
        raise StageError(
            f"{link.name}: the board is in state {fields.state} before a move, expected Idle", "not_idle"
        )
    if link.offset is None:
        return "the status report after G92 contains no WCO"
    intended = tuple(mm - coordinate for mm, coordinate in zip(present, coordinates, strict=True))
    wrong = (
        f"work zero {axis} is at {found} mm instead of {mm:.4f} mm"
        for i, (axis, found, mm) in enumerate(zip("XYZ", link.offset, intended, strict=True))
        if not near(board, i, found, mm)
    )
    return ", ".join(wrong) or None


def _doubt_about_modes(printed: list[str], feed_mm_min: float) -> str | None:
    words, feed = parse_modes(printed)
    missing = sorted({"G90", "G21", "G94"} - words)
    if missing:
        return f"$G does not show {', '.join(missing)}"
    if feed is None or abs(feed - feed_mm_min) > _FEED_SHOWN_MM_MIN:
        return f"$G shows a feed of {feed} mm/min instead of {feed_mm_min:g} mm/min"
    return None
