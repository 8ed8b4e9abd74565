"""The journal: on disk before it counts, and readable after a crash."""

import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.data.documents import JournalError
from rig.data.events import STREAMS
from rig.data.journal import Journal, read_journal
from rig.engine import LimitError, NotReadyError, RunAborted, TripError
from sim.devices.clock import VirtualClock
from tests.error_codes import raises

SOME = {"note": {"text": ""}, "move": {"x_mm": "mm", "height_mm": "mm"}}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "events.jsonl"


def _write(path: Path, clock: VirtualClock, **options: Any) -> None:
    with Journal(path, clock, SOME, **options) as journal:
        journal.start({"protocol": "steps"})
        clock.wait_s(1.5)
        journal.event("note", {"text": "Zürich, 3 µm"})
        journal.event("move", {"x_mm": 0.17, "height_mm": 2.0})
        journal.event("note", {"text": "again"})
        journal.stop("done")


def test_a_dry_run_journals_at_once_and_waits_for_no_disk(
    path: Path, clock: VirtualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.data.journal.os.fsync", lambda fd: pytest.fail("a disk was waited for"))
    with Journal(path, clock, SOME, virtual=True) as journal:
        lines = []
        for write in _calls(journal):
            write()
            lines.append(path.read_bytes().count(b"\n"))
    assert lines == [1, 3, 4, 5]


def test_the_journal_holds_numbered_documents_with_time_and_units(path: Path) -> None:
    _write(path, VirtualClock(1e9))
    documents = list(read_journal(path))
    assert [d["doc"] for d in documents] == ["start", *["descriptor", "event"] * 2, "event", "stop"]
    assert [d["seq"] for d in documents] == list(range(7))
    assert len({d["uid"] for d in documents}) == 7
    assert documents[0]["protocol"] == "steps"
    assert (documents[2]["t_s"], documents[2]["unix_s"]) == (1.5, 1e9 + 1.5)
    assert documents[1]["units"] == {"text": ""}
    assert documents[2]["data"] == {"text": "Zürich, 3 µm"}
    assert documents[3] | {"stream": "move", "units": {"x_mm": "mm", "height_mm": "mm"}} == documents[3]
    assert documents[-1]["status"] == "done"


def test_an_event_reaches_observers_only_once_on_disk(
    path: Path, clock: VirtualClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[tuple[str, int]] = []
    fsync = os.fsync

    def noted(fd: int) -> None:
        fsync(fd)
        done.append(("fsync", path.read_bytes().count(b"\n")))

    monkeypatch.setattr("rig.data.journal.os.fsync", noted)

    def seen(stream: str, data: Any) -> None:
        done.append((f"seen {data['text']}", path.read_bytes().count(b"\n")))

    with Journal(path, clock, SOME, seen) as journal:
        for number, write in enumerate(_calls(journal)):
            write()
            journal.settle()
            done.append((f"settled {number}", path.read_bytes().count(b"\n")))
    several = [(what, lines) for what, lines in done if (what, lines) != ("fsync", 2)]  # descriptor and event: 1 or 2
    assert several == [
        ("fsync", 1),
        ("settled 0", 1),
        ("fsync", 3),
        ("seen a", 3),
        ("settled 1", 3),
        ("fsync", 4),
        ("seen b", 4),
        ("settled 2", 4),
        ("fsync", 5),
        ("settled 3", 5),
    ]


def _calls(journal: Journal) -> list[Callable[[], None]]:
    return [
        lambda: journal.start({}),
        lambda: journal.event("note", {"text": "a"}),
        lambda: journal.event("note", {"text": "b"}),
        lambda: journal.stop("done"),
    ]


@pytest.mark.parametrize("left", [1, 22, 59])
def test_a_torn_last_line_of_a_journal_is_ignored(path: Path, clock: VirtualClock, left: int) -> None:
    _write(path, clock)
    whole = list(read_journal(path))
    data = path.read_bytes()
    last = data.rindex(b"\n", 0, -1) + 1
    path.write_bytes(data[: last + left])
    assert list(read_journal(path)) == whole[:-1]


def test_a_killed_program_loses_no_settled_event(path: Path, clock: VirtualClock) -> None:
    journal = Journal(path, clock, SOME)
    journal.start({})
    journal.event("note", {"text": "the last words"})
    journal.settle()
    # No stop, no close: what a kill leaves behind.
    documents = list(read_journal(path))
    assert [d["doc"] for d in documents] == ["start", "descriptor", "event"]
    journal.close()


@pytest.mark.parametrize(
    ("error", "status", "reason"),
    [
        (RunAborted("by the operator"), "aborted", "by the operator"),
        (KeyboardInterrupt(), "aborted", "interrupted"),
        (TripError("force 3 gwt"), "tripped", "force 3 gwt"),
        (LimitError("too deep"), "limited", "too deep"),
        (NotReadyError("unhomed"), "failed", "unhomed"),
        (ZeroDivisionError(), "failed", "ZeroDivisionError"),
    ],
)
def test_the_stop_document_states_status_and_reason(
    path: Path, clock: VirtualClock, error: BaseException, status: str, reason: str
) -> None:
    def fail() -> None:
        with Journal(path, clock, SOME) as journal:
            journal.start({})
            raise error

    with pytest.raises(type(error)):
        fail()
    last = list(read_journal(path))[-1]
    assert (last["doc"], last["status"], last["reason"]) == ("stop", status, reason)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_journal_event_with_nan_or_infinity_is_refused_and_leaves_no_partial_line(
    path: Path, clock: VirtualClock, value: float
) -> None:
    with Journal(path, clock, SOME) as journal:
        journal.start({})
        journal.event("move", {"x_mm": 0.0})
        journal.settle()
        before = path.read_bytes()
        with pytest.raises(ValueError, match="JSON compliant"):
            journal.event("move", {"x_mm": value})
        journal.settle()
        assert path.read_bytes() == before
        journal.event("move", {"x_mm": 1.0})
        journal.stop("done")
    assert [d["seq"] for d in read_journal(path)] == list(range(5))


def test_the_journal_refuses_unknown_keys_and_streams(path: Path, clock: VirtualClock) -> None:
    with Journal(path, clock, SOME) as journal:
        with pytest.raises(KeyError, match="speed"):
            journal.event("move", {"x_mm": 0.0, "speed": 1.0})
        with pytest.raises(KeyError, match="dance"):
            journal.event("dance", {})
    assert path.read_bytes() == b""


def test_the_journal_file_is_only_appended_to(path: Path, clock: VirtualClock) -> None:
    _write(path, clock)
    before = path.read_bytes()
    _write(path, clock)
    assert path.read_bytes().startswith(before)
    assert len(path.read_bytes()) > len(before)
    assert not [line for line in path.read_text(encoding="utf-8").splitlines() if not json.loads(line)]


def test_every_journal_column_has_the_unit_that_its_name_ends_with() -> None:
    for keys in STREAMS.values():
        for key, unit in keys.items():
            suffix = "mm/s" if key.endswith("_mm_s") else key.rsplit("_", 1)[-1]
            suffix = {"bits": "bit"}.get(suffix, suffix)
            if suffix in ("mm", "gwt", "s", "mm/s", "bit") and "_" in key:
                assert unit == suffix, key
            else:
                assert unit == "", key


def test_a_journal_line_beyond_the_length_limit_is_refused_with_its_number(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _write(path, VirtualClock())
    lengths = [len(line) for line in path.read_text(encoding="utf-8").splitlines()]
    longest = max(lengths)
    monkeypatch.setattr("rig.data.documents.MOST_ON_A_LINE", longest)
    assert len(list(read_journal(path))) == len(lengths)
    monkeypatch.setattr("rig.data.documents.MOST_ON_A_LINE", longest - 1)
    with raises(JournalError, "no_document", line=lengths.index(longest) + 1):
        list(read_journal(path))
