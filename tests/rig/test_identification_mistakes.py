"""Wrong arguments of `rig identify` and `rig serve` print one line, and nothing begins; others: tests/refusals."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

import rig.cli.identify_finger as identify_finger
from tests.program import Program

MISTAKES = {
    "a width": (("identify", "--width", "wide"), "'--width': must be a number, got 'wide'"),
    "presses": (("identify", "--presses", "9"), "'--presses': must be less than or equal to 8, got '9'"),
    "a shape": (("identify", "--shapes", "bar:3.0,blob:3"), "blob:3"),
    "a parameter of a protocol": (("identify", "steps", "force_gwt=nan"), "force_gwt"),
    "a parameter in words": (("identify", "steps", "force_gwt=ten"), "force_gwt = 'ten': must be a number (param"),
    "a subject": (("identify", "--subject", "a b/c"), "subject"),
    "a seed": (("serve", "--random-finger", "-1"), "'--random-finger': must be greater than or equal to 0, got '-1'"),
    "another file": (("serve", "--reveal", "7", "--beside", "other.toml"), "other.toml: no [identified] table"),
    "no TOML": (("serve", "--reveal", "7", "--beside", "not.toml"), "not.toml: not valid TOML"),
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With files of something else, and nobody who computes or opens anything."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "not.toml").write_text("[finger\n")
    (tmp_path / "other.toml").write_text("[finger.tissue]\nstiffness = 1.0\n")

    def begun(*_: object) -> None:
        raise AssertionError("it has begun")

    for name in ("FingerProcess", "PredictedForces", "loaded"):
        monkeypatch.setattr(identify_finger, name, begun)


def _one_line(program: Program, *words: str) -> str:
    ended = program(*words)
    assert ended.code == 2, ended.err
    assert not ended.out
    (line,) = [line for line in ended.err.splitlines() if line.startswith("rig: ")]
    assert not Path("runs").exists()
    return line


@pytest.mark.parametrize("name", MISTAKES)
def test_a_wrong_argument_of_identify_or_serve_prints_one_line_and_nothing_begins(
    program: Program, name: str
) -> None:
    words, reason = MISTAKES[name]
    assert reason in _one_line(program, *words)


@pytest.fixture
def listener() -> Iterator[int]:
    """A port that is in use."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_serve_names_a_tcp_port_that_is_in_use(program: Program, listener: int) -> None:
    said = _one_line(program, "serve", "--random-finger", "7", "--tcp", str(listener))
    assert f"TCP port {listener}: address already in use" in said


def test_identify_names_a_server_that_does_not_answer_before_it_computes(
    program: Program, listener: int, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        nobody = other.getsockname()[1]
    (tmp_path / "rig.toml").write_text(
        f'[stage]\nport = "tcp://127.0.0.1:{nobody}"\n[force]\nport = "tcp://127.0.0.1:{listener}"\n'
    )
    ended = program("identify", "--config", "rig.toml", "--shapes", "bar:3.0", "--yes")
    assert ended.code == 1
    assert "not moved" in ended.err
    assert f"port tcp://127.0.0.1:{nobody}: connection refused" in ended.err
