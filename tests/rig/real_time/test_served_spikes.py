"""`rig serve --afferents`: spikes and sync pulses on a port, and as a stream, while the indentor presses."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.bench.served_spikes import Delivery, IndentorFeed, _DeliverySettings
from rig.clock import WallClock
from rig.devices.grbl import GrblStage
from rig.errors import BadInputError
from rig.plan.config import Config
from rig.plan.nerve import SpikeRequest
from rig.transport import open_port
from sim.carriage import Carriage
from sim.models.fingertip import Fingertip
from sim.serve.ports import MOST_LISTENERS, LinePort, bound
from sim.serve.real_time_loop import WallScheduler
from tests.error_codes import raises
from tests.preloaded import Popen
from tests.rig.real_time.conftest import NEAR, set_up
from tests.rig.real_time.test_lsl_inlet import LOOPBACK
from tests.rig.test_live_spikes import AFFERENTS
from tests.waiting import DEADLINE_S, gathered

pytest.importorskip("pty", reason="needs signals")

HEARD = """
import pylsl, sys
(found,) = pylsl.resolve_byprop("name", "synthetic_spikes", 1, 120.0)
inlet = pylsl.StreamInlet(found, recover=False)
inlet.open_stream(60.0)
labels, child = [], inlet.info(60.0).desc().child("afferents").child("afferent")
while not child.empty():
    labels.append(child.child_value("label"))
    child = child.next_sibling("afferent")
print(*labels, flush=True)
while True:
    values, at_s = inlet.pull_sample(1.0)
    if values is not None:
        print(values[0], at_s, flush=True)
"""


def pressed(port: str, config: Config) -> None:
    """To 0.6 mm, a pulse of the output, a second of hold, and back."""
    clock, frame = WallClock(), config.frame
    stage = GrblStage(open_port(port, 115200), clock, output="coolant")
    stage.connect()
    stage.home()
    stage.move_to(x_mm=frame.pad_centre_x_mm, y_mm=frame.pad_y_mm, speed_mm_s=10.0)
    stage.move_to(z_mm=frame.apex_z_mm + 0.3, speed_mm_s=5.0)
    clock.wait_s(3.0)
    stage.move_to(z_mm=frame.apex_z_mm - 0.6, speed_mm_s=5.0)
    stage.set_output(True)
    stage.set_output(False)
    clock.wait_s(1.0)
    stage.move_to(z_mm=frame.apex_z_mm + 0.3, speed_mm_s=5.0)
    stage.close()


def read(client: socket.socket) -> Callable[[], bytes]:
    client.setblocking(False)

    def once() -> bytes:
        try:
            return client.recv(1 << 16)
        except BlockingIOError:
            return b""

    return once


def test_spikes_arrive_while_the_indentor_presses(
    serving: Callable[..., Any],
    finger: Fingertip,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And as a stream, where pylsl (extra lsl) is there."""
    lsl = find_spec("pylsl") is not None
    if lsl:
        (tmp_path / "lsl.cfg").write_text(LOOPBACK.format(session=f"spikes-{os.getpid()}"), encoding="ascii")
        monkeypatch.setenv("LSLAPICFG", str(tmp_path / "lsl.cfg"))
    config = Config.model_validate({**NEAR, "virtual": {"indentor": "bar:3.0"}, "sync": {"output": "coolant"}})
    path = tmp_path / "rig.toml"
    path.write_text(config.as_toml(), encoding="utf-8")
    words = ("--tcp", "0", "--config", str(path), "--afferents", "SA1@0,RA@0.5,SA1@0.5", *(["--lsl"] * lsl))
    serve = serving(*words)
    ports = serve.ports()
    assert set(ports) == {"stage", "force", "spikes"}
    set_up(ports["stage"])
    client = socket.create_connection(("127.0.0.1", int(ports["spikes"].rpartition(":")[2])))
    inlet = None
    if lsl:
        inlet = Popen([sys.executable, "-c", HEARD], stdout=subprocess.PIPE, text=True)
        assert inlet.stdout is not None
        assert inlet.stdout.readline().split() == ["SA1-1", "RA-1", "SA1-2"]
    pressed(ports["stage"], config)
    heard = gathered(read(client), lambda heard: heard.count(b"spike,SA1-1") > 5 and b"sync," in heard)
    client.close()
    title, columns, *lines = heard.decode("ascii").splitlines()
    assert title.endswith("SA1-1 RA-1 SA1-2")
    assert "synthetic" in title
    assert columns == "time_s,kind,afferent"
    rows = [line.split(",") for line in lines]
    assert sum(kind == "sync" for _, kind, _ in rows) == 1
    assert {name for _, kind, name in rows if kind == "spike"} <= {"SA1-1", "RA-1", "SA1-2"}
    if inlet is not None:
        assert inlet.stdout is not None
        first = next((at_s, name) for at_s, kind, name in rows if kind == "spike")
        name, at_s = inlet.stdout.readline().split()
        inlet.kill()
        inlet.communicate(timeout=DEADLINE_S)
        assert (name, float(at_s)) == (first[1], pytest.approx(float(first[0]), abs=0.001))
    code, out, err = serve.end(signal.SIGINT)
    assert (code, out) == (0, "")
    assert " synthetic spikes delivered, " in err


# --- delivery ---


@pytest.fixture
def scheduler() -> Iterator[WallScheduler]:
    made = WallScheduler()
    yield made
    made.close()


def _settings() -> _DeliverySettings:
    return _DeliverySettings(AFFERENTS, SpikeRequest("SA1"), False, print)


def _read(client: socket.socket, scheduler: WallScheduler, lines: int) -> list[str]:
    scheduler.run_once(0.0)
    with client.makefile(encoding="ascii") as file:
        return [file.readline().strip() for _ in range(lines)]


def test_every_client_gets_every_line_in_order_of_time(scheduler: WallScheduler) -> None:
    server = bound(0)
    port, pushed = LinePort(scheduler, server, b"columns\n"), list[tuple[str, float]]()
    clients = [socket.create_connection(server.getsockname()) for _ in range(2)]
    for _ in clients:
        scheduler.run_once(0.0)
    delivery = Delivery(_settings(), scheduler, port, lambda name, at_s: pushed.append((name, at_s)))
    now_s, delay_s = WallClock().monotonic_s(), AFFERENTS[0].delay_s()
    delivery.add(1, now_s - delay_s - 0.010)
    delivery.sync(now_s - 0.004)
    delivery.add(0, now_s - delay_s - 0.002)
    delivery.add(2, now_s + 3600)
    delivery.go()
    spikes = [(now_s - 0.010, "spike,SA1-2"), (now_s - 0.004, "sync,"), (now_s - 0.002, "spike,SA1-1")]
    expected = ["columns", *(f"{at_s:.6f},{rest}" for at_s, rest in spikes)]
    assert [_read(client, scheduler, 4) for client in clients] == [expected, expected]
    assert [name for name, _ in pushed] == ["SA1-2", "SA1-1"]
    found = delivery.statistics
    assert (found.delivered, found.late >= 1, found.worst_s >= 0.010) == (2, True, True)
    for one in clients:
        one.close()
    port.close()


def test_a_client_that_does_not_read_is_dropped_and_one_too_many_is_refused(scheduler: WallScheduler) -> None:
    server = bound(0)
    port = LinePort(scheduler, server, b"")
    clients = [socket.create_connection(server.getsockname()) for _ in range(MOST_LISTENERS + 1)]
    for _ in clients:
        scheduler.run_once(0.0)
    assert len(port._clients) == MOST_LISTENERS
    for _ in range(2000):
        port.write(b"x" * 10_000)
    assert not port._clients
    for one in clients:
        one.close()
    port.close()


def test_a_stuck_process_does_not_delay_the_bench_and_what_waits_has_an_end(scheduler: WallScheduler) -> None:
    near, far = socket.socketpair()
    feed = IndentorFeed(scheduler, Carriage(lambda t_s: (0.0, 0.0, 0.0)), lambda after_s: [], near, print)
    for _ in range(20):
        feed.close()  # its timer
        feed._next -= 2000
        feed._tick()
    assert len(feed._unsent) < 1 << 18
    said: list[str] = []
    feed._complain = said.append
    far.close()
    feed.close()
    feed._tick()
    assert len(said) == 1
    scheduler.run_once(scheduler.monotonic_s() + 0.05)
    assert len(said) == 1
    near.close()


def test_a_busy_port_is_refused_before_a_finger_is_loaded() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other, raises(BadInputError, "port_busy"):
        ServedBench(
            Config(), stage="grbl", force="mtsics", tcp=other.getsockname()[1] - 2, spikes=SpikeRequest("SA1")
        )
