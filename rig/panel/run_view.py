"""State of a run for a page, read from its growing journal; nothing is written."""

import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rig.data.deviation import warning_of
from rig.data.documents import Document
from rig.data.events import READING
from rig.data.folder import RunFolder
from rig.data.run import Following, RunError
from rig.data.run_state import BEGUN, RunFollower, RunState
from rig.data.run_status import RunStatus
from rig.data.tables import FOREIGN, foreign
from rig.engine.limits import Trips
from rig.errors import BadInputError
from rig.panel.notice import Notice, notice, stopped_now
from rig.panel.section import Job, PressSummary
from rig.panel.stream import SHOWN_S, ReadingSource, Row
from rig.plan.config import Config, load_config
from rig.session.early_ending import Ending


def age_s(then_s: float | None, now_s: float) -> float | None:
    """Return the age (s), at least 0, or None."""
    return None if then_s is None else max(now_s - then_s, 0.0)


GROWS_S = 5.0
"""Age of the last entry (s) up to which a journal counts as growing."""
ORPHANED_S = 0.5
"""Time (s) after which the lock of a run is checked whose process no longer announces it."""
_NEWEST = 50  # Number of folders, whose names begin with the time.


def growing(out: Path, unix_s: float) -> Path | None:
    """Return the run folder below `out` that is being written to, or None."""
    then_s, path = max(_written(out), key=lambda one: one[0], default=(0.0, None))
    return path if unix_s - then_s < GROWS_S else None


def last_real_run(out: Path, on_rig: Callable[[Config], bool]) -> "RunView | None":
    """Return the real run below `out` that was written to last, on a rig that its configuration names; or None."""
    for _, path in sorted(_written(out), reverse=True):
        try:
            (start,) = Following(RunFolder(path)).next(AT_ONCE)[:1] or ({},)
            if start.get("doc") == "start" and not start.get("virtual") and on_rig(load_config(path / "config.toml")):
                return RunView(path)
        except (RunError, BadInputError, *FOREIGN):
            continue  # It is no run of this program.
    return None


def _written(out: Path) -> list[tuple[float, Path]]:
    """Return when the journals of the newest folders were last written to."""
    try:
        names = sorted((path.name for path in out.iterdir() if not path.name.startswith(".")), reverse=True)
    except OSError:
        return []
    found = [(written_s(out / name), out / name) for name in names[:_NEWEST]]
    return [(then_s, path) for then_s, path in found if then_s > 0]


def written_s(run: Path) -> float:
    """Return when a run's journal was last written to, or 0."""
    try:
        about = RunFolder(run).events.stat()
    except OSError:
        return 0.0
    return about.st_mtime if stat.S_ISREG(about.st_mode) else 0.0


def limits_state(config: Config, soft_trip_n: float | None) -> dict[str, float]:
    """Return the trip and the deepest press."""
    return {"trip_gwt": Trips(config.limits, soft_trip_n).soft_gwt, "max_doi_mm": config.limits.max_doi_mm}


COLUMNS = (
    *("unix_s", "t_s", "force_gwt", "doi_mm", "x_mm", "height_mm"),
    *("phase", "index", "purpose"),
)
AT_ONCE = 1 << 20
"""Bytes per read of a journal; of its readings the last minute is kept in memory."""


MOVED_MM = 0.01
"""Change of height (mm) after which the depth of the last reading no longer holds."""
WAIT = "wait for the run's last word on the indentor; in danger use the emergency stop"


class RunView(RunFollower):
    """Run as described by its journal so far; `look` reads new entries."""

    def __init__(self, path: Path) -> None:
        super().__init__(RunFolder(path))
        self.source = ReadingSource(path.name, COLUMNS)
        self.problem = ""
        self.alive = self._announced = self._orphaned = False
        self.job: Job | None = None
        self._journal = Following(self.folder)
        self._config: Config | None = None
        self._checked_s = self._written_s = 0.0
        self.ended_s = 0.0  # time of the last entry by its own clock, which a server's need not follow
        self._trip = ""  # its reason
        self._placed_s: float | None = None  # when the position was last recorded

    def look(self, unix_s: float, *, announced: bool = False) -> list[Row]:
        """Read new entries and return their readings. An unreadable journal sets `problem` and is not read again.

        announced: a process announces that it owns the run; once it no longer does, a growing journal proves nothing.
        """
        rows = [] if self.problem else self._new()
        self._orphaned = not announced and (self._orphaned or self._announced)
        self._announced = announced
        self.alive = not self.ended and self._is_alive(unix_s)
        return rows

    @property
    def _damage(self) -> str:
        """Damaged line of the journal in words, which is left out; empty without one."""
        damage = self._journal.damage
        return "" if damage is None else f"{self.folder.events}, line {damage.line}: {damage.problem}"

    def _is_alive(self, unix_s: float) -> bool:
        """Return whether a process writes the journal; the lock of a silent journal is checked from time to time."""
        if unix_s - written_s(self.folder.path) < GROWS_S and not self._orphaned:
            self._checked_s = unix_s
            return True
        if self.alive and unix_s - self._checked_s >= (ORPHANED_S if self._orphaned else GROWS_S):
            self._checked_s = unix_s
            return self.folder.busy
        return self.alive

    def _new(self) -> list[Row]:
        rows: list[Row] = []
        try:
            self._read_config()
            while documents := self._journal.next(AT_ONCE):
                rows = _latest(rows) + self._taken(documents)
            self.take(())  # The course may have been written since.
            if not self.start and self._journal.damage is not None:
                raise RunError(self._damage, "no_start")
        except (RunError, BadInputError) as error:
            self.problem = str(error)
        except FOREIGN as error:
            self.problem = foreign(error)
        return rows

    def _taken(self, documents: list[Document]) -> list[Row]:
        self._written_s = written_s(self.folder.path)
        self.take(documents)
        self.job = self._drawn()
        return [_row(one) for one in documents if one["doc"] == "event" and one["stream"].endswith(READING)]

    def apply(self, document: Document) -> None:
        """Apply the next document; a virtual run has its own calendar, so its events count when they were written."""
        at_s = self._written_s
        self.ended_s = document.get("unix_s", at_s)
        document["unix_s"] = at_s if self.virtual else min(document.get("unix_s", at_s), at_s)
        if document["doc"] == "resume":
            self._trip = ""
        super().apply(document)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Apply the next event, and note a trip and the time of the position."""
        super().event(stream, data)
        if stream == "trip":
            self._trip = str(data.get("reason", ""))
        if "height_mm" in data or "x_mm" in data:
            self._placed_s = self.unix_s

    def _read_config(self) -> None:
        if self._config is None and self.folder.config.is_file():
            self._config = load_config(self.folder.config)

    def _drawn(self) -> Job | None:
        """Return the job of the drawing."""
        placed = self.placed
        if placed is None:
            return None
        indentor = None if placed.indentor is None else str(placed.indentor)
        return Job(self.folder.config, self.folder.path, indentor, float(placed.along_mm), _press(placed.press))

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.path.name

    @property
    def virtual(self) -> bool:
        """Whether the run uses the virtual bench."""
        return bool(self.start.get("virtual"))

    @property
    def ended(self) -> bool:
        """Whether the journal has an end."""
        return self.stop is not None

    @property
    def config(self) -> Config | None:
        """The run's own copy of its configuration."""
        return self._config

    @property
    def moved(self) -> bool:
        """Whether the run moved anything, by its ending."""
        return self.stop is None or self.stop.get("indentor", {}).get("left") != "not moved"

    @property
    def state(self) -> RunState:
        """The run's state is this view."""
        return self

    def attention(self, *, going: bool, stopped: bool) -> Notice | None:
        """Return `attention` of the state, in the words of the terminal. stopped: a stop reached its process."""
        status = self._status(going=going)
        if self.stop is None and going:
            if self._trip:
                return notice("tripped", self._trip, "the run acts on the trip; look at the finger", WAIT)
            return stopped_now() if stopped else None
        if status == RunStatus.DONE or not self.start:
            return None
        found = Ending.killed(self) if self.stop is None else Ending.recorded(self, status)
        may_touch = found.at.left != "not moved" and found.at.may_touch is not False
        return notice(status, found.reason, found.at.words, found.next, found.resume, may_touch=may_touch)

    def as_json(self, *, going: bool) -> dict[str, Any]:
        """Return `run` of the state. going: a process writes the journal."""
        start = self.start
        return {
            "folder": str(self.folder.path),
            "name": self.name,
            "protocol": start.get("protocol"),
            "title": start.get("title"),
            "subject": start.get("subject"),
            "virtual": self.virtual,
            "state": str(self._status(going=going)),
            "now": self.now if going else None,
            "next": self.next if going else None,
            "left_s": self.left_s if going else None,
            "done": len(self.finished),
            "planned": self.planned,
            "deviation": warning_of(list(self.deviations.values())),
            "problem": self.problem or self._damage or None,
        }

    def _status(self, *, going: bool) -> RunStatus:
        if self.stop is None:
            return RunStatus.RUNNING if going else RunStatus.KILLED
        return RunStatus.of_journal(self.stop, (self.planned or 0) - len(self.finished))

    def newest_state(self, unix_s: float) -> dict[str, Any]:
        """Return `newest` of the state: the last reading, and the last recorded position, with their ages."""
        found, (t_s, read_s) = self.newest, self.newest_s
        end = {} if self.stop is None else self.stop.get("indentor", {})
        values = {name: found.get(name) for name in ("force_gwt", "doi_mm")}
        values["phase"] = found.get("phase") if self.stop is None else None
        values |= {name: end.get(name, getattr(self, name)) for name in ("x_mm", "height_mm")}
        if abs((values["height_mm"] or 0.0) - (found.get("height_mm") or 0.0)) > MOVED_MM:  # since the reading
            values["doi_mm"] = None
        along_mm = 0.0 if self.placed is None else float(self.placed.along_mm)
        ages = {"age_s": age_s(read_s, unix_s), "placed_age_s": age_s(self._placed_s, unix_s)}
        return {**values, "y_mm": along_mm, "t_s": t_s, **ages}

    def devices_state(self, unix_s: float) -> dict[str, Any]:
        """Return `devices` of the state, with the age of each word; None if there is no word."""
        (stage, stage_s), (force, force_s) = self.stage_status, self.force_status
        return {
            "stage": {"word": stage, "homed": self.homed, "age_s": age_s(stage_s, unix_s)},
            "force": {"word": force, "age_s": age_s(force_s, unix_s)},
        }

    def limits_state(self) -> dict[str, Any] | None:
        """Return `limits` of the state, from the run's own copy of its configuration."""
        if self._config is None:
            return None
        return limits_state(self._config, self.start.get("soft_trip_n"))

    def schedule_state(self) -> list[dict[str, Any]]:
        """Return the steps of the run."""
        return [_step(*step) for step in self.steps]


def _latest(rows: list[Row]) -> list[Row]:
    """Return the rows of the last SHOWN_S."""
    at = COLUMNS.index("t_s")
    return [row for row in rows if row[at] >= rows[-1][at] - SHOWN_S]


def _row(reading: Document) -> Row:
    values = {**reading["data"], **reading, "purpose": _purpose(reading["stream"], READING)}
    return [values.get(name) for name in COLUMNS]


def _press(begun: tuple[str, Mapping[str, Any]] | None) -> PressSummary | None:
    if begun is None:
        return None
    stream, data = begun
    x_mm, target = float(data["x_mm"]), str(data["target"])
    return PressSummary(int(data["index"]), _purpose(stream, BEGUN), x_mm, target, float(data["value"]))


def _purpose(stream: str, end: str) -> str:
    return stream.removesuffix(end).rstrip("_") or "data"


def _step(name: tuple[str, int, int], words: str, marks: Mapping[str, Any], when: str) -> dict[str, Any]:
    stream, number, _ = name
    press = stream.endswith(BEGUN)
    return {
        "index": number if press else None,
        "purpose": _purpose(stream, BEGUN) if press else None,
        "words": words,
        **{key: marks.get(key) for key in ("block", "repeat", "condition")},
        "done": when == "done",
        "now": when == "now",
    }
