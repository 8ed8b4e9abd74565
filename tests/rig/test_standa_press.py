"""A Standa stage presses a finger of springs under each force sensor; and what comes of a fault in a press."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.devices.registry import BUILT_IN
from studies.faults.catalogue import Fault
from studies.faults.faulty_bench import TARGET, FaultyBench, delayed, once
from studies.faults.outcomes import bound_gwt, suffer

STANDA: dict[str, Any] = {"stage": {"kind": "standa"}}
HELD_TO_GWT = 0.1


def _nothing(bench: FaultyBench) -> None:
    pass


@pytest.mark.parametrize("kind", BUILT_IN["force"])
def test_two_presses_under_each_force_sensor(kind: str, tmp_path: Path) -> None:
    """To the same force as on any other stage."""
    tables = {**STANDA, "force": {"kind": kind, "baud": 115200}}
    found = suffer(Fault("none", "done", "", _nothing, tables), tmp_path)
    assert (found.outcome, found.ended_by) == ("done", None)
    events = [json.loads(line) for line in (tmp_path / "events.jsonl").read_text(encoding="utf-8").splitlines()]
    holds = [event["data"] for event in events if (event["doc"], event["stream"]) == ("event", "hold_end")]
    forces = [hold["force_gwt"] for hold in holds]
    assert forces == pytest.approx([TARGET.value] * 2, abs=HELD_TO_GWT)
    assert found.worst_gwt <= TARGET.value + HELD_TO_GWT


def _in_press(act: Callable[[FaultyBench], object]) -> Callable[[FaultyBench], object]:
    return lambda bench: bench.after("press", lambda: act(bench))


def _changed(change: Callable[[bytes], list[bytes]]) -> Callable[[FaultyBench], object]:
    return _in_press(lambda bench: bench.change(bench.stage_line, change))


def _bit(data: bytes) -> list[bytes]:
    """One wrong bit in the payload of a status."""
    return [data[:20] + bytes([data[20] ^ 4]) + data[21:]] if data[:4] == b"gets" else [data]


def _cut(bench: FaultyBench) -> None:
    """Half a command of a stranger: the next one is taken for its end."""
    bench.stage_line.host_write(b"move\x01\x00")


FAULTS = (
    Fault("an alarm", "held", "alarm", _in_press(lambda b: b.board.z.fail(0x800)), STANDA, {"axis": "z"}),
    Fault("lost steps", "held", "alarm", _in_press(lambda b: b.board.z.fail(0x80)), STANDA, {"axis": "z"}),
    Fault("overheated", "held", "alarm", _in_press(lambda b: b.board.x.fail(0x200)), STANDA, {"axis": "x"}),
    Fault("power lost", "held", "was_reset", _in_press(lambda b: b.board.power_cycle()), STANDA, {"axis": "z"}),
    Fault("one reply lost", "done", "", _changed(once(lambda d: [] if d[:4] == b"gets" else [d])), STANDA),
    Fault("one wrong bit", "done", "", _changed(once(_bit)), STANDA),
    Fault("a frame in two pieces", "done", "", _changed(lambda d: [d[:9], d[9:]]), STANDA),
    Fault("every checksum wrong", "held", "garbled", _changed(_bit), STANDA),
    Fault("half a command before", "done", "", _in_press(_cut), STANDA),
    Fault("silence", "held", "no_reply", _changed(lambda d: []), STANDA, {"port": "stage"}),
    Fault("unplugged", "held", "closed", _in_press(lambda b: b.stage_wire.close()), STANDA, {"port": "stage"}),
    Fault("replies 0.1 s late", "done", "", _in_press(lambda b: delayed(b, b.stage_line, 0.1)), STANDA),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_of_the_stage_in_a_press(fault: Fault, tmp_path: Path) -> None:
    found = suffer(fault, tmp_path)
    error = found.ended_by
    assert (found.outcome, "" if error is None else error.code) == (fault.outcome, fault.code), str(error)
    assert dict(fault.fields).items() <= ({} if error is None else error.fields).items()
    assert found.worst_gwt <= bound_gwt()
