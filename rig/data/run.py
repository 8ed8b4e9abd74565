"""Read a run from its journal, finished or growing."""

import json
import os
import zlib
from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from rig.data.documents import MOST_ON_A_LINE, Damage, Document, JournalLine, LineCheck, read_lines
from rig.data.events import PRESS_STREAMS, READING
from rig.data.folder import RunFolder
from rig.data.journal import listed_documents
from rig.data.planned_presses import pressed_otherwise
from rig.data.run_status import RunStatus
from rig.data.run_time import RunTime
from rig.errors import RigError
from rig_shared.outputs import Name, Output
from rig_shared.plural import number_of
from rig_shared.user_files import json_of, open_file, read_text

if TYPE_CHECKING:
    from rig.data.run_state import RunState

Event = dict[str, Any]
Events = Mapping[str, Sequence[Event]]


class RunWarningJson(Output):
    """A run that is incomplete or not as planned, whose journal is damaged, or whose files have changed."""

    run: Name
    warning_text: str


class PackageJson(Output):
    """A package and its version."""

    package: Name
    version: Name


class RunReadings(Sequence[Event]):
    """Readings of one stream, as compressed JSON that is taken apart block by block.

    A long run has millions, which as dictionaries need thirty times the memory.
    """

    def __init__(self) -> None:
        self._blocks: list[bytes] = []
        self._last: list[bytes] = []  # JSON of the last block
        self._t_s, self._press = array("d"), array("q")
        self._open: tuple[int, list[Event]] = -1, []  # block that was read last

    def add(self, data: bytes, t_s: float, press: object) -> None:
        """Add a reading by its JSON, its time of the run (s) and its press."""
        self._last.append(data)
        self._t_s.append(t_s)
        self._press.append(press if isinstance(press, int) and abs(press) < _NO_PRESS else -_NO_PRESS)
        if len(self._last) == _READINGS:
            self._blocks.append(zlib.compress(b"\n".join(self._last), 1))
            self._last = []

    def __len__(self) -> int:
        return len(self._t_s)

    @overload
    def __getitem__(self, at: int) -> Event: ...
    @overload
    def __getitem__(self, at: slice) -> list[Event]: ...
    def __getitem__(self, at: int | slice) -> Event | list[Event]:
        if isinstance(at, slice):
            return [self[n] for n in range(*at.indices(len(self)))]
        n = range(len(self))[at]
        number = n // _READINGS
        if self._open[0] != number or number == len(self._blocks):
            self._open = number, self._events(number)
        return dict(self._open[1][n % _READINGS])

    def __iter__(self) -> Iterator[Event]:
        for number in range(len(self._blocks) + 1):
            yield from self._events(number)

    def of_press(self, index: int) -> list[Event]:
        """Return the readings of one press."""
        return [self[n] for n, press in enumerate(self._press) if press == index]

    def extend(self, others: "RunReadings") -> None:
        """Add the readings of others."""
        for one in others._all():
            self.add(*one)

    def split(self, presses: Collection[int]) -> "tuple[RunReadings, RunReadings]":
        """Return the readings of some presses, and the others."""
        some, others = RunReadings(), RunReadings()
        for data, t_s, press in self._all():
            (some if press in presses else others).add(data, t_s, press)
        return some, others

    def _all(self) -> Iterator[tuple[bytes, float, int]]:
        data = (one for number in range(len(self._blocks) + 1) for one in self._json(number))
        return zip(data, self._t_s, self._press, strict=True)

    def _json(self, number: int) -> list[bytes]:
        return self._last if number == len(self._blocks) else zlib.decompress(self._blocks[number]).split(b"\n")

    def _events(self, number: int) -> list[Event]:
        times = self._t_s[number * _READINGS : (number + 1) * _READINGS]
        found = json_of(b"[" + b",".join(self._json(number)) + b"]")
        return [{"t_s": t_s, **data} for t_s, data in zip(times, found, strict=True)]


_READINGS = 256
"""Readings that are compressed together."""
_NO_PRESS = 1 << 62
_DATA = b'"data": '


def _json_of_data(text: bytes, document: Document) -> bytes:
    """Return the JSON of an event's data: the last part of its line, if a run wrote it."""
    if "crc32" in document:
        return text[text.index(_DATA) + len(_DATA) : -1]
    return json.dumps(document["data"]).encode("ascii")


class RunError(RigError):
    """Error of a folder without a readable run."""

    default_code = "no_run"


@dataclass(frozen=True)
class Run:
    """Documents of one run by stream. Every event has its time since the start of the run under "t_s".

    `superseded` holds the events of indentations that were interrupted and repeated; `events` does not.
    """

    folder: RunFolder
    start: dict[str, Any]
    stop: dict[str, Any] | None  # None after a crash
    units: dict[str, dict[str, str]]
    events: Events
    superseded: Events
    duration_s: float  # without the time between its parts
    end_s: float  # t_s of the last document
    # (begin, end) of each part, in t_s
    parts: Sequence[tuple[float, float]] = ()
    # stream and data of all events, in the order of the journal
    in_order: Iterable[tuple[str, Event]] = ()
    damage: Sequence[Damage] = ()
    damaged: frozenset[int] = frozenset()  # indices of presses at a damage, which are left out

    def stream(self, name: str) -> Sequence[Event]:
        """Return the events of one stream in order."""
        return self.events.get(name, [])

    def readings_of(self, index: int) -> list[Event]:
        """Return the readings of an indentation, in order of time."""
        found = self.stream(READING)
        if isinstance(found, RunReadings):
            return found.of_press(index)
        return [reading for reading in found if reading["index"] == index]

    @cached_property
    def done(self) -> dict[int, list[dict[str, Any]]]:
        """Holds of every indentation whose last hold has ended, by index."""
        holds: dict[int, list[dict[str, Any]]] = {}
        for hold in self.stream("hold_end"):
            holds.setdefault(hold["index"], []).append(hold)
        return {i: found for i, found in holds.items() if found[-1]["hold"] == self._last_hold[i]}

    @property
    def missing(self) -> int:
        """Number of planned indentations that are not done; none if the counts ended an adaptive run."""
        if any(event.get("possible") is None for event in self.stream("choice")):
            return 0
        return max(int(self.start["planned_indentations"]) - len(self.done), 0)

    @property
    def repeated(self) -> int:
        """Number of indentations that were repeated although they were done."""
        ends = [*self.superseded.get("hold_end", []), *self.stream("hold_end")]
        times = Counter(end["index"] for end in ends if end["hold"] == self._last_hold[end["index"]])
        return sum(n - 1 for n in times.values())

    @property
    def restarted(self) -> int:
        """Number of interrupted indentations that were repeated."""
        return len(self.superseded.get("indentation_start", []))

    @property
    def last_checkpoint(self) -> str | None:
        """Name of the last checkpoint, or None."""
        passed = self.stream("checkpoint")
        return passed[-1]["name"] if passed else None

    @property
    def contact_s(self) -> float:
        """Contact time on record (s)."""
        found = [*self.events.values(), *self.superseded.values()]
        return max((event["contact_s"] for events in found for event in events if "contact_s" in event), default=0.0)

    @property
    def is_checked(self) -> bool:
        """Whether the lines of the journal have checksums, as from version 0.3 on."""
        return "crc32" in self.start

    @property
    def killed(self) -> bool:
        """Whether the journal has no end: the program was killed, and could not lift."""
        return self.stop is None

    @property
    def warning(self) -> str | None:
        """Sentence on the damage of the journal, what is left out, and what to do about it; None if it is whole."""
        if not self.damage:
            return None
        line, problem = self.damage[0]
        more = f", and {len(self.damage) - 1} more places" if len(self.damage) > 1 else ""
        presses = ", ".join(map(str, sorted(self.damaged)))
        left_out = f"; presses left out: {presses}, which `rig resume` repeats" if presses else ""
        if self.missing:
            left_out += (
                f"; {len(self.done)} of {number_of(self.start['planned_indentations'], 'presses')} can be read"
            )
        left_out = left_out or "; no press is left out"
        return (
            f"run folder {self.folder.path}: {self.folder.events.name} is damaged, line {line}: {problem}{more}"
            f"{left_out}; put back an undamaged copy if you have one"
        )

    @cached_property
    def warnings(self) -> list[str]:
        """Sentences on a damaged journal, files that are not those of the run, and presses that were not planned."""
        return [*filter(None, (self.warning, *self.folder.warnings, pressed_otherwise(self)))]

    @property
    def incomplete(self) -> str | None:
        """Sentence on a run that did not end normally with every planned indentation done; None if it did."""
        status = RunStatus.of_journal(self.stop, self.missing)
        if status is RunStatus.DONE:
            return None
        status = RunStatus.RUNNING if status is RunStatus.KILLED and self.folder.busy else status
        planned = number_of(int(self.start["planned_indentations"]), "indentations")
        return f"run folder {self.folder.path}: the run is incomplete ({status}): {len(self.done)} of {planned} done"

    @cached_property
    def state(self) -> "RunState":
        """State of the run at its end."""
        from rig.data.run_state import RunState  # A list of runs does without this module.

        state = RunState()
        state.start, state.stop = self.start, self.stop
        for stream, event in self.in_order:
            state.event(stream, event)
        return state

    @property
    def complete(self) -> bool:
        """Whether the run ended normally with every planned indentation done."""
        return self.stop is not None and RunStatus.of_journal(self.stop, self.missing) is RunStatus.DONE

    @cached_property
    def _last_hold(self) -> dict[int, int]:
        return {start["index"]: start["increments"] for start in self.stream("indentation_start")}


def warnings_as_json(runs: Iterable[Run]) -> list[RunWarningJson]:
    """Return the warnings of damaged, changed and incomplete runs for `--json`."""
    return [
        {"run": run.folder.path.name, "warning_text": one}
        for run in runs
        for one in (*run.warnings, run.incomplete)
        if one is not None
    ]


def read_run(path: Path, *, only: Collection[str] | None = None) -> Run:
    """Read the journal of a run folder. Raises RunError.

    only: events of these streams. Lines that are damaged, and the presses around them, are left out; `damage` names
    them.
    """
    folder = RunFolder(path)
    documents = _Documents()
    try:
        some = None if only is None else listed_documents(folder.events, only)
        for line in read_lines(folder.events) if some is None else (JournalLine(0, b"", one, None) for one in some):
            documents.add(line, readings=only is None)
    except OSError as error:
        raise RunError(
            f"run folder {path}: cannot read {folder.events.name}: {error.strerror}; give a run folder", "no_journal"
        ) from None
    if documents.start is None:
        at = f" (line {documents.damage[0].line}: {documents.damage[0].problem})" if documents.damage else ""
        raise RunError(
            f"run folder {path}: {folder.events.name} does not begin with a start document, so it is not the "
            f"journal of a run{at}",
            "no_start",
        )
    return documents.run(folder)


def provenance_of(run: Run) -> dict[str, Any]:
    """Return versions, command and devices of a run; empty if its folder lacks them."""
    try:
        return read_provenance(run.folder)
    except (OSError, RunError):
        return {}


_TYPES_OF_PROVENANCE: dict[str, type | tuple[type, ...]] = {
    "protocol": str,
    "parameters": dict,
    "virtual": bool,
    "subject": (str, type(None)),
    "devices": dict,
    "versions": dict,
    "model": (dict, type(None)),
    "python": str,
}


def read_provenance(folder: RunFolder, *required: str) -> dict[str, Any]:
    """Return the provenance of a run folder. Raises OSError; RunError for wrong types and missing keys."""
    try:
        found = json_of(read_text(folder.provenance))
    except ValueError as error:
        raise _damaged(folder, f"not valid JSON: {error}") from None
    if not isinstance(found, dict):
        raise _damaged(folder, "must be an object")
    for name, kind in _TYPES_OF_PROVENANCE.items():
        if name in found and not isinstance(found[name], kind):
            raise _damaged(folder, f"{name}: has a wrong type")
    for name in required:
        if name not in found:
            raise _damaged(folder, f"{name}: is required, but is missing")
    return found


def _damaged(folder: RunFolder, problem: str) -> RunError:
    return RunError(f"run folder {folder.path}: {folder.provenance.name}: {problem}", "bad_provenance")


class _Documents:
    """Lines of a journal, sorted by stream as they are read."""

    def __init__(self) -> None:
        self._time = RunTime()
        self.start: Document | None = None
        self._last: Document = {}
        self._parts: list[tuple[float, float]] = []
        self._units: dict[str, dict[str, str]] = {}
        self._events: dict[str, Any] = {}
        self._superseded: dict[str, Any] = {}
        self._begun: set[int] = set()
        self.damage: list[Damage] = []
        self._damaged: set[int] = set()
        self._press: int | None = None  # under way
        self._next_is_damaged = False

    def add(self, line: JournalLine, *, readings: bool) -> None:
        """Add the next line."""
        if line.damage is not None:
            self._note(line.damage)
        if line.document is None:
            return
        document = self._time.document(line.document)
        if not self._last and document["doc"] == "start":
            self.start = document
        self._last, t_s = document, document["t_s"]
        if document["doc"] in ("start", "resume") or not self._parts:
            self._parts.append((t_s, t_s))
        self._parts[-1] = (self._parts[-1][0], t_s)
        if document["doc"] == "descriptor":
            self._units[document["stream"]] = document["units"]
        elif document["doc"] == "event" and (readings or not document["stream"].endswith(READING)):
            self._add_event(document, line.text)

    def _note(self, damage: Damage) -> None:
        self.damage.append(damage)
        self._next_is_damaged = True
        if self._press is not None:
            self._damaged.add(self._press)

    def _add_event(self, document: Document, text: bytes) -> None:
        stream, data = document["stream"], document["data"]
        if stream in PRESS_STREAMS:
            self._follow_press(stream, data.get("index"))
        if stream.endswith(READING):
            found = self._events.setdefault(stream, RunReadings())
            found.add(_json_of_data(text, document), document["t_s"], data.get("index"))
        else:
            self._events.setdefault(stream, []).append({"t_s": document["t_s"], **data})

    def _follow_press(self, stream: str, index: Any) -> None:
        """Note which press is under way, and set it aside if it begins again."""
        if stream == "indentation_start":
            if index in self._begun:
                for name, events in _taken_out(self._events, {index}).items():
                    kept = self._superseded.setdefault(name, events)
                    if kept is not events:
                        kept.extend(events)
            self._begun.add(index)
            self._damaged.discard(index)
        elif self._next_is_damaged:
            self._damaged.add(index)
        self._next_is_damaged = False
        self._press = None if stream == "indentation_end" else index

    def run(self, folder: RunFolder) -> Run:
        """Return the run, without its damaged presses."""
        assert self.start is not None
        damaged = frozenset(index for index in self._damaged if index >= 0)
        if damaged:
            _taken_out(self._events, damaged)
        return Run(
            folder=folder,
            start=self.start,
            stop=self._last if self._last["doc"] == "stop" else None,
            units=self._units,
            events=self._events,
            superseded=self._superseded,
            duration_s=float(sum(end_s - begin_s for begin_s, end_s in self._parts)),
            end_s=self._last["t_s"],
            parts=self._parts,
            in_order=EventsInOrder(folder.events),
            damage=self.damage,
            damaged=damaged,
        )


def _taken_out(events: dict[str, Any], presses: Collection[int]) -> dict[str, Any]:
    """Take the events of some presses out of their streams, and return them."""
    taken: dict[str, Any] = {}
    for stream in [name for name in events if name in PRESS_STREAMS]:
        found = events[stream]
        if isinstance(found, RunReadings):
            taken[stream], events[stream] = found.split(presses)
        else:
            taken[stream] = [event for event in found if event.get("index") in presses]
            events[stream] = [event for event in found if event.get("index") not in presses]
        if not taken[stream]:
            del taken[stream]
    return taken


class EventsInOrder:
    """Stream and data of all events of a journal in order, read from it each time."""

    def __init__(self, journal: Path) -> None:
        self._journal = journal

    def __iter__(self) -> Iterator[tuple[str, Event]]:
        time = RunTime()
        for line in read_lines(self._journal):
            if line.document is not None and (document := time.document(line.document))["doc"] == "event":
                yield document["stream"], {"t_s": document["t_s"], **document["data"]}


class Following:
    """Reader of a growing journal, which returns each document once."""

    def __init__(self, folder: RunFolder) -> None:
        self._path, self._at = folder.events, 0
        self._check, self._time = LineCheck(), RunTime()
        self.damage: Damage | None = None  # the first one

    def new(self) -> list[Document]:
        """Return the new documents without damaged lines, up to the last whole line. Raises RunError."""
        found: list[Document] = []
        while some := self.next():
            found += some
        return found

    def next(self, most: int = MOST_ON_A_LINE + 1) -> list[Document]:
        """Return the next documents from at most so many bytes, more than the longest line. Raises RunError."""
        try:
            # Without a buffer (128 KiB from Python 3.14 on), and never larger than the new data: buffers that are
            # allocated and shrunk twenty times a second fragment the heap.
            with open_file(self._path, buffering=0) as file:
                file.seek(self._at)
                new_bytes = max(os.fstat(file.fileno()).st_size - self._at, 0)
                whole, end, rest = file.read(min(new_bytes, most)).rpartition(b"\n")
        except FileNotFoundError:
            return []
        except OSError as error:
            raise RunError(f"{self._path}: {error.strerror}", "unreadable") from None
        lines = whole.split(b"\n")
        if max(map(len, (*lines, rest))) > MOST_ON_A_LINE:
            raise RunError(
                f"{self._path}: a line is longer than {MOST_ON_A_LINE} characters, which is the limit", "long_line"
            )
        self._at += len(whole) + len(end)
        found = [self._check.document(line) for line in lines if line]
        self.damage = self.damage or next((damage for _, damage in found if damage is not None), None)
        documents = [self._time.document(document) for document, _ in found if document is not None]
        return documents if documents or not found else self.next(most)


def followed(folder: RunFolder, wait: Callable[[], None]) -> Iterator[list[Document]]:
    """Yield the documents so far, then new ones, until the journal ends or is no longer written.

    wait is called when there is nothing new. Raises RunError.
    """
    journal, last = Following(folder), ""
    while True:
        busy = folder.busy  # Checked first, so that the last documents of an ended program are still read.
        new = journal.next()
        if new:
            last = new[-1]["doc"]
            yield new
            continue
        if last == "stop" or not busy:
            return
        wait()
