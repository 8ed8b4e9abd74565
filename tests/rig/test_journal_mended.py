"""A journal that is torn, mended, or on a disk that is full; and which lines are documents."""

import contextlib
import errno
import os
from pathlib import Path
from typing import Any

import pytest

from rig.data.documents import JournalError
from rig.data.journal import Journal, mend_journal, read_journal
from rig.engine import RecordError
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

SOME = {"note": {"text": ""}}
START = b'{"doc": "start", "t_s": 0.0}\n'
NOTE = b'{"doc": "event", "t_s": 1.0, "stream": "note", "data": {"text": "a"}}\n'


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "events.jsonl"


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Each flush to the disk; none is made."""
    done: list[int] = []
    monkeypatch.setattr("rig.data.journal.os.fsync", done.append)
    return done


# --- mending ---


@pytest.mark.parametrize(
    ("found", "mended"),
    [
        (b"", b""),
        (START, START),
        (START + NOTE, START + NOTE),
        (START + NOTE[:-1], START + NOTE),  # lacks its line end only
        (START[:-1], START),
        (START + NOTE[:-2], START),
        (START + NOTE + b"{", START + NOTE),
        (START + NOTE + b"\xff\xfe", START + NOTE),
        (START + NOTE + b"7", START + NOTE),
        (START[:-2], b""),
        (b"{", b""),
    ],
)
def test_mending_a_torn_journal_removes_only_the_incomplete_line(
    path: Path, synced: list[int], found: bytes, mended: bytes
) -> None:
    path.write_bytes(found)
    assert mend_journal(path) == mended.count(b"\n")
    assert path.read_bytes() == mended
    assert len(synced) == 1  # what was mended is on the disk


def test_a_resumed_journal_continues_its_sequence_numbers(path: Path, synced: list[int], clock: VirtualClock) -> None:
    path.write_bytes(START + NOTE + b"{")
    with Journal(path, clock, SOME) as journal:
        journal.resume({"by": "hand"})
        journal.event("note", {"text": "b"})
    found = list(read_journal(path))
    assert [(d["doc"], d.get("seq")) for d in found[2:]] == [("resume", 2), ("descriptor", 3), ("event", 4)]
    assert found[2]["by"] == "hand"


# --- what is a document ---


@pytest.mark.parametrize(
    "line",
    [b"{", b"7", b"[]", b'"start"', b"null", b"{}", b'{"t_s": 0.0}', b'{"doc": "end", "t_s": 0.0}',
     b'{"doc": "start"}', b'{"doc": "event", "t_s": 1.0, "stream": "note"}',
     b'{"doc": "descriptor", "t_s": 1.0, "stream": "note"}', b'{"doc": "stop", "t_s": 1.0}', b'{"doc": "resume"}'],
)  # fmt: skip
def test_a_journal_line_that_is_no_document_is_refused_with_its_number(path: Path, line: bytes) -> None:
    path.write_bytes(START + line + b"\n" + NOTE)
    with raises(JournalError, "no_document", path=str(path), line=2):
        list(read_journal(path))
    path.write_bytes(START + line)  # the last one, torn
    assert [d["doc"] for d in read_journal(path)] == ["start"]


# --- writing ---


@pytest.mark.parametrize("virtual", [False, True], ids=["run", "dry-run"])
def test_a_journal_on_a_full_disk_keeps_whole_lines_and_writes_every_event_later(
    path: Path, clock: VirtualClock, monkeypatch: pytest.MonkeyPatch, virtual: bool
) -> None:
    write, free = os.write, [True]

    def full(fd: int, data: bytes) -> int:
        if free[0]:
            return write(fd, data)
        write(fd, data[: len(data) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("rig.data.journal.os.write", full)
    watched: list[Any] = []
    with Journal(path, clock, SOME, lambda stream, data: watched.append(data["text"]), virtual=virtual) as journal:
        journal.start({})
        journal.event("note", {"text": "a"})
        journal.settle()
        before, free[0] = path.read_bytes(), False
        for text in "bc":
            with contextlib.suppress(RecordError):
                journal.event("note", {"text": text})
            with raises(RecordError, "cannot_be_written", path=str(path), error=os.strerror(errno.ENOSPC)):
                journal.settle()
            assert path.read_bytes() == before
        assert (journal.unsaved, watched) == (2, ["a"])
        free[0] = True
        journal.settle()
        journal.event("note", {"text": "d"})
        journal.stop("done")
    assert (journal.unsaved, watched) == (0, ["a", "b", "c", "d"])
    assert path.read_bytes().startswith(before)
    found = list(read_journal(path))
    assert [d["seq"] for d in found] == list(range(7))
    assert [d["data"]["text"] for d in found if d["doc"] == "event"] == ["a", "b", "c", "d"]
