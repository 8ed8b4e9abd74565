"""A journal behind the motion: a slow disk delays nothing, and what is shown is on disk."""

import errno
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import rig.data.journal as journals
from rig.data.journal import Journal, read_journal
from rig.engine import RecordError
from rig.errors import LostRecordError
from sim.devices.clock import VirtualClock
from tests.error_codes import raises
from tests.waiting import DEADLINE_S, until

SOME = {"note": {"text": ""}}


class Disk:
    """A disk whose flushes wait while it is `stuck`."""

    def __init__(self) -> None:
        self.free, self.waits = threading.Event(), threading.Event()
        self.free.set()

    def fsync(self, fd: int) -> None:
        self.waits.set()
        self.free.wait()

    def sticks(self) -> None:
        self.waits.clear()
        self.free.clear()


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    found = Disk()
    monkeypatch.setattr("rig.data.journal.os.fsync", found.fsync)
    yield found
    found.free.set()


class Run:
    """A journal, the events that it has shown as recorded, and the time that it measures waits by."""

    def __init__(self, path: Path) -> None:
        self.shown: list[str] = []
        self.shown_by: set[threading.Thread] = set()
        self.now_s = 0.0
        self.journal = Journal(path, VirtualClock(), SOME, self._watch, now_s=lambda: self.now_s)
        self.journal.start({})

    def _watch(self, stream: str, data: Any) -> None:
        self.shown.append(data["text"])
        self.shown_by.add(threading.current_thread())

    def note(self, text: str) -> None:
        self.journal.event("note", {"text": text})


@pytest.fixture
def run(tmp_path: Path, disk: Disk) -> Run:
    return Run(tmp_path / "events.jsonl")


def test_events_during_a_stuck_disk_are_kept_and_shown_in_order_afterwards(run: Run, disk: Disk) -> None:
    disk.sticks()
    for text in "abc":
        run.note(text)
    assert disk.waits.wait(DEADLINE_S)
    assert (run.shown, run.journal.unsaved) == ([], 3)
    disk.free.set()
    run.journal.settle(DEADLINE_S)
    assert (run.shown, run.journal.unsaved) == (["a", "b", "c"], 0)
    assert run.shown_by == {threading.current_thread()}
    run.journal.stop("done")
    run.journal.close()
    assert [d["data"]["text"] for d in read_journal(run.journal.path) if d["doc"] == "event"] == ["a", "b", "c"]


def test_events_that_wait_are_flushed_together(run: Run, disk: Disk, monkeypatch: pytest.MonkeyPatch) -> None:
    disk.sticks()
    run.note("a")
    assert disk.waits.wait(DEADLINE_S)
    for text in "bcdefgh":
        run.note(text)
    flushes: list[int] = []
    monkeypatch.setattr("rig.data.journal.os.fsync", flushes.append)
    disk.free.set()
    run.journal.settle(DEADLINE_S)
    assert len(flushes) <= 2
    assert run.shown == list("abcdefgh")
    run.journal.close()


def test_a_run_ends_when_an_event_waits_too_long_for_the_disk(run: Run, disk: Disk) -> None:
    disk.sticks()
    run.note("a")
    run.now_s = journals.LONGEST_WAIT_S
    run.note("b")
    run.now_s += 1.0
    with raises(RecordError, "slow_disk", waits_s=run.now_s):
        run.note("c")
    assert (run.shown, run.journal.unsaved) == ([], 3)
    disk.free.set()
    run.journal.settle(DEADLINE_S)
    run.note("d")
    assert run.shown[:3] == ["a", "b", "c"], "the event that noticed it is recorded too"
    run.journal.close()


def test_settling_a_journal_fails_after_its_time_limit(run: Run, disk: Disk) -> None:
    disk.sticks()
    run.note("a")
    with raises(RecordError, "slow_disk"):
        run.journal.settle(0.001)
    disk.free.set()
    run.journal.close()


def test_a_disk_that_never_answers_does_not_hang_the_end_of_a_run(
    run: Run, disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journals, "LONGEST_END_S", 0.001)
    disk.sticks()
    run.note("a")
    with raises(RecordError, "slow_disk"):
        run.journal.stop("done")
    run.journal.close()
    assert run.journal.unsaved == 1
    writer = next(thread for thread in threading.enumerate() if thread.name == "journal")
    before = run.journal.path.read_bytes()
    disk.free.set()
    writer.join()
    assert run.journal.path.read_bytes() == before, "nothing is written after the journal gave up"


def test_an_event_that_could_not_be_written_ends_the_run_at_the_next_one(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(fd: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("rig.data.journal.os.fsync", broken)
    with raises(RecordError, "cannot_be_written", error=os.strerror(errno.EIO)):
        until(lambda: run.note("a"))
    assert run.shown == []
    run.journal.close()


def test_a_lost_journal_ends_the_run_when_it_settles(run: Run) -> None:
    run.note("a")
    run.journal.settle(DEADLINE_S)
    run.journal.path.unlink()
    run.note("b")
    with raises(LostRecordError, "record_lost"):
        run.journal.settle(DEADLINE_S)
    assert run.shown == ["a"]
    run.journal.close()


def test_an_interrupted_write_of_a_dry_run_writes_no_line_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, write = Journal(tmp_path / "events.jsonl", VirtualClock(), SOME, virtual=True), os.write

    def interrupted(fd: int, data: bytes) -> int:
        write(fd, data)
        raise KeyboardInterrupt

    journal.start({})
    journal.event("note", {"text": "a"})
    monkeypatch.setattr("rig.data.journal.os.write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        journal.event("note", {"text": "b"})
    monkeypatch.setattr("rig.data.journal.os.write", write)
    journal.event("note", {"text": "c"})
    journal.close()
    found = list(read_journal(journal.path))
    assert [d["seq"] for d in found] == list(range(len(found)))
    assert [d["data"]["text"] for d in found if d["doc"] == "event"] == ["a", "b", "c"]
