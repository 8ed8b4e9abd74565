"""The participant's stop button in every phase, on each stage; what `[stop]` may say; a key as a device of Linux."""

import json
import os
import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest

import rig.bench.virtual as benches
import rig.cli.confirm as confirming
import rig.session.session as sessions
from rig.control.owned_stage import OwnedStage
from rig.data import read_run
from rig.devices.stop_key import StopKey, StopKeyError
from rig.engine import Journal, TripError
from rig.errors import BadInputError
from rig.plan.config import load_config
from rig.session.hardware_stop import BY_THE_BUTTON, explained_by_stop_inputs, stop_inputs_of
from rig.settings import StopSettings
from sim.devices.clock import VirtualClock
from sim.devices.line import StopPins
from sim.models.fingertip import Fingertip
from tests.error_codes import raises
from tests.program import NEAR_HOME, Ended, Program
from tests.waiting import until

pytestmark = pytest.mark.usefixtures("empty_figures")

SCRIPT = """\
def run(rig):
    rig.mount("bar:3.0")
    rig.home()
    rig.zero()
    rig.move_to(x_mm=1.0)
    rig.indent(force_gwt=1.0, hold_s=1.0)
    rig.move_to(x_mm=-1.0)
    rig.indent(force_gwt=1.0, hold_s=1.0)
"""
BENCHES = {
    "door": "[stage]\nkind = 'grbl'\n[stop]\nkind = 'board'\ninput = 'door'\n",
    "hold": "[stage]\nkind = 'grbl'\n[stop]\nkind = 'board'\ninput = 'hold'\n",
    "di1": "[stage]\nkind = 'leadshine'\n[force]\nkind = 'laumas'\n[stop]\nkind = 'board'\ninput = 'di1'\n",
}
STOP_BYTES = {"door": ("2118",), "hold": ("2118",), "di1": ("600200", "6002")}
AFTER: dict[str, tuple[str, Callable[[Mapping[str, Any]], bool], float]] = {
    "homing": ("mount", lambda data: True, 1.0),
    "the way to a place": ("zero", lambda data: True, 0.5),
    "clearance": ("sample", lambda data: data["phase"] == "clearance", 0.0),
    "approach": ("sample", lambda data: data["phase"] == "approach", 0.0),
    "approach, in motion": ("sample", lambda data: data["phase"] == "approach", 0.03),
    "press": ("sample", lambda data: data["phase"] == "press", 0.0),
    "press, in motion": ("sample", lambda data: data["phase"] == "press", 0.02),
    "hold": ("hold_start", lambda data: True, 0.4),
    "lift": ("hold_end", lambda data: True, 0.05),
    "coming back": ("indentation_end", lambda data: True, 0.5),
}


@dataclass
class Bench:
    """The program beside a script, and the board of its virtual bench."""

    program: Program
    config: Path
    board: Any = None
    clock: Any = None
    pressed_s: float = -1.0
    events: list[tuple[str, dict[str, Any]]] = field(default_factory=list)

    def dry_run(self) -> Ended:
        return self.program("dry-run", "mine.py", "--config", self.config, "--json")

    def press(self, name: str) -> None:
        self.pressed_s = self.clock.monotonic_s()
        self.board.press(name)


@pytest.fixture
def bench(finger: Fingertip, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Bench:
    found = Bench(program, tmp_path / "rig.toml")
    made = benches.virtual_stage

    def virtual_stage(scheduler: Any, line: Any, config: Any) -> Any:
        found.board, found.clock = made(scheduler, line, config), scheduler
        return found.board

    monkeypatch.setattr(benches, "virtual_stage", virtual_stage)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    return found


@pytest.fixture
def after(bench: Bench) -> Iterator[Callable[..., None]]:
    """Do something so many seconds of the bench after the first event of a stream that counts."""
    patch, event = pytest.MonkeyPatch(), Journal.event

    def at(stream: str, counts: Callable[[Mapping[str, Any]], bool], then_s: float, deed: Callable[[], None]) -> None:
        due = True

        def seen(journal: Journal, name: str, data: Mapping[str, Any]) -> None:
            nonlocal due
            event(journal, name, data)
            if due and name == stream and counts(data):
                due = False
                bench.clock.call_at(bench.clock.monotonic_s() + then_s, deed)

        patch.setattr(Journal, "event", seen)

    yield at
    patch.undo()


@pytest.mark.quick(rows=lambda name, phase: name == "door" or phase not in ("clearance", "approach", "press"))
@pytest.mark.parametrize("phase", AFTER)
@pytest.mark.parametrize("name", BENCHES)
def test_a_press_of_the_boards_input_stops_the_stage_whatever_it_does_and_ends_the_run(
    name: str, phase: str, bench: Bench, after: Callable[..., None]
) -> None:
    bench.config.write_text(BENCHES[name] + NEAR_HOME, encoding="utf-8")
    after(*AFTER[phase], lambda: bench.press(name))
    ended = bench.dry_run()
    assert bench.pressed_s > 0
    assert ended.code == 130, ended.err
    said = json.loads(ended.out)
    assert BY_THE_BUTTON in said["ending"]["reason_text"]
    run = read_run(Path(said["run"]))
    assert run.stop is not None
    assert (run.stop["status"], run.stop["reason"]) == ("aborted", BY_THE_BUTTON)
    wire = [json.loads(line) for line in run.folder.bytes_log.read_text(encoding="ascii").splitlines()]
    sent = [
        chunk["t_s"]
        for chunk in wire
        if chunk["dir"] == "tx" and chunk["port"] == "stage" and any(h in chunk["hex"] for h in STOP_BYTES[name])
    ]
    after_it = [t_s for t_s in sent if t_s >= bench.pressed_s]
    assert after_it, "the stop went out"
    stopped, stands = (bench.board.carriage_steps_at(t) for t in (min(after_it), bench.clock.monotonic_s()))
    assert stands[2] == stopped[2] if phase != "homing" else stands[2] - stopped[2] < 400
    assert abs(stands[0] - stopped[0]) < 40, "a tenth of a mm: the lateral drive has no button of its own"


def test_a_button_that_is_not_pressed_changes_nothing_in_a_run(bench: Bench) -> None:
    for name in ("door", "di1"):
        bench.config.write_text(BENCHES[name] + NEAR_HOME, encoding="utf-8")
        ended = bench.dry_run()
        assert ended.code == 0, ended.err
        assert json.loads(ended.out)["complete"]


@pytest.mark.parametrize("key", ["input", "trip_input"])
@pytest.mark.parametrize(("stage", "name"), [("grbl", "door"), ("grbl", "hold"), ("leadshine", "di4")])
def test_a_run_is_refused_while_a_stop_input_is_active(
    stage: str, name: str, key: str, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    button = f"kind = 'board'\ninput = {name!r}" if key == "input" else f"trip_input = {name!r}"
    bench.config.write_text(f"[stage]\nkind = {stage!r}\n[stop]\n{button}\n", encoding="utf-8")
    made = benches.virtual_stage

    def pressed(*told: Any) -> Any:
        board = made(*told)
        assert isinstance(board, StopPins)
        board.press(name)
        return board

    monkeypatch.setattr(benches, "virtual_stage", pressed)
    monkeypatch.setattr("rig.session.rehearse.with_stand_ins", lambda config: config, raising=False)
    monkeypatch.setattr("rig.session.rehearsal_summary.rehearsed", _unrehearsed)
    ended = bench.dry_run()
    assert ended.code == 2, ended.err
    assert f"stop.{key} = {name!r}: " in ended.err
    assert not list((bench.config.parent / "runs").glob("*"))


def _unrehearsed(*_: object) -> Any:
    raise TripError("its bench would be the first")


# --- what may be said ---


DOOR_OR_HOLD = {"allowed": "door or hold", "stage": "grbl"}


@pytest.mark.parametrize(
    ("text", "code", "fields"),
    [
        ("kind = 'pedal'", "invalid_value", {"key": "stop.kind", "rule": "must be 'off', 'board' or 'key'"}),
        ("kind = 'board'", "expected_with_kind", {"key": "stop", "setting": "input", "kind": "board"}),
        ("kind = 'key'", "expected_with_kind", {"key": "stop", "setting": "device", "kind": "key"}),
        ("input = 'door'", "expected_with_kind_only", {"setting": "input", "kind": "board"}),
        ("device = '/dev/input/event3'", "expected_with_kind_only", {"setting": "device", "kind": "key"}),
        ("key_code = 30", "expected_with_kind_only", {"setting": "key_code", "kind": "key"}),
        ("kind = 'board'\ninput = ' '", "no_name", {"key": "stop.input"}),
        (
            "kind = 'board'\ninput = 'window'",
            "no_such_input",
            {"setting": "input", "input": "window", **DOOR_OR_HOLD},
        ),
        ("kind = 'board'\ninput = 'di1'", "no_such_input", {"setting": "input", "input": "di1", **DOOR_OR_HOLD}),
        ("trip_input = 'di9'", "no_such_input", {"setting": "trip_input", "input": "di9", **DOOR_OR_HOLD}),
        ("kind = 'board'\ninput = 'door'\ntrip_input = 'door'", "input_used_twice", {"key": "stop"}),
        ("trip_gwt = 200", "no_trip_input", {"key": "stop"}),
        (
            "trip_input = 'hold'\ntrip_gwt = -1",
            "invalid_value",
            {"key": "stop.trip_gwt", "rule": "must be greater than 0"},
        ),
        ("kind = 'key'\ndevice = 'x'\nkey_code = 9000", "invalid_value", {"key": "stop.key_code", "le": 767}),
        ("button = 'door'", "unknown_key", {"key": "stop.button"}),
    ],
)
def test_an_invalid_button_in_the_configuration_is_refused_in_one_line(
    text: str, code: str, fields: dict[str, Any], tmp_path: Path
) -> None:
    (tmp_path / "rig.toml").write_text(f"[stop]\n{text}\n", encoding="utf-8")
    with raises(BadInputError, code, **fields) as caught:
        load_config(tmp_path / "rig.toml")
    assert "\n" not in str(caught.value)


# --- a key ---

A, B = 30, 48


def event(code: int, value: int, kind: int = 1) -> bytes:
    """As the kernel tells it."""
    return struct.pack("llHHi", 0, 0, kind, code, value)


@pytest.fixture
def pipe(tmp_path: Path) -> Iterator[tuple[Path, Callable[[bytes], object]]]:
    path = tmp_path / "pedal"
    os.mkfifo(path)
    file = os.open(path, os.O_RDWR)
    yield path, lambda data: os.write(file, data)
    os.close(file)


def test_a_key_is_pressed_until_it_is_released(pipe: tuple[Path, Callable[[bytes], object]]) -> None:
    path, send = pipe
    key = StopKey(path)
    presses: list[int] = []
    assert not key.pressed
    send(event(A, 1) + event(0, 0, 0))
    until(lambda: key.pressed)
    key.arm(lambda: presses.append(1))
    send(event(A, 2))  # held: the kernel repeats it
    send(event(A, 0) + event(4, 589825, 4))
    until(lambda: not key.pressed)
    assert presses == []
    send(event(B, 1))
    until(lambda: presses == [1])
    key.close()


def test_a_named_pipe_may_be_written_by_one_program_after_the_other(tmp_path: Path) -> None:
    path = tmp_path / "pedal"
    os.mkfifo(path)
    key = StopKey(path)
    for value in (1, 0, 1):
        path.write_bytes(event(A, value))
        until(lambda value=value: key.pressed is bool(value))  # type: ignore[misc]
    key.close()


def test_one_key_of_a_keyboard_may_be_the_button(pipe: tuple[Path, Callable[[bytes], object]]) -> None:
    path, send = pipe
    key, presses = StopKey(path, A), list[int]()
    key.arm(lambda: presses.append(1))
    send(event(B, 1) + event(A, 1, 17) + event(A, 1))  # 17: a light of the keyboard
    until(lambda: presses)
    assert presses == [1]
    key.close()


def test_a_closed_button_leaves_no_file_open_and_an_open_one_delays_no_exit(
    pipe: tuple[Path, Callable[[bytes], object]],
) -> None:
    path, _ = pipe
    before = os.listdir("/dev/fd")
    key = StopKey(path)
    (thread,) = (thread for thread in threading.enumerate() if thread.name == "stop button")
    assert thread.daemon
    key.close()
    assert not thread.is_alive()
    assert os.listdir("/dev/fd") == before


@pytest.mark.parametrize(
    ("read", "code"), [(OSError(19, "No such device"), "gone"), (b"", "no_key_events")], ids=["unplugged", "closed"]
)
def test_a_button_that_is_unplugged_counts_as_gone(
    pipe: tuple[Path, Callable[[bytes], object]], monkeypatch: pytest.MonkeyPatch, read: bytes | OSError, code: str
) -> None:
    path, send = pipe
    key, usual = StopKey(path), os.read

    def gone(fd: int, count: int) -> bytes:
        if count <= 1000:
            return usual(fd, count)
        if isinstance(read, OSError):
            raise read
        return read

    monkeypatch.setattr(os, "read", gone)
    send(event(A, 1))
    until(lambda: key.problem)
    with raises(StopKeyError, code, path=str(path)):
        _ = key.pressed
    key.close()


@pytest.mark.parametrize(
    ("down", "only", "pressed"),
    [([], None, False), ([A], None, True), ([A], A, True), ([A], B, False), ([B, 767], A, False), ([767], 767, True)],
)
def test_a_key_held_while_the_device_is_opened_counts_as_pressed(
    down: list[int], only: int | None, pressed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A device of Linux is asked for its keys (EVIOCGKEY, a bit each) and reserved (EVIOCGRAB)."""
    fcntl, tty = pytest.importorskip("fcntl"), pytest.importorskip("tty")
    master, device = os.openpty()
    tty.setraw(device)
    grabbed: list[int] = []

    def ioctl(file: int, request: int, argument: Any) -> int:
        if request == 0x40044590:
            grabbed.append(argument)
        else:
            assert request & ~(0x3FFF << 16) == 0x80004518
            assert request >> 16 & 0x3FFF == len(argument) >= 96, "a bit for each key up to 767"
            for code in down:
                argument[code // 8] |= 1 << code % 8
        return 0

    monkeypatch.setattr(fcntl, "ioctl", ioctl)
    key = StopKey(Path(os.ttyname(device)), only)
    assert key.pressed is pressed
    assert grabbed == [1]
    for code in down:
        os.write(master, event(code, 0))
    until(lambda: not key.pressed)
    key.close()
    os.close(device)
    os.close(master)


def test_a_device_without_key_events_is_no_button(pipe: tuple[Path, Callable[[bytes], object]]) -> None:
    path, send = pipe
    key = StopKey(path)
    send(event(A, 1) + b"x")
    until(lambda: key.problem)
    with raises(StopKeyError, "no_key_events", path=str(path)):
        _ = key.pressed
    key.close()


@pytest.mark.parametrize(
    ("what", "code"), [("missing", "not_opened"), ("a file", "not_grabbed"), ("a folder", "not_grabbed")]
)
def test_a_path_that_is_no_input_device_is_refused(what: str, code: str, tmp_path: Path) -> None:
    path = tmp_path / "pedal"
    if what == "a file":
        path.write_text("x", encoding="utf-8")
    if what == "a folder":
        path.mkdir()
    before = os.listdir("/dev/fd")
    with raises(StopKeyError, code, path=str(path)):
        StopKey(path)
    assert os.listdir("/dev/fd") == before


class GoneKey:
    """A foot switch that was pulled out."""

    problem = "/dev/input/by-id/pedal: No such device"


@pytest.mark.parametrize("down_mm", [0.0, 0.05])
def test_a_button_that_is_gone_trips_and_lifts(down_mm: float, spring: Callable[..., Any]) -> None:
    bench = spring()
    engine = bench.ready()

    class Gone:
        key = GoneKey()

    settings = bench.settings.model_copy(update={"stop": StopSettings(kind="key", device="pedal")})
    clearance_mm = settings.habits.clearance_mm
    engine.go_to_height(clearance_mm - down_mm, 0.5)
    with raises(TripError, "button_gone", problem=GoneKey.problem):
        _read_with(settings, engine, Gone())
    assert bench.height_mm >= clearance_mm - 1e-3


def _read_with(settings: Any, engine: Any, button: Any) -> None:
    engine.stop_inputs = stop_inputs_of(settings, button)
    with explained_by_stop_inputs(settings, engine.bench.stage):
        engine.reading()


# --- before a real run ---


@pytest.fixture
def real(
    finger: Fingertip, program: Program, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, pipe: tuple[Path, Any]
) -> Callable[..., Ended]:
    """A real run on a virtual bench, with a key on a pipe."""

    def open_bench(config: Any, clock: Any, log: Any, ask: Any, pause: Any, stage: Any) -> Any:
        found = benches.virtual_bench(config, finger, log, VirtualClock(0.0, clock.monotonic_s()), pause)
        return replace(found, virtual=False)  # type: ignore[arg-type]

    monkeypatch.setattr(sessions, "open_bench", open_bench)
    monkeypatch.setattr(OwnedStage, "open", lambda stage: stage)
    monkeypatch.setattr(confirming, "_is_interactive", lambda: True)
    monkeypatch.setattr(confirming, "_BUTTON_S", 0.2)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(SCRIPT, encoding="utf-8")
    for port in ("stage", "force"):
        (tmp_path / port).touch()
    ports = f"[stage]\nport = '{tmp_path / 'stage'}'\n[force]\nport = '{tmp_path / 'force'}'\n"
    (tmp_path / "rig.toml").write_text(
        f"{NEAR_HOME}{ports}[stop]\nkind = 'key'\ndevice = '{pipe[0]}'\nkey_code = {A}\n", encoding="utf-8"
    )
    return lambda *more: program("run", "mine.py", "--config", "rig.toml", *more, "--json", typed="\n")


def _first(folder: Path) -> dict[str, Any]:
    (run,) = (folder / "runs").iterdir()
    found: dict[str, Any] = read_run(run).start
    return found


def test_before_a_real_run_the_button_is_pressed_and_released_once(
    real: Callable[..., Ended], pipe: tuple[Path, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = confirming._seen

    def somebody_does_it(button: Any, request: str, *, pressed: bool) -> None:
        pipe[1](event(A, int(pressed)))
        seen(button, request, pressed=pressed)

    monkeypatch.setattr(confirming, "_seen", somebody_does_it)
    ended = real()
    assert ended.code == 0, ended.err
    assert f"stop      the key {pipe[0]}, not pressed, not tested" in ended.err
    assert "stop      not pressed, tested" in ended.err
    assert _first(tmp_path)["stop_button"] == {"kind": "key", "tested": True}


@pytest.mark.parametrize("pressed_before", [False, True])
def test_no_run_begins_with_a_button_that_is_not_pressed_or_stays_pressed(
    pressed_before: bool, real: Callable[..., Ended], pipe: tuple[Path, Any], tmp_path: Path
) -> None:
    if pressed_before:
        pipe[1](event(A, 1))
    ended = real()
    assert ended.code == 130
    assert (confirming.RELEASE_IT if pressed_before else confirming.PRESS_IT) in ended.err.splitlines()[-1]
    assert not list((tmp_path / "runs").glob("2*"))


def test_with_yes_the_button_is_read_and_reported_as_not_tested(real: Callable[..., Ended], tmp_path: Path) -> None:
    ended = real("--yes")
    assert ended.code == 0, ended.err
    assert "stop      not pressed, not tested" in ended.err
    assert _first(tmp_path)["stop_button"] == {"kind": "key", "tested": False}


def test_with_yes_a_pressed_button_refuses_the_run(
    real: Callable[..., Ended], pipe: tuple[Path, Any], tmp_path: Path
) -> None:
    pipe[1](event(A, 1))  # it waits there for whoever opens the pipe
    ended = real("--yes")
    assert ended.code == 2, ended.err
    assert "rig: stop: the participant's stop button is pressed" in ended.err
    assert not list((tmp_path / "runs").glob("2*"))


def test_a_missing_button_refuses_the_run(real: Callable[..., Ended], pipe: tuple[Path, Any]) -> None:
    pipe[0].rename(pipe[0].with_name("elsewhere"))
    ended = real("--yes")
    assert ended.code == 2, ended.err
    assert f"rig: stop.device: {pipe[0]}: No such file or directory" in ended.err
