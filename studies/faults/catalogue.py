"""The fault catalogue: each fault, how it strikes, and what must come of it."""

import resource
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rig.devices.units import GWT_N
from studies.faults.faulty_bench import Change, FaultyBench, bad_crc, delayed, framed, lost, once, swapped

GRBL: dict[str, Any] = {}
MODBUS: dict[str, Any] = {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}}


@dataclass(frozen=True)
class Fault:
    """What fails, on which bench, how, and what must come of it: done, lifted, held, or refused before a press."""

    name: str
    outcome: str
    says: str  # a pattern that the reason must hold
    strike: Callable[[FaultyBench], object]
    tables: Mapping[str, Any]


def _press(change: Callable[[FaultyBench], object]) -> Callable[[FaultyBench], object]:
    return lambda bench: bench.after("press", lambda: change(bench))


def _force(change: Change) -> Callable[[FaultyBench], object]:
    return _press(lambda bench: bench.change(bench.force_line, change))


def _stage(change: Change) -> Callable[[FaultyBench], object]:
    return _press(lambda bench: bench.change(bench.stage_line, change))


def _bytes(data: bytes) -> Callable[[FaultyBench], object]:
    """Somebody else writes to the board in the middle of the next move."""
    return lambda bench: bench.clock.call_at(
        bench.clock.monotonic_s() + 0.04, lambda: bench.stage_line.host_write(data)
    )


def _freeze(bench: FaultyBench) -> None:
    frozen = bench.true_n(bench.clock.monotonic_s())
    bench.extra_n = lambda t_s: frozen - bench.true_n(t_s)


def _drift(bench: FaultyBench, gwt_s: float) -> None:
    start_s = bench.clock.monotonic_s()
    bench.extra_n = lambda t_s: gwt_s * GWT_N * max(t_s - start_s, 0.0)


def _stall(bench: FaultyBench) -> None:
    bench.stalled_mm = bench.height_mm


def _feedback_stays(bench: FaultyBench) -> None:
    drive, shown = bench.board.z, bench.board.z._shown
    stays = {n: shown()[n] for n in (0x1014, 0x1015)}
    drive._shown = lambda: shown() | stays


def _full_disk(bench: FaultyBench) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (bench.journal_path.stat().st_size + 100, resource.RLIM_INFINITY))


def _wall_clock_jumps(bench: FaultyBench) -> None:
    unix_s = bench.clock.unix_s
    bench.clock.unix_s = lambda: unix_s() - 3600.0  # type: ignore[method-assign]


def _reset(bench: FaultyBench) -> None:
    bench.clock.call_at(bench.clock.monotonic_s() + 0.06, bench.board.power_cycle)


def _split_status(data: bytes) -> list[bytes]:
    return [data[:9], data[9:]] if data.startswith(b"<") else [data]


SCREW = {"virtual": {"z_screw_steps_per_mm": 460.0}}
COARSE_SCREW = {"virtual": {"z_screw_steps_per_mm": 340.0}}

CATALOGUE = (
    Fault("a lost `ok`", "held", "no answer to 'G", _stage(once(lost(b"ok\r\n"))), GRBL),
    Fault("one garbled status", "done", "", _stage(once(lambda d: [d.replace(b"|MPos:", b"|M\xff\x00s:")])), GRBL),
    Fault(
        "every status garbled",
        "held",
        "holds no machine position|no answer to",
        _stage(lambda d: [d.replace(b"MPos:-", b"MP<s:")]),
        GRBL,
    ),
    Fault("a status in two pieces", "done", "", _stage(_split_status), GRBL),
    Fault("a reset in mid-move", "held", "the board was reset", _press(_reset), GRBL),
    Fault(
        "ALARM:2, then silence",
        "held",
        "alarm 2",
        _press(lambda b: b.stage_line.host_write(b"G53G0Z-500\n")),
        GRBL,
    ),
    Fault("feed at 200 %", "lifted", "feed override 200 %", _press(_bytes(b"\x91" * 10)), GRBL),
    Fault("feed at 10 %", "lifted", "feed override 10 %", _press(_bytes(b"\x92" * 9)), GRBL),
    Fault("rapids at 25 %", "lifted", "rapid override 25 %", _press(_bytes(b"\x97")), GRBL),
    Fault("a hold at the board", "held", "the stage is held, Hold", _press(_bytes(b"!")), GRBL),
    Fault("the safety door", "held", "the stage is held, Door", _press(_bytes(b"\x84")), GRBL),
    Fault("the stage's port unplugged", "held", "stage is closed", _press(lambda b: b.stage_wire.close()), GRBL),
    Fault("the sensor's port unplugged", "lifted", "force is closed", _press(lambda b: b.force_wire.close()), GRBL),
    Fault("answers 0.4 s late", "done", "", _press(lambda b: delayed(b, b.force_line, 0.4)), GRBL),
    Fault("answers 0.6 s late", "lifted", "no answer to SI", _press(lambda b: delayed(b, b.force_line, 0.6)), GRBL),
    Fault(
        "a Modbus exception", "lifted", "exception 4", _force(lambda d: [framed(1, bytes([d[1] | 0x80, 4]))]), MODBUS
    ),
    Fault("one CRC error", "done", "", _force(once(bad_crc)), MODBUS),
    Fault("every CRC wrong", "lifted", "bad CRC", _force(bad_crc), MODBUS),
    Fault("another device answers", "lifted", "device 9 answered", _force(lambda d: [framed(9, d[1:-2])]), MODBUS),
    Fault(
        "words swapped",
        "lifted",
        "above the|range|exceeded",
        lambda b: b.after("clearance", lambda: b.change(b.force_line, swapped)),
        MODBUS,
    ),
    Fault("a frozen reading", "lifted", "the force stays at", _press(_freeze), GRBL),
    Fault("a frozen reading, Modbus", "lifted", "the force stays at", _press(_freeze), MODBUS),
    Fault(
        "a reading that is no number",
        "lifted",
        "garbled answer",
        _force(lambda d: [b"S D        nan g\r\n"]),
        GRBL,
    ),
    Fault("over-range", "lifted", "overloaded", _force(lambda d: [b"S +\r\n"]), GRBL),
    Fault(
        "cell error",
        "lifted",
        "load cell error",
        _press(lambda b: setattr(b, "extra_n", lambda t_s: float("nan"))),
        MODBUS,
    ),
    Fault(
        "tare drift of +0.05 gwt/s",
        "lifted",
        "not lifted: the stage reports",
        _press(lambda b: _drift(b, 0.05)),
        GRBL,
    ),
    Fault(
        "tare drift of −0.05 gwt/s",
        "lifted",
        "not lifted: the stage reports",
        _press(lambda b: _drift(b, -0.05)),
        GRBL,
    ),
    Fault("a motor that stalls", "lifted", "the force stays at", _press(_stall), GRBL),
    Fault("commanded ≠ feedback", "held", "not at", _press(_feedback_stays), MODBUS),
    Fault("a finer screw than believed", "lifted", "no contact", lambda b: None, SCREW),
    Fault("a coarser screw than believed", "lifted", "gwt at clearance", lambda b: None, COARSE_SCREW),
    Fault("a full disk", "lifted", "cannot be written", _press(_full_disk), GRBL),
    Fault("the wall clock jumps back an hour", "done", "", _press(_wall_clock_jumps), GRBL),
    Fault(
        "the machine sleeps for a minute", "held", "heartbeat was lost", _press(lambda b: b.clock.wait_s(60.0)), GRBL
    ),
)
