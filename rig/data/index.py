"""List and selection of the runs in a folder, with an index that avoids reading every journal again.

The index is a SQLite file beside the runs. An entry is valid while the journal is unchanged; other runs are read
again and indexed. An index that is lost, corrupt, of another version, locked or read-only only costs time.
"""

import json
import os
import re
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
_EDITION = 4  # Increase it when the same columns change their meaning.
_MARK = zlib.crc32(repr((_EDITION, [field.name for field in fields(Summary)], HOLD_COLUMNS)).encode()) & 0x7FFFFFFF
_BUSY_S = 2.0
_PASSING = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_CANTOPEN)

Read = Callable[[Path], tuple[Summary, list[Row]]]


@dataclass(frozen=True)
class IndexEntry:
    """Entry of one run folder; `mark` changes with its journal."""

    mark: str
    summary: Summary
    holds: str  # JSON rows in the order of HOLD_COLUMNS

    @property
    def rows(self) -> list[Row]:
        """Holds of the run, in the order of RUN_COLUMNS and HOLD_COLUMNS."""
        return [[*self.summary.of_the_run, *hold] for hold in json.loads(self.holds)]


def listed(runs: Path, read: Read = summarised) -> list[IndexEntry]:
    """Return every run folder in a folder, the oldest first, unreadable ones last. Raises OSError."""
    folders = dict(_folders(runs))
    known = _stored(runs / INDEX)
    stored = known or {}
    found = {
        name: stored[name] if name in stored and stored[name].mark == mark else _entry(runs / name, mark, read)
        for name, mark in folders.items()
    }
    fresh = {name: entry for name, entry in found.items() if entry is not stored.get(name)}
    gone = set(stored) - set(found)
    # A folder without a run gets no index.
    if (fresh or gone) and any(not entry.summary.problem for entry in found.values()):
        _store(runs / INDEX, fresh, gone, anew=known is None)
    living = [IndexEntry(entry.mark, alive(entry.summary, runs), entry.holds) for entry in found.values()]
    living = [_as_copy(entry, original) for entry, original in _with_originals(living)]
    return sorted(living, key=lambda entry: (bool(entry.summary.problem), entry.summary.date_utc, entry.summary.name))


def _with_originals(entries: Sequence[IndexEntry]) -> Iterator[tuple[IndexEntry, str]]:
    """Yield each entry with the folder that holds its run: another one if the entry is a copy, such as a cloud
    service makes when two computers change a folder.
    """
    same: dict[str, list[Summary]] = {}
    for entry in entries:
        if entry.summary.uid and not entry.summary.problem:
            same.setdefault(entry.summary.uid, []).append(entry.summary)
    original = {uid: min(some, key=_least_a_copy).name for uid, some in same.items()}
    for entry in entries:
        of_run = not entry.summary.problem and entry.summary.uid in original
        yield entry, original[entry.summary.uid] if of_run else entry.summary.name


def _least_a_copy(summary: Summary) -> tuple[int, bool, str]:
    """Order folders of one run: most presses first, then a name that the program gave."""
    return -summary.done, _OWN_NAME.fullmatch(summary.name) is None, summary.name


_OWN_NAME = re.compile(r"\d{8}T\d{6}-.*-[0-9a-f]{6}")


def _as_copy(entry: IndexEntry, original: str) -> IndexEntry:
    """Return an entry, which counts no run if the folder of its run is another one."""
    name = entry.summary.name
    if name == original:
        return entry
    problem = f"a copy of {original}: the same run (uid {entry.summary.uid}), which is counted once"
    return IndexEntry(entry.mark, Summary(name, problem=problem), "[]")


def _folders(runs: Path) -> Iterator[tuple[str, str]]:
    """Yield the names of the folders and the marks of their journals; of hidden folders only unfinished ones."""
    with os.scandir(runs) as found:
        for one in found:
            if one.is_dir() and (not one.name.startswith(".") or one.name.endswith(".part")):
                yield one.name, _mark(RunFolder(Path(one.path)).events)


def _mark(journal: Path) -> str:
    """Return a mark that changes with the content or the location of a file; empty without a file."""
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


_CORRUPT = (sqlite3.Error, UnicodeDecodeError)
"""Errors of a damaged index; SQLite does not check the texts in it."""


def _stored(path: Path) -> dict[str, IndexEntry] | None:
    """Return the entries of the index, or None if it cannot be read."""
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
    except _CORRUPT:
        return None


def _sum(row: Sequence[object]) -> int:
    """Return a checksum, because SQLite does not notice a changed byte."""
    return zlib.crc32(repr(tuple(row)).encode())


def _summary(rows: dict[str, object]) -> Summary:
    return Summary(**{**rows, "shapes": tuple(rows["shapes"])})  # type: ignore[arg-type]


def _store(path: Path, fresh: Mapping[str, IndexEntry], gone: set[str], *, anew: bool) -> None:
    """Update the index; replace a corrupt one, and give up if it cannot be written."""
    for _ in range(2):
        try:
            _write(path, fresh, gone, anew=anew)
            return
        except _CORRUPT as error:
            if getattr(error, "sqlite_errorcode", 0) & 0xFF in _PASSING:
                return
            _remove(path)


def _write(path: Path, fresh: Mapping[str, IndexEntry], gone: set[str], *, anew: bool) -> None:
    rows = [(name, one.mark, json.dumps(asdict(one.summary)), one.holds) for name, one in fresh.items()]
    with _opened(path) as index:
        index.execute("BEGIN IMMEDIATE")
        if anew:
            index.execute("DROP TABLE IF EXISTS runs")
            index.execute(
                "CREATE TABLE runs (name TEXT PRIMARY KEY, mark TEXT, summary TEXT, holds TEXT, sum INTEGER)"
            )
            index.execute(f"PRAGMA user_version = {_MARK}")
        index.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?)", [(*row, _sum(row)) for row in rows])
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
    """Filter of runs; None matches all."""

    subject: str | None = None
    shape: Callable[[str], bool] | None = None
    protocol: str | None = None
    state: str | None = None
    since: date | None = None
    until: date | None = None

    def has(self, run: Summary) -> bool:
        """Return whether a run matches, of several shapes one."""
        named = ((self.subject, run.subject), (self.protocol, run.protocol), (self.state, run.state))
        if any(value not in (None, found) for value, found in named):
            return False
        if self.shape is not None and not any(map(self.shape, run.shapes)):
            return False
        day = date.fromisoformat(run.date_utc[:10])
        return (self.since is None or day >= self.since) and (self.until is None or day <= self.until)
