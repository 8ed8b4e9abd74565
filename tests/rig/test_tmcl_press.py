"""A TMCL stage presses a finger of springs under each force sensor; and what comes of a fault in a press."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.devices.registry import BUILT_IN
from studies.faults.catalogue import Fault
from studies.faults.faulty_bench import TARGET, FaultyBench, delayed, once
from studies.faults.outcomes import bound_gwt, suffer

TMCL: dict[str, Any] = {"stage": {"kind": "tmcl"}}
HELD_TO_GWT = 0.1


def _nothing(bench: FaultyBench) -> None:
    pass


@pytest.mark.parametrize("kind", BUILT_IN["force"])
def test_two_presses_under_each_force_sensor(kind: str, tmp_path: Path) -> None:
    """To the same force as on any other stage."""
    tables = {**TMCL, "force": {"kind": kind, "baud": 115200}}
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


def _bad_bit(data: bytes) -> list[bytes]:
    return [data[:6] + bytes([data[6] ^ 4]) + data[7:]]


FAULTS = (
    Fault("steps lost", "held", "alarm", _in_press(lambda b: b.board.z.stall()), TMCL, {"number": 207}),
    Fault("a short circuit", "held", "alarm", _in_press(lambda b: b.board.z.fail(8)), TMCL, {"number": 208}),
    Fault("the home switch", "held", "alarm", _in_press(lambda b: b.board.z.press("left")), TMCL, {"number": 11}),
    Fault("the far switch", "held", "alarm", _in_press(lambda b: b.board.z.press("right")), TMCL, {"number": 10}),
    Fault("of the other axis", "held", "alarm", _in_press(lambda b: b.board.x.press("right")), TMCL, {"axis": "x"}),
    Fault("power lost", "held", "was_reset", _in_press(lambda b: b.board.power_cycle()), TMCL, {"axis": "z"}),
    Fault("one reply lost", "done", "", _changed(once(lambda data: [] if data[3] == 6 else [data])), TMCL),
    Fault("one wrong bit", "done", "", _changed(once(lambda d: _bad_bit(d) if d[3] == 6 else [d])), TMCL),
    Fault("one reply too many", "done", "", _changed(once(lambda d: [d, d] if d[3] == 6 else [d])), TMCL),
    Fault("a stray byte", "done", "", _changed(once(lambda d: [b"\x02" + d])), TMCL),
    Fault("a reply in two pieces", "done", "", _changed(lambda d: [d[:4], d[4:]]), TMCL),
    Fault("every checksum wrong", "held", "garbled", _changed(_bad_bit), TMCL),
    Fault("silence", "held", "no_reply", _changed(lambda d: []), TMCL, {"port": "stage"}),
    Fault("unplugged", "held", "closed", _in_press(lambda b: b.stage_wire.close()), TMCL, {"port": "stage"}),
    Fault("replies 0.1 s late", "done", "", _in_press(lambda b: delayed(b, b.stage_line, 0.1)), TMCL),
)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_of_the_stage_in_a_press(fault: Fault, tmp_path: Path) -> None:
    found = suffer(fault, tmp_path)
    error = found.ended_by
    assert (found.outcome, "" if error is None else error.code) == (fault.outcome, fault.code), str(error)
    assert dict(fault.fields).items() <= ({} if error is None else error.fields).items()
    assert found.worst_gwt <= bound_gwt()
