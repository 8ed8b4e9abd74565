"""`rig serve --afferents`: spikes and sync pulses on a port, and as a stream, while the indentor presses."""

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.clock import WallClock
from rig.devices.grbl import GrblStage
from rig.plan.config import Config
from rig.transport import open_port
from sim.models.fingertip import Fingertip
from tests.rig.real_time.conftest import NEAR, set_up
from tests.rig.real_time.test_lsl_inlet import LOOPBACK
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
    client.settimeout(0.1)

    def once() -> bytes:
        try:
            return client.recv(1 << 16)
        except TimeoutError:
            return b""

    return once


@pytest.mark.parametrize("lsl", [False, True])
def test_spikes_arrive_while_the_indentor_presses(
    serving: Callable[..., Any],
    finger: Fingertip,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    lsl: bool,
) -> None:
    if lsl:
        pytest.importorskip("pylsl", reason="needs pylsl (extra lsl)", exc_type=ImportError)
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
        inlet = subprocess.Popen([sys.executable, "-c", HEARD], stdout=subprocess.PIPE, text=True)
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
