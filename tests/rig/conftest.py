"""A wire whose other end is a list of bytes: [(sent, reply), ...], and a bench whose finger is a spring."""

import io
import json
import shutil
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.bench.served import ServedBench
from rig.data import Run
from rig.data.events import STREAMS
from rig.devices.make_drivers import force_driver, stage_driver
from rig.engine import Engine, Journal, Pause, verbs
from rig.engine.bench import Meanwhile
from rig.plan.config import Config
from rig.plan.nerve import MeasureTable, Visits
from rig.settings import RigSettings
from rig.transport import LoopbackTransport
from rig.transport.wire import LoggedTransport
from rig.units import GWT_N
from sim.devices import Load, SerialLine, VirtualBalance, VirtualGrbl
from sim.devices.clock import VirtualClock
from sim.finger_process import FingerProcess
from sim.measures.measures import MEASURES
from sim.models.fingertip import Fingertip
from sim.nerve.population import AfferentPopulation
from tests.confirmed_moves import Confirmed, confirmed_moves
from tests.program import Program, program_of
from tests.waiting import DEADLINE_S

Pair = tuple[bytes, bytes | list[bytes]]


@pytest.fixture(autouse=True)
def _finger_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """A real run asks a finger in a process of its own, which takes seconds to begin; here it is asked in this one.

    Programs in processes of their own are as they are, and tests/sim/test_finger_process.py asks a real one.
    """
    fingers: dict[int, Fingertip] = {}

    def ask(process: FingerProcess, function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        finger = fingers.get(id(process)) or fingers.setdefault(id(process), Fingertip.load(process._config))
        return function(finger, *arguments, **options)

    monkeypatch.setattr(FingerProcess, "_begin", lambda process: None)
    monkeypatch.setattr(FingerProcess, "ask", ask)


@pytest.fixture
def cheap_measures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Presses whose strain energy density is that under a bar, roughly, at no cost."""

    def tables(run: Run, found: Visits, finger: Fingertip, afferents: AfferentPopulation, told: object) -> Any:
        depths = np.linspace(0.05, 0.6, 12)
        x_mm = np.array([one.x_mm + organ[0] for one in afferents for organ in one.organs_mm])
        near = {place: np.exp(-0.1 * (x_mm - place[1]) ** 2)
                for place in {visit.place for visit in found.visits}}  # fmt: skip
        return {
            place: MeasureTable(depths, np.array([
                afferents.measure(dict.fromkeys(MEASURES, 120 * depth ** 2 * share)) for depth in depths
            ]))
            for place, share in near.items()
        }  # fmt: skip

    monkeypatch.setattr("rig.plan.nerve.tables_of", tables)


class ScriptedTransport:
    """Expects each `sent` in turn and then offers its reply, in one chunk or in the chunks of a list."""

    name = "scripted"

    def __init__(self, clock: VirtualClock, script: list[Pair]) -> None:
        self.clock = clock
        self.script = deque(script)
        self.sent = b""
        self.chunks: deque[bytes] = deque()
        self.closed = False
        self._offer_unasked()

    def write(self, data: bytes) -> None:
        assert self.script, f"{data!r} sent past the end of the script"
        self.sent += data
        expected, reply = self.script[0]
        assert expected.startswith(self.sent), f"sent {self.sent!r}, expected {expected!r}"
        if self.sent == expected:
            self.script.popleft()
            self.sent = b""
            self._offer(reply)
            self._offer_unasked()

    def read(self, timeout_s: float) -> bytes:
        if self.chunks:
            return self.chunks.popleft()
        self.clock.wait_s(timeout_s)
        return b""

    def close(self) -> None:
        self.closed = True

    def _offer_unasked(self) -> None:
        while self.script and not self.script[0][0]:
            self._offer(self.script.popleft()[1])

    def _offer(self, reply: bytes | list[bytes]) -> None:
        self.chunks.extend([reply] if isinstance(reply, bytes) else reply)


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What benches are remembered by is each test's own: ports of the same name come again."""
    monkeypatch.setenv("RIG_STATE_DIR", str(tmp_path / "state"))


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def scripted(clock: VirtualClock) -> Iterator[Callable[[list[Pair]], ScriptedTransport]]:
    """Make a scripted transport; at the end of the test its script must be used up."""
    made: list[ScriptedTransport] = []

    def make(script: list[Pair]) -> ScriptedTransport:
        made.append(ScriptedTransport(clock, script))
        return made[-1]

    yield make
    for transport in made:
        assert not transport.script, f"never sent: {transport.script[0][0]!r}"


class SpringBench:
    """Engine, drivers, wire and virtual devices; the finger is F = k d^1.5 below contact_mm, so it costs nothing.

    contact_mm is the height of first contact above the nominal apex. `on_event` sees every event once it is on
    disk; `interrupt` is what the engine asks at its safe points.
    """

    virtual = False

    def __init__(
        self,
        folder: Path,
        *,
        settings: RigSettings | None = None,
        k_gwt: float = 6.0,
        contact_mm: float = -0.3,
        soft_trip_n: float | None = None,
    ) -> None:
        self.settings = RigSettings() if settings is None else settings
        self.k_gwt, self.contact_mm = k_gwt, contact_mm
        self.clock = VirtualClock(1.7e9)
        self.stage_line, self.force_line = SerialLine(self.clock, 115200), SerialLine(self.clock, 9600)
        self.board = VirtualGrbl(self.clock, self.stage_line)
        self.balance = VirtualBalance(self.clock, self.force_line, Load(lambda t_s: self.force_n(t_s)))
        self.wire = io.StringIO()
        self.events: list[tuple[str, dict[str, Any]]] = []
        self.on_event: Callable[[str, Mapping[str, Any]], None] = lambda stream, data: None
        self.interrupt: Callable[[], bool] = lambda: False
        self.mounted: str | None = None
        self.journal_path = folder / "events.jsonl"
        self.journal = Journal(self.journal_path, self.clock, STREAMS, self._watch, self.witness, virtual=True)
        self.stage = stage_driver(lambda _: self._logged(self.stage_line, "stage"), self.clock, self.settings)
        self.force = force_driver(lambda _: self._logged(self.force_line, "force"), self.clock, self.settings)
        self.operator, self.pause = self, Pause(lambda: self.interrupt())
        self.engine = Engine(self.settings, self, self.journal, soft_trip_n)

    def mount(self, indentor: str, meanwhile: Meanwhile) -> str:
        self.mounted = indentor
        return indentor

    def true_pose(self) -> tuple[float, float]:
        x, _, z = self.board.carriage_steps_at(self.clock.monotonic_s())
        frame = self.settings.frame
        return x / 400 - frame.pad_centre_x_mm, self.contact_mm - (z / 400 - frame.apex_z_mm)

    def witness(self, stream: str, data: Mapping[str, Any]) -> dict[str, float]:
        """The truth at a touch and at the end of a hold, as a virtual bench has it."""
        x_mm, doi_mm = self.true_pose()
        if stream.endswith("hold_end"):
            return {"true_x_mm": round(x_mm, 9), "true_doi_mm": round(doi_mm, 9)}
        return {"true_doi_bias_mm": round(doi_mm - data["doi_mm"], 6)} if stream.endswith("touch") else {}

    def force_n(self, t_s: float) -> float:
        height = self.board.carriage_steps_at(t_s)[2] / 400 - self.settings.frame.apex_z_mm
        return float(self.k_gwt * max(self.contact_mm - height, 0.0) ** 1.5 * GWT_N)

    def ready(self, x_mm: float = 0.0) -> Engine:
        """Mounted, homed, zeroed and over x."""
        verbs.mount(self.engine, "bar:3.0")
        verbs.home(self.engine)
        verbs.zero(self.engine)
        verbs.move_to(self.engine, x_mm)
        return self.engine

    def of(self, stream: str) -> list[dict[str, Any]]:
        """The events of one stream so far."""
        return [data for name, data in self.events if name == stream]

    def sent(self, port: str) -> list[tuple[float, bytes]]:
        """What the host wrote to one port, with the time."""
        chunks = map(json.loads, self.wire.getvalue().splitlines())
        return [(c["t_s"], bytes.fromhex(c["hex"])) for c in chunks if c["port"] == port and c["dir"] == "tx"]

    def moves(self) -> list[dict[str, float]]:
        """Every move that the board was told, in machine mm by axis, and its feed as F."""
        return [{**move.target_mm, "F": move.feed} for move in self.confirmed()]

    def confirmed(self) -> list[Confirmed]:
        """Every move that the board was told."""
        chunks = map(json.loads, self.wire.getvalue().splitlines())
        return confirmed_moves((c["t_s"], c["dir"], bytes.fromhex(c["hex"])) for c in chunks if c["port"] == "stage")

    @property
    def height_mm(self) -> float:
        """Where the carriage really is."""
        z = self.board.carriage_steps_at(self.clock.monotonic_s())[2] / 400
        return z - self.settings.frame.apex_z_mm

    def _watch(self, stream: str, data: Mapping[str, Any]) -> None:
        self.events.append((stream, dict(data)))
        self.on_event(stream, data)

    def _logged(self, line: SerialLine, name: str) -> LoggedTransport:
        return LoggedTransport(LoopbackTransport(line, self.clock, name), self.clock, self.wire)


@pytest.fixture
def spring(tmp_path: Path) -> Iterator[Callable[..., SpringBench]]:
    """Make a spring bench."""
    made: list[SpringBench] = []

    def make(**options: Any) -> SpringBench:
        folder = tmp_path / f"bench{len(made)}"
        folder.mkdir()
        made.append(SpringBench(folder, **options))
        return made[-1]

    yield make
    for bench in made:
        bench.journal.close()


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Program:
    """Run the program in this process."""
    return program_of(monkeypatch, capsys)


@pytest.fixture(scope="module")
def _made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("made")


@pytest.fixture
def made_once(_made: Path, tmp_path: Path) -> Callable[[str, Callable[[], object]], Path]:
    """Have the only run of a kind in ./runs, which make() makes for whoever asks first: made_once(kind, make).

    All others of the file get a copy.
    """

    def once(kind: str, make: Callable[[], object]) -> Path:
        kept, runs = _made / kind, tmp_path / "runs"
        if kept.exists():
            shutil.copytree(kept, runs)
        else:
            make()
            shutil.copytree(runs, kept)
        (folder,) = runs.iterdir()
        return folder

    return once


@pytest.fixture
def served() -> Iterator[Callable[..., ServedBench]]:
    """Serve virtual devices in real time, from a thread: make(config, stage=, force=, tcp=)."""
    running: list[tuple[ServedBench, threading.Thread]] = []

    def make(config: Config | None = None, **options: Any) -> ServedBench:
        bench = ServedBench(config or Config(), **{"stage": None, "force": None, **options})
        thread = threading.Thread(target=bench.run)
        thread.start()
        running.append((bench, thread))
        return bench

    yield make
    for bench, thread in running:
        bench.stop()
        thread.join(DEADLINE_S)
        assert not thread.is_alive()
        bench.close()
