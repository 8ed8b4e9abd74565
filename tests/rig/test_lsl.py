"""Streams for LSL, from journals: what is sent, at which time, and what is not."""

import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from rig.data.events import STREAMS
from rig.data.lsl import CHANNELS, GrowingRuns, RunStreams, marker_of, sample_of
from tests.program import Program


class Outlet:
    """Keeps what is pushed."""

    def __init__(self) -> None:
        self.pushed: list[tuple[float, list[Any]]] = []

    def push_sample(self, x: Sequence[Any], timestamp: float) -> None:
        self.pushed.append((timestamp, list(x)))


class Clock:
    """Searches at once."""

    t_s = 0.0

    def monotonic_s(self) -> float:
        self.t_s += 10.0
        return self.t_s


def _document(doc: str, t_s: float, **more: Any) -> dict[str, Any]:
    return {"doc": doc, "uid": "u", "seq": 0, "t_s": t_s, "unix_s": 1000.0 + t_s, **more}


def _event(stream: str, t_s: float, **data: Any) -> dict[str, Any]:
    return _document("event", t_s, stream=stream, data=data)


START = _document("start", 0.0, protocol="p", subject="S07", parameters={"of": "S07"}, planned_indentations=1)
STOP = _document("stop", 9.0, status="done", reason="")


def _write(runs: Path, name: str, *documents: dict[str, Any]) -> Path:
    folder = runs / name
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "events.jsonl").open("a", encoding="ascii") as file:
        file.writelines(json.dumps(document) + "\n" for document in documents)
    return folder


def _following(runs: Path) -> GrowingRuns:
    return GrowingRuns(runs, Clock())  # type: ignore[arg-type]


def test_the_lsl_stream_reads_each_new_line_of_new_grown_or_resumed_runs_once(tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    _write(runs, "earlier", START, STOP)
    begun = _write(runs, "begun", START, _event("home", 1.0, controller=""))
    following = _following(runs)
    assert following.new() == []
    new = _write(runs, "new", START)
    assert following.new() == [(new, [START])]
    _write(runs, "begun", _event("zero", 2.0, sensor=""))
    ((run, documents),) = following.new()
    assert (run, [one["t_s"] for one in documents]) == (begun, [0.0, 1.0, 2.0])
    _write(runs, "new", STOP)
    assert following.new() == [(new, [STOP])]
    resumed = [_document("resume", 20.0, missing=1), _event("home", 21.0, controller="")]
    earlier = _write(runs, "earlier", *resumed)
    assert following.new() == [(earlier, resumed)]
    _write(runs, "new", resumed[0])
    assert following.new() == [(new, resumed[:1])]
    assert following.new() == []


def test_each_lsl_time_is_the_journal_time_plus_one_offset_per_part() -> None:
    samples, markers = Outlet(), Outlet()
    offsets = iter([-900.0, -800.0, -700.0])
    streams = RunStreams(samples, markers, lambda: next(offsets))
    late = {**_event("sample", 2.0, force_gwt=1.0), "unix_s": 1002.5}  # interrupted between two clocks
    streams.push(Path("a"), [START, late])
    streams.push(Path("a"), [_event("hold_end", 3.25, index=0)])
    assert samples.pushed == [(102.0, [1.0, *[pytest.approx(math.nan, nan_ok=True)] * 3])]
    assert [at_s for at_s, _ in markers.pushed] == [100.0, 103.25]
    streams.push(Path("a"), [_document("resume", 20.0, missing=1)])
    streams.push(Path("b"), [STOP])
    assert [at_s for at_s, _ in markers.pushed[2:]] == [220.0, 309.0]


def test_every_reading_becomes_an_lsl_sample_and_every_other_event_a_marker() -> None:
    samples, markers = Outlet(), Outlet()
    streams = RunStreams(samples, markers, lambda: 0.0)
    streams.push(Path("a"), [START, *(_event(stream, 1.0) for stream in STREAMS), STOP])
    readings = [stream for stream in STREAMS if stream.endswith("sample")]
    assert len(samples.pushed) == len(readings) == 4
    found = [json.loads(text)["marker"] for _, (text,) in markers.pushed]
    assert found == ["start", *(stream for stream in STREAMS if stream not in readings), "stop"]


def test_an_lsl_sample_has_nan_where_the_journal_has_null() -> None:
    found = sample_of({"force_gwt": 0.25, "doi_mm": None, "x_mm": 1, "phase": "approach"})
    assert list(CHANNELS) == ["force_gwt", "doi_mm", "x_mm", "height_mm"]
    assert found == pytest.approx([0.25, math.nan, 1.0, math.nan], nan_ok=True)


def test_lsl_markers_omit_texts_that_could_name_the_participant() -> None:
    assert json.loads(marker_of(START)) == {"marker": "start", "protocol": "p", "planned_indentations": 1}
    assert json.loads(marker_of(_event("note", 1.0, text="S07 is left-handed"))) == {"marker": "note"}
    hold = {"index": 0, "hold": 1, "force_gwt": 2.33}
    assert json.loads(marker_of(_event("hold_end", 1.0, **hold))) == {"marker": "hold_end", **hold}


def test_rig_stream_without_pylsl_says_what_to_install(
    program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    ended = program("stream", "--out", tmp_path)
    assert (ended.code, ended.out) == (2, "")
    assert "pip install 'indentation-rig[lsl]'" in ended.complaint
