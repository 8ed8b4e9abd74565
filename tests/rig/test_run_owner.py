"""What a run answers to others, and a pause that ends wherever somebody first says so."""

import io
import os
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

import rig.cli.script_execution as owning_module
import rig.cli.signals as interrupts
from rig.bench.real import Request
from rig.cli.keyboard import line_waits
from rig.cli.run import ask_at_the_bench
from rig.cli.script_execution import AtTheTerminal, RequestedRun, RunOwner, owning
from rig.cli.signals import (
    STOP_SIGNAL,
    PauseRequest,
    at_a_safe_point,
    at_once,
    interrupt_main,
    stoppable,
    unstoppable,
)
from rig.clock import WallClock
from rig.control.client import RefusedError, announced
from rig.control.owned_stage import EndedError, OwnedStage, StopSwitch
from rig.control.owner_socket import ControlSocket
from rig.data import RunFolder
from rig.engine import RunAborted
from rig.plan.config import Config
from rig.session.script_run import AT_ONCE, FROM_THE_PANEL
from rig.session.session import NewRun
from rig.transport import TransportError
from tests.error_codes import raises
from tests.waiting import DEADLINE_S, until

if STOP_SIGNAL is None:
    pytest.skip("only where there are signals", allow_module_level=True)


@pytest.fixture
def owner() -> RunOwner:
    return RunOwner(StopSwitch(None, lambda: None), virtual=False)


def _asked(owner: RunOwner, do: str) -> Any:
    return owner.answers[do]({"do": do})


# --- in one word ---


def test_an_announcement_that_cannot_be_written_does_not_end_a_run(owner: RunOwner, tmp_path: Path) -> None:
    def full(run: Path) -> None:
        raise OSError(28, "No space left")

    owner.told = full
    owner.begins(RunFolder(tmp_path))
    assert owner.folder == RunFolder(tmp_path)


def test_a_stop_is_reported_with_the_state_it_interrupted(owner: RunOwner) -> None:
    owner.at("running")
    assert owner.stopped() is False
    with owner.asking():
        assert _asked(owner, "stop") == {"stopped": True}
    assert (owner._stopped_while, owner.stopped(), _asked(owner, "status")["stopped"]) == ("asking", True, True)


def test_a_stop_that_reached_no_stage_is_reported_as_unconfirmed(
    owner: RunOwner, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unplugged() -> None:
        raise TransportError("there is no port")

    monkeypatch.setattr(owner.switch, "stop", unplugged)
    assert _asked(owner, "stop") == {"stopped": True, "unconfirmed": "there is no port"}


def test_each_phase_of_a_run_may_be_stopped_once() -> None:
    interrupts: list[int] = []
    owner = RunOwner(StopSwitch(None, lambda: interrupts.append(1)), virtual=True)
    for phase in ("running", "reporting"):
        owner.at(phase)  # type: ignore[arg-type]
        for _ in range(2):
            _asked(owner, "stop")
    assert len(interrupts) == 2


def test_a_stop_is_recorded_only_after_its_bytes_are_sent(
    owner: RunOwner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done: list[str] = []
    over = owner.switch.over
    monkeypatch.setattr(owner.switch, "over", lambda: done.append("over") or over())
    monkeypatch.setattr(owning_module, "record_after", lambda *_: done.append("recorded"))
    owner.begins(RunFolder(tmp_path))
    _asked(owner, "stop")
    owner.record(_requested(NewRun(tmp_path), Config()))
    assert done == ["over", "recorded"]


@pytest.mark.parametrize("do", ["pause", "go_on"])
@pytest.mark.parametrize("phase", ["planning", "reporting"])
def test_a_run_is_paused_only_while_it_runs(owner: RunOwner, do: str, phase: Any) -> None:
    owner.at(phase)
    words = {"pause": "it can be paused only while it runs", "go_on": "it is not paused"}[do]
    assert _asked(owner, do) == {"ok": False, "problem": f"the run is {phase}; {words}"}
    assert owner.pause.asked() is False


def test_the_panel_pauses_and_continues_a_run(owner: RunOwner, capsys: pytest.CaptureFixture[str]) -> None:
    owner.at("running")
    assert _asked(owner, "go_on") == {"ok": False, "problem": "the run is running; it is not paused"}
    for _ in range(2):
        assert _asked(owner, "pause") == {"state": "pausing"}
    assert owner.pause.asked() is True
    assert _asked(owner, "go_on") == {"state": "running"}
    assert owner.pause.asked() is False
    assert capsys.readouterr().err == (
        "pausing at the next safe point, as the panel requested; press Ctrl-C to stop now\n"
        "continuing, as the panel requested\n"
    )


# --- whoever says first that it goes on ---


class Keyboard:
    """A terminal whose line comes when a test types it."""

    def __init__(self) -> None:
        self.read, self.write = os.pipe()

    def fileno(self) -> int:
        return self.read

    def isatty(self) -> bool:
        return True

    def readline(self) -> str:
        return os.read(self.read, 100).decode()

    def types(self, line: bytes) -> None:
        os.write(self.write, line)


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


Terminal = Callable[[], tuple[Keyboard, Screen]]


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    """To be called in the test itself: where it is set up, standard error is another one."""
    keyboard, screen = Keyboard(), Screen()

    def sit_down() -> tuple[Keyboard, Screen]:
        monkeypatch.setattr(sys, "stdin", keyboard)
        monkeypatch.setattr(sys, "stderr", screen)
        return keyboard, screen

    yield sit_down
    os.close(keyboard.read)
    os.close(keyboard.write)


@contextmanager
def _as_soon_as_it_waits(pause: PauseRequest, act: Callable[[], object]) -> Iterator[None]:
    def wait() -> None:
        until(lambda: pause.waits)
        act()

    thread = threading.Thread(target=wait)
    thread.start()
    yield
    thread.join(DEADLINE_S)


@pytest.mark.parametrize("asked", ["ask", "ask_from_elsewhere"])
@pytest.mark.parametrize("answered", ["typed", "elsewhere"])
def test_a_pause_at_a_terminal_ends_with_the_first_answer_of_keyboard_or_panel(
    terminal: Terminal, asked: str, answered: str
) -> None:
    keyboard, screen = terminal()
    pause = PauseRequest()
    getattr(pause, asked)()
    act = {"typed": lambda: keyboard.types(b"\n"), "elsewhere": pause.continue_remotely}[answered]
    with _as_soon_as_it_waits(pause, act):
        assert pause.go_on() is True
    assert (pause.asked(), pause.waits) == (False, False)
    said = screen.getvalue()
    assert "paused after a lift: press Enter to continue, Ctrl-C to end the run" in said
    assert ("continuing, as the panel requested" in said) is (answered == "elsewhere")


@pytest.mark.parametrize("wait", ["a pause", "a request"])
def test_the_stop_button_ends_a_pause_or_a_mounting_request(terminal: Terminal, wait: str) -> None:
    """The participant's button, say. Nobody types anything."""
    terminal()
    pause, looks = PauseRequest(), [1, 2, 3]
    pause.ask()

    def meanwhile() -> None:
        if not looks:
            raise RunAborted("pressed", "stop_button")
        looks.pop()

    with raises(RunAborted, "stop_button"):
        pause.go_on(meanwhile) if wait == "a pause" else ask_at_the_bench(Request("mount it", "bar:3.0", meanwhile))


def test_the_end_of_keyboard_input_ends_a_run_paused_from_the_panel(terminal: Terminal) -> None:
    keyboard, _ = terminal()
    pause = PauseRequest()
    pause.ask_from_elsewhere()
    keyboard.readline = lambda: ""  # type: ignore[method-assign]
    keyboard.types(b"\x04")
    assert pause.go_on() is False
    assert pause.asked() is True


def test_a_pause_continued_from_the_panel_leaves_typed_lines_unread(terminal: Terminal) -> None:
    """A pause that went on from elsewhere leaves the next line to whoever asks next."""
    keyboard, _ = terminal()
    pause = PauseRequest()
    pause.ask_from_elsewhere()
    with _as_soon_as_it_waits(pause, pause.continue_remotely):
        assert pause.go_on() is True
    keyboard.types(b"bar:3.0\n")
    assert keyboard.readline() == "bar:3.0\n"


@pytest.fixture
def nobody(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> pytest.CaptureFixture[str]:
    """There is no terminal."""
    monkeypatch.setattr(sys, "stdin", io.StringIO("\n"))
    return capsys


def test_without_a_terminal_a_pause_from_the_panel_waits_for_the_panel(nobody: pytest.CaptureFixture[str]) -> None:
    pause = PauseRequest()
    pause.ask_from_elsewhere()
    with _as_soon_as_it_waits(pause, pause.continue_remotely):
        assert pause.go_on() is True
    assert "paused after a lift: continue from the panel, or press Ctrl-C to end the run\n" in nobody.readouterr().err


def test_without_a_terminal_a_pause_requested_by_a_signal_ends_the_run(nobody: pytest.CaptureFixture[str]) -> None:
    pause = PauseRequest()
    pause.ask()
    assert pause.go_on() is False
    assert "paused" not in nobody.readouterr().err


@pytest.mark.parametrize("end", ["ask", "hang_up"])
def test_a_signal_ends_a_pause_that_only_the_panel_would_end(
    nobody: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, end: str
) -> None:
    """SIGTERM, or a terminal that goes away: nobody is left who knows of the panel."""
    monkeypatch.setattr(os, "dup2", lambda *_: None)
    pause = PauseRequest()
    pause.ask_from_elsewhere()
    with _as_soon_as_it_waits(pause, getattr(pause, end)):
        assert pause.go_on() is False


def test_ctrl_c_stops_at_once_where_the_panel_has_asked_for_a_pause(nobody: object) -> None:
    with at_a_safe_point() as pause:
        pause.ask_from_elsewhere()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        assert pause.asked() is True


def test_a_keyboard_that_cannot_be_polled_is_read(monkeypatch: pytest.MonkeyPatch) -> None:

    def no_socket(*_: object) -> None:
        raise OSError(10038, "not a socket")

    monkeypatch.setattr(select, "select", no_socket)
    assert line_waits(0.0) is True


# --- the main thread ---


def _from_a_thread(act: Callable[[], object]) -> None:
    thread = threading.Thread(target=act)
    thread.start()
    thread.join(DEADLINE_S)
    until(lambda: False)  # interrupted, or never


@pytest.mark.parametrize("signals", [True, False])
@pytest.mark.parametrize("enter", [stoppable, at_a_safe_point])
def test_another_thread_can_interrupt_the_main_thread(
    monkeypatch: pytest.MonkeyPatch, enter: Callable[[], AbstractContextManager[object]], signals: bool
) -> None:
    with enter():
        if not signals:
            monkeypatch.setattr(interrupts, "STOP_SIGNAL", None)
        with pytest.raises(KeyboardInterrupt):
            _from_a_thread(interrupt_main)


def test_without_stop_signals_a_stop_waits_for_the_record_and_interrupts_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As on Windows: what stopped one command is no second Ctrl-C of the next."""
    monkeypatch.setattr(interrupts, "STOP_SIGNAL", None)
    with unstoppable():
        interrupt_main()
    with pytest.raises(KeyboardInterrupt), at_once():
        _from_a_thread(interrupt_main)
    with at_a_safe_point() as pause:
        signal.raise_signal(signal.SIGINT)
        assert pause.asked()


# --- announced ---


class Script:
    name = "two"


SCRIPT: Any = Script()


def _requested(into: NewRun, config: Config) -> RequestedRun:
    return RequestedRun(SCRIPT, config, into, print)


def _owning(into: NewRun, *, virtual: bool = False, file: Path | None = None) -> Any:
    config = Config.model_validate({"stage": {"port": "/dev/a"}, "force": {"port": "/dev/b"}})
    return owning(_requested(into, config), None if virtual else OwnedStage(config, WallClock()), file)


@pytest.mark.parametrize("virtual", [False, True])
def test_a_run_is_announced_while_it_lasts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, virtual: bool) -> None:
    monkeypatch.chdir(tmp_path)
    with _owning(NewRun(Path("runs")), virtual=virtual, file=Path("rig.toml")) as owner:
        (one,) = (one for one in announced() if one.pid == os.getpid())
        assert (one.kind, one.virtual, one.ports) == ("run", virtual, () if virtual else ("/dev/a", "/dev/b"))
        assert (one.out, one.config) == (str(tmp_path / "runs"), str(tmp_path / "rig.toml"))
        assert (one.protocol, one.run) == ("two", None)
        assert one.ask("status") == {"ok": True, "state": "planning", "run": None, "stopped": False}
        with pytest.raises(RefusedError, match=r"^the run is planning; it can be paused only while it runs$"):
            one.ask("pause")
        owner.begins(RunFolder(tmp_path / "runs" / "one"))
        (one,) = (one for one in announced() if one.pid == os.getpid())
        assert one.run == str(tmp_path / "runs" / "one")
    assert not [one for one in announced() if one.pid == os.getpid()]


def test_a_run_that_cannot_be_announced_continues_with_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("RIG_RUNTIME_DIR", str(tmp_path / "file"))
    with _owning(NewRun(tmp_path)) as owner:
        owner.begins(RunFolder(tmp_path))
    assert capsys.readouterr().err.startswith("rig: warning: the panel cannot reach this run: ")


# --- a stop at whatever moment of its life ---


MOMENTS = {
    # moment: (whether the stop is taken, whether the run is ended by it)
    "as it is announced": (True, True),
    "before it plans": (True, True),
    "as it plans": (True, True),
    "as it ends": (True, True),
    "as it is written down": (False, False),
    "when nobody can ask any more": (False, False),
}


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_stop_is_recorded_or_refused_whenever_it_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    taken, ends = MOMENTS[moment]
    answers: list[Any] = []
    recorded: list[str] = []
    known: list[RunOwner] = []
    threads: list[threading.Thread] = []

    def ask() -> None:
        try:
            answers.append(_asked(known[0], "stop"))
        except EndedError as error:
            answers.append(str(error))

    def at(this: str) -> None:
        if this == moment and known and not threads:
            threads.append(threading.Thread(target=ask))
            threads[0].start()
            threads[0].join(DEADLINE_S)

    class Known(RunOwner):
        def __init__(self, *about: Any, **more: Any) -> None:
            super().__init__(*about, **more)
            known.append(self)

    class Announced(ControlSocket):
        def __enter__(self) -> ControlSocket:
            socket = super().__enter__()
            at("as it is announced")
            return socket

        def __exit__(self, *error: Any) -> None:
            super().__exit__(*error)
            at("when nobody can ask any more")

    begins, over = StopSwitch.begins, StopSwitch.over

    def beginning(switch: StopSwitch) -> None:
        at("before it plans")
        begins(switch)

    def ending(switch: StopSwitch) -> None:
        at("as it ends")
        over(switch)
        at("as it is written down")

    monkeypatch.setattr(owning_module, "RunOwner", Known)
    monkeypatch.setattr(owning_module, "ControlSocket", Announced)
    monkeypatch.setattr(StopSwitch, "begins", beginning)
    monkeypatch.setattr(StopSwitch, "over", ending)
    monkeypatch.setattr(
        owning_module, "record_before", lambda *_, **__: recorded.append("its folder") or RunFolder(tmp_path / "own")
    )
    monkeypatch.setattr(owning_module, "record_after", lambda *_: recorded.append("the stop"))
    ended = False
    try:
        with _owning(NewRun(tmp_path), virtual=True):
            at("as it plans")
    except KeyboardInterrupt:
        ended = True
    threads[0].join(DEADLINE_S)
    assert answers == [{"stopped": True} if taken else "it has just ended, so it moves nothing"]
    assert recorded == (["its folder", "the stop"] if taken else [])
    assert ended is ends


def test_a_signal_does_not_interrupt_the_recording_of_a_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`rig stop` sends it to whoever has the port and refuses to be asked."""
    written: list[str] = []

    def record(*_: object) -> None:
        interrupt_main()
        until(lambda: not signal.sigpending())
        written.append("whole")

    monkeypatch.setattr(owning_module, "record_after", record)
    with _owning(NewRun(tmp_path), virtual=True) as owner:
        owner.begins(RunFolder(tmp_path))
        owner.switch._interrupt_main = lambda: None
        owner.switch.stop()
    assert written == ["whole"]


@pytest.mark.parametrize(("by", "reason"), [("", AT_ONCE), ("panel", FROM_THE_PANEL)])
@pytest.mark.parametrize("began", [False, True])
def test_a_stop_is_recorded_once_the_run_has_ended(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    began: bool,
    by: str,
    reason: str,
) -> None:
    done: list[Any] = []

    def before(
        script: Any, config: Config, into: NewRun, *, virtual: bool, reason: str, clock: WallClock | None
    ) -> RunFolder:
        done.append(("before", into, virtual, reason, clock))
        return RunFolder(tmp_path / "own")

    monkeypatch.setattr(owning_module, "record_before", before)
    monkeypatch.setattr(owning_module, "record_after", lambda *what: done.append(what))
    monkeypatch.setattr(StopSwitch, "kept", "its bytes")
    with _owning(NewRun(tmp_path), virtual=True):
        pass
    assert done == []
    folder = RunFolder(tmp_path / ("run" if began else "own"))
    with suppress(KeyboardInterrupt), _owning(NewRun(tmp_path), virtual=True) as owner:
        if began:
            owner.begins(folder)
            owner.at("reporting")
        (one,) = (one for one in announced() if one.pid == os.getpid())
        _from_a_thread(lambda: one.post_stop(by=by)(DEADLINE_S))
    assert AtTheTerminal(owner.pause, lambda *_: None, lambda: None, None, owner).stopped_by == reason
    state = "reporting" if began else "planning"
    assert done == [
        *([] if began else [("before", NewRun(tmp_path), True, reason, None)]),
        (folder, state, "its bytes", reason),
    ]
    assert (f"rig: the run folder {folder.path} records the stop\n" in capsys.readouterr().err) is not began


def test_a_stop_that_cannot_be_recorded_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left")

    monkeypatch.setattr(owning_module, "record_after", full)
    with _owning(NewRun(tmp_path), virtual=True) as owner:
        owner.begins(RunFolder(tmp_path))
        owner.switch._interrupt_main = lambda: None
        owner.switch.stop()
    assert capsys.readouterr().err == "rig: the stop could not be recorded: [Errno 28] No space left\n"
