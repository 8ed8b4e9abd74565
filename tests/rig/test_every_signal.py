"""Every command that moves something, at every signal that could end or suspend it while a finger is pressed."""

import json
import os
import signal
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pytest

import rig.session.session as sessions
from rig.bench.served import ServedBench
from rig.bench.virtual import virtual_bench
from rig.control.owned_stage import OwnedStage
from rig.devices.base import StageError
from rig.devices.grbl import GrblStage
from rig.engine import EngineError, Journal
from rig.engine.bench_memory import BenchMemory
from rig.engine.sensing import ForceZero
from rig.manual.owner_process import ManualOwner
from rig.plan.config import Config
from sim.devices.clock import VirtualClock
from sim.models.fingertip import Fingertip
from tests.program import NEAR_HOME, Program, press_script
from tests.waiting import until

if not hasattr(signal, "SIGTSTP"):
    pytest.skip("only where there are signals", allow_module_level=True)
pytestmark = pytest.mark.usefixtures("empty_figures")

ENDS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGTSTP", "SIGQUIT", "SIGUSR1")
"""What would end or suspend the process, were it not handled."""
BACKGROUND = ("SIGTTIN", "SIGTTOU")
"""What suspends a process in the background that uses its terminal."""
INHERITED = ("SIGINT", "SIGTSTP", "SIGQUIT")
"""Ignored and blocked when the program begins: a shell does the first to a background program."""

SCRIPT = press_script("force_gwt=1.0, hold_s=0.1")


@pytest.fixture(autouse=True)
def _as_before() -> Iterator[None]:
    numbers = [signal.Signals[name] for name in (*ENDS, *BACKGROUND)]
    before = {number: signal.getsignal(number) for number in numbers}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    yield
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def beside_a_script(finger: Fingertip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    def open_bench(config: Any, clock: Any, log: Any, ask: Any, pause: Any, stage: Any) -> Any:
        found = virtual_bench(config, finger, log, VirtualClock(0.0, clock.monotonic_s()), pause)
        return replace(found, virtual=False)  # type: ignore[arg-type]

    monkeypatch.setattr(sessions, "open_bench", open_bench)
    monkeypatch.setattr(OwnedStage, "open", lambda stage: stage)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    for port in ("stage", "force"):
        (tmp_path / port).touch()
    ports = f"[stage]\nport = '{tmp_path / 'stage'}'\n[force]\nport = '{tmp_path / 'force'}'\n"
    (tmp_path / "rig.toml").write_text(NEAR_HOME + ports, encoding="utf-8")
    return tmp_path


def _stopped_before(program: Program, folder: Path) -> str:
    """A run that has been stopped, to be taken up."""
    with pytest.MonkeyPatch.context() as patch:
        event = Journal.event

        def seen(journal: Journal, stream: str, data: Mapping[str, Any]) -> None:
            event(journal, stream, data)
            if stream == "move":
                signal.raise_signal(signal.SIGINT)

        patch.setattr(Journal, "event", seen)
        program("run", "mine.py", "--config", "rig.toml", "--yes", "--json")
    (run,) = (folder / "runs").iterdir()
    return str(run)


PROTOCOLS: dict[str, Callable[[Program, Path], list[object]]] = {
    "dry-run": lambda program, folder: ["dry-run", "mine.py"],
    "run": lambda program, folder: ["run", "mine.py", "--config", "rig.toml", "--yes"],
    "resume": lambda program, folder: ["resume", _stopped_before(program, folder), "--yes"],
    "identify": lambda program, folder: ["identify", "--config", "rig.toml", "--yes", "--shapes", "bar:3.0"],
}
AT_THE_BENCH: dict[str, list[object]] = {
    "home": ["home"],
    "home --without-force": ["home", "--without-force"],
    "jog": ["jog", "--axis", "z", "--by-mm", "0.5"],
    "jog --without-force": ["jog", "--axis", "z", "--by-mm", "0.5", "--without-force"],
    "calibrate steps": ["calibrate", "steps", "--axis", "x", "--by-mm", "0.5"],
    "calibrate compliance": ["calibrate", "compliance"],
    "by-hand": ["by-hand"],
}


def _now() -> dict[str, Any]:
    """What each signal would do."""
    found: dict[str, Any] = {name: signal.getsignal(signal.Signals[name]) for name in (*ENDS, *BACKGROUND)}
    return found | {"blocked": signal.pthread_sigmask(signal.SIG_BLOCK, ()) & {signal.Signals[name] for name in ENDS}}


@pytest.fixture
def dispositions(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What each signal would do, at the first motion that is told; there is no other."""
    found: dict[str, Any] = {}

    def told(*_: object, **__: object) -> NoReturn:
        found.update(_now())
        raise StageError("enough")

    def unrehearsed(*_: object) -> NoReturn:
        raise EngineError("it would be the first to move")

    for motion in ("homing", "moving", "jog"):
        monkeypatch.setattr(GrblStage, motion, told)
    monkeypatch.setattr(ManualOwner, "run", told)
    monkeypatch.setattr("rig.session.rehearsal_summary.rehearsed", unrehearsed)
    monkeypatch.setattr("rig.cli.identify_finger.expected_duration", lambda *_: None)
    return found


def _inherit_the_worst() -> None:
    for name in INHERITED:
        signal.signal(signal.Signals[name], signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.Signals[name] for name in INHERITED])


def _none_is_left_alone(found: Mapping[str, Any]) -> None:
    assert set(found) == {*ENDS, *BACKGROUND, "blocked"}, "something moved"
    assert {name: found[name] for name in ENDS if not callable(found[name])} == {}
    assert {found[name] for name in BACKGROUND} == {signal.SIG_IGN}
    assert found["blocked"] == set()


@pytest.mark.parametrize("command", PROTOCOLS)
def test_every_command_that_runs_a_protocol_handles_every_signal(
    command: str, beside_a_script: Path, program: Program, request: pytest.FixtureRequest
) -> None:
    arguments = PROTOCOLS[command](program, beside_a_script)
    found = request.getfixturevalue("dispositions")
    _inherit_the_worst()
    program(*arguments)
    _none_is_left_alone(found)


@pytest.mark.parametrize("command", AT_THE_BENCH)
def test_every_bench_command_that_moves_handles_signals_and_the_participants_stop_key(
    command: str,
    served: Callable[..., ServedBench],
    program: Program,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    dispositions: dict[str, Any],
) -> None:
    """The process under manual control is not begun here; its stop: test_manual_promises.py."""
    pipe, stops = tmp_path / "pedal", list[int]()
    os.mkfifo(pipe)
    file = os.open(pipe, os.O_RDWR)
    ports = {name: served(**{name: kind}).ports[name] for name, kind in (("stage", "grbl"), ("force", "mtsics"))}
    tables = {name: {"port": port} for name, port in ports.items()}
    config = Config.model_validate({**tables, "stop": {"kind": "key", "device": str(pipe)}})
    (tmp_path / "rig.toml").write_text(config.as_toml(), encoding="utf-8")
    BenchMemory(config).record_zero(ForceZero(0.0, 0.0))

    def moves(*_: object, **__: object) -> NoReturn:
        dispositions.update(_now())
        os.write(file, struct.pack("llHHi", 0, 0, 1, 30, 1))
        until(lambda: False)
        raise AssertionError

    for motion in ("homing", "moving", "jog"):
        monkeypatch.setattr(GrblStage, motion, moves)
    monkeypatch.setattr(GrblStage, "stop", lambda stage: stops.append(1))
    _inherit_the_worst()
    ended = program(*AT_THE_BENCH[command], "--config", tmp_path / "rig.toml", typed="\n\n\n")
    os.close(file)
    _none_is_left_alone(dispositions)
    if command != "by-hand":
        assert ended.code == 130, ended.err
        assert stops


@pytest.mark.quick(rows=lambda command, name, times: command == "run" or (name, times) == ("SIGINT", 1))
@pytest.mark.parametrize("command", ["dry-run", "run"])
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGTSTP", "SIGQUIT"])
@pytest.mark.parametrize("times", [1, 2])
def test_the_first_signal_lifts_and_the_second_stops_at_once(
    command: str, name: str, times: int, beside_a_script: Path, program: Program, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a terminal nobody can go on: it ends."""
    event = Journal.event

    def seen(journal: Journal, stream: str, data: Mapping[str, Any]) -> None:
        event(journal, stream, data)
        if stream == "hold_start":
            for _ in range(times):
                signal.raise_signal(signal.Signals[name])

    monkeypatch.setattr(Journal, "event", seen)
    ended = program(*PROTOCOLS[command](program, beside_a_script), "--json")
    assert ended.code == 130
    at_once = times == 2 and name != "SIGTERM"
    said = json.loads(ended.out)["ending"]
    assert (said["indentor"]["left"], said["indentor"]["may_touch"]) == (
        ("held", True) if at_once else ("lifted", False)
    )
