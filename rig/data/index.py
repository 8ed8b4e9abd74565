"""List and select the runs of a folder; an index spares reading every journal again.

The index is one SQLite file beside the runs. It is believed of a run whose journal is the very file that was read;
all else is read anew and written into it. Lost, corrupt, of another version, locked or not writable, it costs time.
"""

import json
import os
import sqlite3
import stat
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, fields
from datetime import date
from pathlib import Path

from rig.data.folder import RunFolder
from rig.data.tables import HOLD_COLUMNS, Row, Summary, alive, summarised

INDEX = ".runs.sqlite"
_EDITION = 1  # another one where the same columns mean something else
_MARK = zlib.crc32(repr((_EDITION, [field.name for field in fields(Summary)], HOLD_COLUMNS)).encode()) & 0x7FFFFFFF
_BUSY_S = 2.0
_PASSING = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)

Read = Callable[[Path], tuple[Summary, list[Row]]]


@dataclass(frozen=True)
class IndexEntry:
    """What is known of one run folder, and of which journal: `mark` changes when that changes."""

    mark: str
    summary: Summary
    holds: str  # JSON: rows in the order of HOLD_COLUMNS

    @property
    def rows(self) -> list[Row]:
        """The run's holds, in the order of RUN_COLUMNS and HOLD_COLUMNS."""
        return [[*self.summary.of_the_run, *hold] for hold in json.loads(self.holds)]


def listed(runs: Path, read: Read = summarised) -> list[IndexEntry]:
    """Every run folder in a folder, the oldest first, what cannot be read last. Raises OSError."""
    there = dict(_folders(runs))
    known = _kept(runs / INDEX)
    kept = known or {}
    found = {
        name: kept[name] if name in kept and kept[name].mark == mark else _entry(runs / name, mark, read)
        for name, mark in there.items()
    }
    fresh = {name: entry for name, entry in found.items() if entry is not kept.get(name)}
    gone = set(kept) - set(found)
    if (fresh or gone) and any(not entry.summary.problem for entry in found.values()):  # elsewhere it has no business
        _keep(runs / INDEX, fresh, gone, anew=known is None)
    living = [IndexEntry(entry.mark, alive(entry.summary, runs), entry.holds) for entry in found.values()]
    return sorted(living, key=lambda entry: (bool(entry.summary.problem), entry.summary.date_utc, entry.summary.name))


def _folders(runs: Path) -> Iterator[tuple[str, str]]:
    """Names of the folders, hidden ones aside that are no run being made, and the marks of their journals."""
    with os.scandir(runs) as found:
        for one in found:
            if one.is_dir() and (not one.name.startswith(".") or one.name.endswith(".part")):
                yield one.name, _mark(RunFolder(Path(one.path)).events)


def _mark(journal: Path) -> str:
    """What changes with a file's content, or its place; empty where there is no file."""
    try:
        found = journal.stat()
    except OSError:
        return ""
    if not stat.S_ISREG(found.st_mode):
        return "no file"
    return f"{found.st_size} {found.st_mtime_ns} {found.st_ctime_ns} {found.st_ino}"


def _entry(path: Path, mark: str, read: Read) -> IndexEntry:
    if path.name.startswith("."):
        return IndexEntry(
            mark, Summary(path.name, problem="incomplete folder: its program is still running or was killed"), "[]"
        )
    if mark == "no file":
        return IndexEntry(mark, Summary(path.name, problem=f"{RunFolder(path).events.name}: not a file"), "[]")
    summary, rows = read(path)
    return IndexEntry(mark, summary, json.dumps(rows))


def _kept(path: Path) -> dict[str, IndexEntry] | None:
    """What the index says; None where it cannot be read."""
    if not path.is_file():
        return None
    try:
        with _opened(path) as index:
            if index.execute("PRAGMA user_version").fetchone() != (_MARK,):
                return None
            rows = index.execute("SELECT name, mark, summary, holds, sum FROM runs").fetchall()
        if any(_sum(row[:4]) != row[4] for row in rows):
            return None
        return {
            name: IndexEntry(mark, _summary(json.loads(summary)), holds) for name, mark, summary, holds, _ in rows
        }
    except sqlite3.Error:
        return None


def _sum(row: Sequence[object]) -> int:
    """SQLite does not see that a byte has changed."""
    return zlib.crc32(repr(tuple(row)).encode())


def _summary(told: dict[str, object]) -> Summary:
    return Summary(**{**told, "shapes": tuple(told["shapes"])})  # type: ignore[arg-type]


def _keep(path: Path, fresh: Mapping[str, IndexEntry], gone: set[str], *, anew: bool) -> None:
    """Write into the index what is new; one that is no index is made anew, one that cannot be written is left."""
    for _ in range(2):
        try:
            _write(path, fresh, gone, anew=anew)
            return
        except sqlite3.Error as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF in _PASSING:
                return
            _remove(path)


def _write(path: Path, fresh: Mapping[str, IndexEntry], gone: set[str], *, anew: bool) -> None:
    told = [(name, one.mark, json.dumps(asdict(one.summary)), one.holds) for name, one in fresh.items()]
    with _opened(path) as index:
        index.execute("BEGIN IMMEDIATE")
        if anew:
            index.execute("DROP TABLE IF EXISTS runs")
            index.execute(
                "CREATE TABLE runs (name TEXT PRIMARY KEY, mark TEXT, summary TEXT, holds TEXT, sum INTEGER)"
            )
            index.execute(f"PRAGMA user_version = {_MARK}")
        index.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?)", [(*row, _sum(row)) for row in told])
        index.executemany("DELETE FROM runs WHERE name = ?", [(name,) for name in gone])
        index.execute("COMMIT")


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    with closing(sqlite3.connect(path, timeout=_BUSY_S)) as index:
        yield index


def _remove(path: Path) -> None:
    for one in (path, path.with_name(f"{path.name}-journal")):
        try:
            one.unlink(missing_ok=True)
        except OSError:
            return


@dataclass(frozen=True)
class RunFilter:
    """Which runs are asked for; None is all of them."""

    subject: str | None = None
    shape: str | None = None
    protocol: str | None = None
    state: str | None = None
    since: date | None = None
    until: date | None = None

    def has(self, run: Summary) -> bool:
        """Whether it is one of them; a shape is meant with and without what stands behind its colon."""
        named = ((self.subject, run.subject), (self.protocol, run.protocol), (self.state, run.state))
        if any(wanted not in (None, found) for wanted, found in named):
            return False
        if self.shape is not None and not any(self.shape in (one, one.partition(":")[0]) for one in run.shapes):
            return False
        day = date.fromisoformat(run.date_utc[:10])
        return (self.since is None or day >= self.since) and (self.until is None or day <= self.until)
