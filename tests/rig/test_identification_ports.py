"""Ports that `rig identify` and `rig serve` cannot open print one line, and nothing begins."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

import rig.cli.identify_finger as identify_finger
from tests.program import Program


@pytest.fixture
def listener() -> Iterator[int]:
    """A port that is in use."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_serve_names_a_tcp_port_that_is_in_use(program: Program, listener: int) -> None:
    ended = program("serve", "--random-finger", "7", "--tcp", str(listener))
    assert (ended.code, ended.out) == (2, "")
    assert f"TCP port {listener}: address already in use" in ended.err.splitlines()[-1]


def test_identify_names_a_server_that_does_not_answer_before_it_computes(
    program: Program, listener: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("FingerProcess", "PredictedForces", "loaded"):
        monkeypatch.setattr(identify_finger, name, lambda *_: pytest.fail("it has begun"))
    with socket.create_server(("127.0.0.1", 0)) as other:
        nobody = other.getsockname()[1]
    (tmp_path / "rig.toml").write_text(
        f'[stage]\nport = "tcp://127.0.0.1:{nobody}"\n[force]\nport = "tcp://127.0.0.1:{listener}"\n'
    )
    ended = program("identify", "--config", "rig.toml", "--shapes", "bar:3.0", "--yes")
    assert ended.code == 1
    assert "not moved" in ended.err
    assert f"port tcp://127.0.0.1:{nobody}: connection refused" in ended.err
