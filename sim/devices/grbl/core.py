"""Core of the virtual GRBL board: bytes, state and waiting.

Source: GRBL 1.1 interface wiki and the behavior of the 1.1h firmware.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import copysign, floor, inf

from sim.devices.clock import Handle, Scheduler
from sim.devices.grbl.gcode import MM_PER_INCH, LineAssembler, Modal, Offsets
from sim.devices.grbl.planner import Counts, MotionPlanner, Share, Vec
from sim.devices.grbl.settings import HOMING, GrblSettings
from sim.devices.line import SerialLine

# --- overrides ---
#
# Source: GRBL 1.1 interface wiki; the 1.1h firmware: protocol.c, config.h (steps of 10 and 1, from 10 to 200).

FULL, LEAST, MOST = 100, 10, 200
_STEPS = {0x91: ("feed", 10), 0x92: ("feed", -10), 0x93: ("feed", 1), 0x94: ("feed", -1),
          0x9A: ("spindle", 10), 0x9B: ("spindle", -10), 0x9C: ("spindle", 1), 0x9D: ("spindle", -1)}  # fmt: skip
_VALUES = {
    0x90: ("feed", FULL),
    0x95: ("rapid", FULL),
    0x96: ("rapid", 50),
    0x97: ("rapid", 25),
    0x99: ("spindle", FULL),
}
OVERRIDE_BYTES = (*_STEPS, *_VALUES)


@dataclass(frozen=True)
class Overrides:
    """Feed, rapid and spindle overrides, in percent."""

    feed: int = FULL
    rapid: int = FULL
    spindle: int = FULL

    def after(self, byte: int) -> "Overrides":
        """Return the overrides after a real-time byte."""
        if byte in _VALUES:
            name, value = _VALUES[byte]
        else:
            name, step = _STEPS[byte]
            value = min(max(getattr(self, name) + step, LEAST), MOST)
        return replace(self, **{name: value})

    @property
    def share(self) -> Share:
        return Share(self.feed / FULL, self.rapid / FULL)

    def __str__(self) -> str:
        return f"{self.feed},{self.rapid},{self.spindle}"


# --- report ---
#
# Source: GRBL 1.1 interface wiki.

BANNER = "\r\nGrbl 1.1h ['$' for help]"
HELP = "[HLP:$$ $# $G $I $N $x=val $Nx=line $J=line $SLP $C $X $H ~ ! ? ctrl-x]"
ENABLED, DISABLED, PROGRAM_END = "[MSG:Enabled]", "[MSG:Disabled]", "[MSG:Pgm End]"
UNLOCK = "[MSG:'$H'|'$X' to unlock]"
RX_BYTES = 128

_WCO_EVERY = {True: 30, False: 10}
_OV_EVERY = {True: 20, False: 10}
_SPINDLE_LETTER = {3: "S", 4: "C", 5: ""}


@dataclass
class Snapshot:
    """State of the board at a `?`: mm, mm/min, free planner blocks and receive bytes, limit pins."""

    state: str
    machine_mm: Vec
    feed: float
    blocks_free: int
    bytes_free: int
    pins: str
    modal: Modal
    offset_mm: Vec
    overrides: Overrides


class StatusReports:
    """Formatter of `<…>` lines; WCO and Ov appear only in some, less often while busy."""

    def __init__(self, settings: GrblSettings) -> None:
        self._settings = settings
        self._wco_in = 0
        self._ov_in = 0

    def start_over(self) -> None:
        self._wco_in = self._ov_in = 0

    def show_offset(self) -> None:
        """Report work coordinates soon: they or their unit have changed."""
        self._wco_in = 0

    def show_overrides(self) -> None:
        """Report Ov, and with it A, soon: outputs or overrides have changed."""
        self._ov_in = 0

    def line(self, at: Snapshot) -> str:
        mask = int(self._settings[10])
        inches = self._settings.flag(13)
        parts = [at.state, self._position(at, bool(mask & 1), inches)]
        if mask & 2:
            parts.append(f"Bf:{at.blocks_free},{at.bytes_free}")
        parts.append(f"FS:{rate(at.feed, inches)},{self._rpm(at):.0f}")
        if at.pins:
            parts.append(f"Pn:{at.pins}")
        return f"<{'|'.join(parts + self._now_and_then(at, inches))}>"

    def _rpm(self, at: Snapshot) -> float:
        requested = 0.0 if at.modal.spindle == 5 else at.modal.speed * at.overrides.spindle / FULL
        return min(max(requested, self._settings[31]), self._settings[30]) if requested else 0.0

    def _position(self, at: Snapshot, as_machine: bool, inches: bool) -> str:
        if as_machine:
            return "MPos:" + coordinates(at.machine_mm, inches)
        (x, y, z), (i, j, k) = at.machine_mm, at.offset_mm
        return "WPos:" + coordinates((x - i, y - j, z - k), inches)

    def _now_and_then(self, at: Snapshot, inches: bool) -> list[str]:
        busy = at.state not in ("Idle", "Alarm", "Check", "Sleep")
        parts = []
        if self._wco_in > 0:
            self._wco_in -= 1
        else:
            self._wco_in = _WCO_EVERY[busy] - 1
            # The firmware never sends both in one line: Ov follows in the next.
            self._ov_in = max(self._ov_in, 1)
            parts.append("WCO:" + coordinates(at.offset_mm, inches))
        if self._ov_in > 0:
            self._ov_in -= 1
        else:
            self._ov_in = _OV_EVERY[busy] - 1
            parts.append(f"Ov:{at.overrides}")
            accessories = _SPINDLE_LETTER[at.modal.spindle] + ("F" if at.modal.coolant == 8 else "")
            parts += [f"A:{accessories}"] if accessories else []
        return parts


def coordinates(mm: Vec, inches: bool = False) -> str:
    x, y, z = mm
    if inches:
        return f"{x / MM_PER_INCH:.4f},{y / MM_PER_INCH:.4f},{z / MM_PER_INCH:.4f}"
    return f"{x:.3f},{y:.3f},{z:.3f}"


def build(info: str, options: str) -> list[str]:
    """Return the answer to `$I`."""
    return [f"[VER:1.1h.20190830:{info}]", f"[OPT:{options},15,128]"]


def rate(mm_min: float, inches: bool) -> str:
    return f"{mm_min / MM_PER_INCH:.1f}" if inches else f"{mm_min:.0f}"


def parser_state(modal: Modal, inches: bool) -> str:
    """Return the answer to `$G`; the tool is that of the line before, so nearly always 0."""
    units, distance, mode = 21 if modal.metric else 20, 90 if modal.absolute else 91, 93 if modal.inverse_time else 94
    modes = f"G{modal.motion} G{54 + modal.system} G{modal.plane} G{units} G{distance} G{mode}"
    outputs = f"M{modal.spindle} M{modal.coolant}"
    return f"[GC:{modes} {outputs} T0 F{rate(modal.feed, inches)} S{modal.speed:.0f}]"


def parameters(offsets: Offsets, inches: bool) -> list[str]:
    """Return the answer to `$#`, without a probe result."""
    stored = [*offsets.systems, offsets.g28, offsets.g30, offsets.g92]
    names = ("G54", "G55", "G56", "G57", "G58", "G59", "G28", "G30", "G92")
    lines = [f"[{name}:{coordinates(mm, inches)}]" for name, mm in zip(names, stored, strict=True)]
    length = coordinates((offsets.length_mm, 0.0, 0.0), inches).split(",")[0]
    return [*lines, f"[TLO:{length}]", f"[PRB:{coordinates((0.0, 0.0, 0.0), inches)}:0]"]


OVERFLOW = 11
_OUTPUTS_KEPT = 1000


@dataclass(frozen=True)
class Mechanics:
    """Mechanics behind the board's motors, which the board cannot sense.

    start_mm is the carriage's position relative to the home switches; slip_steps is how far inertia carries a moving
    axis past a reset; play_steps is the lost motion of each screw.
    """

    start_mm: Vec = (-30.0, -15.0, -10.0)
    slip_steps: int = 0
    play_steps: Vec = (0.0, 0.0, 0.0)


@dataclass
class Wait:
    """Condition that blocks the main program; ready_s changes with the motion plan."""

    ready_s: Callable[[], float]
    proceed: Callable[[float], None]
    through_hold: bool = False


class GrblCore:
    """Board with three axes behind a serial line; subclasses interpret the bytes."""

    def __init__(
        self,
        scheduler: Scheduler,
        line: SerialLine,
        settings: Mapping[int, float] | None,
        work_offset_mm: Vec,
        mechanics: Mechanics,
    ) -> None:
        self._scheduler = scheduler
        self._wire = line
        self._settings = GrblSettings(settings)
        self._offsets, self._slip_steps = Offsets().with_system(0, work_offset_mm), mechanics.slip_steps
        self._reports = StatusReports(self._settings)
        self._planner = MotionPlanner(
            self._settings.limits(), self._to_steps(mechanics.start_mm), mechanics.play_steps
        )
        self._rx: deque[int] = deque()
        self._state = self._after_jog = "Idle"
        self._deaf = self._dead = self._owes_ok = self._jog_cancelled = self._asked_in_homing = False
        self._zero: Counts = (0, 0, 0)
        self._wait: Wait | None = None
        self._alarm_clock: Handle | None = None
        self._lines = LineAssembler()
        self._modal, self._overrides = Modal(), Overrides()
        self.homes_to_origin = False  # built with HOMING_FORCE_SET_ORIGIN, the option Z
        self._pressed: set[str] = set()  # letters of the stop inputs
        self._realtime: dict[int, Callable[[float], None]] = {}
        self.outputs: deque[tuple[float, str]] = deque(maxlen=_OUTPUTS_KEPT)  # all switching events: s, M word
        line.connect(self._on_bytes)
        self.power_cycle()

    def carriage_steps_at(self, t_s: float) -> Counts:
        """Return the motors' true position in steps from the home switches (x, y, z); past, present or planned."""
        return self._planner.track.counts_at(t_s)

    def nut_steps_at(self, t_s: float) -> Counts:
        """Return the nuts' position: behind the motors by the play where they went up last."""
        return self._planner.track.nut_at(t_s)

    def power_cycle(self) -> None:
        """Switch off and on: motion stops, and the board's position becomes zero."""
        now_s = self._scheduler.monotonic_s()
        self._planner.halt(now_s)
        x, y, z = self.carriage_steps_at(now_s)
        self._zero = (-x, -y, -z)
        self._boot(now_s, locked=self._settings.flag(HOMING))

    # --- bytes in and out ---

    def _on_bytes(self, data: bytes) -> None:
        now_s = self._scheduler.monotonic_s()
        self._settle(now_s)
        for byte in data:
            act = self._realtime.get(byte)
            if act is not None:
                act(now_s)
            elif byte < 0x80:
                self._take(byte, now_s)

    def _take(self, byte: int, now_s: float) -> None:
        if not self._busy():
            self._feed(byte, now_s)
        elif len(self._rx) < RX_BYTES:
            self._rx.append(byte)

    def _pump(self, now_s: float) -> None:
        while self._rx and not self._busy():
            self._feed(self._rx.popleft(), now_s)

    def _feed(self, byte: int, now_s: float) -> None:
        line = self._lines.feed(byte)
        if line is not None:
            self._owes_ok = True
            self._reply(OVERFLOW if self._lines.overflowed else self._execute(line, now_s))

    def _reply(self, code: int | None) -> None:
        if code is not None:
            self._owes_ok = False
            self._send(f"error:{code}" if code else "ok")

    def _send(self, *lines: str) -> None:
        self._wire.device_write("".join(f"{line}\r\n" for line in lines).encode("ascii"))

    # --- state ---

    def _busy(self) -> bool:
        """Return whether lines have to wait in the receive buffer."""
        return self._wait is not None or self._deaf or self._jog_cancelled or self._state in ("Hold", "Door", "Sleep")

    def _settle(self, now_s: float) -> None:
        """Update the state for motion that has ended since the last byte."""
        if self._state in ("Run", "Jog") and now_s >= self._planner.end_s:
            self._state = "Idle"
            if self._jog_cancelled:
                self._planner.halt(now_s)
                self._sync(now_s)
                self._state, self._jog_cancelled = self._after_jog, False

    def _boot(self, now_s: float, locked: bool) -> None:
        self._planner.halt(now_s)
        self._wait = None
        self._arm()
        self._rx.clear()
        self._lines.clear()
        self._reports.start_over()
        self._switch_outputs(Modal(), now_s)
        self._modal = Modal()
        self._offsets = self._offsets.after_reset()
        self._set_overrides(Overrides(), now_s)
        self._deaf = self._dead = self._owes_ok = self._jog_cancelled = self._asked_in_homing = False
        self._after_jog = "Idle"
        self._state = "Alarm" if locked else "Idle"
        self._sync(now_s)
        self._send(BANNER, *([UNLOCK] if locked else []))

    def _switch_outputs(self, to: Modal, now_s: float) -> None:
        changed = [f"M{new}" for new, old in zip(to.outputs, self._modal.outputs, strict=True) if new != old]
        self.outputs.extend((now_s, word) for word in changed)

    def _set_overrides(self, to: Overrides, now_s: float) -> None:
        """Set overrides until the next reset; they change the current motion unless it is already stopping."""
        if to != self._overrides:
            under_way = self._state in ("Run", "Jog") and not self._jog_cancelled and now_s < self._planner.end_s
            self._overrides = to
            self._planner.override(to.share, now_s, moving=under_way)
            self._reports.show_overrides()
            self._arm()

    def _sync(self, now_s: float) -> None:
        """Set parser and planner to the board's believed position."""
        self._queued_to = self.carriage_steps_at(now_s)
        self._parser_mm = self._machine_mm(self._queued_to)

    def _machine_mm(self, carriage: Counts) -> Vec:
        x, y, z = (
            (steps + zero) / per
            for steps, zero, per in zip(carriage, self._zero, self._settings.per_axis(100), strict=True)
        )
        return (x, y, z)

    def _to_steps(self, mm: Vec) -> Counts:
        x, y, z = (_nearest(d * per) for d, per in zip(mm, self._settings.per_axis(100), strict=True))
        return (x, y, z)

    # --- waiting ---

    def _wait_for(self, wait: Wait) -> None:
        self._wait = wait
        self._arm()

    def _arm(self) -> None:
        """Set the timer for the current wait, by the current motion plan."""
        if self._alarm_clock is not None:
            self._alarm_clock.cancel()
            self._alarm_clock = None
        wait = self._wait
        if wait is not None and (wait.through_hold or self._state not in ("Hold", "Door")):
            ready_s = wait.ready_s()
            if ready_s < inf:
                self._alarm_clock = self._scheduler.call_at(ready_s, self._wake)

    def _wake(self) -> None:
        now_s = self._scheduler.monotonic_s()
        self._settle(now_s)
        wait, self._wait, self._alarm_clock = self._wait, None, None
        if wait is not None:
            wait.proceed(now_s)
        self._pump(now_s)

    def _execute(self, line: str, now_s: float) -> int | None:
        """Execute a line; return the error number, 0 for ok, None if the answer comes later."""
        raise NotImplementedError


def _nearest(steps: float) -> int:
    return int(copysign(floor(abs(steps) + 0.5), steps))
