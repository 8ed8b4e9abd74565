"""Devices in real time behind ports, a board that homes fast, the program in this process or in one of its own."""

import json
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pytest

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.devices.grbl import GrblStage
from rig.plan.config import Config
from rig.transport import open_port
from sim.devices import BalanceMenu, Load, SerialLine, VirtualBalance, VirtualGrbl
from sim.devices.grbl import board
from sim.devices.grbl.core import Mechanics
from sim.serve.ports import PtyPort
from sim.serve.real_time_loop import WallScheduler
from tests.preloaded import Popen
from tests.program import Program, as_in_its_schema
from tests.rig.real_time.elsewhere import Elsewhere
from tests.waiting import DEADLINE_S, gathered, until

# Close to the switches, on a board that homes fast: a short way to go in real time. A reading is taken 0.1 s after a
# move: until then a busy machine may still give the force from before it.
NEAR = {
    "frame": {"pad_centre_x_mm": -3.0, "pad_y_mm": -2.0, "apex_z_mm": -4.0},
    "force": {"baud": 115200, "sample_period_s": 0.02},
    "habits": {
        "clearance_mm": 0.4,
        "descent_speed_mm_s": 2.0,
        "approach_speed_mm_s": 2.0,
        "press_speed_mm_s": 2.0,
        "settle_readings": 5,
    },
}
FAST = (b"$110=3000", b"$111=3000", b"$112=3000", b"$120=500", b"$121=500", b"$122=500", b"$24=600", b"$25=3000",
        b"$26=10")  # fmt: skip
START_MM = (-6.0, -4.0, -2.5)
"""Where a board begins, seen from its switches: above the finger."""


@pytest.fixture(autouse=True)
def _begins_near_its_switches(monkeypatch: pytest.MonkeyPatch) -> None:
    """To its switches from where a board usually begins the program takes 9 s."""
    monkeypatch.setattr(board, "Mechanics", partial(Mechanics, start_mm=START_MM))


def set_up(port: str, *more: bytes) -> None:
    """A board that homes in a second; its settings outlast the client, as in a real one. `more` are further lines."""
    wire = open_port(port, 115200)
    for line in (*FAST, *more):
        wire.write(line + b"\n")
        gathered(partial(wire.read, 0.1), lambda heard: b"ok" in heard)
    wire.close()


class Serving:
    """`rig serve` in a process of its own."""

    def __init__(self, *options: str) -> None:
        command = [sys.executable, "-c", "from rig.cli import main; main()", "serve", *options]
        self.process = Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def ports(self) -> dict[str, str]:
        assert self.process.stdout is not None
        return as_in_its_schema("serve", json.loads(self.process.stdout.readline()))

    def end(self, number: signal.Signals) -> tuple[int, str, str]:
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=DEADLINE_S)
        return self.process.returncode, out, err


@pytest.fixture
def serving() -> Iterator[Callable[..., Serving]]:
    started: list[Serving] = []

    def start(*options: str) -> Serving:
        started.append(Serving(*options))
        return started[-1]

    yield start
    for one in started:
        if one.process.poll() is None:
            one.process.kill()
        one.process.communicate()


@pytest.fixture
def elsewhere(tmp_path: Path) -> Iterator[Callable[..., Elsewhere]]:
    begun: list[Elsewhere] = []

    def begin(script: str, *words: object) -> Elsewhere:
        path = tmp_path / "decides.py"
        path.write_text(script, encoding="utf-8")
        command, *options = words
        begun.append(Elsewhere(tmp_path / "runs", command, path, *options))
        return begun[-1]

    yield begin
    for one in begun:
        if one.process.poll() is None:
            one.process.kill()
            one.process.communicate()


@pytest.fixture
def rig(program: Program) -> Program:
    """Run the program in this process, with what is typed to it."""
    return program


@pytest.fixture
def whole(served: Callable[..., ServedBench], rig_toml: Callable[..., Path]) -> tuple[ServedBench, Path]:
    """A fast board and a balance with the finger between them, and their configuration.

    The board has homed while it was fast: the program limits its speed to 5 mm/s.
    """
    bench = served(Config.model_validate(NEAR), stage="grbl", force="mtsics")
    set_up(bench.ports["stage"], b"$H")
    return bench, rig_toml(**bench.ports)


@pytest.fixture
def rig_toml(tmp_path: Path) -> Callable[..., Path]:
    """Write the configuration of a rig near its switches, with these ports."""

    def write(stage: str, force: str = "/dev/ttyNOWHERE7", **limits: float) -> Path:
        path = tmp_path / "rig.toml"
        tables = {**NEAR, "stage": {"port": stage}, "force": {**NEAR["force"], "port": force}, "limits": limits}
        path.write_text(Config.model_validate(tables).as_toml(), encoding="utf-8")
        return path

    return write


@pytest.fixture
def apart(served: Callable[..., ServedBench], rig_toml: Callable[..., Path]) -> tuple[str, str, Path]:
    """A fast board and a balance that know nothing of each other, with no finger: ports and configuration."""
    stage = served(stage="grbl").ports["stage"]
    force = served(Config.model_validate(NEAR), force="mtsics").ports["force"]
    set_up(stage)
    return stage, force, rig_toml(stage, force)


@dataclass(frozen=True)
class FreeStage:
    """An unlocked board: its port, its configuration, and how far its carriage really went, whoever owns the port."""

    port: str
    config: Path
    x_mm: Callable[[], float]

    def state(self) -> str:
        """What the board says; nobody may own the port."""
        stage = GrblStage(open_port(self.port, 115200), WallClock())
        try:
            return stage.look().state
        finally:
            stage.close()


@pytest.fixture
def free_stage(rig_toml: Callable[..., Path]) -> Iterator[FreeStage]:
    scheduler = WallScheduler()
    line = SerialLine(scheduler, 115200)
    board, port = VirtualGrbl(scheduler, line), PtyPort(scheduler, line)
    start, noted = board.carriage_steps_at(0.0)[0], [0.0]

    def note() -> None:
        """In the loop's own thread, which is the only one that may ask the board."""
        now_s = scheduler.monotonic_s()
        noted.append((board.carriage_steps_at(now_s)[0] - start) / 400)
        scheduler.call_at(now_s + 0.01, note)

    def x_mm() -> float:
        seen = len(noted)
        until(lambda: len(noted) > seen)
        return noted[-1]

    note()
    with _answering(scheduler, port):
        stage = GrblStage(open_port(port.name, 115200), WallClock())
        stage.connect()
        stage.unlock()
        stage.close()
        yield FreeStage(port.name, rig_toml(port.name), x_mm)


@contextmanager
def _answering(scheduler: WallScheduler, *ports: PtyPort) -> Iterator[None]:
    loop = threading.Thread(target=scheduler.run)
    loop.start()
    try:
        yield
    finally:
        scheduler.stop()
        loop.join(DEADLINE_S)
        assert not loop.is_alive()
        for port in ports:
            port.close()
        scheduler.close()


@pytest.fixture
def running() -> Callable[..., AbstractContextManager[None]]:
    """What is on the ports of a scheduler answers meanwhile, from a thread: running(scheduler, *ports)."""
    return _answering


@pytest.fixture
def block(rig_toml: Callable[..., Path]) -> Iterator[tuple[float, Callable[..., Path]]]:
    """A rigid block on the balance, under a rig that gives: how far (mm/N), and its configuration by limits."""
    mm_per_n, top_mm = 0.05, NEAR["frame"]["apex_z_mm"] + 0.03
    scheduler = WallScheduler()
    stage_line, force_line = SerialLine(scheduler, 115200), SerialLine(scheduler, 115200)
    board = VirtualGrbl(scheduler, stage_line, mechanics=Mechanics(start_mm=START_MM))

    def force_n(t_s: float) -> float:
        return max(top_mm - board.carriage_steps_at(t_s)[2] / 400, 0.0) / mm_per_n

    menu = BalanceMenu(sample_period_s=NEAR["force"]["sample_period_s"])
    VirtualBalance(scheduler, force_line, Load(force_n), menu)
    stage, force = PtyPort(scheduler, stage_line), PtyPort(scheduler, force_line)
    with _answering(scheduler, stage, force):
        set_up(stage.name, b"$H")
        yield mm_per_n, partial(rig_toml, stage.name, force.name)
