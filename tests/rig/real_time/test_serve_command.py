"""`rig serve` as a command: what it prints, how it ends, what it refuses."""

import random
import signal
import socket
from collections.abc import Callable
from typing import Any

import pytest

from rig.clock import WallClock
from rig.devices.grbl import GrblStage
from rig.devices.mtsics import MtSicsForce
from rig.transport import open_port
from tests.program import beside_progress
from tests.waiting import until

pytest.importorskip("pty", reason="needs pseudo-terminals")

Serving = Callable[..., Any]
Rig = Callable[..., Any]


def two_free_ports() -> int | None:
    """The first of two TCP ports in a row that nobody has, below those that are given to whoever asks for any."""
    number = random.randrange(20_000, 32_000, 2)
    try:
        for port in (number, number + 1):
            socket.create_server(("127.0.0.1", port)).close()
    except OSError:
        return None
    return number


def test_one_device_one_line_and_a_clean_end(serving: Serving) -> None:
    serve = serving("--stage", "grbl", "--tcp", "0")
    ports = serve.ports()
    assert set(ports) == {"stage"}
    stage = GrblStage(open_port(ports["stage"], 115200), WallClock())
    assert stage.connect().startswith("[VER:1.1h")
    stage.close()
    code, out, err = serve.end(signal.SIGINT)
    assert (code, out, beside_progress(err)) == (0, "", "")


def test_keys_that_a_virtual_device_needs_are_printed(serving: Serving) -> None:
    ports = serving("--stage", "standa", "--force-sensor", "net_ft").ports()
    assert set(ports) == {"stage", "force", "x_port", "http_port"}
    assert ports["force"] == f"udp://127.0.0.1:{ports['http_port']}"


def test_both_devices_behind_two_tcp_ports(serving: Serving) -> None:
    number = until(two_free_ports)
    serve = serving("--tcp", str(number), "--indentor", "step:1")
    ports = serve.ports()
    assert ports == {"stage": f"tcp://127.0.0.1:{number}", "force": f"tcp://127.0.0.1:{number + 1}"}
    force = MtSicsForce(open_port(ports["force"], 9600), WallClock())
    assert force.connect() == "MT-SICS balance 0123456789"
    assert force.read().force_n == 0.0
    force.close()
    code, out, err = serve.end(signal.SIGTERM)
    assert (code, out) == (0, "")
    assert "forces requested, 0 not ready in time" in err


def test_a_busy_port_is_one_line(rig: Rig) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        number = other.getsockname()[1]
        ended = rig("serve", "--force-sensor", "mtsics", "--tcp", number)
    assert (ended.code, ended.out, ended.err.count("\n")) == (2, "", 1)
    assert str(number) in ended.err
