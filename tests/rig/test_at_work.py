"""Whoever finds a port busy is told who has it, what that does, since when, and what stops it."""

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from rig.control.client import Announcement, activity_of
from rig.control.owner_socket import ControlSocket
from rig.transport.ownership import PortOwnership
from tests.program import Program

BEGAN_UNIX_S = 1.7e9


@pytest.fixture
def announce() -> Iterator[Any]:
    """This process, as somebody who owns ports."""
    with ExitStack() as stack:

        def begin(status: Any, **more: Any) -> None:
            about = {"kind": "run", "virtual": False, "ports": (), "began_unix_s": BEGAN_UNIX_S, **more}
            one = Announcement(pid=os.getpid(), **about)
            stack.enter_context(ControlSocket(one, {"status": lambda _: status}))

        yield begin


@pytest.mark.parametrize(
    ("more", "status", "does", "stopped_by"),
    [
        (
            {"protocol": "steps", "config": "/here/rig.toml"}, {"state": "asking"},
            "run of steps, asking", "rig stop --config /here/rig.toml",
        ),
        (
            {"kind": "by hand", "config": "/my rig/rig.toml"}, {"state": "Idle"},
            "by hand, Idle", "rig stop --config '/my rig/rig.toml'",
        ),
        ({"protocol": "steps"}, {"ok": False, "problem": "not now"}, "run of steps, not now", "rig stop"),
    ],
)  # fmt: skip
def test_the_owner_of_a_port_is_reported_with_its_activity_start_time_and_stop_command(
    announce: Any, more: dict[str, Any], status: Any, does: str, stopped_by: str
) -> None:
    announce(status, **more)
    told = activity_of(os.getpid())
    assert (told["does_text"], told["stop"]) == (does, stopped_by)
    assert told["since_utc"].startswith("2023-11-1")
    assert len(told["since_utc"]) == len("2023-11-14T22:13:20+00:00")
    assert activity_of(os.getpid() + 1) is None


@pytest.mark.parametrize("command", ["status", "doctor"])
def test_status_and_doctor_name_the_owner_of_both_ports(
    announce: Any, program: Program, tmp_path: Path, command: str
) -> None:
    config = tmp_path / "rig.toml"
    ports = [f"tcp://127.0.0.1:{number}" for number in (1, 2)]
    config.write_text(f"[stage]\nport = '{ports[0]}'\n[force]\nport = '{ports[1]}'\n", encoding="utf-8")
    announce({"state": "running"}, protocol="steps", config=str(config))
    held = [PortOwnership(port) for port in ports]
    try:
        found = json.loads(program(command, "--config", str(config), "--json").out)
        line = program(command, "--config", str(config)).out
    finally:
        for one in held:
            one.release()
    for device in ("stage", "force"):
        assert found[device]["owner"] == os.getpid()
        assert found[device]["does_text"] == "run of steps, running"
    assert f"owner {os.getpid()}, does run of steps, running, since 20" in line
    assert line.count(f"stopped by rig stop --config {config}") == 2
