"""The core of the virtual GRBL board: bytes, state, waiting, and the real-time commands.

Source: GRBL 1.1 interface wiki and the behaviour of the 1.1h firmware.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import copysign, floor, inf

from sim.clock import Handle, Scheduler
from sim.devices import grbl_report as report
from sim.devices.grbl_gcode import Modal
from sim.devices.grbl_lines import LineAssembler
from sim.devices.grbl_settings import HOMING, GrblSettings
from sim.devices.line import SerialLine
from sim.devices.motion import Counts, Vec
from sim.devices.planner import BLOCKS, Planner

# The firmware stands still this long after printing an alarm, and is deaf meanwhile.
ALARM_PAUSE_S = 0.5

OVERFLOW = 11
RESET_IN_MOTION, RESET_IN_HOMING, DOOR_IN_HOMING = 3, 6, 7


@dataclass
class Wait:
    """Something the main program stands still for; ready_s moves when the plan of motion does."""

    ready_s: Callable[[], float]
    proceed: Callable[[float], None]
    through_hold: bool = False


class GrblCore:
    """A board with three axes behind a serial line; what lines mean is left to VirtualGrbl."""

    def __init__(
        self,
        scheduler: Scheduler,
        line: SerialLine,
        *,
        settings: Mapping[int, float] | None = None,
        start_mm: Vec = (-30.0, -15.0, -10.0),
        work_offset_mm: Vec = (0.0, 0.0, 0.0),
        slip_steps: int = 0,
    ) -> None:
        self._scheduler = scheduler
        self._wire = line
        self._settings = GrblSettings(settings)
        self._offset_mm = work_offset_mm
        self._slip_steps = slip_steps
        self._reports = report.StatusReports(self._settings, work_offset_mm)
        self._planner = Planner(self._settings.limits(), self._to_steps(start_mm))
        self._rx: deque[int] = deque()
        self._state = self._after_jog = "Idle"
        self._deaf = self._dead = self._owes_ok = self._jog_cancelled = self._asked_in_homing = False
        self._zero: Counts = (0, 0, 0)
        self._wait: Wait | None = None
        self._alarm_clock: Handle | None = None
        self._lines = LineAssembler()
        self._realtime: dict[int, Callable[[float], None]] = {
            ord("?"): self._report_status,
            ord("!"): self._hold,
            ord("~"): self._resume,
            0x18: self._reset,
            0x84: self._open_door,
            0x85: self._cancel_jog,
        }
        line.connect(self._on_bytes)
        self.power_cycle()

    def carriage_steps_at(self, t_s: float) -> Counts:
        """Where the carriage really is, steps from the home switches (x, y, z); past, present or planned."""
        return self._planner.track.counts_at(t_s)

    def power_cycle(self) -> None:
        """Switch off and on: motion stops, the board takes the place it wakes up at for zero."""
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
        elif len(self._rx) < report.RX_BYTES:
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
        """Whether lines have to wait in the receive buffer."""
        return (
            self._wait is not None
            or self._deaf
            or self._jog_cancelled
            or self._state in ("Hold", "Door", "Sleep")
        )

    def _settle(self, now_s: float) -> None:
        """Notice what has come to rest since the last byte."""
        if self._state in ("Run", "Jog") and now_s >= self._planner.end_s:
            self._state = "Idle"
            if self._jog_cancelled:
                self._planner.halt(now_s)
                self._sync(now_s)
                self._state, self._jog_cancelled = self._after_jog, False

    def _boot(self, now_s: float, locked: bool) -> None:
        self._planner.halt(now_s)
        self._stop_waiting()
        self._rx.clear()
        self._lines.clear()
        self._reports.start_over()
        self._modal = Modal()
        self._deaf = self._dead = self._owes_ok = self._jog_cancelled = self._asked_in_homing = False
        self._after_jog = "Idle"
        self._state = "Alarm" if locked else "Idle"
        self._sync(now_s)
        self._send(report.BANNER, *([report.UNLOCK] if locked else []))

    def _sync(self, now_s: float) -> None:
        """Let parser and planner start from where the board believes the carriage is."""
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

    def _stop_waiting(self) -> None:
        self._wait = None
        self._arm()

    def _arm(self) -> None:
        """Set the alarm clock for what is waited for, as the motion is planned now."""
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

    # --- real-time bytes ---

    def _report_status(self, now_s: float) -> None:
        if self._state == "Home":
            self._asked_in_homing = True
        elif not self._deaf:
            self._send(self._reports.line(self._snapshot(now_s)))

    def _snapshot(self, now_s: float) -> report.Snapshot:
        carriage = self.carriage_steps_at(now_s)
        return report.Snapshot(
            state=self._state_text(now_s),
            machine_mm=self._machine_mm(carriage),
            feed=60 * self._planner.track.speed_at(now_s),
            blocks_free=BLOCKS - self._planner.unfinished(now_s),
            bytes_free=report.RX_BYTES - len(self._rx),
            pins="".join(axis for axis, steps in zip("XYZ", carriage, strict=True) if steps >= 0),
        )

    def _state_text(self, now_s: float) -> str:
        stopping = now_s < self._planner.end_s
        if self._state == "Hold":
            return "Hold:1" if stopping else "Hold:0"
        if self._state == "Door":
            return "Door:2" if stopping else "Door:0"
        return self._state

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
        """A `~` that comes before the stop is complete is lost, as on the real board."""
        stopped = self._state in ("Hold", "Door") and now_s >= self._planner.end_s
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
        """Back to the start of the program; a line that was under way still gets its ok."""
        if self._owes_ok:
            self._reply(0)
        self._boot(now_s, locked=self._state in ("Alarm", "Sleep"))

    def _execute(self, line: str, now_s: float) -> int | None:
        """Returns the error number, 0 for ok, None if the answer comes later."""
        raise NotImplementedError


def _nearest(steps: float) -> int:
    return int(copysign(floor(abs(steps) + 0.5), steps))
