"""A Zaber stage presses a finger of springs under each force sensor; and what comes of a fault in a press."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.devices.registry import BUILT_IN
from studies.faults.catalogue import Fault
from studies.faults.faulty_bench import TARGET, FaultyBench, delayed, once
from studies.faults.outcomes import bound_gwt, suffer

ZABER: dict[str, Any] = {"stage": {"kind": "zaber"}}
HELD_TO_GWT = 0.1


def _nothing(bench: FaultyBench) -> None:
    pass


@pytest.mark.quick(rows=lambda kind: kind == "mtsics")  # others: tests/rig/test_same_indentations.py
@pytest.mark.parametrize("kind", BUILT_IN["force"])
def test_two_presses_under_each_force_sensor(kind: str, tmp_path: Path) -> None:
    """To the same force as on any other stage."""
    tables = {**ZABER, "force": {"kind": kind, "baud": 115200}}
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


FAULTS = (
    Fault("stalled and stopped", "held", "alarm", _in_press(lambda b: b.board.z.stall()), ZABER, {"number": "FS"}),
    Fault("recovered", "held", "alarm", _in_press(lambda b: b.board.z.warn("WS")), ZABER, {"number": "WS"}),
    Fault("a limit sensor", "held", "alarm", _in_press(lambda b: b.board.z.fail("WL")), ZABER, {"number": "WL"}),
    Fault("pushed away", "held", "alarm", _in_press(lambda b: b.board.z.warn("WM")), ZABER, {"number": "WM"}),
    Fault("driver off", "held", "alarm", _in_press(lambda b: b.board.z.fail("FO")), ZABER, {"number": "FO"}),
    Fault("power lost", "held", "was_reset", _in_press(lambda b: b.board.power_cycle()), ZABER, {"axis": "z"}),
    Fault("one reply lost", "done", "", _changed(once(lambda data: [])), ZABER),
    Fault("one wrong bit", "done", "", _changed(once(lambda d: [d.replace(b"OK", b"OJ")])), ZABER),
    Fault("a line in two pieces", "done", "", _changed(lambda d: [d[:9], d[9:]]), ZABER),
    Fault("every checksum wrong", "held", "garbled", _changed(lambda d: [d.replace(b" OK", b" OJ")]), ZABER),
    Fault("silence", "held", "no_reply", _changed(lambda d: []), ZABER, {"port": "stage"}),
    Fault("unplugged", "held", "closed", _in_press(lambda b: b.stage_wire.close()), ZABER, {"port": "stage"}),
    Fault("replies 0.1 s late", "done", "", _in_press(lambda b: delayed(b, b.stage_line, 0.1)), ZABER),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_of_the_stage_in_a_press(fault: Fault, tmp_path: Path) -> None:
    found = suffer(fault, tmp_path)
    error = found.ended_by
    assert (found.outcome, "" if error is None else error.code) == (fault.outcome, fault.code), str(error)
    assert dict(fault.fields).items() <= ({} if error is None else error.fields).items()
    assert found.worst_gwt <= bound_gwt()
