"""The fault catalogue: each fault, how it strikes, and what must come of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rig.units import GWT_N
from studies.faults.faulty_bench import Change, FaultyBench, bad_crc, delayed, framed, lost, once, swapped
from studies.posix import resource

GRBL: dict[str, Any] = {}
MODBUS: dict[str, Any] = {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}}


@dataclass(frozen=True)
class Fault:
    """What fails, on which bench, how, and what must come of it: done, lifted, held, or refused before a press."""

    name: str
    outcome: str
    code: str  # of the error that ends it
    strike: Callable[[FaultyBench], object]
    tables: Mapping[str, Any]
    shows: object = ""  # in its sentence
    cause: str = ""  # code of an error that led to it


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
    Fault("a lost `ok`", "held", "no_reply", _stage(once(lost(b"ok\r\n"))), GRBL, shows="stage"),
    Fault("one garbled status", "done", "", _stage(once(lambda d: [d.replace(b"|MPos:", b"|M\xff\x00s:")])), GRBL),
    Fault(
        "every status garbled",
        "held",
        "no_status",
        _stage(lambda d: [d.replace(b"MPos:-", b"MP<s:")]),
        GRBL,
        shows="stage",
    ),
    Fault("a status in two pieces", "done", "", _stage(_split_status), GRBL),
    Fault("a reset in mid-move", "held", "was_reset", _press(_reset), GRBL),
    Fault(
        "ALARM:2, then silence",
        "held",
        "alarm",
        _press(lambda b: b.stage_line.host_write(b"G53G0Z-500\n")),
        GRBL,
        shows=2,
    ),
    Fault("feed at 200 %", "lifted", "overridden", _press(_bytes(b"\x91" * 10)), GRBL, shows=200),
    Fault("feed at 10 %", "lifted", "overridden", _press(_bytes(b"\x92" * 9)), GRBL, shows=10),
    Fault("rapids at 25 %", "lifted", "overridden", _press(_bytes(b"\x97")), GRBL, shows=25),
    Fault("a hold at the board", "held", "held", _press(_bytes(b"!")), GRBL, shows="Hold:0"),
    Fault("the safety door", "held", "held", _press(_bytes(b"\x84")), GRBL, shows="Door:0"),
    Fault(
        "the stage's port unplugged",
        "held",
        "closed",
        _press(lambda b: b.stage_wire.close()),
        GRBL,
        shows="stage",
    ),
    Fault(
        "the sensor's port unplugged",
        "lifted",
        "no_reading",
        _press(lambda b: b.force_wire.close()),
        GRBL,
        cause="closed",
    ),
    Fault("answers 0.4 s late", "done", "", _press(lambda b: delayed(b, b.force_line, 0.4)), GRBL),
    Fault(
        "answers 0.6 s late",
        "lifted",
        "no_reading",
        _press(lambda b: delayed(b, b.force_line, 0.6)),
        GRBL,
        cause="no_reply",
    ),
    Fault(
        "a Modbus exception",
        "lifted",
        "no_reading",
        _force(lambda d: [framed(1, bytes([d[1] | 0x80, 4]))]),
        MODBUS,
        cause="refused",
    ),
    Fault("one CRC error", "done", "", _force(once(bad_crc)), MODBUS),
    Fault("every CRC wrong", "lifted", "no_reading", _force(bad_crc), MODBUS, cause="garbled"),
    Fault(
        "another device answers",
        "lifted",
        "no_reading",
        _force(lambda d: [framed(9, d[1:-2])]),
        MODBUS,
        cause="garbled",
    ),
    Fault(
        "words swapped",
        "lifted",
        "hard_trip",
        lambda b: b.after("clearance", lambda: b.change(b.force_line, swapped)),
        MODBUS,
    ),
    Fault("a frozen reading", "lifted", "frozen", _press(_freeze), GRBL),
    Fault("a frozen reading, Modbus", "lifted", "frozen", _press(_freeze), MODBUS),
    Fault(
        "a reading that is no number",
        "lifted",
        "no_reading",
        _force(lambda d: [b"S D        nan g\r\n"]),
        GRBL,
        cause="garbled",
    ),
    Fault("over-range", "lifted", "no_reading", _force(lambda d: [b"S +\r\n"]), GRBL, cause="overload"),
    Fault(
        "cell error",
        "lifted",
        "no_reading",
        _press(lambda b: setattr(b, "extra_n", lambda t_s: float("nan"))),
        MODBUS,
        cause="cell_error",
    ),
    Fault(
        "tare drift of +0.05 gwt/s",
        "lifted",
        "not_lifted",
        _press(lambda b: _drift(b, 0.05)),
        GRBL,
        shows="the motor may have stalled",
    ),
    Fault(
        "tare drift of −0.05 gwt/s",
        "lifted",
        "not_lifted",
        _press(lambda b: _drift(b, -0.05)),
        GRBL,
        shows="the motor may have stalled",
    ),
    Fault("a motor that stalls", "lifted", "frozen", _press(_stall), GRBL),
    Fault("commanded ≠ feedback", "held", "not_there", _press(_feedback_stays), MODBUS, shows="z axis"),
    Fault("a finer screw than believed", "lifted", "no_contact", lambda b: None, SCREW),
    Fault("a coarser screw than believed", "lifted", "touch_at_clearance", lambda b: None, COARSE_SCREW),
    Fault("a full disk", "lifted", "cannot_be_written", _press(_full_disk), GRBL),
    Fault("the wall clock jumps back an hour", "done", "", _press(_wall_clock_jumps), GRBL),
    Fault("the machine sleeps for a minute", "held", "heartbeat_lost", _press(lambda b: b.clock.wait_s(60.0)), GRBL),
)
