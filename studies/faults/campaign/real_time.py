"""The same faults in real time over TCP: devices in a process of their own, the program in another, wires between.

The ports hand every message through the tap of a served world, as on the virtual clock. A command is struck where the
first one of its phase says what it said in the census, any other message at the first one of its shape. The true
force is computed in the devices' process, from the carriage, every 2 ms.
"""

import io
import json
import mmap
import multiprocessing
import struct
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from rig.bench.real import open_bench
from rig.clock import WallClock
from rig.engine import Journal
from rig.engine.bench_memory import BenchMemory
from rig.plan.config import Config
from sim.serve.ports import TcpPort
from sim.serve.real_time_loop import WallScheduler
from studies.faults.campaign.cases import FaultCase, content, is_command, shape
from studies.faults.campaign.faults import FaultyCarriage, cell
from studies.faults.campaign.judge import claim_of, claim_on_record, exemption_of, hidden, true_claim, violations
from studies.faults.campaign.runner import DEFAULTS, about, commit, ended, finished_presses, kept
from studies.faults.campaign.scenarios import SCENARIOS
from studies.faults.campaign.tables import Record
from studies.faults.campaign.world import Message, RememberingBench, World, Worst, config_of, untouched
from studies.posix import forking, os, signal

BENCHES = ("grbl", "tcp")
AT_ONCE = 4
"""Cases at a time: each is a program that mostly waits."""

_TRUTH = struct.Struct("ddd")  # worst force and force now (gwt), mm sideways
_STRUCK, _MEND, _PHASE = 30, 31, 32
_SETTLE_S = 1.0


class Shared:
    """What the program's process tells that of the devices, and hears of it."""

    def __init__(self) -> None:
        self._memory = mmap.mmap(-1, 64)

    @property
    def phase(self) -> str:
        """What the rig is doing."""
        return self._memory[_PHASE:].rstrip(b"\0").decode("ascii")

    @phase.setter
    def phase(self, phase: str) -> None:
        self._memory[_PHASE:] = phase.encode("ascii").ljust(64 - _PHASE, b"\0")

    @property
    def truth(self) -> tuple[float, float, float]:
        """Worst true force and that of now, gwt; mm moved sideways in contact."""
        worst, now, drag = _TRUTH.unpack(self._memory[: _TRUTH.size])
        return worst, now, drag

    @truth.setter
    def truth(self, truth: tuple[float, float, float]) -> None:
        self._memory[: _TRUTH.size] = _TRUTH.pack(*truth)

    def flag(self, which: int) -> bool:
        """Whether it was raised."""
        return self._memory[which] != 0

    def raise_flag(self, which: int) -> None:
        """For the other process."""
        self._memory[which] = 1


class ServedWorld(World):
    """A world on the wall clock, behind TCP ports, with the fault of one case."""

    def __init__(self, case: FaultCase, scheduler: WallScheduler, shared: Shared) -> None:
        self._case, self._shared, self._mended = case, shared, False
        super().__init__(case.bench, scheduler)
        for name, line in self.lines.items():
            self._tap_host(name, line.host_write)
        self.tap = self._strike
        self._tell()

    def _tap_host(self, name: str, send: Callable[[bytes], None]) -> None:
        def tapped(data: bytes) -> None:
            for part in self._messages(data):
                for late_s, piece in self.passed(name, "to", part):
                    self.later(late_s, lambda piece=piece: send(piece))  # type: ignore[misc]

        self.lines[name].host_write = tapped  # type: ignore[method-assign]

    def _messages(self, data: bytes) -> Iterator[bytes]:
        """What came at once: lines, real-time bytes as they were written, or frames of Modbus TCP."""
        if self.config.stage.framing != "tcp":
            yield from data.splitlines(keepends=True)
            return
        while data:
            length = 6 + int.from_bytes(data[4:6], "big") if len(data) >= 6 else len(data)
            yield data[:length]
            data = data[length:]

    def _tell(self) -> None:
        if self._shared.flag(_MEND) and not self._mended:
            self._mended, self.worst, self.felt_n = True, Worst(), self.true_n
            if isinstance(self.mechanics, FaultyCarriage):
                self.mechanics.mend()
        self.phase = self._shared.phase
        self._shared.truth = self.worst.force_gwt, self.true_gwt, self.worst.drag_mm
        self.scheduler.call_at(self.scheduler.monotonic_s() + 0.005, self._tell)

    def _strike(self, message: Message) -> list[tuple[float, bytes]]:
        case = self._case
        if self._shared.flag(_STRUCK) or self._shared.phase != case.phase or not self._meant(message):
            return untouched(message)
        self._shared.raise_flag(_STRUCK)
        if case.fault is not None:
            return case.fault.pieces(message.data)
        if case.mechanics != "none":
            self.mechanics = FaultyCarriage(self, case.mechanics)
        self.felt_n = cell(self, case.cell)
        self.touch_n *= hidden(case.cell)
        return untouched(message)

    def _meant(self, message: Message) -> bool:
        case = self._case
        if case.fault is None:
            return True
        if (message.wire, message.way) != (case.wire, case.way):
            return False
        same = content(message.data) == content(case.data)
        return same if is_command(message) else same or shape(message.data) == shape(case.data)


def _serve(case: FaultCase, shared: Shared, names: "multiprocessing.connection.Connection") -> None:
    scheduler = WallScheduler()
    signal.signal(signal.SIGTERM, lambda number, frame: scheduler.stop())
    world = ServedWorld(case, scheduler, shared)
    ports = {name: TcpPort(scheduler, line, 0) for name, line in world.lines.items()}
    for port in ports.values():
        port.listen()
    names.send({name: port.name for name, port in ports.items()})
    scheduler.run()


class RealPlace:
    """A bench behind ports, for a scenario."""

    def __init__(self, config: Config, shared: Shared) -> None:
        self.config, self._shared, self.clock = config, shared, WallClock()
        self.verb = ""
        self.journal: Journal | None = None
        self.folder: Path | None = None

    @property
    def phase(self) -> str:
        """What the rig is doing."""
        return self._shared.phase

    @phase.setter
    def phase(self, phase: str) -> None:
        self._shared.phase = phase

    def connected(self, *, moves: bool = True) -> RememberingBench:
        """Another program's, which says that it moves."""
        return open_bench(self.config, self.clock, io.StringIO(), ask=lambda request: "")


def one(case: FaultCase, folder: Path) -> Record:
    """Carry a case out in real time; takes as long as it takes a rig."""
    os.environ["RIG_STATE_DIR"] = os.environ["RIG_RUNTIME_DIR"] = str(folder)
    shared, context = Shared(), forking()
    here, there = context.Pipe()
    devices = context.Process(target=_serve, args=(case, shared, there), daemon=True)
    devices.start()
    try:
        return _judged(case, RealPlace(config_of(case.bench, here.recv()), shared), shared, folder / "run")
    finally:
        devices.terminate()
        devices.join()


def _judged(case: FaultCase, place: RealPlace, shared: Shared, run: Path) -> Record:
    scenario = next(scenario for scenario in SCENARIOS if scenario.name == case.scenario)
    finished = ended(lambda: scenario.play(place, run))
    time.sleep(_SETTLE_S)
    worst_gwt, left_gwt, drag_mm = shared.truth
    claim, on_record = claim_of(finished.at), claim_on_record(BenchMemory(place.config).read())
    record: Record = {
        **DEFAULTS,
        **about(case),
        "met": shared.flag(_STRUCK),
        "exit": finished.exit,
        "reason": finished.reason[:300],
        "claim": claim,
        "report_true": true_claim(claim, left_gwt, case.cell),
        "on_record": on_record,
        "record_true": true_claim(on_record, left_gwt, case.cell),
        "worst_gwt": round(worst_gwt, 3),
        "drag_mm": round(drag_mm, 4),
        "left_gwt": round(left_gwt, 3),
    }
    before = finished_presses(run)
    shared.raise_flag(_MEND)
    time.sleep(0.1)
    if finished.exit != "done":
        again = ended(lambda: scenario.take_up(place, run))
        record |= {"resumed": again.exit == "done", "resume_reason": again.reason[:200]}
        record["resume_worst_gwt"] = round(shared.truth[0], 3)
    record |= kept(run, before)
    record["violations"] = violations(record)
    exemption = exemption_of(record)
    record["exempt"] = None if exemption is None else exemption.name
    return record


def carry_out(cases: Sequence[FaultCase], out: Path, load: int, say: Callable[[str], None] = print) -> None:
    """Carry cases out, some at a time, beside so many processes that never rest; records are appended to `out`."""
    commit()
    left, running, over = list(cases), dict[int, float](), 0
    with busy(load):
        while left or running:
            while left and len(running) < AT_ONCE:
                running[_begun(left.pop(0), out)] = time.monotonic()
            child, _ = os.wait()
            if running.pop(child, None) is not None:
                over += 1
                say(f"{over} of {len(cases)}")


def _begun(case: FaultCase, out: Path) -> int:
    child: int = os.fork()
    if child == 0:
        try:
            with ExitStack() as stack:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
                record = one(case, folder)
                with out.open("a", encoding="ascii") as file:
                    file.write(json.dumps(record) + "\n")
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(0)
    return child


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """So many others that never rest."""
    others = []
    for _ in range(processes):
        child = os.fork()
        if child == 0:
            while os.getppid() != 1:
                pass
            os._exit(0)
        others.append(child)
    try:
        yield
    finally:
        for child in others:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
