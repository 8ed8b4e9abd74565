"""Real-time commands of the virtual GRBL board, including overrides, and its alarms.

Source: GRBL 1.1 interface wiki and the behavior of the 1.1h firmware.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from sim.devices.clock import Scheduler
from sim.devices.grbl import core
from sim.devices.grbl.core import OVERRIDE_BYTES, GrblCore, Mechanics, Wait
from sim.devices.grbl.planner import BLOCKS, Vec
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
