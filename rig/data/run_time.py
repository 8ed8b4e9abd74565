"""Time of a run (`t_s`), also in journals and byte logs of earlier versions.

`t_s` is 0 when the byte log of a run begins, and counts by the computer's monotonic clock. A resumed part begins at
the wall-clock time since then, but never before the last recorded `t_s`. In earlier versions `t_s` of a real run
counted from the boot of the computer, and after a reboot from the end of the earlier part.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rig.data.documents import Document, is_document
from rig.data.events import INSTANTS


def resumed_s(last_s: float, since_start_s: float) -> float:
    """Return the time (s) at which a part begins, from the last recorded one and the wall-clock time since the start.

    A wall clock that was set back does not turn back the time of the run.
    """
    return max(last_s, since_start_s)


@dataclass
class _Part:
    """Part of a run: its first and last `t_s` as recorded, and the offset to subtract (s)."""

    begin_s: float
    end_s: float
    ahead_s: float

    def on(self, t_s: float) -> float:
        return round(t_s - self.ahead_s, 6)


class RunTime:
    """Correction of `t_s` in the documents of one journal, received in their order, and then in its byte log."""

    def __init__(self) -> None:
        self._start: Document = {}
        self._parts: list[_Part] = []
        self._reached = 0  # part that the byte log has reached
        self._byte_s = 0.0  # last time in the byte log, as recorded

    def document(self, found: Document) -> Document:
        """Return the next document with the time of the run."""
        doc = found.get("doc")
        if doc is None:  # in a damaged journal
            return found
        if doc == "start":
            self._start, t_s = found, found["t_s"]
            self._parts = [_Part(t_s, t_s, t_s)] if _is_late(t_s) else []
        if not self._parts:
            return found
        if doc == "resume":
            self._parts.append(self._resumed(found))
        part = self._parts[-1]
        part.end_s = found["t_s"]
        return _on(found, part)

    def chunk(self, found: dict[str, Any]) -> dict[str, Any]:
        """Return the next line of the byte log with the time of the run."""
        if not self._parts:
            return found
        t_s = found["t_s"]
        while self._reached + 1 < len(self._parts) and self._next_began(t_s):
            self._reached += 1
            self._byte_s = t_s
        self._byte_s = max(self._byte_s, t_s)
        return {**found, "t_s": self._parts[self._reached].on(t_s)}

    def _resumed(self, found: Document) -> _Part:
        last, t_s = self._parts[-1], found["t_s"]
        since_s = t_s - last.ahead_s
        if not self._start.get("virtual") and "unix_s" in self._start and "unix_s" in found:
            since_s = found["unix_s"] - self._start["unix_s"]
        return _Part(t_s, t_s, t_s - resumed_s(last.on(last.end_s), since_s))

    def _next_began(self, t_s: float) -> bool:
        """Return whether bytes at this time belong to the next part; they may precede its first document."""
        now, following = self._parts[self._reached : self._reached + 2]
        if following.begin_s < now.end_s and t_s < self._byte_s:  # after a reboot
            return True
        return not now.begin_s <= t_s <= now.end_s and abs(t_s - following.begin_s) <= abs(t_s - now.end_s)


def _is_late(t_s: object) -> bool:
    """Return whether a run does not begin at 0; another program may write anything."""
    return isinstance(t_s, int | float) and t_s != 0


def is_timed(found: object) -> bool:
    """Return whether a line of a journal, or of a byte log, has a time that can be corrected."""
    timed = isinstance(found, Mapping) and isinstance(found.get("t_s"), int | float)
    return timed and ("doc" not in found or is_document(found))  # type: ignore[operator]


def _on(found: Document, part: _Part) -> Document:
    document = {**found, "t_s": part.on(found["t_s"])}
    data = found.get("data")
    if data is not None and any(name in data for name in INSTANTS):
        document["data"] = {**data, **{name: part.on(data[name]) for name in INSTANTS if name in data}}
    return document
