"""Files that a run appends to: the journal, one JSON document per line, and the byte log.

Documents: start, descriptor (keys and units of a stream), event, stop, and resume where a stopped run continues. A
missing stop means a crash; a torn last line is ignored by the reader and removed before anything is appended.
"""

import contextlib
import itertools
import json
import os
import queue
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from rig.errors import LimitError, LostRecordError, RecordError, RigError, RunAborted, TripError
from rig_shared.user_files import json_of, open_file, read_bytes

if TYPE_CHECKING:
    from rig.clock import Clock


Document = dict[str, Any]
Watch = Callable[[str, Mapping[str, Any]], None]
"""Callback for each event on disk: its stream and its data."""

_NUMBER = (float, int)
_LATEST_S = 1e12
_NEEDED: dict[str, dict[str, type | tuple[type, ...]]] = {
    "start": {"t_s": _NUMBER},
    "resume": {"t_s": _NUMBER},
    "descriptor": {"t_s": _NUMBER, "stream": str, "units": dict},
    "event": {"t_s": _NUMBER, "stream": str, "data": dict},
    "stop": {"t_s": _NUMBER, "status": str},
}
_STATUS = {RunAborted: "aborted", KeyboardInterrupt: "aborted", TripError: "tripped", LimitError: "limited"}


_AS_IT_IS = "surrogateescape"  # Bytes that are no text stay unchanged, and form no document.


class JournalError(RigError):
    """Error of a line, other than the last one, that cannot be read."""

    default_code = "no_document"


class LostFileError(RigError, OSError):
    """Error of an open file that its path no longer leads to."""

    default_code = "lost"

    def __init__(self, path: Path, what: str, *, code: str | None = None, **fields: Any) -> None:
        super().__init__(what, code=code, **fields)
        self.strerror, self.filename = str(self.args[0]), str(path)

    def __reduce__(self) -> tuple[Any, ...]:
        # The dictionary lacks what OSError stores itself.
        return type(self), (Path(self.filename), self.strerror), self.__dict__

    def __str__(self) -> str:
        return str(self.strerror)


class LineFile:
    """Open file of whole lines, to be appended to.

    The descriptor of a file that is deleted, moved, replaced or shortened stays writable, so a write alone notices
    nothing.
    """

    def __init__(self, path: Path) -> None:
        """Open or create the file.

        Raises
        ------
        OSError
            If it cannot be opened.
        """
        self.path = path
        self.lost: LostFileError | None = None
        self._at = path.absolute()  # A script may change the working folder.
        self._file = path.open("ab+", buffering=0)
        self._size = self._file.seek(0, os.SEEK_END)
        self._content: bytes | None = None

    def append(self, line: bytes, *, sync: bool = False) -> None:
        """Append a whole line, or none of it.

        Parameters
        ----------
        line : bytes
            Line with its line end.
        sync : bool
            Whether to wait until it is on the disk.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        end = self._file.tell()
        try:
            left = memoryview(line)
            while left:
                left = left[os.write(self._file.fileno(), left) :]
            if sync:
                os.fsync(self._file.fileno())
        except OSError:
            with contextlib.suppress(OSError):  # A torn line is mended before the file is used again.
                if os.fstat(self._file.fileno()).st_size > end:
                    self._file.truncate(end)
                    self._file.seek(end)
            raise
        # The file may be longer: an interrupt, or a line of another thread, may have come between.
        self._size = end + len(line)

    @property
    def size(self) -> int:
        """Size (bytes) of the lines that this program wrote or found."""
        return self._size

    def cut(self, size: int) -> None:
        """Remove what is beyond this size (bytes). Raises OSError."""
        if os.fstat(self._file.fileno()).st_size > size:
            self._file.truncate(size)
            self._file.seek(size)

    def check(self) -> None:
        """Check that the path still leads to the written file.

        Raises
        ------
        LostFileError
            If the file was deleted, moved, replaced or shortened.
        """
        if self.lost is None:
            self.lost = self._what_happened()
        if self.lost is not None:
            raise self.lost

    def _what_happened(self) -> LostFileError | None:
        mine = os.fstat(self._file.fileno())
        try:
            there = os.stat(self._at)
        except FileNotFoundError:
            if mine.st_nlink == 0:
                return LostFileError(self.path, "was deleted during the run", code="deleted")
            return LostFileError(self.path, "was moved during the run, alone or with its folder", code="moved")
        except OSError as error:
            what = "can no longer be found: {problem}"
            return LostFileError(self.path, what, code="not_found", problem=error.strerror)
        if not os.path.samestat(mine, there):
            return LostFileError(self.path, "was replaced during the run", code="replaced")
        if mine.st_size < self._size:
            what = "was shortened during the run by another program"
            return LostFileError(self.path, what, code="shortened")
        return None

    def content(self) -> bytes:
        """Return the whole content, wherever the file is now. Raises OSError."""
        if self._content is not None:
            return self._content
        if self._file.closed:
            return self._at.read_bytes()
        self._file.seek(0)
        return self._file.readall()

    def close(self) -> None:
        """Close the file; content() can still read a lost one."""
        if self.lost is not None and not self._file.closed:
            with contextlib.suppress(OSError):
                self._content = self.content()
        self._file.close()


class ByteLog:
    """Log of whole lines. A failed write ends it and is its `problem`, so that it never delays a stop."""

    def __init__(self, path: Path) -> None:
        """Append to an existing file. Raises OSError."""
        self.path = path
        self.file = LineFile(path)
        self.problem: OSError | None = None

    def write(self, text: str, /) -> None:
        if self.problem is not None and self.file.lost is None:  # A lost file can still be read back.
            return
        try:
            self.file.append(text.encode("ascii"))
        except OSError as error:
            self.problem = error

    def check(self) -> None:
        """Record as `problem` if the path no longer leads to the file."""
        if self.problem is None:
            try:
                self.file.check()
            except OSError as error:
                self.problem = error

    def checked_before(self, watch: Watch) -> Watch:
        """Return the watch, with a RecordError if the bytes are no longer recorded."""

        def checked(stream: str, data: Mapping[str, Any]) -> None:
            self.check()
            if isinstance(self.problem, LostFileError):
                raise LostRecordError("{path}: {error}", path=str(self.path), error=str(self.problem))
            if self.problem is not None:
                raise RecordError(
                    "{path}: cannot be written: {error}",
                    code="cannot_be_written",
                    path=str(self.path),
                    error=str(self.problem.strerror),
                ) from self.problem
            watch(stream, data)

        return checked

    def __enter__(self) -> "ByteLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.file.close()


class Recorder(Protocol):
    """Destination of events: the journal of a run, or the memory of a rehearsal."""

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Record an event, without waiting for a disk. Raises RecordError, also about earlier events."""

    def settle(self) -> None:
        """Wait, for a limited time, until all events are on disk. Raises RecordError."""


LONGEST_WAIT_S = 2.0
"""Longest time that an event may wait for the disk in a run."""
LONGEST_END_S = 10.0
"""Longest time that the end of a run waits for the disk."""


class _Line(NamedTuple):
    """Document to be written: JSON before and after its number, its event, its order, and its time (s)."""

    before: str
    after: str
    event: tuple[str, Mapping[str, Any]] | None
    order: int
    since_s: float


class _Written(NamedTuple):
    """What the file has: the order of the last line, the number of documents, and the size (bytes)."""

    order: int
    documents: int
    size: int


_Answer = queue.SimpleQueue[None]
_MORE: _Answer = queue.SimpleQueue()
"""Call of the writing thread that waits for no answer."""


class Journal:
    """Writer of events.jsonl.

    `event` queues a document and returns; one thread writes what is queued, with one flush. `settle` waits for it.
    A virtual run can be repeated, so each document is written before `event` returns, and no disk is waited for: it
    survives a killed process, but not a power failure.
    """

    def __init__(
        self,
        path: Path,
        clock: "Clock",
        streams: Mapping[str, Mapping[str, str]],
        watch: Watch = lambda stream, data: None,
        witness: Callable[[str, Mapping[str, Any]], Mapping[str, Any]] = lambda stream, data: {},
        *,
        virtual: bool = False,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Open the journal, or mend and continue an existing one. Raises JournalError.

        `streams`: keys of each stream and their units ("" for text). `watch` is called for each event on disk, in
        order, by the thread that records: at the next event, or when it settles. `witness` adds keys to an event
        that only the bench knows (`true_…`). `now_s` measures how long an event waits for the disk.
        """
        self._watch, self._witness = watch, witness
        self._clock, self._now_s = clock, now_s
        self._streams = streams
        self._described: set[str] = set()
        self.path = path
        self._virtual = virtual
        documents = mend_journal(path)
        self.file = LineFile(path)
        self._stopped = self._closed = False
        self.at_end: Callable[[], Mapping[str, Any]] = dict  # further fields of a stop before the end
        self.interrupted_by: Callable[[], str] = lambda: "interrupted"  # the reason of an interrupt without a message
        # One thread records and one writes. Each step of both is atomic, so that an interrupt leaves no lock behind,
        # and no line is written twice.
        self._waiting: deque[_Line] = deque()
        self._order = itertools.count()
        self._written, self._sure = _Written(-1, documents, self.file.size), True
        self._on_disk: deque[tuple[str, Mapping[str, Any]]] = deque()
        self._recorded = self._saved = 0  # events
        self._problem: Exception | None = None  # of the last attempt to write
        self._calls: queue.SimpleQueue[_Answer | None] = queue.SimpleQueue()
        self._writer: threading.Thread | None = None
        self._given_up = False

    def start(self, about: Mapping[str, Any]) -> None:
        """Write the first document, the script and its inputs, at t_s = 0, when the byte log began."""
        self._put("start", about)
        self._settle_or_give_up()

    def resume(self, about: Mapping[str, Any]) -> None:
        """Write that a stopped run continues."""
        self._put("resume", about)
        self._settle_or_give_up()

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Record an event; the descriptor of the stream precedes its first event.

        Raises RecordError if an earlier event could not be written, or waits for the disk for too long.
        """
        keys, data = self._streams[stream], {**data, **self._witness(stream, data)}
        unknown = set(data) - set(keys)
        if unknown:
            raise KeyError(f"stream {stream!r} has no {sorted(unknown)}")
        if stream not in self._described:
            self._put("descriptor", {"stream": stream, "units": dict(keys)})
            self._described.add(stream)
        self._put("event", {"stream": stream, "data": data}, (stream, data))
        self._report()
        if not self._virtual:
            self._refuse_slow_disk()

    def settle(self, within_s: float = LONGEST_WAIT_S) -> None:
        """Wait until everything recorded is on disk, and report it to `watch`. Raises RecordError."""
        if self._virtual:
            self._write()
        elif self._writer is not None and not self._answered(within_s):
            self._report()
            raise self._slow_disk(within_s)
        self._report()

    def _settle_or_give_up(self) -> None:
        try:
            self.settle(LONGEST_END_S)
        except RecordError as error:
            self._given_up = error.code == "slow_disk"
            raise

    def stop(self, status: str, reason: str = "") -> None:
        """Write the last document; status is done, aborted, tripped, limited or failed. Raises RecordError."""
        self._put("stop", {"status": status, "reason": reason, **({} if status == "done" else self.at_end())})
        self._stopped = True
        self._settle_or_give_up()

    @property
    def unsaved(self) -> int:
        """Number of events that are not on disk."""
        return self._recorded - self._saved

    def close(self) -> None:
        """Close the file, after what is queued is written; give up on a disk that does not answer."""
        self._closed = True
        if self._writer is None:
            self.file.close()
            return
        self._calls.put(None)
        self._writer.join(0.0 if self._given_up else LONGEST_END_S)
        self._given_up = True

    def _default_reason(self, error: BaseException) -> str:
        """Return the reason of an error without a message; an interrupt has the person or program behind it."""
        return self.interrupted_by() if isinstance(error, KeyboardInterrupt) else type(error).__name__

    def _put(self, kind: str, body: Mapping[str, Any], event: tuple[str, Mapping[str, Any]] | None = None) -> None:
        """Queue a document; of a virtual run, write it. Raises ValueError for a number that JSON does not have."""
        if self._closed:
            raise ValueError("the journal is a closed file")
        t_s, unix_s = self._clock.run_s(), self._clock.unix_s()
        if kind == "start":
            t_s, unix_s = 0.0, unix_s - t_s
        after = json.dumps({"t_s": round(t_s, 6), "unix_s": round(unix_s, 6), **body}, allow_nan=False)
        before = f'{{"doc": "{kind}", "uid": "{uuid.uuid4().hex}", "seq": '
        self._recorded += event is not None
        self._waiting.append(_Line(before, after[1:], event, next(self._order), self._now_s()))
        if self._virtual:
            self._write()
            return
        if self._writer is None:
            self._writer = threading.Thread(target=self._write_behind, name="journal", daemon=True)
            self._writer.start()
        self._calls.put(_MORE)

    def _answered(self, within_s: float) -> bool:
        """Return whether the writing thread has tried to write everything within this time."""
        answer: _Answer = queue.SimpleQueue()
        self._calls.put(answer)
        try:
            answer.get(timeout=within_s)
        except queue.Empty:
            return False
        return True

    def _report(self) -> None:
        """Report the events on disk to `watch`. Raises RecordError if the others could not be written."""
        while self._on_disk:
            self._watch(*self._on_disk.popleft())
        if (problem := self._problem) is not None:
            raise self._record_error(problem) from problem

    def _refuse_slow_disk(self) -> None:
        try:
            waits_s = self._now_s() - self._waiting[0].since_s
        except IndexError:  # it has just been written
            return
        if waits_s > LONGEST_WAIT_S:
            raise self._slow_disk(waits_s)

    def _slow_disk(self, waits_s: float) -> RecordError:
        return RecordError(
            "{path}: the disk does not keep up with the run: an event has waited for it for {waits_s:.1f} s; record "
            "on a faster disk",
            code="slow_disk",
            path=str(self.path),
            waits_s=waits_s,
        )

    def _write_behind(self) -> None:
        """Write what is recorded, until the journal is closed."""
        ends = False
        while not ends:
            calls = [self._calls.get()]
            with contextlib.suppress(queue.Empty):
                while True:
                    calls.append(self._calls.get_nowait())
            if not self._given_up:
                self._write()
            for call in calls:
                if call is None:
                    ends = True
                elif call is not _MORE:
                    call.put(None)
        self.file.close()

    def _write(self) -> None:
        """Append all waiting lines with one flush, or none of them; an error becomes the `_problem`."""
        try:
            while self._waiting and self._waiting[0].order <= self._written.order:
                self._waiting.popleft()
            lines = [self._waiting[n] for n in range(len(self._waiting))]
            if lines:
                self._append(lines)
                self._saved += sum(line.event is not None for line in lines)
                for _ in lines:
                    self._waiting.popleft()
            self.file.check()
        except Exception as error:  # which the recording thread raises
            self._problem = error
        else:
            self._problem = None
            self._on_disk.extend(line.event for line in lines if line.event is not None)

    def _append(self, lines: Sequence[_Line]) -> None:
        """Append lines with their numbers. Raises OSError."""
        _, documents, size = self._written
        if not self._sure:  # an interrupt may have left whole lines
            self.file.cut(size)
        self._sure = False
        text = "".join(f"{line.before}{n}, {line.after}\n" for n, line in enumerate(lines, documents)).encode("ascii")
        self.file.append(text, sync=not self._virtual)
        self._written = _Written(lines[-1].order, documents + len(lines), size + len(text))
        self._sure = True

    def _record_error(self, error: Exception) -> RecordError:
        """Return the error of an event that is not on disk at its path."""
        if isinstance(error, LostFileError):
            return LostRecordError("{path}: {error}", path=str(self.path), error=str(error))
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        return RecordError(
            "{path}: cannot be written: {error}", code="cannot_be_written", path=str(self.path), error=reason
        )

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if not self._stopped and error is not None:
                status = next((name for known, name in _STATUS.items() if isinstance(error, known)), "failed")
                with contextlib.suppress(RecordError):  # The first error is reported.
                    self.stop(status, str(error) or self._default_reason(error))
        finally:
            self.close()


class NoJournal:
    """Recorder that discards events, for commands outside of runs."""

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Do nothing."""

    def settle(self) -> None:
        """Do nothing."""


MOST_ON_A_LINE = 4_000_000
"""Characters of a document; those of runs have at most a few thousand."""


def read_journal(path: Path, *, readings: bool = True) -> Iterator[Document]:
    """Yield the documents of a journal in order, without a torn last line. Raises JournalError.

    readings=False: only the last of successive readings, which make up nine documents in ten.
    """
    lines = read_bytes(path).decode("utf-8", _AS_IT_IS).split("\n")  # Text is searched in half the time.
    _refuse_long(path, lines)
    skipped = [False] * len(lines) if readings else _before_another_reading(lines)
    counting = {n: line for n, line in enumerate(lines, 1) if line and not skipped[n - 1]}
    documents = None if readings else _documents_on(counting.values())
    yield from documents if documents is not None else _one_by_one(counting, len(lines), path)


def _refuse_long(path: Path, lines: Sequence[str]) -> None:
    if max(map(len, lines)) > MOST_ON_A_LINE:
        line = next(n for n, line in enumerate(lines, 1) if len(line) > MOST_ON_A_LINE)
        raise JournalError(
            "{path}, line {line}: longer than {most} characters, which is the limit",
            code="long_line",
            path=str(path),
            line=line,
            most=MOST_ON_A_LINE,
        )


def _one_by_one(lines: Mapping[int, str], last: int, path: Path) -> Iterator[Document]:
    """Yield the documents of numbered lines, the last of which may be torn. Raises JournalError."""
    for number, line in lines.items():
        document = document_on(line.encode("utf-8", _AS_IT_IS))
        if document is not None:
            yield document
        elif number < last:
            raise JournalError("{path}, line {line}: not a journal document", path=str(path), line=number)


def mend_journal(path: Path) -> int:
    """End a journal with a whole line, without a torn one; return the number of documents.

    A last document that lacks only its line end gets it, since the reader accepts it. Raises JournalError.
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
    """Append the last document again with further keys, at the same time of the run. Raises OSError."""
    documents = mend_journal(path)
    *_, last = read_journal(path)
    document = {**last, **more, "uid": uuid.uuid4().hex, "seq": documents, "unix_s": round(unix_s, 6)}
    with path.open("ab") as file:
        file.write((json.dumps(document, allow_nan=False) + "\n").encode("ascii"))
        file.flush()
        os.fsync(file.fileno())


def _before_another_reading(lines: Sequence[str]) -> list[bool]:
    """Return which lines look like whole readings, as the journal writes them, before another one."""
    reading = [
        'sample", "data": {' in line and line.startswith('{"doc": "event", ') and line.endswith("}}")
        for line in lines
    ]
    return [one and other for one, other in zip(reading, [*reading[1:], False], strict=True)]


def _documents_on(lines: Iterable[str]) -> list[Document] | None:
    """Return the documents of lines, parsed as one list in half the time; None if any line is not a document."""
    each = list(lines)
    text = ",".join(each)
    try:
        # Journals are written as ASCII, so other bytes are damage.
        found = json_of(f"[{text}]") if text.isascii() else []
    except ValueError:
        return None
    return found if len(found) == len(each) and all(map(is_document, found)) else None


def document_on(line: bytes) -> Document | None:
    """Return the document on a line, or None."""
    try:
        found = json_of(line)
    except ValueError:  # neither JSON nor UTF-8
        return None
    return found if is_document(found) else None


def is_document(found: object) -> bool:
    """Return whether an object is a document, by its required keys and their types."""
    if not isinstance(found, dict) or not isinstance(doc := found.get("doc"), str):
        return False
    needed = _NEEDED.get(doc)
    if needed is None or not all(isinstance(found.get(name), kind) for name, kind in needed.items()):
        return False
    return bool(abs(found["t_s"]) < _LATEST_S)  # False for NaN


# A journal in a list of many runs: every line is checked, but few events are parsed.
# The text is split between events, as the journal writes them. Any other, torn or non-ASCII journal is read in
# full.

_BETWEEN = '}}\n{"doc": "event", '
_READING = 'sample", "data": {'
"""Nine lines in ten are readings and contain this."""
_STREAM = '"stream": "'
"""The first occurrence in a line belongs to the document; recorded text comes after it."""
_BLOCK = 1 << 15
"""Bytes per block, which are discarded while they are in the cache."""


def listed_documents(path: Path, streams: Collection[str]) -> list[Document]:
    """Return all documents except most events of other streams. Raises OSError, JournalError."""
    found = _documents(_BETWEEN.join(_selected(path, tuple(f'{_STREAM}{stream}"' for stream in streams))))
    return list(read_journal(path, readings=False)) if found is None else found


def _selected(path: Path, prefixes: tuple[str, ...]) -> Iterator[str]:
    """Yield the first and the last part, events of these streams, and everything between events."""
    with open_file(path, buffering=0) as file:
        left, first = "", True
        while block := file.read(_BLOCK):
            *lines, left = (left + block.decode("latin-1")).split(_BETWEEN)
            if len(left) > MOST_ON_A_LINE:  # not as the journal writes it, and longer and longer to split
                yield "\n"
                return
            for line in lines:
                if first or "\n" in line or (_READING not in line and line.startswith(prefixes, line.find(_STREAM))):
                    yield line
                first = False
        yield left


def _documents(text: str) -> list[Document] | None:
    """Return the documents of lines, or None if the journal did not write them."""
    if not (text.isascii() and text.endswith("\n")):
        return None
    try:
        found = json_of(f"[{text[:-1].replace(chr(10), ',')}]")
    except ValueError:
        return None
    return found if len(found) == text.count("\n") and all(map(is_document, found)) else None
