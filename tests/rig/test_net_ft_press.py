"""An ATI Net F/T under a finger of springs: the journal of two presses, and what comes of a fault in a press."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.devices.registry import ForceKind, find
from studies.faults.catalogue import Fault
from studies.faults.faulty_bench import TARGET, FaultyBench, delayed, once
from studies.faults.outcomes import bound_gwt, suffer

NET_FT: dict[str, Any] = {"force": {"kind": "net_ft"}}
HELD_TO_GWT = 0.1


def _nothing(bench: FaultyBench) -> None:
    pass


def _in_press(act: Callable[[FaultyBench], object]) -> Callable[[FaultyBench], object]:
    return lambda bench: bench.after("press", lambda: act(bench))


def _changed(change: Callable[[bytes], list[bytes]]) -> Callable[[FaultyBench], object]:
    return _in_press(lambda bench: bench.change(bench.force_line, change))


def _status(word: int) -> Callable[[FaultyBench], object]:
    return _in_press(lambda bench: setattr(bench.sensor, "status", word))


def _events(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines()]


def _is(document: dict[str, Any], kind: str, stream: str) -> bool:
    return (document["doc"], document.get("stream")) == (kind, stream)


def test_the_journal_has_all_axes_and_the_counts_of_packets(tmp_path: Path) -> None:
    found = suffer(Fault("none", "done", "", _nothing, NET_FT), tmp_path)
    assert (found.outcome, found.ended_by) == ("done", None)
    events = _events(tmp_path)
    holds = [one["data"]["force_gwt"] for one in events if _is(one, "event", "hold_end")]
    assert holds == pytest.approx([TARGET.value] * 2, abs=HELD_TO_GWT)
    keys = set(find(ForceKind, "net_ft").also)
    units = next(one["units"] for one in events if _is(one, "descriptor", "sample"))
    assert keys < set(units)
    samples = [one["data"] for one in events if _is(one, "event", "sample")]
    assert all(keys < set(sample) for sample in samples)
    for sample in samples:
        assert sample["fz_n"] == pytest.approx(-sample["force_gwt"] * 9.80665e-3, abs=2e-4)
    assert {sample["packets_lost"] + sample["packets_late"] for sample in samples} == {0}


def test_other_sensors_journal_what_they_did(tmp_path: Path) -> None:
    suffer(Fault("none", "done", "", _nothing, {}), tmp_path)
    units = next(
        one["units"] for one in _events(tmp_path) if (one["doc"], one.get("stream")) == ("descriptor", "sample")
    )
    assert not set(find(ForceKind, "net_ft").also) & set(units)


FAULTS = (
    Fault("saturated", "lifted", "no_reading", _status(0x80020000), NET_FT, {"error_code": "saturated"}),
    Fault("monitor", "lifted", "no_reading", _status(0x80010000), NET_FT, {"error_code": "monitor_condition"}),
    Fault("watchdog", "lifted", "no_reading", _status(0x80004000), NET_FT, {"error_code": "sensor_error"}),
    Fault("silence", "lifted", "no_reading", _changed(lambda d: []), NET_FT, {"error_code": "no_reply"}),
    Fault("half records", "lifted", "no_reading", _changed(lambda d: [d[:18]]), NET_FT, {"error_code": "garbled"}),
    Fault("one record lost", "done", "", _changed(once(lambda d: [])), NET_FT),
    Fault("every record twice", "done", "", _changed(lambda d: [d, d]), NET_FT),
    Fault("half a record once", "done", "", _changed(once(lambda d: [d[:18]])), NET_FT),
    Fault("unplugged", "lifted", "no_reading", _in_press(lambda b: b.force_wire.close()), NET_FT,
          {"error_code": "closed"}),
    Fault("records 0.1 s late", "done", "", _in_press(lambda b: delayed(b, b.force_line, 0.1)), NET_FT),
)  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_of_the_sensor_in_a_press(fault: Fault, tmp_path: Path) -> None:
    found = suffer(fault, tmp_path)
    error = found.ended_by
    assert (found.outcome, "" if error is None else error.code) == (fault.outcome, fault.code), str(error)
    assert dict(fault.fields).items() <= ({} if error is None else error.fields).items()
    assert found.worst_gwt <= bound_gwt()
