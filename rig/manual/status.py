"""Status of manual control: position, force, readings, byte log."""

import json
import math
import os
import threading
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from itertools import islice
from types import TracebackType
from typing import Any

from rig.clock import Clock
from rig.data.journal import ByteLog
from rig.devices.base import ForceReading, StageStatus
from rig.engine.bench_memory import state_folder
from rig.engine.contact import FRESH_S, KnownContact, contact_at
from rig.engine.limits import Trips
from rig.engine.sensing import APART_S, Sensing
from rig.manual.orders import HOME_FIRST
from rig.settings import RigSettings
from rig.units import GWT_N

COLUMNS = ("unix_s", "t_s", "force_gwt", "x_mm", "y_mm", "z_mm", "height_mm")
KEPT = 3600
"""Number of stored readings, a little more than a minute at 50 per second."""

AT_A_TIME = 400
"""Maximum number of rows in a reply, within the message size of the socket."""

Row = tuple[float | None, ...]


class Backlog:
    """Last KEPT readings, numbered from 0; written by one thread, read by others under a lock."""

    def __init__(self) -> None:
        self._rows: deque[Row] = deque(maxlen=KEPT)
        self._total = 0

    def add(self, row: Row) -> None:
        """Add a reading, as COLUMNS."""
        self._rows.append(row)
        self._total += 1

    def since(self, number: int) -> dict[str, Any]:
        """Return readings from this number on (0: all), at most AT_A_TIME, and the number of the next one."""
        first = self._total - len(self._rows)
        start = min(max(number, first), self._total)
        rows = list(islice(self._rows, start - first, start - first + AT_A_TIME))
        return {"columns": COLUMNS, "rows": rows, "next": start + len(rows)}


NO_FORCE = "nothing moves while the force sensor does not answer"
IN_STEPS = "not homed: heights are unknown, and a step down is made of single increments; home the stage"
ZERO_FIRST = (
    "not zeroed: forces count from the reading before the first motion; zero the sensor while nothing touches it"
)


class ManualStatus:
    """Status written by one thread and read by others; never waits for a device."""

    def __init__(self, settings: RigSettings, clock: Clock, sensing: Sensing) -> None:
        self._settings, self._clock, self._sensing = settings, clock, sensing
        self._lock, self._backlog = threading.Lock(), Backlog()
        self._at: StageStatus | None = None
        self._seen_unix_s: float | None = None
        self._force_gwt: float | None = None
        self._read_unix_s: float | None = None
        self._read_run_s: float | None = None
        self._problems: dict[str, str | None] = {"stage": None, "force": None}
        self._homed = self.zeroed = self.tripped = False
        self.did: str | None = None  # the last order
        self.ended_by: str | None = None
        self.contact: KnownContact | None = None  # as recorded
        self._recent: deque[tuple[float, float]] = deque()  # times (s) and forces (gwt) of the last APART_S
        self._looked_s = -math.inf  # when the stage reported

    # --- written by one thread ---

    def record_stage(self, at: StageStatus | None, *, homed: bool) -> None:
        """Record the stage's status, None if it does not report, and whether heights are known."""
        with self._lock:
            self._at, self._homed = at, homed
            self._seen_unix_s, self._looked_s = self._clock.unix_s(), self._clock.monotonic_s()
            self._problems["stage"] = None

    def record_stage_problem(self, problem: str, *, homed: bool) -> None:
        """Record a failure of the stage."""
        self._problems["stage"], self._homed = problem, homed

    def record_reading(self, at: StageStatus | None, reading: ForceReading) -> None:
        """Record a raw reading, and where the stage was by its last report."""
        if self._at is not None and at not in (None, self._at):
            self.record_stage(at, homed=self._homed)
        if not math.isfinite(reading.force_n):
            self.record_sensor_problem(f"the force reading is {reading.force_n}, not a number")
            return
        force_gwt = self._sensing.from_zero(reading).force_n / GWT_N
        unix_s = self._clock.unix_s() - (self._clock.monotonic_s() - reading.t_s)
        t_s = round(self._clock.run_s(reading.t_s), 3)
        with self._lock:
            self._force_gwt, self._read_unix_s, self._read_run_s = force_gwt, unix_s, t_s
            self._recall(reading.t_s, force_gwt)
            self._problems["force"] = None
            location = (*self._place, self._height_mm)
            self._backlog.add((round(unix_s, 3), t_s, round(force_gwt, 6), *location))

    def _recall(self, read_s: float, force_gwt: float) -> None:
        """Keep the readings back to one that is APART_S old; a gap, or another zero, begins anew."""
        if self._recent and not 0.0 <= read_s - self._recent[-1][0] <= FRESH_S:
            self._recent.clear()
        self._recent.append((read_s, force_gwt))
        while len(self._recent) > 1 and read_s - self._recent[1][0] >= APART_S:
            self._recent.popleft()

    def record_sensor_problem(self, problem: str) -> None:
        """Record a failure of the sensor."""
        with self._lock:
            self._problems["force"] = problem
            self._recent.clear()

    # --- read by others ---

    def as_json(self, *, stopped: bool, since: int | None) -> dict[str, Any]:
        """Return the status; with `since`, include the readings from that number on."""
        homed = self._homed and not stopped
        with self._lock:
            x_mm, y_mm, z_mm = self._place
            found: dict[str, Any] = {
                "state": "Home" if self._at is None else self._at.state,
                "x_mm": x_mm, "y_mm": y_mm, "z_mm": z_mm, "height_mm": self._height_mm if homed else None,
                "seen_unix_s": self._seen_unix_s, "stage_problem": self._problems["stage"],
                "force_gwt": self._force_gwt, "read_unix_s": self._read_unix_s, "read_t_s": self._read_run_s,
                "force_problem": self._problems["force"],
            }  # fmt: skip
            if since is not None:
                found["readings"] = self._backlog.since(since)
            known = self._contact(homed=homed)
        contact = None if known is None else known.as_json()
        last = {"did": self.did, "ended_by": self.ended_by}
        return {**found, **self._limits(), **last, "homed": homed, "zeroed": self.zeroed, "contact": contact,
                "next": self._next(stopped=stopped)}  # fmt: skip

    def _contact(self, *, homed: bool) -> KnownContact | None:
        """Return contact as the last readings and the last position show it, or as it was recorded."""
        now_s, at = self._clock.monotonic_s(), self._at
        fresh = at is not None and bool(self._recent) and now_s - min(self._looked_s, self._recent[-1][0]) <= FRESH_S
        if at is None or not (fresh and self._sensing.absolute):
            return self.contact and self.contact.after(math.inf, trusted=homed)
        touch_gwt, forces_gwt = self._sensing.touch_gwt, [force_gwt for _, force_gwt in self._recent]
        touches = abs(forces_gwt[-1]) >= touch_gwt
        apart = self._recent[-1][0] - self._recent[0][0] >= APART_S
        agree = self._sensing.agree(forces_gwt)
        return contact_at(
            self._settings, at, placed=homed, force_gwt=forces_gwt[-1] if touches or (apart and agree) else None,
            touch_gwt=touch_gwt, unix_s=self._clock.unix_s(),
        )  # fmt: skip

    @property
    def _place(self) -> tuple[float | None, float | None, float | None]:
        return (None, None, None) if self._at is None else (self._at.x_mm, self._at.y_mm, self._at.z_mm)

    @property
    def _height_mm(self) -> float | None:
        """Height above the nominal apex (mm), if known."""
        known = self._homed and self._at is not None
        return round(self._at.z_mm - self._settings.frame.apex_z_mm, 6) if self._at and known else None

    def _limits(self) -> Mapping[str, float]:
        return {
            "trip_gwt": Trips(self._settings.limits, None).lowest_gwt,
            "touch_gwt": self._sensing.touch_gwt,
            "clearance_mm": self._settings.habits.clearance_mm,
        }

    def _next(self, *, stopped: bool) -> str | None:
        """Return the next action for the operator, or None."""
        if stopped:
            return HOME_FIRST
        if self._problems["force"] is not None:
            return NO_FORCE
        if self.tripped:
            return HOME_FIRST
        if not self._homed:
            return IN_STEPS
        return None if self.zeroed else ZERO_FIRST


FILE_BYTES = 8 << 20
KEPT_FILES = 16
"""Number of files of all benches together, some hours of readings."""


class ManualLog:
    """Log of lines from any thread; each file begins with the wall time (unix_s) at its first t_s.

    `t_s` counts from the start of manual control.
    """

    def __init__(self, clock: Clock) -> None:
        """Create the first file. Raises OSError."""
        self._clock, self._lock = clock, threading.Lock()
        self._folder = state_folder() / "by_hand"
        self._folder.mkdir(parents=True, exist_ok=True)
        self._begin()

    @property
    def problem(self) -> OSError | None:
        """Error that ended the log, or None."""
        return self._file.problem

    def write(self, text: str, /) -> None:
        """Write a line; start a new file when one is full."""
        with self._lock:
            self._file.write(text)
            self._bytes += len(text)
            if self._bytes >= FILE_BYTES:
                full = self._file
                with suppress(OSError):  # If no new file can be created, the full one continues.
                    self._begin()
                    full.__exit__(None, None, None)

    def _begin(self) -> None:
        now_s = self._clock.unix_s()
        stamp = datetime.fromtimestamp(now_s, UTC).strftime("%Y%m%d-%H%M%S.%f")
        path = self._folder / f"{stamp}-{os.getpid()}.jsonl"
        self._file, self.path, self._bytes = ByteLog(path), path, 0
        self._file.write(json.dumps({"t_s": round(self._clock.run_s(), 6), "unix_s": now_s}) + "\n")
        for old in sorted(self._folder.glob("*.jsonl"))[:-KEPT_FILES]:
            old.unlink(missing_ok=True)

    def __enter__(self) -> "ManualLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.__exit__(kind, error, trace)
