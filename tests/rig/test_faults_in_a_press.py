"""Presses under faults of the stages and the sensor that are not in tests/faults/catalogue.py."""

import itertools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.devices.registry import ForceKind, find
from sim.devices.modbus import RegisterFault
from studies.faults.faulty_bench import TARGET, Change, FaultyBench, bound_gwt, delayed
from tests.error_codes import causes, shows
from tests.faults.catalogue import Fault
from tests.faults.outcomes import suffer

NEAR = {"frame": {"pad_centre_x_mm": -12.0, "apex_z_mm": -12.0}}
"""A short way from the switches, below where a virtual stage begins."""
TMCL: dict[str, Any] = {"stage": {"kind": "tmcl"}, **NEAR}
ZABER: dict[str, Any] = {"stage": {"kind": "zaber"}, **NEAR}
STANDA: dict[str, Any] = {"stage": {"kind": "standa"}, **NEAR}
NET_FT: dict[str, Any] = {"force": {"kind": "net_ft"}, **NEAR}
HELD_TO_GWT = 0.1
APART = 12
"""Messages between two faults."""


def _in_press(act: Callable[[FaultyBench], object]) -> Callable[[FaultyBench], object]:
    return lambda bench: bench.after("press", lambda: act(bench))


def _line(bench: FaultyBench) -> Any:
    return bench.force_line if bench.config.force.kind == "net_ft" else bench.stage_line


def _changed(change: Change) -> Callable[[FaultyBench], object]:
    return _in_press(lambda bench: bench.change(_line(bench), change))


def _bad_bit(data: bytes) -> list[bytes]:
    return [data[:6] + bytes([data[6] ^ 4]) + data[7:]]


def _bad_status(data: bytes) -> list[bytes]:
    return [data[:20] + bytes([data[20] ^ 4]) + data[21:]] if data[:4] == b"gets" else [data]


def _if(kind: Callable[[bytes], bool], change: Change) -> Change:
    return lambda data: change(data) if kind(data) else [data]


def _answers_a_read(data: bytes) -> bool:
    """Of a TMCL module: the answer to GAP."""
    return data[3] == 6


def _tells_a_place(data: bytes) -> bool:
    """Of a Zaber device: the answer to a question, which is repeated."""
    return re.search(rb"(IDLE|BUSY) .. [1-9]", data) is not None


def _events(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "events.jsonl").read_text(encoding="utf-8").splitlines()]


def _is(document: dict[str, Any], kind: str, stream: str) -> bool:
    return (document["doc"], document.get("stream")) == (kind, stream)


# --- what ends nothing ---

HARMLESS: dict[str, tuple[dict[str, Any], tuple[Change, ...]]] = {
    "tmcl": (
        TMCL,
        (
            _if(_answers_a_read, lambda data: []),
            _if(_answers_a_read, _bad_bit),
            _if(_answers_a_read, lambda data: [data, data]),
            lambda data: [b"\x02" + data],
        ),
    ),
    "zaber": (
        ZABER,
        (_if(_tells_a_place, lambda data: []), _if(_tells_a_place, lambda data: [data.replace(b"OK", b"OJ")])),
    ),
    "standa": (STANDA, (_if(lambda data: data[:4] == b"gets", lambda data: []), _bad_status)),
    "net_ft": (NET_FT, (lambda data: [], lambda data: [data[:18]], lambda data: [data, data])),
}
"""Messages that are lost, wrong, doubled or cut, one at a time."""


def _pressed_to_the_same_force(strike: Callable[[FaultyBench], object], tables: dict[str, Any], folder: Path) -> None:
    found = suffer(Fault("harmless", "done", "", strike, tables), folder)
    assert (found.outcome, found.ended_by) == ("done", None)
    forces = [one["data"]["force_gwt"] for one in _events(folder) if _is(one, "event", "hold_end")]
    assert forces == pytest.approx([TARGET.value] * 2, abs=HELD_TO_GWT)
    assert found.worst_gwt <= TARGET.value + HELD_TO_GWT


@pytest.mark.parametrize("kind", HARMLESS)
def test_a_press_survives_an_occasional_wrong_message(kind: str, tmp_path: Path) -> None:
    tables, changes = HARMLESS[kind]
    left, since = list(changes), [0]

    def in_turn(data: bytes) -> list[bytes]:
        since[0] += 1
        if not left or since[0] < APART or (found := left[0](data)) == [data]:
            return [data]
        left.pop(0)
        since[0] = 0
        return found

    _pressed_to_the_same_force(_changed(in_turn), tables, tmp_path)
    assert not left


# --- a device that is busy ---

Now = Callable[[], bool]
"""Whether the next request or answer is refused."""


def _refuses(number: int) -> Callable[[FaultyBench, Now], None]:
    """Registers that refuse reads and writes, which they then do not obey."""

    def strike(bench: FaultyBench, now: Now) -> None:
        leadshine = bench.config.stage.kind == "leadshine"
        for device in (bench.board.x, bench.board.z) if leadshine else (bench.sensor,):
            for name in ("read", "write"):
                setattr(device, name, _or_fault(getattr(device, name), number, now))

    return strike


def _or_fault(obey: Callable[..., Any], number: int, now: Now) -> Callable[..., Any]:
    def refuse_or_obey(*request: Any) -> Any:
        if now():
            raise RegisterFault(number)
        return obey(*request)

    return refuse_or_obey


def _says(reply: bytes) -> Callable[[FaultyBench, Now], None]:
    """A balance that answers so instead of with a weight."""
    return lambda bench, now: bench.change(
        bench.force_line, lambda data: [reply] if data.startswith((b"S S ", b"S D ")) and now() else [data]
    )


Answer = tuple[dict[str, Any], Callable[[FaultyBench, Now], None]]
LAUMAS = {"force": {"kind": "laumas", "baud": 115200}, **NEAR}
MTSICS = {"force": {"kind": "mtsics"}, **NEAR}
LEADSHINE = {"stage": {"kind": "leadshine"}, **NEAR}
BUSY: dict[str, Answer] = {
    "laumas: 6": (LAUMAS, _refuses(6)),
    "laumas: 11": (LAUMAS, _refuses(11)),
    "leadshine: 6": (LEADSHINE, _refuses(6)),
    "mtsics: S I": (MTSICS, _says(b"S I\r\n")),
}
NO_VALUE: dict[str, Answer] = {
    "laumas: 4": (LAUMAS, _refuses(4)),
    "mtsics: S +": (MTSICS, _says(b"S +\r\n")),
    "mtsics: S -": (MTSICS, _says(b"S -\r\n")),
}
"""Answers that are final. All numbers: tests/contracts, tests/rig/test_modbus_master.py."""
everywhere = pytest.mark.parametrize("phase", ["", "clearance", "press"], ids=["in the air", "near", "in contact"])
BUSY_TIMES = 3
"""So often one after the other, as answers are lost."""


def _struck(phase: str, answer: Callable[[FaultyBench, Now], None], now: Now) -> Callable[[FaultyBench], object]:
    """At once, on the way to the finger, or from the first sample of a phase on."""
    if not phase:
        return lambda bench: answer(bench, now)
    return lambda bench: bench.after(phase, lambda: answer(bench, now))


@everywhere
@pytest.mark.parametrize("name", BUSY)
def test_a_press_survives_a_device_that_is_occasionally_busy(name: str, phase: str, tmp_path: Path) -> None:
    tables, answer = BUSY[name]
    asked = itertools.count()

    def now_and_then() -> bool:
        return next(asked) % (APART + BUSY_TIMES) >= APART

    _pressed_to_the_same_force(_struck(phase, answer, now_and_then), tables, tmp_path)
    assert next(asked) > 3 * APART


@everywhere
@pytest.mark.parametrize("name", BUSY | NO_VALUE)
def test_a_device_without_a_value_ends_the_press(name: str, phase: str, tmp_path: Path) -> None:
    """Whether it stays busy or has a final answer; the force is no higher than without a reading."""
    tables, answer = (BUSY | NO_VALUE)[name]
    found = suffer(Fault("no value", "", "", _struck(phase, answer, lambda: True), tables), tmp_path)
    assert found.ended_by is not None
    assert found.worst_gwt <= bound_gwt()
    if "force" in tables:
        assert (found.outcome, found.ended_by.code) == ("lifted", "no_reading")
        code = {"S +": "overload", "S -": "underload"}.get(name.split(": ")[1], "refused")
        assert ("busy" if name in BUSY else code) in causes(found.ended_by)
    else:
        assert "busy" in {found.ended_by.code, *causes(found.ended_by)}


def _late_in_pieces(bench: FaultyBench) -> None:
    if bench.config.force.kind != "net_ft":  # a datagram comes whole
        bench.change(_line(bench), lambda data: [data[:4], data[4:]])
    delayed(bench, _line(bench), 0.1)


@pytest.mark.parametrize("kind", ["tmcl", "net_ft"])
def test_a_press_survives_replies_that_come_late_and_in_pieces(kind: str, tmp_path: Path) -> None:
    found = suffer(Fault("late", "done", "", _in_press(_late_in_pieces), HARMLESS[kind][0]), tmp_path)
    assert (found.outcome, found.ended_by) == ("done", None)
    assert found.worst_gwt <= bound_gwt()


def test_a_press_survives_half_a_command_from_another_program(tmp_path: Path) -> None:
    """A Standa controller takes the next one for its end."""
    _pressed_to_the_same_force(_in_press(lambda b: b.stage_line.host_write(b"move\x01\x00")), STANDA, tmp_path)


# --- what ends a press ---


def _status(word: int) -> Callable[[FaultyBench], object]:
    return _in_press(lambda bench: setattr(bench.sensor, "status", word))


def _silence(data: bytes) -> list[bytes]:
    return []


# Every alarm of a stage: tests/rig/test_tmcl_driver.py and its like; garbled replies and a cut wire: tests/contracts.
FAULTS = {
    "tmcl: steps lost": Fault("", "held", "alarm", _in_press(lambda b: b.board.z.stall()), TMCL, shows=207),
    "tmcl: of x": Fault("", "held", "alarm", _in_press(lambda b: b.board.x.press("right")), TMCL, shows="x axis"),
    "zaber: stalled": Fault("", "held", "alarm", _in_press(lambda b: b.board.z.stall()), ZABER, shows="FS"),
    "zaber: pushed": Fault("", "held", "alarm", _in_press(lambda b: b.board.z.warn("WM")), ZABER, shows="WM"),
    "standa: an alarm": Fault(
        "", "held", "alarm", _in_press(lambda b: b.board.z.fail(0x800)), STANDA, shows="z axis"
    ),
    "standa: of x": Fault("", "held", "alarm", _in_press(lambda b: b.board.x.fail(0x200)), STANDA, shows="x axis"),
    **{
        f"{tables['stage']['kind']}: {name}": Fault("", "held", code, strike, tables, shows)
        for tables in (TMCL, ZABER, STANDA)
        for name, code, strike, shows in (
            ("power lost", "was_reset", _in_press(lambda b: b.board.power_cycle()), "z axis"),
            ("silence", "no_reply", _changed(_silence), "stage"),
        )
    },
    **{
        f"net_ft: {code}": Fault("", "lifted", "no_reading", strike, NET_FT, cause=code)
        for code, strike in (
            ("saturated", _status(0x80020000)),
            ("no_reply", _changed(_silence)),
            ("closed", _in_press(lambda b: b.force_wire.close())),
        )
    },
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_device_fault_in_a_press_ends_it_with_its_code_within_the_force_bound(name: str, tmp_path: Path) -> None:
    fault = FAULTS[name]
    found = suffer(fault, tmp_path)
    assert found.ended_by is not None
    assert (found.outcome, found.ended_by.code) == (fault.outcome, fault.code), str(found.ended_by)
    assert shows(str(found.ended_by), fault.shows)
    assert fault.cause in ("", *causes(found.ended_by))
    assert found.worst_gwt <= bound_gwt()


# --- what a Net F/T journals ---


def test_the_journal_of_a_net_ft_sensor_has_all_axes_and_packet_counts(tmp_path: Path) -> None:
    _pressed_to_the_same_force(lambda bench: None, NET_FT, tmp_path)
    events = _events(tmp_path)
    keys = set(find(ForceKind, "net_ft").also)
    units = next(one["units"] for one in events if _is(one, "descriptor", "sample"))
    assert keys < set(units)
    samples = [one["data"] for one in events if _is(one, "event", "sample")]
    assert all(keys < set(sample) for sample in samples)
    for sample in samples:
        assert sample["fz_n"] == pytest.approx(-sample["force_gwt"] * 9.80665e-3, abs=2e-4)
    assert {sample["packets_lost"] + sample["packets_late"] for sample in samples} == {0}
