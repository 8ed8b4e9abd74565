"""`rig by-hand` in a process of its own, asked over its socket, on devices in real time; and every way it ends."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from rig.bench.served import ServedBench
from rig.clock import WallClock
from rig.control.client import ControlError, RefusedError, announced
from rig.devices.grbl import GrblStage
from rig.engine.bench_memory import BenchMemory, state_folder
from rig.plan.config import Config, load_config
from rig.transport import open_port
from tests.error_codes import raises
from tests.preloaded import Popen
from tests.rig.hand_bench import is_move, is_stop
from tests.waiting import DEADLINE_S, repeated, until

pytest.importorskip("pty", reason="needs pseudo-terminals")

CLOCK = WallClock()
COMMAND = [sys.executable, "-m", "rig", "by-hand", "--config"]
# Popened by one that then waits to be killed.
PARENT = "import sys; from tests.preloaded import Popen; Popen(sys.argv[1:]); sys.stdin.read()"


class Owner:
    """The process, and the way to ask it."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        (self.there,) = until(lambda: announced() or self._failed())

    def __call__(self, do: str, **more: Any) -> dict[str, Any]:
        return self.there.ask(do, within_s=DEADLINE_S, **more)

    def step(self, by_mm: float = -5.0, axis: str = "x") -> None:
        self("step", axis=axis, sign=1 if by_mm > 0 else -1, by_mm=abs(by_mm), tab="one")

    def stepping(self, there: Callable[[dict[str, Any]], bool]) -> None:
        """Begin steps until one has come so far."""
        for _ in repeated(0.02):
            if there(found := self("status")) and found["busy"]:
                return
            if found["busy"] is None:
                self.step()
        raise AssertionError

    def done(self) -> dict[str, Any]:
        return until(lambda: (found := self("status"))["busy"] is None and found)

    def end(self, number: signal.Signals | None = None) -> tuple[int, str]:
        if number is not None:
            self.process.send_signal(number)
        _, err = self.process.communicate(timeout=DEADLINE_S)
        return self.process.returncode, err

    def _failed(self) -> None:
        assert self.process.poll() is None, self.process.communicate()[1]


@pytest.fixture
def begin() -> Iterator[Callable[..., Owner]]:
    started: list[subprocess.Popen[str]] = []

    def start(config: Path) -> Owner:
        started.append(Popen([*COMMAND, str(config)], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True))
        return Owner(started[-1])

    yield start
    for one in started:
        if one.poll() is None:
            one.kill()
        one.communicate()


@pytest.fixture
def homed(begin: Callable[..., Owner], whole: tuple[ServedBench, Path]) -> tuple[Owner, Path]:
    """Homed, zeroed, and so ready to move sideways."""
    owner = begin(whole[1])
    for do in ("home", "zero"):
        owner(do)
        assert owner.done()["ended_by"] is None
    return owner, whole[1]


def test_the_position_is_known_to_the_next_session(homed: tuple[Owner, Path], begin: Callable[..., Owner]) -> None:
    owner, config = homed
    state = owner("status", since=0)
    assert (state["x_mm"], state["homed"], state["stopped"]) == (-1.0, True, False)
    assert state["readings"]["rows"][-1][2] == pytest.approx(0.0, abs=0.02)
    owner.step(-1.0)
    with raises(RefusedError, "busy"):
        owner.step(-1.0)
    state = owner.done()
    assert (state["ended_by"], state["x_mm"]) == (None, pytest.approx(-2.0, abs=0.003))
    later = owner("status", since=0)["readings"]
    assert min(row[3] for row in later["rows"] if row[3] is not None) < -1.4
    owner("leave")
    assert owner.end() == (0, "")
    assert not announced()
    left_mm = BenchMemory(load_config(config)).read().left_at_mm
    assert left_mm is not None
    assert left_mm[0] == pytest.approx(state["x_mm"], abs=0.003)
    again = begin(config)
    assert again("status")["homed"]
    log = sorted((state_folder() / "by_hand").glob("*.jsonl"))
    assert len(log) == 2
    assert '"did": "step x -1 mm"' in log[0].read_text("ascii")


def test_a_stop_ends_a_step_and_only_homing_follows(homed: tuple[Owner, Path]) -> None:
    owner, config = homed
    owner.stepping(lambda found: found["x_mm"] is not None and found["x_mm"] < -1.2)
    assert owner("stop")["stopped"]
    state = owner.done()
    assert (state["ended_by"], state["stopped"], state["homed"]) == ("stopped at once by the operator", True, False)
    assert state["x_mm"] > -6.0
    with raises(RefusedError, "stopped"):
        owner.step()
    memory = BenchMemory(load_config(config))
    end = until(lambda: memory.read().manual_end)
    assert (end.status, end.reason) == ("aborted", state["ended_by"]), "on disk, for a panel that begins later"
    owner("home")
    assert owner.done()["stopped"] is False
    assert memory.read().lifted_unix_s > end.unix_s


def test_two_drives_on_a_bus_are_stopped_in_a_step(
    begin: Callable[..., Owner], served: Callable[..., ServedBench], tmp_path: Path
) -> None:
    """What stops shares the bus with what moves: nothing moves after the stop, and the drives say that they stand."""
    tables = {"stage": {"kind": "leadshine"}, "force": {"kind": "laumas", "baud": 115200}}
    bench = served(Config.model_validate(tables), stage="leadshine", force="laumas")
    for name in ("stage", "force"):
        tables[name]["port"] = bench.ports[name]
    config = tmp_path / "rig.toml"
    config.write_text(Config.model_validate(tables).as_toml(), encoding="utf-8")

    def frames() -> list[bytes]:
        log = max((state_folder() / "by_hand").glob("*.jsonl"))
        sent = [json.loads(line) for line in log.read_text("ascii").splitlines() if '"tx"' in line]
        return [bytes.fromhex(line["hex"]) for line in sent if line["port"] == bench.ports["stage"]]

    def stopped_in_a_step() -> float | None:
        """Where; None if a reading that came too late on a busy machine had ended the step before."""
        owner = begin(config)
        owner("zero", anyway=True)
        assert owner.done()["ended_by"] is None
        owner.step()
        until(lambda: any(is_move("leadshine", frame) for frame in frames()) or owner("status")["busy"] is None)
        assert owner("stop")["stopped"]
        state = owner.done()
        assert state["stopped"]
        at_mm = until(lambda: (found := owner("status"))["seen_unix_s"] > state["seen_unix_s"] and found["x_mm"])
        owner("leave")
        assert owner.end() == (0, "")
        return at_mm if state["ended_by"] == "stopped at once by the operator" else None

    at_mm = until(stopped_in_a_step)
    sent = frames()
    stop = next(number for number, frame in enumerate(sent) if is_stop("leadshine", frame))
    assert not [frame for frame in sent[stop:] if is_move("leadshine", frame)]
    again = begin(config)
    assert again("status")["x_mm"] == pytest.approx(at_mm, abs=0.003)


@pytest.mark.parametrize(
    ("number", "code", "kept"),
    [(signal.SIGTERM, 0, True), (signal.SIGKILL, -9, False)],
)
def test_a_signal_in_a_step_leaves_that_step(
    homed: tuple[Owner, Path], number: signal.Signals, code: int, kept: bool
) -> None:
    """Killed, too, the stage goes no farther than the step; asked to end, where it stands is remembered."""
    owner, config = homed
    owner.step()
    until(lambda: (owner("status")["x_mm"] or 0.0) < -1.2)
    ended, said = owner.end(number)
    assert ended == code
    assert said == ""
    known = BenchMemory(load_config(config)).read()
    assert (known.left_at_mm is not None) is kept
    stage = GrblStage(open_port(load_config(config).stage.port, 115200), CLOCK)
    at = until(lambda: (now := stage.look()).state in ("Idle", "Alarm") and now)
    stage.close()
    assert known.is_where_left(at) is kept
    assert at.x_mm >= -6.0 - 0.003


def test_manual_control_ends_with_the_panel_process(
    homed: tuple[Owner, Path], whole: tuple[ServedBench, Path]
) -> None:
    owner, config = homed
    owner("leave")
    owner.end()
    parent = Popen([sys.executable, "-c", PARENT, *COMMAND, str(config)], stdin=subprocess.PIPE)
    try:
        (there,) = until(announced)
        parent.kill()
        parent.communicate()
        until(lambda: not announced())
        with pytest.raises(ControlError):
            there.ask("status")
        until(lambda: BenchMemory(load_config(config)).read().left_at_mm)
    finally:
        parent.kill()
        parent.communicate()


def test_manual_control_that_does_not_begin_gives_one_line(
    rig_toml: Callable[..., Path], apart: tuple[str, str, Path]
) -> None:
    stage, _, config = apart
    for settings, says in ((rig_toml(stage), "use --without-force"), (config, "")):
        wire = open_port(stage, 115200) if not says else None
        with Popen([*COMMAND, str(settings)], stderr=subprocess.PIPE, text=True) as process:
            err = process.communicate(timeout=DEADLINE_S)[1]
        if wire is not None:
            wire.close()
        assert process.returncode in (1, 2)
        assert err.count("\n") == 1
        assert (says or "is in use by process") in err
