"""Wrong arguments of the three identification commands print one line, and nothing begins."""

import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

import rig.cli.identify_finger as identify_finger
from tests.program import Program

NOT_MET = "[finger.tissue]\nstiffness = 1.0\n"
IDENTIFIES = [
    (["--width", "0.5"], "--width 0.5: must be 1 to 50 %"),
    (["--width", "nan"], "nan must be a finite number"),
    (["--width", "inf"], "inf must be a finite number"),
    (["--width", "wide"], "'--width': must be a number"),
    (["--most-gwt", "500"], "--most-gwt 500: must be 1 to 100 gwt"),
    (["--most-gwt", "nan"], "nan must be a finite number"),
    (["--presses", "0"], "'--presses': must be greater than or equal to 1"),
    (["--presses", "9"], "'--presses': must be less than or equal to 8"),
    (["--presses", "nan"], "'--presses': must be a whole number"),
    (["--to", "nowhere/finger.toml"], "must be a file in an existing folder"),
    (["--to", "."], "must be a file in an existing folder"),
    (["--shapes", "blob:3"], "blob:3"),
    (["--shapes", "bar:3.0,blob:3"], "blob:3"),
    (["--shapes", ""], "shape ''"),
    (["--shapes", "bar:nan"], "bar:nan"),
    (["--shapes", "bar:-3"], "bar:-3"),
    (["--config", "nowhere.toml"], "nowhere.toml"),
    (["--config", "not.toml"], "not.toml"),
    (["no_such_protocol"], "no_such_protocol"),
    (["steps", "force_gwt=nan"], "force_gwt"),
    (["--subject", "a b/c"], "subject"),
]
SERVES = [
    (["--random-finger", "seven"], "'--random-finger': must be a whole number"),
    (["--random-finger", "-1"], "'--random-finger': must be greater than or equal to 0"),
    (["--random-finger", "nan"], "'--random-finger': must be a whole number"),
    (["--tcp", "70000"], "--tcp 70000: must be 0 to 65534"),
    (["--tcp", "0", "--pty"], "--pty and --tcp cannot be combined; give one of them"),
    (["--tcp", "0", "--indentor", "blob:3"], "blob:3"),
    (["--tcp", "0", "--indentor", "bar:nan"], "bar:nan"),
    (["--config", "nowhere.toml"], "nowhere.toml"),
    (["--stage", "wheel"], "--stage wheel: "),
]
BESIDE = [
    (["seven"], "'--reveal': must be a whole number"),
    (["-1"], "--reveal"),
    (["7.5"], "'--reveal': must be a whole number"),
    (["7", "--beside", "nowhere.toml"], "nowhere.toml: No such file or directory"),
    (["7", "--beside", "."], "Is a directory"),
    (["7", "--beside", "not.toml"], "not.toml: not valid TOML"),
    (["7", "--beside", "not_met.toml"], "not_met.toml: no [identified] table"),
    (["7", "--beside", "nan.toml"], "nan.toml"),
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With files of something else, and nobody who computes or opens anything."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "not.toml").write_text("[finger\n")
    (tmp_path / "not_met.toml").write_text(NOT_MET)
    (tmp_path / "nan.toml").write_text("[met]\nband = {model_error = nan}\n")

    def begun(*_: object) -> None:
        raise AssertionError("it has begun")

    monkeypatch.setattr(identify_finger, "FingerProcess", begun)
    monkeypatch.setattr(identify_finger, "PredictedForces", begun)
    monkeypatch.setattr(identify_finger, "loaded", begun)


def _one_line(program: Program, *words: str) -> str:
    ended = program(*words)
    assert ended.code == 2, ended.err
    assert not ended.out
    (line,) = [line for line in ended.err.splitlines() if line.startswith("rig: ")]
    assert len(ended.err.splitlines()) <= 2  # that nothing moved, and why
    assert not Path("runs").exists()
    return line


@pytest.mark.parametrize(("words", "said"), IDENTIFIES, ids=str)
@pytest.mark.parametrize("dry", [True, False])
def test_of_identify(program: Program, words: list[str], said: str, dry: bool) -> None:
    assert said in _one_line(program, "identify", *words, *(["--dry-run"] if dry else []))


@pytest.mark.parametrize(("words", "said"), SERVES, ids=str)
def test_of_a_server(program: Program, words: list[str], said: str) -> None:
    assert said in _one_line(program, "serve", *words)


@pytest.mark.parametrize(("words", "said"), BESIDE, ids=str)
def test_of_the_truth(program: Program, words: list[str], said: str) -> None:
    assert said in _one_line(program, "serve", "--reveal", *words)


@pytest.fixture
def listener() -> Iterator[int]:
    """A port that somebody has."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


def test_of_a_port_that_is_taken(program: Program, listener: int) -> None:
    said = _one_line(program, "serve", "--random-finger", "7", "--tcp", str(listener))
    assert f"TCP port {listener}: address already in use" in said


def test_of_a_server_that_is_not_there(program: Program, listener: int, tmp_path: Path) -> None:
    """Before anything is computed."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        nobody = other.getsockname()[1]
    (tmp_path / "rig.toml").write_text(
        f'[stage]\nport = "tcp://127.0.0.1:{nobody}"\n[force]\nport = "tcp://127.0.0.1:{listener}"\n'
    )
    ended = program("identify", "--config", "rig.toml", "--shapes", "bar:3.0", "--yes")
    assert ended.code == 1
    assert "not moved" in ended.err
    assert f"port tcp://127.0.0.1:{nobody}: connection refused" in ended.err


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_of_a_folder_that_may_not_be_written_to(program: Program, tmp_path: Path) -> None:
    (tmp_path / "shut").mkdir(mode=0o500)
    assert "--to shut/finger.toml: " in _one_line(program, "identify", "--to", "shut/finger.toml")
