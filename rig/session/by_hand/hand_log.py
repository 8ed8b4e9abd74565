"""Every byte of what is done by hand, in files of the user's state folder; the oldest make room."""

import json
import os
import threading
from contextlib import suppress
from datetime import UTC, datetime
from types import TracebackType

from rig.engine.by_hand.bench_memory import state_folder
from rig.transport.byte_log import ByteLog
from rig.transport.clock import Clock

FILE_BYTES = 8 << 20
KEPT = 16
"""Files, of all benches together: some hours of readings."""


class HandLog:
    """A sink of whole lines, of any thread; each file begins with the wall time, unix_s, at a t_s of its lines."""

    def __init__(self, clock: Clock) -> None:
        """Raises OSError."""
        self._clock, self._lock = clock, threading.Lock()
        self._folder = state_folder() / "by_hand"
        self._folder.mkdir(parents=True, exist_ok=True)
        self._begin()

    @property
    def problem(self) -> OSError | None:
        """Why nothing is written any more, if so."""
        return self._file.problem

    def write(self, text: str, /) -> None:
        """A line; a file that is full is followed by another one."""
        with self._lock:
            self._file.write(text)
            self._bytes += len(text)
            if self._bytes >= FILE_BYTES:
                full = self._file
                with suppress(OSError):  # the full one goes on rather than none
                    self._begin()
                    full.__exit__(None, None, None)

    def _begin(self) -> None:
        now_s = self._clock.unix_s()
        stamp = datetime.fromtimestamp(now_s, UTC).strftime("%Y%m%d-%H%M%S.%f")
        path = self._folder / f"{stamp}-{os.getpid()}.jsonl"
        self._file, self.path, self._bytes = ByteLog(path), path, 0
        self._file.write(json.dumps({"t_s": round(self._clock.monotonic_s(), 6), "unix_s": now_s}) + "\n")
        for old in sorted(self._folder.glob("*.jsonl"))[:-KEPT]:
            old.unlink(missing_ok=True)

    def __enter__(self) -> "HandLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.__exit__(kind, error, trace)
