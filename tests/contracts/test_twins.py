"""Every twin replies as its byte table, typed from the manual, says: to each question in each state, and command."""

import math
from collections.abc import Iterator, Mapping
from functools import cache

import pytest

from tests.contracts.counted import Bench, bench_of
from tests.contracts.force import UNASKED, ForceBytes
from tests.contracts.force_twin import ForceTwin
from tests.contracts.stage import StageBytes
from tests.contracts.tables import tables

FORCES = {device.name: device for device in tables(ForceBytes)}
STAGES = {device.name: device for device in tables(StageBytes)}
STATES = ("new", "home", "moving", "arrived", "alarm")
"""Those that a twin is in exactly where the table has it."""
WITHIN_S = 1.0


def twin_in(device: StageBytes, state: str) -> Bench:
    """The twin of a controller in a state of its table."""
    bench = bench_of(device.kind, homed=state != "new", stage=dict(device.table))
    if state in ("moving", "arrived", "alarm"):
        _begin_move(bench, device)
    if state == "arrived":
        bench.clock.wait_s(60.0)
    elif state in ("moving", "alarm"):
        _wait_until_under_way(bench, device)
    if state == "alarm":
        assert device.alarmed is not None, (
            f"tests/contracts/bytes: {device.name}: give alarmed, or say in not_on_twin why"
        )
        device.alarmed(bench.devices)
        bench.clock.wait_s(1.0)
    for line in bench.lines:
        line.host_read()
    return bench


@cache
def _frames_of_a_move(name: str) -> list[bytes]:
    """What the driver writes to move from home, the trigger last."""
    device = STAGES[name]
    bench = bench_of(device.kind, stage=dict(device.table))
    next(bench.stage.moving(**device.move))
    port = next(iter(device.ports.values()), b"")
    frames = [data for _, axis, data in bench.sent if axis == "z" or not device.ports]
    last = next(n for n, data in enumerate(frames) if port + device.heard(data) == device.trigger)
    return frames[: last + 1]


def _begin_move(bench: Bench, device: StageBytes, *, trigger: bool = True) -> None:
    *before, last = _frames_of_a_move(device.name)
    for frame in before:
        bench.lines[0].host_write(frame)
        bench.clock.wait_s(0.05)
    if trigger:
        bench.lines[0].host_write(last)
        bench.clock.wait_s(5e-3)


def _wait_until_under_way(bench: Bench, device: StageBytes) -> None:
    """Wait until the carriage is at the count of the table."""
    assert device.under_way is not None
    count = round(device.under_way.z_mm * abs(bench.stage.steps_per_mm("z")))
    early_s = bench.clock.monotonic_s()
    late_s = early_s + 60.0
    while late_s - early_s > 1e-6:
        middle_s = (early_s + late_s) / 2
        there = bench.devices.carriage_steps_at(middle_s)[2] <= count
        early_s, late_s = (early_s, middle_s) if there else (middle_s, late_s)
    bench.clock.wait_s(late_s - bench.clock.monotonic_s())


def exchanges(device: StageBytes, state: str) -> Iterator[tuple[bytes, bytes, Bench]]:
    """What is said in a state, the reply of the table, and the twin in that state.

    What changes nothing, or is undone by the next, is said to one twin, in the order of the table.
    """
    usual = {words: said for words, said in device.usual.items() if words not in device.not_on_twin}
    steady: Bench | None = None
    for words, said in {**(usual if state == "home" else {}), **device.states[state]}.items():
        leads_on = isinstance(said, tuple)
        if leads_on or state in ("moving", "alarm"):
            bench = twin_in(device, state)
        else:
            bench = steady = steady or twin_in(device, state)
        if words == device.trigger:
            _begin_move(bench, device, trigger=False)
        yield words, said[0] if isinstance(said, tuple) else said, bench


def replied(bench: Bench, device: StageBytes, words: bytes, reply: bytes) -> tuple[bytes, bytes]:
    """What the twin replies to words, and what the table says."""
    lines = dict(zip(device.ports.values(), bench.lines, strict=False))
    port = next((port for port in lines if words.startswith(port)), b"")
    line, frame = lines.get(port, bench.lines[0]), device.framed(words.removeprefix(port))
    line.host_read()
    line.host_write(frame)
    bench.clock.wait_s(WITHIN_S)
    return device.alike(line.host_read()), device.alike(device.said(frame, reply) if reply else reply)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("name", STAGES)
def test_a_twin_of_a_stage_replies_as_its_byte_table(name: str, state: str) -> None:
    device, different = STAGES[name], dict[bytes, tuple[bytes, bytes]]()
    if state in device.not_on_twin:
        return
    for words, reply, bench in exchanges(device, state):
        twin, table = replied(bench, device, words, reply)
        if twin != table:
            different[words] = (twin, table)
    assert different == {}


TOO_MUCH_G = 1e7
LOADS_G: Mapping[str, float] = {
    "overload": TOO_MUCH_G,
    "underload": -TOO_MUCH_G,
    "cell error": math.nan,
    "nan": math.nan,
}
"""Under which loads a sensor has no weight."""
SETTLED_S = 3.0


def weighed(device: ForceBytes, grams: float, *, stable: bool = True) -> ForceTwin:
    """The twin of a sensor under a load, which is stable where it lasts for longer than some samples."""
    changes_s = 1000.0 + SETTLED_S
    bench = ForceTwin(device, lambda t_s: grams if stable or t_s > changes_s else grams + 5.0)
    bench.clock.wait_s(changes_s + 0.07 - bench.clock.monotonic_s())
    return bench


def said_by(bench: ForceTwin, device: ForceBytes, question: bytes, reply: bytes) -> tuple[bytes, bytes]:
    """What the twin replies to a question, or sends by itself, and what the table says."""
    frame = device.framed(question)
    table, said = device.alike(device.said(frame, reply)), list[bytes]()
    for data in [*device.on_connect, frame] if question == UNASKED else [frame]:
        bench.line.host_write(data)
    until_s = bench.clock.monotonic_s() + 0.5
    while table not in said and bench.clock.monotonic_s() < until_s:
        bench.clock.wait_s(2e-3)
        said += [device.alike(data) for data in [bench.line.host_read()] if data]
    return table if table in said else b"".join(said), table


@pytest.mark.parametrize("name", FORCES)
def test_a_twin_of_a_sensor_replies_as_its_byte_table(name: str) -> None:
    device = FORCES[name]
    usual = device.usual[device.reading]
    load_g = next(weight.grams for weight in device.weights.values() if weight.reply == usual)
    rows = [
        *((words, words, reply, load_g, True) for words, reply in device.usual.items()),
        *((name, device.reading, one.reply, one.grams, one.stable) for name, one in device.weights.items()),
        *(
            (name, device.reading, one.reply, LOADS_G[name], True)
            for name, one in device.refusals.items()
            if name in LOADS_G
        ),
    ]
    different = {}
    for row, question, reply, grams, stable in rows:
        if row not in device.not_on_twin:
            twin, table = said_by(
                weighed(device, grams, stable=stable or "stable" in device.lacks), device, question, reply
            )
            if twin != table:
                different[row] = (twin, table)
    assert different == {}
