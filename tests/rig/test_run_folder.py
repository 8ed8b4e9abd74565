"""A run folder: read back, exported, hashed; also after a crash."""

import csv
import hashlib
import json
import pickle
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import pytest

from rig.data import RunError, RunFolder, export_run, new_run_folder, read_run
from rig.data.events import OF_THE_PRESS, PRESS_STREAMS, STREAMS
from rig.data.folder import UnwritableError
from rig.engine import Target, indent, verbs
from rig.plan.config import Config
from rig.report.run_report import write_report
from sim.models.fingertip import Fingertip
from tests.error_codes import raises

START = {
    "protocol": "mine",
    "title": "Two presses <on> a spring",
    "source": "",
    "parameters": {"depth_mm": 0.3},
    "planned_indentations": 2,
    "virtual": True,
}
PROVENANCE = {
    "started_utc": "2026-01-01T00:00:00+00:00",
    "command": ["rig"],
    "protocol": "mine.py",
    "python": "3",
    "platform": "here",
    "versions": {},
    "model": {"nodes": 1, "e_epidermis_mpa": 0.01, "from_cache": True},
    "devices": {"stage": "virtual grbl"},
}


@pytest.fixture
def folder(tmp_path: Path, spring: Callable[..., Any]) -> RunFolder:
    """Two indentations on a spring, the second in two increments; the journal has its stop."""
    bench = spring()
    bench.journal.start(START)
    engine = bench.ready(0.5)
    verbs.note(engine, 'a "word", and µ')
    indent(engine, Target("doi_mm", 0.3), hold_s=0.2)
    indent(engine, Target("doi_mm", 0.4), increments=2, hold_s=0.2)
    bench.journal.stop("done")
    script = tmp_path / "mine.py"
    script.write_text("def run(rig): pass\n", encoding="utf-8")
    when = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    folder = new_run_folder(tmp_path / "runs", "mine", when, script, Config().as_toml(), PROVENANCE)
    folder.events.write_bytes(bench.journal_path.read_bytes())
    return folder


def _crashed(folder: RunFolder, keep: int, torn: bytes = b'{"doc": "event", "uid"') -> RunFolder:
    lines = folder.events.read_bytes().splitlines(keepends=True)
    folder.events.write_bytes(b"".join(lines[:keep]) + torn)
    return folder


def test_a_run_folder_is_new_and_named_by_time_and_script(folder: RunFolder, tmp_path: Path) -> None:
    assert folder.path.name.startswith("20260102T030405-mine-")
    assert folder.path.parent == tmp_path / "runs"
    assert (folder.path / "protocol.py").read_text(encoding="utf-8") == "def run(rig): pass\n"
    assert (folder.path / "config.toml").read_text(encoding="utf-8") == Config().as_toml()
    assert json.loads(folder.provenance.read_text(encoding="utf-8")) == PROVENANCE
    when = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
    again = new_run_folder(tmp_path / "runs", "mine", when, tmp_path / "mine.py", "", {})
    assert again.path != folder.path


def test_reading_a_run_returns_its_journaled_events(folder: RunFolder) -> None:
    run = read_run(folder.path)
    assert run.complete
    assert run.start["title"] == START["title"]
    assert run.stop is not None
    assert run.stop["status"] == "done"
    assert [e["index"] for e in run.stream("indentation_end")] == [0, 1]
    assert [e["hold"] for e in run.stream("hold_end")] == [1, 1, 2]
    assert run.stream("trip") == []
    assert run.duration_s > 10
    assert run.units["touch"] == STREAMS["touch"]
    times = [e["t_s"] for e in run.stream("sample")]
    assert times == sorted(times)


def test_hdf5_holds_every_event_with_its_unit(folder: RunFolder) -> None:
    run = read_run(folder.path)
    export_run(run)
    with h5py.File(folder.data) as file:
        assert set(file) == {"presses", *(name for name in STREAMS if run.stream(name))}
        assert (file.attrs["protocol"], file.attrs["planned_indentations"]) == ("mine", 2)
        assert bool(file.attrs["complete"])
        for stream, group in file.items():
            if stream == "presses":
                continue
            assert set(group) == {"t_s", *STREAMS[stream], *of_the_press(stream)}
            assert group["t_s"].attrs["unit"] == "s"
            for key, unit in STREAMS[stream].items():
                assert group[key].attrs["unit"] == unit
                assert group[key].shape == (len(run.stream(stream)),)
        sample = file["sample"]
        assert sample["force_gwt"][:].tolist() == [e["force_gwt"] for e in run.stream("sample")]
        assert sample["stable"].dtype == bool
        assert sample["phase"].asstr()[0] == "clearance"
        # No DOI before contact is found.
        assert [d != d for d in sample["doi_mm"][:]] == [e["doi_mm"] is None for e in run.stream("sample")]
        assert file["note/text"].asstr()[0] == 'a "word", and µ'


def test_csv_tables_have_one_row_per_event_and_end_with_the_press(folder: RunFolder) -> None:
    run = read_run(folder.path)
    export_run(run)
    assert {p.stem for p in folder.path.glob("*.csv")} == {"presses", *(name for name in STREAMS if run.stream(name))}
    for stream in ("sample", "hold_end", "note"):
        with (folder.path / f"{stream}.csv").open(encoding="utf-8", newline="") as text:
            rows = list(csv.DictReader(text))
        own = [name for name in ("t_s", *STREAMS[stream]) if name not in of_the_press(stream)]
        assert list(rows[0]) == [*own, *of_the_press(stream)]
        assert len(rows) == len(run.stream(stream))
        for row, event in zip(rows, run.stream(stream), strict=True):
            assert {k: row[k] for k in own} == {k: "" if event[k] is None else str(event[k]) for k in own}


def test_an_export_that_fails_leaves_the_old_files(folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    export_run(read_run(folder.path))
    before = {p.name: p.read_bytes() for p in folder.path.iterdir()}

    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rig.data.folder.os.fsync", full)
    with raises(UnwritableError, "unwritable", reason="No space left on device") as caught:
        export_run(read_run(folder.path))
    assert isinstance(caught.value, OSError)
    for error in (caught.value, pickle.loads(pickle.dumps(caught.value))):
        assert (error.errno, error.code) == (28, "unwritable")
        assert str(error) == f"{error.filename}: {error.strerror}"
    assert {p.name: p.read_bytes() for p in folder.path.iterdir() if p.suffix != ".part"} == before


def test_the_checksum_file_lists_and_verifies_every_file(folder: RunFolder) -> None:
    export_run(read_run(folder.path))
    folder.write_checksums()
    lines = (folder.path / "SHA256SUMS").read_text(encoding="utf-8").splitlines()
    listed = dict(reversed(line.split("  ", 1)) for line in lines)
    assert set(listed) == {p.name for p in folder.path.iterdir()} - {"SHA256SUMS"}
    assert {"events.jsonl", "data.h5", "protocol.py", "config.toml", "provenance.json"} <= set(listed)
    for name, digest in listed.items():
        assert hashlib.sha256((folder.path / name).read_bytes()).hexdigest() == digest


def of_the_press(stream: str) -> list[str]:
    """Columns that the tables of a press end with."""
    return list(OF_THE_PRESS) if stream in PRESS_STREAMS else []


# --- after a crash ---


def test_a_crashed_run_is_read_and_exported(folder: RunFolder) -> None:
    documents = [json.loads(line) for line in folder.events.read_text(encoding="utf-8").splitlines()]
    ended = next(n for n, d in enumerate(documents) if d.get("stream") == "indentation_end" and d["doc"] == "event")
    run = read_run(_crashed(folder, ended + 1).path)
    assert run.stop is None
    assert not run.complete
    assert len(run.stream("indentation_end")) == 1
    export_run(run)
    with h5py.File(folder.data) as file:
        assert not file.attrs["complete"]
        assert len(file["indentation_end/t_s"]) == 1
        assert "trip" not in file


@pytest.mark.parametrize("keep", [1, 40])
def test_a_crash_at_any_time_is_readable_and_reported(folder: RunFolder, finger: Fingertip, keep: int) -> None:
    run = read_run(_crashed(folder, keep).path)
    export_run(run)
    text = write_report(run, finger).read_text(encoding="utf-8")
    assert run.killed
    what_ran = text.split('<h2 id="run">', 1)[1].split("</p>", 1)[0]
    assert '<span class="bad">' in what_ran
    assert "killed" in what_ran
    assert "Two presses &lt;on&gt; a spring" in text


def test_a_run_with_all_presses_but_no_stop_document_is_not_complete(folder: RunFolder) -> None:
    lines = len(folder.events.read_text(encoding="utf-8").splitlines())
    run = read_run(_crashed(folder, lines - 1, b"").path)
    assert len(run.stream("indentation_end")) == 2
    assert not run.complete


@pytest.mark.parametrize(
    ("content", "code", "fields"),
    [
        (None, "no_journal", {"events": "events.jsonl", "reason": "No such file or directory"}),
        (b"", "no_start", {"events": "events.jsonl"}),
        (b'{"doc": "st', "no_start", {}),
        (b'{"doc": "event", "t_s": 0, "stream": "note", "data": {}}\n', "no_start", {}),
        (b'rubbish\n{"doc": "start", "t_s": 0}\n', "no_start", {"at": " (line 1: not a journal document)"}),
    ],
)
def test_reading_a_folder_without_a_run_is_refused(
    tmp_path: Path, content: bytes | None, code: str, fields: dict[str, str]
) -> None:
    if content is not None:
        (tmp_path / "events.jsonl").write_bytes(content)
    with raises(RunError, code, run=str(tmp_path), **fields):
        read_run(tmp_path)


def _event(t_s: float, stream: str, **data: Any) -> dict[str, Any]:
    return {"doc": "event", "t_s": t_s, "stream": stream, "data": data}


def test_a_resumed_run_that_made_a_press_twice_counts_it_as_repeated(tmp_path: Path) -> None:
    documents = [
        {"doc": "start", "t_s": 0.0, "planned_indentations": 1},
        _event(1.0, "indentation_start", index=0, increments=1),
        _event(2.0, "hold_end", index=0, hold=1, contact_s=3.5),
        {"doc": "resume", "t_s": 100.0},
        _event(101.0, "indentation_start", index=0, increments=1),
        _event(102.0, "hold_end", index=0, hold=1),
        {"doc": "stop", "t_s": 103.0, "status": "done"},
    ]
    (tmp_path / "events.jsonl").write_text("".join(json.dumps(d) + "\n" for d in documents), encoding="utf-8")
    run = read_run(tmp_path)
    assert (run.missing, run.repeated, run.restarted) == (0, 1, 1)
    assert run.duration_s == (2.0 - 0.0) + (103.0 - 100.0)  # not the time between
    assert run.contact_s == 3.5  # also of what was begun again
    (tmp_path / ".lock").touch()
    run.folder.write_checksums()
    assert [line.split("  ")[1] for line in (tmp_path / "SHA256SUMS").read_text().splitlines()] == ["events.jsonl"]
