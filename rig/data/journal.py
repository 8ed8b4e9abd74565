"""Files that a run appends to: the journal, one JSON document per line, and the byte log.

Documents: start, descriptor (keys and units of a stream), event, stop, and resume where a stopped run continues. A
missing stop means a crash; a torn last line is ignored by the reader and removed before anything is appended.
"""

import contextlib
import itertools
import json
import os
import queue
import re
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from rig.data.documents import (
    MOST_ON_A_LINE,
    Document,
    JournalError,
    as_line,
    document_on,
    fits,
    is_document,
    last_document,
    line_of,
    read_lines,
)
from rig.data.run_status import RunStatus
from rig.errors import LostRecordError, RecordError, RigError
from rig_shared.user_files import json_of, open_file

if TYPE_CHECKING:
    from rig.clock import Clock


Watch = Callable[[str, Mapping[str, Any]], None]
"""Callback for each event on disk: its stream and its data."""


class LostFileError(RigError, OSError):
    """Error of an open file that its path no longer leads to."""

    default_code = "lost"

    def __init__(self, path: Path, what: str, code: str | None = None) -> None:
        super().__init__(what, code)
        self.strerror, self.filename = what, str(path)

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
        """Open or create the file, or raise OSError."""
        self.path = path
        self.lost: LostFileError | None = None
        self._at = path.absolute()  # A script may change the working folder.
        self._file = path.open("ab+", buffering=0)
        self._size = self._file.seek(0, os.SEEK_END)
        self._content: bytes | None = None

    def append(self, line: bytes, *, sync: bool = False) -> None:
        """Append a line with its end, or none of it; `sync` waits until it is on the disk. Raises OSError."""
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
        """Raise LostFileError if the written file was deleted, moved, replaced or shortened."""
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
                return LostFileError(self.path, "was deleted during the run", "deleted")
            return LostFileError(self.path, "was moved during the run, alone or with its folder", "moved")
        except OSError as error:
            return LostFileError(self.path, f"can no longer be found: {error.strerror}", "not_found")
        if not os.path.samestat(mine, there):
            return LostFileError(self.path, "was replaced during the run", "replaced")
        if mine.st_size < self._size:
            return LostFileError(self.path, "was shortened during the run by another program", "shortened")
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
                raise LostRecordError(f"{self.path}: {self.problem}")
            if self.problem is not None:
                raise RecordError(
                    f"{self.path}: cannot be written: {self.problem.strerror}", "cannot_be_written"
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


class _Waiting(NamedTuple):
    """Document to be written: kind, JSON before and after its number, its event, its order, and its time (s)."""

    kind: str
    before: str
    after: str
    event: tuple[str, Mapping[str, Any]] | None
    order: int
    since_s: float


class _Written(NamedTuple):
    """What the file has: the order of the last line, the number of the next document, and the size (bytes)."""

    order: int
    next_number: int
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
        next_number = mend_journal(path)
        self.file = LineFile(path)
        self._stopped = self._closed = False
        self.at_end: Callable[[], Mapping[str, Any]] = dict  # further fields of a stop before the end
        self.interrupted_by: Callable[[], str] = lambda: "interrupted"  # the reason of an interrupt without a message
        # One thread records and one writes. Each step of both is atomic, so that an interrupt leaves no lock behind,
        # and no line is written twice.
        self._waiting: deque[_Waiting] = deque()
        self._order = itertools.count()
        self._written, self._sure = _Written(-1, next_number, self.file.size), True
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
        """Write the last document, with a value of `RunStatus`. Raises RecordError."""
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
        before = f'"uid": "{uuid.uuid4().hex}", "seq": '
        self._recorded += event is not None
        self._waiting.append(_Waiting(kind, before, after[1:], event, next(self._order), self._now_s()))
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
            f"{self.path}: the disk does not keep up with the run: an event has waited for it for {waits_s:.1f} "
            "s; record on a faster disk",
            "slow_disk",
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

    def _append(self, lines: Sequence[_Waiting]) -> None:
        """Append lines with their numbers. Raises OSError."""
        _, number, size = self._written
        if not self._sure:  # an interrupt may have left whole lines
            self.file.cut(size)
        self._sure = False
        text = b"".join(line_of(line.kind, f"{line.before}{n}, {line.after}") for n, line in enumerate(lines, number))
        self.file.append(text, sync=not self._virtual)
        self._written = _Written(lines[-1].order, number + len(lines), size + len(text))
        self._sure = True

    def _record_error(self, error: Exception) -> RecordError:
        """Return the error of an event that is not on disk at its path."""
        if isinstance(error, LostFileError):
            return LostRecordError(f"{self.path}: {error}")
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        return RecordError(f"{self.path}: cannot be written: {reason}", "cannot_be_written")

    def __enter__(self) -> "Journal":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if not self._stopped and error is not None:
                with contextlib.suppress(RecordError):  # The first error is reported.
                    self.stop(RunStatus.of_error(error), str(error) or self._default_reason(error))
        finally:
            self.close()


class NoJournal:
    """Recorder that discards events, for commands outside of runs."""

    def event(self, stream: str, data: Mapping[str, Any]) -> None:
        """Do nothing."""

    def settle(self) -> None:
        """Do nothing."""


def read_journal(path: Path) -> Iterator[Document]:
    """Yield the documents of a journal in order, without a torn last line. Raises JournalError at any damage."""
    for line in read_lines(path):
        if line.damage is not None:
            raise JournalError(f"{path}, line {line.damage.line}: {line.damage.problem}")
        assert line.document is not None
        yield line.document


def mend_journal(path: Path) -> int:
    """End a journal with a whole line, without a torn one; return the number of the next document.

    A last document that lacks only its line end gets it, since the reader accepts it. Raises OSError.
    """
    if not path.exists():
        return 0
    open_file(path).close()  # which refuses a link to a device
    with path.open("rb+") as file:
        tail = min(file.seek(0, os.SEEK_END), MOST_ON_A_LINE + 1)
        file.seek(-tail, os.SEEK_END)
        data = file.read(tail)
        whole = data.rfind(b"\n") + 1
        if document_on(data[whole:]) or (whole == 0 and tail > MOST_ON_A_LINE):
            file.write(b"\n")
        elif whole < len(data):
            file.truncate(file.tell() - len(data) + whole)
        os.fsync(file.fileno())
    last = (data[whole:] or data[data.rfind(b"\n", 0, max(whole - 1, 0)) + 1 :]).rstrip(b"\n")
    if fits(last) and isinstance(number := (document_on(last) or {}).get("seq"), int):
        return number + 1
    return sum(line.document is not None for line in read_lines(path))


def add_to_end(path: Path, more: Mapping[str, Any], unix_s: float) -> None:
    """Append the last document again with further keys, at the same time of the run. Raises OSError."""
    number = mend_journal(path)
    document = {**last_document(path), **more, "uid": uuid.uuid4().hex, "seq": number, "unix_s": round(unix_s, 6)}
    with path.open("ab") as file:
        file.write(as_line(document))
        file.flush()
        os.fsync(file.fileno())


# A journal in a list of many runs: few events are parsed, and only these are checked.
# The text is split between events, as the journal writes them. Any other, torn, damaged or non-ASCII journal is read
# in full.

_NUMBER = re.compile(rb'\{"doc": "\w+", "crc32": "\w{8}", (?:"uid": "\w+", )?"seq": (\d+),')
_BETWEEN = '}}\n{"doc": "event", '
_READING = 'sample", "data": {'
"""Nine lines in ten are readings and contain this."""
_STREAM = '"stream": "'
"""The first occurrence in a line belongs to the document; recorded text comes after it."""
_BLOCK = 1 << 15
"""Bytes per block, which are discarded while they are in the cache."""


def listed_documents(path: Path, streams: Collection[str]) -> list[Document] | None:
    """Return all documents except most events of other streams; None if it must be read in full. Raises OSError."""
    if not _is_whole(path):
        return None
    return _documents(_BETWEEN.join(_selected(path, tuple(f'{_STREAM}{stream}"' for stream in streams))))


def _is_whole(path: Path) -> bool:
    """Return whether the lines of a journal are unchanged and numbered without a gap; those of 0.2 have no number."""
    with open_file(path) as file:
        for expected in itertools.count():
            line = file.readline(MOST_ON_A_LINE + 1)
            number = _NUMBER.match(line)
            if number is None:
                return not line or expected == 0
            if int(number[1]) != expected or not fits(line.rstrip(b"\n")):
                return False
    return True


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
    if any(fits(line.encode("ascii")) is False for line in text.splitlines()):
        return None
    try:
        found = json_of(f"[{text[:-1].replace(chr(10), ',')}]")
    except ValueError:
        return None
    return found if len(found) == text.count("\n") and all(map(is_document, found)) else None
