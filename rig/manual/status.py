"""What the process at the bench tells of it: where the stage is, what is felt, how the last thing ended."""

import math
import threading
from collections.abc import Mapping
from typing import Any

from rig.devices.force.base import ForceReading
from rig.devices.stage.base import StageStatus
from rig.devices.units import GWT_N
from rig.engine.by_hand.held import FASTEST_MM_S
from rig.engine.contact import Contact
from rig.engine.limits import Trips
from rig.engine.rig_settings import RigSettings
from rig.engine.sensing import Sensing
from rig.session.by_hand.hand_readings import Backlog
from rig.session.by_hand.orders import HOME_FIRST
from rig.transport.clock import Clock

NOT_FELT = "nothing moves while the force sensor does not answer"
IN_STEPS = "home: where it is not homed heights are not known, and down it goes in steps of one increment"
ZERO_FIRST = "zero, with nothing touched: until then forces count from what is felt before the first motion"


class HandStatus:
    """Told by one thread, read by others; nothing here waits for a device."""

    def __init__(self, settings: RigSettings, clock: Clock, sensing: Sensing) -> None:
        self._settings, self._clock, self._sensing = settings, clock, sensing
        self._lock, self._backlog = threading.Lock(), Backlog()
        self._at: StageStatus | None = None
        self._seen_unix_s: float | None = None
        self._force_gwt: float | None = None
        self._read_unix_s: float | None = None
        self._problems: dict[str, str | None] = {"stage": None, "force": None}
        self.placed = self.zeroed = False
        self.ended_by: str | None = None
        self.contact: Contact | None = None  # as it is on record

    # what is told

    def seen(self, at: StageStatus | None) -> None:
        """Where the stage is now, None: it does not say."""
        with self._lock:
            self._at, self._seen_unix_s = at, self._clock.unix_s()
            self._problems["stage"] = None

    def unseen(self, problem: str) -> None:
        """The stage did not answer."""
        self._problems["stage"] = problem

    def read(self, reading: ForceReading) -> None:
        """A reading, as the sensor has it."""
        if not math.isfinite(reading.force_n):
            self.unread(f"the force reading is {reading.force_n}, not a number")
            return
        zero = self._sensing.zero
        force_gwt = (reading if zero is None else zero.taken_off(reading)).force_n / GWT_N
        unix_s = self._clock.unix_s() - (self._clock.monotonic_s() - reading.t_s)
        with self._lock:
            self._force_gwt, self._read_unix_s, self._problems["force"] = force_gwt, unix_s, None
            place = (*self._place, self._height_mm)
            self._backlog.add((round(unix_s, 3), round(reading.t_s, 3), round(force_gwt, 6), *place))

    def unread(self, problem: str) -> None:
        """There was no reading."""
        self._problems["force"] = problem

    # what is asked

    def as_json(self, *, stopped: bool, since: int | None) -> dict[str, Any]:
        """As of now; since: with the readings from that number on."""
        homed = self.placed and not stopped
        with self._lock:
            x_mm, y_mm, z_mm = self._place
            found: dict[str, Any] = {
                "state": "Home" if self._at is None else self._at.state,
                "x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm, "height_mm": self._height_mm if homed else None,
                "seen_unix_s": self._seen_unix_s, "stage_problem": self._problems["stage"],
                "force_gwt": self._force_gwt, "read_unix_s": self._read_unix_s,
                "force_problem": self._problems["force"],
            }  # fmt: skip
            if since is not None:
                found["readings"] = self._backlog.since(since)
        contact = None if self.contact is None else self.contact.as_json()
        return {**found, **self._limits(), "homed": homed, "zeroed": self.zeroed, "ended_by": self.ended_by,
                "contact": contact, "next": self._next(stopped=stopped)}  # fmt: skip

    @property
    def _place(self) -> tuple[float | None, float | None, float | None]:
        return (None, None, None) if self._at is None else (self._at.x_mm, self._at.y_mm, self._at.z_mm)

    @property
    def _height_mm(self) -> float | None:
        """Above the nominal apex, where that is known."""
        known = self.placed and self._at is not None
        return round(self._at.z_mm - self._settings.frame.apex_z_mm, 6) if self._at and known else None

    def _limits(self) -> Mapping[str, float]:
        return {
            "trip_gwt": Trips(self._settings.limits, None).lowest_gwt,
            "touch_gwt": self._sensing.touch_gwt,
            "clearance_mm": self._settings.habits.clearance_mm,
            "fastest_mm_s": FASTEST_MM_S,
        }

    def _next(self, *, stopped: bool) -> str | None:
        """What whoever stands there must do before the next thing, or had better."""
        if stopped:
            return HOME_FIRST
        if self._problems["force"] is not None:
            return NOT_FELT
        if not self.placed:
            return IN_STEPS
        return None if self.zeroed else ZERO_FIRST
