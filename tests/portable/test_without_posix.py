"""The program with everything hidden that Windows lacks, in this process's children and all that they begin.

They are forked from a Python that has it hidden (tests/preloaded.py), but for the first one.
"""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from rig.plan.config import Config
from rig.transport import open_port
from sim import compiling
from tests.preloaded import Popen
from tests.program import EMPTY_FIGURES, INIT_ANSWERS, SEVERAL, WHOLE, press_script
from tests.waiting import DEADLINE_S, gathered, until

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
NEAR: dict[str, Any] = {
    "stage": {"kind": "grbl"},
    "frame": {"pad_centre_x_mm": -3.0, "pad_y_mm": -2.0, "apex_z_mm": -4.0},
    "force": {"kind": "mtsics", "baud": 115200, "sample_period_s": 0.02},
    "habits": {
        "clearance_mm": 0.4,
        "descent_speed_mm_s": 2.0,
        "approach_speed_mm_s": 2.0,
        "press_speed_mm_s": 2.0,
        "settle_readings": 5,
    },
    "virtual": {"indentor": "bar:3.0"},
}
FAST = ("$110=3000", "$111=3000", "$112=3000", "$120=500", "$121=500", "$122=500", "$24=600", "$25=3000", "$26=10")
SCRIPT = press_script("doi_mm=0.3, hold_s={hold_s}")
EDGES = """\
def run(rig):
    rig.mount("step:1")
    rig.home()
    rig.zero()
    for x_mm in (-0.8, 0.0, 0.8):
        rig.move_to(x_mm=x_mm)
        rig.indent(doi_mm=0.3)
"""
SWALLOWS = """
            try: time.sleep(0.01)
            except Exception: pass"""
Rig = Callable[..., "subprocess.CompletedProcess[str]"]
BEGUN_ANEW = "test_the_product_sees_another_system_and_the_rest_sees_this_one"
UNDRAWN = f"""\
{EMPTY_FIGURES}
import rig.cli.compare
from rig.cli import main
rig.cli.compare.stimulus_maps = lambda *_: []
main()
"""


@pytest.fixture(scope="module", autouse=True)
def _machine_code() -> None:
    """As on Windows, the contact's loops are looked for in the user's cache, where compiling them takes a minute."""
    here = compiling._folder()
    if here is None:
        return
    there = compiling.cache_dir() / here.name
    for loops in here.iterdir():
        if not (there / loops.name).exists():
            there.mkdir(mode=0o700, parents=True, exist_ok=True)
            part = there / f"{loops.name}.{os.getpid()}"
            shutil.copytree(loops, part)
            with suppress(OSError):  # another process was first
                part.rename(there / loops.name)
            shutil.rmtree(part, ignore_errors=True)


@pytest.fixture(autouse=True)
def _forked(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.function.__name__ != BEGUN_ANEW:
        monkeypatch.setattr(subprocess, "Popen", Popen)


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    private = {name: str(tmp_path / name) for name in ("RIG_RUNTIME_DIR", "RIG_STATE_DIR", "PROGRAMDATA")}
    Path(private["PROGRAMDATA"]).mkdir()
    return {**os.environ, **private, "PYTHONPATH": str(HERE)}


@pytest.fixture
def begun(environment: dict[str, str], tmp_path: Path) -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Begin a command, which does not outlive the test."""
    with ExitStack() as stack:

        def begin(*words: object) -> "subprocess.Popen[str]":
            program = ["-c", UNDRAWN] if words[0] in ("compare", "identify") else [WHOLE]
            process = subprocess.Popen(
                [sys.executable, *program, *map(str, words)], env=environment, cwd=tmp_path, text=True,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            )  # fmt: skip

            def end() -> None:
                if process.poll() is None:
                    process.kill()
                process.communicate()

            stack.callback(end)
            return process

        yield begin


@pytest.fixture
def rig(begun: Callable[..., "subprocess.Popen[str]"]) -> Rig:
    def ended(*words: object, typed: str = "", code: int = 0) -> "subprocess.CompletedProcess[str]":
        process = begun(*words)
        out, err = process.communicate(typed, timeout=DEADLINE_S)
        assert process.returncode == code, err
        return subprocess.CompletedProcess(words, process.returncode, out, err)

    return ended


@pytest.fixture
def bench(begun: Callable[..., "subprocess.Popen[str]"], tmp_path: Path) -> Path:
    """Configuration of `rig serve` on the ports that it chose."""
    config = tmp_path / "rig.toml"
    config.write_text(Config.model_validate(NEAR).as_toml(), encoding="utf-8")
    serving = begun("serve", "--config", config)
    assert serving.stdout is not None
    ports = json.loads(serving.stdout.readline())
    assert all(re.fullmatch(r"tcp://127\.0\.0\.1:\d+", port) for port in ports.values())
    wire = open_port(ports["stage"], 115200)
    for line in FAST:
        wire.write(f"{line}\n".encode("ascii"))
        gathered(partial(wire.read, 0.1), lambda heard: b"ok" in heard)
    wire.close()
    served = {**NEAR, **{name: {**NEAR[name], "port": port} for name, port in ports.items()}}
    config.write_text(Config.model_validate(served).as_toml(), encoding="utf-8")
    return config


def _script(tmp_path: Path, hold_s: float) -> Path:
    path = tmp_path / "script.py"
    path.write_text(SCRIPT.format(hold_s=hold_s), encoding="utf-8")
    return path


def test_the_product_sees_another_system_and_the_rest_sees_this_one(environment: dict[str, str]) -> None:
    code = """
import os, signal, socket, sys
import rig.control.connection, rig.cli.signals, rig.transport.ownership as ownership, sim.workers, sim.benchmark
assert not hasattr(rig.control.connection.socket, "AF_UNIX") and rig.cli.signals.STOP_SIGNAL is None
assert ownership.sys.platform == "win32" and ownership.os.name == "nt" and not hasattr(ownership.os, "fork")
assert not hasattr(ownership, "fcntl") and not hasattr(sim.benchmark, "resource")
assert not hasattr(sim.workers.signal, "SIGUSR1") and sim.workers.signal.SIGINT is signal.SIGINT
assert os.name == "posix" and sys.platform == "linux" and hasattr(os, "fork") and hasattr(socket, "AF_UNIX")
"""
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)


def test_check_dry_run_show_and_compare(rig: Rig, tmp_path: Path) -> None:
    script = tmp_path / "edges.py"
    script.write_text(EDGES, encoding="utf-8")
    assert rig("check", script).stdout
    made = rig("dry-run", script, "--out", "runs", "--json")
    (run,) = (path for path in (tmp_path / "runs").iterdir() if not path.name.startswith("."))
    assert json.loads(made.stdout)["complete"] is True
    assert rig("show", run).stdout
    recorded = ROOT / "examples" / "tutorial" / "synthetic_afferent.csv"
    verdict = rig("compare", run, "--recorded", f"step:1={recorded}", "--json")
    assert json.loads(verdict.stdout)["rows"]


def read_ports(config: Path) -> tuple[str, str]:
    from rig.plan.config import load_config

    found = load_config(config)
    return found.stage.port, found.force.port


def test_a_bench_is_found_and_a_run_is_stopped_in_a_hold(
    rig: Rig, bench: Path, begun: Callable[..., "subprocess.Popen[str]"], tmp_path: Path
) -> None:
    """Whoever owns it sends the bytes of a stop and confirms; its main thread is interrupted without a signal."""
    served = read_ports(bench)
    ports = [word for port in served for word in ("--port", port)]
    rig("init", "--yes", "--to", "found.toml", *ports, *INIT_ANSWERS)
    assert read_ports(tmp_path / "found.toml") == served
    running = begun("run", _script(tmp_path, 30.0), "--yes", "--config", bench, "--out", "stopped")
    assert running.stdin is not None
    running.stdin.write("\n" * 9)
    running.stdin.flush()

    def holds() -> bool:
        assert running.poll() is None, running.communicate()
        return any('"hold"' in path.read_text(encoding="utf-8") for path in tmp_path.glob("stopped/*/events.jsonl"))

    until(holds)
    found = json.loads(rig("stop", "--config", bench, "--json").stdout)
    assert found["owner"] == running.pid, "Windows does not name the owner of a port, its note does"
    running.communicate(timeout=DEADLINE_S)
    assert running.returncode == 130


def test_the_panel_serves_its_page(begun: Callable[..., "subprocess.Popen[str]"], tmp_path: Path) -> None:
    panel = begun("panel", "--no-browser", "--json")
    assert panel.stdout is not None
    url = str(json.loads(panel.stdout.readline())["url"]).partition("#")[0]

    def answers() -> bool:
        try:
            return bool(urllib.request.urlopen(url, timeout=DEADLINE_S).status == 200)
        except urllib.error.URLError:
            return False

    until(answers)
    panel.send_signal(signal.SIGINT)
    panel.communicate(timeout=DEADLINE_S)
    assert panel.returncode == 0


def test_what_waits_for_sockets_looks_up_for_ctrl_c(environment: dict[str, str]) -> None:
    """Windows runs the handler of a signal when the wait has ended."""
    code = """
from sim.serve.real_time_loop import WallScheduler
scheduler = WallScheduler()
scheduler.run_once()
print("looked up")
"""
    words = [sys.executable, "-c", code]
    ended = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=DEADLINE_S, check=True)
    assert ended.stdout == "looked up\n"


def test_a_finger_is_identified_in_a_rehearsal(rig: Rig, tmp_path: Path) -> None:
    rig("identify", "--dry-run", "--to", "finger.toml", "--presses", "1")
    assert (tmp_path / "finger.toml").exists()


def require_printed(code: str, printed: str, environment: dict[str, str]) -> None:
    """Run code in a process; it must succeed and print this text."""
    ended = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=DEADLINE_S
    )
    assert (ended.returncode, ended.stdout) == (0, printed), ended.stderr


def test_a_script_that_makes_no_step_is_ended(environment: dict[str, str]) -> None:
    """Also one that takes every exception for its own."""
    code = f"""
import time
import rig.protocol.handlers as patience
patience.LONGEST_SILENCE_S = 0.2
class Then:
    def handle(self, step, place):
        time.sleep(0.5)  # in a step nobody is impatient
        return "done"
patient = patience.Patience(Then())
try:
    with patience.impatient():
        assert patient.handle(type("S", (), {{"verb": "rest"}})(), None) == "done"
        while True: {SWALLOWS}
except patience.SilentScriptError as error:
    assert str(error).endswith(" 0.2 s")
    time.sleep(0.3)
    print("ended")
with patience.impatient():
    pass
assert not patience._watches
"""
    require_printed(code, "ended\n", environment)


def test_a_script_whose_end_did_not_arrive_in_time_makes_no_further_step(environment: dict[str, str]) -> None:
    """It was in compiled code when it was silent for too long."""
    code = """
import ctypes, time, types
import rig.protocol.handlers as patience
patience.LONGEST_SILENCE_S = 0.2
sent, done = [], []
api = types.SimpleNamespace(PyThreadState_SetAsyncExc=lambda thread, kind: sent.append(kind))
patience.ctypes = types.SimpleNamespace(c_ulong=ctypes.c_ulong, py_object=ctypes.py_object, pythonapi=api)
class Then:
    def handle(self, step, place):
        done.append(step)
patient = patience.Patience(Then())
try:
    with patience.impatient():
        while not sent:
            time.sleep(0.01)
        patient.handle(type("S", (), {"verb": "rest"})(), None)
except patience.SilentScriptError:
    print("ended", done, sent[1:])
"""
    require_printed(code, "ended [] [None]\n", environment)


def test_keys_of_the_console_are_read(environment: dict[str, str]) -> None:
    code = """
import sys, types
from rig.cli import keyboard
def typing(typed):
    typed = list(typed)
    keyboard.msvcrt = types.SimpleNamespace(kbhit=lambda: bool(typed), getwch=lambda: typed.pop(0))
sys.stdin = types.SimpleNamespace(isatty=lambda: True)
with keyboard.single_keys() as keys:
    typing("")
    assert keys() == b"" and not keyboard.line_waits(0.0)
    typing("dd")
    assert keyboard.line_waits(0.0) and keys() == b"dd"
    typing("d\\xe0H")  # an arrow, whose code is no letter typed
    assert keys() == b"d\\0"
    typing("d\\x03")
    try:
        keys()
    except KeyboardInterrupt:
        print("interrupted")
"""
    require_printed(code, "interrupted\n", environment)


def test_keys_from_a_pipe_are_read(environment: dict[str, str]) -> None:
    code = """
import time
from rig.cli import keyboard
with keyboard.single_keys() as keys:
    heard = b""
    while (more := keys()) is not None:
        heard += more
        time.sleep(0.01)
print(heard)
"""
    ended = subprocess.run([sys.executable, "-c", code], env=environment, input="dq", capture_output=True, text=True)
    assert (ended.returncode, ended.stdout) == (0, "b'dq'\n"), ended.stderr


def test_a_port_has_one_owner_until_its_process_is_killed(environment: dict[str, str]) -> None:
    code = """
from rig.transport.ownership import NotOwnedError, PortOwnership
try:
    own = PortOwnership("tcp://127.0.0.1:9")
    print("owned", flush=True)
    input()
except NotOwnedError as error:
    print(error.code)
"""
    words = [sys.executable, "-c", code]
    ask = partial(subprocess.run, words, env=environment, input="\n", capture_output=True, text=True, check=True)
    with subprocess.Popen(words, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as owner:
        try:
            assert owner.stdout is not None
            assert owner.stdout.readline() == "owned\n"
            assert ask().stdout == "in_use\n"
        finally:
            owner.kill()
    assert ask().stdout == "owned\n"


@pytest.mark.parametrize("most", [3, 10**9])
def test_a_file_that_is_read_is_replaced_afterwards(environment: dict[str, str], tmp_path: Path, most: int) -> None:
    code = """
import sys
from pathlib import Path
import rig.data.folder as folder
replace, refused = Path.replace, []
def busy(path, to):
    refused.append(path)
    if len(refused) > int(sys.argv[2]):
        return replace(path, to)
    raise PermissionError(13, "used by another process", str(to))
Path.replace, folder._READ_S = busy, 0.1
try:
    folder.replace_text(Path(sys.argv[1]), "new")
    print(Path(sys.argv[1]).read_text(), len(refused))
except folder.UnwritableError:
    print("refused", len(list(Path(sys.argv[1]).parent.glob("*.part"))))
"""
    words = [sys.executable, "-c", code, str(tmp_path / "mine"), str(most)]
    ended = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert ended.stdout == ("new 4\n" if most == 3 else "refused 0\n")


def test_what_the_system_lacks_is_refused(rig: Rig) -> None:
    refused = json.loads(rig("serve", "--pty", "--json", code=2).stdout)
    assert refused["code"] == "no_terminals"


def test_signs_that_a_pipe_of_windows_lacks_are_written_all_the_same(environment: dict[str, str]) -> None:
    commands = json.dumps([("config", "--markdown"), ("config", "--json")])
    ascii_only = {**environment, "PYTHONIOENCODING": "ascii"}
    ended = subprocess.run([sys.executable, "-c", SEVERAL, commands], env=ascii_only, capture_output=True, check=True)
    markdown, as_json, _ = ended.stdout.split(b"\0")
    assert ended.stdout.isascii()
    assert markdown
    json.loads(as_json)


@pytest.mark.parametrize("name", ["com12", r"\\.\COM12"])
def test_a_com_port_is_one_port_under_all_its_names(environment: dict[str, str], name: str) -> None:
    code = """
import sys
from rig.settings import StageSettings
from rig.transport.ownership import PortOwnership, NotOwnedError, identities, port_owner
assert StageSettings(port=sys.argv[1]).port == sys.argv[1]
assert identities(sys.argv[1]) == ("COM12",)
own = PortOwnership("COM12")
try:
    PortOwnership(sys.argv[1])
except NotOwnedError as error:
    assert error.owner.pid is None and not error.owner.same_account
assert port_owner(sys.argv[1]) is not None
own.release()
assert port_owner(sys.argv[1]) is None
"""
    subprocess.run([sys.executable, "-c", code, name], env=environment, check=True)
