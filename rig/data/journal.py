"""The journal of a run: one JSON document a line, on disk before it counts.

Documents: start, descriptor (the keys and units of a stream), event, stop, and resume where a run that had stopped
goes on. A missing stop means a crash; a torn last line is dropped by the reader and cut off before anything is added.
"""

import contextlib
import json
import os
import uuid
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

from rig.append_only_file import LineFile, LostFileError
from rig.errors import LimitError, LostRecordError, RecordError, RigError, RunAborted, TripError

if TYPE_CHECKING:
    from rig.clock import Clock


Document = dict[str, Any]

_NEEDED: dict[str, set[str]] = {
    "start": {"t_s"},
    "resume": {"t_s"},
    "descriptor": {"t_s", "stream", "units"},
    "event": {"t_s", "stream", "data"},
    "stop": {"t_s", "status"},
}
_STATUS = {RunAborted: "aborted", KeyboardInterrupt: "aborted", TripError: "tripped", LimitError: "limited"}


_AS_IT_IS = "surrogateescape"  # bytes that are no text stay what they are, and make no document


class JournalError(RigError):
    """A line that is not the last one cannot be read."""

    default_code = "no_document"


class Recorder(Protocol):
    """Where events go: the journal of a run, or the memory of a rehearsal."""

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Keep it; it counts when this returns. Raises RecordError."""


class Journal:
    """Writes events.jsonl; every document is on the disk (of a virtual run: in the file) when a call returns."""

    def __init__(
        self,
        path: Path,
        clock: "Clock",
        streams: Mapping[str, Mapping[str, str]],
        watch: Callable[[str, Mapping[str, Any]], None] = lambda stream, data: None,
        witness: Callable[[str, Mapping[str, Any]], Mapping[str, Any]] = lambda stream, data: {},
        *,
        virtual: bool = False,
    ) -> None:
        """`streams` gives each stream's keys and their units ("" for text); `watch` sees what is on disk.

        `witness` adds to an event what only the bench knows, keys that begin with `true_`.
        A journal that is there already is mended and added to. What is `virtual` can be had again, and waits for no
        disk: it outlives a killed process, not a cut of power. Raises JournalError.
        """
        self._watch, self._witness = watch, witness
        self._clock = clock
        self._streams = streams
        self._described: set[str] = set()
        self.path = path
        self._virtual = virtual
        self._seq = mend_journal(path)
        self.file = LineFile(path)
        self._stopped = False
        self.at_end: Callable[[], Mapping[str, Any]] = dict  # what a stop before the end says besides

    def start(self, about: Mapping[str, Any]) -> None:
        """The first document: what is run, with what."""
        self._write("start", about)

    def resume(self, about: Mapping[str, Any]) -> None:
        """A run that had stopped goes on from here."""
        self._write("resume", about)

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """One event of a stream; the stream's descriptor precedes its first event."""
        keys, data = self._streams[stream], {**data, **self._witness(stream, data)}
        unknown = set(data) - set(keys)
        if unknown:
            raise KeyError(f"stream {stream!r} has no {sorted(unknown)}")
        if stream not in self._described:
            self._described.add(stream)
            self._write("descriptor", {"stream": stream, "units": dict(keys)})
        self._write("event", {"stream": stream, "data": data})
        self._watch(stream, data)

    def stop(self, status: str, reason: str = "") -> None:
        """The last document; status is done, aborted, tripped, limited or failed."""
        self._write("stop", {"status": status, "reason": reason, **({} if status == "done" else self.at_end())})
        self._stopped = True

    def close(self) -> None:
        """Give the file back."""
        self.file.close()

    def _write(self, kind: str, body: Mapping[str, Any]) -> None:
        document = {
            "doc": kind,
            "uid": uuid.uuid4().hex,
            "seq": self._seq,
            "t_s": round(self._clock.monotonic_s(), 6),
            "unix_s": round(self._clock.unix_s(), 6),
            **body,
        }
        self._append((json.dumps(document, allow_nan=False) + "\n").encode("ascii"))
        self._seq += 1

    def _append(self, line: bytes) -> None:
        """The whole line on the disk, where it will be found, or none of it. Raises RecordError."""
        try:
            self.file.append(line, sync=not self._virtual)
            self.file.check()
        except LostFileError as error:
            raise LostRecordError("{path}: {error}", path=str(self.path), error=str(error)) from error
        except OSError as error:
            raise RecordError(
                "{path}: cannot be written: {error}",
                code="cannot_be_written",
                path=str(self.path),
                error=error.strerror or str(error),
            ) from error

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if not self._stopped and error is not None:
                status = next((name for known, name in _STATUS.items() if isinstance(error, known)), "failed")
                with contextlib.suppress(RecordError):  # the first error says more
                    self.stop(status, str(error) or type(error).__name__)
        finally:
            self.close()


class NoJournal:
    """Forgets what it is told: for what is no run."""

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Nothing is kept."""


def read_journal(path: Path, *, readings: bool = True) -> Iterator[Document]:
    """The documents of a journal in order; a torn last line is dropped. Raises JournalError.

    readings=False: of readings in a row the last only, since nine documents in ten are readings.
    """
    lines = path.read_bytes().decode("utf-8", _AS_IT_IS).split("\n")  # text is searched in half the time
    passed_over = [False] * len(lines) if readings else _before_another_reading(lines)
    counting = {n: line for n, line in enumerate(lines, 1) if line and not passed_over[n - 1]}
    documents = None if readings else _documents_on(counting.values())
    yield from documents if documents is not None else _one_by_one(counting, len(lines), path)


def _one_by_one(lines: Mapping[int, str], last: int, path: Path) -> Iterator[Document]:
    """The documents of lines, by their numbers; the last may be torn. Raises JournalError."""
    for number, line in lines.items():
        document = document_on(line.encode("utf-8", _AS_IT_IS))
        if document is not None:
            yield document
        elif number < last:
            raise JournalError("{path}, line {line}: not a journal document", path=str(path), line=number)


def mend_journal(path: Path) -> int:
    """End a journal on a whole line, cutting off a torn one; returns how many documents it holds.

    A last document that lacks nothing but its line end gets it, since the reader takes it as written. Raises
    JournalError.
    """
    if not path.exists():
        return 0
    with path.open("rb+") as file:
        data = file.read()
        whole = data.rindex(b"\n") + 1 if b"\n" in data else 0
        if document_on(data[whole:]) is not None:
            file.write(b"\n")
        elif whole < len(data):
            file.truncate(whole)
        os.fsync(file.fileno())
    return sum(1 for _ in read_journal(path))


def add_to_end(path: Path, more: Mapping[str, Any], unix_s: float) -> None:
    """One document more: the last one, with these keys besides, at the same instant of the run. Raises OSError."""
    documents = mend_journal(path)
    *_, last = read_journal(path)
    document = {**last, **more, "uid": uuid.uuid4().hex, "seq": documents, "unix_s": round(unix_s, 6)}
    with path.open("ab") as file:
        file.write((json.dumps(document, allow_nan=False) + "\n").encode("ascii"))
        file.flush()
        os.fsync(file.fileno())


def _before_another_reading(lines: Sequence[str]) -> list[bool]:
    """Which lines look like whole readings, as the journal writes them, and stand before another one."""
    reading = [
        'sample", "data": {' in line and line.startswith('{"doc": "event", ') and line.endswith("}}")
        for line in lines
    ]
    return [one and other for one, other in zip(reading, [*reading[1:], False], strict=True)]


def _documents_on(lines: Iterable[str]) -> list[Document] | None:
    """A document from each line, read as one list in half the time; None where they are not all documents."""
    each = list(lines)
    text = ",".join(each)
    try:
        found = json.loads(f"[{text}]") if text.isascii() else []  # as journals are written: no broken bytes
    except ValueError:
        return None
    return found if len(found) == len(each) and all(map(is_document, found)) else None


def document_on(line: bytes) -> Document | None:
    """The document on a line, or None where there is none."""
    try:
        found = json.loads(line)
    except ValueError:  # neither JSON nor UTF-8
        return None
    return found if is_document(found) else None


def is_document(found: object) -> bool:
    """Whether something read is one, by the keys that each has."""
    needed = _NEEDED.get(str(found.get("doc"))) if isinstance(found, dict) else None
    return needed is not None and isinstance(found, dict) and needed <= found.keys()


# A journal for a list of many runs: every line is seen to be whole, and of the events few are taken apart.
#
# It is cut at once where one event follows another, as the journal writes them. Written otherwise, torn, or with
# bytes that are no ASCII it is read as for anything else.

_BETWEEN = '}}\n{"doc": "event", '
_READING = 'sample", "data": {'
"""Nine lines in ten are readings: with this in it a line is one of them."""
_STREAM = '"stream": "'
"""The first one in a line is its own: what is recorded comes after it."""
_BLOCK = 1 << 15
"""Bytes at a time: what is cut is thrown away while it is near."""


def listed_documents(path: Path, streams: Collection[str]) -> list[Document]:
    """All but the events of other streams, of which some may be among them. Raises OSError, JournalError."""
    found = _documents(_BETWEEN.join(_kept(path, tuple(f'{_STREAM}{stream}"' for stream in streams))))
    return list(read_journal(path, readings=False)) if found is None else found


def _kept(path: Path, wanted: tuple[str, ...]) -> Iterator[str]:
    """The begin and the end, events that are wanted, and whatever stands between events."""
    with path.open("rb", buffering=0) as file:
        left, first = "", True
        while block := file.read(_BLOCK):
            *lines, left = (left + block.decode("latin-1")).split(_BETWEEN)
            for line in lines:
                if first or "\n" in line or (_READING not in line and line.startswith(wanted, line.find(_STREAM))):
                    yield line
                first = False
        yield left


def _documents(text: str) -> list[Document] | None:
    """Of lines; None where they are not as the journal writes them."""
    if not (text.isascii() and text.endswith("\n")):
        return None
    try:
        found = json.loads(f"[{text[:-1].replace(chr(10), ',')}]")
    except ValueError:
        return None
    return found if len(found) == text.count("\n") and all(map(is_document, found)) else None
