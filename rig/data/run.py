"""Read a run from its journal, finished or growing."""

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rig.data.folder import RunFolder
from rig.data.journal import MOST_ON_A_LINE, Document, JournalError, document_on, listed_documents, read_journal
from rig.data.run_time import RunTime, on_run_time
from rig.data.schema import PRESS_STREAMS
from rig.errors import RigError
from rig_shared.user_files import MOST_BYTES, json_of, open_file, read_text

if TYPE_CHECKING:
    from rig.data.run_state import RunState

Events = dict[str, list[dict[str, Any]]]


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
    # stream and data of all events, in the order of the journal
    in_order: Sequence[tuple[str, dict[str, Any]]] = ()
    # (begin, end) of each part, in t_s
    parts: Sequence[tuple[float, float]] = ()

    def stream(self, name: str) -> list[dict[str, Any]]:
        """Return the events of one stream in order."""
        return self.events.get(name, [])

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
    def killed(self) -> bool:
        """Whether the journal has no end: the program was killed, and could not lift."""
        return self.stop is None

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
        return self.stop is not None and self.stop["status"] == "done" and self.missing == 0

    @cached_property
    def _last_hold(self) -> dict[int, int]:
        return {start["index"]: start["increments"] for start in self.stream("indentation_start")}


def read_run(path: Path, *, readings: bool = True, only: Collection[str] | None = None) -> Run:
    """Read the journal of a run folder. Raises RunError.

    readings=False: with few of the readings. only: events of these streams.
    """
    folder = RunFolder(path)
    try:
        if only is None:
            documents = on_run_time(read_journal(folder.events, readings=readings))
        else:
            documents = on_run_time(listed_documents(folder.events, only))
    except OSError as error:
        raise RunError(
            "run folder {run}: cannot read {events}: {reason}; give a run folder",
            code="no_journal",
            run=str(path),
            events=folder.events.name,
            reason=error.strerror,
        ) from None
    except JournalError as error:
        raise RunError(
            "run folder {run}: {problem}", code="bad_journal", run=str(path), problem=str(error)
        ) from error
    if not documents or documents[0]["doc"] != "start":
        raise RunError(
            "run folder {run}: {events} does not begin with a start document, so it is not the journal of a run",
            code="no_start",
            run=str(path),
            events=folder.events.name,
        )
    events, superseded, in_order = _by_stream(documents)
    last, parts = documents[-1], _parts(documents)
    return Run(
        folder=folder,
        start=documents[0],
        stop=last if last["doc"] == "stop" else None,
        units={d["stream"]: d["units"] for d in documents if d["doc"] == "descriptor"},
        events=events,
        superseded=superseded,
        in_order=in_order,
        duration_s=float(sum(end_s - begin_s for begin_s, end_s in parts)),
        end_s=last["t_s"],
        parts=parts,
    )


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
    "choose": (dict, type(None)),
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
    return RunError(
        "run folder {run}: {file}: {problem}",
        code="bad_provenance",
        run=str(folder.path),
        file=folder.provenance.name,
        problem=problem,
    )


def _by_stream(documents: Iterable[Document]) -> tuple[Events, Events, list[tuple[str, dict[str, Any]]]]:
    """Return the valid events, those of repeated indentations, and all in the order of the journal."""
    in_order: list[tuple[str, dict[str, Any]]] = []
    events: Events = {}
    superseded: Events = {}
    begun: set[int] = set()
    for document in documents:
        if document["doc"] != "event":
            continue
        stream, data = document["stream"], document["data"]
        if stream == "indentation_start":
            if data["index"] in begun:
                _set_aside(events, superseded, data["index"])
            begun.add(data["index"])
        add_event(events, document)
        in_order.append((stream, events[stream][-1]))
    return events, superseded, in_order


def add_event(events: Events, document: Document) -> None:
    """Add an event with its time; skip other documents."""
    if document["doc"] == "event":
        events.setdefault(document["stream"], []).append({"t_s": document["t_s"], **document["data"]})


def _set_aside(events: Events, superseded: Events, index: int) -> None:
    for stream, found in events.items():
        if stream not in PRESS_STREAMS:
            continue
        old = [event for event in found if event.get("index") == index]
        if old:
            superseded.setdefault(stream, []).extend(old)
            events[stream] = [event for event in found if event.get("index") != index]


def _parts(documents: list[Document]) -> list[tuple[float, float]]:
    """Return begin and end of the run and of its resumed parts (s)."""
    begins = [n for n, document in enumerate(documents) if document["doc"] in ("start", "resume")]
    ends = [*(n - 1 for n in begins[1:]), len(documents) - 1]
    return [(documents[a]["t_s"], documents[b]["t_s"]) for a, b in zip(begins, ends, strict=True)]


class Following:
    """Reader of a growing journal, which returns each document once."""

    def __init__(self, folder: RunFolder) -> None:
        self._path, self._at, self._line = folder.events, 0, 0
        self._time = RunTime()

    def new(self, most: int = -1) -> list[Document]:
        """Return the new documents, up to the last whole line. Raises RunError.

        most: maximum number of bytes, more than the longest line. Default: all.
        """
        try:
            # Without a buffer (128 KiB from Python 3.14 on), and never larger than the new data: buffers that are
            # allocated and shrunk twenty times a second fragment the heap.
            with open_file(self._path, buffering=0) as file:
                file.seek(self._at)
                new_bytes = min(max(os.fstat(file.fileno()).st_size - self._at, 0), MOST_BYTES)
                whole, end, rest = file.read(new_bytes if most < 0 else min(new_bytes, most)).rpartition(b"\n")
        except FileNotFoundError:
            return []
        except OSError as error:
            raise RunError(
                "{path}: {reason}", code="unreadable", path=str(self._path), reason=error.strerror
            ) from None
        lines = whole.split(b"\n")
        if max(map(len, (*lines, rest))) > MOST_ON_A_LINE:
            raise RunError(
                "{path}: a line is longer than {most} characters, which is the limit",
                code="long_line",
                path=str(self._path),
                most=MOST_ON_A_LINE,
            )
        self._at += len(whole) + len(end)
        return [self._document(line) for line in lines if line]

    def _document(self, line: bytes) -> Document:
        self._line += 1
        found = document_on(line)
        if found is None:
            raise RunError(
                "{path}, line {line}: not a journal document",
                code="no_document",
                path=str(self._path),
                line=self._line,
            )
        return self._time.document(found)


def followed(folder: RunFolder, wait: Callable[[], None]) -> Iterator[list[Document]]:
    """Yield the documents so far, then new ones, until the journal ends or is no longer written.

    wait is called when there is nothing new. Raises RunError.
    """
    journal, last = Following(folder), ""
    while True:
        busy = folder.busy  # Checked first, so that the last documents of an ended program are still read.
        new = journal.new()
        if new:
            last = new[-1]["doc"]
            yield new
        if last == "stop" or not (new or busy):
            return
        if not new:
            wait()
