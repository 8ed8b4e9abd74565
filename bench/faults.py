"""The fault catalogue: what the rig does when a wire, a device or the machine under it fails, on real bytes.

    .venv/bin/python bench/faults.py        # the table of docs/faults.md

Each fault strikes an indentation to 8 gwt on a finger of springs, at its first move in contact, or later in its hold.
Drivers, wire and virtual devices are those of a dry-run; bytes are lost, changed or delayed between them.
"""

import json
import resource
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pymodbus.framer import FramerRTU

from rig.devices.bench import force_driver, stage_driver
from rig.devices.force.base import ForceError
from rig.devices.heartbeat import Heartbeat
from rig.devices.stage.base import StageError
from rig.devices.units import GWT_N
from rig.engine import Engine, EngineError, Journal, Target, indent
from rig.engine.stopping import Stopping
from rig.engine.streams import STREAMS
from rig.plan.config import Config
from rig.session.rehearsal import Spring
from rig.transport import LoopbackTransport, TransportError
from rig.virtual.virtual_devices import FORCES, STAGES, true_carriage
from sim.devices.cell import Load
from sim.devices.clock import VirtualClock
from sim.devices.line import SerialLine

TARGET = Target("force_gwt", 8.0)
PREDICTED = Spring(contact_mm=-0.3, doi_mm=1.0, force_n=10 * GWT_N, exponent=1.5)
SOFT_TRIP_N = 2 * TARGET.value * GWT_N
GRBL: dict[str, Any] = {}
MODBUS: dict[str, Any] = {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}}
LOOK_S = 0.002

Change = Callable[[bytes], list[bytes]]


class FaultyBench:
    """A finger of springs under real drivers; what the devices send can be changed on its way."""

    def __init__(self, folder: Path, tables: Mapping[str, Any]) -> None:
        self.config = config = Config.model_validate(tables)
        self.clock = clock = VirtualClock(1.7e9)
        self.stage_line, self.force_line = SerialLine(clock, config.stage.baud), SerialLine(clock, config.force.baud)
        self.board: Any = STAGES[config.stage.kind](clock, self.stage_line, config)
        self.carriage = true_carriage(self.board, config)
        self.extra_n: Callable[[float], float] = lambda t_s: 0.0
        self.stalled_mm: float | None = None
        load = Load(lambda t_s: self.true_n(t_s) + self.extra_n(t_s))
        self.sensor: Any = FORCES[config.force.kind](clock, self.force_line, config, load)
        self.stage_wire = LoopbackTransport(self.stage_line, clock, "stage")
        self.force_wire = LoopbackTransport(self.force_line, clock, "force")
        stage = stage_driver(lambda _: self.stage_wire, clock, config)
        force = force_driver(lambda _: self.force_wire, clock, config)
        self.on_sample: dict[str, Callable[[], object]] = {}
        self.journal_path = folder / "events.jsonl"
        self.journal = Journal(self.journal_path, clock, STREAMS, self._watch)
        self.heartbeat = Heartbeat(clock)
        self.engine = Engine(
            config, clock, stage, force, self.journal, self, soft_trip_n=SOFT_TRIP_N, heartbeat=self.heartbeat
        )
        self.worst_n = 0.0
        self._look()

    def mount(self, indentor: str) -> str:
        """Whatever is asked for."""
        return indentor

    def confirm(self, request: str) -> None:
        """Nobody is here."""

    def true_pose(self) -> None:
        """Not needed."""

    @property
    def height_mm(self) -> float:
        """Where the carriage really is."""
        return self.carriage.pose_at(self.clock.monotonic_s()).above_apex_mm

    def true_n(self, t_s: float) -> float:
        """What the finger really feels."""
        height = self.carriage.pose_at(t_s).above_apex_mm
        return PREDICTED.force_at(height if self.stalled_mm is None else max(height, self.stalled_mm))

    def after(self, phase: str, act: Callable[[], object]) -> None:
        """Do it once, when the first sample of this phase is on disk."""
        self.on_sample[phase] = act

    def change(self, line: SerialLine, change: Change) -> None:
        """From now on what the device sends goes through this."""
        send = line.device_write
        line.device_write = lambda data: [send(part) for part in change(data)] and None  # type: ignore[method-assign]

    def _look(self) -> None:
        now_s = self.clock.monotonic_s()
        self.worst_n = max(self.worst_n, self.true_n(now_s))
        self.heartbeat.look()
        self.clock.call_at(now_s + LOOK_S, self._look)

    def _watch(self, stream: str, data: Mapping[str, Any]) -> None:
        act = self.on_sample.pop(data["phase"], None) if stream == "sample" else None
        if act is not None:
            act()


# --- what is done to the bytes ---


def once(change: Change) -> Change:
    """The first time only that it makes a difference."""
    done: list[bool] = []

    def changed(data: bytes) -> list[bytes]:
        if done:
            return [data]
        found = change(data)
        if found != [data]:
            done.append(True)
        return found

    return changed


def lost(what: bytes) -> Change:
    """These bytes never arrive."""
    return lambda data: [data.replace(what, b"")]


def framed(device_id: int, content: bytes) -> bytes:
    """An RTU frame with a right CRC."""
    body = bytes([device_id]) + content
    return body + FramerRTU.compute_CRC(body).to_bytes(2, "big")


def bad_crc(data: bytes) -> list[bytes]:
    """Its last byte changed."""
    return [data[:-1] + bytes([data[-1] ^ 0x55])]


def swapped(data: bytes) -> list[bytes]:
    """Registers of a weight low word first: the answer to a read of registers 6 to 13."""
    if data[1] != 3 or data[2] != 16:
        return [data]
    words = [data[n : n + 2] for n in range(3, 19, 2)]
    for high in (1, 3, 5):
        words[high], words[high + 1] = words[high + 1], words[high]
    return [framed(data[0], data[1:3] + b"".join(words))]


def delayed(bench: FaultyBench, line: SerialLine, seconds: float) -> None:
    """Every answer comes so much later."""
    send = line.device_write
    line.device_write = lambda data: (
        bench.clock.call_at(  # type: ignore[method-assign]
            bench.clock.monotonic_s() + seconds, lambda: send(data)
        )
        and None
    )


# --- the catalogue ---


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
    Fault("a lost `ok`", "held", "no answer to 'G53", _stage(once(lost(b"ok\r\n"))), GRBL),
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
    Fault("tare drift of +0.05 gwt/s", "lifted", "gwt at clearance", _press(lambda b: _drift(b, 0.05)), GRBL),
    Fault("tare drift of −0.05 gwt/s", "lifted", "gwt at clearance", _press(lambda b: _drift(b, -0.05)), GRBL),
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


@dataclass(frozen=True)
class Found:
    """What came of a fault."""

    outcome: str
    reason: str
    state: str
    worst_gwt: float
    journalled: int  # whole lines


def bound_gwt() -> float:
    """The soft trip, and what the worst increment may add."""
    trip_gwt = SOFT_TRIP_N / GWT_N
    return trip_gwt + Stopping.of(Config(), 1.0).overshoot_gwt(trip_gwt, PREDICTED.force_n / GWT_N, PREDICTED.doi_mm)


@contextmanager
def _file_sizes_restored() -> Iterator[None]:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def suffer(fault: Fault, folder: Path) -> Found:
    """Two indentations, the fault in the first."""
    bench = FaultyBench(folder, fault.tables)
    reason = ""
    with ExitStack() as stack:
        stack.enter_context(_file_sizes_restored())
        stack.callback(lambda: bench.journal._file.close())
        try:
            _two_presses(bench, fault)
        except (EngineError, StageError, ForceError, TransportError) as error:
            reason = str(error)
    lifted = bench.height_mm > PREDICTED.contact_mm + 1.0
    outcome = "done" if not reason else "lifted" if lifted else "held"
    lines = bench.journal_path.read_bytes().split(b"\n")
    assert lines[-1] == b"", "a torn line"
    documents = [json.loads(line) for line in lines[:-1]]
    return Found(outcome, reason, bench.engine.state.value, bench.worst_n / GWT_N, len(documents))


def _two_presses(bench: FaultyBench, fault: Fault) -> None:
    engine = bench.engine
    engine.mount("bar:3.0")
    engine.home()
    engine.zero()
    fault.strike(bench)
    for x_mm in (0.0, 0.5):
        engine.move_to(x_mm)
        indent(engine, TARGET, hold_s=0.5, expected_contact_mm=PREDICTED.contact_mm)


def main() -> None:
    """Print the table."""
    print(
        f"| fault | what happens | the engine is then | worst force (gwt, of {bound_gwt():.2f}) |\n|---|---|---|---|"
    )
    for fault in CATALOGUE:
        with tempfile.TemporaryDirectory() as folder:
            found = suffer(fault, Path(folder))
        reason = found.reason.replace(folder, "…").replace("|", "\\|") or "the run goes on"
        print(f"| {fault.name} | {found.outcome}: {reason} | {found.state} | {found.worst_gwt:.2f} |")


if __name__ == "__main__":
    main()
